"""Reference at finite strain on smoothed elements: the same Newton's method, another energy."""

import numpy as np
from scipy.sparse import bsr_array, coo_array, csr_array, diags_array

from palpate.arrays import Float64, Int32
from palpate.tissue.reference.finite_strain import NEO_HOOKEAN, FiniteStrain
from palpate.tissue.reference.linear_elasticity import FiniteElements, lame
from palpate.tissue.smoothed_elements import edge_stiffening, smoothing_cells
from palpate.tissue.tissue import Tissue

BARRIER_START = 0.3
"""Share of a tetrahedron's volume below which it resists by an energy of its own."""


class SmoothedFiniteStrain(FiniteStrain):
    """Neo-Hookean equilibrium on smoothed elements; `push` answers like a model, to rounding.

    E = Σ V_g μ_g (½(tr F̄ᵀF̄ − 3) − ln det F̄) + Σ V_a λ_a/2 (ln J_a)² + Σ V_e μ_e (ln J_e/0.3)₋², with the mean F̄ of each
    edge's cell g, the volume ratio J_a of each node's cell a, and J_e of each tetrahedron. With a stiffening, the first sum
    has Demiray's law.
    """

    def __init__(self, tissue: Tissue) -> None:
        self.tissue, self.law = tissue, NEO_HOOKEAN
        self.linear = FiniteElements(tissue, "smoothed")
        lam, mu = lame(tissue.young, tissue.poisson)
        cells = self._cells = smoothing_cells(tissue.mesh, lam, mu)
        stiff = (edge_stiffening(cells, mu, tissue.stiffening),) if tissue.stiffening.any() else ()
        self._constants = (np.zeros(len(cells.mu)), cells.mu * cells.edge_volumes, *stiff)
        self._mu, self._slope = mu, cells.slopes[:, None]  # (M, 1, 4, 3): one point of quadrature
        tets = tissue.mesh.tets
        self._unknown = (3 * tets[:, :, None] + np.arange(3)).reshape(len(tets), 12)
        share = (cells.volumes / 6)[:, None] / cells.edge_volumes[cells.edge]
        self._mean = _gradients(cells.edge, share, cells.slopes, self._unknown)
        part = (cells.volumes / 4)[:, None] / cells.node_volumes[cells.node]
        corner = np.repeat(np.arange(len(tets)), 4)
        self._average = csr_array(coo_array((part.ravel(), (cells.node.ravel(), corner))))

    def force(self, u: Float64) -> Float64:
        """(unknowns,) N that holds the tissue at displacement u (unknowns,)."""
        F, rows = self._mean_deformation(u), self._volume_rows(u)
        P = self.law.stress(F, *self._constants)
        return np.asarray(self._mean.T @ P.ravel() + rows.T @ self._pressures(u)[0])

    def tangent(self, u: Float64) -> csr_array:
        """(unknowns, unknowns) N/mm: derivative of `force`."""
        F, rows = self._mean_deformation(u), self._volume_rows(u)
        A = self.law.tangent(F, *self._constants).reshape(-1, 9, 9)
        middle = bsr_array((A, np.arange(len(A)), np.arange(len(A) + 1)))
        pressure, bulk, barrier = self._pressures(u)
        averaged = csr_array(self._average @ rows)
        K = self._mean.T @ csr_array(middle) @ self._mean + averaged.T @ diags_array(bulk) @ averaged
        K = K + rows.T @ diags_array(barrier) @ rows + self._bending(u, pressure)
        return csr_array(K)

    def _mean_deformation(self, u: Float64) -> Float64:
        return np.asarray(np.eye(3) + (self._mean @ u).reshape(-1, 3, 3))

    def _ratios(self, u: Float64) -> tuple[Float64, Float64]:
        """(M, 3, 3) F and (M,) J of the tets."""
        F = self.deformation(u)[:, 0]
        return F, np.asarray(np.linalg.det(F))

    def _volume_rows(self, u: Float64) -> csr_array:
        """(M, unknowns) derivative of each tet's J."""
        F, J = self._ratios(u)
        cofactor = J[:, None, None] * np.linalg.inv(F).swapaxes(1, 2)
        value = np.einsum("mij,maj->mai", cofactor, self._cells.slopes).reshape(-1, 12)
        row = np.repeat(np.arange(len(J)), 12)
        return csr_array(coo_array((value.ravel(), (row, self._unknown.ravel())), shape=(len(J), len(u))))

    def _pressures(self, u: Float64) -> tuple[Float64, Float64, Float64]:
        """dE/dJ of each tet (M,); d²E/dJ² of each node's cell, and of each tet by its barrier."""
        cells, J = self._cells, self._ratios(u)[1]
        average: Float64 = np.asarray(self._average @ J)
        below = np.log(np.minimum(J / BARRIER_START, 1))
        slope = cells.node_volumes * cells.lam * np.log(average) / average
        bulk = cells.node_volumes * cells.lam * (1 - np.log(average)) / average**2
        stiff = 2 * cells.volumes * self._mu
        barrier = np.where(J < BARRIER_START, stiff * (1 - below) / J**2, 0)
        return self._average.T @ slope + stiff * below / J, bulk, barrier

    def _bending(self, u: Float64, pressure: Float64) -> csr_array:
        """(unknowns, unknowns) dE/dJ times the second derivative of J, summed over the tets."""
        F, J = self._ratios(u)
        G = np.linalg.inv(F).swapaxes(1, 2)
        moved = np.einsum("mij,maj->mai", G, self._cells.slopes)
        pairs = np.einsum("mai,mbk->maibk", moved, moved)
        local = (pressure * J)[:, None, None, None, None] * (pairs - pairs.transpose(0, 1, 4, 3, 2))
        row, column = np.repeat(self._unknown, 12, axis=1).ravel(), np.tile(self._unknown, 12).ravel()
        return csr_array(coo_array((local.ravel(), (row, column)), shape=(len(u), len(u))))


def _gradients(cell: Int32, share: Float64, slopes: Float64, unknown: Int32) -> csr_array:
    """(9 cells, unknowns): row 9g + 3i + j is the mean of ∂u_i/∂X_j in cell g."""
    value = np.broadcast_to(
        share[:, :, None, None, None] * slopes.swapaxes(1, 2)[:, None, None], (*cell.shape, 3, 3, 4)
    )  # (M, k, i, j, corner)
    row = 9 * cell[:, :, None, None, None] + np.arange(9).reshape(3, 3)[:, :, None]
    column = unknown.reshape(-1, 4, 3).swapaxes(1, 2)[:, None, :, None]
    row, column = np.broadcast_to(row, value.shape), np.broadcast_to(column, value.shape)
    shape = (9 * (int(cell.max()) + 1), int(unknown.max()) + 1)
    return csr_array(coo_array((value.ravel(), (row.ravel(), column.ravel())), shape=shape))
