"""The parts that a file of surfaces has: which of them together are one solid, and the names of solids."""

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from palpate.arrays import AnyArray, Int64
from palpate.meshes.tet_mesh import row_keys
from palpate.meshes.triangle_surface import connected_groups

LONGEST = 100  # characters of a name, which messages repeat


class Part(NamedTuple):
    """What a file says of some of its triangles: which object they belong to, its name, and their own."""

    home: int
    home_name: str
    name: str


class StoredSurface(NamedTuple):
    """Points (N, 3), triangles (F, 3), the number (F,) of each triangle's part, and the parts."""

    points: AnyArray
    triangles: Int64
    part: Int64
    parts: list[Part]


def fans(corners: Int64, lengths: Int64) -> tuple[Int64, Int64]:
    """Triangles (F, 3) of polygons, and the polygon (F,) of each: a fan around its first corner.

    corners: those of all polygons, one after another. lengths (P,): how many each has.
    """
    start = np.cumsum(lengths) - lengths
    count = np.maximum(lengths - 2, 0)
    polygon = np.repeat(np.arange(len(lengths)), count)
    step = np.arange(len(polygon)) - np.repeat(np.cumsum(count) - count, count) + 1
    first = start[polygon]
    triangles = np.stack([corners[first], corners[first + step], corners[first + step + 1]], axis=1)
    return triangles.astype(np.int64), polygon


def joined_parts(triangles: Int64, part: Int64) -> dict[int, list[int]]:
    """Solid to its parts, in their order: parts that meet at an open edge are pieces of one surface."""
    numbers, index = np.unique(part, return_inverse=True)
    if len(numbers) == 1:
        return {0: numbers.tolist()}
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    rows = np.column_stack([edges, np.repeat(index.ravel(), 3)]).astype(np.int64)
    _, first, times = np.unique(row_keys(rows), return_index=True, return_counts=True)
    rim = rows[first[times % 2 == 1]]  # in the order of edges
    same = (rim[1:, :2] == rim[:-1, :2]).all(axis=1)
    _, solid = connected_groups(len(numbers), np.column_stack([rim[:-1, 2][same], rim[1:, 2][same]]))
    members: dict[int, list[int]] = {}
    for one, number in zip(solid.tolist(), numbers.tolist(), strict=True):
        members.setdefault(one, []).append(number)
    return members


def solid_names(solids: Sequence[Sequence[int]], parts: Sequence[Part], otherwise: str) -> list[str]:
    """A name for each solid, all different: that of its object, if this has no other solid, or of its first part."""
    each = Counter(home for members in solids for home in {parts[n].home for n in members})
    names = []
    for members in solids:
        first = parts[members[0]]
        names.append(first.home_name if each[first.home] == 1 and first.home_name else first.name or first.home_name)
    return different_names([_plain(name) for name in names], otherwise)


def different_names(names: Sequence[str], otherwise: str) -> list[str]:
    """Names without repetitions; one that is missing or taken gets the next free number."""
    made: list[str] = []
    for number, name in enumerate(names, 1):
        free = name or f"{otherwise} {number}"
        while free in made:
            free, number = f"{name or otherwise} {number}", number + 1
        made.append(free)
    return made


def _plain(name: str) -> str:
    """A name in one line, without what a terminal or a file of XML does not take."""
    return "".join(c for c in " ".join(name.split()) if c.isprintable())[:LONGEST].strip()
