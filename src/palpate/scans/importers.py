"""Imports stacks of projections: DICOM, raw, TIFF, MATLAB and NumPy files, and palpate's samples."""

import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import scipy.io

from palpate.arrays import AnyArray, Bool, Float64
from palpate.bounded_read import check_claim, existing_file, read_text
from palpate.errors import DataError, FileError
from palpate.samples import sample
from palpate.scans.dicom_projections import dicom_projections, dicom_scan, is_dicom_stack
from palpate.scans.geometry_file import AXES, LINE_INTEGRALS, Geometry, Stack, read_geometry
from palpate.scans.intensity_correction import equal_contrast, open_beam
from palpate.scans.scan import Scan, per_pixel
from palpate.scans.scatter.scan_scatter import add_scatter
from palpate.volumes.suppress_output import suppress_output
from palpate.volumes.tiff import whole_series

BESIDE = "geometry.yaml"  # beside DICOM files, where their tags do not tell the geometry
SAMPLES = ("breast", "head")
MOST = 25.0  # of a line integral: e^-25 of the photons are left
WIDTH = {"double": 8, "single": 4, "int64": 8, "uint64": 8, "int32": 4, "uint32": 4, "int16": 2, "uint16": 2}
FORMAT_OF = {".raw": "raw", ".bin": "raw", ".tif": "tiff", ".tiff": "tiff", ".mat": "mat", ".npy": "npy"}


def import_scan(stack: str | Path, geometry: str | Path | Geometry | None = None) -> Scan:
    """Import a stack of projections and its geometry.

    Parameters
    ----------
    stack : str or Path
        A file, a folder, a pattern such as "view_*.tif" (sorted by number) or the name of a
        sample: "breast" or "head".
    geometry : str, Path or Geometry, optional
        A geometry file in YAML; `palpate scan template` writes one. DICOM projections hold their geometry. One that is
        given, or that lies beside them as geometry.yaml, takes precedence.

    Returns
    -------
    Scan
        The projections.

    Raises
    ------
    FileError, DataError, GeometryError
        If a file is missing, or its contents are not valid.

    Examples
    --------
    >>> pp.import_scan("breast").shape
    (7, 170, 615)
    """
    if is_dicom_stack(Path(stack)):
        return _of_dicom(Path(stack), geometry)
    g = geometry_of(stack, geometry)
    ours = str(stack) in SAMPLES and g.path.parent == sample(str(stack))
    paths = stack_files(g.path.parent / str(g.stack.files)) if ours else stack_files(Path(stack), g.stack)
    values = np.transpose(read_stack(paths, g.stack), [g.stack.axes.index(axis) for axis in AXES])
    check_shape(paths[0], values, g)
    try:
        return _scan(values, g)
    except DataError as problem:
        raise DataError(f"{paths[0]}: {problem}") from None


def _of_dicom(path: Path, geometry: str | Path | Geometry | None) -> Scan:
    beside = (path if path.is_dir() else path.parent) / BESIDE
    if geometry is None and not beside.exists():
        return dicom_scan(path)
    g = geometry if isinstance(geometry, Geometry) else read_geometry(geometry or beside)
    values, measured, _ = dicom_projections(path)
    check_shape(path, values, g)
    try:
        return _scan(values, g, measured)
    except DataError as problem:
        raise DataError(f"{path}: {problem}") from None


def geometry_of(stack: str | Path, geometry: str | Path | Geometry | None = None) -> Geometry:
    """The geometry of a stack: the given file, or that of the sample that `stack` names."""
    if isinstance(geometry, Geometry):
        return geometry
    if geometry is not None:
        return read_geometry(geometry)
    if str(stack) in SAMPLES:
        return read_geometry(sample(str(stack)) / "geometry.yaml")
    stack_files(Path(stack))  # a name that is wrong is the first thing to say
    raise FileError(
        f"{stack}: no geometry file; write one with `palpate scan template -o geometry.yaml`, fill it in, and "
        f"give it with --geometry (samples that need none: {', '.join(SAMPLES)})"
    )


def _scan(values: AnyArray, g: Geometry, measured: Bool | None = None) -> Scan:
    mask = np.ones(values.shape, dtype=bool) if measured is None else measured
    if g.unmeasured is not None:
        mask = mask & (~np.isnan(values) if np.isnan(g.unmeasured) else values != g.unmeasured)
    if g.dead is not None:
        mask = mask & ~dead_pixels(g.dead, g.views.shape[1:])
    counts = np.where(mask, values, 0)
    if g.values == LINE_INTEGRALS and isinstance(g.incident, str):
        raise DataError("incident: line integrals do not tell it; give the photons of a pixel in air as a number")
    incident = open_beam(counts, mask, g.values == "photons") if isinstance(g.incident, str) else g.incident
    if isinstance(g.background, str):
        raise DataError("background: cannot be estimated; give a number, or one a view")
    if g.values == LINE_INTEGRALS:
        counts = _counts_of(values, mask, incident, g)
    elif g.contrast == "equal":
        counts = equal_contrast(counts, incident, mask)
    scan = Scan(counts, incident, g.views, g.background, mask, blur=g.blur)
    return add_scatter(scan, g.scatter, g.beam.kv, g.beam.target, g.beam.gap, g.beam.grid, g.beam.thickness)


def _counts_of(values: AnyArray, mask: Bool, incident: float | Float64, g: Geometry) -> AnyArray:
    """Counts whose line integrals are `values`: incident e⁻ᵖ + background."""
    if not np.isfinite(values[mask]).all() or np.abs(values[mask]).max(initial=0) > MOST:
        raise DataError(
            f"values: line integrals must be finite and at most {MOST:g} in size, found {np.abs(values[mask]).max():g}; are "
            f"they counts, or scaled? State them as natural logarithms"
        )
    beam, background = (
        per_pixel(n, v, values.shape) for n, v in (("incident", incident), ("background", g.background))
    )
    return np.where(mask, beam * np.exp(-np.where(mask, values, 0.0)) + background, 0)


def stack_files(where: Path, stack: Stack | None = None) -> list[Path]:
    """The files of a stack, natural order: view_2 before view_10."""
    if where.is_dir():
        pattern = (stack.files if stack else None) or "*"
        found = [p for p in where.glob(pattern) if p.is_file() and p.name[0] != "."]
        if pattern == "*":
            found = [p for p in found if p.suffix.lower() in FORMAT_OF]
    elif re.search(r"[*?\[]", where.name) and not where.exists():
        found = [p for p in where.parent.glob(where.name) if p.is_file()]
    else:
        return [existing_file(where)]
    if not found:
        raise FileError(f"{where}: no projections there; name a file, a folder or a pattern such as 'view_*.tif'")
    return sorted(found, key=lambda p: [int(w) if w.isdigit() else w for w in re.split(r"(\d+)", p.name)])


def read_stack(paths: list[Path], stack: Stack) -> AnyArray:
    """One array of three axes, in the order of the file; several files follow each other along the axis of views."""
    form = stack.format or FORMAT_OF.get(paths[0].suffix.lower())
    if form is None:
        raise FileError(f"{paths[0]}: cannot tell the format from the name; set stack.format to raw, tiff, mat or npy")
    parts = [READERS[form](path, stack, len(paths)) for path in paths]
    views = stack.axes.index("view")
    parts = [np.expand_dims(part, views) if part.ndim == 2 else part for part in parts]
    for path, part in zip(paths, parts, strict=True):
        if part.dtype.kind not in "fiub":
            raise DataError(f"{path}: expected real numbers, got dtype {part.dtype}; export it as numbers")
        if part.ndim != 3 or np.delete(part.shape, views).tolist() != np.delete(parts[0].shape, views).tolist():
            raise DataError(
                f"{path}: shape {part.shape} does not follow {parts[0].shape} of {paths[0].name}; "
                f"expected images of one shape, with three axes in all"
            )
    return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=views)


def _raw(path: Path, stack: Stack, files: int) -> AnyArray:
    if stack.dtype is None or stack.shape is None:
        raise FileError(
            f"{path}: a raw file says nothing of itself; set stack.dtype and stack.shape in the geometry file"
        )
    kind = np.dtype(stack.dtype).newbyteorder("<" if stack.order == "little" else ">")
    views = stack.axes.index("view")
    if stack.shape[views] % files:
        raise DataError(f"{path}: {files} files cannot hold equal parts of stack.shape {stack.shape}; check both")
    shape = tuple(n // files if axis == views else n for axis, n in enumerate(stack.shape))
    wanted, there = stack.offset + math.prod(shape) * kind.itemsize, path.stat().st_size
    if there != wanted:
        what = "truncated, or" if there < wanted else "longer than"
        raise FileError(
            f"{path}: {there} bytes, {wanted} expected: {what} not {shape} of {stack.dtype} after {stack.offset}; "
            f"check stack.shape, dtype and offset"
        )
    return np.fromfile(path, kind, offset=stack.offset).reshape(shape)


def _tiff(path: Path, stack: Stack, files: int) -> AnyArray:
    with whole_series(path) as (_, series):
        values: AnyArray = np.squeeze(series.asarray())
        return values


def _mat(path: Path, stack: Stack, files: int) -> AnyArray:
    try:
        for one, shape, kind in scipy.io.whosmat(path):
            if min(shape, default=0) < 0:
                raise ValueError(f"{one} has shape {shape}")
            check_claim(path, f"{one} {shape}", math.prod(map(int, shape)) * WIDTH.get(kind, 1), path.stat().st_size)
        content = scipy.io.loadmat(path)
    except NotImplementedError:
        raise FileError(f"{path}: a MATLAB 7.3 file; save it in MATLAB with save(..., '-v7')") from None
    except FileError:
        raise
    except Exception as problem:  # scipy's reader raises almost anything on a damaged file
        raise FileError(f"{path}: not a whole MATLAB file ({problem}); copy or save it again") from None
    arrays = {k: v for k, v in content.items() if k[0] != "_" and isinstance(v, np.ndarray)}
    name = stack.variable
    if name is None:
        stacks = [k for k, v in arrays.items() if v.ndim == 3]
        name = stacks[0] if len(stacks) == 1 else None
    if name not in arrays:
        there = ", ".join(f"{k} {v.shape}" for k, v in arrays.items()) or "none"
        raise DataError(f"{path}: no variable {name or 'chosen'}; set stack.variable to one of: {there}")
    return arrays[name]


def _npy(path: Path, stack: Stack, files: int) -> AnyArray:
    try:
        with suppress_output():
            return np.array(np.load(path, mmap_mode="r", allow_pickle=False))  # a map allocates no more than is there
    except Exception as problem:  # what stands in the header is evaluated
        raise FileError(f"{path}: not a whole NumPy file ({problem}); copy or save it again") from None


READERS: dict[str, Callable[[Path, Stack, int], AnyArray]] = {"raw": _raw, "tiff": _tiff, "mat": _mat, "npy": _npy}


def check_shape(path: Path, values: AnyArray, g: Geometry) -> None:
    """Raises `DataError` unless a stack has the shape that the geometry says."""
    if values.shape == g.views.shape:
        return
    way = "check panel.shape and the number of views"
    if sorted(values.shape) == sorted(g.views.shape):
        order = [AXES[g.views.shape.index(n)] for n in np.transpose(values, _inverse(g)).shape]
        way = f"set stack.axes: [{', '.join(order)}]" if len(set(order)) == 3 else "check stack.axes"
    raise DataError(
        f"{path}: holds (view, row, column) = {values.shape}, the geometry {g.path} says {g.views.shape}; {way}"
    )


def _inverse(g: Geometry) -> list[int]:
    """Back from (view, row, column) to the order of the file."""
    return [AXES.index(axis) for axis in g.stack.axes]


def dead_pixels(path: Path, shape: tuple[int, int]) -> Bool:
    """True at the pixels that a text file lists, one "row column" a line, # starts a comment."""
    mask = np.zeros(shape, dtype=bool)
    for number, line in enumerate(read_text(path).splitlines(), 1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        if len(words) != 2 or not all(w.isdigit() for w in words):
            raise DataError(f"{path}, line {number}: expected 'row column', got {line!r}")
        row, column = map(int, words)
        if row >= shape[0] or column >= shape[1]:
            raise DataError(
                f"{path}, line {number}: pixel ({row}, {column}) is not on a panel of {shape}; count from 0"
            )
        mask[row, column] = True
    return mask
