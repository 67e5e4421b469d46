"""What the open beam was, when nobody measured it."""

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import AnyArray, Float64, float32
from palpate.errors import DataError

WIDTH = 0.02  # least half-width, relative, of what counts as one level: unevenness of beam and panel
SPREADS = 1.5  # standard deviations of a Poisson number that the half-width covers, where that is more
SHARE = 0.02  # of the measured pixels: below it, a bright spot is a marker or a hot pixel, not the open beam
STEPS = 2000


def open_beam(counts: ArrayLike, mask: ArrayLike | None = None, photons: bool = True) -> Float64:
    """Open-beam level (views,) of each view, from the view itself: the brightest level that many pixels share.

    counts: (views, rows, columns). mask: True = measured. photons: whether the numbers scatter as Poisson counts do.
    A level is a value whose neighbourhood (±2 %, or ±1.5 standard deviations of a count) holds at least 2 % of the
    measured pixels and more than that of any other value nearby; the mean in there is returned. It is right only where
    part of each view sees nothing but air; it knows no variation across the field. Raises `DataError`.
    """
    y = float32("counts", counts, (None, None, None))
    measured = np.broadcast_to(np.asarray(True if mask is None else mask), y.shape)
    return np.array([_brightest_level(view, y[view][measured[view]], photons) for view in range(len(y))])


def _brightest_level(view: int, values: AnyArray, photons: bool) -> float:
    values = np.sort(values[values > 0].astype(np.float64))
    if len(values) < 100:
        raise DataError(
            f"incident of view {view}: only {len(values)} measured pixels above 0, too few to estimate the open beam; "
            f"give incident as a number"
        )

    def width(level: Float64) -> Float64:
        return np.maximum(WIDTH, SPREADS / np.sqrt(level)) if photons else np.full_like(level, WIDTH)

    def around(level: Float64) -> tuple[AnyArray, AnyArray]:
        w = width(level)
        return np.searchsorted(values, level * (1 - w)), np.searchsorted(values, level * (1 + w))

    low, high = np.quantile(values, [0.01, 1])
    levels = np.geomspace(low, high * (1 + WIDTH), STEPS)
    first, last = around(levels)
    held = last - first
    near = np.searchsorted(levels, [levels * (1 - 2 * width(levels)), levels * (1 + 2 * width(levels))])
    most = np.array([held[a : max(b, a + 1)].max() for a, b in near.T])
    peaks = np.flatnonzero((held == most) & (held >= SHARE * len(values)))
    level = levels[[peaks[-1]]]  # the fullest level of all is a peak, so there is always one
    for _ in range(10):  # to the middle of its neighbourhood
        first, last = around(level)
        level = values[first[0] : last[0]].mean(keepdims=True)
    return float(level[0])
