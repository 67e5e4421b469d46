"""The force of the continuum: Taylor-Hood elements on a mesh that is bisected under the contact.

It shares the polyhedron, the support and the contact's density φ with the models, but no element, no weights and no
quadrature: displacement is quadratic, and φ itself stands at the points of a rule on each small facet. The pressure is
linear and continuous within a region, so that coarse tets far from the contact do not lock: quadratic displacements alone
do, by 2 % of the force on kidneys of 6 mm edges at ν = 0.49, and bisection under the contact does not show it.
"""

import logging
from collections.abc import Sequence
from typing import Any

import numpy as np
import skfem
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree
from skfem.helpers import ddot, div, sym_grad

import palpate as pp
from palpate.tissue.sparse_factor import Factors

Array = NDArray[np.float64]
_ORDER = 8  # of the rule on each facet
logging.getLogger("skfem").setLevel(logging.ERROR)  # it tells of each array that it copies


def compliance(tissue: pp.Tissue, point: Array, radius: float, levels: int = 1, reach: float = 1.7) -> Array:
    """(3, 3) mm/N: the mean ∫φu/∫φ over the patch at `point` under unit forces with the density φ.

    levels: how often the tets nearer than `reach` radii are bisected, the later ones nearer than that. φ = (1 − d²/r²)²
    with d² twice the squared distance over 1 + n·n_q, as the models define it.
    """
    return compliances([tissue], point, radius, levels, reach)[0]


def compliances(
    tissues: Sequence[pp.Tissue], point: Array, radius: float, levels: int = 1, reach: float = 1.7
) -> list[Array]:
    """`compliance` of tissues of one mesh and support, the shear moduli of which are in proportion: one factor serves all."""
    tissue = tissues[0]
    hit = tissue.surface.closest(np.ascontiguousarray(point))
    coarse = _mesh(tissue)
    mesh = coarse
    for level in range(levels):
        apart = np.linalg.norm(mesh.p[:, mesh.t].mean(axis=1) - hit.point[:, None], axis=0)
        near = apart < reach * radius / (1 + level / 2)
        mesh = mesh.refined(np.flatnonzero(near))
    align = np.zeros(len(tissue.mesh.nodes))
    align[tissue.surface.nodes] = 1 + tissue.surface.normals @ tissue.surface.normal(hit)
    align, held = _carried(coarse, mesh, align), _carried(coarse, mesh, tissue.held.astype(float)) > 1 - 1e-6
    parent, _ = _located(coarse, mesh.p[:, mesh.t].mean(axis=1))
    space = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTetP2()), intorder=2)
    free, load = _free(space, held), _loads(space, align, hit.point, radius)
    first = _lame(tissue)[1]
    shear = _shear_stiffness(space, first[parent])
    factors, found = Factors(shear[free][:, free], space.doflocs[:, free[::3]].T), []
    for each in tissues:
        lam, mu = _lame(each)
        stiffer = mu[0] / first[0]
        np.testing.assert_allclose(mu, stiffer * first, rtol=1e-12)
        B, C, like = _pressure(space, lam[parent] / stiffer, first[parent], tissue.mesh.region[parent])
        u = _solved(factors, csr_array(B[:, free]), C, like, load[free])
        found.append(np.asarray(load[free].T @ u) / stiffer)
    return found


def _lame(tissue: pp.Tissue) -> tuple[Array, Array]:
    """λ and μ of each tet, N/mm²."""
    E, nu = tissue.young * 1e-3, tissue.poisson
    return E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))


def _solved(factors: Factors, B: csr_array, C: csr_array, like: Array, load: Array) -> Array:
    """u of A u + Bᵀp = load, B u = C p: conjugate gradients on (B A⁻¹ Bᵀ + C) p = B A⁻¹ load, `like` its diagonal."""
    u = factors.solve(load)
    p, r = np.zeros((B.shape[0], load.shape[1])), B @ u
    z = r / like[:, None]
    way, size = z.copy(), (r * z).sum(axis=0)
    enough = 1e-12 * size
    while (size > enough).any():
        moved = factors.solve(B.T @ way)
        image = B @ moved + C @ way
        step = size / (way * image).sum(axis=0)
        p, u, r = p + step * way, u - step * moved, r - step * image
        z = r / like[:, None]
        before, size = size, (r * z).sum(axis=0)
        way = z + size / before * way
    return u


def _mesh(tissue: pp.Tissue) -> Any:
    return skfem.MeshTet(np.ascontiguousarray(tissue.mesh.nodes.T), tissue.mesh.tets.T.astype(np.int64))


def _carried(coarse: Any, fine: Any, values: Array) -> Array:
    """The values at the coarse nodes, interpolated to the fine ones, of which the coarse ones come first."""
    count = coarse.p.shape[1]
    assert (fine.p[:, :count] == coarse.p).all()
    tet, share = _located(coarse, fine.p[:, count:])
    return np.concatenate([values, (values[coarse.t[:, tet]] * share).sum(axis=0)])


def _located(mesh: Any, x: Array) -> tuple[NDArray[np.int64], Array]:
    """The tet of each point x (3, n), which may lie on the surface up to rounding, and its barycentric coordinates (4, n).

    A large tet's middle may be further off than those of many small ones: what the nearest few do not hold is looked for
    among more.
    """
    tree, count = cKDTree(mesh.p[:, mesh.t].mean(axis=1).T), mesh.t.shape[1]
    tet, share = _within(mesh, x, tree.query(x.T, k=min(40, count))[1].T)
    lost = share.min(axis=0) < -1e-6
    if lost.any():
        tet[lost], share[:, lost] = _within(mesh, x[:, lost], tree.query(x[:, lost].T, k=min(1000, count))[1].T)
    assert (share > -1e-6).all()
    return tet, share


def _within(mesh: Any, x: Array, near: NDArray[np.int64]) -> tuple[NDArray[np.int64], Array]:
    """Of the tets near (k, n) the one that holds each point, or comes closest to it, and the coordinates in it."""
    corner = mesh.p[:, mesh.t[:, near]]  # (3, 4, k, n)
    sides = np.moveaxis(corner[:, 1:] - corner[:, :1], (0, 1), (-2, -1))
    part = np.linalg.solve(sides, np.moveaxis(x[:, None] - corner[:, 0], 0, -1)[..., None])[..., 0]
    share = np.concatenate([1 - part.sum(axis=-1, keepdims=True), part], axis=-1)  # (k, n, 4)
    best = share.min(axis=-1).argmax(axis=0)
    each = np.arange(x.shape[1])
    return near[best, each], share[best, each].T


def _free(space: Any, held: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Unknowns that may move: not of held nodes, nor of edges between two of them."""
    edges = held[space.mesh.edges].all(axis=0)
    still = np.concatenate([space.nodal_dofs[:, held].ravel(), space.edge_dofs[:, edges].ravel()])
    return np.setdiff1d(np.arange(space.N), still)


def _shear_stiffness(space: Any, mu: Array) -> csr_array:
    @skfem.BilinearForm
    def elastic(u: Any, v: Any, w: Any) -> Any:
        return 2 * w.mu * ddot(sym_grad(u), sym_grad(v))

    return csr_array(elastic.assemble(space, mu=np.tile(mu[:, None], space.dx.shape[1])))


def _pressure(space: Any, lam: Array, mu: Array, region: NDArray[np.int32]) -> tuple[csr_array, csr_array, Array]:
    """∫q div u, ∫pq/λ, and the diagonal ∫q (1/λ + 1/2μ), with one pressure for each node of a region."""
    broken = space.with_element(skfem.ElementDG(skfem.ElementTetP1()))
    own = space.mesh.t * (int(region.max()) + 1) + region
    number = np.unique(own, return_inverse=True)[1].reshape(own.shape)
    gather = csr_array((np.ones(own.size), (number.ravel(), broken.element_dofs.ravel())))

    def mass(factor: Array) -> csr_array:
        form = skfem.BilinearForm(lambda p, q, w: w.factor * p * q)
        return csr_array(gather @ form.assemble(broken, factor=np.tile(factor[:, None], space.dx.shape[1])) @ gather.T)

    B = skfem.BilinearForm(lambda u, q, w: div(u) * q).assemble(space, broken)
    return csr_array(gather @ B), mass(1 / lam), np.asarray(mass(1 / lam + 0.5 / mu).sum(axis=1))


def _loads(space: Any, align: Array, centre: Array, radius: float) -> Array:
    """(unknowns, 3) ∫φ v along each axis, over ∫φ."""
    mesh = space.mesh
    corner = mesh.p[:, mesh.facets]
    facets = mesh.boundary_facets()
    size = np.linalg.norm(corner[:, 1] - corner[:, 0], axis=0).max()
    facets = facets[np.linalg.norm(corner[:, :, facets].mean(axis=1) - centre[:, None], axis=0) < radius + size]
    skin = skfem.FacetBasis(mesh, space.elem, facets=facets, intorder=_ORDER)
    x = np.asarray(skin.global_coordinates())
    field = np.asarray(skin.with_element(skfem.ElementTetP1()).interpolate(align))
    square = 2 * ((x - centre[:, None, None]) ** 2).sum(axis=0) / np.maximum(field, 1e-9)
    phi = np.clip(1 - square / radius**2, 0, None) ** 2
    whole = float((phi * skin.dx).sum())
    forms = [skfem.LinearForm(lambda v, w, axis=axis: w.phi * v[axis]) for axis in range(3)]
    return np.stack([form.assemble(skin, phi=phi) / whole for form in forms], axis=1)
