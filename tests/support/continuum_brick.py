"""Forces on the 50 mm cube from quadratic elements with linear pressure, bisected under the contact: shares no code."""

import numpy as np
import skfem
from scipy.sparse import block_array
from scipy.sparse.linalg import splu
from skfem.helpers import ddot, div, sym_grad


@skfem.BilinearForm
def _shear(u, v, w):
    return 2 * w.mu * ddot(sym_grad(u), sym_grad(v))


@skfem.BilinearForm
def _dilatation(u, p, w):
    return p * div(u)


@skfem.BilinearForm
def _pressure(p, q, w):
    return p * q / w.lam


def compliance(mesh, young, poisson, point, radius, side=50.0, rounds=1):
    """(3, 3) mm/N of a patch on the top (z = side) of a cube held at z = 0. young: kPa, one or (M,)."""
    whole = tets = skfem.MeshTet(mesh.nodes.T.copy(), mesh.tets.T.astype(np.int64))
    for _ in range(rounds):
        middle = tets.p[:, tets.t].mean(axis=1).T
        tets = tets.refined(np.flatnonzero(np.linalg.norm(middle - point, axis=1) < 1.6 * radius))
    parent = whole.element_finder()(*tets.p[:, tets.t].mean(axis=1))
    E = np.broadcast_to(np.asarray(young, float) * 1e-3, len(mesh.tets))[parent]
    quadratic = skfem.Basis(tets, skfem.ElementVector(skfem.ElementTetP2()), intorder=4)
    linear = quadratic.with_element(skfem.ElementTetP1())
    each = np.ones(quadratic.dx.shape)
    mu, lam = E / (2 * (1 + poisson)), E * poisson / ((1 + poisson) * (1 - 2 * poisson))
    K = _shear.assemble(quadratic, mu=mu[:, None] * each)
    B = _dilatation.assemble(quadratic, linear)
    M = _pressure.assemble(linear, lam=lam[:, None] * each)
    top = tets.facets_satisfying(lambda x: np.abs(x[2] - side) < 1e-6 * side, boundaries_only=True)
    facets = skfem.FacetBasis(tets, skfem.ElementVector(skfem.ElementTetP2()), intorder=8, facets=top)

    def phi(x):
        return np.maximum(1 - ((x - np.reshape(point, (3, 1, 1))) ** 2).sum(axis=0) / radius**2, 0) ** 2

    total = skfem.Functional(lambda w: phi(w.x)).assemble(facets)
    load = np.stack([skfem.LinearForm(lambda v, w, k=k: v[k] * phi(w.x) / total).assemble(facets) for k in range(3)], 1)
    A = block_array([[K, B.T], [B, -M]]).tocsc()
    free = np.setdiff1d(np.arange(A.shape[0]), quadratic.get_dofs(lambda x: np.abs(x[2]) < 1e-9).all())
    right = np.zeros((A.shape[0], 3))
    right[: len(load)] = load
    solved = np.zeros_like(right)
    solved[free] = splu(A[free][:, free]).solve(right[free])
    return load.T @ solved[: len(load)]
