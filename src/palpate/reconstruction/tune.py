"""Strength and edge of the prior, from the data, where the user gives none."""

import math
from dataclasses import replace

import numpy as np

from palpate.arrays import Float32, Float64
from palpate.reconstruction.likelihood import Likelihood
from palpate.reconstruction.prior import Prior
from palpate.reconstruction.projector import Projector
from palpate.scans.views import Views
from palpate.volumes.grid import Grid

RAYS = 10_000  # a view, enough for a mean: ten times as many change it by 0.03 %
SHARE = 0.05  # an edge, as a share of the object's attenuation: half of what parts fat from muscle


def tune(prior: Prior, A: Projector, likelihood: Likelihood, curvature: Float32) -> Prior:
    """The prior with its open knobs chosen, from nothing but the scan and the grid.

    edge: a twentieth of the object's mean attenuation (mean of line integral / length in the box over the measured rays,
    each weighted by its line integral, so that air has no say). strength: at one edge, neighbours pull as hard as noise
    does. The noise in the data's pull on a voxel, the slope of the likelihood, has the variance d, the data's curvature
    there (Fisher's information); β is such that the neighbours of a voxel one edge away from all of them pull back with √d,
    d the median over the voxels that some ray sees. Smaller differences are noise's as likely as not, larger ones the
    object's. So β grows as the root of the dose: slower than the data's own weight, so that a scan of more photons is
    smoothed less. For a quadratic prior
    the edge serves to choose the strength only. curvature: see `data_curvature`.
    """
    edge = prior.edge if prior.edge is not None else SHARE * mean_attenuation(A, likelihood)
    prior = replace(prior, edge=edge)
    if prior.strength is None:
        one = np.zeros((3, 3, 3), np.float32)
        one[1, 1, 1] = edge
        pull = prior.surrogate(one, Grid(one.shape, A.grid.spacing, (0, 0, 0)))[0][1, 1, 1]
        known = median_curvature(curvature)
        prior = replace(prior, strength=float(math.sqrt(known) / (pull * known)))
    return prior


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
        way[way == 0] = 1e-12  # along a plane: in between or beside for all its length
        near, far = ((face - 0.5 - start) / way for face in (np.zeros(3), np.array(grid.shape)))
        enter = np.minimum(near, far).max(axis=1).clip(0)
        leave = np.maximum(near, far).min(axis=1).clip(max=1)
        out[k] = ((leave - enter).clip(0) * np.linalg.norm(ends - source, axis=1)).reshape(r.shape)
    return out


def median_curvature(curvature: Float32) -> float:
    """Median over the voxels that some ray sees."""
    seen = curvature[curvature > 0]
    return float(np.median(seen)) if seen.size else 1.0
