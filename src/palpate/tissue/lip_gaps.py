"""The gap between the lips of a cut, node by node."""

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from palpate.arrays import Float64, Int64
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.tissue.surface_gaps import SurfaceGaps, along

KINK = 0.1  # standard deviation of the normals about their mean, from which on a part of a cut counts as two
KINKS = 2  # rounds of halving: up to three kinks at a node
SAME = 1e-8  # of the body's size: vertices that are nearer to each other are at one place


def lip_gaps(mesh: CutMesh, slips: bool = False) -> SurfaceGaps:
    """The weighted mean of the gap over each part of the cut; slips: and the slips there.

    A node of the mesh before, of which the two lips have two copies, has a part of the cut: its weight is the node's own
    shape function, so the means are those of a mortar method. With it the jump of the displacement along the normal is
    integrated over the faces of the cut (one point a corner). Where the blade has turned, a node has a gap on each side of
    the kink. At rest all gaps are 0.
    """
    skin, places = mesh.skin, mesh.places
    front, back = _opposite(
        skin.triangles[skin.lip].astype(np.int64), places, SAME * float(np.ptp(mesh.nodes, axis=0).max())
    )
    a, b, c = places[front].swapaxes(0, 1)
    normal = np.cross(b - a, c - a) / 6  # a third of the area: of a corner. Out of the front, into the back
    vertex, other = front.ravel(), back.ravel()
    normal = np.repeat(normal, 3, axis=0)
    nodes, weight = mesh.tets[skin.tet].astype(np.int64), skin.weight
    origin = mesh.origin.astype(np.int64)
    # The copies of one node that move a front corner and the back corner opposite.
    point, i, j = np.nonzero(
        (origin[nodes[vertex]][:, :, None] == origin[nodes[other]][:, None, :])
        & (weight[vertex][:, :, None] > 0)
        & (weight[other][:, None, :] > 0)
    )
    first, second = nodes[vertex[point], i], nodes[other[point], j]
    apart = first != second  # at the blade's tip they are one
    point, i, first, second = point[apart], i[apart], first[apart], second[apart]
    if len(point) == 0:
        return SurfaceGaps.none(len(mesh.nodes))
    pair = np.sort(np.stack([first, second], axis=1), axis=1)
    gap = np.unique(pair, axis=0, return_inverse=True)[1].ravel()
    share = weight[vertex[point], i]
    outwards = np.where(first < second, share, -share)[:, None] * normal[point]  # of the same lip for all of a gap
    for _ in range(KINKS):
        gap = np.unique(2 * gap + _beyond_a_kink(gap, outwards), return_inverse=True)[1].ravel()
    area = share * np.linalg.norm(normal[point], axis=1)
    size = np.bincount(gap, area)[gap]
    part, pressed = area / size, (share / size)[:, None] * normal[point]  # (p,), (p, 3)
    count = int(gap.max()) + 1
    nodal = np.concatenate([nodes[vertex[point]], nodes[other[point]]])  # (2p, 4), of the front and of the back
    by = np.concatenate([-weight[vertex[point]], weight[other[point]]])
    rows = (3 * nodal[:, :, None] + np.arange(3)).ravel()

    def of_nodes(which: Int64, ways: Float64, columns: int) -> csr_array:
        values = (by[:, :, None] * np.tile(ways, (2, 1))[:, None]).ravel()
        return csr_array(
            coo_array((values, (rows, np.repeat(np.tile(which, 2), 12))), shape=(3 * len(mesh.nodes), columns))
        )

    N = of_nodes(gap, pressed, count)
    if not slips:
        return SurfaceGaps(N, np.zeros(count), csr_array((N.shape[0], 0)))
    mean = np.stack([np.bincount(gap, pressed[:, c], count) for c in range(3)], axis=1)
    tangent = along(np.asarray(mean, dtype=np.float64))
    along_first, along_second = (of_nodes(2 * gap + k, part[:, None] * tangent[gap, k], 2 * count) for k in (0, 1))
    return SurfaceGaps(N, np.zeros(count), csr_array(along_first + along_second))


def _beyond_a_kink(gap: Int64, normal: Float64) -> Int64:
    """(p,) 1 for the faces of a gap whose normals, times their areas (p, 3), lie to one side of a kink, 0 to the other."""
    size = np.linalg.norm(normal, axis=1)
    count = int(gap.max()) + 1
    mean = np.stack([np.bincount(gap, normal[:, c], count) for c in range(3)], axis=1)
    unit = normal / np.maximum(size, 1e-300)[:, None]
    off = unit - (mean / np.bincount(gap, size, count)[:, None])[gap]
    spread = np.zeros((count, 3, 3))
    np.add.at(spread, gap, size[:, None, None] * off[:, :, None] * off[:, None, :])
    spread /= np.bincount(gap, size, count)[:, None, None]
    value, vector = np.linalg.eigh(spread)
    across = np.einsum("pc,pc->p", off, vector[gap, :, 2])
    beyond = np.logical_and(value[gap, 2] > KINK**2, across > 0)
    return np.asarray(beyond, dtype=np.int64)


def _opposite(triangles: Int64, places: Float64, tolerance: float) -> tuple[Int64, Int64]:
    """(n, 3) and (n, 3): each face of one lip, and the vertices of the other lip at the same places."""
    i, j = cKDTree(places).query_pairs(tolerance, output_type="ndarray").T
    size = (len(places), len(places))
    place = connected_components(coo_array((np.ones(len(i)), (i, j)), size), directed=False)[1].astype(np.int64)
    order = np.argsort(place[triangles], axis=1, kind="stable")
    turned = np.take_along_axis(triangles, order, axis=1)
    _, group, count = np.unique(place[turned], axis=0, return_inverse=True, return_counts=True)
    double = np.flatnonzero(count[group.ravel()] == 2)
    one, two = double[np.argsort(group.ravel()[double], kind="stable")].reshape(-1, 2).T
    front, back = triangles[one], turned[two]
    rank = np.argsort(order[one], axis=1, kind="stable")  # corners of the back in the order of the front's
    return front, np.take_along_axis(back, rank, axis=1)
