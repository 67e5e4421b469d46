"""Common trajectories of the tube; each function returns `Views`."""

from collections.abc import Sequence

import numpy as np

from palpate.arrays import ArrayLike, Float64, float64
from palpate.errors import GeometryError
from palpate.scans.views import Panel, Views

MOST = 100_000  # views; no scan has more


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
    """Place focal spots on a circle above a panel.

    Parameters
    ----------
    panel : Panel
        A panel in a plane z = constant.
    radius : float
        Radius of the circle, mm.
    height : float
        Height of the circle above the panel, mm.
    count : int, optional
        Number of focal spots, equally spaced.
    start : float, optional
        Angle of the first focal spot, from +x towards +y, degrees.
    centre : array_like, (2,), optional
        Centre (x, y) of the circle, mm. The default is the panel's centre.
    fulcrum : float, optional
        Height above the panel of the plane that stays in focus while the panel moves against the tube, mm. By default
        the panel stays still.

    Returns
    -------
    Views
        The geometry.

    Raises
    ------
    GeometryError
        If a length is not positive or the panel is not horizontal.

    Examples
    --------
    >>> views = pp.circular_views(panel, radius=200, height=500, count=8)
    >>> views.source[0].tolist()
    [200.0, 0.0, 500.0]
    """
    _positive("radius", radius)
    turn = np.radians(start) + 2 * np.pi * np.arange(at_least("count", count, 1)) / count
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
    """Place focal spots on a straight line that is parallel to the panel.

    Parameters
    ----------
    panel : Panel
        A panel in a plane z = constant.
    length : float
        Length of the line, mm.
    height : float
        Height of the line above the panel, mm.
    count : int, optional
        Number of focal spots, from one end to the other.
    direction : float, optional
        Direction of the line, from +x towards +y, degrees.
    centre : array_like, (2,), optional
        Middle (x, y) of the line, mm. The default is the panel's centre.
    fulcrum : float, optional
        As in `circular_views`, mm.

    Returns
    -------
    Views
        The geometry.

    Raises
    ------
    GeometryError
        If a length is not positive or the panel is not horizontal.

    Examples
    --------
    >>> views = pp.linear_views(panel, length=100, height=500, count=3)
    >>> views.source[:, 0].tolist()
    [-50.0, 0.0, 50.0]
    """
    _positive("length", length)
    along = np.linspace(-length / 2, length / 2, at_least("count", count, 2))
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
    """Place focal spots on a hypocycloid: the path of a point on a circle that rolls inside a larger circle.

    Parameters
    ----------
    panel : Panel
        A panel in a plane z = constant.
    radius : float
        Radius of the larger circle, mm.
    height : float
        Height of the path above the panel, mm.
    count : int, optional
        Number of focal spots.
    cusps : int, optional
        Radius of the larger circle over that of the rolling one, at least 3.
    start : float, optional
        Angle of the first focal spot, from +x towards +y, degrees.
    centre : array_like, (2,), optional
        Centre (x, y), mm. The default is the panel's centre.
    fulcrum : float, optional
        As in `circular_views`, mm.

    Returns
    -------
    Views
        The geometry.

    Raises
    ------
    GeometryError
        If a length or the number of cusps is not valid, or the panel is not horizontal.

    Examples
    --------
    >>> pp.hypocycloid_views(panel, radius=200, height=500, count=15).shape
    (15, 40, 48)
    """
    _positive("radius", radius)
    n = at_least("cusps", cusps, 3)
    t = np.radians(start) + 2 * np.pi * np.arange(at_least("count", count, 1)) / count
    path = np.stack([(n - 1) * np.cos(t) + np.cos((n - 1) * t), (n - 1) * np.sin(t) - np.sin((n - 1) * t)], axis=1)
    return _above(panel, radius / n * path, height, centre, fulcrum)


def arc_views(panel: Panel, angles: ArrayLike, *, radius: float, pivot: ArrayLike = (0, 0, 0)) -> Views:
    """Place focal spots on an arc in a plane of constant y, above a panel that stays still.

    Parameters
    ----------
    panel : Panel
        The panel.
    angles : array_like, (views,)
        Angles from +z towards +x, degrees.
    radius : float
        Distance from the pivot to the focal spots, mm.
    pivot : array_like, (3,), optional
        Centre (x, y, z) of the arc, mm.

    Returns
    -------
    Views
        The geometry.

    Raises
    ------
    GeometryError
        If the radius is not positive.

    Examples
    --------
    >>> views = pp.arc_views(panel, angles=[-20, 0, 20], radius=500)
    >>> views.source[1].tolist()
    [0.0, 0.0, 500.0]
    """
    _positive("radius", radius)
    a = np.radians(_angles(angles))
    return Views(_point("pivot", pivot) + radius * np.stack([np.sin(a), 0 * a, np.cos(a)], axis=1), panel)


def rotating_views(
    panel: Panel, angles: ArrayLike, *, source: ArrayLike, pivot: ArrayLike = (0, 0, 0), axis: ArrayLike = (0, 1, 0)
) -> Views:
    """Turn tube and panel together about an axis, as a C-arm does.

    Parameters
    ----------
    panel : Panel
        The panel at angle 0.
    angles : array_like, (views,)
        Angles about `axis` by the right-hand rule, degrees. About +y the tube moves from +z towards +x.
    source : array_like, (3,)
        Focal spot (x, y, z) at angle 0, mm.
    pivot : array_like, (3,), optional
        A point (x, y, z) on the axis, mm.
    axis : array_like, (3,), optional
        Direction of the axis.

    Returns
    -------
    Views
        The geometry.

    Raises
    ------
    GeometryError
        If the axis has no direction.

    Examples
    --------
    >>> views = pp.rotating_views(panel, angles=[0, 90], source=(0, 0, 500))
    >>> views.source[1].round(6).tolist()
    [500.0, 0.0, 0.0]
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


def at_least(name: str, value: int, low: int) -> int:
    """The value; raises `GeometryError` unless it is a whole number from `low` to `MOST`."""
    if not low <= value <= MOST or int(value) != value:
        raise GeometryError(f"{name}: expected a whole number of at least {low} and at most {MOST}, got {value!r}")
    return int(value)
