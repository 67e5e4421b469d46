"""Reads and writes scans as HDF5 files and Zarr folders; docs/formats.md documents their layout."""

import contextlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from palpate.arrays import AnyArray
from palpate.atomic_write import new_folder, replacing_folder, writable
from palpate.bounded_read import existing_file, existing_path, parse_json
from palpate.errors import DataError, FileError, GeometryError
from palpate.plugins import read_by_plugin
from palpate.scans.blur import Blur
from palpate.scans.dicom_projections import holds_projections, is_dicom_stack
from palpate.scans.importers import import_scan
from palpate.scans.scan import Scan
from palpate.scans.views import Panel, Views
from palpate.scans.zarr_arrays import attributes_of, get, group_of, named_zarr, new_group, put
from palpate.volumes.hdf5_guard import check_heap, read_dataset
from palpate.volumes.hdf5_output import replacing_hdf5

FORMAT, VERSION = "palpate scan", 1
PANEL = {"pitch": "mm", "origin": "mm", "row_axis": "1", "column_axis": "1"}  # each (1 or views, 2 or 3)
WAY_OUT = "write it with `palpate scan import` or palpate.write_scan"


def write_scan(path: str | Path, scan: Scan) -> None:
    """Write a scan as HDF5, or as a Zarr folder. Data that are equal along an axis are stored once.

    Parameters
    ----------
    path : str or Path
        The file. A name that ends with .zarr is that of a folder, which needs `pip install palpate[zarr]`.
    scan : Scan
        What to write.

    Raises
    ------
    FileError
        If it cannot be written. It is written completely or not at all.

    Examples
    --------
    >>> pp.write_scan("scan.h5", scan)
    """
    path = Path(path)
    if named_zarr(path):
        with replacing_folder(path) as made:
            _write(new_group(made), put, scan)
    else:
        with replacing_hdf5(path) as file:
            _write(file, _dataset, scan)


def writable_scan(path: Path) -> None:
    """Returns if a scan can be written to `path`. Call before long work. Raises `FileError`."""
    if named_zarr(path):
        new_folder(path)
    else:
        writable(path)


def read_scan(path: str | Path) -> Scan:
    """Read a scan from palpate's HDF5 file or Zarr folder, or from DICOM projections.

    Parameters
    ----------
    path : str or Path
        The file, a Zarr folder, or a folder with one DICOM file for each view.

    Returns
    -------
    Scan
        The projections and their geometry.

    Raises
    ------
    FileError
        If the file is missing or cannot be read.
    DataError, GeometryError
        If its contents are not valid; the message names the file.

    Examples
    --------
    >>> pp.write_scan("scan.h5", scan)
    >>> pp.read_scan("scan.h5").shape
    (5, 40, 48)
    """
    if (read := read_by_plugin(Path(path), Scan)) is not None:
        return read
    if is_dicom_stack(Path(path)):
        return import_scan(path)
    return _read_zarr(existing_path(path)) if named_zarr(Path(path)) else _read_hdf5(existing_file(path))


def is_scan(path: str | Path) -> bool:
    """Return whether `read_scan` can read a file: an HDF5 name, a Zarr folder with a scan, or DICOM projections.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    bool
        True for a scan.

    Raises
    ------
    FileError
        If a DICOM file is damaged.

    Examples
    --------
    >>> pp.is_scan("scan.h5")
    True
    """
    path = Path(path)
    if named_zarr(path) and path.is_dir():
        return attributes_of(path).get("format") == FORMAT
    return path.suffix.lower() in (".h5", ".hdf5") or holds_projections(path)


def drop_constant_axes(values: AnyArray, axes: Sequence[int] = (0, 1, 2)) -> AnyArray:
    """`values` with each axis along which nothing changes cut to length 1: it broadcasts back to the same array."""
    for axis in axes:
        first = values.take([0], axis=axis)
        if values.strides[axis] == 0 or (values == first).all():
            values = first
    return values


def _read_hdf5(path: Path) -> Scan:
    if not h5py.is_hdf5(path):
        raise FileError(f"{path}: not an HDF5 file; {WAY_OUT}")
    check_heap(path)
    with _named(path, "HDF5 file"), h5py.File(path, "r") as file:
        return _scan(path, file, lambda name: read_dataset(path, file, name, WAY_OUT))


def _read_zarr(path: Path) -> Scan:
    with _named(path, "Zarr folder"):
        group = group_of(path)
        return _scan(path, group, lambda name: get(path, group, name, WAY_OUT))


@contextlib.contextmanager
def _named(path: Path, kind: str) -> Iterator[None]:
    """Errors name the file. The libraries raise almost anything on a damaged one."""
    try:
        yield
    except (DataError, GeometryError) as problem:
        raise type(problem)(f"{path}: {problem}") from None
    except (FileError, MemoryError):
        raise
    except Exception as problem:
        raise FileError(f"{path}: truncated or damaged {kind} ({problem}); copy it again, or {WAY_OUT}") from None


def _write(file: Any, put: Callable[[Any, str, AnyArray], Any], scan: Scan) -> None:
    """Fills a file or a group. put: writes an array there, and gives what has its attributes."""
    file.attrs.update({"format": FORMAT, "version": VERSION})
    if scan.notes:
        file.attrs["notes"] = json.dumps(dict(scan.notes))
    if scan.blur is not None:
        file.attrs["blur"] = json.dumps(asdict(scan.blur))

    def store(name: str, values: AnyArray, unit: str, meaning: str = "") -> None:
        stored = put(file, name, values)
        stored.attrs["units"] = unit
        if meaning:
            stored.attrs["meaning"] = meaning

    store("counts", scan.counts, "photons")
    store("incident", drop_constant_axes(scan.incident), "photons")
    store("background", drop_constant_axes(scan.background), "photons")
    store("mask", drop_constant_axes(scan.mask), "1", "True where the pixel was measured")
    store("views/source", scan.views.source, "mm", "focal spot (x, y, z) of each view")
    if not np.array_equal(scan.views.direction, np.eye(3)):
        store("views/direction", scan.views.direction, "1", "columns: the world's axes in patient space, LPS")
    for name, unit in PANEL.items():
        values = np.array([getattr(panel, name) for panel in scan.views.panels])
        store(f"views/panel/{name}", drop_constant_axes(values, axes=(0,)), unit)


def _scan(path: Path, file: Any, array: Callable[[str], AnyArray]) -> Scan:
    """The scan in an HDF5 file or a Zarr group. array: reads one by its name."""
    if file.attrs.get("format") != FORMAT:
        raise FileError(f"{path}: its attribute 'format' is not {FORMAT!r}; {WAY_OUT}")
    if int(file.attrs.get("version", 0)) != VERSION:
        raise FileError(
            f"{path}: layout version {file.attrs.get('version')}, this palpate reads {VERSION}; update palpate"
        )

    def read(name: str) -> AnyArray:
        values = array(name)
        if values.dtype.kind == "V":
            raise DataError(f"/{name}: expected real numbers, got {values.dtype}; convert them first")
        return values

    counts = read("counts")
    if counts.ndim != 3:
        raise DataError(f"/counts: expected shape (views, rows, columns), got {counts.shape}")
    source, panel = read("views/source"), {name: read(f"views/panel/{name}") for name in PANEL}
    for name, values in panel.items():
        if values.ndim != 2 or len(values) not in (1, len(source)):
            raise DataError(
                f"/views/panel/{name}: expected one line, or {len(source)} (one a view), got {values.shape}"
            )
    moving = max(len(values) for values in panel.values())
    panels = [
        Panel(counts.shape[1:], **{name: values[k if len(values) > 1 else 0] for name, values in panel.items()})
        for k in range(moving)
    ]
    direction = read("views/direction") if "views/direction" in file else None
    views = Views(source, panels[0] if moving == 1 else panels, direction)
    said = parse_json(str(file.attrs.get("notes", "{}")))
    notes = {str(k): str(v) for k, v in said.items()} if isinstance(said, dict) else {}
    mask = read("mask").astype(bool)
    return Scan(counts, read("incident"), views, read("background"), mask, notes, _blur(file.attrs.get("blur")))


def _blur(words: Any) -> Blur | None:
    """What `write_scan` keeps of a blur. Raises `DataError`."""
    if words is None:
        return None
    said = parse_json(str(words))
    if not isinstance(said, dict) or not {*said} <= {"panel", "focal_spot", "at"}:
        raise DataError(f"attribute 'blur': expected panel, focal_spot and at, got {said!r}; {WAY_OUT}")
    return Blur(**said)


def _dataset(file: Any, name: str, values: AnyArray) -> Any:
    large = values.size > 4096
    how = {"chunks": (1, *values.shape[1:]), "compression": 4, "shuffle": True} if large else {}
    return file.create_dataset(name, data=values, **how)
