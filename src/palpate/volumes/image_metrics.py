"""Errors of a reconstruction against the truth: NMSE, SSIM, contrast to noise, spread over the slices."""

import numpy as np

from palpate.arrays import AnyArray, ArrayLike, Bool, Float64, float64
from palpate.errors import DataError


def nmse(values: ArrayLike, truth: ArrayLike, region: ArrayLike | None = None, scaled: bool = False) -> float:
    """Return the normalized mean-square error, Σ (values − truth)² / Σ truth².

    Parameters
    ----------
    values, truth : array_like
        Arrays of one shape and unit.
    region : array_like of bool, optional
        Where to compare, of the same shape. The default is everywhere.
    scaled : bool, optional
        Fit scale and offset of `values` to the truth by least squares first, and divide by the truth's variance.
        This ignores scale and offset, as a viewer with a window and level does.

    Returns
    -------
    float
        The error, no unit.

    Raises
    ------
    DataError
        If the shapes differ, or the truth is zero or constant there.

    Examples
    --------
    >>> round(pp.nmse([1.0, 2.2], [1.0, 2.0]), 3)
    0.008
    """
    x, t = _inside(values, truth, region)
    if not scaled:
        return _ratio(float(((x - t) ** 2).sum()), float((t**2).sum()), "truth is 0 everywhere")
    x, t = x - x.mean(), t - t.mean()
    spread = float((t**2).sum())
    along = float((x * t).sum()) ** 2 / max(float((x**2).sum()), np.finfo(float).tiny)
    return _ratio(spread - along, spread, "truth is constant")


def contrast_to_noise(values: ArrayLike, inside: ArrayLike, outside: ArrayLike) -> float:
    """Return the contrast-to-noise ratio of two regions.

    It is the difference of the two means over the standard deviation of the outer region.

    Parameters
    ----------
    values : array_like
        Values of any shape and unit.
    inside, outside : array_like of bool
        The two regions, of the same shape. They must not overlap.

    Returns
    -------
    float
        The ratio, no unit.

    Raises
    ------
    DataError
        If the regions overlap or are empty.

    Examples
    --------
    >>> values = np.array([5.0, 5.0, 1.0, 3.0])
    >>> pp.contrast_to_noise(values, values > 4, values < 4)
    3.0
    """
    x = float64("values", values)
    a, b = _region("inside", inside, x.shape), _region("outside", outside, x.shape)
    if (a & b).any():
        raise DataError(f"inside and outside overlap in {np.count_nonzero(a & b)} voxels; erode one of them")
    return _ratio(float(x[a].mean() - x[b].mean()), float(x[b].std()), "outside is constant")


def structural_similarity(values: ArrayLike, truth: ArrayLike, region: ArrayLike | None = None) -> float:
    """SSIM, slice by slice, its mean over the region: 1 for the truth itself.

    values, truth: (z, y, x), 11 voxels at least across a slice. Gaussian window, 1.5 voxels; the constants are those of
    Wang et al., IEEE TIP 13:600, 2004, for the range of the truth in the region. Raises `DataError`.
    """
    from skimage.metrics import structural_similarity as similarity

    t = float64("truth", truth, (None, None, None))
    x = float64("values", values, t.shape)
    where = np.ones(t.shape, dtype=bool) if region is None else _region("region", region, t.shape)
    if min(t.shape[1:]) < 11:
        raise DataError(f"truth: expected slices of at least 11 x 11 voxels, got {t.shape[1:]}")
    span = float(np.ptp(t[where]))
    if span == 0:
        raise DataError("truth is constant in the region, so there is no range to compare with; choose another region")
    options = {"data_range": span, "gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    maps = np.stack([similarity(a, b, full=True, **options)[1] for a, b in zip(x, t, strict=True)])
    return float(maps[where].mean())


def artefact_spread(values: ArrayLike, inside: ArrayLike, outside: ArrayLike, at: int) -> Float64:
    """Spread of an insert over the slices: (z,) contrast of slice over that of slice `at`, which holds the insert.

    values: (z, y, x). inside, outside: bool (y, x), the insert's shadow along z and the background around it, apart
    from each other. Source: Wu et al., Med. Phys. 31:2636, 2004. Raises `DataError`.
    """
    x = float64("values", values, (None, None, None))
    a, b = _region("inside", inside, x.shape[1:]), _region("outside", outside, x.shape[1:])
    if (a & b).any():
        raise DataError(f"inside and outside overlap in {np.count_nonzero(a & b)} pixels; erode one of them")
    if not 0 <= at < len(x):
        raise DataError(f"at: there is no slice {at!r}; choose from 0 to {len(x) - 1}")
    contrast: Float64 = x[:, a].mean(axis=1) - x[:, b].mean(axis=1)
    if contrast[at] == 0:
        raise DataError(f"the insert has no contrast in slice {at}, so nothing can be divided by it")
    spread: Float64 = contrast / contrast[at]
    return spread


def width_at_half(curve: ArrayLike, spacing: float) -> float:
    """Full width at half of the maximum, mm, of samples (n,) `spacing` mm apart, linear in between.

    A side that never falls to the half ends at the last sample. Raises `DataError`.
    """
    y = float64("curve", curve, (None,))
    top = int(np.argmax(y))
    half = y[top] / 2
    if not half > 0:
        raise DataError("curve: its maximum is not above 0, so it has no half")
    reach = 0.0
    for side in (y[top:], y[top::-1]):
        below = np.flatnonzero(side < half)
        if below.size:
            k = int(below[0])
            reach += k - 1 + float((side[k - 1] - half) / (side[k - 1] - side[k]))
        else:
            reach += len(side) - 1
    return reach * spacing


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
