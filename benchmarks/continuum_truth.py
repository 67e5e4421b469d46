"""The force of the continuum: quadratic elements on a mesh that is bisected under the contact.

It shares the polyhedron, the support and the contact's density φ with the models, but no element, no weights and no
quadrature: displacement is quadratic, and φ itself stands at the points of a rule on each small facet.
"""

import logging
from typing import Any

import numpy as np
import skfem
from numpy.typing import NDArray
from scipy.sparse import csr_array
from skfem.helpers import ddot, sym_grad, trace

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
    hit = tissue.surface.closest(np.ascontiguousarray(point))
    coarse = _mesh(tissue)
    mesh = coarse
    for level in range(levels):
        apart = np.linalg.norm(mesh.p[:, mesh.t].mean(axis=1) - hit.point[:, None], axis=0)
        near = apart < reach * radius / (1 + level / 2)
        mesh = mesh.refined(np.flatnonzero(near))
    align = np.zeros(len(tissue.mesh.nodes))
    align[tissue.surface.nodes] = 1 + tissue.surface.normals @ tissue.surface.normal(hit)
    align, held = _carried(coarse, mesh, align), _carried(coarse, mesh, tissue.held.astype(float)) > 1 - 1e-5
    parent = coarse.element_finder()(*mesh.p[:, mesh.t].mean(axis=1))
    space = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTetP2()), intorder=2)
    free, load = _free(space, held), _loads(space, align, hit.point, radius)
    E, nu = tissue.young[parent] * 1e-3, tissue.poisson[parent]
    K = _stiffness(space, E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu)))
    factors = Factors(K[free][:, free], space.doflocs[:, free[::3]].T)
    return np.asarray(load[free].T @ factors.solve(load[free]))


def _mesh(tissue: pp.Tissue) -> Any:
    return skfem.MeshTet(np.ascontiguousarray(tissue.mesh.nodes.T), tissue.mesh.tets.T.astype(np.int64))


def _carried(coarse: Any, fine: Any, values: Array) -> Array:
    """The values at the coarse nodes, interpolated to the fine ones, of which the coarse ones come first."""
    count = coarse.p.shape[1]
    assert (fine.p[:, :count] == coarse.p).all()
    out = np.concatenate([values, np.zeros(fine.p.shape[1] - count)])
    if len(out) > count:
        tet = np.zeros(len(out), dtype=np.int64)
        tet[fine.t] = np.arange(fine.t.shape[1])
        middle = fine.p[:, fine.t].mean(axis=1)[:, tet[count:]]
        inside = fine.p[:, count:] + 1e-7 * (middle - fine.p[:, count:])  # rounding puts nodes of the surface outside
        out[count:] = skfem.Basis(coarse, skfem.ElementTetP1()).probes(inside) @ values
    return out


def _free(space: Any, held: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Unknowns that may move: not of held nodes, nor of edges between two of them."""
    edges = held[space.mesh.edges].all(axis=0)
    still = np.concatenate([space.nodal_dofs[:, held].ravel(), space.edge_dofs[:, edges].ravel()])
    return np.setdiff1d(np.arange(space.N), still)


def _stiffness(space: Any, lam: Array, mu: Array) -> csr_array:
    points = space.dx.shape[1]

    @skfem.BilinearForm
    def elastic(u: Any, v: Any, w: Any) -> Any:
        return 2 * w.mu * ddot(sym_grad(u), sym_grad(v)) + w.lam * trace(sym_grad(u)) * trace(sym_grad(v))

    return csr_array(elastic.assemble(space, lam=np.tile(lam[:, None], points), mu=np.tile(mu[:, None], points)))


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
