"""Whether `incident` is too large where no view shows air: a constant in all line integrals that no object has."""

import numpy as np

from palpate.arrays import Float32
from palpate.reconstruction.coarse_fit import smooth_line_integrals
from palpate.reconstruction.projector import Projector
from palpate.scans.finding import Finding
from palpate.scans.scan import Scan
from palpate.volumes.grid import Grid

AIR = 0.6  # net counts over incident of the brightest pixels: above it, air or nearly air is seen
BRIGHT = 0.995  # of the pixels: the brightest
ITERATIONS = 20
LEAST, SURE = 0.35, 2.0  # of the constant: as much may be scatter or the beam's fault; and standard deviations above it
DRIFT, BLUNT = (
    0.012,
    0.01,
)  # standard deviation of a gain that drifts by 2 %; least trace of a constant that tells something


def check_open_beam(scan: Scan, grid: Grid) -> list[Finding]:
    """Whether an incident that is too large explains what no object does.

    grid: voxels over all that the views see.

    An `incident` too large by the factor e^c adds c to all line integrals. A layer with the line integral c across it adds
    c / cos(a), where a is the angle of the ray. So a constant is no object's: with A the projector, r(p) what the best
    volume leaves of p, and w the weights, the line integrals l = A f + c have

        c = <r(1), r(l)>_w / <r(1), r(1)>_w

    (Frisch, Waugh and Lovell's theorem). Gains that drift from view to view add to c the more, the less r(1) is.
    """
    net = (scan.counts - scan.background)[scan.mask] / scan.incident[scan.mask]
    if np.quantile(net, BRIGHT) > AIR:
        return []
    l, _, w = smooth_line_integrals(scan)
    A = Projector(scan.views, grid)
    alone, left = (_unexplained(A, p, w) for p in (np.ones_like(l), l))
    power = float(np.vdot(alone, w * alone))
    trace = np.sqrt(power / max(float(w.sum()), 1e-30))
    if trace < BLUNT:
        return []
    constant = float(np.vdot(alone, w * left)) / power
    if constant < LEAST + SURE * DRIFT / (trace * np.sqrt(len(l))):
        return []
    words = (
        f"no view shows air, and {constant:.2g} in all line integrals is a constant that no object has: is incident about "
        f"{np.exp(constant):.2g} times too large?"
    )
    return [Finding("incident", words)]


def _unexplained(A: Projector, p: Float32, w: Float32) -> Float32:
    """What the best volume leaves of p, by conjugate gradients for the least weighted squares."""
    left = p.copy()
    slope = direction = A.T(w * left)
    steep = float(np.vdot(slope, slope))
    for _ in range(ITERATIONS):
        image = A(direction)
        left -= np.float32(steep / float(np.vdot(image, w * image))) * image
        slope = A.T(w * left)
        before, steep = steep, float(np.vdot(slope, slope))
        direction = slope + np.float32(steep / before) * direction
    return left
