"""Model `blocks`: the 3×3 edge blocks of the P1 finite-element operator in the ring sweep, exact in the limit."""

from functools import cached_property

import numpy as np
from scipy.sparse import bsr_array, csr_array, diags_array

from palpate import _core
from palpate.arrays import Bool, Float64
from palpate.errors import MaterialError
from palpate.tissue.elasticity import basis, factored, stiffness
from palpate.tissue.rings import RingModel, best_relaxation, least_ritz_value, typical_contact
from palpate.tissue.tissue import Tissue


class BlockModel(RingModel):
    """Block Gauss-Seidel with over-relaxation on linear P1 finite elements, whatever the tissue's `element`.

    relaxation: ω of the sweep; None: chosen from the spectrum under a typical contact.
    """

    def __init__(self, tissue: Tissue, relaxation: float | None = None) -> None:
        self._K = _ordered_by_node(tissue)
        still = tissue.held.copy()
        still[typical_contact(tissue).nodes] = True
        omega = best_relaxation(least_ritz_value(_scaled(self._K, still))) if relaxation is None else float(relaxation)
        if not 0 < omega < 2:
            raise MaterialError(f"relaxation: {omega} diverges; give a number between 0 and 2")
        held = tissue.held.view(np.uint8)
        native = _core.Blocks(
            self._K.indptr.astype(np.int32), self._K.indices.astype(np.int32), self._K.data, held, omega
        )
        super().__init__(tissue, native, omega)

    @cached_property
    def _least(self) -> float:
        """λ such that M⁻½KM⁻½ − λ is positive definite, shown by factors whose pivots are all positive."""
        scaled = _scaled(self._K, self.tissue.held)
        identity = diags_array(np.ones(scaled.shape[0]))
        shift = 0.8 * least_ritz_value(scaled)
        for _ in range(60):
            factors = factored(scaled - shift * identity)
            on_diagonal = np.array_equal(factors.perm_r, factors.perm_c)
            if on_diagonal and (factors.U.diagonal() > 0).all():
                return shift
            shift *= 0.7
        raise MaterialError("the stiffness is not positive definite; hold more nodes, or mend flat tets of the mesh")

    def least_eigenvalue(self, state: "_core.State") -> float:
        """Certified lower bound of the eigenvalues of M⁻¹K; the same for every contact. Costs one factorisation."""
        return self._least


def _ordered_by_node(tissue: Tissue) -> bsr_array:
    """K with unknown 3i+k for node i, in 3×3 blocks, N/mm."""
    space = basis(tissue.mesh, "P1")
    K = stiffness(space, tissue.young, tissue.poisson)
    order = space.nodal_dofs.T.ravel()
    if not np.array_equal(order, np.arange(K.shape[0])):
        K = K[order][:, order]
    blocks = bsr_array(K, blocksize=(3, 3))
    blocks.sort_indices()
    return blocks


def _scaled(K: bsr_array, still: Bool) -> csr_array:
    """M⁻½ K M⁻½ among the unknowns that may move, M the diagonal blocks of K, with its Cholesky factors as root."""
    nodes = len(still)
    rows = np.repeat(np.arange(nodes), np.diff(K.indptr))
    diagonal: Float64 = K.data[rows == K.indices]
    root = np.linalg.inv(np.linalg.cholesky(diagonal))
    R = bsr_array((root, np.arange(nodes), np.arange(nodes + 1)), shape=K.shape)
    free = np.flatnonzero(np.repeat(~still, 3))
    S = csr_array(R @ csr_array(K) @ R.T)[free][:, free]
    return csr_array((S + S.T) / 2)
