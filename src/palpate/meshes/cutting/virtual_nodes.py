"""Virtual nodes: copies of the tetrahedra that a blade has passed, one for each part into which it has cut them."""

from dataclasses import dataclass

import numpy as np

from palpate import _core
from palpate.arrays import Bool, Float64, Int32, Int64
from palpate.meshes.tet_mesh import TetMesh, row_keys, shared_faces, signed_volumes
from palpate.meshes.triangle_surface import connected_groups

LEAST_SHARE = 1e-6  # of a tetrahedron's volume: what is smaller belongs to another part of the same tetrahedron


@dataclass(frozen=True, eq=False)
class Pieces:
    """How the parts of a slit complex hang together.

    corners: (n, 4) points of the complex. parent: (n,) tetrahedra of the mesh. volume: (n,) mm³. bond: (b, 2) parts that
    share a face which no blade has passed. lips: (c, 2) those whose common face one has passed, first the one to which the
    blade's normal points, and faces: (c, 3) that face. fragment: (n,) parts of one parent that hang together within it
    have one number. body: (n,) whatever hangs together has one number.
    """

    corners: Int64
    parent: Int64
    volume: Float64
    bond: Int64
    lips: Int64
    faces: Int64
    fragment: Int64
    body: Int64


@dataclass(frozen=True, eq=False)
class VirtualNodes:
    """A mesh with copies. origin: (N',) the node and parent: (M',) the tetrahedron of the mesh that each is a copy of.

    tets: (M', 4). share: (M',) of the tetrahedron's volume, those of all copies sum to 1. side: (M',) 1, -1 or 0. body:
    (M',) number of the piece that it belongs to. element: (fragments,) copy that carries each fragment.
    """

    origin: Int32
    tets: Int32
    parent: Int32
    share: Float64
    side: Int32
    body: Int32
    element: Int64


def pieces(slit: "_core.cutting.SlitComplex") -> Pieces:
    """The parts of a slit complex, and how they hang together. A crumb that holds on to nothing is stuck on again."""
    corners, parent, places = slit.corners.astype(np.int64), slit.parent.astype(np.int64), slit.places
    volume = signed_volumes(places, corners)
    pair, face = shared_faces(corners)
    passed, normal = _passed(face, slit)
    while True:
        bond = pair[~passed]
        within = bond[parent[bond[:, 0]] == parent[bond[:, 1]]]
        fragment, body = (connected_groups(len(corners), pairs)[1] for pairs in (within, bond))
        crumb = _share(fragment, parent, volume)[fragment] < LEAST_SHARE
        loose = np.bincount(body, ~crumb) == 0
        stuck = passed & loose[body[pair]].any(axis=1)
        if not stuck.any():
            break
        passed &= ~stuck
    lips, edge = pair[passed], face[passed]
    inner = places[corners[lips[:, 0]]].mean(axis=1) - places[edge[:, 0]]
    turned = (inner * normal[passed]).sum(axis=1) < 0
    lips[turned] = lips[turned][:, ::-1]
    return Pieces(corners, parent, volume, bond, lips, edge, fragment, body)


def virtual_nodes(mesh: TetMesh, found: Pieces) -> VirtualNodes:
    """Return the copies that the fragments of a slit mesh need.

    Each fragment is a copy of its tetrahedron. Copies of neighbours share the nodes of their common face where material
    goes through it, so that nodes are split by side behind the blade, and whole at its tip.

    Parameters
    ----------
    mesh : TetMesh
        The mesh before the cut.
    found : Pieces
        Its parts.

    Returns
    -------
    VirtualNodes
        The copies. The first N nodes are the mesh's own, the copies with the most volume.

    References
    ----------
    Molino, Bao & Fedkiw, ACM Trans. Graph. 23 (2004) 385. Sifakis, Der & Fedkiw, SCA 2007, 73.
    """
    tets = mesh.tets.astype(np.int64)
    first = np.unique(found.fragment, return_index=True)[1]
    owner, body = found.parent[first], found.body[first]  # of each fragment
    share = _share(found.fragment, found.parent, found.volume)
    node = _slots(tets, owner, found)
    key = np.column_stack([owner, node])
    copy = np.unique(row_keys(key), return_inverse=True)[1].ravel()  # fragments with the same nodes are one element
    count = int(copy.max()) + 1
    part = np.asarray(np.bincount(copy, share, count), dtype=np.float64)
    one = np.unique(copy, return_index=True)[1]
    copy_owner, copy_node = owner[one], node[one]
    side = _side(found, copy[found.fragment], count)
    largest = _largest(copy_owner, part, len(tets))
    kept = (part >= LEAST_SHARE) | (largest[copy_owner] == np.arange(count))
    np.add.at(part, largest[copy_owner[~kept]], part[~kept])
    number = np.cumsum(kept) - 1
    element = np.where(kept[copy], number[copy], -1)
    new, origin = _renumbered(copy_node[kept], tets[copy_owner[kept]], part[kept] * mesh.volumes[copy_owner[kept]])
    return VirtualNodes(
        origin.astype(np.int32),
        new.astype(np.int32),
        copy_owner[kept].astype(np.int32),
        part[kept],
        side[kept].astype(np.int32),
        np.unique(body[one][kept], return_inverse=True)[1].ravel().astype(np.int32),
        _hosts(element, found),
    )


def _passed(face: Int64, slit: "_core.cutting.SlitComplex") -> tuple[Bool, Float64]:
    """(f,) whether a blade has passed each face, and (f, 3) its normal there."""
    cut = slit.passed.astype(np.int64)
    passed, normal = np.zeros(len(face), dtype=bool), np.zeros((len(face), 3))
    if len(cut):
        key = row_keys(np.concatenate([face, cut]))
        mine, theirs = key[: len(face)], key[len(face) :]
        order = np.argsort(theirs)
        at = np.minimum(np.searchsorted(theirs[order], mine), len(cut) - 1)
        passed = theirs[order][at] == mine
        normal[passed] = slit.normals[order[at[passed]]]
    return passed, normal


def _share(fragment: Int64, parent: Int64, volume: Float64) -> Float64:
    """(fragments,) part of its tetrahedron's volume."""
    owner = parent[np.unique(fragment, return_index=True)[1]]
    own = np.bincount(fragment, volume)
    return np.asarray(own / np.bincount(owner, own)[owner])


def _slots(tets: Int64, owner: Int64, found: Pieces) -> Int64:
    """(fragments, 4) corners of all fragments' copies; equal numbers are one node."""
    across = found.bond[found.parent[found.bond[:, 0]] != found.parent[found.bond[:, 1]]]
    f, g = np.unique(found.fragment[across], axis=0).T
    row, a, b = np.nonzero(tets[owner[f]][:, :, None] == tets[owner[g]][:, None, :])
    same = np.stack([4 * f[row] + a, 4 * g[row] + b], axis=1)
    return connected_groups(4 * len(owner), same)[1].reshape(-1, 4)


def _side(found: Pieces, copy: Int64, count: int) -> Int64:
    """(copies,) 1 on the side to which the normals of most of its cut faces point, -1 on the other, 0 if it has none."""
    ones = np.ones(len(found.lips))
    above, below = (np.bincount(copy[found.lips[:, k]], ones, count) for k in (0, 1))
    return np.asarray(np.sign(above - below), dtype=np.int64)


def _largest(owner: Int64, part: Float64, count: int) -> Int64:
    """(count,) the copy of each tetrahedron with the largest part."""
    order = np.lexsort((part, owner))
    last = np.zeros(count, dtype=np.int64)
    last[owner[order]] = order
    return last


def _renumbered(node: Int64, original: Int64, volume: Float64) -> tuple[Int64, Int64]:
    """(M', 4) new numbers for `node`, and (N',) the node of the mesh that each is a copy of."""
    used, at = np.unique(node, return_inverse=True)
    at = at.reshape(node.shape)
    origin = np.zeros(len(used), dtype=np.int64)
    origin[at] = original
    weight = np.bincount(at.ravel(), np.repeat(volume, 4))
    order = np.lexsort((-weight, origin))
    leading = np.ones(len(order), dtype=bool)
    leading[1:] = origin[order][1:] != origin[order][:-1]
    ranked = np.concatenate([order[leading], order[~leading]])
    number = np.empty(len(used), dtype=np.int64)
    number[ranked] = np.arange(len(used))
    return number[at], origin[ranked]


def _hosts(element: Int64, found: Pieces) -> Int64:
    """(fragments,) element of each; one too small to have its own gets a neighbour's."""
    host = element.copy()
    f, g = found.fragment[found.bond].T
    while (host < 0).any():
        before = np.count_nonzero(host < 0)
        for a, b in ((f, g), (g, f)):
            new = (host[a] < 0) & (host[b] >= 0)
            host[a[new]] = host[b[new]]
        if np.count_nonzero(host < 0) == before:
            raise AssertionError("a fragment hangs on no element")
    return host
