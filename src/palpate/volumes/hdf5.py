"""A damaged HDF5 file in which the HDF5 library would read for ever."""

import mmap
import struct
from pathlib import Path

from palpate.errors import FileError

HEAP = b"GCOL\x01\x00\x00\x00"  # a global heap collection, version 1: where texts of any length lie
HEADER = 16  # bytes, of a collection and of each object in it


def refuse_endless_heap(path: Path) -> None:
    """Raises a `FileError` when the free space in a heap of texts is said to be 0 long.

    The library (1.14) adds that length to where it reads, again and again; nothing can interrupt it. An object is its
    number (0: free space), a count of references, 4 bytes of nothing, its length, and its bytes padded to 8; the length
    of free space counts its own header (HDF5 file format specification, III.E).
    """
    if path.stat().st_size == 0:
        return
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        start = data.find(HEAP)
        while start >= 0:
            (length,) = struct.unpack_from("<Q", data, start + 8) if start + HEADER <= len(data) else (0,)
            at, end = start + HEADER, min(start + length, len(data))
            while at + HEADER <= end:
                number, size = struct.unpack_from("<H6xQ", data, at)
                if number == 0 and size == 0:
                    raise FileError(
                        f"{path}: damaged HDF5 file (a heap of texts without end at byte {at}); copy it again"
                    )
                at += size if number == 0 else HEADER + (size + 7) // 8 * 8
            start = data.find(HEAP, start + 1)
