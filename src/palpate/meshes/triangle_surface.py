"""Triangle surfaces: topology and distances."""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from palpate.arrays import Float64, Int32, Int64


def connected_groups(count: int, pairs: Int64) -> tuple[int, Int64]:
    """Number of groups and the group of each of `count` items, of which `pairs` (P, 2) belong together."""
    graph = coo_matrix((np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    groups, group = connected_components(graph, directed=False)
    return int(groups), group.astype(np.int64)


def _sorted_edges(surface: Int32) -> tuple[Int64, Int64, Int64, Int64]:
    """Edges (3F, 2) in order, the triangle of each, the index of the first of each kind, how many of each kind."""
    edge = np.sort(surface[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1).astype(np.int64)
    triangle = np.repeat(np.arange(len(surface)), 3)
    order = np.argsort(edge[:, 0] * (int(edge.max(initial=0)) + 1) + edge[:, 1], kind="stable")
    edge, triangle = edge[order], triangle[order]
    first = np.flatnonzero(np.r_[True, (edge[1:] != edge[:-1]).any(axis=1)])
    return edge, triangle, first, np.diff(np.r_[first, len(edge)])


def non_manifold_parts(surface: Int32) -> tuple[Int64, Int64]:
    """Edges (E, 2) that are not shared by two triangles, and nodes (V,) where several fans of triangles meet.

    Both are empty for a closed 2-manifold.
    """
    edge, triangle, first, count = _sorted_edges(surface)
    pair = first[count == 2]
    # A corner is a triangle at one of its nodes; corners of two triangles that share an edge belong to one fan.
    links = []
    for end in (0, 1):
        node = edge[pair, end]
        links.append(np.stack([_corner(surface, triangle[pair + i], node) for i in (0, 1)], axis=1))
    _, fan = connected_groups(3 * len(surface), np.concatenate(links))
    base = int(fan.max(initial=0)) + 1
    node_fan = np.unique(surface.ravel().astype(np.int64) * base + fan)
    node, fans = np.unique(node_fan // base, return_counts=True)
    return edge[first[count != 2]], node[fans > 1]


def _corner(surface: Int32, triangle: Int64, node: Int64) -> Int64:
    corner: Int64 = 3 * triangle + np.argmax(surface[triangle] == node[:, None], axis=1)
    return corner


def shells_and_genus(surface: Int32) -> tuple[int, int]:
    """Number of closed surfaces, and their total genus, by Euler's V - E + F = 2 - 2g."""
    _, triangle, first, count = _sorted_edges(surface)
    pair = first[count == 2]
    shells, _ = connected_groups(len(surface), np.stack([triangle[pair], triangle[pair + 1]], axis=1))
    euler = len(np.unique(surface)) - len(first) + len(surface)
    return shells, (2 * shells - euler) // 2


def distance_to_surface(points: Float64, nodes: Float64, triangles: Int32 | Int64, candidates: int = 12) -> Float64:
    """(N,) mm from points (N, 3) to the nearest of the `candidates` triangles whose centres are nearest.

    Exact where triangles are of similar size, which those of a mesh or of marching cubes are.
    """
    corners = nodes[triangles]
    candidates = min(candidates, len(triangles))
    _, near = cKDTree(corners.mean(axis=1)).query(points, k=candidates)
    near = np.asarray(near).reshape(len(points), candidates)
    best = np.full(len(points), np.inf)
    for i in range(candidates):
        np.minimum(best, _to_triangle(points, *np.moveaxis(corners[near[:, i]], 1, 0)), out=best)
    return best


def _to_triangle(p: Float64, a: Float64, b: Float64, c: Float64) -> Float64:
    """(N,) distance of each point to its own triangle: to the plane if it falls inside, else to the nearest side."""
    n = np.cross(b - a, c - a)
    area = np.einsum("ij,ij->i", n, n)
    inside = np.ones(len(p), dtype=bool)
    best = np.full(len(p), np.inf)
    for u, v in ((a, b), (b, c), (c, a)):
        side = v - u
        inside &= np.einsum("ij,ij->i", np.cross(side, p - u), n) >= 0
        along = np.einsum("ij,ij->i", p - u, side) / np.maximum(np.einsum("ij,ij->i", side, side), 1e-300)
        nearest = u + np.clip(along, 0, 1)[:, None] * side
        best = np.minimum(best, np.linalg.norm(p - nearest, axis=1))
    plane = np.abs(np.einsum("ij,ij->i", p - a, n)) / np.sqrt(np.maximum(area, 1e-300))
    distance: Float64 = np.where(inside & (area > 0), plane, best)
    return distance
