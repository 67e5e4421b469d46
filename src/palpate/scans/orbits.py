"""Orbits of tube and panel around an object, cone or parallel beam; each function returns `Views`."""

import numpy as np

from palpate.arrays import ArrayLike, Float64, float64
from palpate.errors import GeometryError
from palpate.scans.trajectories import at_least, rotating_views
from palpate.scans.views import PARALLEL, Panel, Views

AWAY = 5 * PARALLEL  # mm from the centre, of the focal spot of a parallel beam


def orbit_views(
    shape: ArrayLike,
    pitch: ArrayLike,
    *,
    source_to_centre: float,
    source_to_panel: float,
    count: int = 200,
    arc: float = 360.0,
    start: float = 0.0,
    elevation: float = 0.0,
    axis: ArrayLike = (0, 0, 1),
    centre: ArrayLike = (0, 0, 0),
) -> Views:
    """Turn a cone beam and the panel opposite it about an axis, as a CT scanner or a C-arm does.

    The central ray goes through the centre and meets the middle of the panel at a right angle. Rows of the panel grow
    along the axis. About z, the tube starts on the +x side and moves towards +y.

    Parameters
    ----------
    shape : array_like, (2,)
        Number of (rows, columns) of the panel.
    pitch : array_like, (2,)
        Distance between rows and between columns, mm.
    source_to_centre, source_to_panel : float
        Distance from the focal spot to the centre and to the panel, mm.
    count : int, optional
        Number of views, evenly spread; over less than a full turn they include both ends.
    arc : float, optional
        Angle of the orbit, up to 360 degrees.
    start : float, optional
        Angle of the first view, degrees.
    elevation : float, optional
        Angle by which the central rays leave the plane across the axis, degrees. The focal spot moves along the axis. 0
        is a CT orbit, about 60 is laminography.
    axis : array_like, (3,), optional
        Direction of the axis.
    centre : array_like, (3,), optional
        The point (x, y, z) that all central rays meet, mm.

    Returns
    -------
    Views
        The geometry.

    Raises
    ------
    GeometryError
        If a length, an angle or a number is not valid.

    Examples
    --------
    >>> views = pp.orbit_views((40, 48), (2, 2), source_to_centre=500, source_to_panel=800, count=4)
    >>> views.source.round(6).tolist()[:2]
    [[500.0, 0.0, 0.0], [0.0, 500.0, 0.0]]
    """
    if not 0 < source_to_centre < source_to_panel < np.inf:
        raise GeometryError(
            f"source_to_centre, source_to_panel: expected 0 < {source_to_centre!r} < {source_to_panel!r} mm; the centre lies "
            f"between focal spot and panel"
        )
    behind = source_to_panel - source_to_centre
    return _around(shape, pitch, source_to_centre, behind, count, arc, start, elevation, axis, centre)


def parallel_views(
    shape: ArrayLike,
    pitch: ArrayLike,
    *,
    centre_to_panel: float,
    count: int = 180,
    arc: float = 180.0,
    start: float = 0.0,
    elevation: float = 0.0,
    axis: ArrayLike = (0, 0, 1),
    centre: ArrayLike = (0, 0, 0),
) -> Views:
    """Turn a parallel beam, as of a synchrotron, and the panel opposite it about an axis.

    The focal spots lie 5e8 mm from the centre: over 500 mm the rays part by less than 0.001 mm.

    Parameters
    ----------
    shape, pitch, count, start, elevation, axis, centre : optional
        As for `orbit_views`.
    centre_to_panel : float
        Distance from the centre to the panel, mm. The panel must lie behind the volume in every view.
    arc : float, optional
        Angle of the orbit, degrees. Of 180 or 360 the end is left out, as it would repeat the first view.

    Returns
    -------
    Views
        The geometry.

    Raises
    ------
    GeometryError
        If a length, an angle or a number is not valid.

    Examples
    --------
    >>> views = pp.parallel_views((40, 48), (2, 2), centre_to_panel=100, count=90)
    >>> views.parallel.all()
    np.True_
    >>> views.project([(0, 5, 0), (50, 5, 0)])[0].round(3).tolist()  # of the same ray
    [[19.5, 26.0], [19.5, 26.0]]
    """
    if not 0 < centre_to_panel < np.inf:
        raise GeometryError(f"centre_to_panel: expected a positive length in mm, got {centre_to_panel!r}")
    return _around(shape, pitch, AWAY, centre_to_panel, count, arc, start, elevation, axis, centre)


def _around(
    shape: ArrayLike,
    pitch: ArrayLike,
    before: float,
    behind: float,
    count: int,
    arc: float,
    start: float,
    elevation: float,
    axis: ArrayLike,
    centre: ArrayLike,
) -> Views:
    """Focal spots `before` and panels `behind` the centre, turned about an axis through it."""
    along, middle = float64("axis", axis, (3,)), float64("centre", centre, (3,))
    if not np.linalg.norm(along) > 0:
        raise GeometryError(f"axis: expected a direction (x, y, z), got {axis!r}")
    count = at_least("count", count, 1)
    if not 0 < arc <= 360 or not abs(start) <= 360:
        raise GeometryError(f"arc, start: expected 0 < arc <= 360 and a start within ±360 degrees, got {arc}, {start}")
    if not abs(elevation) < 90:
        raise GeometryError(f"elevation: expected an angle between -90 and 90 degrees, got {elevation!r}")
    along /= np.linalg.norm(along)
    out = _across(along)
    lift = np.radians(elevation)
    towards = np.cos(lift) * out + np.sin(lift) * along  # from the centre to the tube
    row = np.cos(lift) * along - np.sin(lift) * out
    flat = Panel(shape, pitch, (0, 0, 0), row, np.cross(row, towards))
    corner = flat.points([(n - 1) / 2 for n in flat.shape])[0]
    panel = Panel(flat.shape, flat.pitch, middle - behind * towards - corner, flat.row_axis, flat.column_axis)
    closed = arc == 360 or (arc == 180 and before == AWAY)
    angles = start + np.linspace(0, arc, count, endpoint=not closed)
    turns = (angles + 180) % 360 - 180
    return rotating_views(panel, turns, source=middle + before * towards, pivot=middle, axis=along)


def _across(along: Float64) -> Float64:
    """The unit vector across an axis that is nearest to x, or to y if the axis is nearly along x."""
    wanted = np.eye(3)[0 if abs(along[0]) < 0.9 else 1]
    across = wanted - wanted @ along * along
    return np.asarray(across / np.linalg.norm(across))
