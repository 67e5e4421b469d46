"""Resamples a volume to another grid of the same directions."""

from typing import Literal

import numpy as np
from scipy.ndimage import median_filter

from palpate import _core
from palpate.arrays import Bool, Float32, Float64, Int32
from palpate.errors import DataError, GeometryError
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Volume

Interpolation = Literal["linear", "nearest", "median"]
INTERPOLATIONS: tuple[Interpolation, ...] = ("linear", "nearest", "median")


def resample(volume: Volume, grid: Grid, interpolation: Interpolation = "linear") -> Volume:
    """Return a volume on another grid.

    Voxels outside the volume's box become 0.

    Parameters
    ----------
    volume : Volume
        The values.
    grid : Grid
        The new grid, with the same direction.
    interpolation : {"linear", "nearest", "median"}, optional
        "nearest" takes the voxel that holds the centre. "median" smooths this by the median of 3×3 voxels in the slice.

    Returns
    -------
    Volume
        Values at the voxel centres of `grid`.

    Raises
    ------
    GeometryError
        If the directions of the two grids differ.
    DataError
        If the interpolation is unknown.

    Examples
    --------
    >>> coarse = pp.Grid((4, 10, 12), (10, 6, 6), origin=(-33, -27, 9))
    >>> pp.resample(volume, coarse).values.shape
    (4, 10, 12)
    """
    if interpolation not in INTERPOLATIONS:
        raise DataError(f"interpolation: there is no {interpolation!r}; choose from {', '.join(INTERPOLATIONS)}")
    if not np.allclose(volume.grid.direction, grid.direction, atol=1e-4):
        raise GeometryError("resample: the two grids have different directions; only shifts and spacings can differ")
    values = volume.values
    if interpolation == "linear":
        return Volume(_linear(values, _positions(volume.grid, grid), grid), grid, volume.unit)
    for axis, positions in enumerate(_positions(volume.grid, grid)):
        values = _nearest(values, axis, positions)
    if interpolation == "median":
        values = median_filter(values, size=(1, 3, 3), mode="nearest")
    return Volume(values, grid, volume.unit)


def _positions(old: Grid, new: Grid) -> list[Float64]:
    """Along z, y, x: the index in the old grid of each new voxel's centre."""
    offset = old.direction.T @ (np.array(new.origin) - np.array(old.origin))
    return [
        (offset[2 - i] + new.spacing[i] * np.arange(new.shape[i], dtype=np.float64)) / old.spacing[i] for i in range(3)
    ]


def _linear(values: Float32, positions: list[Float64], grid: Grid) -> Float32:
    """One pass, slices and rows mixed before columns; nothing of the volume's size beside the answer."""
    z, y, x = (_interpolation_weights(along, n) for n, along in zip(values.shape, positions, strict=True))
    out = np.empty(grid.shape, np.float32)
    _core.volume.interpolate(values, z[0], z[1], z[2], y[0], y[1], y[2], x[0], x[1], x[2], out)
    return out


def _interpolation_weights(positions: Float64, n: int) -> tuple[Int32, Float32, Float32]:
    """Index below each position, share of the way to the next, and 1 inside or 0 outside."""
    held = np.clip(positions, 0, n - 1)
    low = np.minimum(held.astype(np.int32), max(n - 2, 0))
    return low, (held - low).astype(np.float32), (~_outside(positions, n)).astype(np.float32)


def _nearest(values: Float32, axis: int, positions: Float64) -> Float32:
    n = values.shape[axis]
    new = values.take(np.floor(np.clip(positions, 0, n - 1) + 0.5).clip(0, n - 1).astype(int), axis)
    if (outside := _outside(positions, n)).any():
        new = new * np.expand_dims(~outside, tuple({0, 1, 2} - {axis}))
    moved: Float32 = np.ascontiguousarray(new, np.float32)
    return moved


def _outside(positions: Float64, n: int) -> Bool:
    return (positions < -0.5 - 1e-6) | (positions > n - 0.5 + 1e-6)
