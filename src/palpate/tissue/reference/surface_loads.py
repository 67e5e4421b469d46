"""Loads of a contact patch on quadratic elements, by quadrature of its density itself on the facets."""

from typing import Any

import numpy as np
import skfem

from palpate import _core
from palpate.arrays import Float64, Int32
from palpate.tissue.tissue import Tissue

_PARTS, _ORDER = 4, 6  # each side of a facet is cut in so many parts, with a rule of this order on each piece


def surface_loads(space: Any, tissue: Tissue, hit: "_core.tissue.SurfacePoint", radius: float) -> Float64:
    """Return the loads of a unit force with the density φ = (1 − d²/r²)₊² over a contact patch.

    Parameters
    ----------
    space : skfem.Basis
        Quadratic vector functions on the tissue's mesh.
    tissue : Tissue
        The solid.
    hit : SurfacePoint
        The middle of the patch.
    radius : float
        Its radius r, mm.

    Returns
    -------
    ndarray, (unknowns, 3)
        ∫N_i φ / ∫φ, one column for each axis; 0 at held unknowns, and the others of a column sum to 1. Where no node
        lies inside the radius, a force at the point itself.
    """
    mesh, surface = space.mesh, tissue.surface
    triangles = tissue.mesh.surface[surface.patch_triangles(hit, radius)]
    scalar = skfem.ElementTetP2()
    if not (_density(tissue, hit, radius, tissue.mesh.nodes)[np.unique(triangles)] > 0).any():
        unknown, value = _point_loads(space, tissue, hit)
    else:
        facets = skfem.FacetBasis(mesh, scalar, facets=_facets(mesh, triangles), quadrature=composite_rule())
        linear = facets.with_element(skfem.ElementTetP1())
        align = linear.interpolate(patch_alignment(tissue, hit))
        x = np.asarray(facets.global_coordinates())
        distance2 = ((x - hit.point[:, None, None]) ** 2).sum(axis=0)
        falloff = np.clip(1 - 2 * distance2 / (np.maximum(np.asarray(align), 1e-9) * radius**2), 0, None) ** 2
        value = skfem.LinearForm(lambda v, w: w.falloff * v).assemble(facets, falloff=falloff)
        unknown = np.empty((facets.N, 3), dtype=np.int64)
        unknown[facets.nodal_dofs[0]] = space.nodal_dofs.T
        unknown[facets.edge_dofs[0]] = space.edge_dofs.T
    held = tissue.held[mesh.edges].all(axis=0)
    still = np.zeros(space.N, dtype=bool)
    still[space.nodal_dofs[:, tissue.held]] = True
    still[space.edge_dofs[:, held]] = True
    out = np.zeros((space.N, 3))
    for k in range(3):
        out[unknown[:, k], k] = np.where(still[unknown[:, k]], 0, value)
    return np.asarray(out / out.sum(axis=0))


def patch_alignment(tissue: Tissue, hit: "_core.tissue.SurfacePoint") -> Float64:
    """(N,) 1 + n·n_a at surface nodes, n the contact's normal; 0 elsewhere."""
    align = np.zeros(len(tissue.mesh.nodes))
    align[tissue.surface.nodes] = 1 + tissue.surface.normals @ tissue.surface.normal(hit)
    return align


def _density(tissue: Tissue, hit: "_core.tissue.SurfacePoint", radius: float, x: Float64) -> Float64:
    """(N,) 1 − d²/r² at the nodes `x` (N, 3) mm, as the patch takes it."""
    align = np.maximum(patch_alignment(tissue, hit), 1e-9)
    return np.asarray(1 - 2 * ((x - hit.point) ** 2).sum(axis=1) / (align * max(radius, 1e-300) ** 2))


def _facets(mesh: Any, triangles: Int32) -> Int32:
    """Numbers of the mesh's facets with the corners `triangles` (T, 3)."""
    n = mesh.p.shape[1]
    every = np.sort(mesh.facets, axis=0).astype(np.int64)
    wanted = np.sort(triangles.astype(np.int64), axis=1)
    key, ask = (every[0] * n + every[1]) * n + every[2], (wanted[:, 0] * n + wanted[:, 1]) * n + wanted[:, 2]
    order = np.argsort(key)
    return np.asarray(order[np.searchsorted(key[order], ask)], dtype=np.int32)


def composite_rule() -> tuple[Float64, Float64]:
    """Points (2, q) and weights (q,) on the unit triangle, cut into `_PARTS`² pieces: φ has a kink on the patch's rim."""
    x, w = skfem.quadrature.get_quadrature(skfem.MeshTri.elem().refdom, _ORDER)
    h, points = 1 / _PARTS, []
    for i in range(_PARTS):
        for j in range(_PARTS - i):
            points.append(h * (x + [[i], [j]]))
            if i + j < _PARTS - 1:
                points.append(h * (np.array([[i + 1], [j + 1]]) - x))
    return np.concatenate(points, axis=1), np.tile(w * h * h, len(points))


def _point_loads(space: Any, tissue: Tissue, hit: "_core.tissue.SurfacePoint") -> tuple[Int32, Float64]:
    """Unknowns (6, 3) and values (6,) of the quadratic functions of the hit's triangle, at the hit."""
    corners, part = tissue.mesh.surface[hit.triangle], hit.weights
    ends = np.sort(space.mesh.edges, axis=0)
    unknown, value = [space.nodal_dofs[:, corners].T], [part * (2 * part - 1)]
    for a, b in ((0, 1), (1, 2), (2, 0)):
        low, high = sorted((corners[a], corners[b]))
        at = int(np.flatnonzero((ends[0] == low) & (ends[1] == high))[0])
        unknown.append(space.edge_dofs[:, [at]].T)
        value.append(np.array([4 * part[a] * part[b]]))
    return np.concatenate(unknown), np.concatenate(value)
