"""Features too thin for the elements: the volume that would be lost, and where smaller elements would keep it."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from palpate.arrays import Float64, Int64
from palpate.meshes.stuffing.level_set import Level, inner_distance
from palpate.meshes.stuffing.nested_solids import Solid
from palpate.meshes.tet_mesh import boundary_faces
from palpate.meshes.triangle_surface import distance_to_surface

NEAR = 0.4  # of an edge: a surface further than this from the mesh is missed (half an edge is the promise)
MOST_POINTS = 60_000


@dataclass(frozen=True)
class Lost:
    """part: of the volume. places: how many apart. furthest: mm from the mesh. thickness: mm, of the thickest place."""

    part: float = 0.0
    places: int = 0
    furthest: float = 0.0
    thickness: float = 0.0

    def __str__(self) -> str:
        return (
            f"{self.part:.1%} of the volume, in {self.places} place{'s' * (self.places > 1)} up to {self.thickness:.2g} mm "
            f"thick, reaching {self.furthest:.2g} mm from what stays"
        )


def predict_losses(body: Solid, edge: float) -> Lost:
    """What elements of `edge` mm are sure to miss, from the voxels alone: all that is less than half an edge thick."""
    mask, spacing = body.coarse(edge / 8)
    deep = inner_distance(mask, spacing)
    core = deep > edge / 4
    if not core.any():
        return Lost(1.0, 1, float(deep.max(initial=0)), 2 * float(deep.max(initial=0)))
    away: Float64 = ndimage.distance_transform_edt(~core, sampling=spacing)
    # An opening: what a ball of that radius cannot reach. Corners of thick places are not thin.
    gone = mask & (away > 0.75 * edge + 1.5 * float(spacing.max()))
    return _describe(gone, mask, away, deep)


def measure_losses(body: Solid, nodes: Float64, tets: Int64, edge: float) -> Lost:
    """What lies further from any tetrahedron than half an edge and half a voxel."""
    if len(tets) == 0:
        return Lost()
    mask, spacing = body.coarse(edge / 8)
    inside = np.concatenate([nodes[np.unique(tets)], nodes[tets].mean(axis=1)])
    index = np.argwhere(mask)
    reach = 0.5 * edge + 0.5 * float(np.linalg.norm(spacing))
    tree = cKDTree(inside)
    far = np.isinf(tree.query(index[:, ::-1] * spacing[::-1], distance_upper_bound=reach)[0])
    gone = np.zeros(mask.shape, dtype=bool)
    gone[tuple(index[far].T)] = True
    away = np.zeros(mask.shape)
    away[gone] = tree.query(index[far][:, ::-1] * spacing[::-1])[0]
    return _describe(gone, mask, away, inner_distance(mask, spacing))


def _describe(gone: np.ndarray, mask: np.ndarray, away: Float64, deep: Float64) -> Lost:
    if not gone.any():
        return Lost()
    part = float(np.count_nonzero(gone) / np.count_nonzero(mask))
    places = ndimage.label(gone, np.ones((3, 3, 3)))[1]
    return Lost(part, int(places), float(away[gone].max()), 2 * float(deep[gone].max()))


def smooth_surface(body: Solid, edge: float = 0.0) -> tuple[Float64, Int64]:
    """Nodes mm and triangles of the surface of a solid, smoothed by 0.7 voxels or 0.3 edges, at equal volume."""
    spacing = np.array(body.grid.spacing)
    level = Level(body.mask, spacing, np.maximum(0.7 * spacing, 0.3 * edge))
    level.enclose(body.volume)
    return level.triangles()


def missed_places(surface: tuple[Float64, Int64], nodes: Float64, tets: Int64, edge: float) -> Float64:
    """(P, 3) mm: where a surface and the skin of a mesh lie further apart than 0.4 edges, either way."""
    points, triangles = surface
    skin = boundary_faces(tets.astype(np.int32))
    used = points[:: max(1, len(points) // MOST_POINTS)]
    edges = np.unique(np.sort(skin[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    bridges = nodes[edges].mean(axis=1)  # over a valley that the middles of the faces beside them miss
    middles = np.concatenate([nodes[skin].mean(axis=1), bridges])
    # Most lie close to a node or a middle: only the rest is measured to triangles.
    rest = used[cKDTree(np.concatenate([nodes[np.unique(skin)], middles])).query(used)[0] > NEAR * edge]
    outside = rest[distance_to_surface(rest, nodes, skin) > NEAR * edge] if len(rest) else rest
    rest = middles[cKDTree(points).query(middles)[0] > NEAR * edge]
    bridged = rest[distance_to_surface(rest, points, triangles) > NEAR * edge] if len(rest) else rest
    return np.concatenate([outside, bridged])
