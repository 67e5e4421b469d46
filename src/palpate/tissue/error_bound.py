"""A certified bound on the error of a solution, by a factorisation."""

from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import bsr_array, csr_array, eye_array

from palpate.arrays import Bool, Float64
from palpate.errors import MaterialError
from palpate.tissue.sparse_factor import Factors

MOST_NODES = 30_000
"""Nodes beyond which a model does not factor its stiffness only to know how well it did."""


class Certificate:
    """‖r‖ in the norm of K⁻¹, for residuals r of the elastic equilibrium K u = W f under Wᵀu = d.

    K: (3N, 3N) in 3×3 blocks, N/mm. held: (N,) nodes that stand still. places: (N, 3) mm.

    An answer that holds Wᵀu = d errs by e with Wᵀe = 0 and K e = W(f − f*) − r at the nodes that may move, so
    eᵀKe = −eᵀr ≤ ‖e‖_K ‖r‖_{K⁻¹}: the energy norm of the error is at most ‖r‖_{K⁻¹}, whatever force f the residual was
    made with. The factors give some x with K x = r − t, and ‖r‖_{K⁻¹} ≤ ‖x‖_K + ‖t‖/√λ, λ a lower bound of K's
    eigenvalues that a second factorisation, of K − λ, proves. What rounding may hide of r and of K x is added to t.
    """

    def __init__(self, K: bsr_array, held: Bool, places: Float64) -> None:
        self._free = np.flatnonzero(np.repeat(~held, 3))
        self._K: Any = csr_array(csr_array(K)[self._free][:, self._free])
        self._places = np.ascontiguousarray(places[~held])
        longest = int(np.diff(self._K.indptr).max())
        self._unit = 4 * (longest + 4) * 2.0**-53  # rounding error of a sum over a row, with a margin

    @cached_property
    def _factors(self) -> Factors:
        return Factors(self._K, self._places)

    @cached_property
    def least(self) -> float:
        """N/mm, proven lower bound of K's eigenvalues; a crude one will do."""
        x = np.random.default_rng(0).standard_normal(self._K.shape[0])
        for _ in range(3):  # inverse iteration estimates it from above; the factorisation below proves a smaller value
            x = self._factors.solve(x / np.linalg.norm(x))
        shift = 0.5 / float(np.linalg.norm(x))
        for _ in range(20):
            factors = Factors(self._K - shift * eye_array(len(x), format="csr"), self._places)
            if factors.positive and shift > 2 * factors.slack:
                return shift - factors.slack
            shift /= 4
        raise MaterialError("the stiffness is too near to singular to certify; hold more nodes, or mend flat tets")

    def distance(self, residual: Float64, u: Float64) -> float:
        """√(N mm): at least ‖r‖_{K⁻¹}, r (N, 3) N the residual of u (N, 3) mm, as float64 made it."""
        r, v = residual.reshape(-1)[self._free], u.reshape(-1)[self._free]
        x = self._factors.solve(r)
        force = self._K @ x
        rounded = self._unit * (abs(self._K) @ (np.abs(x) + np.abs(v)) + np.abs(r))
        missed = np.linalg.norm(np.abs(r - force) + rounded)
        return float(np.sqrt(max(float(x @ force), 0.0)) + missed / np.sqrt(self.least))


def relative(distance: float, energy_norm: float) -> float:
    """Bound on ‖u − u*‖/‖u*‖ from one on ‖u − u*‖ and from ‖u‖, all in the energy norm."""
    return distance / (energy_norm - distance) if energy_norm > distance else float("inf")
