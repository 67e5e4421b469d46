"""The part of a mesh that blades may split: the rest of a large mesh need not be looked at for a small cut."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate import _core
from palpate.arrays import Bool, Float64, Int64
from palpate.meshes.cutting.blade import Blade
from palpate.meshes.cutting.skin import Skin
from palpate.meshes.cutting.virtual_nodes import VirtualNodes
from palpate.meshes.tet_mesh import TetMesh, row_keys
from palpate.meshes.triangle_surface import connected_groups


@dataclass(frozen=True, eq=False)
class CutZone:
    """All tetrahedra about the nodes of those that blades may split, as a mesh.

    whole: the mesh that is cut. tets: (z,) and nodes: (n,) their numbers in it, ascending. part: their mesh. rim: (k, 3)
    sorted nodes of its faces beyond which the whole goes on. still: (n,) True for nodes whose tetrahedra all stay whole.
    """

    whole: TetMesh
    tets: Int64
    nodes: Int64
    part: TetMesh
    rim: Int64
    still: Bool


def cut_zone(mesh: TetMesh, blades: Sequence[Blade], near: float) -> CutZone:
    """The zone of some blades. near: mm; a tetrahedron that is so near to a blade is met by it."""
    met = np.zeros(len(mesh.tets), dtype=bool)
    for blade in blades:
        met |= _core.cutting.meets(blade.points, blade.triangles, mesh.nodes, mesh.tets, near) > 0
    met[0] |= not met.any()  # a zone has a tetrahedron, if nothing is met
    passed = np.zeros(len(mesh.nodes), dtype=bool)
    passed[mesh.tets[met]] = True
    split = np.asarray(passed[mesh.tets].sum(axis=1) >= 2)  # an edge that is split splits all tetrahedra about it
    moved = np.zeros(len(mesh.nodes), dtype=bool)
    moved[mesh.tets[split]] = True
    inside = np.asarray(moved[mesh.tets].any(axis=1))
    tets = np.flatnonzero(inside)
    nodes = np.unique(mesh.tets[tets]).astype(np.int64)
    part = TetMesh(mesh.nodes[nodes], np.searchsorted(nodes, mesh.tets[tets]), mesh.region[tets])
    pairs, faces = mesh.shared_faces
    goes_on = np.asarray(inside[pairs].sum(axis=1) == 1)
    return CutZone(mesh, tets, nodes, part, np.searchsorted(nodes, faces[goes_on]), ~moved[nodes])


def whole_nodes(zone: CutZone, made: VirtualNodes) -> tuple[VirtualNodes, Int64]:
    """The copies of the whole mesh, from those of its zone, and (copies of the zone,) their numbers there."""
    mesh, own = zone.whole, len(zone.nodes)
    outside = np.ones(len(mesh.tets), dtype=bool)
    outside[zone.tets] = False
    rest = np.flatnonzero(outside)
    late = made.origin[own:]  # the first nodes are the zone's own
    twice = ~zone.still[late]  # where none is split, what hangs together beyond the zone is one node
    number = np.concatenate([zone.nodes, np.where(twice, len(mesh.nodes) + np.cumsum(twice) - 1, zone.nodes[late])])
    parent = np.concatenate([zone.tets[made.parent], rest])
    order = np.argsort(parent, kind="stable")
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    copies, others = place[: len(made.parent)], place[len(made.parent) :]

    at = np.empty(len(mesh.tets), dtype=np.int64)  # a copy of each tetrahedron, the only one where none is split
    at[zone.tets[made.parent]], at[rest] = copies, others
    pairs = mesh.shared_faces[0]
    by_body = np.argsort(made.body, kind="stable")
    same = made.body[by_body][1:] == made.body[by_body][:-1]
    chain = np.stack([copies[by_body[:-1][same]], copies[by_body[1:][same]]], axis=1)
    body = connected_groups(len(order), np.concatenate([at[pairs[outside[pairs].any(axis=1)]], chain]))[1]

    whole = VirtualNodes(
        np.concatenate([np.arange(len(mesh.nodes)), zone.nodes[late[twice]]]).astype(np.int32),
        np.concatenate([number[made.tets], mesh.tets[rest]])[order].astype(np.int32),
        parent[order].astype(np.int32),
        np.concatenate([made.share, np.ones(len(rest))])[order],
        np.concatenate([made.side, np.zeros(len(rest))])[order].astype(np.int32),
        body.astype(np.int32),
        copies[made.element],
    )
    return whole, copies


def whole_skin(zone: CutZone, made: VirtualNodes, drawn: Skin, whole: VirtualNodes, copies: Int64) -> Skin:
    """The surface of the whole mesh, from that of its zone.

    made, drawn: of the zone. whole, copies: what `whole_nodes` gave. A vertex at a node whose tetrahedra all stay whole is
    the node's, so that the surfaces fit.
    """
    mesh = zone.whole
    one = drawn.weight == 1
    local = made.origin[made.tets[drawn.tet, one.argmax(axis=1)]]
    of_node = one.any(axis=1) & zone.still[local]
    vertex = np.where(of_node, zone.nodes[local], len(mesh.nodes) + np.arange(len(local)))
    around = zone.nodes[zone.part.surface]
    key = row_keys(np.sort(np.concatenate([mesh.surface, around]), axis=1))
    rest = mesh.surface[~np.isin(key[: len(mesh.surface)], key[len(mesh.surface) :])]
    triangles = np.concatenate([rest, vertex[drawn.triangles]])
    used, numbered = np.unique(triangles, return_inverse=True)
    still = used[used < len(mesh.nodes)]
    host = np.empty(len(whole.origin), dtype=np.int64)
    host[whole.tets] = np.arange(len(whole.tets))[:, None]
    mine = used[len(still) :] - len(mesh.nodes)
    tet = np.concatenate([host[still], copies[drawn.tet[mine]]])
    weight: Float64 = np.concatenate([(whole.tets[host[still]] == still[:, None]).astype(float), drawn.weight[mine]])
    return Skin(
        numbered.reshape(-1, 3).astype(np.int32),
        np.concatenate([np.zeros(len(rest), dtype=bool), drawn.lip]),
        tet.astype(np.int32),
        weight,
    )
