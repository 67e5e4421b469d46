"""Nodes of the few tets with small angles, moved a little until no angle is small.

Where cells change size under the surface, stuffing leaves a handful of tets below its bound. Each of their nodes looks
around itself for the place that is best for the worst of its tets.
"""

import numpy as np

from palpate.arrays import Float64, Int64
from palpate.meshes.element_quality import smallest_dihedral
from palpate.meshes.tet_mesh import signed_volumes

MOST = 40  # tets: more than these are no accident
STEPS = (0.12, 0.06, 0.03)  # of the mean edge at the node
FURTHEST = 0.25  # of that edge, from where the node was
# Faces, edges and corners of a cube: where a node looks.
AROUND = np.array(
    [[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) != (0, 0, 0)], float
)
AROUND /= np.linalg.norm(AROUND, axis=1)[:, None]


def improve_dihedrals(nodes: Float64, tets: Int64, least: float) -> Float64:
    """Nodes (N, 3) mm so that, if it can be had, no tet (M, 4) has an angle below `least` degrees."""
    angle = smallest_dihedral(nodes, tets)
    bad = np.flatnonzero(angle < least)
    if len(bad) == 0 or len(bad) > MOST:
        return nodes
    x = nodes.copy()
    near = tets[np.isin(tets, tets[bad]).any(axis=1)]
    before = np.inf
    while 0 < len(bad) < before:
        before = len(bad)
        for node in np.unique(tets[bad]):
            _move_node(x, nodes[node], near[(near == node).any(axis=1)], node)
        bad = np.flatnonzero(smallest_dihedral(x, tets) < least)
    return x


def _move_node(x: Float64, home: Float64, star: Int64, node: int) -> None:
    """Moves one node to the best of the positions around it, in shrinking steps."""
    others = np.unique(star)
    size = float(np.linalg.norm(x[others] - x[node], axis=1).sum() / (len(others) - 1))
    index = np.searchsorted(others, star)
    here = int(np.searchsorted(others, node))
    best = _worst(x[others][None], index)[0]
    for step in STEPS:
        places = x[node] + step * size * AROUND
        places = places[np.linalg.norm(places - home, axis=1) <= FURTHEST * size]
        if len(places) == 0:
            continue
        tried = np.repeat(x[others][None], len(places), axis=0)
        tried[:, here] = places
        worth = _worst(tried, index)
        if worth.max() > best:
            best = worth.max()
            x[node] = places[np.argmax(worth)]


def _worst(points: Float64, tets: Int64) -> Float64:
    """(T,) degrees: the smallest angle of `tets` with each of the sets of points (T, K, 3); inverted is below 0."""
    count, size = points.shape[:2]
    flat = points.reshape(-1, 3)
    all_tets = (tets[None] + size * np.arange(count)[:, None, None]).reshape(-1, 4)
    angle = np.where(signed_volumes(flat, all_tets) > 0, smallest_dihedral(flat, all_tets), -1)
    worst: Float64 = angle.reshape(count, -1).min(axis=1)
    return worst
