"""A scan's arrays in a Zarr folder, a view a chunk: many machines can read it, and a store of objects can hold it."""

import contextlib
from pathlib import Path
from typing import Any

import numpy as np

from palpate.arrays import AnyArray
from palpate.bounded_read import parse_json
from palpate.errors import FileError
from palpate.volumes.zarr_folder import check_array, is_zarr, stored_bytes, zarr_package

SUFFIX = ".zarr"
LONGEST = 2**20  # bytes of attributes that are looked at
LEVEL = 4  # of gzip, whose checksum notices damage


def named_zarr(path: Path) -> bool:
    """Whether a name is that of a Zarr folder."""
    return path.name.lower().endswith(SUFFIX)


def attributes_of(path: Path) -> dict[str, Any]:
    """The attributes of a folder's group, without zarr; none if it has none that can be read."""
    for name in (".zattrs", "zarr.json"):
        with contextlib.suppress(OSError, ValueError), (path / name).open("rb") as file:
            said = parse_json(file.read(LONGEST))
            if isinstance(said, dict):
                inner = said if name == ".zattrs" else said.get("attributes")
                return inner if isinstance(inner, dict) else {}
    return {}


def new_group(path: Path) -> Any:
    """A group in an empty folder. Raises `FileError` without zarr."""
    return zarr_package().open_group(path, mode="w", zarr_format=2)


def group_of(path: Path) -> Any:
    """The group that a folder is, to read. Raises `FileError`."""
    zarr = zarr_package()
    if not is_zarr(path):
        raise FileError(f"{path}: not a Zarr folder (neither .zgroup nor zarr.json in it); check the name")
    return zarr.open_group(path, mode="r")


def put(group: Any, name: str, values: AnyArray) -> Any:
    """Writes an array; a chunk of zeros, too, since one that is missing must not pass for zeros."""
    values = np.asarray(values)
    stored = group.create_array(
        name,
        shape=values.shape,
        dtype=values.dtype,
        chunks=(1, *values.shape[1:]),
        compressors={"id": "gzip", "level": LEVEL},
        config={"write_empty_chunks": True},
    )
    stored[...] = values
    return stored


def get(path: Path, group: Any, name: str, remedy: str) -> AnyArray:
    """The numbers of an array. Raises `FileError`, and on damage whatever zarr does."""
    array = group.get(name)
    if not hasattr(array, "chunks"):
        raise FileError(f"{path}: array {name} is missing (there: {', '.join(sorted(group)) or 'none'}); {remedy}")
    if array.dtype.kind not in "fiub":
        raise FileError(f"{path}: {name}: expected real numbers, got {array.dtype}; convert them")
    check_array(path, array, f"numbers of {name}", stored_bytes(path / name))
    if name == "counts" and (missing := array.nchunks - array.nchunks_initialized):
        raise FileError(
            f"{path}: {missing} of {array.nchunks} chunks of {name} are missing; copy it again, or {remedy}"
        )
    return np.asarray(array[...])
