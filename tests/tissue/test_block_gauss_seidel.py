"""Block ring sweeps are finite elements: they converge to the direct solution, and say how far they still are."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.brick_meshes import block, brick

import palpate as pp
from palpate import _core

TOP = np.array([25.0, 25.0, 50.0])


@pytest.fixture(scope="module")
def tissue():
    mesh = brick((8, 8, 8), warp=0.2, region=lambda c: np.where(np.linalg.norm(c - [25, 25, 35], axis=1) < 10, 2, 1))
    return pp.Tissue(mesh, {1: 3.25, 2: 42.5}, {1: 0.3, 2: 0.45}, mesh.nodes[:, 2] == 0)


@pytest.fixture(scope="module")
def truth(tissue):
    return pp.finite_elements(tissue)


@pytest.fixture(scope="module")
def model(tissue):
    return pp.model(tissue, "blocks")


def energy_norm(truth, field):
    u = np.zeros(truth.K.shape[0])
    u[truth.nodal] = field
    return float(np.sqrt(u @ (truth.K @ u)))


@pytest.mark.parametrize(("relaxation", "modes"), [(1.0, False), (None, False), (None, True)])
def test_sweeps_converge_to_the_direct_solution(tissue, truth, relaxation, modes):
    model = pp.model(tissue, "blocks", relaxation=relaxation, modes=modes)
    exact = truth.push(TOP, [1.0, 2.0, -5.0], 10.0)
    answer = model.push(TOP, [1.0, 2.0, -5.0], 10.0, tolerance=1e-5)
    assert np.linalg.norm(exact.displacement) > 1
    assert np.abs(answer.displacement - exact.displacement).max() < 1e-4 * 5
    np.testing.assert_allclose(answer.force, exact.force, rtol=1e-4)
    np.testing.assert_allclose(answer.realised, [1.0, 2.0, -5.0], atol=1e-12)
    np.testing.assert_array_equal(answer.surface_displacement, answer.displacement[tissue.mesh.surface_nodes])


def test_several_contacts_at_once_agree_with_the_direct_solution(truth, model):
    points = np.array([[14.0, 14.0, 50.0], [36.0, 30.0, 50.0], [50.0, 25.0, 25.0]])
    moves = np.array([[0.0, 1.0, -3.0], [1.0, 0.0, 2.0], [-4.0, 0.0, 0.0]])
    exact, answer = truth.push(points, moves, [9, 10, 11]), model.push(points, moves, [9, 10, 11], tolerance=1e-5)
    np.testing.assert_allclose(answer.force, exact.force, atol=1e-4 * np.abs(exact.force).max())
    np.testing.assert_allclose(answer.realised, moves, atol=1e-12)
    assert answer.state == ("stick",) * 3


@settings(max_examples=25, deadline=None)
@given(st.tuples(*[st.floats(-5, 5)] * 3), st.floats(12, 38), st.floats(12, 38), st.integers(0, 60))
def test_the_certified_error_is_never_less_than_the_true_one(tissue, truth, model, push, x, y, sweeps):
    if np.linalg.norm(push) < 0.1:
        push = (0.0, 0.0, -1.0)
    exact = truth.push([x, y, 50.0], push, 10.0).displacement
    state = model.start()
    spot = tissue.surface.patch(tissue.surface.closest(np.array([x, y, 50.0])), 10.0)
    force = model.native.solve(state, [spot], np.array([push]), sweeps)
    true = energy_norm(truth, state.u - exact) / energy_norm(truth, exact)
    assert true <= model.certified_error(state, force) * (1 + 1e-9)


def test_the_certificate_is_worth_having(truth, model):
    answer = model.push(TOP, [0, 0, -5.0], 10.0, tolerance=1e-3)
    exact = truth.push(TOP, [0, 0, -5.0], 10.0).displacement
    true = energy_norm(truth, answer.displacement - exact) / energy_norm(truth, exact)
    least = model.least_eigenvalue(answer.warm)
    assert true <= answer.error <= 1e-3
    assert answer.error <= true * 4 / np.sqrt(least)  # the spectrum of M⁻¹K lies between `least` and 4


@pytest.mark.parametrize(
    ("name", "options"), [("springs", {}), ("blocks", {"modes": False}), ("blocks", {"modes": True})]
)
@pytest.mark.parametrize("relaxation", [1.0, 1.5, 1.9])
def test_the_energy_falls_with_every_sweep(tissue, name, options, relaxation):
    model = pp.model(tissue, name, relaxation=relaxation, **options)
    spot = tissue.surface.patch(tissue.surface.closest(TOP), 10.0)
    state, energies, move = model.start(), [], np.array([[1.0, 0.0, -5.0]])
    for _ in range(80):
        force = model.native.solve(state, [spot], move, 1)
        energies.append(model.native.balance(state, force)[0])
    assert (np.diff(energies) <= 1e-12 * energies[0]).all()
    assert energies[-1] < 0.95 * energies[0]


@pytest.mark.parametrize("name", ["springs", "blocks"])
def test_force_opposes_the_push_and_grows_with_it(tissue, name):
    model = pp.model(tissue, name)
    for way in [*np.eye(3), *-np.eye(3)]:
        one, two = (model.push(TOP, depth * way, 10.0, tolerance=1e-5).force for depth in (1.0, 2.0))
        assert one @ way < 0
        np.testing.assert_allclose(two, 2 * one, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("name", ["springs", "blocks"])
def test_stiffness_scales_force_but_not_shape(tissue, name):
    stiff = pp.Tissue(tissue.mesh, 3 * tissue.young, tissue.poisson, tissue.fixed)
    a, b = (pp.model(t, name).push(TOP, [1.0, 0, -3.0], 10.0, tolerance=1e-6) for t in (tissue, stiff))
    np.testing.assert_allclose(b.force, 3 * a.force, rtol=1e-6)
    np.testing.assert_allclose(b.displacement, a.displacement, atol=1e-6)


def test_tool_and_support_forces_sum_to_zero(tissue, model):
    answer = model.push(TOP, [1.0, 2.0, -5.0], 10.0, tolerance=1e-6)
    outside = model.native.internal_force(answer.warm)
    assert np.linalg.norm(answer.force) > 0.01
    support = outside[tissue.fixed].sum(axis=0)
    np.testing.assert_allclose(support - answer.force, 0, atol=1e-5 * np.linalg.norm(answer.force))


@pytest.mark.parametrize("name", ["springs", "blocks"])
def test_let_go_the_tissue_goes_home(tissue, name):
    model = pp.model(tissue, name)
    state = model.push(TOP, [0, 0, -5.0], 10.0).warm
    assert np.abs(state.u).max() > 4
    force = model.native.relax(state, None, np.zeros(3), 1000)
    assert np.abs(state.u).max() < 1e-3
    np.testing.assert_array_equal(force, 0)


@pytest.mark.parametrize("name", ["springs", "blocks"])
def test_a_moving_contact_ends_where_a_fresh_one_does(tissue, name):
    model = pp.model(tissue, name)
    state = model.start()
    for x in np.linspace(15, 30, 12):  # the patch, its rings and its factors change on the way
        model.push([x, 20.0, 50.0], [0, 0, -3.0], 9.0, tolerance=0.5, warm=state)
    moved = model.push([30.0, 20.0, 50.0], [0, 0, -3.0], 9.0, tolerance=1e-6, warm=state)
    fresh = model.push([30.0, 20.0, 50.0], [0, 0, -3.0], 9.0, tolerance=1e-6)
    np.testing.assert_allclose(moved.force, fresh.force, rtol=1e-5, atol=1e-8)
    np.testing.assert_allclose(moved.displacement, fresh.displacement, atol=1e-4)


@pytest.mark.parametrize("name", ["springs", "blocks"])
def test_equal_inputs_give_equal_bits(tissue, name):
    answers = [pp.model(tissue, name).push(TOP, [0.3, 0, -5.0], 10.0) for _ in range(2)]
    np.testing.assert_array_equal(answers[0].displacement, answers[1].displacement)
    np.testing.assert_array_equal(answers[0].force, answers[1].force)


def test_an_organ_on_a_narrow_support_does_not_creep():
    # A tall block on a small foot tilts as a whole when pushed at its side; bare sweeps crawl there.
    mesh = brick((6, 6, 9), (40.0, 40.0, 60.0))
    foot = (mesh.nodes[:, 2] == 0) & (np.abs(mesh.nodes[:, :2] - 20) < 7).all(axis=1)
    tissue = pp.Tissue(mesh, 5, 0.45, foot)
    exact = pp.finite_elements(tissue).push([40.0, 20.0, 50.0], [-5.0, 0, 0], 14.0)
    assert exact.displacement[mesh.nodes[:, 2] == 60][:, 0].mean() < -5  # it tilts
    spot = tissue.surface.patch(tissue.surface.closest(np.array([40.0, 20.0, 50.0])), 14.0)
    gap = {}
    for modes in (False, True):
        model = pp.model(tissue, "blocks", modes=modes)
        state = model.start()
        model.native.relax(state, spot, np.array([-5.0, 0, 0]), 60)
        gap[modes] = np.abs(state.u - exact.displacement).max()
    assert gap[True] < 0.05
    assert gap[True] < 0.1 * gap[False]


def test_rings_are_graph_distances(tissue, model):
    spot = tissue.surface.patch(tissue.surface.closest(TOP), 10.0)
    state = model.start()
    model.native.relax(state, spot, np.array([0, 0, -1.0]), 1)
    rows = model.native.rows(state)
    assert set(np.flatnonzero(rows == 1)) == set(spot.nodes)
    a, b = tissue.edges.T
    assert (np.abs(rows[a] - rows[b]) <= 1).all()
    for row in range(2, rows.max() + 1):
        members = np.flatnonzero(rows == row)
        below = set(a[np.isin(b, members) & (rows[a] == row - 1)]) | set(b[np.isin(a, members) & (rows[b] == row - 1)])
        assert below


def test_a_state_of_another_model_is_refused(tissue, model):
    other = pp.model(block(4), "blocks").start()
    with pytest.raises(ValueError, match="another model"):
        model.push(TOP, [0, 0, -1.0], 10.0, warm=other)


def test_more_contacts_than_the_native_model_holds_are_refused(model):
    x, y = (g.ravel() for g in np.meshgrid(np.linspace(8, 42, 5), np.linspace(8, 42, 5)))
    points = np.stack([x, y, np.full(25, 50.0)], axis=1)
    with pytest.raises(ValueError, match="at most 16 contacts"):
        model.push(points, np.tile([0, 0, -1.0], (25, 1)), 6.0)


@pytest.mark.parametrize(
    ("name", "option"), [("gel", {}), ("blocks", {"relaxation": 2.5}), ("springs", {"relaxation": -1})]
)
def test_models_that_cannot_be_are_refused(tissue, name, option):
    with pytest.raises(ValueError, match=r"gel.*springs, blocks|relaxation: (2.5|-1.0) diverges"):
        pp.model(tissue, name, **option)


def test_the_tolerance_must_be_a_share(model):
    with pytest.raises(ValueError, match="tolerance: 0"):
        model.push(TOP, [0, 0, -1.0], 10.0, tolerance=0)
    assert _core.relaxation.RingRelaxation.most_contacts == 16
