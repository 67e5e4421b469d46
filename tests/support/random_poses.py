"""Views from anywhere around a volume: cone and parallel beams, panels tilted, spun and off-centre."""

import numpy as np

import palpate as pp
from support.projector_scenes import centred


def random_pose(seed):
    """One view and a grid of 20 to 40 voxels a side; every third beam is parallel."""
    rng = np.random.default_rng(seed)
    shape = rng.integers(20, 41, 3)
    spacing = rng.uniform(0.8, 2.4, 3)
    size = float(np.linalg.norm(shape * spacing))
    grid = pp.Grid(shape, spacing, rng.uniform(-40, 40, 3))
    middle = grid.bounds.mean(axis=0)
    towards = _unit(rng.standard_normal(3))
    before = 5e8 if seed % 3 == 2 else size * rng.uniform(1.5, 8)
    behind = size * rng.uniform(0.6, 1.5)
    normal = _unit(towards + 0.2 * rng.standard_normal(3))
    row = _unit(np.cross(normal, rng.standard_normal(3)))
    column = np.cross(row, normal)
    pixels = rng.integers(40, 90, 2)
    pitch = size * (1 + min(behind / before, 1)) / pixels * rng.uniform(0.5, 1.2, 2)
    beside = rng.uniform(-0.2, 0.2, 2) * size
    centre = middle - behind * towards + beside[0] * row + beside[1] * column
    return pp.Views([middle + before * towards], centred(pixels, pitch, centre, row, column)), grid


def boxes(grid, seed):
    """(z, y, x): some boxes of voxels, of different attenuation, on top of one another."""
    rng, values = np.random.default_rng(seed), np.zeros(grid.shape, np.float32)
    for _ in range(4):
        low, high = np.sort(rng.integers(0, np.array(grid.shape)[:, None] + 1, (3, 2)), axis=1).T
        low = np.minimum(low, np.array(grid.shape) - 4)
        high = np.maximum(high, low + 4)
        values[tuple(map(slice, low, high))] += rng.uniform(0.01, 0.05)
    return values


def box(grid, seed):
    """(z, y, x): one box of voxels, half to nine tenths as wide as the grid."""
    rng, n = np.random.default_rng(seed), np.array(grid.shape)
    size = np.round(rng.uniform(0.5, 0.9, 3) * n).astype(int)
    low = rng.integers(0, n - size + 1)
    values = np.zeros(grid.shape, np.float32)
    values[tuple(map(slice, low, low + size))] = 0.02
    return values


def ellipsoid(grid, seed):
    """(z, y, x): the share of each voxel inside an ellipsoid nearly as wide as the grid, by 3³ points a voxel."""
    radii = np.random.default_rng(seed).uniform(0.6, 0.95, 3)
    axes = [((np.arange(3 * n) + 0.5) / (3 * n) * 2 - 1) / r for n, r in zip(grid.shape, radii, strict=True)]
    z, y, x = np.meshgrid(*axes, indexing="ij", sparse=True)
    inside = (z * z + y * y + x * x < 1).reshape([n for m in grid.shape for n in (m, 3)])
    return (0.02 * inside.mean(axis=(1, 3, 5))).astype(np.float32)


def random_voxels(grid, seed):
    """(z, y, x): uniform in [0, 1)."""
    return np.random.default_rng(seed + 1_000_000).random(grid.shape, np.float32)


def _unit(v):
    return v / np.linalg.norm(v)
