"""PS,P,CD: paraboloidal surrogates of likelihood and prior, minimised voxel by voxel."""

from collections.abc import Iterator

import numpy as np

from palpate import _core
from palpate.arrays import Float32
from palpate.reconstruction.likelihood import Curvature, Likelihood
from palpate.reconstruction.prior import Prior
from palpate.reconstruction.projector import Projector


def descend(
    A: Projector, likelihood: Likelihood, prior: Prior, beta: float, values: Float32, curvature: Curvature = "optimal"
) -> Iterator[tuple[Float32, float]]:
    """Coordinate descent on Φ(f) = likelihood(A f) + β R(f), f >= 0 (Erdogan & Fessler, IEEE TMI 18:801, 1999).

    Yields each iterate and its objective, without end. With "optimal" or "maximum" curvature the objective never rises.
    The yielded volume is the working array: copy it to keep it. Nothing else is carried from one iteration to the next,
    so a run that starts from an iterate goes on exactly as the one that made it.
    """
    values = np.array(values, np.float32)
    l = A(values)
    while True:
        _core.descend(A.geometry, likelihood.slope(l), likelihood.curvature(l, curvature), values, *prior.law, beta)
        l = A(values)
        yield values, likelihood.value(l) + (beta * prior.value(values, A.grid) if beta > 0 else 0.0)


def data_curvature(A: Projector, likelihood: Likelihood) -> Float32:
    """d_j = Σ_i a_ij² c_i (z, y, x) with the precomputed curvature: how well the data alone know each voxel, mm²."""
    nothing = np.zeros(A.range_shape, np.float32)
    return _core.diagonal(A.geometry, np.ascontiguousarray(likelihood.curvature(nothing, "precomputed")))
