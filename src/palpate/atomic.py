"""Outputs appear whole or not at all: written under a temporary name beside the target, then renamed."""

import contextlib
import os
import uuid
from collections.abc import Iterator
from pathlib import Path

from palpate.errors import FileError


def writable(path: str | Path) -> Path:
    """`path`, once it is sure that a file can be made there. Call before long work. Raises `FileError`."""
    path = Path(path)
    folder = path.parent
    if not folder.is_dir():
        raise FileError(f"{path}: folder {folder} does not exist; make it first: mkdir -p {folder}")
    if path.is_dir():
        raise FileError(f"{path}: is a folder; name a file")
    probe = folder / f".{path.name}.{uuid.uuid4().hex[:8]}.part"
    try:
        probe.touch()
        probe.unlink()
    except OSError as problem:
        raise FileError(
            f"{path}: folder {folder} is not writable ({problem.strerror}); choose another with -o"
        ) from None
    return path


def output_folder(path: str | Path) -> Path:
    """Folder `path`, made if need be and known to be writable. Raises `FileError`."""
    path = Path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise FileError(f"{path}: cannot make this folder ({problem.strerror}); choose another with -o") from None
    writable(path / "probe")
    return path


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Gives a temporary path to write; renames it to `path` when the block ends well, removes it when it does not.

    The temporary name keeps the suffixes (`.nii.gz`), since many writers choose the format by them.
    """
    path = writable(path)
    suffixes = "".join(path.suffixes[-2:])
    temporary = path.parent / f".part-{uuid.uuid4().hex[:8]}{suffixes}"
    try:
        yield temporary
        with temporary.open("rb") as written:
            os.fsync(written.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
