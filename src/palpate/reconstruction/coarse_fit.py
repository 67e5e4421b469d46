"""How well one non-negative object explains all views of a scan, at a resolution at which that takes a moment.

Projections are consistent if and only if an object has them. So a coarse volume is fitted to coarse views, and what it
leaves over is judged. Unlike moment conditions this holds for truncated views too, because the volume reaches beyond the
field that the views share.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from palpate.arrays import Float32, Float64
from palpate.reconstruction.projector import Projector
from palpate.scans.intensity_correction import line_integrals
from palpate.scans.scan import Scan
from palpate.volumes.grid import Grid

ITERATIONS = 50
BLUR = 1.2  # coarse pixels: removes what coarse voxels cannot show
MODEL = 0.02  # relative error of a blurred line integral that is no fault of the geometry
OFFSET = 0.12  # of a view's line integrals: as much may be the beam's fault
STARVED = 3.0  # coarse net counts below which a pixel tells nothing


@dataclass(frozen=True, eq=False)
class Fit:
    """A coarse object, what it explains of the views, and the share of each view's contrast that it does not.

    offset: mean constant that the views add to their line integrals.
    """

    values: Float32
    grid: Grid
    measured: Float32
    explained: Float32
    weight: Float32
    left: Float64
    offset: float

    @property
    def misfit(self) -> float:
        """Root mean square, over the views, of the share that is left."""
        return float(np.sqrt(np.mean(self.left**2)))


def smooth_line_integrals(scan: Scan) -> tuple[Float32, Float32, Float32]:
    """(views, rows, columns) each: blurred line integrals, their variance by the counts, their weight."""
    net = np.maximum(scan.counts - scan.background, 0)
    seen = (scan.mask & (net > STARVED)).astype(np.float32)

    def blurred(values: Float32) -> Float32:
        return np.asarray(gaussian_filter(values * seen, (0, BLUR, BLUR), mode="constant") / np.maximum(share, 1e-3))

    share = gaussian_filter(seen, (0, BLUR, BLUR), mode="constant")
    l = blurred(line_integrals(scan))
    variance = blurred(scan.counts / np.maximum(net, 1) ** 2) / (4 * np.pi * BLUR**2)
    known = (seen > 0) & (share > 0.3)
    weight = np.where(known, 1 / (variance + (MODEL * np.maximum(np.abs(l), 0.3)) ** 2), 0)
    return l.astype(np.float32), variance.astype(np.float32), weight.astype(np.float32)


def fit_object(scan: Scan, grid: Grid, offset: float = OFFSET, iterations: int = ITERATIONS) -> Fit:
    """The non-negative volume that explains the blurred views best, after some accelerated steps.

    offset: bound of a constant that each view may add to its line integrals.

    Minimises Σ w (l − A f)² over f ≥ 0 with separable quadratic surrogates and Nesterov's momentum (Kim, Ramani &
    Fessler, IEEE TMI 34:167, 2015). w is the inverse variance of a line integral l by its counts and by the model.
    """
    l, variance, w = smooth_line_integrals(scan)
    A = Projector(scan.views, grid)
    surrogate = A.T(w * A(np.ones(grid.shape, np.float32)))
    step = np.where(surrogate > 1e-6 * surrogate.max(), 1 / np.maximum(surrogate, 1e-20), 0).astype(np.float32)
    f = z = np.zeros(grid.shape, np.float32)
    t = 1.0
    for _ in range(iterations):
        new = np.maximum(z + step * A.T(w * without_offset(l - A(z), w, offset)), 0)
        following = (1 + np.sqrt(1 + 4 * t * t)) / 2
        z = new + np.float32((t - 1) / following) * (new - f)
        f, t = new, following
    explained = A(f)
    error = without_offset(l - explained, w, offset)
    beam = float(np.mean(l - explained - error))
    return Fit(f, grid, l, l - error, w, unexplained(l, l - error, variance, w), beam)


def without_offset(error: Float32, w: Float32, bound: float) -> Float32:
    """The error of each view less its mean, up to a bound: a gain that drifts, and scatter as even as that in air."""
    mean = (w * error).sum(axis=(1, 2)) / np.maximum(w.sum(axis=(1, 2)), 1e-30)
    return np.asarray(error - np.clip(mean, -bound, bound)[:, None, None], np.float32)


def unexplained(l: Float32, explained: Float32, variance: Float32, w: Float32) -> Float64:
    """(views,): root of the weighted squared error, less what noise makes, over that of a constant."""
    total = np.maximum(w.sum(axis=(1, 2)), 1e-30)
    mean = (w * l).sum(axis=(1, 2)) / total
    contrast = (w * (l - mean[:, None, None]) ** 2).sum(axis=(1, 2))
    error = (w * (l - explained) ** 2).sum(axis=(1, 2)) - (w * variance).sum(axis=(1, 2))
    return np.asarray(np.sqrt(np.maximum(error, 0) / np.maximum(contrast, 1e-3 * total)), np.float64)
