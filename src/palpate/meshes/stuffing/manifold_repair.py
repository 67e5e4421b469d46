"""Removes tetrahedra that touch at a single node or edge, so that each surface is a manifold."""

import numpy as np

from palpate.arrays import Bool, Float64, Int64
from palpate.meshes.tet_mesh import boundary_faces, shared_faces
from palpate.meshes.triangle_surface import connected_groups, non_manifold_parts


def remove_pinches(tets: Int64, volume: Float64) -> Bool:
    """(M,) which tets to keep so that the skin of those kept is a 2-manifold: the smaller side of each pinch goes.

    Where the solid is whole around the pinched node and two hollows meet there, the tets around it go.
    """
    keep = np.ones(len(tets), dtype=bool)
    while keep.any():
        surface = boundary_faces(tets[keep].astype(np.int32))
        edges, nodes = non_manifold_parts(surface)
        loose = np.setdiff1d(nodes, edges)
        if len(edges) == 0 and len(loose) == 0:
            break
        near = np.flatnonzero(keep & np.isin(tets, np.union1d(edges, loose)).any(axis=1))
        for item in [*edges, *loose[:, None]]:
            holds = np.all([(tets[near] == n).any(axis=1) for n in item], axis=0)
            around = near[holds & keep[near]]
            if len(around):
                keep[around[_smaller(tets[around], volume[around], item)]] = False
    return keep


def _smaller(tets: Int64, volume: Float64, item: Int64) -> Bool:
    """Of the tets around a node or edge, those not in the largest fan linked by faces around it; all if one fan."""
    pairs = shared_faces(tets)[0]
    if len(pairs):
        shared = tets[pairs[:, 0]][:, :, None] == tets[pairs[:, 1]][:, None, :]
        common = shared.any(axis=2)
        holds = [(common & (tets[pairs[:, 0]] == n)).any(axis=1) for n in item]
        pairs = pairs[np.all(holds, axis=0)]
    count, fan = connected_groups(len(tets), pairs)
    if count == 1:
        return np.ones(len(tets), dtype=bool)
    largest = int(np.argmax(np.bincount(fan, weights=volume)))
    smaller: Bool = fan != largest
    return smaller
