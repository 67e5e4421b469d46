"""Quadratic displacements on tetrahedra in the hierarchical basis: nodal functions and edge bubbles."""

from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from palpate.arrays import Bool, Float64, Int32
from palpate.tissue.smoothed_elements import EDGES, SmoothingCells
from palpate.tissue.tissue import Tissue

MASS = (np.ones((4, 4)) + np.eye(4)) / 20
"""∫ λ_a λ_b over a tetrahedron of volume 1, λ its barycentric coordinates."""


class HierarchicalBasis:
    """Displacements of a tissue as Σ z_a λ_a over its nodes + Σ z_g 4 λ_i λ_j over its edges, and the energy ∫μ 2ε:ε.

    The first N rows of a coefficient array (N + E, 3) are nodes, the others edges. Their gradients are linear in each
    tetrahedron, so values at its corners say all. Nothing is assembled: memory is a few hundred bytes a tetrahedron.

    tissue: the solid. cells: its volumes and slopes. mu: (M,) N/mm² of the tetrahedra.
    """

    def __init__(self, tissue: Tissue, cells: SmoothingCells, mu: Float64) -> None:
        self.cells, self.mu = cells, mu
        self.tets, self.nodes = tissue.mesh.tets, len(tissue.mesh.nodes)
        ends = np.sort(self.tets[:, EDGES].astype(np.int64), axis=2)
        self._keys, edge = np.unique(ends[:, :, 0] * self.nodes + ends[:, :, 1], return_inverse=True)
        self.edge: Int32 = edge.reshape(-1, 6).astype(np.int32)  # of each tet's edges
        first, second = np.divmod(self._keys, self.nodes)
        self.held: Bool = np.concatenate([tissue.held, tissue.held[first] & tissue.held[second]])
        self._at_edges = _sums(self.edge, len(self._keys))
        self._at_nodes = _sums(self.tets, self.nodes)

    def edges(self, ends: Int32) -> Int32:
        """Rows of the edges with the nodes `ends` (..., 2)."""
        low, high = np.sort(ends.astype(np.int64), axis=-1).swapaxes(0, -1)
        return np.asarray(self.nodes + np.searchsorted(self._keys, (low * self.nodes + high).T), dtype=np.int32)

    def slopes(self, z: Float64) -> Float64:
        """(M, 4, 3, 3): ∂u_k/∂x_l at the corners of each tetrahedron, for coefficients `z` (N + E, 3) mm."""
        pairs = np.zeros((len(self.tets), 4, 3, 4))
        a, b = EDGES.T
        pairs[:, a, :, b] = pairs[:, b, :, a] = 4 * z[self.nodes :][self.edge].swapaxes(0, 1)
        pairs += z[self.tets].swapaxes(1, 2)[:, None]
        return (pairs.reshape(-1, 12, 4) @ self.cells.slopes).reshape(-1, 4, 3, 3)

    def forces(self, stress: Float64) -> Float64:
        """(N + E, 3) N: ∫ s ∇v for each function v, for a stress s (M, 4, 3, 3) N/mm² at the corners, linear between."""
        moment = (MASS @ stress.reshape(-1, 4, 9)) * self.cells.volumes[:, None, None]  # ∫ λ_a s
        pairs = moment.reshape(-1, 12, 3) @ self.cells.slopes.swapaxes(1, 2)
        pairs = pairs.reshape(-1, 4, 3, 4)
        a, b = EDGES.T
        bubbles = 4 * (pairs[:, a, :, b] + pairs[:, b, :, a]).swapaxes(0, 1)
        nodal = pairs.sum(axis=1).swapaxes(1, 2)
        return np.concatenate([self._at_nodes @ nodal.reshape(-1, 3), self._at_edges @ bubbles.reshape(-1, 3)])

    def shear_stress(self, slope: Float64) -> Float64:
        """2 μ ε for slopes (M, 4, 3, 3)."""
        return self.mu[:, None, None, None] * (slope + slope.swapaxes(2, 3))

    def solve(self, load: Float64, iterations: int) -> Float64:
        """(N + E, 3) mm: displacement under `load` (N + E, 3) N, by conjugate gradients with the diagonal's blocks."""
        z, r = np.zeros_like(load), load.copy()
        r[self.held] = 0
        y = np.einsum("gkl,gl->gk", self._inverse_blocks, r)
        q, ry = y, float((r * y).sum())
        for _ in range(iterations):
            if not ry > 0:
                break
            Aq = self.forces(self.shear_stress(self.slopes(q)))
            Aq[self.held] = 0
            step = ry / float((q * Aq).sum())
            z += step * q
            r -= step * Aq
            y = np.einsum("gkl,gl->gk", self._inverse_blocks, r)
            before, ry = ry, float((r * y).sum())
            q = y + ry / before * q
        return z

    @cached_property
    def _inverse_blocks(self) -> Float64:
        """(N + E, 3, 3) mm/N: inverse of each function's own stiffness."""
        g, V = self.cells.slopes, self.cells.volumes[:, None, None]
        outer = g[:, :, None, :, None] * g[:, None, :, None, :]  # (M, 4, 4, 3, 3)
        a, b = EDGES.T
        bubbles = 16 * (outer[:, a, a] / 10 + outer[:, b, b] / 10 + (outer[:, a, b] + outer[:, b, a]) / 20)
        nodal = outer[:, range(4), range(4)]
        summed = []
        for square, sums in ((nodal, self._at_nodes), (bubbles, self._at_edges)):  # ∫ ∇v ∇vᵀ
            block = square + np.trace(square, axis1=2, axis2=3)[:, :, None, None] * np.eye(3)
            block *= (V * self.mu[:, None, None])[..., None]
            summed.append(sums @ block.reshape(-1, 9))
        return np.linalg.inv(np.concatenate(summed).reshape(-1, 3, 3))


def _sums(number: Int32, count: int) -> csr_array:
    """(count, number.size): sums entries of an array over `number`, which says the row of each."""
    return csr_array((np.ones(number.size), (number.ravel(), np.arange(number.size))), shape=(count, number.size))
