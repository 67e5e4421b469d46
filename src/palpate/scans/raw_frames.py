"""Reads what belongs to a raw scan: views, dark, flat, gain, mask, and numbers one a view."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate.arrays import AnyArray, Bool, Float64
from palpate.bounded_read import existing_file, read_text
from palpate.errors import DataError, FileError
from palpate.scans.dicom_projections import dicom_frames, is_dicom_stack
from palpate.scans.geometry_file import AXES, LINE_INTEGRALS, Geometry, read_geometry
from palpate.scans.importers import BESIDE, check_shape, dead_pixels, geometry_of, read_stack, stack_files
from palpate.scans.lag import Lag
from palpate.scans.views import Views

FLAT = "flat"  # the line of a table of doses that says the flat's


def read_raw(stack: str | Path, geometry: str | Path | None = None) -> tuple[AnyArray, Bool, Views, Geometry | None]:
    """What a panel read (views, rows, columns), which of it was measured, the geometry, and the file that said so.

    Raises `FileError`, `DataError`, `GeometryError`.
    """
    path = Path(stack)
    if is_dicom_stack(path):
        values, measured, views = dicom_frames(path, linear=True)
        beside = (path if path.is_dir() else path.parent) / BESIDE
        if geometry is None and not beside.exists():
            return values, measured, views(), None
        g = read_geometry(geometry or beside)
    else:
        g = geometry_of(str(stack), geometry)
        paths = stack_files(path, g.stack)
        values = np.transpose(read_stack(paths, g.stack), [g.stack.axes.index(axis) for axis in AXES])
        measured = np.ones(values.shape, bool)
    if g.values == LINE_INTEGRALS:
        raise DataError(f"{g.path}: values are line integrals, which are flat-fielded already: palpate scan import")
    check_shape(path, values, g)
    if g.unmeasured is not None:
        measured = measured & (~np.isnan(values) if np.isnan(g.unmeasured) else values != g.unmeasured)
    return values, measured, g.views, g


def read_frames(name: str, path: Path, g: Geometry | None) -> AnyArray:
    """Frames (n, rows, columns) of one file or several, stored as the views are. Raises `FileError`, `DataError`."""
    try:
        if is_dicom_stack(path):
            return dicom_frames(path, linear=True)[0]
        if g is None:
            raise FileError(
                f"{path}: its views are DICOM, so give DICOM files, or --geometry that says how it is stored"
            )
        stack = replace(g.stack, files=None, format=None)
        paths = stack_files(path, stack)
        if stack.shape is not None and stack.dtype is not None:  # a raw file: as many frames as it holds
            axis = stack.axes.index("view")
            shape = list(stack.shape)
            frame = int(np.prod(np.delete(shape, axis))) * np.dtype(stack.dtype).itemsize
            held = max(1, (paths[0].stat().st_size - stack.offset) // frame)
            shape[axis] = int(held) * len(paths)
            stack = replace(stack, shape=(shape[0], shape[1], shape[2]))
        return np.transpose(read_stack(paths, stack), [stack.axes.index(axis) for axis in AXES])
    except (DataError, FileError) as problem:
        raise type(problem)(f"{name}: {problem}") from None


def number_or_frames(name: str, given: str, g: Geometry | None) -> AnyArray | float:
    """A number, or the frames of a file."""
    value = number(given)
    return read_frames(name, Path(given), g) if value is None else value


def read_mask(path: Path, g: Geometry | None, shape: tuple[int, int]) -> Bool:
    """True at bad pixels: where an image is not 0, or those that a text lists as "row column"."""
    if path.suffix.lower() in (".txt", ".csv"):
        return dead_pixels(existing_file(path), shape)
    frames = read_frames("bad_pixels", path, g)
    if frames.shape != (1, *shape):
        raise DataError(f"bad_pixels: {path} holds {frames.shape}, expected one image of {shape}")
    return np.asarray(frames[0] != 0)


def parse_lag(given: str) -> Lag | None:
    """A share such as 0.03, or pairs amplitude:decay with commas between; None where the text is neither."""
    if (share := number(given)) is not None:
        return Lag.first_order(share)
    pairs = [[number(part) for part in pair.split(":")] for pair in given.split(",")]
    if all(len(pair) == 2 and None not in pair for pair in pairs):
        return Lag(tuple((float(a or 0), float(d or 0)) for a, d in pairs))
    return None


def read_by_view(name: str, path: Path, views: int, flat: bool = False) -> Float64:
    """One number a view from a table of lines "view,number", counted from 0; a line of words is a header.

    flat: the table has a line "flat,number" too, by which all others are divided. Raises `FileError`, `DataError`.
    """
    found: dict[str, float] = {}
    for row, words in enumerate(csv.reader(read_text(path).splitlines()), 1):
        words = [word.strip() for word in words if word.strip()]
        if not words or words[0].startswith("#"):
            continue
        value = number(words[-1])
        key = words[0].lower()
        if len(words) != 2 or value is None or not (key == FLAT or key.isdigit()):
            if not found and value is None:
                continue
            raise DataError(
                f"{name}: {path}, line {row}: expected 'view,number' or 'flat,number', got {','.join(words)!r}"
            )
        if key in found:
            raise DataError(f"{name}: {path}, line {row}: a second number for {'view ' * (key != FLAT)}{key}")
        found[key] = value
    wanted = [str(k) for k in range(views)]
    missing = [k for k in wanted if k not in found]
    extra = [k for k in found if k not in wanted and k != FLAT]
    if missing or extra:
        said = f"no number for view {missing[0]}" if missing else f"a view {extra[0]}"
        raise DataError(f"{name}: {path} has {said}; the scan has views 0 to {views - 1}")
    numbers = np.array([found[k] for k in wanted])
    if not flat:
        return numbers
    if not found.get(FLAT, 0.0) > 0:
        raise DataError(
            f"{name}: {path} has no line 'flat,number' above 0; add the reading of the flat, in the same unit"
        )
    return numbers / found[FLAT]


def number(text: str) -> float | None:
    """The number that a text is, None if it is none."""
    try:
        return float(text)
    except ValueError:
        return None
