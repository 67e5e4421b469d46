"""Geometric calibration: where focal spots and panels are, from a phantom of balls at known places."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from palpate.arrays import ArrayLike, Float64, float64
from palpate.errors import DataError
from palpate.scans.ball_matching import assign
from palpate.scans.ball_shadows import apart, centres, shadow_radii, spots
from palpate.scans.intensity_correction import line_integrals
from palpate.scans.scan import Scan
from palpate.scans.view_fit import ANGLE, LENGTH, FittedViews, fit_views
from palpate.scans.view_parameters import Poses, poses, shadows, views_of
from palpate.scans.views import Views

FEWEST = 6  # balls in the table
REACH = 0.05  # of the distance from source to panel: how far a shadow may be from where the start puts it
SHARE, ALL = 0.6, 0.85  # of the balls that a view, and all views, should show apart: fewer are too few to trust
PLACE = 0.1  # mm: a ball farther from its place in the table leaves a residual that is refused
BLUR = 0.3  # pixels of residual that are allowed beside it
MOVED = 6.0  # times LENGTH and ANGLE: a fit that is farther from the start is not believed
ROUNDS = 3  # of measuring the shadows; the first is at the start, whose shadows have slightly wrong shapes


@dataclass(frozen=True, eq=False)
class BallCalibration:
    """The geometry that `calibrate_from_balls` found, and how well it is known.

    Parameters
    ----------
    views : Views
        The geometry, in the balls' coordinates. What is undetermined is as it was in the start.
    centres : ndarray, (views, balls, 2)
        Measured shadows of the balls' centres, fractional (row, column); NaN where a ball was not used.
    residuals : ndarray, (views, balls, 2)
        Measured − re-projected, pixels; NaN likewise.
    noise : ndarray, (views, balls, 2)
        Standard deviation of each centre by the noise of its pixels alone, pixels. Residuals that are several times as
        large tell that the table, or what was said of the motion, is not quite true.
    names : tuple of str
        What was fitted, with its unit.
    changes, deviations : ndarray, (n,)
        By how much each differs from the start, and its standard deviation; inf where it is undetermined.
    undetermined : tuple of str
        Each change of the geometry that the shadows cannot tell, in words.

    Examples
    --------
    >>> nothing = np.full((5, 8, 2), np.nan)
    >>> lost = ("arc longer by 1 %",)
    >>> found = pp.BallCalibration(views, nothing, nothing, nothing, ("arc, %",), np.zeros(1), np.full(1, np.inf), lost)
    >>> found.undetermined
    ('arc longer by 1 %',)
    """

    views: Views
    centres: Float64
    residuals: Float64
    noise: Float64
    names: tuple[str, ...]
    changes: Float64
    deviations: Float64
    undetermined: tuple[str, ...]


def calibrate_from_balls(
    scan: Scan,
    balls: ArrayLike,
    views: Views | None = None,
    *,
    diameter: float | None = None,
    rigid: bool = False,
    still_panel: bool | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> BallCalibration:
    """Estimate the geometry of a scan of dense balls whose places are known.

    Shadows are found to a small part of a pixel: the exact shadow of a ball is fitted, so the answer is that of the ball's
    centre, not of the shadow's. They are assigned to the balls from a start that may be off by 2 % of the distances, tilts
    of 1 degree and 2 degrees of arc. Then robust least squares fit the geometry. The pixel pitch is taken as given: a
    pitch that is 1 % wrong shows as a distance from source to panel that is 1 % wrong.

    Parameters
    ----------
    scan : Scan
        Views of the phantom.
    balls : array_like, (N, 3) or (N, 4)
        Centres (x, y, z) and, in a fourth column, diameters, mm. Their coordinates become those of the views.
    views : Views, optional
        The geometry to start from. The default is that of the scan.
    diameter : float, optional
        Of all balls, mm, where `balls` has no fourth column.
    rigid : bool, optional
        Fit 14 numbers for all views: the tube turns about one axis, with the panel or above a still one. By default each
        focal spot is fitted by itself.
    still_panel : bool, optional
        Whether one panel serves all views. The default is what the start says.
    progress : callable, optional
        Called with what is being done and the share of it that is done.

    Returns
    -------
    BallCalibration
        The geometry, residuals, standard deviations, and what the shadows cannot tell.

    Raises
    ------
    DataError
        If balls are too few or in one line, too few are seen in a view, or no geometry near the start explains the shadows.
    GeometryError
        If a beam is parallel, or `rigid` is asked for and the start is no rotation.

    References
    ----------
    Cho, Moseley, Siewerdsen and Jaffray, Medical Physics 32(4), 2005. Li, Zhang and Liu, Medical Physics 37(5), 2010.

    Examples
    --------
    >>> rng = np.random.default_rng(3)
    >>> balls = rng.uniform((-25, -20, 10), (25, 20, 50), (14, 3))
    >>> fine = pp.arc_views(pp.Panel((160, 190), (0.5, 0.5), (-47, -40, 0)), [-20, 0, 20], radius=500)
    >>> solid = pp.Phantom([(pp.Ellipsoid(ball, 1.5), 0.5) for ball in balls])
    >>> seen = pp.simulate_scan(solid, fine, incident=2000)
    >>> start = pp.arc_views(fine.panels[0], [-21, 0, 21], radius=508)
    >>> found = pp.calibrate_from_balls(seen, balls, start, diameter=3)
    >>> bool(np.abs(found.views.source - fine.source).max() < 2), found.undetermined
    (True, ())
    """
    places, radii = checked_balls(balls, diameter)
    start = scan.views if views is None else views
    if start.shape != scan.shape:
        raise DataError(f"views: the start has {start.shape} views, rows and columns, the scan {scan.shape}")
    at, say = poses(start), progress or (lambda what, share: None)
    views_and_balls = (len(at.source), len(places))
    seen, sure = np.full((*views_and_balls, 2), np.nan), np.full((*views_and_balls, 2), np.nan)
    for k in range(len(at.source)):
        say("finding the balls", k / len(at.source))
        seen[k], sure[k] = _first_look(scan, at, k, places, radii)
    say("finding the balls", 1.0)
    for number in range(1, ROUNDS):
        now = fit_views(at, places, seen, sure, rigid=rigid, still_panel=still_panel, strict=False).at
        what = f"measuring their shadows, {number} of {ROUNDS - 1}"
        for k in range(len(at.source)):
            say(what, k / len(at.source))
            seen[k], sure[k] = _look_again(scan, now, k, places, radii)
        say(what, 1.0)
    done = fit_views(at, places, seen, sure, rigid=rigid, still_panel=still_panel)
    _believe(done, at, places, radii, rigid)
    return BallCalibration(
        views_of(done.at, start),
        np.where(done.used[..., None], seen, np.nan),
        done.residuals,
        np.where(done.used[..., None], sure, np.nan),
        done.names,
        done.changes,
        done.deviations,
        done.undetermined,
    )


def checked_balls(balls: ArrayLike, diameter: float | None) -> tuple[Float64, Float64]:
    """Centres (N, 3) and radii (N,), mm. Raises `DataError` for balls that cannot calibrate anything."""
    table = float64("balls", balls, (None, None))
    if table.shape[1] not in (3, 4):
        raise DataError(f"balls: expected columns x, y, z and perhaps diameter, got {table.shape[1]} columns")
    if len(table) < FEWEST:
        raise DataError(f"balls: {len(table)} given, at least {FEWEST} are needed; 12 or more are better")
    if table.shape[1] == 3 and diameter is None:
        raise DataError("diameter: not given; give it in mm, or a column diameter beside x, y, z")
    across = table[:, 3] if diameter is None else np.full(len(table), float(diameter))
    if not (np.isfinite(across) & (across > 0)).all():
        raise DataError(f"diameter: expected mm above 0, got {float(across.min()):g}")
    places = np.ascontiguousarray(table[:, :3])
    gap = np.linalg.norm(places[:, None] - places[None], axis=2) + np.diag(np.full(len(places), np.inf))
    if (gap < (across[:, None] + across[None]) / 2 * 0.999).any():
        i, j = (int(n) for n in np.argwhere(gap < (across[:, None] + across[None]) / 2 * 0.999)[0])
        raise DataError(f"balls: {i} and {j} are {gap[i, j]:.3g} mm apart, less than their diameter; check the table")
    extent = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    if extent[1] < 1e-3 * extent[0]:
        raise DataError("balls: all lie on one line, which tells no geometry; use a phantom with width and depth")
    return places, across / 2


def _first_look(scan: Scan, at: Poses, k: int, places: Float64, radii: Float64) -> tuple[Float64, Float64]:
    """Shadows (N, 2) and their standard deviations in view k, from the start; NaN for those not found."""
    expected, size = shadows(at, places)[k], shadow_radii(at, k, places, radii)
    p = line_integrals(scan[[k]])[0].astype(np.float64)
    found = spots(p, scan.mask[k], float(np.median(size)), len(places))
    if len(found) < 4:
        return np.full(expected.shape, np.nan), np.full(expected.shape, np.nan)
    pitch, far = at.pitch[k], float(np.linalg.norm(at.source[k] - at.middle[k]))
    width = 2 * float(np.median(size)) * float(pitch.min())
    chosen = assign(expected * pitch, places, found * pitch, REACH * far, width)
    begin = np.where(chosen[:, None] >= 0, found[chosen], -1e6)  # far outside: not fitted
    return _measured(scan, at, k, places, radii, expected, begin)


def _look_again(scan: Scan, at: Poses, k: int, places: Float64, radii: Float64) -> tuple[Float64, Float64]:
    expected = shadows(at, places)[k]
    return _measured(scan, at, k, places, radii, expected, expected)


def _measured(
    scan: Scan, at: Poses, k: int, places: Float64, radii: Float64, expected: Float64, begin: Float64
) -> tuple[Float64, Float64]:
    found = centres(
        scan.counts[k], scan.incident[k], scan.background[k], scan.mask[k], at, k, places, radii, expected, begin
    )
    return np.where(found.found[:, None], found.centres, np.nan), np.where(
        found.found[:, None], found.deviations, np.nan
    )


def _believe(done: FittedViews, start: Poses, places: Float64, radii: Float64, rigid: bool) -> None:
    """Raises `DataError` where the fit cannot be the geometry."""
    far = np.linalg.norm(start.source - start.middle, axis=1)
    visible = [apart(done.at, k, places, radii, seen) for k, seen in enumerate(shadows(done.at, places))]
    advice = "the table, the diameter and the start" + (", or fit without rigid" if rigid else "")
    for k, gap in enumerate(np.linalg.norm(done.residuals, axis=2)):
        used, there = np.count_nonzero(done.used[k]), np.count_nonzero(visible[k])
        if used < SHARE * there:
            raise DataError(f"view {k}: {used} of {there} balls are where the fit says; check {advice}")
        rest = float(np.sqrt(np.nanmean(gap**2) / 2))
        ray = (places - done.at.source[k]) @ done.at.axes[k, 2]
        enlarged = float(np.mean((done.at.middle[k] - done.at.source[k]) @ done.at.axes[k, 2] / ray))
        limit = float(np.hypot(BLUR, PLACE * enlarged / done.at.pitch[k].min()))
        if rest > limit:
            raise DataError(
                f"view {k}: balls are {rest:.2f} pixels (RMS) from where the fit puts them, more than {limit:.2f}; "
                f"check {advice}"
            )
        step = max(
            np.linalg.norm(done.at.source[k] - start.source[k]), np.linalg.norm(done.at.middle[k] - start.middle[k])
        )
        turn = np.degrees(Rotation.from_matrix(done.at.axes[k].T @ start.axes[k]).magnitude())
        if step > MOVED * LENGTH * far[k] or turn > MOVED * ANGLE:
            raise DataError(
                f"view {k}: the fit is {step:.0f} mm and {turn:.1f} degrees from the start, too far to be believed; "
                f"check {advice}"
            )
    used, there = np.count_nonzero(done.used), np.count_nonzero(visible)
    if used < ALL * there:  # such as a lattice that is taken for itself one period away
        raise DataError(f"{used} of {there} shadows of balls are where the fit says; check {advice}")
