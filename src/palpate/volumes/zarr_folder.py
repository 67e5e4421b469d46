"""What all Zarr folders have in common: the package that reads them, and the care before anything is read."""

import math
import os
from pathlib import Path
from typing import Any

from palpate.bounded_read import check_claim
from palpate.errors import FileError

EMPTY = 2**20  # bytes that a folder counts for at least: chunks of zeros need not be there


def zarr_package() -> Any:
    """The package. Raises `FileError` without it."""
    try:
        import zarr
    except ImportError:
        raise FileError("Zarr folders need the package zarr: pip install 'palpate[zarr]'") from None
    return zarr


def is_zarr(path: Path) -> bool:
    """Whether a folder is a Zarr group."""
    return any((path / name).is_file() for name in (".zgroup", "zarr.json"))


def stored_bytes(path: Path) -> int:
    """Bytes of the files in a folder, which has to hold nothing but files and folders. Raises `FileError`."""
    size, folders = 0, [path]
    while folders:
        with os.scandir(folders.pop()) as entries:
            for entry in entries:
                if entry.is_dir():
                    folders.append(Path(entry.path))
                elif entry.is_file():
                    size += entry.stat().st_size
                else:
                    raise FileError(
                        f"{path}: {entry.name} in it is a pipe or a device, not a file; copy the folder again"
                    )
    return size


def check_array(path: Path, array: Any, unit: str, stored: int) -> None:
    """Raises `FileError` if an array, or a chunk of it, says more numbers than `stored` bytes can hold."""
    for what, shape in ((unit, array.shape), (f"{unit} a chunk", array.chunks)):
        check_claim(path, f"{shape} {what}", math.prod(shape) * array.dtype.itemsize, max(stored, EMPTY))
