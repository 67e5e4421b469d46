"""Estimates the open beam and a common scale of images that were stored for display."""

import numpy as np

from palpate.arrays import AnyArray, ArrayLike, Float32, Float64, float32
from palpate.errors import DataError
from palpate.scans.scan import Scan

WIDTH = 0.02  # least half-width, relative, of what counts as one level: unevenness of beam and panel
SPREADS = 1.5  # standard deviations of a Poisson number that the half-width covers, where that is more
SHARE = 0.02  # of the measured pixels: below it, a bright spot is a marker or a hot pixel, not the open beam
STEPS = 2000


def open_beam(counts: ArrayLike, mask: ArrayLike | None = None, photons: bool = True) -> Float64:
    """Estimate the open-beam level of each view from the view itself.

    The level is the brightest value that many pixels share: its neighbourhood (±2 %, or ±1.5 standard deviations) holds
    at least 2 % of the measured pixels. This is right only where a part of each view shows nothing but air.

    Parameters
    ----------
    counts : array_like, (views, rows, columns)
        Counts.
    mask : array_like of bool, optional
        True where measured.
    photons : bool, optional
        Whether the values scatter like Poisson counts.

    Returns
    -------
    ndarray, (views,)
        Level of each view, in the unit of `counts`.

    Raises
    ------
    DataError
        If no level is found.

    Examples
    --------
    >>> pp.open_beam(scan.counts).round(-2)
    array([10000., 10000., 10000., 10000., 10000.])
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
    """Scale the line integrals of all views to one contrast.

    A display scale often raises each view to a power of its own, which multiplies its line integrals by a factor. The
    factors are chosen so that the mean line integral of the dense part is equal in all views.

    Parameters
    ----------
    counts : array_like, (views, rows, columns)
        Counts, 0 where nothing was measured.
    incident : array_like
        Incident counts: a scalar or (views,).
    mask : array_like of bool, optional
        True where measured.

    Returns
    -------
    ndarray, (views, rows, columns)
        Corrected counts.

    Raises
    ------
    DataError
        If a view shows nothing dense.

    Examples
    --------
    >>> pp.equal_contrast(scan.counts, 10_000).shape
    (5, 40, 48)
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
    """Return −log((counts − background) / incident) of each pixel.

    Parameters
    ----------
    scan : Scan
        The projections. A net count below 0.5 is taken as 0.5.

    Returns
    -------
    ndarray, (views, rows, columns)
        Line integrals, no unit; 0 where not measured.

    Raises
    ------
    AttributeError
        If `scan` is not a scan.

    Examples
    --------
    >>> bool(pp.line_integrals(scan).max() > 0.5)
    True
    """
    ratio = np.maximum(scan.counts - scan.background, 0.5) / np.maximum(scan.incident, 0.5)
    return np.where(scan.mask, -np.log(ratio), 0).astype(np.float32)
