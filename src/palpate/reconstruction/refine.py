"""What each view was recorded with, from the data alone: gain of its line integrals, shift of its panel."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from palpate.arrays import AnyArray, Bool, Float64, float64
from palpate.errors import DataError
from palpate.reconstruction.projector import Projector
from palpate.reconstruction.reconstruct import LikelihoodOf, iterates
from palpate.scans.correct import line_integrals
from palpate.scans.scan import Scan
from palpate.scans.views import Panel, Views
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Volume

DENSE = 0.2  # of the 95th percentile of a view's re-projection: what lies behind less is air, and teaches little
FEWEST = 100  # pixels of a view that an estimate is made from


@dataclass(frozen=True, eq=False)
class Refinement:
    """What makes the views of a scan agree; `refined` applies it.

    gains: (views,), no unit: measured line integrals are gain · true. shifts: (views, 2) (dv, du) mm by which each panel
    lies further along its row and column axes than was said.
    """

    gains: Float64
    shifts: Float64


def refine(
    scan: Scan,
    grid: Grid,
    *,
    drift: bool = True,
    shifts: bool = True,
    rounds: int = 4,
    iterations: int = 10,
    likelihood: LikelihoodOf = "poisson",
    fine: float = 4.0,
) -> Refinement:
    """Gains and shifts, by turns with a reconstruction on `grid` that goes on from round to round.

    In each round every view is compared with the re-projection of what all views made together: its gain by least
    squares, its shift by least squares with the re-projection's gradients, without what is coarser than about `fine`
    pixels. Few iterations keep the volume too smooth to follow the errors of single views. drift, shifts: which to
    estimate. What the data cannot tell is left as it was: the mean gain, and the shifts that a
    displacement of the whole object would make (`without_displacement`). Raises `DataError` where a view shows too little.
    """
    if rounds < 1 or iterations < 1:
        raise DataError(f"refinement: expected at least 1 round and 1 iteration, got {rounds!r} and {iterations!r}")
    views = len(scan.views)
    found = Refinement(np.ones(views), np.zeros((views, 2)))
    if not (drift or shifts):
        return found
    measured = line_integrals(scan)
    inner = np.stack([ndimage.binary_erosion(m, iterations=int(2 * fine), border_value=0) for m in scan.mask])
    volume: Literal["backprojection"] | Volume = "backprojection"  # few iterations: too smooth to follow a single view
    for _ in range(rounds):
        now = refined(scan, found)
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
                moves[k] += image_shift(measured[k], seen, region, fine) * scan.views.panels[k].pitch
        gains /= gains.mean()
        found = Refinement(gains, without_displacement(scan.views, moves, grid))
    return found


def refined(scan: Scan, refinement: Refinement) -> Scan:
    """The scan with its line integrals over their gains, its panels where they are. Raises `DataError`."""
    gains = float64("gains", refinement.gains, (len(scan.views),))
    if (gains <= 0).any():
        raise DataError(f"gains: expected numbers above 0, got {gains.tolist()}")
    views = moved_panels(scan.views, refinement.shifts)
    if (gains == 1).all():
        return Scan(scan.counts, scan.incident, views, scan.background, scan.mask)
    net = np.maximum(scan.counts - scan.background, 0) / np.maximum(scan.incident, 1e-30)
    true = net ** (1 / gains)[:, None, None]
    counts = np.where(scan.mask, scan.incident * true + scan.background, 0)
    return Scan(counts, scan.incident, views, scan.background, scan.mask)


def moved_panels(views: Views, shifts: ArrayLike) -> Views:
    """The views with each panel moved by (dv, du) mm, (views, 2), along its row and column axes."""
    steps = float64("shifts", shifts, (len(views), 2))
    panels = [
        Panel(p.shape, p.pitch, p.origin + dv * p.row_axis + du * p.column_axis, p.row_axis, p.column_axis)
        for p, (dv, du) in zip(views.panels, steps, strict=True)
    ]
    return Views(views.source, panels)


def view_gain(measured: AnyArray, expected: AnyArray, region: Bool) -> float:
    """The gain with which gain · expected is nearest to what was measured, over the region.

    Raises `DataError` where nothing is expected there.
    """
    x, y = expected[region].astype(np.float64), measured[region].astype(np.float64)
    if not x @ x > 0:
        raise DataError("gain: the expected image is 0 over the region; nothing to compare")
    return float(x @ y / (x @ x))


def image_shift(
    measured: AnyArray, expected: AnyArray, region: Bool, fine: float = 4.0, smooth: float = 1.0
) -> Float64:
    """(rows, columns) by which the expected image lies further on than the measured one: the way its panel must move.

    Least squares with the expected image's gradients and a gain of its own (Lucas & Kanade, IJCAI 1981), both images
    without what is coarser than about `fine` pixels and finer than about `smooth`: good to small parts of a pixel, for
    shifts below about `fine`. Raises `DataError` where the image has no detail in both directions.
    """
    band = [ndimage.gaussian_filter(i, smooth) - ndimage.gaussian_filter(i, fine) for i in (measured, expected)]
    slopes = [np.gradient(band[1], axis=axis) for axis in (0, 1)]
    columns = np.stack([image[region] for image in (band[1], *slopes)], axis=1).astype(np.float64)
    if np.linalg.matrix_rank(columns.T @ columns) < 3:
        raise DataError("shift: the expected image has no detail in the region; nothing to register")
    gain, *shift = np.linalg.lstsq(columns, band[0][region].astype(np.float64), rcond=None)[0].tolist()
    moved: Float64 = np.array(shift) / max(gain, 0.1)
    return moved


def without_displacement(views: Views, shifts: Float64, grid: Grid) -> Float64:
    """Shifts (views, 2) mm less the part that a displacement of the object along x, y and z would make as well."""
    middle = np.asarray(grid.bounds).mean(axis=0)
    at = views.project(middle)[:, 0]
    pitches = np.array([p.pitch for p in views.panels])
    ways = np.stack([((views.project(middle + e)[:, 0] - at) * pitches).ravel() for e in np.eye(3)], axis=1)
    flat = shifts.ravel()
    return np.asarray((flat - ways @ np.linalg.lstsq(ways, flat, rcond=1e-6)[0]).reshape(shifts.shape))


def between(angles: Float64, values: Float64, angle: float) -> Float64:
    """Values (views, n) at another angle: linear between neighbouring views, as the nearest beyond the outermost."""
    order = np.argsort(angles)
    return np.array([np.interp(angle, np.asarray(angles)[order], column[order]) for column in np.asarray(values).T])
