"""The body-centred cubic lattice of tetrahedra, and how its nodes snap to surfaces that pass close by.

Source: F. Labelle, J. R. Shewchuk, "Isosurface stuffing", ACM Transactions on Graphics 26(3), 57, 2007.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.arrays import ArrayLike, Float64, Int64

# A node closer to a cut than this part of the edge moves onto it (Labelle & Shewchuk 2007, table 1): long, short edges.
SNAP_LONG, SNAP_SHORT = 0.24999, 0.41189
SNAP_DIAGONAL = 0.35  # edges that only occur where cells change size
EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])

Field = Callable[[Float64], Float64]  # points (N, 3) mm -> (N,), positive inside


@dataclass(frozen=True, eq=False)
class Lattice:
    """place: (N, 3) whole numbers in half cells, all even or all odd; tets: (M, 4), the first two nodes on one axis."""

    place: Int64
    tets: Int64


def lattice(cells: ArrayLike) -> Lattice:
    """The tetrahedra of `cells` (x, y, z) cubes: 4 around each inner axis edge between corners (12 a cube)."""
    n = np.asarray(cells)
    corner = _counted(n + 1, 0)
    centre = _counted(n, len(corner.ravel()))
    place = np.concatenate([2 * np.argwhere(corner >= 0), 2 * np.argwhere(centre >= 0) + 1])
    tets = []
    for axis in range(3):
        j, k = (axis + 1) % 3, (axis + 2) % 3
        low = np.moveaxis(corner, (axis, j, k), (0, 1, 2))[:-1, 1:-1, 1:-1]
        high = np.moveaxis(corner, (axis, j, k), (0, 1, 2))[1:, 1:-1, 1:-1]
        c = np.moveaxis(centre, (axis, j, k), (0, 1, 2))
        ring = [c[:, 1:, 1:], c[:, :-1, 1:], c[:, :-1, :-1], c[:, 1:, :-1]]
        for here in range(4):
            tets.append(np.stack([low, high, ring[here], ring[(here + 1) % 4]], axis=-1).reshape(-1, 4))
    return Lattice(place, np.concatenate(tets))


def _counted(shape: Int64, first: int) -> Int64:
    return first + np.arange(int(np.prod(shape)), dtype=np.int64).reshape(shape)


@dataclass(frozen=True, eq=False)
class Snapped:
    """The lattice after nodes moved onto surfaces.

    points: (N, 3) mm. sign: (surfaces, N) -1 outside, 0 on, 1 inside. cuts: (C, 2) edges, lower node first, that a
    surface still crosses; surface: (C,) which one; cut_points: (C, 3) mm where.
    """

    points: Float64
    sign: Int64
    cuts: Int64
    surface: Int64
    cut_points: Float64


def edges_of(tets: Int64) -> Int64:
    """(E, 2) the edges of `tets`, each once, lower node first."""
    pairs = np.sort(tets[:, EDGES].reshape(-1, 2), axis=1)
    base = np.int64(pairs.max() + 1)
    key = np.unique(pairs[:, 0] * base + pairs[:, 1])
    return np.stack([key // base, key % base], axis=1)


def slant(place: Int64, edges: Int64) -> Int64:
    """(E,) along how many axes an edge runs: 1 for the long ones, 3 for those √3/2 as long, 2 where cells change size."""
    axes: Int64 = (place[edges[:, 0]] != place[edges[:, 1]]).sum(axis=1)
    return axes


def _cell(place: Int64, edges: Int64) -> Int64:
    """(E,) side of the cell to which an edge of the lattice would belong by its length, in half cells."""
    step = np.abs(place[edges[:, 0]] - place[edges[:, 1]]).max(axis=1)
    side: Int64 = np.where(slant(place, edges) == 1, step, 2 * step)
    return side


def _smallest_cell(place: Int64, edges: Int64) -> Int64:
    """(N,) that of the smallest edge at each node: a node moves no further than its smallest neighbours bear."""
    smallest = np.full(len(place), np.iinfo(np.int64).max)
    np.minimum.at(smallest, edges.ravel(), np.repeat(_cell(place, edges), 2))
    return smallest


def snap(place: Int64, points: Float64, tets: Int64, fields: Sequence[Field]) -> Snapped:
    """Finds where each field changes sign along the edges of `tets`, and moves nodes that lie too close onto it."""
    sign = np.stack([np.where(field(points) > 0, 1, -1) for field in fields])
    edges = edges_of(tets)
    cuts, surface, where = [], [], []
    for s, field in enumerate(fields):
        crossed = edges[sign[s, edges[:, 0]] != sign[s, edges[:, 1]]]
        cuts.append(crossed)
        surface.append(np.full(len(crossed), s))
        where.append(_root(field, points[crossed[:, 0]], points[crossed[:, 1]]))
    cut, on, t = np.concatenate(cuts), np.concatenate(surface), np.concatenate(where)
    crossing = points[cut[:, 0]] + t[:, None] * (points[cut[:, 1]] - points[cut[:, 0]])
    # In which part of its own threshold a cut lies from either end: below 1 is too close.
    threshold = np.array([0, SNAP_LONG, SNAP_DIAGONAL, SNAP_SHORT])[slant(place, cut)]
    allowed = threshold[:, None] * _smallest_cell(place, edges)[cut] / _cell(place, cut)[:, None]
    closeness = np.stack([t, 1 - t], axis=1) / allowed
    moved = points.copy()
    taken = np.zeros(len(points), dtype=bool)
    while True:
        alive = (sign[on, cut[:, 0]] != 0) & (sign[on, cut[:, 1]] != 0)
        node, via = _winners(cut, np.where(alive[:, None] & ~taken[cut], closeness, np.inf))
        if len(node) == 0:
            return Snapped(moved, sign, cut[alive], on[alive], crossing[alive])
        moved[node] = crossing[via]
        sign[on[via], node] = 0
        taken[node] = True


def _winners(cut: Int64, closeness: Float64) -> tuple[Int64, Int64]:
    """Nodes that snap in this round, and the cut that each snaps to: the closest of those that share a cut edge.

    One at a time would do as well, but a snapped node takes the cuts of its edges away, so that neighbours must wait.
    """
    row, end = np.nonzero(closeness < 1)
    if len(row) == 0:
        return row, row
    node, ratio = cut[row, end], closeness[row, end]
    order = np.lexsort((node, ratio))
    rank = np.empty(len(row), dtype=np.int64)
    rank[order] = np.arange(len(row))
    best = np.full(cut.max() + 1, len(row), dtype=np.int64)
    np.minimum.at(best, node, rank)
    rival = np.full_like(best, len(row))
    live = np.isfinite(closeness).any(axis=1)
    np.minimum.at(rival, cut[live, 0], best[cut[live, 1]])
    np.minimum.at(rival, cut[live, 1], best[cut[live, 0]])
    wins = (best[node] == rank) & (best[node] < rival[node])
    return node[wins], row[wins]


def _root(field: Field, start: Float64, stop: Float64) -> Float64:
    """(E,) part of the way from start to stop where the field changes sign, by bisection (to 1e-5 of the way)."""
    low, high = np.zeros(len(start)), np.ones(len(start))
    if len(start) == 0:
        return low
    inside = field(start) > 0
    for _ in range(17):
        middle = (low + high) / 2
        before = (field(start + middle[:, None] * (stop - start)) > 0) == inside
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    return (low + high) / 2
