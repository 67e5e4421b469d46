"""Pieces that the cuts of a session have freed: bodies of their own, as they were in the moment when they came free.

The loop moves them (cpp/simulation/loose_pieces.h); here is what they are: their shape, their weight, and whether they lie.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from palpate import _core
from palpate.arrays import Bool, Float32, Float64, Int32
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.meshes.display_surfaces import DisplayedSurface, displayed_surface
from palpate.meshes.tet_mesh import TetMesh
from palpate.simulation.cut_works import HeldPoints
from palpate.tissue.models.tissue_model import TissueModel
from palpate.tissue.named_tissues import tissue_properties
from palpate.tissue.tissue import Tissue

MOST = 16  # pieces at once, as in the loop; smaller ones are gone at once
GRAVITY = 9.81  # m/s²
FALL = 3.0  # diagonals of the organ, after which a falling piece is gone
RAYS = 64  # downward from a piece, at most
SIDEWAYS = 0.1  # of the organ's diagonal: nearer to its middle, what holds it says no direction
BACK = (0.0, 1.0, 0.0)  # LPS: of a patient who lies on the back


@dataclass(frozen=True, eq=False)
class LoosePiece:
    """A piece that a cut has freed.

    mesh: it alone. moved: (N, 3) mm, how far its nodes were displaced when it came free. weight: N, of the regions whose
    density is known. bedded: whether it lies where it came free when nothing holds it; else it falls.
    """

    mesh: CutMesh
    moved: Float64
    weight: float
    bedded: bool

    @property
    def volume(self) -> float:
        """mm³."""
        return float(self.mesh.volumes.sum())

    @cached_property
    def drawn(self) -> DisplayedSurface:
        """Its surface, at rest in the organ."""
        return displayed_surface(self.mesh)

    @cached_property
    def places(self) -> Float32:
        """(S, 3) mm, the vertices of its surface as it came free."""
        drawn = self.drawn
        at_rest = drawn.places.astype(np.float32)
        return at_rest + drawn.carried(self.moved[drawn.nodes].astype(np.float32))

    def is_part(self, mesh: CutMesh) -> bool:
        """Whether a mesh is that of this piece, to the bit."""
        return np.array_equal(mesh.parent, self.mesh.parent) and np.array_equal(mesh.share, self.mesh.share)


def pieces_after(
    freed: Sequence[CutMesh], present: Sequence[LoosePiece], before: TissueModel, left: Tissue, held: HeldPoints
) -> tuple[LoosePiece, ...]:
    """The pieces beside a body after a cut.

    freed: their meshes, the largest first. present: those before it. before: the model until then, and held: what tools held
    of it. left: the tissue after it.
    """
    u: Float64 | None = None
    found = []
    for mesh in freed[:MOST]:
        same = next((one for one in present if one.is_part(mesh)), None)
        if same:
            found.append(same)
            continue
        earlier = next((one for one in present if is_same(one.mesh, mesh)), None)
        if earlier:  # by a longer blade of the same stroke
            moved = carried_to(mesh, earlier.mesh, earlier.moved)
        else:
            u = displacement(before, held) if u is None else u
            moved = carried_to(mesh, before.tissue.mesh, u)
        found.append(LoosePiece(mesh, moved, weight(left, mesh), bedded(left, mesh)))
    return tuple(found)


def loop_arguments(now: Sequence[LoosePiece], before: Sequence[LoosePiece], whole: Tissue) -> tuple[Any, ...]:
    """What the loop has to know of the pieces beside a body, after those beside the body before."""
    number = [next((i for i, old in enumerate(before) if is_same(old.mesh, one.mesh)), -1) for one in now]
    parts = [(one.drawn.places, one.drawn.triangles) for one in now]
    first = np.cumsum([0, *(len(places) for places, _ in parts)])
    surface = None
    if now:
        places = np.concatenate([places for places, _ in parts])
        triangles = np.concatenate([t + at for (_, t), at in zip(parts, first, strict=False)]).astype(np.int32)
        surface = _core.tissue.ContactSurface(places, triangles, np.zeros(len(places), dtype=np.uint8))
    diagonal = float(np.linalg.norm(np.ptp(whole.mesh.nodes, axis=0)))
    return (
        surface,
        np.repeat(np.arange(len(now), dtype=np.int32), [len(t) for _, t in parts]),
        np.array([one.weight for one in now], dtype=np.float64),
        np.array([one.bedded for one in now], dtype=np.uint8),
        np.array(number, dtype=np.int32),
        tuple(down(whole).tolist()),
        FALL * diagonal,
    )


def is_same(one: CutMesh, other: CutMesh) -> bool:
    """Whether two pieces share more than half of the larger one."""
    size = int(max(one.parent.max(), other.parent.max())) + 1
    parts = [np.bincount(mesh.parent, mesh.volumes, size) for mesh in (one, other)]
    return bool(np.minimum(*parts).sum() > 0.5 * max(part.sum() for part in parts))


def displacement(model: TissueModel, held: HeldPoints) -> Float64:
    """(N, 3) mm of all nodes of a body that is held so."""
    if not len(held.points):
        return np.zeros((len(model.tissue.mesh.nodes), 3))
    return model.push(held.points, held.displacements, np.full(len(held.points), held.radius)).displacement


def carried_to(piece: CutMesh, mesh: TetMesh, values: Float64) -> Float64:
    """(n, 3) at the nodes of a piece, of values (N, 3) at those of the body that it was part of.

    Of the copies of a tetrahedron that earlier cuts have made, that one is meant which shares most real corners.
    """
    if not isinstance(mesh, CutMesh):
        return np.asarray(values[piece.origin])
    order = np.argsort(mesh.parent, kind="stable")
    begin, end = (np.searchsorted(mesh.parent[order], piece.parent, side) for side in ("left", "right"))
    most, best = np.full(len(piece.parent), -1), np.full(len(piece.parent), -1)
    for k in range(int((end - begin).max(initial=0))):
        there = begin + k < end
        copy = order[np.minimum(begin + k, len(order) - 1)]
        alike = (piece.real[piece.tets] & mesh.real[mesh.tets[copy]]).sum(axis=1)
        better = there & (alike > most)
        most[better], best[better] = alike[better], copy[better]
    found = np.zeros((len(piece.nodes), 3))
    known = best >= 0
    found[piece.tets[known]] = values[mesh.tets[best[known]]]
    return found


def weight(tissue: Tissue, piece: CutMesh) -> float:
    """N. Regions of unknown density weigh nothing."""
    total = 0.0
    for region, name in tissue.materials.items():
        density = tissue_properties(name).density
        if density and density.value is not None:
            total += density.value * float(piece.volumes[piece.region == region].sum())
    return 1e-9 * GRAVITY * total


def down(tissue: Tissue) -> Float64:
    """(3,) unit vector in which pieces fall: from the organ's middle to what holds it, since there it lies.

    Where it is held all around, towards the back of a patient who lies on it.
    """
    nodes = tissue.mesh.nodes
    way = nodes[tissue.fixed].mean(axis=0) - nodes.mean(axis=0)
    length = float(np.linalg.norm(way))
    return np.asarray(way / length if length > SIDEWAYS * np.linalg.norm(np.ptp(nodes, axis=0)) / 2 else BACK)


def bedded(left: Tissue, piece: CutMesh) -> bool:
    """Whether the piece has tissue below it: straight down from most of its underside, by area as seen from below."""
    way = down(left)
    places, triangles = piece.boundary
    corners = places[triangles]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ way / 2
    under = np.argsort(-facing, kind="stable")[:RAYS]
    under = under[facing[under] > 0]
    start = corners[under].mean(axis=1) - 1e-3 * left.edge * way  # its cut faces are those of its bed
    met = np.array([meets(point, way, *left.mesh.boundary) for point in start], dtype=bool)
    return bool(facing[under][met].sum() > 0.5 * facing[under].sum())


def meets(point: Float64, way: Float64, places: Float64, triangles: Int32) -> bool:
    """Whether a ray meets a surface (Möller & Trumbore, J. Graphics Tools 2 (1997) 21)."""
    a, b, c = (places[triangles[:, k]] for k in range(3))
    across = np.cross(way, c - a)
    determinant = np.einsum("ij,ij->i", b - a, across)
    flat: Bool = np.abs(determinant) < 1e-12
    scale = 1 / np.where(flat, 1, determinant)
    u = np.einsum("ij,ij->i", point - a, across) * scale
    along = np.cross(point - a, b - a)
    v, t = along @ way * scale, np.einsum("ij,ij->i", c - a, along) * scale
    return bool((~flat & (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0)).any())
