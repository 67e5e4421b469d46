"""The share of each voxel that an ellipsoid fills."""

import numpy as np

from palpate.arrays import ArrayLike, Float32
from palpate.volumes.grid import Grid

SUBVOXELS = 4  # along a voxel's side, where the share is counted


def ellipsoid_shares(grid: Grid, centre: ArrayLike, radii: ArrayLike) -> Float32:
    """(z, y, x) share of each voxel in an ellipsoid along the grid's axes, 0 to 1. centre, radii: (3,) mm in x, y, z."""
    at, radius = grid.indices(np.asarray(centre))[0], np.broadcast_to(radii, 3)[::-1]
    sub = (np.arange(SUBVOXELS) + 0.5) / SUBVOXELS - 0.5
    squares, near = [], []
    for k in range(3):
        away = (np.arange(grid.shape[k])[:, None] + sub - at[k]) * grid.spacing[k] / radius[k]
        met = np.flatnonzero((away**2 <= 1).any(axis=1))
        near.append(slice(met[0], met[-1] + 1) if len(met) else slice(0))
        squares.append(away[near[-1]] ** 2)
    z, y, x = squares
    within = z[:, :, None, None, None, None] + y[:, :, None, None] + x <= 1
    shares = np.zeros(grid.shape, np.float32)
    shares[tuple(near)] = within.mean(axis=(1, 3, 5))
    return shares
