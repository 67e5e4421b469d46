"""The surface of a cut body: the organ's own and the lips of the cut, embedded in its tetrahedra."""

from dataclasses import dataclass

import numpy as np

from palpate import _core
from palpate.arrays import Bool, Float64, Int32, Int64
from palpate.meshes.cutting.virtual_nodes import Pieces, VirtualNodes
from palpate.meshes.tet_mesh import FACES, TetMesh, row_keys
from palpate.meshes.triangle_surface import connected_groups


@dataclass(frozen=True, eq=False)
class Skin:
    """A closed surface whose vertices move with tetrahedra.

    triangles: (T, 3) vertices, normals outwards. lip: (T,) True on a face that a blade has made. tet: (S,) the
    tetrahedron that moves each vertex, and weight: (S, 4) how much each of its corners counts.
    """

    triangles: Int32
    lip: Bool
    tet: Int32
    weight: Float64

    def carried(self, tets: Int32, values: Float64) -> Float64:
        """(S, k) at the vertices, of nodal values (N, k)."""
        return np.asarray(np.einsum("sa,sak->sk", self.weight, values[tets[self.tet]]))


def skin(mesh: TetMesh, slit: "_core.cutting.SlitComplex", found: Pieces, made: VirtualNodes, rim: Int64) -> Skin:
    """Return the surface of a slit mesh.

    A point of the complex is one vertex for all parts that hang together there, so the lips of a cut have vertices of
    their own, but for those at the blade's tip, where they meet.

    Parameters
    ----------
    mesh : TetMesh
        The mesh before the cut.
    slit : SlitComplex
        What it is split into.
    found : Pieces
        Its parts.
    made : VirtualNodes
        The copies.
    rim : ndarray, (k, 3)
        Sorted nodes of faces that do not belong to the surface, though they bound the mesh.

    Returns
    -------
    Skin
        The surface: oriented, and watertight but for `rim`.
    """
    vertex = _vertices(found)
    corner, lip = _boundary(found, rim)
    triangles = vertex[corner[:, :1], FACES[corner[:, 1]]]
    used, numbered = np.unique(triangles, return_inverse=True)
    slot = _representatives(used, vertex, found, made)
    part = slot // 4
    tet = made.element[found.fragment[part]]
    weight = _weights(mesh, slit, found.corners.ravel()[slot], made.parent[tet])
    return Skin(numbered.reshape(-1, 3).astype(np.int32), lip, tet.astype(np.int32), weight)


def pinches(found: Pieces, rim: Int64) -> Int64:
    """(p, 2) points of the complex: edges at which the surface of its parts would meet itself, split to be cured."""
    vertex = _vertices(found)
    corner, _ = _boundary(found, rim)
    faces = FACES[corner[:, 1]]
    part = np.repeat(corner[:, 0], 3)
    ends = np.stack([faces.ravel(), np.roll(faces, -1, axis=1).ravel()], axis=1)
    between = row_keys(np.take_along_axis(vertex[part], ends, axis=1))
    again, count = np.unique(between, return_index=True, return_counts=True)[1:]
    points = np.take_along_axis(found.corners[part], ends, axis=1)[again[count > 1]]
    return np.unique(np.sort(points, axis=1), axis=0)


def _vertices(found: Pieces) -> Int64:
    """(n, 4) vertex of each corner of the parts: corners of bonded parts at one point are one."""
    i, j = found.bond.T
    row, a, b = np.nonzero(found.corners[i][:, :, None] == found.corners[j][:, None, :])
    same = np.stack([4 * i[row] + a, 4 * j[row] + b], axis=1)
    return connected_groups(found.corners.size, same)[1].reshape(-1, 4)


def _boundary(found: Pieces, rim: Int64) -> tuple[Int64, Bool]:
    """(T, 2) part and number of its face, for all faces that no bond joins; and whether a blade made it."""
    faces = np.sort(found.corners[:, FACES], axis=2)  # (n, 4, 3)
    key = row_keys(np.concatenate([faces.reshape(-1, 3), found.faces, rim]))
    own, cut, beyond = np.split(key, [4 * len(faces), 4 * len(faces) + len(found.faces)])
    own = own.reshape(-1, 4)
    single = np.unique(own, return_inverse=True, return_counts=True)
    alone = (single[2][single[1]] == 1).reshape(own.shape) & ~np.isin(own, beyond)
    lip = np.isin(own, cut)
    at = np.argwhere(alone | lip)
    return at, lip[at[:, 0], at[:, 1]]


def _representatives(used: Int64, vertex: Int64, found: Pieces, made: VirtualNodes) -> Int64:
    """(S,) a corner (4 part + number) for each vertex, in a fragment with an element of its own if there is one."""
    own = made.parent[made.element[found.fragment]] == found.parent
    order = np.lexsort((np.repeat(~own, 4), vertex.ravel()))
    first = np.searchsorted(vertex.ravel()[order], used)
    return np.asarray(order[first])


def _weights(mesh: TetMesh, slit: "_core.cutting.SlitComplex", point: Int64, tet: Int32) -> Float64:
    """(S, 4) barycentric coordinates of points of the complex in tetrahedra: by the edges that they came from, exactly
    0 where they do not count; beyond the tetrahedron, where a crumb has no element, by its geometry."""
    nodes, between = mesh.tets[tet], slit.between[point]
    same = nodes[:, :, None] == between[:, None, :]
    weight = np.asarray(same @ slit.weights[point][:, :, None])[:, :, 0]
    beyond = np.flatnonzero(((between >= 0) & ~same.any(axis=1)).any(axis=1))
    x = mesh.nodes[nodes[beyond]]
    sides = (x[:, 1:] - x[:, :1]).swapaxes(1, 2)
    away = slit.places[point[beyond]] - x[:, 0]
    weight[beyond, 1:] = np.linalg.solve(sides, away[:, :, None])[:, :, 0]
    weight[beyond, 0] = 1 - weight[beyond, 1:].sum(axis=1)
    return weight
