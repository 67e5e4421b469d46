"""Reference at finite strain: hyperelastic equilibrium by Newton's method with direct solves."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array

from palpate.arrays import ArrayLike, Float64
from palpate.errors import DataError, MaterialError
from palpate.tissue.contact_patches import Answer, contacts
from palpate.tissue.reference.linear_elasticity import FiniteElements, lame
from palpate.tissue.sparse_factor import Factors
from palpate.tissue.tissue import Tissue

_DEGREE = {"P1": 1, "P2": 4}
_NEWTON, _CHUNK, _LEAST_PART = 25, 1000, 1e-3


@dataclass(frozen=True)
class Law:
    """A hyperelastic energy per volume at rest, by its derivatives.

    stress: F (..., 3, 3), λ (...), μ (...) N/mm² -> ∂W/∂F (..., 3, 3) N/mm². tangent: the same -> ∂²W/∂F²
    (..., 3, 3, 3, 3), the first two indices those of the stress. Of a tissue that stiffens, the exponent (...) follows μ.
    """

    stress: Callable[..., Float64]
    tangent: Callable[..., Float64]


def _grown(F: Float64, mu: Float64, stiffening: Float64 | None) -> Float64:
    """μ exp(b (tr FᵀF − 3 − 2 ln J))."""
    if stiffening is None:
        return mu
    with np.errstate(over="ignore"):  # of a trial that goes too far
        return np.asarray(mu * np.exp(stiffening * ((F**2).sum(axis=(-1, -2)) - 3 - 2 * np.log(np.linalg.det(F)))))


def _stress(F: Float64, lam: Float64, mu: Float64, stiffening: Float64 | None = None) -> Float64:
    G, grown = np.linalg.inv(F).swapaxes(-1, -2), _grown(F, mu, stiffening)
    along = lam * np.log(np.linalg.det(F)) - grown
    return np.asarray(grown[..., None, None] * F + along[..., None, None] * G)


def _tangent(F: Float64, lam: Float64, mu: Float64, stiffening: Float64 | None = None) -> Float64:
    G, one, grown = np.linalg.inv(F).swapaxes(-1, -2), np.eye(3), _grown(F, mu, stiffening)
    turn = grown - lam * np.log(np.linalg.det(F))
    A = grown[..., None, None, None, None] * np.einsum("ik,jl->ijkl", one, one)
    A = A + turn[..., None, None, None, None] * np.einsum("...il,...kj->...ijkl", G, G)
    A = A + lam[..., None, None, None, None] * np.einsum("...ij,...kl->...ijkl", G, G)
    if stiffening is not None:
        Q, steep = F - G, 2 * stiffening * grown
        A = A + steep[..., None, None, None, None] * np.einsum("...ij,...kl->...ijkl", Q, Q)
    return np.asarray(A)


NEO_HOOKEAN = Law(_stress, _tangent)
"""W = μ/2 (tr FᵀF − 3) − μ ln J + λ/2 (ln J)², linear elasticity for small strain. With a stiffening b, the terms with μ are
those of Demiray's law (J. Biomech. 5 (1972) 309): μ/2b (exp(b (tr FᵀF − 3 − 2 ln J)) − 1)."""


class FiniteStrain:
    """Hyperelastic equilibrium of a tissue at finite strain; `push` answers like a model, to rounding.

    element: "P1" or "P2"; None: the tissue's own. degree: that quadrature is exact to. Contacts are those of
    `FiniteElements`: Wᵀu = d, traction at rest.
    """

    def __init__(
        self, tissue: Tissue, element: str | None = None, law: Law = NEO_HOOKEAN, degree: int | None = None
    ) -> None:
        chosen = tissue.element if element is None else element
        if chosen not in _DEGREE:
            raise MaterialError(f'element: {chosen!r} is not built at finite strain; choose "smoothed", "P1" or "P2"')
        self.tissue, self.law = tissue, law
        self.linear = FiniteElements(tissue, chosen)
        space = self.linear.space.with_element(self.linear.space.elem.elem)  # of one component
        space = type(space)(space.mesh, space.elem, intorder=degree or _DEGREE[chosen])
        self._slope = np.stack([field[0].grad for field in space.basis]).transpose(2, 3, 0, 1)  # (M, q, shapes, 3)
        self._weight: Float64 = space.dx
        self._unknown = self.linear.space.element_dofs.T  # (M, 3 shapes), the components of a shape side by side
        constants = lame(tissue.young, tissue.poisson) + ((tissue.stiffening,) if tissue.stiffening.any() else ())
        self._constants = tuple(np.tile(c[:, None], space.dx.shape[1]) for c in constants)

    def deformation(self, u: Float64) -> Float64:
        """(M, q, 3, 3) F at the points of quadrature of each tet."""
        moved = u[self._unknown].reshape(len(self._unknown), -1, 3)
        return np.asarray(np.eye(3) + np.einsum("mai,mqaj->mqij", moved, self._slope))

    def force(self, u: Float64) -> Float64:
        """(unknowns,) N that holds the tissue at displacement u (unknowns,)."""
        P = self.law.stress(self.deformation(u), *self._constants)
        local = np.einsum("mqij,mqaj,mq->mai", P, self._slope, self._weight)
        return np.bincount(self._unknown.ravel(), local.ravel(), len(u)).astype(np.float64)

    def tangent(self, u: Float64) -> csr_array:
        """(unknowns, unknowns) N/mm: derivative of `force`."""
        F, size = self.deformation(u), self._unknown.shape[1]
        value = np.empty((len(F), size, size))
        for first in range(0, len(F), _CHUNK):
            part = slice(first, first + _CHUNK)
            A = self.law.tangent(F[part], *(c[part] for c in self._constants))
            half = np.einsum("mqijkl,mqbl,mq->mqijbk", A, self._slope[part], self._weight[part], optimize=True)
            local = np.einsum("mqaj,mqijbk->maibk", self._slope[part], half, optimize=True)
            value[part] = local.reshape(-1, size, size)
        row = np.repeat(self._unknown, size, axis=1).ravel()
        column = np.tile(self._unknown, size).ravel()
        return csr_array(coo_array((value.ravel(), (row, column)), shape=(len(u), len(u))))

    def push(self, points: ArrayLike, displacements: ArrayLike, radii: ArrayLike) -> Answer:
        """The answer of finite strain to m glued contacts; arguments as for every model's `push`.

        `error` is the residual relative to the tools' forces. Raises `DataError` where no increment, however small,
        leads on: a tool too deep for the mesh, or an instability.
        """
        found = contacts(self.tissue, points, displacements, radii)
        W, goal = self.linear.loads(found), found.displacement.ravel()
        u, multiplier = np.zeros(len(W)), np.zeros(W.shape[1])
        reached, part = 0.0, 1.0
        while reached < 1:
            trial = self._equilibrium(u, multiplier, W, min(reached + part, 1.0) * goal)
            if trial is not None:
                u, multiplier = trial
                reached = min(reached + part, 1.0)
                part *= 1.5
            elif (part := part / 2) < _LEAST_PART:
                raise DataError(
                    f"displacements: no equilibrium found beyond {100 * reached:.0f} % of the push, where elements of "
                    f"edge {self.tissue.edge:.3g} mm are nearly flat or buckle; give a smaller push or a finer mesh"
                )
        free = self.linear.free
        load = (W @ multiplier)[free]
        error = float(np.linalg.norm(self.force(u)[free] - load) / max(float(np.linalg.norm(load)), 1e-300))
        return found.answer(self.tissue, -multiplier.reshape(-1, 3), u[self.linear.nodal], error, 0, None)

    def _equilibrium(self, u: Float64, multiplier: Float64, W: Float64, d: Float64) -> tuple[Float64, Float64] | None:
        """Newton's method from u; None where it does not converge, an element turns or the tangent is not positive."""
        free, size = self.linear.free, 0.0
        for _ in range(_NEWTON):
            residual = (self.force(u) - W @ multiplier)[free]
            gap = d - W.T @ u
            if not np.isfinite(residual).all():
                return None
            size = max(size, float(np.abs(W @ multiplier).max()))
            if np.abs(residual).max() <= 1e-11 * size and np.abs(gap).max() <= 1e-11 * max(
                float(np.abs(d).max()), 1e-9
            ):
                return u, multiplier
            factors = Factors(self.tangent(u)[free][:, free], self.linear.space.doflocs[:, free[::3]].T)
            if not factors.positive:
                return None
            columns = factors.solve(np.column_stack([W[free], -residual]))
            C = W[free].T @ columns
            change = np.linalg.solve(C[:, :-1], gap - C[:, -1])
            multiplier = multiplier + change
            u = u.copy()
            u[free] += columns[:, -1] + columns[:, :-1] @ change
            if np.linalg.det(self.deformation(u)).min() <= 0:
                return None
        return None
