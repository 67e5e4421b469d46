"""Strength and edge of the prior, from the data, where the user gives none."""

import math
from dataclasses import replace

import numpy as np

from palpate.arrays import Float32
from palpate.reconstruction.likelihood import Likelihood
from palpate.reconstruction.prior import Prior
from palpate.reconstruction.projector import Projector
from palpate.volumes.grid import Grid

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
    """1/mm, over the rays through the object."""
    length = (A(np.ones(A.domain_shape, np.float32)) * likelihood.measured).astype(np.float64)
    p = np.maximum(likelihood.line_integrals.astype(np.float64), 0) * (length > 0)
    return max(float((p * p).sum() / max((p * length).sum(), 1e-12)), 1e-6)


def median_curvature(curvature: Float32) -> float:
    """Median over the voxels that some ray sees."""
    seen = curvature[curvature > 0]
    return float(np.median(seen)) if seen.size else 1.0
