"""How large the cells of the lattice are where: small at some inclusions, growing away from them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from palpate.arrays import Bool, Float64, Int64
from palpate.meshes.lattice import Lattice
from palpate.meshes.octree import octree
from palpate.meshes.solids import Solid

# Cells of one size reach this many sides beyond an inclusion, so that its surface meets whole tets of one size only.
REACH = 1.5
MOST_HALVINGS = 5


@dataclass(frozen=True, eq=False)
class Grading:
    """scale: side of the coarsest cell over what the edge alone would make it; halvings: (bodies,) of it at each body.

    The sizes of an octree are powers of two, so those asked for share the rounding evenly.
    """

    scale: float
    halvings: tuple[int, ...]
    near: tuple[cKDTree, ...]

    @property
    def depth(self) -> int:
        """Halvings at the body with the smallest cells."""
        return max(self.halvings)

    def lattice(self, origin: Float64, cells: ArrayLike, side: float) -> Lattice:
        """The lattice of `cells` (x, y, z) cubes of `side` mm from `origin` (3,) mm on."""

        def wanted(level: int, places: Int64) -> Bool:
            here = side / 2**level
            middle = origin + (places + 0.5) * here
            split = np.zeros(len(places), dtype=bool)
            reach = (np.sqrt(3) / 2 + REACH / 2) * here
            for halvings, tree in zip(self.halvings, self.near, strict=True):
                if level < halvings:
                    split |= np.isfinite(tree.query(middle, distance_upper_bound=reach)[0])
            return split

        return octree(cells, self.depth, wanted)

    def tets(self, bodies: Sequence[Solid], side: float) -> float:
        """About how many tets cells of `side` mm make of the first body with the others in it: 12 a cell."""
        total = bodies[0].volume / side**3
        for body, halvings in zip(bodies, self.halvings, strict=True):
            radius = (3 * body.volume / (4 * np.pi)) ** (1 / 3)
            for level in range(1, halvings + 1):
                here = side / 2**level
                reached = min(4 / 3 * np.pi * (radius + 2.5 * here) ** 3, bodies[0].volume)
                total += 7 / 8 * reached / here**3
        return float(12 * total)


def grading(bodies: Sequence[Solid], edges: Sequence[float]) -> Grading | None:
    """The grading that comes nearest to the `edges` (bodies,) mm asked for; None if all are the same."""
    asked = np.log2(edges[0] / np.array(edges, dtype=np.float64))
    if not (asked > 0).any():
        return None
    shifts = np.linspace(-0.5, 0.5, 201)
    off = np.abs(shifts[:, None] + asked - np.round(shifts[:, None] + asked)).max(axis=1)
    shift = float(shifts[np.argmin(np.maximum(off, np.abs(shifts)))])
    halvings = np.maximum(np.round(asked + shift), 0).astype(int)
    trees = [cKDTree(_voxels(body) if n else np.zeros((0, 3))) for body, n in zip(bodies, halvings, strict=True)]
    return Grading(2**shift, tuple(int(n) for n in halvings), tuple(trees))


def _voxels(body: Solid) -> Float64:
    """(N, 3) mm, x, y, z: the voxels of the body."""
    points: Float64 = np.argwhere(body.mask)[:, ::-1] * np.array(body.grid.spacing)[::-1]
    return points
