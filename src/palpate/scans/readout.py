"""Panels that integrate charge: gain and electronic noise, brought into the terms of counts."""

import numpy as np
from numpy.typing import ArrayLike

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
    """The scan of a panel that shows values = gain · photons + electronic noise, its offset already subtracted.

    values: (views, rows, columns), in the panel's units; may be a little below 0. incident, background: in the same units,
    as in `Scan`. gain: units a photon adds. electronic: standard deviation of the read-out noise, in the panel's units.
    Both: scalar, (views,) or full; they are measured on dark and open frames (variance of an open frame = gain · its mean
    + electronic²).

    The counts are photons with the noise's variance σ² = (electronic/gain)² added, and so is the background: then mean
    and variance of a count are equal again, counts of several pixels still add up, and each likelihood reads the noise
    from the scan alone. Counts that would be below 0 are set to 0. Raises `DataError`.
    """
    g, sigma = (per_pixel(name, a, views.shape) for name, a in (("gain", gain), ("electronic", electronic)))
    if not (g > 0).all():
        raise DataError(f"gain: expected units a photon, above 0, found {g.min():g}")
    if (sigma < 0).any():
        raise DataError(f"electronic: expected a standard deviation of 0 or more, found {sigma.min():g}")
    photons = Scan(np.zeros(views.shape, np.float32), incident, views, background, mask)  # checks all but the values
    variance = np.square(sigma / g)
    shown = np.asarray(values)
    if shown.shape != views.shape or shown.dtype.kind not in "fiub":
        raise DataError(f"values: expected real numbers of shape {views.shape}, got {shown.dtype} {shown.shape}")
    with np.errstate(invalid="ignore"):  # under the mask anything may lie; Scan refuses what is not finite elsewhere
        counts = np.where(photons.mask, shown / g + variance, 0)
        counts = np.where(counts < 0, 0, counts)
    return Scan(counts, photons.incident / g, views, photons.background / g + variance, photons.mask)
