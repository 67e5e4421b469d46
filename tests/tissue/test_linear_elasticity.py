"""The truth holds what theory says: patch test, order of convergence, beam, balance, scaling, symmetry."""

import numpy as np
import pytest
from scipy.sparse import eye_array
from support.brick_meshes import block, brick

import palpate as pp
from palpate.tissue.contact_patches import contacts
from palpate.tissue.reference.linear_elasticity import lame
from palpate.tissue.sparse_factor import Factors

TOP = np.array([25.0, 25.0, 50.0])


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_a_linear_displacement_is_reproduced_on_an_irregular_mesh(element):
    mesh = brick((4, 3, 5), (40, 30, 50), warp=0.3)
    outside = ((mesh.nodes == 0) | (mesh.nodes == [40, 30, 50])).any(axis=1)
    fe = pp.finite_elements(pp.Tissue(mesh, 7.0, 0.3, outside), element)
    slope = np.array([[0.01, 0.02, -0.03], [0.005, -0.01, 0.04], [0.02, 0.0, 0.03]])
    exact = fe.space.doflocs.T @ slope.T  # displacement wanted at the place of each unknown, all three components
    component = np.zeros(fe.K.shape[0], dtype=int)
    component[fe.nodal] = np.arange(3)
    if element == "P2":
        component[fe.space.edge_dofs.T] = np.arange(3)
    u = exact[np.arange(len(exact)), component]
    held = np.setdiff1d(np.arange(len(u)), fe.free)
    assert np.ptp(u[held]) > 0.5  # the boundary does move
    inner = fe.factors.solve(-(fe.K[fe.free][:, held] @ u[held]))
    np.testing.assert_allclose(inner, u[fe.free], atol=1e-12 * np.abs(u).max() * 1e2)


def _manufactured(n, nu=0.3, young=5.0):
    """L2 and energy error of u = (sin πx sin πy sin πz, 0, 0) on a unit cube of n cells a side, boundary held."""
    mesh = brick((n, n, n), (1.0, 1.0, 1.0))
    fe = pp.finite_elements(pp.Tissue(mesh, young, nu, ((mesh.nodes == 0) | (mesh.nodes == 1)).any(axis=1)))
    lam, mu = (float(c) for c in lame(young, nu))
    a, b = 0.5854101966249685, 0.1381966011250105  # four points, exact to degree 2
    shape = np.full((4, 4), b) + (a - b) * np.eye(4)
    x = np.einsum("qc,mcd->mqd", shape, mesh.nodes[mesh.tets])
    weight = mesh.volumes[:, None] / 4
    s, c = np.sin(np.pi * x), np.cos(np.pi * x)
    value = s.prod(axis=2)
    along = np.stack([np.pi * c[..., k] * np.delete(s, k, axis=2).prod(axis=2) for k in range(3)], axis=-1)
    mixed = [np.pi**2 * c[..., 0] * c[..., k] * s[..., 3 - k] for k in (1, 2)]
    body = np.stack([(lam + 4 * mu) * np.pi**2 * value, *[-(lam + mu) * m for m in mixed]], axis=-1)
    load = np.zeros(fe.K.shape[0])
    for corner in range(4):
        part = np.einsum("mq,q,mqd->md", weight * np.ones_like(value), shape[:, corner], body)
        np.add.at(load, fe.nodal[mesh.tets[:, corner]], part)
    u = fe.solve(load[:, None])[:, 0][fe.nodal]
    at = np.einsum("qc,mcd->mqd", shape, u[mesh.tets])
    exact = np.zeros_like(at)
    exact[..., 0] = value
    edges = mesh.nodes[mesh.tets[:, 1:]] - mesh.nodes[mesh.tets[:, :1]]
    slope = np.linalg.solve(edges, u[mesh.tets[:, 1:]] - u[mesh.tets[:, :1]]).transpose(0, 2, 1)  # du_i/dx_j
    gap = np.broadcast_to(slope[:, None], (*value.shape, 3, 3)).copy()
    gap[..., 0, :] -= along
    strain = (gap + gap.swapaxes(-1, -2)) / 2
    trace = np.trace(strain, axis1=-2, axis2=-1)
    energy = 2 * mu * (strain**2).sum(axis=(-1, -2)) + lam * trace**2
    return np.sqrt((weight * ((at - exact) ** 2).sum(axis=2)).sum()), np.sqrt((weight * energy).sum())


def test_halving_the_elements_quarters_the_error_and_halves_that_of_the_energy():
    coarse, middle, fine = (np.array(_manufactured(n)) for n in (4, 8, 16))
    assert coarse[0] > 1e-3
    order = np.log2(middle / fine)
    assert order[0] == pytest.approx(2, abs=0.2)
    assert order[1] == pytest.approx(1, abs=0.1)
    assert (middle < coarse).all()


def sag(length, side, cells, young, poisson, element):
    """mm at the end of a cantilever for 1 N across it, spread over its end face, of whose mean displacement it is."""
    mesh = brick(cells, (length, side, side))
    fe = pp.finite_elements(pp.Tissue(mesh, young, poisson, mesh.nodes[:, 0] == 0), element)
    load = fe.loads(contacts(fe.tissue, [length, side / 2, side / 2], [0, 0, 0], 6.0))[:, [2]]
    assert load.sum() == pytest.approx(1)
    return float((load * fe.solve(load)).sum())


@pytest.mark.parametrize("poisson", [0.0, 0.3])
def test_a_cantilever_bends_as_timoshenko_says(poisson):
    length, side, young = 120.0, 10.0, 5.0
    E, G = young * 1e-3, young * 1e-3 / (2 * (1 + poisson))
    shear = 10 * (1 + poisson) / (12 + 11 * poisson)  # Cowper's coefficient of a rectangle
    flexibility = length**3 / (3 * E * side**4 / 12) + length / (shear * G * side**2)  # mm/N
    assert sag(length, side, (24, 2, 2), young, poisson, "P2") == pytest.approx(flexibility, rel=0.015)


def test_a_cantilever_of_two_layers_of_smoothed_elements_is_hardly_too_stiff():
    """At ν = 0.49, where P1 elements give a tenth of the sag; the truth is quadratic elements on a finer mesh."""
    coarse = {element: sag(120.0, 10.0, (24, 2, 2), 5.0, 0.49, element) for element in ("smoothed", "P1")}
    truth = sag(120.0, 10.0, (36, 3, 3), 5.0, 0.49, "P2")
    assert coarse["smoothed"] == pytest.approx(truth, rel=0.10)
    assert coarse["P1"] < 0.2 * truth


def test_a_bar_stretched_without_sideways_strain_has_its_modulus():
    # ν = 0: a uniform bar pulled at its end follows Hooke with EA/L; kPa are 1e-3 N/mm².
    mesh = brick((2, 2, 8), (10, 10, 40))
    fe = pp.finite_elements(pp.Tissue(mesh, 8.0, 0.0, mesh.nodes[:, 2] == 0))
    end = np.flatnonzero(mesh.nodes[:, 2] == 40)
    u = np.zeros(fe.K.shape[0])
    u[fe.nodal[:, 2]] = mesh.nodes[:, 2] / 40  # 1 mm over 40 mm
    assert (fe.K @ u)[fe.nodal[end, 2]].sum() == pytest.approx(8e-3 * 100 / 40)


@pytest.fixture(scope="module")
def truth():
    return pp.finite_elements(block(9, poisson=0.4))


def test_forces_and_moments_sum_to_zero(truth):
    answer = truth.push(TOP, [1.0, -2.0, -4.0], 9.0)
    assert np.linalg.norm(answer.force) > 0.05
    np.testing.assert_allclose(truth.support_force(answer.displacement), answer.force, rtol=1e-9)
    u = np.zeros(truth.K.shape[0])
    u[truth.nodal] = answer.displacement
    outside = (truth.K @ u)[truth.nodal]
    moment = np.cross(truth.tissue.mesh.nodes, outside).sum(axis=0)
    np.testing.assert_allclose(moment, 0, atol=1e-9 * np.abs(np.cross(truth.tissue.mesh.nodes, outside)).sum())


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_the_patch_goes_where_the_tool_is_and_pushes_back(element):
    tissue = block(6, poisson=0.4, element=element)
    fe = pp.finite_elements(tissue)
    assert fe.element == element
    for way in np.eye(3):
        for sign in (1, -1):
            answer = fe.push(TOP, 3 * sign * way, 14.0)
            assert answer.force @ (sign * way) < 0
            assert answer.error < 1e-9
            if element == "P1":  # P2 prescribes the mean of its own, quadratic field
                np.testing.assert_allclose(answer.realised, 3 * sign * way, atol=1e-12)


def test_twice_as_stiff_is_twice_the_force_and_the_same_shape(truth):
    stiff = pp.finite_elements(block(9, young=10.0, poisson=0.4))
    a, b = (fe.push(TOP, [0.5, 1.0, -4.0], 9.0) for fe in (truth, stiff))
    np.testing.assert_allclose(b.force, 2 * a.force, rtol=1e-9)
    np.testing.assert_allclose(b.displacement, a.displacement, atol=1e-9)


def test_compliance_is_symmetric_between_contacts(truth):
    points = np.array([[15.0, 20.0, 50.0], [38.0, 30.0, 50.0]])
    k = np.zeros((6, 6))
    for column in range(6):
        k[:, column] = truth.push(points, np.eye(6)[column].reshape(2, 3), 9.0).force.ravel()
    np.testing.assert_allclose(k, k.T, atol=1e-9 * np.abs(k).max())
    assert (np.linalg.eigvalsh(k) < 0).all()  # force of the tissue on the tools: always against them


def test_linear_and_quadratic_elements_approach_each_other():
    far, near = (
        abs(pp.finite_elements(t, "P1").push(TOP, [0, 0, -1.0], 20.0).force[2] /
            pp.finite_elements(t, "P2").push(TOP, [0, 0, -1.0], 20.0).force[2] - 1)
        for t in (block(5), block(9))
    )  # fmt: skip
    assert near < 0.5 * far
    assert near < 0.1  # P1 is still this stiff; weights at the nodes, which soften, once hid half of it


def test_a_mirrored_push_gives_the_mirrored_field(truth):
    # The mesh is its own mirror image under x <-> y.
    swap = [1, 0, 2]
    order = np.lexsort(truth.tissue.mesh.nodes.round(6).T)
    mirrored = np.lexsort(truth.tissue.mesh.nodes[:, swap].round(6).T)
    a = truth.push([18.0, 30.0, 50.0], [1.0, 2.0, -3.0], 9.0)
    b = truth.push([30.0, 18.0, 50.0], [2.0, 1.0, -3.0], 9.0)
    np.testing.assert_allclose(b.displacement[mirrored][:, swap], a.displacement[order], atol=1e-9)
    assert np.abs(a.displacement).max() > 3


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_the_factors_solve_and_know_a_matrix_that_is_not_positive(element):
    fe = pp.finite_elements(block(4), element)
    K = fe.K[fe.free][:, fe.free]
    load = np.random.default_rng(1).standard_normal(len(fe.free))
    np.testing.assert_allclose(K @ fe.factors.solve(load), load, atol=1e-9)
    assert fe.factors.positive
    least = np.linalg.eigvalsh(K.toarray())[0]
    places = fe.space.doflocs[:, fe.free[::3]].T
    assert Factors(K - 0.99 * least * eye_array(K.shape[0]), places).positive
    assert not Factors(K - 1.01 * least * eye_array(K.shape[0]), places).positive
