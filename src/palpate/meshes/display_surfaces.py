"""The surfaces that a display draws: the mesh's own, those of the regions inside, and the lips of cuts."""

from dataclasses import dataclass, replace

import numpy as np

from palpate import _core
from palpate.arrays import Float32, Float64, Int32, Int64
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.meshes.separate_organs import main_regions, organs
from palpate.meshes.tet_mesh import TetMesh, region_faces


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles first to first + count of a `DisplayedSurface` or a scene: the organ, or a region inside it."""

    name: str
    first: int
    count: int
    inside: bool


@dataclass(frozen=True, eq=False)
class DisplayedSurface:
    """What a display draws of a mesh.

    nodes: (n,) nodes of the mesh that move it, sorted. places: (S, 3) mm, its vertices at rest. triangles: (T, 3) vertices,
    normals outwards. lips: numbers of the first vertex on the lips of cuts, in the largest region and in each of the others
    by label; lips have vertices of their own so that their rim is sharp. S where there are none. carrier, weight: (S, 4)
    which of `nodes` move each vertex, and how much; None where the vertices are the nodes. gape: (S, 3) mm, how far the
    vertices have gone from their places before anything touches them, since a tension has opened the cuts; None: not at all.
    beside: names of the organs, where several lie beside each other, and organ: (S,) to which of them each vertex belongs.
    """

    nodes: Int32
    places: Float64
    triangles: Int32
    parts: tuple[Part, ...]
    lips: tuple[int, ...]
    carrier: Int64 | None = None
    weight: Float32 | None = None
    gape: Float32 | None = None
    beside: tuple[str, ...] = ()
    organ: Int32 | None = None

    def carried(self, values: Float32) -> Float32:
        """(S, 3) at the vertices, of values (n, 3) at the nodes."""
        if self.carrier is None or self.weight is None:
            return values
        return np.asarray(np.einsum("sa,sak->sk", self.weight, values[self.carrier]), dtype=np.float32)


def displayed_surface(mesh: TetMesh, regions: bool = True) -> DisplayedSurface:
    """Return what a display draws of a mesh; regions: also those inside, but not of a mesh that was cut."""
    if isinstance(mesh, CutMesh):
        return _of_cut(mesh, displayed_nodes(mesh))
    nodes = displayed_nodes(mesh) if regions else mesh.surface_nodes
    drawn = [("organ", mesh.surface, False)]
    inside = inner_faces(mesh) if regions else {}
    drawn += [(mesh.names.get(k, f"region {k}"), faces, True) for k, faces in inside.items()]
    first = np.concatenate([[0], np.cumsum([len(faces) for _, faces, _ in drawn])])
    parts = tuple(Part(name, int(first[i]), len(faces), inside) for i, (name, faces, inside) in enumerate(drawn))
    triangles = np.searchsorted(nodes, np.concatenate([faces for _, faces, _ in drawn])).astype(np.int32)
    drawn_of = DisplayedSurface(nodes, mesh.nodes[nodes], triangles, parts, (len(nodes),))
    return _with_organs(drawn_of, mesh, organs(mesh)[nodes])


def _with_organs(drawn: DisplayedSurface, mesh: TetMesh, organ: Int32) -> DisplayedSurface:
    """With the names of organs beside each other, and which of them each vertex (S,) belongs to."""
    main = main_regions(mesh)
    if len(main) < 2:
        return drawn
    return replace(drawn, beside=tuple(mesh.names.get(label, f"region {label}") for label in main), organ=organ)


def _of_cut(mesh: CutMesh, nodes: Int32) -> DisplayedSurface:
    skin = mesh.skin
    labels = mesh.figures.regions
    rank = np.array([labels.index(region) for region in mesh.region[skin.tet].tolist()], dtype=np.int32)
    vertex, triangles, lips = _core.cutting.drawn(skin.triangles, skin.lip.view(np.uint8), rank, len(labels))
    drawn = DisplayedSurface(
        nodes,
        mesh.places[vertex],
        triangles,
        (Part("organ", 0, len(triangles), False),),
        tuple(lips.tolist()),
        np.minimum(np.searchsorted(nodes, mesh.tets[skin.tet[vertex]]), len(nodes) - 1),  # of weight 0 where not there
        skin.weight[vertex].astype(np.float32),
    )
    return _with_organs(drawn, mesh, organs(mesh)[mesh.tets[skin.tet[vertex], 0]])


def displayed_nodes(mesh: TetMesh) -> Int32:
    """Sorted nodes that move what a display draws: on the surface, or between two regions."""
    if isinstance(mesh, CutMesh):
        return mesh.surface_nodes
    nodes = [mesh.surface.ravel(), *(faces.ravel() for faces in inner_faces(mesh).values())]
    return np.unique(np.concatenate(nodes)).astype(np.int32)


def inner_faces(mesh: TetMesh) -> dict[int, Int32]:
    """Triangles around each region inside an organ, by label: all but the largest of each organ."""
    main = main_regions(mesh)
    return {label: faces for label, faces in region_faces(mesh).items() if label not in main}
