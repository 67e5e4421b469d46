"""The body-centred lattice with small cells where they are wanted: tetrahedra of a balanced octree.

Neighbouring leaves differ by one level at most, so four shapes suffice: the lattice's own tetrahedron, its halves and
quarters at edges and faces that a smaller neighbour splits, and half pyramids on a larger neighbour. No dihedral angle
is below 45 degrees. Source: F. Labelle, J. R. Shewchuk, "Isosurface stuffing", ACM Trans. Graphics 26(3), 57, 2007, §3.
"""

from collections.abc import Callable

import numpy as np

from palpate.arrays import ArrayLike, Bool, Int64
from palpate.meshes.stuffing.bcc_lattice import Lattice

# Called with a level and cells (N, 3) of that level: whether each must be split. Level 0 is the coarsest.
Wanted = Callable[[int, Int64], Bool]
_BITS = 21
_AROUND = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1], [-1, 0, 1], indexing="ij"), axis=-1).reshape(-1, 3)
_EIGHT = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), axis=-1).reshape(-1, 3)
_SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])


def octree(cells: ArrayLike, depth: int, wanted: Wanted) -> Lattice:
    """The lattice of `cells` (x, y, z) cubes, those `wanted` split up to `depth` times; places in finest half cells."""
    n = np.asarray(cells)
    split = _balanced(n, _split(n, depth, wanted))
    leaves = [_without(_children(above), here) for above, here in zip([None, *split], [*split, None], strict=True)]
    leaves[0] = _without(_all(n), split[0] if split else None)
    corners = np.unique(np.concatenate([_key(_corners(leaf, 1 << (depth - k))) for k, leaf in enumerate(leaves)]))
    tets = []
    for k, leaf in enumerate(leaves):
        half = 1 << (depth - k)
        smaller = _key(split[k]) if k < depth else np.zeros(0, dtype=np.int64)
        larger = _key(leaves[k - 1]) if k > 0 else np.zeros(0, dtype=np.int64)
        for axis in range(3):
            step = np.eye(3, dtype=np.int64)[axis]
            pair = leaf[np.isin(_key(leaf + step), _key(leaf))]
            tets.append(_between_equals(pair, axis, half, corners))
            for side in (0, 1):
                beyond = leaf + (2 * side - 1) * step
                tets.append(_on_smaller(leaf[np.isin(_key(beyond), smaller)], axis, side, half))
                tets.append(_on_larger(leaf[np.isin(_key(beyond // 2), larger)], axis, side, half))
    places = np.concatenate(tets)  # (M, 4, 3)
    key, tets_of = np.unique(_key(places), return_inverse=True)
    return Lattice(_place(key), tets_of.reshape(-1, 4))


def _split(n: Int64, depth: int, wanted: Wanted) -> list[Int64]:
    cells, split = _all(n), []
    for level in range(depth):
        split.append(cells[wanted(level, cells)])
        cells = _children(split[-1])
    return split


def _balanced(n: Int64, split: list[Int64]) -> list[Int64]:
    """Splits what touches a split cell and is larger than it, corners included."""
    split = list(split)
    for level in range(len(split) - 1, 0, -1):
        near = (split[level][:, None] + _AROUND).reshape(-1, 3)
        near = near[((near >= 0) & (near < n << level)).all(axis=1)] // 2
        split[level - 1] = _place(np.unique(np.concatenate([_key(split[level - 1]), _key(near)])))
    return split


def _between_equals(pair: Int64, axis: int, half: int, corners: Int64) -> Int64:
    """Tets around the line between the centres of two leaves of one size; halved where a smaller leaf splits an edge."""
    square = _square(pair, axis, 1, half)
    low = (2 * pair + 1) * half
    high = low + 2 * half * np.eye(3, dtype=np.int64)[axis]
    made = []
    for j in range(4):
        a, b = square[:, j], square[:, (j + 1) % 4]
        middle = (a + b) // 2
        halved = np.isin(_key(middle), corners)
        whole = ~halved
        made.append(np.stack([a, b, low, high], axis=1)[whole])
        made.append(np.stack([a, middle, low, high], axis=1)[halved])
        made.append(np.stack([middle, b, low, high], axis=1)[halved])
    return np.concatenate(made)


def _on_smaller(leaf: Int64, axis: int, side: int, half: int) -> Int64:
    """The eight quarters between a leaf's centre and a face behind which four smaller leaves lie."""
    square = _square(leaf, axis, side, half)
    centre, face = (2 * leaf + 1) * half, square.sum(axis=1) // 4
    made = []
    for j in range(4):
        a, b = square[:, j], square[:, (j + 1) % 4]
        made += [np.stack([centre, face, end, (a + b) // 2], axis=1) for end in (a, b)]
    return np.concatenate(made)


def _on_larger(leaf: Int64, axis: int, side: int, half: int) -> Int64:
    """The pyramid on a quarter of a larger leaf's face, halved along the diagonal that meets the face's centre."""
    square = _square(leaf, axis, side, half)
    centre = (2 * leaf + 1) * half
    j, k = (axis + 1) % 3, (axis + 2) % 3
    # The quarter's corner at the face's centre is the one away from the parent's own corner.
    a, b = 1 - leaf[:, j] % 2, 1 - leaf[:, k] % 2
    first = np.argmax((np.stack([a, b], axis=1)[:, None] == _SQUARE).all(axis=2), axis=1)
    row = np.arange(len(leaf))
    ends = square[row, first], square[row, (first + 2) % 4]
    return np.concatenate([np.stack([centre, *ends, square[row, (first + i) % 4]], axis=1) for i in (1, 3)])


def _square(leaf: Int64, axis: int, side: int, half: int) -> Int64:
    """(N, 4, 3) the corners of a face of each leaf, in order round it."""
    offset = np.zeros((4, 3), dtype=np.int64)
    offset[:, axis] = side
    offset[:, [(axis + 1) % 3, (axis + 2) % 3]] = _SQUARE
    corners: Int64 = 2 * half * (leaf[:, None] + offset)
    return corners


def _all(n: Int64) -> Int64:
    return np.argwhere(np.ones(n, dtype=bool)).astype(np.int64)


def _children(cells: Int64 | None) -> Int64:
    return np.zeros((0, 3), np.int64) if cells is None else (2 * cells[:, None] + _EIGHT).reshape(-1, 3)


def _corners(leaf: Int64, half: int) -> Int64:
    corners: Int64 = (2 * half * (leaf[:, None] + _EIGHT)).reshape(-1, 3)
    return corners


def _without(cells: Int64, others: Int64 | None) -> Int64:
    return cells if others is None else cells[~np.isin(_key(cells), _key(others))]


def _key(place: Int64) -> Int64:
    """One number for three, in the same order; from -1 on, so that a neighbour outside the box is just not found."""
    p = place + 1
    key: Int64 = (p[..., 0] << 2 * _BITS) | (p[..., 1] << _BITS) | p[..., 2]
    return key


def _place(key: Int64) -> Int64:
    mask = (1 << _BITS) - 1
    return np.stack([key >> 2 * _BITS, (key >> _BITS) & mask, key & mask], axis=-1) - 1
