"""Contact between surfaces of one body: Signorini's law for the gaps between them."""

from collections.abc import Callable

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import nnls
from scipy.sparse import csc_array, hstack

from palpate import _core
from palpate.arrays import Float64, Int32
from palpate.errors import DataError
from palpate.tissue.sparse_factor import Factors
from palpate.tissue.surface_gaps import SurfaceGaps

MOST_GAPS = 1024
REGULAR = 1e-9  # of the mean entry on the diagonal
SETTLED = 1e-10  # of the largest force
MOST_TURNS = 500
MOST_STEPS = 5000


class GapContact:
    """Gaps = rest + Nᵀu ≥ 0 mm, the forces p ≥ 0 N between their surfaces, and in each gap one of the two is 0.

    Linear: the gaps are those of the surfaces at rest, whose normals do not turn. With friction the surfaces slip by
    s = Tᵀu, and a force q acts against that: |q| ≤ μ p, and q = −μ p s/|s| where they slip (Coulomb). A push is one step
    from rest, so s is the whole way; the loop counts it from where the surfaces stuck last.

    Let d be the displacements of tools, C the compliance of their patches, A = (N, T) and D = WᵀK⁻¹A what the patches do
    under unit forces (p, q). The forces of the tools are C⁻¹ (d − D (p, q)), and gaps and slips
    (rest, 0) + DᵀC⁻¹d + (AᵀK⁻¹A − DᵀC⁻¹D) (p, q).

    found: the gaps, by free nodes, with their slips if there is friction. give: (g,) mm/N of springs across gaps, whose
    force is −Nᵀu over it, of any sign; 0: surfaces that may meet. friction: μ. vertices: free nodes that are touched or
    shown. native: all of it for the loop. Raises `DataError` for more than `MOST_GAPS` gaps.
    """

    def __init__(self, factors: Factors, found: SurfaceGaps, give: Float64, friction: float, vertices: Int32) -> None:
        self.count = len(found.rest)
        if self.count > MOST_GAPS:
            raise DataError(
                f"contact: {self.count} gaps between surfaces, at most {MOST_GAPS}; take larger elements, or make the "
                f"model with contact=False"
            )
        self.A = csc_array(hstack([found.N, found.T]))
        self.rest, self.give, self.friction = found.rest, give, friction
        nodes = np.unique(self.A.indices // 3).astype(np.int32)
        on = np.ascontiguousarray(self.A[(3 * nodes[:, None] + np.arange(3)).ravel()].toarray())
        wanted = np.union1d(vertices, nodes).astype(np.int32)
        moved = factors.native.partial_solve(nodes, on, wanted).reshape(len(wanted), 3, -1)
        W = on.T @ moved[np.searchsorted(wanted, nodes)].reshape(on.shape)
        self.W = np.ascontiguousarray((W + W.T) / 2)
        share = on.reshape(-1, 3, on.shape[1])
        row, node = np.nonzero(np.abs(share).sum(axis=1).T)
        self.native = _core.compliance.GapConstraints(
            self.rest,
            give,
            friction,
            self.W,
            np.ascontiguousarray(moved[np.searchsorted(wanted, vertices)]),
            np.searchsorted(row, np.arange(on.shape[1] + 1)).astype(np.int32),
            nodes[node],
            np.ascontiguousarray(share[node, :, row]),
        )

    def forces(
        self, C: Float64, moved: Float64, displacement: Float64, tools: Callable[[Float64], Float64]
    ) -> tuple[Float64, Float64]:
        """(m, 3) N of the tools on the tissue, and (r,) N in the gaps: p, then with friction q.

        moved: (3n, 3m) mm/N, K⁻¹ times unit forces on the patches. tools: forces by displacement, (m, 3) of both. If they
        are C⁻¹ times it, the answer is direct. Otherwise tools and gaps are solved in turn. Raises `DataError` if that
        does not settle.
        """
        D = np.asarray(self.A.T @ moved).T  # (3m, r)
        d = displacement.ravel()
        stiff = np.linalg.solve(C, D)
        p = self._solved(self.W - D.T @ stiff, stiff.T @ d)
        force = tools(displacement - (D @ p).reshape(-1, 3))
        if np.allclose(force.ravel(), np.linalg.solve(C, d - D @ p), rtol=1e-9, atol=0):
            return force, p
        for _ in range(MOST_TURNS):
            p = self._solved(self.W, D.T @ force.ravel())
            before, force = force, tools(displacement - (D @ p).reshape(-1, 3))
            if np.abs(force - before).max() <= SETTLED * np.abs(force).max():
                return force, p
        raise DataError(
            "friction: no balance found of tools that slide and surfaces that meet; push less, or glue them"
        )

    def _solved(self, M: Float64, moved: Float64) -> Float64:
        """(r,) N of gaps and slips that are moved by (r,) mm, and by M times the forces."""
        g = self.count
        if self.friction == 0:
            return complementarity(M, self.rest + moved, self.give)
        p, q = np.zeros(g), np.zeros(2 * g)
        for _ in range(MOST_TURNS):
            before = np.concatenate([p, q])
            p = complementarity(M[:g, :g], self.rest + moved[:g] + M[:g, g:] @ q, self.give)
            q = rubbing(M[g:, g:], moved[g:] + M[g:, :g] @ p, self.friction * np.where(self.give == 0, p, 0), q)
            both = np.concatenate([p, q])
            if np.abs(both - before).max() <= SETTLED * np.abs(p).max():
                return both
        raise DataError("surface_friction: no balance found of surfaces that slide; give less friction, or push less")


def rubbing(M: Float64, slip: Float64, cone: Float64, start: Float64) -> Float64:
    """The q of least ½ qᵀM q + slipᵀq with |q| ≤ cone in each pair, (2g,): the dissipation by given forces is greatest.

    Accelerated projected gradients with restart (B. O'Donoghue & E. Candès, Found. Comput. Math. 15 (2015) 715). M: (2g, 2g),
    positive semidefinite. cone: (g,) N. start: (2g,).
    """
    rate = 1 / max(float(np.abs(M).sum(axis=1).max()), 1e-300)  # at least the largest eigenvalue
    q, ahead, momentum = start, start, 1.0
    for _ in range(MOST_STEPS):
        slope = slip + M @ ahead
        free = (ahead - rate * slope).reshape(-1, 2)
        size = np.linalg.norm(free, axis=1)
        kept = np.where(size > cone, cone / np.maximum(size, 1e-300), 1.0)
        after = (free * kept[:, None]).ravel()
        step = after - q
        if np.abs(step).max(initial=0) <= SETTLED * np.abs(cone).max(initial=0):
            return after
        if slope @ step > 0:
            momentum = 1.0
        following = (1 + np.sqrt(1 + 4 * momentum**2)) / 2
        ahead = after + (momentum - 1) / following * step
        q, momentum = after, following
    return q


def complementarity(M: Float64, q: Float64, give: Float64 | None = None) -> Float64:
    """The p ≥ 0 with q + M p ≥ 0 and p·(q + M p) = 0, (g,): the least of ½ pᵀM p + qᵀp. M: positive semidefinite.

    Where give is not 0, p has any sign, and q + M p + give p = 0.
    """
    if give is not None and give.any():
        return _with_springs(M, q, give)
    if (q >= 0).all():
        return np.zeros(len(q))
    # Gaps may depend on each other. Regularised (Tikhonov), the forces are the least of those that solve the problem.
    root = np.linalg.cholesky((M + M.T) / 2 + REGULAR * np.trace(M) / len(M) * np.eye(len(M))).T
    return np.asarray(nnls(root, -solve_triangular(root, q, trans="T"), maxiter=100 * len(q))[0])


def _with_springs(M: Float64, q: Float64, give: Float64) -> Float64:
    """The springs' forces are eliminated."""
    S, U = np.flatnonzero(give), np.flatnonzero(give == 0)
    own = M[np.ix_(S, S)] + np.diag(give[S])
    by_others, alone = np.linalg.solve(own, M[np.ix_(S, U)]), np.linalg.solve(own, q[S])
    p = np.zeros(len(q))
    if len(U):
        p[U] = complementarity(M[np.ix_(U, U)] - M[np.ix_(U, S)] @ by_others, q[U] - M[np.ix_(U, S)] @ alone)
    p[S] = -alone - by_others @ p[U]
    return p
