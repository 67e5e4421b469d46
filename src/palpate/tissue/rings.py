"""What the models that are relaxed ring by ring share: pushing until a certified error is small enough."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array

from palpate import _core
from palpate.arrays import Float64, Int32
from palpate.errors import DataError
from palpate.tissue.contact import Answer, Contacts, contacts
from palpate.tissue.tissue import Tissue


class RingModel:
    """A tissue model solved by ring sweeps. Immutable; what changes is the state that `start` gives.

    native: the C++ model that the real-time loop runs. relaxation: ω of the sweep.
    """

    def __init__(self, tissue: Tissue, native: "_core.RingModel", relaxation: float) -> None:
        self.tissue = tissue
        self.native = native
        self.relaxation = relaxation

    def start(self) -> "_core.State":
        """A state at rest, to hand to `push(warm=)`."""
        return self.native.start()

    def refuse(self, found: Contacts) -> None:
        """Raises `DataError` for contacts that this model cannot answer; none by default."""

    def least_eigenvalue(self, state: "_core.State") -> float:
        """Certified lower bound of the eigenvalues of M⁻¹K, M the diagonal (blocks) of K, as the contact stands."""
        raise NotImplementedError

    def push(
        self,
        points: ArrayLike,
        displacements: ArrayLike,
        radii: ArrayLike,
        normals: ArrayLike | None = None,
        friction: float = np.inf,
        tolerance: float = 1e-3,
        warm: "_core.State | None" = None,
        most_sweeps: int = 20_000,
    ) -> Answer:
        """Pushes m contacts at once and relaxes until the certified error is below `tolerance`.

        points: (m, 3) mm, rest positions on the surface. displacements: (m, 3) mm. radii: (m,) mm. One contact keeps
        (3,), (3,), scalar. friction: inf (glue); sliding is not built yet. warm: a state from `start` or an earlier
        answer, which this push moves on. The answer says its certified error, which exceeds the tolerance only if
        `most_sweeps` sweeps were not enough. Raises `DataError` or `MaterialError` for contacts that cannot be.
        """
        if not 0 < tolerance < 1:
            raise DataError(f"tolerance: {tolerance}; give a relative error between 0 and 1, such as 1e-3")
        found = contacts(self.tissue, points, displacements, radii, normals, friction)
        self.refuse(found)
        state = self.start() if warm is None else warm
        if not found.displacement.any():
            state.u[:] = 0  # the exact solution
        done, batch = 0, 4 if found.displacement.any() else 0
        while True:
            force = self.native.solve(state, found.patches, found.displacement, batch)
            if force is None:
                raise DataError(
                    f"{len(found.patches)} contacts with {sum(len(p.nodes) for p in found.patches)} nodes; at most "
                    f"{_core.RingModel.most_contacts} contacts and {_core.Patch.capacity} nodes; give smaller radii"
                )
            done += batch
            error = self.certified_error(state, force)
            if error <= tolerance or done >= most_sweeps:
                break
            batch = min(max(4, done // 4), most_sweeps - done)
        return found.answer(self.tissue, force, state.u.copy(), error, done, state)

    def certified_error(self, state: "_core.State", force: Float64) -> float:
        """Bound on ‖u − u*‖_K / ‖u*‖_K, u* the exact solution of this model's equations for the contacts of `state`.

        The error e has Wᵀe = 0, so eᵀKe = eᵀr ≤ ‖e‖_M ‖r‖_{M⁻¹} with r the residual at the nodes that may move, and
        λ eᵀMe ≤ eᵀKe: hence ‖e‖_K ≤ ‖r‖_{M⁻¹}/√λ. The force then errs along the push by at most the square.
        """
        energy, residual = self.native.balance(state, force)
        if residual == 0:
            return 0.0
        distance = float(np.sqrt(residual / self.least_eigenvalue(state)))
        length = float(np.sqrt(max(energy, 0.0)))
        return distance / (length - distance) if length > distance else float("inf")


def best_relaxation(least: float) -> float:
    """Young's ω = 2/(1 + √(1 − μ²)) for successive over-relaxation, μ = 1 − `least` the Jacobi sweep's contraction.

    Exact for consistently ordered matrices only; here a good choice between 1 and 2 (D. M. Young, 1954).
    """
    return float(2 / (1 + np.sqrt(least * (2 - least))))


def typical_contact(tissue: Tissue) -> "_core.Patch":
    """A patch of two edges' radius on the free surface node nearest the middle of the surface."""
    nodes = tissue.mesh.surface_nodes[~tissue.held[tissue.mesh.surface_nodes]]
    x = tissue.mesh.nodes[nodes]
    middle = int(np.argmin(np.linalg.norm(x - x.mean(axis=0), axis=1)))
    found = tissue.surface.patch(tissue.surface.closest(x[middle]), 2 * tissue.edge)
    one = _core.Patch(nodes[middle : middle + 1].astype(np.int32), np.ones(1))
    return found if isinstance(found, _core.Patch) else one


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
