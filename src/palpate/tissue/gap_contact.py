"""Contact between surfaces of one body: Signorini's law for the gaps between them."""

from collections.abc import Callable

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import nnls
from scipy.sparse import csc_array, csr_array

from palpate import _core
from palpate.arrays import Float64, Int32
from palpate.errors import DataError
from palpate.tissue.sparse_factor import Factors

MOST_GAPS = 1024
REGULAR = 1e-9  # of the mean entry on the diagonal
SETTLED = 1e-10  # of the largest force
MOST_TURNS = 500


class GapContact:
    """Gaps = rest + Nᵀu ≥ 0 mm, the forces p ≥ 0 N between their surfaces, and in each gap one of the two is 0.

    Without friction, and linear: the gaps are those of the surfaces at rest, whose normals do not turn. Let d be the
    displacements of tools, C the compliance of their patches, and D = WᵀK⁻¹N what the patches do under unit forces p. The
    forces of the tools are C⁻¹ (d − D p), and the gaps rest + DᵀC⁻¹d + (NᵀK⁻¹N − DᵀC⁻¹D) p: a linear complementarity
    problem.

    N: (3n, g) by free nodes, rest: (g,) mm. give: (g,) mm/N of springs across gaps, whose force is −Nᵀu over it, of any
    sign; 0: surfaces that may meet. vertices: free nodes that are touched or shown. native: all of it for the loop. Raises
    `DataError` for more than `MOST_GAPS` gaps.
    """

    def __init__(self, factors: Factors, N: csr_array, rest: Float64, give: Float64, vertices: Int32) -> None:
        if N.shape[1] > MOST_GAPS:
            raise DataError(
                f"contact: {N.shape[1]} gaps between surfaces, at most {MOST_GAPS}; take larger elements, or make the "
                f"model with contact=False"
            )
        self.N, self.rest, self.give = csc_array(N), rest, give
        nodes = np.unique(self.N.indices // 3).astype(np.int32)
        on = np.ascontiguousarray(self.N[(3 * nodes[:, None] + np.arange(3)).ravel()].toarray())
        wanted = np.union1d(vertices, nodes).astype(np.int32)
        moved = factors.native.partial_solve(nodes, on, wanted).reshape(len(wanted), 3, -1)
        W = on.T @ moved[np.searchsorted(wanted, nodes)].reshape(on.shape)
        self.W = np.ascontiguousarray((W + W.T) / 2)
        share = on.reshape(-1, 3, on.shape[1])
        gap, node = np.nonzero(np.abs(share).sum(axis=1).T)
        self.native = _core.compliance.GapConstraints(
            rest,
            give,
            self.W,
            np.ascontiguousarray(moved[np.searchsorted(wanted, vertices)]),
            np.searchsorted(gap, np.arange(on.shape[1] + 1)).astype(np.int32),
            nodes[node],
            np.ascontiguousarray(share[node, :, gap]),
        )

    def forces(
        self, C: Float64, moved: Float64, displacement: Float64, tools: Callable[[Float64], Float64]
    ) -> tuple[Float64, Float64]:
        """(m, 3) N of the tools on the tissue, and (g,) N in the gaps.

        moved: (3n, 3m) mm/N, K⁻¹ times unit forces on the patches. tools: forces by displacement, (m, 3) of both. If they
        are C⁻¹ times it, the answer is direct. Otherwise tools and gaps are solved in turn. Raises `DataError` if that
        does not settle.
        """
        D = np.asarray(self.N.T @ moved).T  # (3m, g)
        d = displacement.ravel()
        stiff = np.linalg.solve(C, D)
        p = complementarity(self.W - D.T @ stiff, self.rest + stiff.T @ d, self.give)
        force = tools(displacement - (D @ p).reshape(-1, 3))
        if np.allclose(force.ravel(), np.linalg.solve(C, d - D @ p), rtol=1e-9, atol=0):
            return force, p
        for _ in range(MOST_TURNS):
            p = complementarity(self.W, self.rest + D.T @ force.ravel(), self.give)
            before, force = force, tools(displacement - (D @ p).reshape(-1, 3))
            if np.abs(force - before).max() <= SETTLED * np.abs(force).max():
                return force, p
        raise DataError(
            "friction: no balance found of tools that slide and surfaces that meet; push less, or glue them"
        )


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
