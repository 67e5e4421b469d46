"""Writes HDF5 files so that a full disk is an error, not a crash."""

import contextlib
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py

from palpate.atomic_write import replacing
from palpate.interrupts import CALLED_BY_C


@contextlib.contextmanager
def replacing_hdf5(path: str | Path) -> Iterator[h5py.File]:
    """Gives an HDF5 file to fill, which becomes `path` as a whole or not at all. Raises `FileError`.

    The HDF5 library (2.0) crashes when it closes a file of which a write has failed. So it writes to a file
    that takes everything, and what the disk refused is raised when the library has closed it.
    """
    with replacing(path) as temporary, _TakesEverything(temporary, "w+") as disk:
        with h5py.File(disk, "w") as file:
            yield file
        if disk.refused is not None:
            raise disk.refused


class _TakesEverything(io.FileIO):
    """A file whose writes never fail; the first that did is in `refused`, and none is tried after it."""

    refused: OSError | None = None

    def write(self, data: Any) -> int:
        rest = memoryview(data).cast("B")
        size = len(rest)
        try:
            while len(rest) and self.refused is None:
                rest = rest[super().write(rest) or 0 :]
        except OSError as problem:
            self.refused = problem
        return size

    def truncate(self, size: int | None = None) -> int:
        if self.refused is None:
            try:
                return super().truncate(size)
            except OSError as problem:
                self.refused = problem
        return size or 0


CALLED_BY_C.update({_TakesEverything.write.__code__, _TakesEverything.truncate.__code__})
