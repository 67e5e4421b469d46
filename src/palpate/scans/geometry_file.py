"""The geometry file: YAML with the positions of tube and panel, and the meaning of the stored values."""

import difflib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from palpate.arrays import Float64
from palpate.bounded_read import read_text
from palpate.errors import GeometryError
from palpate.scans import orbits, trajectories
from palpate.scans.blur import Blur
from palpate.scans.bounded_yaml import yaml_in
from palpate.scans.views import Panel, Views

UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 0.001}
AXES = ("view", "row", "column")
TOP = (
    "units",
    "values",
    "incident",
    "background",
    "contrast",
    "unmeasured",
    "dead",
    "stack",
    "panel",
    "views",
    "scatter",
    "beam",
    "blur",
)
ORBIT = ("count", "arc", "start", "elevation", "axis", "centre")
# Of each motion: its function, the keys it cannot do without, those it can; LENGTHS are scaled by the file's units.
SWEEP = ("count", "centre", "fulcrum")
MOTIONS: dict[str, tuple[Callable[..., Views], tuple[str, ...], tuple[str, ...]]] = {
    "circular": (trajectories.circular_views, ("radius", "height"), (*SWEEP, "start")),
    "linear": (trajectories.linear_views, ("length", "height"), (*SWEEP, "direction")),
    "hypocycloid": (trajectories.hypocycloid_views, ("radius", "height"), (*SWEEP, "cusps", "start")),
    "arc": (trajectories.arc_views, ("angles", "radius"), ("pivot",)),
    "rotating": (trajectories.rotating_views, ("angles", "source"), ("pivot", "axis")),
    "orbit": (orbits.orbit_views, ("source_to_centre", "source_to_panel"), ORBIT),
    "parallel": (orbits.parallel_views, ("centre_to_panel",), ORBIT),
}
LENGTHS = (
    "radius",
    "height",
    "length",
    "centre",
    "fulcrum",
    "pivot",
    "source",
    "source_to_centre",
    "source_to_panel",
    "centre_to_panel",
)
FORMATS = ("raw", "tiff", "mat", "npy")
LINE_INTEGRALS = "line integrals"
VALUES = ("photons", "intensity", LINE_INTEGRALS)


@dataclass(frozen=True)
class Stack:
    """Layout of a stack in its file or files; shape, dtype, offset and order serve raw files only."""

    files: str | None = None
    format: str | None = None
    dtype: str | None = None
    shape: tuple[int, ...] | None = None
    offset: int = 0
    order: str = "little"
    axes: tuple[str, ...] = AXES
    variable: str | None = None


@dataclass(frozen=True)
class Beam:
    """What estimated scatter needs to know: kV, anode/filter, mm from the object to the panel, anti-scatter grid.

    thickness: of the object at its thickest, mm, if it is known.
    """

    kv: float | None = None
    target: str = "W/Rh"
    gap: float = 15.0
    grid: str = "none"
    thickness: float | None = None


@dataclass(frozen=True, eq=False)
class Geometry:
    """What a geometry file says. incident: photons a pixel: one number, (views,), or "estimate"; background likewise.

    values: "photons", "intensity" or "line integrals". contrast: "as stored" or "equal" (intensities only). unmeasured:
    value that marks pixels that saw nothing. dead: list of dead pixels. scatter: none, estimate, or a file. blur: of panel
    and focal spot.
    """

    path: Path
    views: Views
    stack: Stack
    values: str = "photons"
    incident: float | Float64 | str = "estimate"
    background: float | Float64 | str = 0.0
    contrast: str = "as stored"
    unmeasured: float | None = None
    dead: Path | None = None
    scatter: str = "none"
    beam: Beam = Beam()
    blur: Blur | None = None


def read_geometry(path: str | Path) -> Geometry:
    """Read a geometry file.

    Parameters
    ----------
    path : str or Path
        A YAML file, as `palpate scan template` writes it.

    Returns
    -------
    Geometry
        Views and incident counts. Lengths are in mm, whatever the unit of the file.

    Raises
    ------
    FileError
        If the file is missing or is not YAML.
    GeometryError
        If a key is wrong; the message names it.

    Examples
    --------
    >>> try:
    ...     pp.read_geometry("missing.yaml")
    ... except pp.errors.FileError:
    ...     print("no such file")
    no such file
    """
    path = Path(path)
    content = yaml_in(path, read_text(path), "see: palpate scan template")
    try:
        return _geometry(path, content)
    except ValueError as problem:  # GeometryError and DataError are ValueErrors: say in which file
        raise GeometryError(f"{path}: {problem}") from None


def _geometry(path: Path, content: Any) -> Geometry:
    top = _mapping("the file", content, ("panel", "views", "incident"), TOP)
    units = _one_of("units", top.get("units", "mm"), tuple(UNITS))
    views = _views(top, UNITS[units])
    incident, background = (_level(k, top.get(k, 0), len(views)) for k in ("incident", "background"))
    values = _one_of("values", top.get("values", "photons"), VALUES)
    contrast = _one_of("contrast", top.get("contrast", "as stored"), ("as stored", "equal"))
    if contrast == "equal" and values != "intensity":
        raise GeometryError(f"contrast: equal would spoil {values}; leave it out, or say values: intensity")
    unmeasured, dead = top.get("unmeasured"), top.get("dead")
    return Geometry(
        path,
        views,
        _stack(top.get("stack") or {}),
        values,
        incident,
        background,
        contrast,
        None if unmeasured is None else _number("unmeasured", unmeasured, finite=False),
        None if dead is None else path.parent / str(dead),
        _scatter(path, str(top.get("scatter", "none"))),
        _beam(top.get("beam") or {}, UNITS[units]),
        _blur(top.get("blur"), views, UNITS[units]),
    )


def _blur(given: Any, views: Views, length: float) -> Blur | None:
    if given is None:
        return None
    b = _mapping("blur", given, (), ("panel", "focal_spot", "at"))
    widths = {k: _number(f"blur.{k}", b[k]) * length for k in ("panel", "focal_spot") if k in b}
    at = b.get("at")
    blur = Blur(**widths, at=None if at is None else np.asarray(_value("blur.at", at)) * length)
    blur.check(views)
    return blur


def _scatter(path: Path, given: str) -> str:
    """none, estimate, or the path of a file beside the geometry file."""
    return given if given in ("none", "estimate") else str(path.parent / given)


def _beam(given: Any, length: float) -> Beam:
    b = _mapping("beam", given, (), ("kv", "target", "gap", "grid", "thickness"))
    return Beam(
        None if b.get("kv") is None else _number("beam.kv", b["kv"]),
        str(b.get("target", Beam.target)),
        _number("beam.gap", b["gap"]) * length if "gap" in b else Beam.gap,
        str(b.get("grid", Beam.grid)),
        None if b.get("thickness") is None else _number("beam.thickness", b["thickness"]) * length,
    )


def _views(top: Mapping[str, Any], length: float) -> Views:
    common = _mapping("panel", top["panel"], ("shape", "pitch"), ("origin", "centre", "row_axis", "column_axis"))
    if isinstance(top["views"], Sequence) and not isinstance(top["views"], str):
        return _free(common, top["views"], length)
    name = _mapping("views", top["views"], ("motion",), None)["motion"]
    make, required, optional = MOTIONS[_one_of("views.motion", name, tuple(MOTIONS), "or list each view by itself")]
    given = _mapping("views", top["views"], ("motion", *required), optional)
    values = {
        key: _value(f"views.{key}", given[key])
        for key in (*required, *optional)
        if key in required or given.get(key) is not None
    }
    scaled = {key: value * length if key in LENGTHS else value for key, value in values.items()}
    if name in ("orbit", "parallel"):  # they place the panel themselves
        common = _mapping("panel", common, ("shape", "pitch"), ())
        shape, pitch = _numbers("panel.shape", common["shape"], 2), _numbers("panel.pitch", common["pitch"], 2) * length
        return make(shape, pitch, **scaled)
    return make(_panel("panel", common, length), **scaled)


def _free(common: Mapping[str, Any], entries: Sequence[Any], length: float) -> Views:
    """One entry a view, each with its source and, where the panel moves, its panel's pose."""
    if not entries:
        raise GeometryError("views: the list is empty; give each view its source")
    sources, panels = [], []
    for k, entry in enumerate(entries):
        where = f"views[{k}]"
        view = _mapping(where, entry, (), ("source", "direction", "panel"))
        if ("source" in view) == ("direction" in view):
            raise GeometryError(f"{where}: give either source (focal spot) or direction (of a parallel beam's rays)")
        sources.append(_source(where, view, length))
        pose = _mapping(f"{where}.panel", view.get("panel") or {}, (), ("origin", "centre", "row_axis", "column_axis"))
        placed = {k: v for k, v in common.items() if not (k in ("origin", "centre") and {"origin", "centre"} & {*pose})}
        panels.append(_panel(f"{where}.panel" if pose else "panel", {**placed, **pose}, length))
    return Views(
        np.array(sources), panels if any(isinstance(e, Mapping) and "panel" in e for e in entries) else panels[0]
    )


def _source(where: str, view: Mapping[str, Any], length: float) -> Float64:
    """The focal spot, mm; of a parallel beam one that is far away against the direction of its rays."""
    if "source" in view:
        return _numbers(f"{where}.source", view["source"], 3) * length
    way = _numbers(f"{where}.direction", view["direction"], 3)
    if not np.linalg.norm(way) > 0:
        raise GeometryError(f"{where}.direction: expected (x, y, z), in which the rays run, got {view['direction']!r}")
    return np.asarray(-orbits.AWAY * way / np.linalg.norm(way))


def _panel(where: str, given: Mapping[str, Any], length: float) -> Panel:
    shape, pitch = _numbers("panel.shape", given["shape"], 2), _numbers("panel.pitch", given["pitch"], 2) * length
    axes = {k: _numbers(f"{where}.{k}", given[k], 3) for k in ("row_axis", "column_axis") if k in given}
    place = [key for key in ("origin", "centre") if key in given]
    if len(place) != 1:
        raise GeometryError(
            f"{where}: give either origin (centre of pixel (0, 0)) or centre (of the panel), got {place or 'neither'}"
        )
    at = _numbers(f"{where}.{place[0]}", given[place[0]], 3) * length
    panel = Panel(shape, pitch, at, **axes)
    if place[0] == "origin":
        return panel
    return Panel(shape, pitch, 2 * at - panel.points((shape - 1) / 2)[0], **axes)


def _stack(given: Any) -> Stack:
    s = _mapping("stack", given, (), ("files", "format", "dtype", "shape", "offset", "order", "axes", "variable"))
    axes = s.get("axes", AXES)
    if not isinstance(axes, list | tuple) or sorted(map(str, axes)) != sorted(AXES):
        raise GeometryError(f"stack.axes: expected view, row and column in the order of the file, got {axes!r}")
    axes = tuple(axes)
    dtype = None if s.get("dtype") is None else str(s["dtype"])
    if dtype is not None and (dtype not in np.sctypeDict or np.dtype(dtype).kind not in "iuf"):
        raise GeometryError(f"stack.dtype: expected uint8, uint16, int32, float32 and so on, got {dtype!r}")
    sizes = None if s.get("shape") is None else _numbers("stack.shape", s["shape"], 3)
    if sizes is not None and ((sizes < 1) | (sizes > 2**31) | (sizes != np.round(sizes))).any():
        raise GeometryError(f"stack.shape: expected 3 whole numbers of at least 1, got {s['shape']!r}")
    offset = _number("stack.offset", s.get("offset", 0))
    if not 0 <= offset < 2**63 or offset != int(offset):
        raise GeometryError(f"stack.offset: expected a number of bytes, 0 or more, got {s['offset']!r}")
    return Stack(
        files=None if s.get("files") is None else str(s["files"]),
        format=None if s.get("format") is None else _one_of("stack.format", s["format"], FORMATS),
        dtype=dtype,
        shape=None if sizes is None else (int(sizes[0]), int(sizes[1]), int(sizes[2])),
        offset=int(offset),
        order=_one_of("stack.order", s.get("order", "little"), ("little", "big")),
        axes=axes,
        variable=None if s.get("variable") is None else str(s["variable"]),
    )


def _level(key: str, given: Any, views: int) -> float | Float64 | str:
    if given == "estimate":
        return "estimate"
    if isinstance(given, list):
        return _numbers(key, given, views)
    try:
        return _number(key, given)
    except GeometryError:
        raise GeometryError(
            f'{key}: expected a number, {views} of them (one a view), or "estimate"; got {given!r}'
        ) from None


def _value(where: str, given: Any) -> Any:
    """A number, a list of numbers, or {first, last, count} for equally spaced ones."""
    if isinstance(given, Mapping):
        run = _mapping(where, given, ("first", "last", "count"), ())
        first, last, count = (_number(f"{where}.{k}", run[k]) for k in ("first", "last", "count"))
        if not 2 <= count <= trajectories.MOST or count != int(count):
            raise GeometryError(
                f"{where}.count: expected a whole number of at least 2 and at most {trajectories.MOST}, got {count:g}"
            )
        return np.linspace(first, last, int(count))
    return _numbers(where, given) if isinstance(given, list) else _number(where, given)


def _mapping(where: str, given: Any, required: Sequence[str], optional: Sequence[str] | None) -> Mapping[str, Any]:
    """`given`, once it has all required keys and no unknown ones (None leaves those open)."""
    if not isinstance(given, Mapping):
        raise GeometryError(f"{where}: expected key: value lines, got {given!r}; see: palpate scan template")
    known = [*required, *(optional or ())]
    for key in given if optional is not None else ():
        if key not in known:
            near = difflib.get_close_matches(str(key), known, 1, 0.5)
            meant = f"did you mean {near[0]!r}?" if near else f"known keys: {', '.join(known)}"
            raise GeometryError(f"unknown key {key!r} in {where}; {meant}")
    for key in required:
        if key not in given:
            raise GeometryError(f"key {key!r} is missing in {where}; add it (palpate scan template shows how)")
    return given


def _one_of(where: str, given: Any, known: Sequence[str], otherwise: str = "") -> str:
    if given not in known:
        near = difflib.get_close_matches(str(given), known, 1, 0.5)
        meant = f"; did you mean {near[0]!r}?" if near else ""
        raise GeometryError(
            f"{where}: expected one of {', '.join(known)} {otherwise}".rstrip() + f", got {given!r}{meant}"
        )
    return str(given)


def _number(where: str, given: Any, finite: bool = True) -> float:
    try:
        number = float(given)  # YAML 1.1 reads 1e5 as a text
    except (TypeError, ValueError):
        number = np.nan
        finite = True
    if isinstance(given, bool) or (finite and not np.isfinite(number)):
        raise GeometryError(f"{where}: expected a number, got {given!r}")
    return number


def _numbers(where: str, given: Any, count: int | None = None) -> Float64:
    if not isinstance(given, list) or (count is not None and len(given) != count):
        wanted = "a list of numbers" if count is None else f"a list of {count} numbers"
        raise GeometryError(f"{where}: expected {wanted}, got {given!r}")
    return np.array([_number(f"{where}[{i}]", value) for i, value in enumerate(given)])
