"""Reads HDF5 files that may be damaged: where the library would not return, or take what memory there is."""

import math
import mmap
import struct
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from palpate.arrays import AnyArray
from palpate.bounded_read import check_claim, existing_file, inflate
from palpate.errors import FileError

HEAP = b"GCOL\x01\x00\x00\x00"  # a global heap collection, version 1: where texts of any length lie
HEADER = 16  # bytes, of a collection and of each object in it
DEFLATE, SHUFFLE, CHECKSUM = h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32


def read_dataset(path: Path, file: Any, name: str, remedy: str = "copy it again") -> AnyArray:
    """The numbers of a dataset that lies in the file itself. Raises `FileError`, and on damage whatever h5py does."""
    parts = name.split("/")
    links = [file.get("/".join(parts[: k + 1]), getlink=True) for k in range(len(parts))]
    dataset = None if any(isinstance(link, h5py.ExternalLink) for link in links) else file.get(name)
    if not isinstance(dataset, h5py.Dataset):
        raise FileError(f"{path}: dataset /{name} is missing (there: {', '.join(list(file)[:20]) or 'none'}); {remedy}")
    if dataset.is_virtual or dataset.external:
        raise FileError(f"{path}: the numbers of /{name} lie in another file; copy them into this one")
    if dataset.dtype.kind not in "fiubV" or dataset.shape is None:
        raise FileError(
            f"{path}: /{name}: expected real numbers, got {dataset.dtype}, shape {dataset.shape}; convert them"
        )
    size = math.prod(dataset.shape) * dataset.dtype.itemsize
    check_claim(path, f"/{name} {dataset.shape}", size, path.stat().st_size)
    way = dataset.id.get_create_plist()
    filters = [way.get_filter(k)[0] for k in range(way.get_nfilters())]
    if set(filters) - {DEFLATE, SHUFFLE, CHECKSUM}:
        raise FileError(f"{path}: /{name} is compressed by another way than gzip; write it with gzip, or plain")
    return _inflated(dataset, filters) if DEFLATE in filters else np.asarray(dataset[()])


def _inflated(dataset: Any, filters: list[int]) -> AnyArray:
    """The numbers, unpacked here: the library goes on as long as a chunk's stream does."""
    values = np.full(dataset.shape, dataset.fillvalue, dataset.dtype)
    width, shape = dataset.dtype.itemsize, dataset.chunks
    chunks: list[Any] = []
    dataset.id.chunk_iter(chunks.append)
    for chunk in chunks:
        if chunk.filter_mask:
            raise ValueError("a chunk that is not compressed as the others are")
        packed = dataset.id.read_direct_chunk(chunk.chunk_offset)[1]
        data = inflate(packed[:-4] if CHECKSUM in filters else packed, math.prod(shape) * width, 15)
        there = values[tuple(slice(a, a + n) for a, n in zip(chunk.chunk_offset, shape, strict=True))]
        part = there if there.shape == shape and there.flags.c_contiguous else np.empty(shape, dataset.dtype)
        columns = part.reshape(-1).view(np.uint8).reshape(-1, width)
        if (
            SHUFFLE in filters
        ):  # the first bytes of all numbers, then the second: byte by byte is thrice as fast as at once
            for column, plane in zip(columns.T, np.frombuffer(data, np.uint8).reshape(width, -1), strict=True):
                column[...] = plane
        else:
            columns[...] = np.frombuffer(data, np.uint8).reshape(-1, width)
        if part is not there:
            there[...] = part[tuple(slice(n) for n in there.shape)]
    return np.asarray(dataset[()]) if CHECKSUM in filters else values  # only the library checks the sums


def check_heap(path: Path) -> None:
    """Raises a `FileError` if the free space in a heap of texts has length 0.

    The library (1.14) adds that length to where it reads, again and again; nothing can interrupt it. An object is its
    number (0: free space), a count of references, 4 bytes of nothing, its length, and its bytes padded to 8; the length
    of free space counts its own header (HDF5 file format specification, III.E).
    """
    if existing_file(path).stat().st_size == 0:
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
