"""Solids for the tests of tissue: a brick of tetrahedra, six a cell."""

import itertools

import numpy as np

import palpate as pp


def brick(cells=(4, 4, 4), size=(50.0, 50.0, 50.0), warp=0.0, region=None):
    """A box from the origin, `cells` a side; warp moves inner nodes by that share of a cell, at random but fixed."""
    counts = np.array(cells) + 1
    x = np.stack(np.meshgrid(*[np.arange(n) for n in counts], indexing="ij"), axis=-1).reshape(-1, 3).astype(float)
    inner = ((x > 0) & (x < counts - 1)).all(axis=1)
    x[inner] += warp * np.random.default_rng(7).uniform(-1, 1, (inner.sum(), 3))
    nodes = x / np.array(cells) * np.array(size)
    corner = np.stack(np.meshgrid(*[np.arange(n) for n in cells], indexing="ij"), axis=-1).reshape(-1, 3)

    def number(ijk):
        return (ijk[:, 0] * counts[1] + ijk[:, 1]) * counts[2] + ijk[:, 2]

    tets = []
    for path in itertools.permutations(range(3)):  # Kuhn: the six ways from a cell's low corner to its high one
        walk = [np.zeros(3, int)]
        for axis in path:
            walk.append(walk[-1] + np.eye(3, dtype=int)[axis])
        tet = np.stack([number(corner + step) for step in walk], axis=1)
        odd = np.linalg.det(np.eye(3)[list(path)]) < 0
        tets.append(tet[:, [0, 2, 1, 3]] if odd else tet)
    tets = np.concatenate(tets)
    if region is not None:
        region = region(nodes[tets].mean(axis=1))
    return pp.TetMesh(nodes, tets, region=region)


def block(n=11, young=5.0, poisson=0.3, **options):
    """The 50 mm cube of n³ nodes, held at its bottom (z = 0)."""
    mesh = brick((n - 1,) * 3)
    return pp.Tissue(mesh, young, poisson, mesh.nodes[:, 2] == 0, **options)


def dome(cells, depth, half, bend, sign):
    """A block whose top is a paraboloid of radius `bend` mm, with smaller elements at its apex, (0, 0, 0)."""
    k = 5.0  # the ends' elements over those at the apex: cosh k
    x = brick((cells, cells, depth), (1, 1, 1)).nodes
    across = half * np.sinh(k * (2 * x[:, :2] - 1)) / np.sinh(k)
    below = half * np.sinh(k * (1 - x[:, 2])) / np.sinh(k)
    z = -below - np.minimum((across**2).sum(axis=1), half**2 / 4) / (2 * bend) * (1 - below / half)
    nodes = np.column_stack([across[:, 0], sign * across[:, 1], sign * z])
    return nodes, brick((cells, cells, depth), (1, 1, 1)).tets
