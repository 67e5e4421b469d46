"""Reconstruction with a penalty on the total variation."""

from collections.abc import Iterator

import numpy as np

from palpate.arrays import Float32
from palpate.errors import DataError
from palpate.reconstruction.baselines.sirt import check_seen
from palpate.reconstruction.models.likelihood import Likelihood
from palpate.reconstruction.prior_parameters import SHARE, mean_attenuation
from palpate.reconstruction.projector import Projector
from palpate.volumes.grid import Grid

INNER = 8  # steps of the denoising in each iteration; doubled if they are too few
ROUNDING = 1e-6  # share of the objective below which a rise is a rounding error of float32


def tv(
    A: Projector, likelihood: Likelihood, values: Float32, strength: float | None = None
) -> Iterator[tuple[Float32, float]]:
    """Minimize −log likelihood(A f) + β TV(f) over f ≥ 0, with isotropic total variation.

    The objective never rises. The method is an accelerated proximal gradient, scaled by voxel and restarted if the
    objective would rise.

    Parameters
    ----------
    A : Projector
        The projector.
    likelihood : Likelihood
        The data.
    values : ndarray, (z, y, x)
        The start, 1/mm.
    strength : float, optional
        β = strength × the median of (Aᵀ C A 1)_j / V, no unit, with the data's curvature C and the voxel's volume V. A
        column of radius r mm through the whole depth then loses 2 · strength / r of its attenuation. By default, a voxel
        that stands out by one edge is less likely by a factor of e.

    Yields
    ------
    tuple of ndarray and float
        The iterate and the objective. The iteration has no end.

    Raises
    ------
    DataError
        If the strength is not valid.
    GeometryError
        If no measured ray meets the grid.

    References
    ----------
    Beck & Teboulle, IEEE TIP 18:2419, 2009. Strong & Chan, Inverse Problems 19:S165, 2003.

    Examples
    --------
    >>> A, start = pp.Projector(views, grid), np.zeros(grid.shape, np.float32)
    >>> iterate, objective = next(pp.tv(A, pp.Transmission.of(scan), start))
    """
    if strength is not None and not 0 <= strength < float("inf"):
        raise DataError(f"strength: expected 0 or more, got {strength!r}; None lets the data choose")
    x = np.maximum(np.array(values, np.float32), 0)
    steep, beta = _scale(A, likelihood, strength)
    weight = np.float32(beta * A.grid.voxel_volume)
    inner, t = INNER, 1.0
    q = np.zeros((3, *A.domain_shape), np.float32)
    l = A(x)
    objective = likelihood.value(l) + beta * total_variation(x, A.grid)
    y, l_y = x, l
    while True:
        z, q = denoise(y - A.T(likelihood.slope(l_y)) / steep, steep, weight, q, A.grid, inner)
        l_z = A(z)
        now = likelihood.value(l_z) + beta * total_variation(z, A.grid)
        if now <= objective:
            following = (1 + np.sqrt(1 + 4 * t * t)) / 2
            ahead = np.float32((t - 1) / following)
            y, l_y = z + ahead * (z - x), l_z + ahead * (l_z - l)
            x, l, objective, t = z, l_z, now, following
        else:
            if t == 1.0 and now > objective * (
                1 + ROUNDING
            ):  # the momentum is not the cause, but the step or the denoising
                steep, inner = 2 * steep, 2 * inner
            y, l_y, t = x, l, 1.0
        yield x, objective


def total_variation(values: Float32, grid: Grid) -> float:
    """Σ V |∇f|, mm. values: (z, y, x) 1/mm."""
    return float(np.sqrt(np.square(_gradient(values, grid)).sum(axis=0)).sum(dtype=np.float64) * grid.voxel_volume)


def denoise(
    z: Float32, steep: Float32, weight: np.float32, q: Float32, grid: Grid, steps: int
) -> tuple[Float32, Float32]:
    """argmin over x >= 0 of Σ steep (x − z)²/2 + weight Σ |∇x|, and its dual (3, z, y, x), |q| <= 1, which starts at q."""
    if weight == 0:
        return np.maximum(z, 0), q
    least = steep.copy()  # of a voxel and the neighbours that its differences reach
    for axis in range(3):
        here = [slice(None)] * 3
        there = [slice(None)] * 3
        here[axis], there[axis] = slice(None, -1), slice(1, None)
        np.minimum(least[tuple(here)], steep[tuple(there)], out=least[tuple(here)])
    rate = least / np.float32(4 * sum(1 / d**2 for d in grid.spacing) * float(weight))
    share = weight / steep
    r, t = q, 1.0
    for _ in range(steps):
        x = np.maximum(z - share * _transposed(r, grid), 0)
        new = r + rate * _gradient(x, grid)
        new /= np.maximum(1, np.sqrt(np.square(new).sum(axis=0)))
        following = (1 + np.sqrt(1 + 4 * t * t)) / 2
        r = new + np.float32((t - 1) / following) * (new - q)
        q, t = new, following
    return np.maximum(z - share * _transposed(q, grid), 0), q


def _scale(A: Projector, likelihood: Likelihood, strength: float | None) -> tuple[Float32, float]:
    """A diagonal above the data's curvature AᵀCA (De Pierro, IEEE TMI 14:132, 1995), and β."""
    length = A(np.ones(A.domain_shape, np.float32)) * likelihood.measured
    check_seen(length)
    steep = A.T(likelihood.curvature(np.zeros_like(length), "precomputed") * length)
    median = float(np.median(steep[steep > 0]))
    if strength is None:
        spike = np.zeros((3, 3, 3), np.float32)
        spike[1, 1, 1] = SHARE * mean_attenuation(A, likelihood)
        beta = 1 / total_variation(spike, Grid(spike.shape, A.grid.spacing))
    else:
        beta = strength * median / A.grid.voxel_volume
    return np.maximum(steep, np.float32(1e-2 * median)), beta


def _gradient(values: Float32, grid: Grid) -> Float32:
    """(3, z, y, x): differences to the next voxel along z, y, x, by mm; 0 at the last."""
    differences = np.zeros((3, *values.shape), np.float32)
    for axis, spacing in enumerate(grid.spacing):
        inner = tuple(slice(None, -1) if a == axis else slice(None) for a in range(3))
        np.multiply(np.diff(values, axis=axis), np.float32(1 / spacing), out=differences[axis][inner])
    return differences


def _transposed(q: Float32, grid: Grid) -> Float32:
    """The transpose of `_gradient`."""
    summed = np.zeros(q.shape[1:], np.float32)
    for axis, spacing in enumerate(grid.spacing):
        low = tuple(slice(None, -1) if a == axis else slice(None) for a in range(3))
        high = tuple(slice(1, None) if a == axis else slice(None) for a in range(3))
        part = q[axis][low] * np.float32(1 / spacing)
        summed[low] -= part
        summed[high] += part
    return summed
