"""The sizing field: edge lengths on the surface, at the inclusions and between them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from palpate.arrays import ArrayLike, Bool, Float64, Int64, float64
from palpate.errors import MeshError
from palpate.meshes.stuffing.bcc_lattice import Lattice
from palpate.meshes.stuffing.graded_bcc_lattice import octree
from palpate.meshes.stuffing.nested_solids import Solid

CELL = 1.1  # side of a lattice cube in units of `edge`: makes `edge` the mean edge of the mesh
MOST_TETS = 5_000_000
# Cells of one size reach this many sides beyond an inclusion, so that its surface meets whole tets of one size only.
REACH = 1.5
SHORT_REACH = 0.5  # at an organ's skin and thin places: few tets are worth a small angle that is lifted
MOST_HALVINGS = 5


@dataclass(frozen=True, eq=False)
class Grading:
    """scale: side of the coarsest cell over what the edge alone would make it; halvings: (bodies,) of it at each body.

    near, reach: points in them, and how far beyond, in sides.

    The sizes of an octree are powers of two, so those asked for share the rounding evenly.
    """

    scale: float
    halvings: tuple[int, ...]
    near: tuple[cKDTree, ...]
    reach: tuple[float, ...]

    @classmethod
    def even(cls, bodies: int) -> "Grading":
        """Cells of one size."""
        return cls(1.0, (0,) * bodies, (cKDTree(np.zeros((0, 3))),) * bodies, (REACH,) * bodies)

    def finer(self, points: Float64, halvings: int) -> "Grading":
        """The same, and so many more halvings near points (N, 3) mm than at the surface."""
        return Grading(
            self.scale,
            (*self.halvings, self.halvings[0] + halvings),
            (*self.near, cKDTree(points)),
            (*self.reach, SHORT_REACH),
        )

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
            for halvings, tree, beyond in zip(self.halvings, self.near, self.reach, strict=True):
                if level < halvings:
                    reach = (np.sqrt(3) / 2 + beyond / 2) * here
                    split |= np.isfinite(tree.query(middle, distance_upper_bound=reach)[0])
            return split

        return octree(cells, self.depth, wanted)

    def tets(self, bodies: Sequence[Solid], side: float) -> float:
        """About how many tets cells of `side` mm make of the first body with the others in it: 12 a cell."""
        total = bodies[0].volume / side**3
        for number, (body, halvings) in enumerate(zip(bodies, self.halvings, strict=False)):
            radius = (3 * body.volume / (4 * np.pi)) ** (1 / 3)
            for level in range(1, halvings + 1):
                here = side / 2**level
                reached = min(4 / 3 * np.pi * (radius + 4 * here) ** 3, bodies[0].volume)
                if number == 0:  # at its surface alone
                    reached -= 4 / 3 * np.pi * max(radius - 2 * here, 0) ** 3
                total += 7 / 8 * reached / here**3
        return float(12 * total)


def edges_at(bodies: Sequence[Solid], edge: float, fine: Mapping[int, float]) -> list[float]:
    """The edge length at each body, mm."""
    names = {body.value: body.name for body in bodies[1:]}
    for value, length in fine.items():
        if value not in names:
            raise MeshError(f"fine: label {value} is not among the inclusions {sorted(names)}; name it there too")
        if not (np.isfinite(length) and 0 < length <= edge):
            raise MeshError(
                f"fine: expected an edge for {names[value]!r} above 0 and up to the organ's {edge:g} mm, got {length!r}"
            )
        if length < edge / 2**MOST_HALVINGS:
            raise MeshError(
                f"fine: {length:g} mm for {names[value]!r} is less than 1/{2**MOST_HALVINGS} of the organ's {edge:g} mm; "
                f"use {edge / 2**MOST_HALVINGS:.2g} mm or more, or a shorter edge"
            )
    return [edge, *(fine.get(body.value, edge) for body in bodies[1:])]


def check_interior(edge: float, interior: float | None) -> None:
    """Raises `MeshError` for an inner edge length that is invalid, or shorter than that of the surface."""
    if interior is not None and not (np.isfinite(interior) and edge <= interior <= edge * 2**MOST_HALVINGS):
        raise MeshError(
            f"interior: expected an edge from that of the surface, {edge:g} mm, to {2**MOST_HALVINGS} times as much, "
            f"got {interior!r}"
        )


def check_edge(body: Solid, edge: float) -> None:
    """Raises `MeshError` for an edge length that makes too many tets, or exceeds the body's thickness."""
    tets = 12 * body.volume / (CELL * edge) ** 3
    if tets > MOST_TETS:
        enough = (12 * body.volume / MOST_TETS) ** (1 / 3) / CELL
        raise MeshError(
            f"edge {edge:g} mm makes about {tets / 1e6:.3g} million tets of {body.name!r} ({body.volume:.3g} mm³), "
            f"at most {MOST_TETS // 1_000_000} million are allowed; use an edge of {enough:.2g} mm or more"
        )
    thickest = body.thickness(edge / 8)
    if edge > thickest:
        raise MeshError(
            f"edge {edge:g} mm is longer than {body.name!r} is thick ({thickest:.3g} mm at its thickest); "
            f"use an edge of {thickest / 3:.2g} mm or less"
        )


def grading(
    bodies: Sequence[Solid],
    edges: Sequence[float],
    interior: float | None = None,
    finer_at: Mapping[float, Float64] | None = None,
) -> Grading | None:
    """The grading nearest to the `edges` (bodies,) mm asked for, that of the first body at its surface alone.

    interior: mm, the edge deep inside the first body. finer_at: shorter edges, mm, and points (P, 3) mm near which they
    are wanted. None if all are the same; refuses too many tets.
    """
    coarse = edges[0] if interior is None else interior
    places = finer_at or {}
    asked = np.log2(coarse / np.array([*edges, *places], dtype=np.float64))
    if not (asked > 0).any():
        return None
    shifts = np.linspace(-0.5, 0.5, 201)
    off = np.abs(shifts[:, None] + asked - np.round(shifts[:, None] + asked)).max(axis=1)
    shift = float(shifts[np.argmin(np.maximum(off, np.abs(shifts)))])
    halvings = np.maximum(np.round(asked + shift), 0).astype(int)
    masks = [_surface_voxels(bodies[0]), *(body.mask for body in bodies[1:])]
    spacing = np.array(bodies[0].grid.spacing)[::-1]
    trees = [cKDTree(np.argwhere(mask & (n > 0))[:, ::-1] * spacing) for mask, n in zip(masks, halvings, strict=False)]
    trees += [cKDTree(points) for points in places.values()]
    reach = (SHORT_REACH, *(REACH,) * (len(bodies) - 1), *(SHORT_REACH,) * len(places))
    sizes = Grading(2**shift * coarse / edges[0], tuple(int(n) for n in halvings), tuple(trees), reach)
    _check_fine(bodies, edges, sizes)
    _check_places(places)
    return sizes


def _check_fine(bodies: Sequence[Solid], edges: Sequence[float], sizes: Grading) -> None:
    tets = sizes.tets(bodies, CELL * edges[0] * sizes.scale)
    if tets > MOST_TETS:
        finest = int(np.argmin(edges))
        raise MeshError(
            f"fine: {edges[finest]:g} mm at {bodies[finest].name!r} ({bodies[finest].volume:.3g} mm³) makes about "
            f"{tets / 1e6:.3g} million tets, at most {MOST_TETS // 1_000_000} million are allowed; use "
            f"{edges[finest] * (tets / MOST_TETS) ** (1 / 3):.2g} mm or more"
        )


def _check_places(places: Mapping[float, Float64]) -> None:
    """Raises `MeshError` if the cells that hold the points alone make too many tets."""
    for length, points in places.items():
        tets = 12 * len(np.unique(np.floor(points / (CELL * length)), axis=0))
        if tets > MOST_TETS:
            raise MeshError(
                f"finer_at: {length:g} mm makes at least {tets / 1e6:.3g} million tets, at most {MOST_TETS // 1_000_000} "
                f"million are allowed; use {length * (tets / MOST_TETS) ** (1 / 3):.2g} mm or more, or fewer points"
            )


def checked_places(edge: float, finer_at: Mapping[float, ArrayLike]) -> dict[float, Float64]:
    """Arrays of the points by length. Raises `MeshError` for lengths, `DataError` for points that cannot be."""
    for length in finer_at:
        if not (np.isfinite(length) and edge / 2**MOST_HALVINGS <= length <= edge):
            raise MeshError(
                f"finer_at: expected an edge from 1/{2**MOST_HALVINGS} of the organ's {edge:g} mm up to it, got {length!r}"
            )
    return {float(length): float64("finer_at", points, (None, 3)) for length, points in finer_at.items()}


def _surface_voxels(body: Solid) -> Bool:
    """(z, y, x) voxels of the body that have a neighbour outside."""
    inner = ndimage.binary_erosion(np.pad(body.mask, 1))[1:-1, 1:-1, 1:-1]
    skin: Bool = body.mask & ~inner
    return skin
