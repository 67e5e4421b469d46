"""The area of cuts, by region."""

import numpy as np
from scipy.spatial import cKDTree

from palpate.arrays import Float64, Int32, Int64

NEAREST = 32  # tetrahedra around a point: their copies count too


def cut_areas(nodes: Float64, tets: Int32, region: Int32, lips: Float64) -> dict[int, float]:
    """mm², of each cut one lip. nodes: (N, 3) mm, tets: (M, 4) of a cut mesh, region: (M,). lips: (T, 3, 3) mm, of both."""
    a, b, c = lips.swapaxes(0, 1)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 4  # a half of the triangle, of which each lip has one
    if (region == region[0]).all():  # then one need not look where the lips are
        return {int(region[0]): float(area.sum())}
    label = region[_tets_at(nodes[tets], lips.mean(axis=1))]
    return {int(r): float(area[label == r].sum()) for r in np.unique(label)}


def _tets_at(corners: Float64, points: Float64) -> Int64:
    """(P,) the tetrahedron in which each point lies, of those (M, 4, 3) whose centroids are nearest."""
    near = np.asarray(cKDTree(corners.mean(axis=1)).query(points, k=min(NEAREST, len(corners)))[1])  # (P, k)
    edges = np.swapaxes(corners[near][:, :, 1:] - corners[near][:, :, :1], 2, 3)
    share = np.linalg.solve(edges, (points[:, None] - corners[near][:, :, 0])[..., None])[..., 0]
    least = np.minimum(share.min(axis=2), 1 - share.sum(axis=2))
    return np.asarray(near[np.arange(len(points)), least.argmax(axis=1)])
