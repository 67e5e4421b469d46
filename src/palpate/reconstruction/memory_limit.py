"""A limit of memory: arrays that do not fit lie in files, which the kernels read and write as if they were memory."""

import contextlib
import os
import re
import sys
import tempfile
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

from palpate import _core
from palpate.atomic_write import output_folder
from palpate.errors import DataError, FileError

UNITS = {"": 1, "B": 1, "KB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12, "KIB": 2**10, "MIB": 2**20, "GIB": 2**30}
SMALLEST = 500 * 10**6  # bytes
OTHERS = 250 * 10**6  # bytes that Python, its libraries and the kernels need beside arrays
ARRAYS = 0.5  # share of the rest that arrays take in memory; the other is for what passes through from files
TMPFS = {"tmpfs", "ramfs"}  # files there are memory


def bytes_of(words: str | float) -> int:
    """Of "4GB", "800 MB", "2GiB" or a number of bytes. Raises `DataError`."""
    found = re.fullmatch(r"\s*(\d+(?:\.\d*)?)\s*([A-Za-z]*)\s*", str(words))
    if not found or found[2].upper() not in UNITS:
        raise DataError(f"memory: {words!r}; expected an amount such as 4GB or 800MB")
    amount = int(float(found[1]) * UNITS[found[2].upper()])
    if amount < SMALLEST:
        raise DataError(f"memory: {words}; expected at least {SMALLEST // 10**6} MB")
    return amount


@contextlib.contextmanager
def memory_limit(memory: str | float, folder: str | Path | None = None) -> Iterator[None]:
    """Limit the memory of what is made in a block.

    Half of what Python itself leaves of it is for arrays in memory. All further ones lie in files without a name in the
    folder, and go with the process. Reconstructions pass over volumes in files slab by slab, with sums in another order:
    they are the same to 1e-6 of their norm. Blocks may not lie in each other.

    Parameters
    ----------
    memory : str or float
        "4GB", or a number of bytes.
    folder : str or Path, optional
        Where the files are: on a disk that is fast. The default is that of temporary files.

    Yields
    ------
    None
        The block.

    Raises
    ------
    DataError
        If the limit is no amount, or too small; on Windows.
    FileError
        If the folder cannot be written to, lies in memory itself, or is full.

    Examples
    --------
    >>> with pp.memory_limit("2GB"):
    ...     volume = pp.reconstruct(scan, grid, iterations=2)
    """
    if sys.platform == "win32":
        raise DataError("memory: there is no limit of memory on Windows; use the Linux subsystem")
    amount = bytes_of(memory)
    folder = output_folder(tempfile.gettempdir() if folder is None else folder).resolve()
    if file_system(folder) in TMPFS:
        raise FileError(f"{folder}: lies in memory itself; name a folder on a disk with --scratch")
    before = _core.base.set_allocator(_numpy_table(), _core.base.scratch_allocator())
    _core.base.set_scratch(str(folder), int((amount - OTHERS) * ARRAYS))
    try:
        yield
    except MemoryError:
        error = _core.base.scratch_use()[4]
        if error:
            raise FileError(
                f"{folder}: {os.strerror(error)}; make room, or name another folder with --scratch"
            ) from None
        raise
    finally:
        _core.base.set_allocator(_numpy_table(), before)
        _core.base.set_scratch("", 0)


def scratch_bytes() -> tuple[int, int]:
    """Bytes of large arrays in memory and in files, at most since the limit was set."""
    _, _, in_memory, in_files, _ = _core.base.scratch_use()
    return in_memory, in_files


def file_system(folder: Path) -> str:
    """The kind of file system that holds a folder, such as "ext4"; empty where the system does not tell."""
    try:
        mounts = [line.split() for line in Path("/proc/mounts").read_text(encoding="utf-8").splitlines()]
    except OSError:
        return ""
    holding = [(len(words[1]), words[2]) for words in mounts if folder.is_relative_to(words[1])]
    return max(holding, default=(0, ""))[1]


def _numpy_table() -> Any:
    """NumPy's table of functions."""
    with contextlib.suppress(ImportError):
        return import_module("numpy._core._multiarray_umath")._ARRAY_API
    return import_module("numpy.core._multiarray_umath")._ARRAY_API  # NumPy 1
