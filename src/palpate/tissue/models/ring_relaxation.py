"""Base class of the models that are relaxed ring by ring from the contact."""

from abc import abstractmethod
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from palpate import _core
from palpate.arrays import Float64, Int32
from palpate.tissue.contact_patches import Contacts
from palpate.tissue.error_bound import relative
from palpate.tissue.models.tissue_model import IterativeModel
from palpate.tissue.tissue import Tissue


class RingModel(IterativeModel):
    """A tissue model solved by ring sweeps. native: its C++ model. relaxation: ω of the sweep."""

    native: "_core.relaxation.RingRelaxation"

    def __init__(self, tissue: Tissue, native: "_core.relaxation.RingRelaxation", relaxation: float) -> None:
        super().__init__(tissue, native, {"relaxation": relaxation})
        self.relaxation = relaxation

    @abstractmethod
    def least_eigenvalue(self, state: "_core.tissue.ModelState") -> float:
        """Certified lower bound of the eigenvalues of M⁻¹K, M the diagonal (blocks) of K, as the contact stands."""

    def certified_error(self, state: "_core.tissue.ModelState", force: Float64, found: Contacts | None = None) -> float:
        """Bound on ‖u − u*‖_K / ‖u*‖_K, u* the exact solution of this model's equations for the contacts of `state`.

        The error e has Wᵀe = 0, so eᵀKe = eᵀr ≤ ‖e‖_M ‖r‖_{M⁻¹} with r the residual at the nodes that may move, and
        λ eᵀMe ≤ eᵀKe: hence ‖e‖_K ≤ ‖r‖_{M⁻¹}/√λ. Force times push errs by ‖e‖_K² − uᵀr, no more than
        about the same share.
        """
        energy, residual = self.native.balance(state, force)
        if residual == 0:
            return 0.0
        return relative(float(np.sqrt(residual / self.least_eigenvalue(state))), float(np.sqrt(max(energy, 0.0))))


def best_relaxation(least: float) -> float:
    """Young's ω = 2/(1 + √(1 − μ²)) for successive over-relaxation, μ = 1 − `least` the Jacobi sweep's contraction.

    Exact for consistently ordered matrices only; here a good choice between 1 and 2 (D. M. Young, 1954).
    """
    return float(2 / (1 + np.sqrt(least * (2 - least))))


def typical_contact(tissue: Tissue) -> "_core.tissue.ContactPatch":
    """A patch of two edges' radius on the free surface node nearest the middle of the surface."""
    nodes = tissue.mesh.surface_nodes[~tissue.held[tissue.mesh.surface_nodes]]
    x = tissue.mesh.nodes[nodes]
    middle = int(np.argmin(np.linalg.norm(x - x.mean(axis=0), axis=1)))
    found = tissue.surface.patch(tissue.surface.closest(x[middle]), 2 * tissue.edge)
    one = _core.tissue.ContactPatch(nodes[middle : middle + 1].astype(np.int32), np.ones(1))
    return found if isinstance(found, _core.tissue.ContactPatch) else one


def least_ritz_value(A: Any, steps: int = 150) -> float:
    """Estimate from above of the least eigenvalue of a symmetric matrix, by Lanczos steps from a fixed start."""
    n = A.shape[0]
    v = np.random.default_rng(0).standard_normal(n)
    v /= np.linalg.norm(v)
    previous, beta = np.zeros(n), 0.0
    diagonal: list[float] = []
    off: list[float] = []
    for _ in range(min(steps, n)):
        w = A @ v - beta * previous
        alpha = float(v @ w)
        w -= alpha * v
        diagonal.append(alpha)
        beta = float(np.linalg.norm(w))
        if beta < 1e-12:
            break
        off.append(beta)
        previous, v = v, w / beta
    tridiagonal = np.diag(diagonal) + np.diag(off[: len(diagonal) - 1], 1) + np.diag(off[: len(diagonal) - 1], -1)
    return float(np.linalg.eigvalsh(tridiagonal)[0])


def without_diagonal(K: csr_array) -> tuple[Int32, Int32, Float64]:
    """Compressed rows of a scalar matrix without its diagonal: start, column, value."""
    K = K.copy()
    K.setdiag(0)
    K.eliminate_zeros()
    K.sort_indices()
    return K.indptr.astype(np.int32), K.indices.astype(np.int32), K.data.astype(np.float64)
