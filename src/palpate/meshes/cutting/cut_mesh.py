"""The mesh of a cut body."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from palpate import _core
from palpate.arrays import Bool, Float64, Int32
from palpate.errors import MeshError
from palpate.meshes.cutting.blade import Blade
from palpate.meshes.cutting.skin import Skin
from palpate.meshes.tet_mesh import TetMesh, regions_by_size, signed_volumes
from palpate.volumes.centerline import Centerline


@dataclass(frozen=True)
class CutFigures:
    """What cuts have done, by labels of regions: the area of all cuts, one lip of each, mm²; and of the pieces that came
    free and were taken away the volumes, mm³. regions: labels of the mesh before, the largest first.
    """

    areas: dict[int, float]
    taken: dict[int, float]
    regions: tuple[int, ...]


@dataclass(frozen=True, eq=False, init=False)
class CutMesh(TetMesh):
    """A mesh that blades have cut: each tetrahedron that one has passed is there once for each part it was cut into.

    A copy keeps the shape of its tetrahedron and counts with its part of the volume, `share`. `volumes` are those of the
    parts. The first nodes are those of the mesh before, the others virtual ones: copies of nodes, at the same places.

    share: (M,) 0 to 1. side: (M,) 1 or -1, the side of the blade; 0 where none has passed. body: (M,) number of the piece.
    origin: (N,) and parent: (M,) node and tetrahedron of the mesh before. real: (N,) True where a node's place is in its
    piece, and not beyond the blade. skin: the surface. blades: what cut it. figures: what the cuts have done. If a piece was
    taken away, some nodes and tetrahedra of the mesh before have no copy.
    """

    share: Float64
    side: Int32
    body: Int32
    origin: Int32
    real: Bool
    parent: Int32
    skin: Skin
    blades: tuple[Blade, ...]
    figures: CutFigures

    def __init__(
        self,
        nodes: Float64,
        tets: Int32,
        region: Int32,
        names: dict[int, str],
        *,
        share: Float64,
        side: Int32,
        body: Int32,
        origin: Int32,
        real: Bool,
        parent: Int32,
        skin: Skin,
        blades: Sequence[Blade],
        figures: CutFigures,
        centerline: Centerline | None = None,
    ) -> None:
        super().__init__(nodes, tets, region, names, centerline)
        per_node = (("origin", origin), ("real", real))
        for name, value in (("share", share), ("side", side), ("body", body), ("parent", parent), *per_node):
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        object.__setattr__(self, "skin", skin)
        object.__setattr__(self, "blades", tuple(blades))
        object.__setattr__(self, "figures", figures)

    @cached_property
    def surface(self) -> Int32:
        """No triangles between nodes bound a cut body: raises `MeshError`."""
        raise MeshError("a cut mesh: its surface goes through its tetrahedra, so that this cannot be done with it")

    @cached_property
    def surface_nodes(self) -> Int32:
        """Sorted indices of the nodes that move the surface."""
        return np.unique(self.tets[self.skin.tet][self.skin.weight != 0]).astype(np.int32)

    @property
    def filled(self) -> Float64 | float:
        """Part of each tetrahedron's volume that is there, (M,)."""
        return self.share

    @cached_property
    def volumes(self) -> Float64:
        """Volume of each tetrahedron's part, (M,), mm³."""
        return self.share * signed_volumes(self.nodes, self.tets)

    @cached_property
    def places(self) -> Float64:
        """Positions of the vertices of the surface, (S, 3), mm."""
        return self.skin.carried(self.tets, self.nodes)

    @property
    def boundary(self) -> tuple[Float64, Int32]:
        """Vertices (S, 3), mm, and triangles (F, 3) of the surface."""
        return self.places, self.skin.triangles

    def text(self) -> str:
        """What was cut, in words."""
        pieces, copies = int(self.body.max()) + 1, len(self.nodes) - len(np.unique(self.origin))
        said = f"cuts of {sum(self.figures.areas.values()) / 100:.3g} cm², {copies} copies of nodes, "
        said += f"{pieces} piece{'s' * (pieces > 1)} of {self.volumes.sum() / 1000:.4g} ml"
        taken = sum(self.figures.taken.values())
        return said + f"; {taken / 1000:.3g} ml taken away" * (taken > 0)

    @cached_property
    def uncut(self) -> TetMesh:
        """The mesh before. Raises `MeshError` if a piece of it has been taken away."""
        whole = np.bincount(self.parent, self.share)
        if (np.abs(whole - 1) > 1e-9).any():
            raise MeshError("a piece of this cut mesh has been taken away; make all its cuts at once")
        count, first = int(self.origin.max()) + 1, np.unique(self.parent, return_index=True)[1]
        return TetMesh(
            self.nodes[:count], self.origin[self.tets[first]], self.region[first], self.names, self.centerline
        )


def cut_mesh(mesh: TetMesh, blades: Sequence[Blade]) -> CutMesh:
    """Cut a mesh, or cut a cut mesh again.

    Parameters
    ----------
    mesh : TetMesh
        The body.
    blades : sequence of Blade
        What passes through it.

    Returns
    -------
    CutMesh
        The cut body, its loose pieces included.

    Raises
    ------
    MeshError
        If a piece of a cut mesh has been taken away.
    """
    return cut_held_mesh(mesh, blades, np.empty(0, dtype=bool))[0]


def cut_held_mesh(mesh: TetMesh, blades: Sequence[Blade], held: Bool) -> tuple[CutMesh, Bool]:
    """Cut a mesh that is held, blade after blade.

    Parameters
    ----------
    mesh, blades
        As `cut_mesh` takes them.
    held : ndarray, (N,)
        Which nodes of the mesh before all cuts are held. A piece that a blade frees, of which no three nodes are held that
        are not on one line, is gone then: later blades meet nothing there.

    Returns
    -------
    CutMesh
        The cut body, its loose pieces included.
    ndarray, (M,)
        Which of its tetrahedra belong to a piece that is gone.

    Raises
    ------
    MeshError
        If a piece of a cut mesh has been taken away.
    """
    every = (*mesh.blades, *blades) if isinstance(mesh, CutMesh) else tuple(blades)
    mesh = mesh.uncut if isinstance(mesh, CutMesh) else mesh
    sizes = np.array([len(blade.triangles) for blade in every], dtype=np.int32)
    offset = np.cumsum([0, *(len(blade.points) for blade in every)], dtype=np.int32)
    points = np.concatenate([np.empty((0, 3)), *(blade.points for blade in every)])
    numbered = (blade.triangles + first for blade, first in zip(every, offset, strict=False))
    triangles = np.concatenate([np.empty((0, 3), np.int32), *numbered])
    made = _core.cutting.cut(mesh.nodes, mesh.tets, held.astype(np.uint8), points, triangles, sizes)
    tets, origin, parent, share, side, body, triangles, lip, tet, weight, real, gone, cut_parent, cut_area = made
    areas = np.bincount(mesh.region[cut_parent], cut_area)
    figures = CutFigures({k: float(v) for k, v in enumerate(areas) if v > 0}, {}, tuple(regions_by_size(mesh)))
    cut = CutMesh(
        mesh.nodes[origin],
        tets,
        mesh.region[parent],
        mesh.names,
        share=share,
        side=side,
        body=body,
        origin=origin,
        real=real,
        parent=parent,
        skin=Skin(triangles, lip, tet, weight),
        blades=every,
        figures=figures,
        centerline=mesh.centerline,
    )
    return cut, gone


def touched_surface(mesh: TetMesh, held: Bool) -> tuple[Float64, Int32, Bool]:
    """Vertices (S, 3) mm and triangles of a mesh's surface, and which vertices are held, for held nodes (N,)."""
    places, triangles = mesh.boundary
    if not isinstance(mesh, CutMesh):
        return places, triangles, held
    free = (mesh.skin.weight != 0) & ~held[mesh.tets[mesh.skin.tet]]
    return places, triangles, ~free.any(axis=1)


def refuse_cut(mesh: TetMesh, what: str, instead: str = "take the model `compliance`, `multigrid` or `blocks`") -> None:
    """Raises `MeshError` for a cut mesh."""
    if isinstance(mesh, CutMesh):
        raise MeshError(f"{what}: takes no tissue that has been cut; {instead}")


def without(mesh: CutMesh, gone: Bool) -> CutMesh:
    """A cut mesh without tetrahedra (M,), which are whole pieces that have come free."""
    taken = np.bincount(mesh.region[gone], mesh.volumes[gone])
    figures = replace(mesh.figures, taken={region: float(v) for region, v in enumerate(taken) if v > 0})
    return part_of(mesh, ~gone, figures)


def pieces_of(mesh: CutMesh, gone: Bool) -> tuple[CutMesh, ...]:
    """The pieces that tetrahedra (M,) make, each a mesh, the largest first."""
    volume = np.bincount(mesh.body[gone], mesh.volumes[gone])
    order = np.argsort(-volume, kind="stable")[: np.count_nonzero(volume)]
    return tuple(part_of(mesh, gone & (mesh.body == body), mesh.figures) for body in order)


def part_of(mesh: CutMesh, kept: Bool, figures: CutFigures) -> CutMesh:
    """Those tetrahedra (M,) of a cut mesh, which are whole pieces."""
    nodes = np.zeros(len(mesh.nodes), dtype=bool)
    nodes[mesh.tets[kept]] = True
    at, tet = np.cumsum(nodes) - 1, np.cumsum(kept) - 1
    drawn = kept[mesh.skin.tet]
    vertex = np.cumsum(drawn) - 1
    triangle = drawn[mesh.skin.triangles[:, 0]]
    return CutMesh(
        mesh.nodes[nodes],
        at[mesh.tets[kept]].astype(np.int32),
        mesh.region[kept],
        mesh.names,
        share=mesh.share[kept],
        side=mesh.side[kept],
        body=mesh.body[kept],
        origin=mesh.origin[nodes],
        real=mesh.real[nodes],
        parent=mesh.parent[kept],
        skin=Skin(
            vertex[mesh.skin.triangles[triangle]].astype(np.int32),
            mesh.skin.lip[triangle],
            tet[mesh.skin.tet[drawn]].astype(np.int32),
            mesh.skin.weight[drawn],
        ),
        blades=mesh.blades,
        figures=figures,
        centerline=mesh.centerline,
    )
