"""The gaps between organs of one body of tissue, node by node."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array, eye_array, kron
from scipy.spatial import cKDTree

from palpate import _core
from palpate.arrays import Bool, Float64, Int32, Int64
from palpate.meshes.cutting.cut_mesh import CutMesh, touched_surface
from palpate.meshes.separate_organs import organs
from palpate.meshes.tet_mesh import TetMesh
from palpate.tissue.surface_gaps import SurfaceGaps, along

REACH = 5.0  # mm: surfaces further apart at rest do not meet
FACING = 0.3  # least cosine between a surface and the opposite of the other
CORNERS = np.array([(4, 1, 1), (1, 4, 1), (1, 1, 4)]) / 6  # of a triangle: exact for polynomials of degree 2
TOUCHING = 1e-3  # mm: the way from one surface to the other has no direction
LEAST_PART = 0.05  # of a node's part of the surface, over which a gap is a mean


@dataclass(frozen=True, eq=False)
class _Skin:
    """The surface of a mesh. carried: (S, N) the share of each node in the displacement of a vertex."""

    places: Float64
    triangles: Int32
    carried: csr_array
    organ: Int32

    def part(self, organ: int) -> Int32:
        """(T, 3) triangles of an organ."""
        return np.asarray(self.triangles[self.organ[self.triangles[:, 0]] == organ])


def organ_gaps(mesh: TetMesh, reach: float = REACH, slips: bool = False) -> SurfaceGaps:
    """The mean gap over each part of an organ's surface that faces another; slips: and the slips there.

    Of two organs one has the parts: a vertex' part is weighted by its shape function (a mortar method, three points in a
    triangle). The gap at a point is the distance to the other surface; below 0 they overlap. The faces of cuts are not
    looked at.
    """
    organ = organs(mesh)
    if organ.max() == 0:
        return SurfaceGaps.none(len(mesh.nodes))
    skin = _skin(mesh, organ)
    parts: list[SurfaceGaps] = []
    for one in range(int(skin.organ.max()) + 1):
        for other in range(one):
            found = _between(skin, one, other, reach, slips)
            if found is not None:
                parts.append(found)
    return SurfaceGaps.together(parts) if parts else SurfaceGaps.none(len(mesh.nodes))


def deepest_overlap(mesh: TetMesh) -> float:
    """mm: how deep a vertex of an organ's surface lies inside another organ; 0 if none does."""
    skin, deepest = _skin(mesh, organs(mesh)), 0.0
    count = int(skin.organ.max()) + 1
    for one in range(count):
        mine = np.unique(skin.part(one))
        for other in range(count):
            theirs = skin.part(other)
            low, high = skin.places[theirs].min(axis=(0, 1)), skin.places[theirs].max(axis=(0, 1))
            x = skin.places[mine]
            x = x[((x > low) & (x < high)).all(axis=1)]
            if one == other or len(x) == 0:
                continue
            _, _, foot, normal = _feet(skin, theirs, x)
            inside = np.einsum("pc,pc->p", x - foot, normal) < 0
            deepest = max(deepest, float(np.linalg.norm(x - foot, axis=1)[inside].max(initial=0.0)))
    return deepest


def _skin(mesh: TetMesh, organ: Int32) -> _Skin:
    nodes = np.arange(len(mesh.nodes))
    if not isinstance(mesh, CutMesh):
        places, triangles, _ = touched_surface(mesh, np.zeros(len(nodes), dtype=bool))
        one = csr_array((np.ones(len(nodes)), (nodes, nodes)))
        return _Skin(places, triangles, one, organ)
    skin = mesh.skin
    carrier = mesh.tets[skin.tet]
    rows = np.repeat(np.arange(len(carrier)), 4)
    carried = csr_array((skin.weight.ravel(), (rows, carrier.ravel())), shape=(len(carrier), len(nodes)))
    return _Skin(mesh.places, skin.triangles[~skin.lip], carried, organ[carrier[:, 0]])


def _between(skin: _Skin, one: int, other: int, reach: float, slips: bool) -> SurfaceGaps | None:
    """Between two organs; None if they are too far apart."""
    near = [_near(skin, a, b, reach) for a, b in ((one, other), (other, one))]
    if not (near[0].any() and near[1].any()):
        return None
    if near[0].sum() >= near[1].sum():  # the finer surface has the parts
        return _gaps(skin, skin.part(one)[near[0]], skin.part(one), skin.part(other), reach, slips)
    return _gaps(skin, skin.part(other)[near[1]], skin.part(other), skin.part(one), reach, slips)


def _near(skin: _Skin, one: int, other: int, reach: float) -> Bool:
    """Which triangles of an organ have a corner so near to another organ that they may be within reach."""
    mine, theirs = skin.part(one), skin.part(other)
    corners = skin.places[theirs]
    longest = float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max())
    tree = cKDTree(skin.places[np.unique(theirs)])
    distance = np.asarray(tree.query(skin.places[mine], distance_upper_bound=reach + longest)[0])
    return np.asarray(np.isfinite(distance).any(axis=1))


def _gaps(skin: _Skin, near: Int32, mine: Int32, theirs: Int32, reach: float, slips: bool) -> SurfaceGaps | None:
    """Of the triangles `near` of `mine`, whose vertices have the parts."""
    corners = skin.places[near]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    points = np.einsum("qk,tkc->tqc", CORNERS, corners).reshape(-1, 3)
    out = np.repeat(across / np.linalg.norm(across, axis=1, keepdims=True), len(CORNERS), axis=0)
    area = np.repeat(np.linalg.norm(across, axis=1) / 2 / len(CORNERS), len(CORNERS))
    vertex, by = np.repeat(near, len(CORNERS), axis=0), np.tile(CORNERS, (len(near), 1))
    triangle, weights, foot, normal = _feet(skin, theirs, points)
    apart = points - foot
    distance = np.linalg.norm(apart, axis=1)
    facing: Float64 = np.einsum("pc,pc->p", out, normal)
    met = np.flatnonzero(np.logical_and(distance <= reach, facing < -FACING))
    if len(met) == 0:
        return None
    sign = np.where(np.einsum("pc,pc->p", apart, normal) < 0, -1.0, 1.0)
    far = distance > TOUCHING  # along the way between the two, so that the moments of their forces cancel
    normal[far] = (sign[far] / distance[far])[:, None] * apart[far]
    gap = (sign * distance)[met]
    vertex, by, area, normal, weights = vertex[met], by[met], area[met], normal[met], weights[met]
    share = by * area[:, None]  # (p, 3): of each point, in the part of each vertex
    size = np.bincount(vertex.ravel(), share.ravel(), len(skin.places))
    whole = np.bincount(mine.ravel(), np.repeat(_areas(skin, mine) / 3, 3), len(skin.places))
    kept = np.flatnonzero(size > LEAST_PART * whole)
    number = np.full(len(skin.places), -1)
    number[kept] = np.arange(len(kept))
    rest = np.bincount(vertex.ravel(), (share * gap[:, None]).ravel(), len(skin.places))[kept] / size[kept]
    part = number[vertex]  # (p, 3)
    share = np.where(part >= 0, share / size[vertex], 0)
    at, moved = [], []  # of the vertices: by the point, and by its foot on the other surface
    for corner, weight in ((vertex, by), (theirs[triangle[met]], -weights)):
        at.append(np.broadcast_to(corner[:, None], (*part.shape, 3)))
        moved.append(share[:, :, None] * weight[:, None])
    row, column = np.concatenate(at), np.broadcast_to(np.concatenate([part, part])[:, :, None], (2 * len(part), 3, 3))
    value, direction = np.concatenate(moved), np.concatenate([normal, normal])[:, None, None]
    used = column >= 0
    row, column, value = row[used], column[used], value[used]
    rows = (3 * row[:, None] + np.arange(3)).ravel()
    carried = csr_array(kron(skin.carried, eye_array(3)).T)

    def of_nodes(which: Int64, ways: Float64, count: int) -> csr_array:
        entries = ((value[:, None] * ways).ravel(), (rows, np.repeat(which, 3)))
        return csr_array(carried @ csr_array(coo_array(entries, shape=(3 * len(skin.places), count))))

    N = of_nodes(column, np.broadcast_to(direction, (*used.shape, 3))[used], len(kept))
    if not slips:
        return SurfaceGaps(N, rest, csr_array((N.shape[0], 0)))
    mean = np.zeros((len(kept), 3))  # normals of the parts
    np.add.at(mean, part[part >= 0], (share[:, :, None] * normal[:, None])[part >= 0])
    tangent = along(mean)
    one, other = (of_nodes(2 * column + k, tangent[column, k], 2 * len(kept)) for k in (0, 1))
    return SurfaceGaps(N, rest, csr_array(one + other))


def _areas(skin: _Skin, triangles: Int32) -> Float64:
    a, b, c = skin.places[triangles].swapaxes(0, 1)
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)


def _feet(skin: _Skin, triangles: Int32, points: Float64) -> tuple[Int64, Float64, Float64, Float64]:
    """Of (p, 3) points the nearest of the triangles (p,), weights (p, 3) and place (p, 3) there, and its normal (p, 3)."""
    surface = _core.tissue.ContactSurface(
        skin.places, np.ascontiguousarray(triangles), np.zeros(len(skin.places), dtype=np.uint8)
    )
    found = [surface.closest(x) for x in points]
    return (
        np.array([at.triangle for at in found]),
        np.array([at.weights for at in found]),
        np.array([at.point for at in found]),
        np.array([surface.normal(at) for at in found]),
    )
