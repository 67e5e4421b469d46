"""Lumps: the connected parts of a region, and whether a needle's tip is in one."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array, csgraph

from palpate import _core
from palpate.arrays import ArrayLike, Float64, Int32
from palpate.meshes.tet_mesh import TetMesh, boundary_faces

INSIDE = 1e-9  # tolerance of a barycentric weight below 0 on the lump's surface


@dataclass(frozen=True, eq=False)
class Lump:
    """mesh: of the organ. tets: (k,) those of the lump."""

    mesh: TetMesh
    tets: Int32

    @cached_property
    def faces(self) -> Int32:
        """(F, 3) triangles of its skin."""
        return boundary_faces(np.ascontiguousarray(self.mesh.tets[self.tets]))

    @cached_property
    def depth(self) -> float:
        """mm from it to the nearest of the organ's skin, at rest."""
        skin, still = self.mesh.nodes[self.mesh.surface_nodes], self._skin(self.mesh.nodes)
        return float(min(still.closest(np.ascontiguousarray(x)).distance for x in skin))

    def distance(self, point: ArrayLike, displacement: Float64 | None = None) -> float:
        """mm from `point` to its skin, or 0 inside it: at rest, or with every node moved by `displacement` (N, 3)."""
        at = np.ascontiguousarray(point, dtype=np.float64)
        nodes = self.mesh.nodes if displacement is None else np.ascontiguousarray(self.mesh.nodes + displacement)
        return 0.0 if self._holds(at, nodes) else float(self._skin(nodes).closest(at).distance)

    def centre(self, displacement: Float64 | None = None) -> Float64:
        """(3,) mm, mean of its volume at rest, or carried along."""
        nodes = self.mesh.nodes if displacement is None else self.mesh.nodes + displacement
        middles = nodes[self.mesh.tets[self.tets]].mean(axis=1)
        return np.asarray(np.average(middles, axis=0, weights=self.mesh.volumes[self.tets]))

    def _holds(self, point: Float64, nodes: Float64) -> bool:
        """Is the point in one of its tets? By barycentric weights."""
        corners = nodes[self.mesh.tets[self.tets]]
        sides = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)
        sound = np.abs(np.linalg.det(sides)) > 0
        weights = np.linalg.solve(sides[sound], (point - corners[sound, 0])[:, :, None])[:, :, 0]
        return bool(((weights >= -INSIDE).all(axis=1) & (weights.sum(axis=1) <= 1 + INSIDE)).any())

    def _skin(self, nodes: Float64) -> "_core.tissue.ContactSurface":
        return _core.tissue.ContactSurface(nodes, self.faces, np.zeros(len(nodes), dtype=np.uint8))


def connected_lumps(mesh: TetMesh, label: int) -> list[Lump]:
    """The parts of a region that are connected through nodes, the largest first."""
    tets = np.flatnonzero(mesh.region == label).astype(np.int32)
    owner, node = np.repeat(np.arange(len(tets)), 4), mesh.tets[tets].ravel()
    meets = coo_array((np.ones(len(node)), (owner, node)), shape=(len(tets), len(mesh.nodes))).tocsr()
    count, part = csgraph.connected_components(meets @ meets.T, directed=False)
    parts = [tets[part == k] for k in range(count)]
    return [Lump(mesh, mine) for mine in sorted(parts, key=lambda t: -float(mesh.volumes[t].sum()))]
