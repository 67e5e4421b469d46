"""Organs of one mesh that lie beside each other."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from palpate.arrays import Int32
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.meshes.tet_mesh import TetMesh


def organs(mesh: TetMesh) -> Int32:
    """(N,) the number of the organ that each node belongs to: what hangs together, before all cuts."""
    origin = np.arange(len(mesh.nodes))
    if isinstance(mesh, CutMesh):
        origin = np.unique(mesh.origin, return_inverse=True)[1].astype(np.int64)  # not all of them need be there
    tets = origin[mesh.tets]
    pairs = (tets[:, :3].ravel(), tets[:, 1:].ravel())
    size = (int(origin.max()) + 1,) * 2
    number: Int32 = connected_components(coo_array((np.ones(len(pairs[0])), pairs), size), directed=False)[1]
    return np.asarray(np.take(number, origin))


def main_regions(mesh: TetMesh) -> list[int]:
    """The label of the largest region of each organ."""
    organ = organs(mesh)[mesh.tets[:, 0]]
    found = []
    for number in range(int(organ.max()) + 1):
        labels, count = np.unique(mesh.region[organ == number], return_counts=True)
        found.append(int(labels[np.argmax(count)]))
    return found
