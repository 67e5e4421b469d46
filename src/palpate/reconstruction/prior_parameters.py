"""Chooses the strength and the edge of the prior from the data."""

import math
from dataclasses import replace

import numpy as np

from palpate.arrays import Float32, Float64
from palpate.reconstruction.models.likelihood import Likelihood
from palpate.reconstruction.models.mrf_prior import Prior
from palpate.reconstruction.optimizers.coordinate_descent import sampled_diagonal
from palpate.reconstruction.projector import Projector
from palpate.scans.views import Views
from palpate.volumes.grid import Grid

RAYS = 10_000  # for each view; ten times as many change the mean by 0.03 %
SHARE = 0.05  # edge over the object's mean attenuation: half the difference between fat and muscle
SMOOTH_SHARE = 0.0005  # the same of a smooth object: the penalty is nearly a total variation over all neighbours


def choose_prior_parameters(
    prior: Prior, A: Projector, likelihood: Likelihood, curvature: Float32, local: float | None = None
) -> Prior:
    """The prior with its missing parameters chosen from the scan and the grid.

    edge: a twentieth of the object's mean attenuation: the mean of line integral / length in the box over the
    measured rays, weighted by the line integral, so that air does not count. strength: the prior's gradient at a
    voxel that differs from all its neighbours by one edge is √d, the standard deviation of the likelihood's gradient;
    d is the median of the Fisher information over the voxels that some ray meets. Smaller differences are mostly
    noise, larger ones mostly the object. β grows as the square root of the dose, so that a scan of more photons is
    smoothed less. A quadratic prior uses the edge only to choose the strength. Of a smooth object the edge is 0.05 %
    of the mean attenuation, and the prior's gradient is √(2 log n) √d, with the n voxels that some ray meets. The
    largest of n standard normal numbers is hardly ever larger, so that noise alone makes no structure (Donoho &
    Johnstone's universal threshold). With a resolution β is `local` times the data's curvature in the object; both
    the curvature and β are proportional to the dose. curvature: see `data_curvature`. local: what
    `strength_for_resolution` gives, needed with a resolution alone.
    """
    if prior.resolution is not None:
        assert local is not None
        share = object_curvature(A, likelihood, curvature) / median_curvature(curvature)
        return replace(prior, strength=local * share, resolution=None)
    share = SMOOTH_SHARE if prior.smooth else SHARE
    edge = prior.edge if prior.edge is not None else share * mean_attenuation(A, likelihood)
    pulls = universal_threshold(curvature) if prior.smooth else 1.0
    prior = replace(prior, edge=edge, smooth=False)
    if prior.strength is None:
        one = np.zeros((3, 3, 3), np.float32)
        one[1, 1, 1] = edge
        pull = prior.surrogate(one, Grid(one.shape, A.grid.spacing, (0, 0, 0)))[0][1, 1, 1]
        known = median_curvature(curvature)
        prior = replace(prior, strength=float(pulls * math.sqrt(known) / (pull * known)))
    return prior


def universal_threshold(curvature: Float32) -> float:
    """√(2 log n), with the n voxels that some ray meets."""
    return math.sqrt(2 * math.log(max(int(np.count_nonzero(curvature > 0)), 2)))


def mean_attenuation(A: Projector, likelihood: Likelihood) -> float:
    """1/mm, over the rays through the object: of large panels `RAYS` a view, evenly spread."""
    step = max(1, math.isqrt(math.prod(A.range_shape[1:]) // RAYS))
    there = np.s_[:, ::step, ::step]
    length = box_lengths(A.views, A.grid, step) * likelihood.measured[there]
    p = np.maximum(likelihood.line_integrals[there].astype(np.float64), 0) * (length > 0)
    return max(float((p * p).sum() / max((p * length).sum(), 1e-12)), 1e-6)


def box_lengths(views: Views, grid: Grid, step: int = 1) -> Float64:
    """mm of the ray to each `step`-th pixel's centre that lie in the grid's box, (views, rows/step, columns/step)."""
    out = np.empty((len(views), -(-views.shape[1] // step), -(-views.shape[2] // step)))
    r, c = np.meshgrid(*(np.arange(0, n, step) for n in views.shape[1:]), indexing="ij")
    pixels = np.stack([r.ravel(), c.ravel()], axis=1)
    for k, (source, panel) in enumerate(zip(views.source, views.panels, strict=True)):
        ends = panel.points(pixels)
        start, way = grid.indices(source), grid.indices(ends)
        way -= start
        way[way == 0] = 1e-12  # parallel to two faces of the box: avoids a division by zero
        near, far = ((face - 0.5 - start) / way for face in (np.zeros(3), np.array(grid.shape)))
        enter = np.minimum(near, far).max(axis=1).clip(0)
        leave = np.maximum(near, far).min(axis=1).clip(max=1)
        out[k] = ((leave - enter).clip(0) * np.linalg.norm(ends - source, axis=1)).reshape(r.shape)
    return out


def object_curvature(A: Projector, likelihood: Likelihood, curvature: Float32) -> float:
    """Median over the voxels, each weighted by the squares of the line integrals through it, so that air does not count."""
    p = np.where(likelihood.measured, np.maximum(likelihood.line_integrals, 0), np.float32(0))
    weights = sampled_diagonal(A, p * p).ravel()
    order = np.argsort(curvature, axis=None)
    below = np.cumsum(weights[order], dtype=np.float64)
    if not below[-1] > 0:
        return median_curvature(curvature)
    return float(curvature.ravel()[order[np.searchsorted(below, below[-1] / 2)]])


def explain_prior(given: Prior, chosen: Prior) -> str:
    """One line: what a prior is, and by what each of its numbers was decided."""
    name = given.potential if isinstance(given.potential, str) else type(given.potential).__name__
    said = f"prior {name}, strength {chosen.strength:.3g} 1/mm"
    if given.resolution is not None:
        return f"{said}: a point becomes {given.resolution:g} mm wide in the slice, at every dose"
    reasons = []
    if given.smooth:
        edge = f", edge {chosen.edge:.3g} 1/mm" if given.edge is None else ""
        return (
            f"{said}{edge}: for a smooth object: neighbours that differ pull several times as hard as the noise, so that it "
            f"makes no structure; what is small or faint is lost, and the level is too low: for seeing, not for measuring"
        )
    if given.strength is None:
        reasons.append("the strength by the dose: at one edge neighbours pull as hard as the noise")
    if name != "quadratic":
        said += f", edge {chosen.edge:.3g} 1/mm"
        if given.edge is None:
            reasons.append(f"the edge by the object: {SHARE:.0%} of its mean attenuation")
        reasons.append("for smooth objects: it flattens faint detail, which --resolution keeps")
    return said + (": " + "; ".join(reasons) if reasons else "")


def median_curvature(curvature: Float32) -> float:
    """Median over the voxels that some ray sees."""
    seen = curvature[curvature > 0]
    return float(np.median(seen)) if seen.size else 1.0
