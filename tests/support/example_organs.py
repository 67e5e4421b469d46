"""Synthetic organs for tests: an ellipsoid of tetrahedra with a ball of another region inside."""

import numpy as np

import palpate as pp
from palpate.meshes.tet_mesh import TetMesh, signed_volumes


def ellipsoid(n: int = 9, semi_axes=(40.0, 30.0, 25.0), lump=(0.0, 0.0, 10.0), lump_radius: float = 9.0) -> TetMesh:
    """n³ nodes of a cube, mapped to a ball so that shells stay shells, then stretched; mm."""
    line = np.linspace(-1, 1, n)
    x, y, z = (c.ravel() for c in np.meshgrid(line, line, line, indexing="ij"))
    ball = np.stack(
        [
            x * np.sqrt(1 - y**2 / 2 - z**2 / 2 + y**2 * z**2 / 3),
            y * np.sqrt(1 - z**2 / 2 - x**2 / 2 + z**2 * x**2 / 3),
            z * np.sqrt(1 - x**2 / 2 - y**2 / 2 + x**2 * y**2 / 3),
        ],
        axis=1,
    )
    nodes = ball * semi_axes
    index = np.arange(n**3).reshape(n, n, n)
    corner = [
        index[a : n - 1 + a, b : n - 1 + b, c : n - 1 + c].ravel() for a in (0, 1) for b in (0, 1) for c in (0, 1)
    ]
    around_diagonal = [(0, 1, 3, 7), (0, 1, 7, 5), (0, 5, 7, 4), (0, 3, 2, 7), (0, 6, 4, 7), (0, 2, 6, 7)]
    tets = np.concatenate([np.stack([corner[k] for k in tet], axis=1) for tet in around_diagonal])
    inverted = signed_volumes(nodes, tets) < 0
    tets[inverted] = tets[inverted][:, [0, 1, 3, 2]]
    inside = np.linalg.norm(nodes[tets].mean(axis=1) - np.array(lump), axis=1) < lump_radius
    return TetMesh(nodes, tets, np.where(inside, 2, 1), {1: "organ", 2: "lump"})


def organ(n: int = 9) -> pp.Tissue:
    """The ellipsoid with a stiff lump near its top, lying on a table."""
    mesh = ellipsoid(n)
    return pp.Tissue(mesh, {"organ": 5.0, "lump": 50.0}, 0.45, pp.resting_on(mesh, (0, 0, -1), depth=8.0))
