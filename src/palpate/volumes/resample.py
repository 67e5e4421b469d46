"""A volume on another grid of the same directions."""

from typing import Literal

import numpy as np
from scipy.ndimage import median_filter

from palpate.arrays import Float32, Float64
from palpate.errors import DataError, GeometryError
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Volume

Interpolation = Literal["linear", "nearest", "median"]
INTERPOLATIONS: tuple[Interpolation, ...] = ("linear", "nearest", "median")


def resample(volume: Volume, grid: Grid, interpolation: Interpolation = "linear") -> Volume:
    """The volume at the voxel centres of `grid`; voxels are cells, so grids of other spacing meet at their faces.

    "linear" interpolates along each axis and holds the outermost value up to the cell's face; "nearest" takes the cell
    that holds the centre; "median" is "nearest" smoothed by the median of 3x3 voxels in the slice. Voxels outside the
    volume's box are 0. Raises `GeometryError` for grids turned against each other, `DataError` for another name.
    """
    if interpolation not in INTERPOLATIONS:
        raise DataError(f"interpolation: there is no {interpolation!r}; choose from {', '.join(INTERPOLATIONS)}")
    if not np.allclose(volume.grid.direction, grid.direction, atol=1e-4):
        raise GeometryError("resample: the two grids have different directions; only shifts and spacings can differ")
    values = volume.values
    for axis, positions in enumerate(_positions(volume.grid, grid)):
        values = _along(values, axis, positions, linear=interpolation == "linear")
    if interpolation == "median":
        values = median_filter(values, size=(1, 3, 3), mode="nearest")
    return Volume(values, grid, volume.unit)


def _positions(old: Grid, new: Grid) -> list[Float64]:
    """Along z, y, x: the index in the old grid of each new voxel's centre."""
    offset = old.direction.T @ (np.array(new.origin) - np.array(old.origin))
    return [
        (offset[2 - i] + new.spacing[i] * np.arange(new.shape[i], dtype=np.float64)) / old.spacing[i] for i in range(3)
    ]


def _along(values: Float32, axis: int, positions: Float64, linear: bool) -> Float32:
    n = values.shape[axis]
    outside = (positions < -0.5 - 1e-6) | (positions > n - 0.5 + 1e-6)
    held = np.clip(positions, 0, n - 1)
    shape = [1, 1, 1]
    shape[axis] = -1
    if linear:
        low = np.minimum(held.astype(int), max(n - 2, 0))
        share = (held - low).astype(np.float32).reshape(shape)
        high = np.minimum(low + 1, n - 1)
        new = values.take(low, axis) * (1 - share) + values.take(high, axis) * share
    else:
        new = values.take(np.floor(held + 0.5).clip(0, n - 1).astype(int), axis)
    if outside.any():
        new = new * ~outside.reshape(shape)
    moved: Float32 = np.ascontiguousarray(new, np.float32)
    return moved
