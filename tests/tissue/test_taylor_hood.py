"""Displacement and pressure together: no locking up to ν = 0.5, and the orders that theory gives them."""

import numpy as np
import pytest
import skfem
from hypothesis import given, settings
from hypothesis import strategies as st
from skfem.helpers import div, dot
from support.brick_meshes import block, brick

import palpate as pp
from palpate.errors import MaterialError
from palpate.tissue.contact_patches import contacts

TOP = np.array([25.0, 25.0, 50.0])


def prescribed(fe, field):
    """The unknowns of `field` (3, n) -> (3, n) mm at every place, pressures 0."""
    places = fe.space.doflocs
    value, g = field(places), np.zeros(fe.K.shape[0])
    for k in range(3):
        for unknowns in (fe.space.nodal_dofs[k], fe.space.edge_dofs[k]):
            g[unknowns] = value[k, unknowns]
    return g


def bent(n):
    """L2 errors of displacement (mm) and pressure (kPa) for u = (y²z, z²x, x²y), p = xyz kPa, ν = 0.5, top face free."""
    mesh = brick((n, n, n), (1.0, 1.0, 1.0), warp=0.2)
    outside = ((mesh.nodes == 0) | (mesh.nodes == 1)).any(axis=1) & ~(
        (mesh.nodes[:, 2] == 1) & (mesh.nodes[:, :2] > 0).all(axis=1) & (mesh.nodes[:, :2] < 1).all(axis=1)
    )
    young = 3.0  # kPa, so that μ = 1e-3 N/mm²
    fe = pp.finite_elements(pp.Tissue(mesh, young, 0.5, outside, element="mixed"))
    mu = 1e-3

    def field(x):
        return np.stack([x[1] ** 2 * x[2], x[2] ** 2 * x[0], x[0] ** 2 * x[1]])

    def body(v, w):  # −μ Δu − ∇p
        x, y, z = w.x
        return -mu * (2 * z + y * z) * v[0] - mu * (2 * x + x * z) * v[1] - mu * (2 * y + x * y) * v[2]

    def traction(v, w):  # σ e_z on the top face z = 1
        x, y, z = w.x
        shear = (y**2 + 2 * x * y, 2 * z * x + x**2)
        return mu * (shear[0] * v[0] + shear[1] * v[1] + x * y * z * v[2])

    load = np.zeros(fe.K.shape[0])
    load[: fe.space.N] = skfem.LinearForm(body).assemble(fe.space)
    skin = skfem.FacetBasis(fe.space.mesh, fe.space.elem, facets=fe.space.mesh.facets_satisfying(lambda x: x[2] == 1))
    load[: fe.space.N] += skfem.LinearForm(traction).assemble(skin)
    g = np.where(np.isin(np.arange(len(load)), fe.free), 0, prescribed(fe, field))
    found = g + fe.solve((load - fe.K @ g)[:, None])[:, 0]
    fine = skfem.Basis(fe.space.mesh, fe.space.elem, intorder=6)
    gap = fine.interpolate(found[: fe.space.N])
    exact = field(fine.global_coordinates())
    pressure = fine.with_element(skfem.ElementTetP1()).interpolate(found[fe.space.N :] * (mu / fe.tissue.edge))
    off = [
        ((np.asarray(gap) - exact) ** 2).sum(axis=0),
        (np.asarray(pressure) / mu - fine.global_coordinates().prod(axis=0)) ** 2,
    ]
    return np.array([np.sqrt((o * fine.dx).sum()) for o in off])


def test_halving_incompressible_elements_divides_the_error_by_eight_and_that_of_the_pressure_by_four():
    coarse, fine = bent(2), bent(4)
    assert (coarse > 1e-5).all()
    order = np.log2(coarse / fine)
    assert order[0] > 2.7
    assert order[1] > 1.8


@settings(max_examples=8, deadline=None)
@given(st.lists(st.floats(-0.05, 0.05), min_size=9, max_size=9), st.sampled_from([0.0, 0.2, 0.4999, 0.5]))
def test_a_linear_displacement_is_reproduced_with_mixed_materials(slopes, poisson):
    """Materials differ in ν, not in μ; the displacement keeps the volume, so that one state of stress fits all."""
    slope = np.array(slopes).reshape(3, 3)
    slope -= np.trace(slope) / 3 * np.eye(3)
    mesh = brick((3, 2, 3), (30, 20, 40), warp=0.3)
    ratio = np.where(np.arange(len(mesh.tets)) % 2, 0.3, poisson)
    fe = pp.finite_elements(pp.Tissue(mesh, 5 * (1 + ratio), ratio, mesh.nodes[:, 2] == 0, element="mixed"))
    u = prescribed(fe, lambda x: slope @ x)
    g = np.where(np.isin(np.arange(len(u)), fe.free), 0, u)
    load = np.zeros((len(u), 1))
    sigma = 2 * 5e-3 / 2 * (slope + slope.T) / 2
    skin = skfem.FacetBasis(fe.space.mesh, fe.space.elem)
    load[: fe.space.N, 0] = skfem.LinearForm(lambda v, w: dot(np.einsum("ij,j...->i...", sigma, w.n), v)).assemble(skin)
    found = g + fe.solve(load - (fe.K @ g)[:, None])[:, 0]
    np.testing.assert_allclose(found[: fe.space.N], u[: fe.space.N], atol=1e-9 * max(np.abs(u).max(), 1))


def test_linear_elements_lock_and_mixed_ones_do_not():
    force = {}
    for element in ("P1", "mixed"):
        for poisson in (0.45, 0.4999):
            tissue = block(6, poisson=poisson, element=element)
            force[element, poisson] = -pp.finite_elements(tissue).push(TOP, [0, 0, -1.0], 20.0).force[2]
    stiffer = {element: force[element, 0.4999] / force[element, 0.45] for element in ("P1", "mixed")}
    assert stiffer["P1"] > 1.8  # and ever more as ν nears 0.5
    assert 1 < stiffer["mixed"] < 1.1


def test_mixed_and_quadratic_elements_agree_where_nothing_locks():
    far, near = (
        abs(
            pp.finite_elements(tissue, "mixed").push(TOP, [0, 0, -1.0], 20.0).force[2]
            / pp.finite_elements(tissue, "P2").push(TOP, [0, 0, -1.0], 20.0).force[2]
            - 1
        )
        for tissue in (block(4), block(7))
    )
    assert near < 0.5 * far
    assert near < 5e-3


def test_the_limit_of_one_half_is_reached_smoothly():
    force = [
        pp.finite_elements(block(5, poisson=nu, element="mixed")).push(TOP, [1, 2, -3.0], 20.0).force
        for nu in (0.5 - 1e-3, 0.5 - 1e-5, 0.5)
    ]
    far, near = (np.linalg.norm(f - force[2]) / np.linalg.norm(force[2]) for f in force[:2])
    assert 1e-6 < near < 1e-4
    assert far == pytest.approx(100 * near, rel=0.05)  # the difference is that of 1/λ


def test_an_incompressible_tumour_in_compressible_fat():
    mesh = brick((5, 5, 5), region=lambda x: 1 + (np.linalg.norm(x - [25, 25, 35], axis=1) < 12))
    bottom = mesh.nodes[:, 2] == 0
    tissue = pp.Tissue(mesh, {1: 5.0, 2: 40.0}, {1: 0.3, 2: 0.5}, bottom, element="mixed")
    fe = pp.finite_elements(tissue)
    answer = fe.push(TOP, [0, 0, -2.0], 20.0)
    plain = pp.finite_elements(pp.Tissue(mesh, 5.0, 0.3, bottom, element="mixed")).push(TOP, [0, 0, -2.0], 20.0)
    assert answer.error < 1e-9
    assert 1.05 < answer.force[2] / plain.force[2] < 3
    load = fe.loads(contacts(tissue, TOP, np.zeros(3), 20.0))[:, [2]]
    u = fe.solve(load)[:, 0]
    swelling = skfem.Functional(lambda w: w.inside * div(w.u))
    strain = [
        swelling.assemble(fe.space, u=u[: fe.space.N], inside=np.tile(inside[:, None], fe.space.dx.shape[1]) * 1.0)
        / mesh.volumes[inside].sum()
        for inside in (mesh.region == 2, mesh.region == 1)
    ]
    assert abs(strain[1]) > 1e-3  # of the push of 1 N
    assert abs(strain[0]) < 1e-9 * abs(strain[1])  # the tumour as a whole keeps its volume exactly


def test_one_half_is_refused_where_it_cannot_be_solved():
    tissue = block(4, poisson=0.5, element="mixed")
    for ask in (lambda: pp.finite_elements(tissue, "P1"), lambda: pp.model(tissue, "blocks")):
        with pytest.raises(MaterialError, match="mixed"):
            ask()
    with pytest.raises(MaterialError, match=r"P3.*mixed"):
        pp.finite_elements(tissue, "P3")
    contacts(tissue, TOP, np.zeros(3), 20.0)  # contacts do not mind
