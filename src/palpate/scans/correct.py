"""What images on a display scale leave out: the open beam, and one scale for all views."""

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import AnyArray, Float32, Float64, float32
from palpate.errors import DataError
from palpate.scans.scan import Scan

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


def equal_contrast(counts: ArrayLike, incident: ArrayLike, mask: ArrayLike | None = None) -> Float32:
    """Counts (views, rows, columns) whose line integrals p = -log(counts / incident) share one scale in all views.

    A display scale often raises each view to a power of its own, which multiplies its p by a factor. The factors are
    chosen so that the mean p of the dense part (p above half of its 95th percentile) is the same in each view, the
    median over the views. That holds for one object seen over some tens of degrees; the scale itself stays unknown.
    counts: with 0 wherever nothing was measured. incident: (views,), or one number. mask: True = measured. Raises
    `DataError` when a view shows nothing dense.
    """
    y = float32("counts", counts, (None, None, None))
    b = np.broadcast_to(float32("incident", incident), len(y))[:, None, None]
    measured = np.broadcast_to(np.asarray(True if mask is None else mask), y.shape) & (y > 0)
    p = np.log(b / np.where(measured, y, b))
    dense = np.empty(len(y))
    for view, seen in enumerate(measured):
        values = p[view][seen]
        top = np.quantile(values, 0.95) if len(values) else 0.0
        if top <= 0.05:
            raise DataError(
                f"contrast of view {view}: its line integrals end at {top:.3g}, nothing is in the beam to match"
            )
        dense[view] = values[values > top / 2].mean()
    factor = (np.median(dense) / dense)[:, None, None]
    return np.where(measured, b * np.exp(-factor * p), y).astype(np.float32)


def line_integrals(scan: Scan) -> Float32:
    """-log((counts - background) / incident), (views, rows, columns), counts below 0.5 as 0.5; 0 where not measured."""
    ratio = np.maximum(scan.counts - scan.background, 0.5) / np.maximum(scan.incident, 0.5)
    return np.where(scan.mask, -np.log(ratio), 0).astype(np.float32)
