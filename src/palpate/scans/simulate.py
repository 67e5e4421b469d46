"""Simulates scans of analytic phantoms, with Poisson noise."""

import numpy as np

from palpate import _core
from palpate.arrays import ArrayLike, Float64
from palpate.errors import DataError, GeometryError
from palpate.scans import orbits, trajectories
from palpate.scans.analytic_phantoms import Box, Ellipsoid, Intersection, Phantom, Solid
from palpate.scans.scan import Scan
from palpate.scans.views import Panel, Views

BEHIND = 200.0  # mm, from the middle of the object to the panel of an orbit
RAYS_AT_ONCE = 250_000  # keeps the working arrays of one batch within a few tens of MB


def simulate_scan(
    phantom: Phantom,
    views: Views,
    incident: ArrayLike,
    seed: int | None = 0,
    background: ArrayLike = 0,
    mask: ArrayLike | None = None,
    subrays: int = 2,
) -> Scan:
    """Simulate the counts of a panel: Poisson(incident · mean of e⁻ᵖ over the pixel + background).

    Parameters
    ----------
    phantom : Phantom
        The object. A volume is refused: a scan from palpate's own projector would favour palpate (inverse crime).
    views : Views
        The geometry.
    incident, background, mask : array_like
        As in `Scan`.
    seed : int or None, optional
        Equal seeds give equal counts. None gives the expected counts without noise.
    subrays : int, optional
        Each pixel is the mean over subrays² rays, each with an exact line integral p.

    Returns
    -------
    Scan
        The projections.

    Raises
    ------
    DataError
        If `phantom` is a volume or an argument is not valid.

    Examples
    --------
    >>> pp.simulate_scan(phantom, views, incident=10_000, seed=1).shape
    (5, 40, 48)
    """
    if not isinstance(phantom, Phantom):
        raise DataError(
            f"phantom: expected a Phantom of ellipsoids and boxes, got {type(phantom).__name__}; "
            f"voxels would need our own projector, and the test would then flatter itself"
        )
    if subrays < 1 or int(subrays) != subrays:
        raise DataError(f"subrays: expected a whole number of at least 1, got {subrays!r}")
    blank = Scan(np.zeros(views.shape, np.float32), incident, views, background, mask)  # checks all before the work
    passed = np.stack([transmission(phantom, s, p, subrays) for s, p in zip(views.source, views.panels, strict=True)])
    mean = blank.incident * passed + blank.background
    if seed is not None:
        rng = np.random.default_rng(seed)
        mean = rng.poisson(np.where(blank.mask, mean, 0)).astype(np.float64)
    return Scan(np.where(blank.mask, mean, 0), incident, views, background, mask)


def transmission(phantom: Phantom, source: Float64, panel: Panel, subrays: int = 2) -> Float64:
    """(rows, columns): mean over each pixel's area of e^-p, p the line integral from the source."""
    known = [_primitives(solid) for solid, _ in phantom.parts]
    if not all(known):  # a solid of the user's own
        return _transmission(phantom, source, panel, subrays)
    fine = [p / subrays for p in panel.pitch]
    down, right = fine[0] * np.asarray(panel.row_axis), fine[1] * np.asarray(panel.column_axis)
    start = panel.points([(0.5 / subrays - 0.5,) * 2])[0]
    passed = np.empty(panel.shape)
    _core.phantom.transmission(
        np.cumsum([0] + [len(solids) for solids in known]),
        np.array([attenuation for _, attenuation in phantom.parts], np.float64),
        np.array([_rays_that_meet(solid.bounds(), source, panel, subrays) for solid, _ in phantom.parts], np.int64),
        np.array([kind for solids in known for kind, _ in solids], np.int64),
        np.array([numbers for solids in known for _, numbers in solids], np.float64),
        np.ascontiguousarray(np.stack([source, start, down, right]), np.float64),
        subrays,
        passed,
    )
    return passed


def _primitives(solid: Solid) -> list[tuple[int, Float64]]:
    """Kind and numbers of the convex solids whose intersection is a solid; none if there are no such solids.

    The numbers are those of cpp/phantom/analytic_transmission.h.
    """
    if type(solid) is Ellipsoid:
        turn = np.asarray(solid.axes) / np.asarray(solid.radii)
        return [(0, np.concatenate([turn.ravel(), np.asarray(solid.centre)]))]
    if type(solid) is Box:
        return [(1, np.concatenate([solid.bounds().ravel(), np.zeros(6)]))]
    if type(solid) is Intersection:
        parts = [_primitives(part) for part in solid.solids]
        return [primitive for part in parts for primitive in part] if all(parts) else []
    return []


def _rays_that_meet(bounds: Float64, source: Float64, panel: Panel, subrays: int) -> tuple[int, int, int, int]:
    """First and last row and column of the panel's rays between which the shadow of a box lies, rather too many."""
    rows, columns = (n * subrays for n in panel.shape)
    corners = np.array([[x, y, z] for x in bounds[:, 0] for y in bounds[:, 1] for z in bounds[:, 2]])
    depth, whole = (corners - source) @ panel.normal, (np.asarray(panel.origin) - source) @ panel.normal
    if (depth / whole <= 1e-6).any():  # beside or behind the source: no bound
        return 0, rows - 1, 0, columns - 1
    landed = source + (whole / depth)[:, None] * (corners - source) - np.asarray(panel.origin)
    r = (landed @ panel.row_axis / panel.pitch[0] + 0.5) * subrays
    c = (landed @ panel.column_axis / panel.pitch[1] + 0.5) * subrays
    low_r, high_r, low_c, high_c = (
        int(np.clip(v, -2, n + 2))
        for v, n in ((r.min() - 2, rows), (r.max() + 2, rows), (c.min() - 2, columns), (c.max() + 2, columns))
    )
    return low_r, high_r, low_c, high_c


def _transmission(phantom: Phantom, source: Float64, panel: Panel, subrays: int) -> Float64:
    """The same for solids of any kind, which need only tell where lines enter and leave them."""
    offsets = (np.arange(subrays) + 0.5) / subrays - 0.5
    passed = np.empty(panel.shape)
    rows, columns = panel.shape
    v = (np.arange(rows)[:, None] + offsets).ravel()
    u = (np.arange(columns)[:, None] + offsets).ravel()
    batch = max(1, RAYS_AT_ONCE // (len(u) * subrays))
    for first in range(0, rows, batch):
        last = min(first + batch, rows)
        V, U = np.meshgrid(v[first * subrays : last * subrays], u, indexing="ij")
        ends = panel.points(np.stack([V.ravel(), U.ravel()], axis=1))
        fine = np.exp(-phantom.line_integrals(source, ends))
        passed[first:last] = fine.reshape(last - first, subrays, columns, subrays).mean(axis=(1, 3))
    return passed


def standard_views(
    motion: str,
    count: int,
    shape: tuple[int, int] = (512, 512),
    pitch: float = 0.4,
    distance: float = 1000.0,
    extent: float = 250.0,
    angle: float = 20.0,
) -> Views:
    """Views of the built-in phantoms: a panel in the plane z = 0, the tube `distance` mm above it.

    motion: circular, hypocycloid (extent: radius, mm), linear (extent: length, mm), arc or rotating (angle: half the
    range, degrees; pivot 50 mm above the panel), orbit or parallel (around y and the point (0, 0, 50) mm, from
    which the panel is 200 mm away). Raises `GeometryError`.
    """
    rows, columns = shape
    corner = (-(columns - 1) / 2 * pitch, -(rows - 1) / 2 * pitch, 0)
    panel, pivot = Panel(shape, (pitch, pitch), corner), (0, 0, 50)
    if motion == "circular":
        return trajectories.circular_views(panel, radius=extent, height=distance, count=count)
    if motion == "hypocycloid":
        return trajectories.hypocycloid_views(panel, radius=extent, height=distance, count=count)
    if motion == "linear":
        return trajectories.linear_views(panel, length=extent, height=distance, count=count)
    if motion == "arc":
        return trajectories.arc_views(panel, np.linspace(-angle, angle, count), radius=distance - 50, pivot=pivot)
    if motion == "rotating":
        return trajectories.rotating_views(
            panel, np.linspace(-angle, angle, count), source=(0, 0, distance), pivot=pivot
        )
    if motion == "orbit":
        return orbits.orbit_views(
            shape,
            (pitch, pitch),
            source_to_centre=distance - BEHIND,
            source_to_panel=distance,
            count=count,
            axis=(0, 1, 0),
            centre=pivot,
        )
    if motion == "parallel":
        return orbits.parallel_views(
            shape, (pitch, pitch), centre_to_panel=BEHIND, count=count, axis=(0, 1, 0), centre=pivot
        )
    known = "circular, hypocycloid, linear, arc, rotating, orbit, parallel"
    raise GeometryError(f"motion: {motion!r} cannot be simulated; choose {known}")
