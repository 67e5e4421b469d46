"""How bright air is in each view: the incident beam behind a sheet, such as a compression paddle, over all of the field."""

import math

import numpy as np
from scipy.ndimage import uniform_filter

from palpate.arrays import Float32, Float64
from palpate.reconstruction.multiresolution import coarser_scan
from palpate.scans.scan import Scan
from palpate.scans.views import Panel

NOISE = 0.005  # of a block's mean, at most: as much as a sheet's level may be wrong
WIDEST = 20  # pixels along a block
PIXELS = 256  # along a panel, at most: of larger panels several are added up
THICKEST = 0.3  # line integral of a sheet; a paddle of 3 mm has 0.1 to 0.25
SHEET = 0.01  # the thinnest that is worth it: incident itself is hardly known better
BRIGHTEST = -0.2  # the same where incident is too low
LEAST = 0.02  # share of the view's blocks that air fills at least to be found
EVEN = 3.0  # times as many blocks at the level as at line integrals just above: an object's thin parts have no level


def air_levels(scan: Scan) -> Float64:
    """(views,): line integral through the sheet at right angles, 0 where no even region of air is seen in any view.

    A view without such a region has the median of the others.
    """
    while max(scan.shape[1:]) > PIXELS and min(scan.shape[1:]) > PIXELS / 4:
        scan = coarser_scan(scan)
    found = np.array([_air_level(scan, k) for k in range(scan.shape[0])])
    known = found[np.isfinite(found)]
    return np.where(np.isfinite(found), found, np.median(known) if known.size else 0.0)


def without_sheet(scan: Scan) -> Scan:
    """The scan whose incident beam has passed the sheet already, so that it need not be reconstructed.

    The same scan where there is none, or less than `SHEET`.
    """
    levels = air_levels(scan)
    if np.abs(levels).max() < SHEET:
        return scan
    incident = np.stack([expected_in_air(scan, k, level) - scan.background[k] for k, level in enumerate(levels)])
    return Scan(scan.counts, incident, scan.views, scan.background, scan.mask, scan.notes, scan.blur)


def expected_in_air(scan: Scan, view: int, level: float) -> Float32:
    """(rows, columns): counts expected of a view in air, with background."""
    passed = np.exp(-level * obliquity(scan.views.source[view], scan.views.panels[view])) if level else 1.0
    return np.asarray(scan.incident[view] * passed + scan.background[view], np.float32)


def obliquity(source: Float64, panel: Panel) -> Float64:
    """(rows, columns): length of the ray in a sheet parallel to the panel, over the sheet's thickness."""
    rows, columns = np.indices(panel.shape)
    rays = panel.points(np.stack([rows.ravel(), columns.ravel()], axis=1)) - source
    secant: Float64 = np.linalg.norm(rays, axis=1) / np.abs(rays @ panel.normal)
    return secant.reshape(panel.shape)


def _air_level(scan: Scan, view: int) -> float:
    """NaN where no even region is seen.

    Means over blocks have a line integral l and a standard deviation σ. Air is the cluster of least l: it holds at least
    `LEAST` of the blocks within ±2σ, and `EVEN` times as many as lie from 3σ to 7σ above it.
    """
    y, I, r, mask = (a[view] for a in (scan.counts, scan.incident, scan.background, scan.mask))
    typical = max(float(np.median(y[mask])), 1.0) if mask.any() else 1.0
    side = min(math.ceil(1 / (NOISE * math.sqrt(typical))), WIDEST, max(1, min(y.shape) // 8))
    step = max(1, side // 2)
    share, net, beam, total = (
        uniform_filter(np.where(mask, a, 0).astype(np.float64), side)[::step, ::step]
        for a in (np.ones_like(y), y - r, I, y)
    )
    seen = (share > 0.99) & (net > 0)
    angle = obliquity(scan.views.source[view], scan.views.panels[view])[::step, ::step][seen]
    l = -np.log(net[seen] / beam[seen]) / angle
    sigma = np.sqrt(total[seen]) / (side * net[seen])
    low = (l > BRIGHTEST) & (l < THICKEST)
    if not low.any():
        return math.nan
    order = np.sort(l[low])
    width = float(np.median(sigma[low][np.argsort(l[low])[: max(1, low.sum() // 4)]]))

    def within(a: Float64, b: Float64) -> Float64:
        return np.asarray(np.searchsorted(order, b) - np.searchsorted(order, a), np.float64)

    counts = within(order - 2 * width, order + 2 * width)
    above = within(order + 3 * width, order + 7 * width)
    good = (counts >= LEAST * seen.sum()) & (counts >= EVEN * above)
    if not good.any():
        return math.nan
    first = order[np.argmax(good)]
    near = (order >= first) & (order <= first + 4 * width)
    level = float(order[near][np.argmax(counts[near])])
    for _ in range(5):
        level = float(order[np.abs(order - level) < 2 * width].mean())
    return level
