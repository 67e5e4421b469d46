"""Self-calibration: estimates each view's gain and panel shift from the data."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy import ndimage

from palpate.arrays import AnyArray, ArrayLike, Bool, Float64, float64
from palpate.errors import DataError
from palpate.reconstruction.projector import Projector
from palpate.reconstruction.reconstruct import LikelihoodOf, iterates
from palpate.scans.intensity_correction import line_integrals
from palpate.scans.scan import Scan
from palpate.scans.views import Panel, Views
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Volume

DENSE = 0.2  # of the 95th percentile of a view's re-projection: pixels below it see air and are not used
FEWEST = 100  # pixels that an estimate needs in a view


@dataclass(frozen=True, eq=False)
class Calibration:
    """What makes the views of a scan agree. `apply_calibration` applies it.

    Parameters
    ----------
    gains : ndarray, (views,)
        Measured line integrals are gain × true, no unit.
    shifts : ndarray, (views, 2)
        (dv, du) by which each panel lies further along its row and column axes than the geometry says, mm.

    Examples
    --------
    >>> found = pp.Calibration(gains=np.ones(5), shifts=np.zeros((5, 2)))
    >>> pp.apply_calibration(scan, found).shape
    (5, 40, 48)
    """

    gains: Float64
    shifts: Float64


def calibrate(
    scan: Scan,
    grid: Grid,
    *,
    drift: bool = True,
    shifts: bool = True,
    rounds: int = 12,
    iterations: int = 10,
    likelihood: LikelihoodOf = "poisson",
    fine: float = 4.0,
    memory: int = 4,
) -> Calibration:
    """Estimate a gain and a panel shift for each view, by turns with a reconstruction.

    In each round every view is compared with the re-projection of the volume from all views. Gain and shift follow by
    least squares. Few iterations keep the volume smooth, so that it does not follow the error of a single view. Volume and
    shifts by turns converge slowly, so the shifts are extrapolated from the last rounds. What the data cannot tell stays as
    it was: the mean gain, and shifts that a displacement of the object would cause (`calibration_gauge`).

    Parameters
    ----------
    scan : Scan
        The projections.
    grid : Grid
        Voxels that cover the object.
    drift, shifts : bool, optional
        Whether to estimate gains and shifts.
    rounds : int, optional
        Number of rounds.
    iterations : int, optional
        Iterations of each reconstruction.
    likelihood : str or callable, optional
        As for `reconstruct`.
    fine : float, optional
        Detail coarser than about this many pixels is ignored.
    memory : int, optional
        Number of rounds from which shifts are extrapolated (Anderson's acceleration); 0 for none.

    Returns
    -------
    Calibration
        Gains and shifts.

    Raises
    ------
    DataError
        If a view shows too little detail.

    References
    ----------
    Walker & Ni, SIAM Journal on Numerical Analysis 49(4), 2011.

    Examples
    --------
    >>> found = pp.calibrate(scan, grid, shifts=False, rounds=1, iterations=2)
    >>> bool(abs(found.gains - 1).max() < 0.1)
    True
    """
    if rounds < 1 or iterations < 1:
        raise DataError(f"refinement: expected at least 1 round and 1 iteration, got {rounds!r} and {iterations!r}")
    views = len(scan.views)
    found = Calibration(np.ones(views), np.zeros((views, 2)))
    if not (drift or shifts):
        return found
    measured = line_integrals(scan)
    inner = np.stack([ndimage.binary_erosion(m, iterations=int(2 * fine), border_value=0) for m in scan.mask])
    volume: Literal["backprojection"] | Volume = "backprojection"  # few iterations: too smooth to follow a single view
    tried: list[Float64] = []  # shifts of the last rounds, and what each round made of them
    made: list[Float64] = []
    for _ in range(rounds):
        now = apply_calibration(scan, found)
        *_, volume = (
            step.volume
            for step in iterates(
                now, grid, levels=1, likelihood=likelihood, iterations=iterations, tolerance=1e-12, start=volume
            )
        )
        again = Projector(now.views, grid)(volume.values)
        gains, moves = found.gains.copy(), found.shifts.copy()
        for k, seen in enumerate(again):
            region = inner[k] & (seen > DENSE * np.quantile(seen, 0.95))
            if np.count_nonzero(region) < FEWEST:
                raise DataError(f"view {k}: nothing dense is re-projected {2 * fine:g} pixels inside its field")
            if drift:
                gains[k] = view_gain(measured[k], seen, region)
            if shifts:
                # Of line integrals: as the root of the counts.
                weights = np.exp(-seen / 2) if likelihood == "poisson" else None
                moves[k] += image_shift(measured[k], seen, region, fine, weights=weights) * scan.views.panels[k].pitch
        gains /= gains.mean()
        tried, made = [*tried[-memory:], found.shifts], [*made[-memory:], without_displacement(scan.views, moves, grid)]
        found = Calibration(gains, accelerated(tried, made) if memory else made[-1])
    return found


def accelerated(tried: list[Float64], made: list[Float64], noise: float = 1e-2) -> Float64:
    """The next point of a fixed-point iteration from the last ones: the combination whose step is shortest (Anderson).

    noise: differences of steps smaller than this share of the largest are not used.
    """
    steps = [np.ravel(m - t) for t, m in zip(tried, made, strict=True)]
    if len(steps) < 2 or np.linalg.norm(steps[-1]) > 2 * np.linalg.norm(steps[-2]):
        return made[-1]
    change = np.stack([later - earlier for earlier, later in pairwise(steps)], axis=1)
    share = np.linalg.lstsq(change, steps[-1], rcond=noise)[0]
    back = np.stack([later - earlier for earlier, later in pairwise(made)], axis=-1)
    return np.asarray(made[-1] - back @ share)


def apply_calibration(scan: Scan, refinement: Calibration) -> Scan:
    """Return the scan with its line integrals divided by their gains, and its panels moved.

    Parameters
    ----------
    scan : Scan
        The projections.
    refinement : Calibration
        Gains and shifts.

    Returns
    -------
    Scan
        The corrected scan.

    Raises
    ------
    DataError
        If the number of views differs.

    Examples
    --------
    >>> found = pp.Calibration(gains=np.full(5, 1.1), shifts=np.zeros((5, 2)))
    >>> corrected = pp.apply_calibration(scan, found)
    """
    gains = float64("gains", refinement.gains, (len(scan.views),))
    if (gains <= 0).any():
        raise DataError(f"gains: expected numbers above 0, got {gains.tolist()}")
    views = shift_panels(scan.views, refinement.shifts)
    if (gains == 1).all():
        return Scan(scan.counts, scan.incident, views, scan.background, scan.mask, scan.notes, scan.blur)
    net = np.maximum(scan.counts - scan.background, 0) / np.maximum(scan.incident, 1e-30)
    true = net ** (1 / gains)[:, None, None]
    counts = np.where(scan.mask, scan.incident * true + scan.background, 0)
    return Scan(counts, scan.incident, views, scan.background, scan.mask, scan.notes, scan.blur)


def shift_panels(views: Views, shifts: ArrayLike) -> Views:
    """Return the views with each panel moved along its own axes.

    Parameters
    ----------
    views : Views
        The geometry.
    shifts : array_like, (views, 2)
        (dv, du) along the row and column axes, mm.

    Returns
    -------
    Views
        The new geometry.

    Raises
    ------
    DataError
        If the shape of `shifts` is wrong.

    Examples
    --------
    >>> moved = pp.shift_panels(views, np.tile([0.0, 2.0], (5, 1)))
    >>> (moved.panels[0].origin - views.panels[0].origin).tolist()
    [2.0, 0.0, 0.0]
    """
    steps = float64("shifts", shifts, (len(views), 2))
    panels = [
        Panel(p.shape, p.pitch, p.origin + dv * p.row_axis + du * p.column_axis, p.row_axis, p.column_axis)
        for p, (dv, du) in zip(views.panels, steps, strict=True)
    ]
    return Views(views.source, panels)


def view_gain(measured: AnyArray, expected: AnyArray, region: Bool) -> float:
    """Return the gain for which gain × expected is closest to the measured image.

    Parameters
    ----------
    measured, expected : ndarray, (rows, columns)
        Line integrals.
    region : ndarray of bool, (rows, columns)
        Where to compare.

    Returns
    -------
    float
        The gain, no unit.

    Raises
    ------
    DataError
        If nothing is expected there.

    Examples
    --------
    >>> image = np.ones((3, 3))
    >>> pp.view_gain(2 * image, image, image > 0)
    2.0
    """
    x, y = expected[region].astype(np.float64), measured[region].astype(np.float64)
    if not x @ x > 0:
        raise DataError("gain: the expected image is 0 over the region; nothing to compare")
    return float(x @ y / (x @ x))


def image_shift(
    measured: AnyArray,
    expected: AnyArray,
    region: Bool,
    fine: float = 4.0,
    smooth: float = 1.0,
    weights: AnyArray | None = None,
) -> Float64:
    """Return the shift from a measured image to an expected one, by least squares with the image gradients.

    The shift is accurate to a small part of a pixel if it is below about `fine` pixels.

    Parameters
    ----------
    measured, expected : ndarray, (rows, columns)
        Line integrals.
    region : ndarray of bool, (rows, columns)
        Where to compare.
    fine : float, optional
        Detail coarser than about this many pixels is removed.
    smooth : float, optional
        Detail finer than about this many pixels is removed.
    weights : ndarray, (rows, columns), optional
        One over the standard deviation of each pixel, in any unit. The default is 1.

    Returns
    -------
    ndarray, (2,)
        (rows, columns) by which the expected image lies further on: the way that the panel must move.

    Raises
    ------
    DataError
        If the image has no detail in both directions.

    References
    ----------
    Lucas & Kanade, IJCAI 1981.

    Examples
    --------
    >>> rows, columns = np.mgrid[:40, :40]
    >>> image = np.exp(-((rows - 20) ** 2 + (columns - 20) ** 2) / 18.0)
    >>> moved = np.exp(-((rows - 20) ** 2 + (columns - 20.5) ** 2) / 18.0)
    >>> pp.image_shift(image, moved, np.full(image.shape, True), fine=12).round(1) + 0.0
    array([0. , 0.5])
    """
    band = [ndimage.gaussian_filter(i, smooth) - ndimage.gaussian_filter(i, fine) for i in (measured, expected)]
    slopes = [np.gradient(band[1], axis=axis) for axis in (0, 1)]
    weight = np.ones(np.count_nonzero(region)) if weights is None else weights[region].astype(np.float64)
    columns = np.stack([image[region] * weight for image in (band[1], *slopes)], axis=1)
    if np.linalg.matrix_rank(columns.T @ columns) < 3:
        raise DataError("shift: the expected image has no detail in the region; nothing to register")
    gain, *shift = np.linalg.lstsq(columns, band[0][region] * weight, rcond=None)[0].tolist()
    moved: Float64 = np.array(shift) / max(gain, 0.1)
    return moved


def without_displacement(views: Views, shifts: Float64, grid: Grid) -> Float64:
    """Remove from panel shifts the part that a displacement of the object would cause.

    Parameters
    ----------
    views : Views
        The geometry.
    shifts : ndarray, (views, 2)
        (dv, du) along the row and column axes, mm.
    grid : Grid
        Where the object lies.

    Returns
    -------
    ndarray, (views, 2)
        The remaining shifts, mm.

    Raises
    ------
    ValueError
        If the shape of `shifts` is wrong.

    Examples
    --------
    >>> pp.without_displacement(views, np.tile([1.0, 0.0], (5, 1)), grid).round(1) + 0.0
    array([[0., 0.],
           [0., 0.],
           [0., 0.],
           [0., 0.],
           [0., 0.]])
    """
    middle = np.asarray(grid.bounds).mean(axis=0)
    at = views.project(middle)[:, 0]
    pitches = np.array([p.pitch for p in views.panels])
    ways = np.stack([((views.project(middle + e)[:, 0] - at) * pitches).ravel() for e in np.eye(3)], axis=1)
    flat = shifts.ravel()
    return np.asarray((flat - ways @ np.linalg.lstsq(ways, flat, rcond=1e-6)[0]).reshape(shifts.shape))


def interpolate_over_angle(angles: Float64, values: Float64, angle: float) -> Float64:
    """Values (views, n) at another angle: linear interpolation, constant beyond the outermost views."""
    order = np.argsort(angles)
    return np.array([np.interp(angle, np.asarray(angles)[order], column[order]) for column in np.asarray(values).T])
