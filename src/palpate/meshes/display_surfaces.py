"""The surfaces that a display draws: the mesh's own, and those of the regions inside."""

import numpy as np

from palpate.arrays import Int32
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.meshes.tet_mesh import TetMesh, boundary_faces


def displayed_nodes(mesh: TetMesh) -> Int32:
    """Sorted nodes that a display draws: on the surface, or between two regions."""
    if isinstance(mesh, CutMesh):
        return mesh.surface_nodes
    nodes = [mesh.surface.ravel(), *(faces.ravel() for faces in region_faces(mesh).values())]
    return np.unique(np.concatenate(nodes)).astype(np.int32)


def region_faces(mesh: TetMesh) -> dict[int, Int32]:
    """Triangles around each region inside another, by label: all regions but the largest."""
    labels, count = np.unique(mesh.region, return_counts=True)
    return {
        int(label): boundary_faces(np.ascontiguousarray(mesh.tets[mesh.region == label]))
        for label in labels
        if label != labels[np.argmax(count)]
    }
