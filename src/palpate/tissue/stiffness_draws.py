"""Draws of the stiffness from its range, and the stiffness of elements that a lump fills in part."""

import numpy as np
from scipy.special import ndtri

from palpate.arrays import Float64
from palpate.errors import MaterialError
from palpate.tissue.tissue_properties import Measured

Stiffness = Measured | tuple[float, float]


def log_normal(name: str, given: Stiffness) -> tuple[float, float]:
    """Mean and standard deviation of the logarithm of a stiffness."""
    if isinstance(given, Measured):
        if given.value is None or given.spread is None:
            raise MaterialError(f"{name}: {given.text} has no mean and spread; give both in kPa")
        given = (given.value, given.spread)
    mean, std = given
    if not (np.isfinite([mean, std]).all() and mean > 0 and std >= 0):
        raise MaterialError(f"{name}: expected a mean above 0 and a standard deviation of at least 0, got {given!r}")
    variance = np.log1p((std / mean) ** 2)
    return float(np.log(mean) - variance / 2), float(np.sqrt(variance))


def latin_normals(count: int, dimensions: int, seed: int) -> Float64:
    """(count, dimensions) standard normal, one in each of `count` equally likely strata of every dimension."""
    rng = np.random.default_rng(seed)
    strata = np.stack([rng.permutation(count) for _ in range(dimensions)], axis=1)
    return np.asarray(ndtri((strata + rng.uniform(0, 1, strata.shape)) / count))


def in_series(soft: Float64, stiff: float, share: Float64) -> Float64:
    """(M,) kPa: compliances add up by volume (Reuss). In a soft body that is near the force of meshes that follow a lump."""
    return np.asarray(1 / ((1 - share) / soft + share / stiff))
