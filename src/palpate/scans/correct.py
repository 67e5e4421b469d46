"""What the open beam was, when nobody measured it."""

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import AnyArray, Float64, float32
from palpate.errors import DataError

WIDTH = 0.02  # half-width, relative, of what counts as one level: beam flatness and noise
SHARE = 0.02  # of the measured pixels: below it, a bright spot is a marker or a hot pixel, not the open beam
STEPS = 2000


def open_beam(counts: ArrayLike, mask: ArrayLike | None = None) -> Float64:
    """Open-beam level (views,) of each view, from the view itself: the brightest level that many pixels share.

    counts: (views, rows, columns). mask: True = measured. A level is a value whose neighbourhood of ±2 % holds more
    pixels than any other level within ±4 % and at least 2 % of the measured pixels; its mean is returned. It is right
    only where part of each view sees nothing but air; it knows no variation across the field. Raises `DataError`.
    """
    y = float32("counts", counts, (None, None, None))
    measured = np.broadcast_to(np.asarray(True if mask is None else mask), y.shape)
    return np.array([_brightest_level(view, y[view][measured[view]]) for view in range(len(y))])


def _brightest_level(view: int, values: AnyArray) -> float:
    values = np.sort(values[values > 0].astype(np.float64))
    if len(values) < 100:
        raise DataError(
            f"incident of view {view}: only {len(values)} measured pixels above 0, too few to estimate the open beam; "
            f"give incident as a number"
        )
    low, high = np.quantile(values, [0.01, 1])
    levels = np.geomspace(low, high * (1 + WIDTH), STEPS)
    first, last = (np.searchsorted(values, levels * (1 + s)) for s in (-WIDTH, WIDTH))
    held = last - first
    reach = max(1, round(np.log1p(2 * WIDTH) / np.log(levels[1] / levels[0]))) if high > low else 1
    padded = np.pad(held, reach)
    most = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1).max(axis=1)
    peaks = np.flatnonzero((held == most) & (held >= SHARE * len(values)))
    brightest = int(peaks[-1])  # the fullest level of all is one, so there is always one
    return float(values[first[brightest] : last[brightest]].mean())
