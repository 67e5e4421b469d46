"""The usual ways in which a tube moves, each a function that fills `Views`."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import Float64, float64
from palpate.errors import GeometryError
from palpate.scans.views import Panel, Views


def circular_views(
    panel: Panel,
    *,
    radius: float,
    height: float,
    count: int = 8,
    start: float = 0.0,
    centre: ArrayLike | None = None,
    fulcrum: float | None = None,
) -> Views:
    """`count` focal spots equally spaced on a circle above a panel that lies in a plane z = constant.

    radius: mm. height: of the circle above the panel, mm. start: angle of the first spot from +x towards +y, degrees.
    centre: (x, y) of the circle, mm; None is the panel's centre. fulcrum: height above the panel, mm, of the plane that
    stays still because the panel moves against the tube; None holds the panel still. Raises `GeometryError`.
    """
    _positive("radius", radius)
    turn = np.radians(start) + 2 * np.pi * np.arange(_at_least("count", count, 1)) / count
    return _above(panel, radius * np.stack([np.cos(turn), np.sin(turn)], axis=1), height, centre, fulcrum)


def linear_views(
    panel: Panel,
    *,
    length: float,
    height: float,
    count: int = 15,
    direction: float = 0.0,
    centre: ArrayLike | None = None,
    fulcrum: float | None = None,
) -> Views:
    """`count` focal spots from one end to the other of a straight line of `length` mm, parallel to the panel.

    direction: of the line, degrees from +x towards +y. The other arguments as in `circular_views`.
    """
    _positive("length", length)
    along = np.linspace(-length / 2, length / 2, _at_least("count", count, 2))
    turn = np.radians(direction)
    return _above(panel, along[:, None] * np.array([np.cos(turn), np.sin(turn)]), height, centre, fulcrum)


def hypocycloid_views(
    panel: Panel,
    *,
    radius: float,
    height: float,
    count: int = 15,
    cusps: int = 3,
    start: float = 0.0,
    centre: ArrayLike | None = None,
    fulcrum: float | None = None,
) -> Views:
    """`count` focal spots on a hypocycloid: the path of a point of a circle that rolls inside a circle of `radius` mm.

    cusps: radius over that of the rolling circle, at least 3. The other arguments as in `circular_views`.
    """
    _positive("radius", radius)
    n = _at_least("cusps", cusps, 3)
    t = np.radians(start) + 2 * np.pi * np.arange(_at_least("count", count, 1)) / count
    path = np.stack([(n - 1) * np.cos(t) + np.cos((n - 1) * t), (n - 1) * np.sin(t) - np.sin((n - 1) * t)], axis=1)
    return _above(panel, radius / n * path, height, centre, fulcrum)


def arc_views(panel: Panel, angles: ArrayLike, *, radius: float, pivot: ArrayLike = (0, 0, 0)) -> Views:
    """Focal spots on an arc in the plane y = pivot y, above a panel that stays still.

    angles: (views,) degrees from +z, positive towards +x. radius: from pivot to focal spot, mm. pivot: (x, y, z) mm.
    Raises `GeometryError`.
    """
    _positive("radius", radius)
    a = np.radians(_angles(angles))
    return Views(_point("pivot", pivot) + radius * np.stack([np.sin(a), 0 * a, np.cos(a)], axis=1), panel)


def rotating_views(
    panel: Panel, angles: ArrayLike, *, source: ArrayLike, pivot: ArrayLike = (0, 0, 0), axis: ArrayLike = (0, 1, 0)
) -> Views:
    """Tube and panel turn together about an axis, as on a C-arm.

    panel, source: the poses at angle 0, mm. angles: (views,) degrees, right-handed about `axis`: about +y the tube
    moves from +z towards +x. pivot: a point on the axis, mm. Raises `GeometryError`.
    """
    spot, through, along = _point("source", source), _point("pivot", pivot), _point("axis", axis)
    _positive("length of axis", float(np.linalg.norm(along)))
    turns = [_rotation(along, angle) for angle in np.radians(_angles(angles))]
    panels = [
        Panel(
            panel.shape, panel.pitch, through + R @ (panel.origin - through), R @ panel.row_axis, R @ panel.column_axis
        )
        for R in turns
    ]
    return Views(np.array([through + R @ (spot - through) for R in turns]), panels)


def _above(panel: Panel, path: Float64, height: float, centre: ArrayLike | None, fulcrum: float | None) -> Views:
    """Focal spots at `path` (views, 2) around a centre, `height` above a panel that lies level."""
    _positive("height", height)
    if abs(abs(panel.normal[2]) - 1) > 1e-6:
        raise GeometryError(
            f"panel: this motion needs a level panel (in a plane z = constant), its normal is {panel.normal.tolist()}; "
            f"use rotating_views, or Views for any pose"
        )
    middle = panel.points([(n - 1) / 2 for n in panel.shape])[0]
    if centre is not None:
        middle[:2] = float64("centre", centre, (2,))
    source = np.column_stack([middle[:2] + path, np.full(len(path), middle[2] + height)])
    if fulcrum is None:
        return Views(source, panel)
    if not 0 <= fulcrum < height:
        raise GeometryError(f"fulcrum: expected a height of 0 up to below {height:g} mm, got {fulcrum:g}")
    shift = np.column_stack([-path * fulcrum / (height - fulcrum), np.zeros(len(path))])
    return Views(source, [_moved(panel, s) for s in shift])


def _moved(panel: Panel, shift: Float64) -> Panel:
    return Panel(panel.shape, panel.pitch, panel.origin + shift, panel.row_axis, panel.column_axis)


def _rotation(axis: Float64, angle: float) -> Float64:
    """Rodrigues' formula."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn: Float64 = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return turn


def _angles(angles: ArrayLike | Sequence[float]) -> Float64:
    a = float64("angles", angles, (None,))
    if len(a) == 0 or np.abs(a).max() > 360:
        raise GeometryError(f"angles: expected at least one, in degrees within ±360, got {angles!r}")
    return a


def _point(name: str, values: ArrayLike) -> Float64:
    return float64(name, values, (3,))


def _positive(name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0):
        raise GeometryError(f"{name}: expected a positive length in mm, got {value!r}")


def _at_least(name: str, value: int, low: int) -> int:
    if int(value) != value or value < low:
        raise GeometryError(f"{name}: expected a whole number of at least {low}, got {value!r}")
    return int(value)
