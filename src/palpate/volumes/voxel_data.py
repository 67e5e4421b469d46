"""What formats with a text before their voxels share: the header's beginning, and as many voxels as it says."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.arrays import AnyArray
from palpate.bounded_read import check_claim, inflate
from palpate.errors import FileError

HEADER = 2**20  # bytes in which a header has to end; one of a hundred labels takes some 10,000


def read_header(path: Path) -> bytes:
    """The bytes of a file in which its header has to end."""
    with path.open("rb") as file:
        return file.read(HEADER)


def voxels_beside(path: Path, name: str) -> Path:
    """The file of voxels that the header in `path` names. Raises `FileError`."""
    if not (path.parent / name).is_file():
        raise FileError(f"{path}: its data file {name} is not beside it, or no file; put both in one folder")
    return path.parent / name


def read_voxels(
    path: Path, home: Path, start: int, kind: np.dtype[Any], sizes: Sequence[int], packed: int | None
) -> AnyArray:
    """(z, y, x) values in the file `home` from byte `start` on; `path` is that of the header, which messages name.

    sizes: x, y, z. packed: `wbits` of the deflate stream, None if there is none. Raises `FileError` if there are fewer
    voxels, or more of them are in the stream than are said to be.
    """
    if len(sizes) != 3 or min(sizes) < 1:
        raise FileError(
            f"{path}: expected 3 axes of one number a voxel, got sizes {list(sizes)}; save one volume a file"
        )
    wanted, there = math.prod(sizes) * kind.itemsize, home.stat().st_size - start
    if packed is None and there < wanted:
        raise FileError(f"{path}: truncated: {there} bytes of voxels, {wanted} expected; copy it again")
    check_claim(path, f"{list(sizes)} voxels", wanted, there)
    with home.open("rb") as file:
        file.seek(start)
        body = file.read(wanted if packed is None else 2 * wanted + HEADER)  # what is packed is hardly ever longer
    try:
        return np.frombuffer(body if packed is None else inflate(body, wanted, packed), kind).reshape(sizes[::-1])
    except ValueError as problem:
        raise FileError(f"{path}: voxels: {problem}; copy or export it again") from None
