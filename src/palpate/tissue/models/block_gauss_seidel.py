"""Model `blocks`: ring-by-ring block Gauss-Seidel on linear finite elements."""

from functools import cached_property

import numpy as np
from scipy.sparse import bsr_array, csr_array, diags_array
from scipy.sparse.linalg import LinearOperator, eigsh

from palpate import _core
from palpate.arrays import Bool, Float64
from palpate.errors import MaterialError
from palpate.tissue.contact_patches import Contacts
from palpate.tissue.error_bound import MOST_NODES, Certificate, relative
from palpate.tissue.models.ring_relaxation import RingModel, best_relaxation, least_ritz_value, typical_contact
from palpate.tissue.models.tissue_model import nodal_element
from palpate.tissue.reference.linear_elasticity import basis, lame, stiffness
from palpate.tissue.smoothed_elements import smoothed_stiffness
from palpate.tissue.sparse_factor import Factors
from palpate.tissue.tissue import Tissue


class BlockModel(RingModel):
    """Block Gauss-Seidel with over-relaxation on finite elements of the tissue's `element`, "smoothed" or "P1".

    relaxation: ω of the sweep; None: chosen from the spectrum. modes: every few sweeps the energy is also brought to
    its minimum over the body's twelve slowest shapes, so that an organ does not creep as it tilts on its support;
    False: bare sweeps. Either way the limit is the same.
    """

    linear_elasticity = True

    def __init__(self, tissue: Tissue, relaxation: float | None = None, modes: bool = True) -> None:
        self._K = ordered_by_node(tissue)
        root = _root(self._K)
        self._scaled = _scaled(self._K, root, tissue.held)
        shape, load = None, None
        if modes and self._scaled.shape[0] > 2 * _core.relaxation.BlockGaussSeidel.modes:
            self._slowest, beyond, shape, load = _slow_modes(self._K, root, self._scaled, tissue)
            least = beyond / 4  # the slowest mode that the tool's constraints leave may lie below the next one
        else:
            still = tissue.held.copy()
            still[typical_contact(tissue).nodes] = True
            self._slowest, least = (least_ritz_value(_scaled(self._K, root, part)) for part in (tissue.held, still))
        omega = best_relaxation(least) if relaxation is None else float(relaxation)
        if not 0 < omega < 2:
            raise MaterialError(f"relaxation: {omega} diverges; give a number between 0 and 2")
        start, column = self._K.indptr.astype(np.int32), self._K.indices.astype(np.int32)
        held = tissue.held.view(np.uint8)
        super().__init__(
            tissue, _core.relaxation.BlockGaussSeidel(start, column, self._K.data, held, omega, shape, load), omega
        )

    @cached_property
    def _least(self) -> float:
        """λ such that M⁻½KM⁻½ − λ is positive definite, shown by factors whose pivots are all positive."""
        identity = diags_array(np.ones(self._scaled.shape[0]))
        shift = 0.9 * self._slowest
        places = self.tissue.mesh.nodes[~self.tissue.held]
        for _ in range(60):
            factors = Factors(self._scaled - shift * identity, places)
            if factors.positive and shift > 2 * factors.slack:
                return shift - factors.slack
            shift *= 0.7
        raise MaterialError("the stiffness is not positive definite; hold more nodes, or mend flat tets of the mesh")

    @cached_property
    def _certificate(self) -> Certificate:
        return Certificate(self._K, self.tissue.held, self.tissue.mesh.nodes)

    def certified_error(self, state: "_core.tissue.ModelState", force: Float64, found: Contacts | None = None) -> float:
        """As for all ring models, but sharp, by factors of K, where a mesh of this size can be factored."""
        if int((~self.tissue.held).sum()) > MOST_NODES:
            return super().certified_error(state, force)
        residual = self.native.residual(state, force)
        energy = float(np.sqrt(max(float(np.vdot(state.u, self.native.internal_force(state))), 0.0)))
        return relative(self._certificate.distance(residual, np.array(state.u)), energy) if residual.any() else 0.0

    def least_eigenvalue(self, state: "_core.tissue.ModelState") -> float:
        """Certified lower bound of the eigenvalues of M⁻¹K; the same for every contact. Costs one factorisation."""
        return self._least


def ordered_by_node(tissue: Tissue) -> bsr_array:
    """K of the tissue's element with unknown 3i+k for node i, in 3×3 blocks, N/mm."""
    element = nodal_element(tissue)
    space = basis(tissue.mesh, element)
    if element == "smoothed":
        return smoothed_stiffness(tissue.mesh, *lame(tissue.young, tissue.poisson))
    K = stiffness(space, tissue.young * tissue.mesh.filled, tissue.poisson)
    order = space.nodal_dofs.T.ravel()
    if not np.array_equal(order, np.arange(K.shape[0])):
        K = K[order][:, order]
    blocks = bsr_array(K, blocksize=(3, 3))
    blocks.sort_indices()
    return blocks


def _root(K: bsr_array) -> bsr_array:
    """R with R M Rᵀ = 1, M the diagonal blocks of K: the inverse of their Cholesky factors."""
    nodes = K.shape[0] // 3
    rows = np.repeat(np.arange(nodes), np.diff(K.indptr))
    diagonal: Float64 = K.data[rows == K.indices]
    root = np.linalg.inv(np.linalg.cholesky(diagonal))
    return bsr_array((root, np.arange(nodes), np.arange(nodes + 1)), shape=K.shape)


def _scaled(K: bsr_array, root: bsr_array, still: Bool) -> csr_array:
    """R K Rᵀ among the unknowns that may move: its eigenvalues are those of M⁻¹K."""
    free = np.flatnonzero(np.repeat(~still, 3))
    S = csr_array(root @ csr_array(K) @ root.T)[free][:, free]
    return csr_array((S + S.T) / 2)


def _slow_modes(
    K: bsr_array, root: bsr_array, scaled: csr_array, tissue: Tissue
) -> tuple[float, float, Float64, Float64]:
    """The least eigenvalue of M⁻¹K, the first one past the modes, the modes (3N, 12) with ZᵀKZ = 1, and K Z."""
    count = _core.relaxation.BlockGaussSeidel.modes
    factors = Factors(scaled, tissue.mesh.nodes[~tissue.held])
    inverse = LinearOperator(scaled.shape, matvec=factors.solve, dtype=np.float64)
    start = np.random.default_rng(0).standard_normal(scaled.shape[0])
    values, vectors = eigsh(scaled, count + 1, sigma=0, OPinv=inverse, v0=start, tol=1e-3)
    shape = np.zeros((K.shape[0], count))
    shape[np.repeat(~tissue.held, 3)] = vectors[:, :count]
    shape = root.T @ shape
    energy = shape.T @ (K @ shape)  # nearly diagonal; scaled to exactly 1, so that the deflation is an exact minimum
    shape = np.ascontiguousarray(np.linalg.solve(np.linalg.cholesky((energy + energy.T) / 2), shape.T).T)
    return float(values[0]), float(values[count]), shape, np.ascontiguousarray(K @ shape)
