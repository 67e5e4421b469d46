"""Panels that integrate charge: converts gain and electronic noise to counts."""

import numpy as np

from palpate.arrays import ArrayLike, as_numpy
from palpate.errors import DataError
from palpate.scans.scan import Scan, per_pixel
from palpate.scans.views import Views


def integrating_scan(
    values: ArrayLike,
    incident: ArrayLike,
    views: Views,
    background: ArrayLike = 0,
    mask: ArrayLike | None = None,
    *,
    gain: ArrayLike = 1.0,
    electronic: ArrayLike = 0.0,
) -> Scan:
    """Build the scan of a panel that integrates charge: values = gain · photons + electronic noise.

    The variance σ² = (electronic / gain)² of the read-out noise is added to counts and background. Then mean and
    variance of a count are equal again (shifted Poisson model), and counts of several pixels may still be added.

    Parameters
    ----------
    values : array_like, (views, rows, columns)
        Read-out with its offset subtracted, in the panel's units. Values may be slightly negative.
    incident : array_like
        As in `Scan`, in the panel's units.
    views : Views
        The geometry.
    background, mask : array_like, optional
        As in `Scan`; the background is in the panel's units.
    gain : array_like, optional
        Panel units for each photon: a scalar, (views,) or full.
    electronic : array_like, optional
        Standard deviation of the read-out noise, in the panel's units. Measure it on dark frames.

    Returns
    -------
    Scan
        Counts in photons.

    Raises
    ------
    DataError
        If the gain is not positive or shapes differ.

    References
    ----------
    Snyder et al., J. Opt. Soc. Am. A 12:272, 1995.

    Examples
    --------
    >>> values = np.full((5, 40, 48), 1800.0)
    >>> scan = pp.integrating_scan(values, 2000, views, gain=2.0, electronic=6.0)
    >>> float(scan.background[0, 0, 0])
    9.0
    """
    g, sigma = (per_pixel(name, a, views.shape) for name, a in (("gain", gain), ("electronic", electronic)))
    if not (g > 0).all():
        raise DataError(f"gain: expected units a photon, above 0, found {g.min():g}")
    if (sigma < 0).any():
        raise DataError(f"electronic: expected a standard deviation of 0 or more, found {sigma.min():g}")
    photons = Scan(np.zeros(views.shape, np.float32), incident, views, background, mask)  # checks all but the values
    variance = np.square(sigma / g)
    shown = as_numpy("values", values)
    if shown.shape != views.shape or shown.dtype.kind not in "fiub":
        raise DataError(f"values: expected real numbers of shape {views.shape}, got {shown.dtype} {shown.shape}")
    with np.errstate(invalid="ignore"):  # under the mask anything may lie; Scan refuses what is not finite elsewhere
        counts = np.where(photons.mask, shown / g + variance, 0)
        counts = np.where(counts < 0, 0, counts)
    return Scan(counts, photons.incident / g, views, photons.background / g + variance, photons.mask)
