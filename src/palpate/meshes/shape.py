"""How well a tetrahedron is shaped."""

import numpy as np

from palpate.arrays import Float64, Int32, Int64
from palpate.meshes.lattice import EDGES


def smallest_dihedral(points: Float64, tets: Int32 | Int64) -> Float64:
    """(M,) smallest of the six angles between faces of each tet, degrees, whatever its orientation."""
    smallest: Float64 = dihedrals(points, tets).min(axis=1)
    return smallest


def dihedrals(points: Float64, tets: Int32 | Int64) -> Float64:
    """(M, 6) angles between faces at the edges 01, 02, 03, 12, 13, 23 of each tet, degrees."""
    x = points[tets]
    angles = []
    for i, j in EDGES:
        k, m = (n for n in range(4) if n not in (i, j))
        e = x[:, j] - x[:, i]
        u, v = np.cross(e, x[:, k] - x[:, i]), np.cross(e, x[:, m] - x[:, i])
        angles.append(np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), np.einsum("ij,ij->i", u, v)))
    answer: Float64 = np.degrees(np.stack(angles, axis=1))
    return answer


def radius_ratios(points: Float64, tets: Int32 | Int64) -> Float64:
    """(M,) three times the inscribed over the circumscribed radius: 1 for the regular tet, 0 for a flat one."""
    a, b, c, d = (points[tets[:, i]] for i in range(4))
    u, v, w = b - a, c - a, d - a
    six_volumes = np.abs(np.einsum("ij,ij->i", np.cross(u, v), w))
    area = sum(np.linalg.norm(np.cross(p, q), axis=1) for p, q in ((u, v), (v, w), (w, u), (v - u, w - u))) / 2
    squares = [np.einsum("ij,ij->i", p, p)[:, None] for p in (u, v, w)]
    around = squares[0] * np.cross(v, w) + squares[1] * np.cross(w, u) + squares[2] * np.cross(u, v)
    # inscribed = 3 V / area, circumscribed = |around| / (12 V)
    ratio: Float64 = 3 * (six_volumes / 2 / area) * (2 * six_volumes) / np.linalg.norm(around, axis=1)
    return ratio
