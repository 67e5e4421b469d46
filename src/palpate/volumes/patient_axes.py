"""Reorders the axes of a volume along those of the patient, or of another grid."""

from itertools import permutations, product
from typing import Protocol

import numpy as np

from palpate.arrays import AnyArray, Float32, Float64, Int32
from palpate.volumes.grid import Grid


class VoxelImage(Protocol):
    """What a plot needs of a `Volume`; this module may not import it."""

    @property
    def values(self) -> Float32:
        """(z, y, x)."""

    @property
    def grid(self) -> Grid:
        """Where the voxels are."""

    @property
    def unit(self) -> str:
        """ "1/mm" or "HU"."""


class LabelImage(Protocol):
    """What a plot needs of `Labels`."""

    @property
    def values(self) -> Int32:
        """(z, y, x)."""

    @property
    def grid(self) -> Grid:
        """Where the voxels are."""


def reorient_to_patient(volume: VoxelImage) -> tuple[Float32, Grid]:
    """The same voxels, axes swapped and reversed so that x, y, z are nearest to left, posterior, superior.

    The values are a view of the volume's, not a copy.
    """
    return patient_view(volume.values, volume.grid), patient_grid(volume.grid)


def patient_view(values: AnyArray, grid: Grid) -> AnyArray:
    """Values (z, y, x) on a grid, as a view with the axes of `patient_grid`."""
    return reordered_view(values, grid, np.eye(3))


def patient_grid(grid: Grid) -> Grid:
    """The same voxels as a grid whose axes x, y, z are nearest to left, posterior, superior."""
    return reordered_grid(grid, np.eye(3))


def reordered_view(values: AnyArray, grid: Grid, direction: Float64) -> AnyArray:
    """Values (z, y, x) on a grid, as a view with the axes of `reordered_grid`."""
    order, signs = _nearest_axes(grid, direction)
    flips = tuple(slice(None, None, signs[2 - a]) for a in range(3))
    return values.transpose([2 - order[2 - a] for a in range(3)])[flips]


def reordered_grid(grid: Grid, direction: Float64) -> Grid:
    """The same voxels as a grid whose axes x, y, z, swapped and reversed, are nearest to the columns of `direction`."""
    order, signs = _nearest_axes(grid, direction)
    axes = [2 - order[2 - a] for a in range(3)]  # of the array, (z, y, x)
    corner = np.zeros(3)
    for a in range(3):
        if signs[2 - a] < 0:
            corner[axes[a]] = grid.shape[axes[a]] - 1
    shape, spacing = ([of[i] for i in axes] for of in (grid.shape, grid.spacing))
    return Grid(shape, spacing, grid.points(corner)[0], grid.direction[:, order] * signs)


def _nearest_axes(grid: Grid, direction: Float64) -> tuple[list[int], list[int]]:
    """For x, y and z the grid's axis that is nearest, and its sign: of all rotations the one with the largest trace."""
    ways = [
        (list(order), list(signs))
        for order in permutations(range(3))
        for signs in product((1, -1), repeat=3)
        if np.linalg.det(np.eye(3)[:, order] * signs) > 0
    ]
    return max(ways, key=lambda way: float(np.trace(direction.T @ (grid.direction[:, way[0]] * way[1]))))


def has_patient_axes(volume: VoxelImage) -> bool:
    """Whether the axes are those of a patient. Without a direction they are those of the X-ray system."""
    return volume.unit == "HU" or not np.allclose(volume.grid.direction, np.eye(3), atol=1e-6)
