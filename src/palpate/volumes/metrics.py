"""How near a reconstruction comes to the truth, in a region, with or without its scale."""

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import AnyArray, Bool, Float64, float64
from palpate.errors import DataError


def nmse(values: ArrayLike, truth: ArrayLike, region: ArrayLike | None = None, scaled: bool = False) -> float:
    """Normalised mean-square error: Σ (values - truth)² / Σ truth² over the region.

    values, truth: arrays of one shape. region: bool of that shape, None is everywhere. scaled: first bring values
    to the truth's mean and contrast by least squares, a·values + b, and divide by the truth's variance instead: what a
    viewer with a window and level would judge (few views leave scale and offset uncertain). Raises `DataError`.
    """
    x, t = _inside(values, truth, region)
    if not scaled:
        return _ratio(float(((x - t) ** 2).sum()), float((t**2).sum()), "truth is 0 everywhere")
    x, t = x - x.mean(), t - t.mean()
    spread = float((t**2).sum())
    along = float((x * t).sum()) ** 2 / max(float((x**2).sum()), np.finfo(float).tiny)
    return _ratio(spread - along, spread, "truth is constant")


def contrast_to_noise(values: ArrayLike, inside: ArrayLike, outside: ArrayLike) -> float:
    """Difference of the two regions' means over the standard deviation of the outer one (the background).

    values: any shape. inside, outside: bool of that shape, apart from each other. Raises `DataError`.
    """
    x = float64("values", values)
    a, b = _region("inside", inside, x.shape), _region("outside", outside, x.shape)
    if (a & b).any():
        raise DataError(f"inside and outside overlap in {np.count_nonzero(a & b)} voxels; erode one of them")
    return _ratio(float(x[a].mean() - x[b].mean()), float(x[b].std()), "outside is constant")


def _inside(values: ArrayLike, truth: ArrayLike, region: ArrayLike | None) -> tuple[Float64, Float64]:
    t = float64("truth", truth)
    x = float64("values", values, t.shape)
    where = np.ones(t.shape, dtype=bool) if region is None else _region("region", region, t.shape)
    return x[where], t[where]


def _region(name: str, region: ArrayLike, shape: tuple[int, ...]) -> Bool:
    where: AnyArray = np.asarray(region)
    if where.dtype != bool or where.shape != shape:
        raise DataError(f"{name}: expected bool of shape {shape}, got {where.dtype} of {where.shape}")
    if not where.any():
        raise DataError(f"{name}: no voxel is True; mark the voxels to judge")
    return where


def _ratio(top: float, bottom: float, problem: str) -> float:
    if bottom == 0:
        raise DataError(f"{problem} in the region, so nothing can be divided by it; choose another region")
    return top / bottom
