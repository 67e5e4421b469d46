"""Multigrid-preconditioned conjugate gradients are finite elements: they reach the direct solution, fast, and know it."""

import sys
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from support.brick_meshes import block, brick

import palpate as pp
from palpate.simulation.pointer import Command
from palpate.tissue.contact_patches import contacts

sys.path.append(str(Path(__file__).parents[2]))
from benchmarks.certificate_soundness import cases, exact, outcomes

TOP = np.array([25.0, 25.0, 50.0])
PUSH = np.array([1.0, 2.0, -5.0])


@pytest.fixture(scope="module")
def tissue():
    mesh = brick((8, 8, 8), warp=0.2, region=lambda c: np.where(np.linalg.norm(c - [25, 25, 35], axis=1) < 10, 2, 1))
    return pp.Tissue(mesh, {1: 3.25, 2: 42.5}, {1: 0.3, 2: 0.45}, mesh.nodes[:, 2] == 0)


@pytest.fixture(scope="module")
def truth(tissue):
    return pp.finite_elements(tissue)


@pytest.fixture(scope="module")
def model(tissue):
    return pp.model(tissue, "multigrid")


def energy_norm(truth, field):
    u = np.zeros(truth.K.shape[0])
    u[truth.nodal] = field
    return float(np.sqrt(u @ (truth.K @ u)))


def answers(model, iterations, point=TOP, push=PUSH, radius=10.0):
    """The displacement and force after each number of iterations, each from rest."""
    found = contacts(model.tissue, point, push, radius)
    for count in iterations:
        state = model.start()
        force = model.iteration.solve(state, found.patches, found.displacement, count)
        yield state.u.copy(), force[0]


def iterations_to(tissue, wanted, point, push, radius):
    """How many iterations from rest bring the energy norm's error to `wanted`, by the direct solution."""
    truth = pp.finite_elements(tissue)
    u = truth.push(point, push, radius).displacement
    whole = energy_norm(truth, u)
    model = pp.model(tissue, "multigrid")
    for count, (answer, _) in enumerate(answers(model, range(25), point, push, radius)):
        if energy_norm(truth, answer - u) < wanted * whole:
            return count
    raise AssertionError("25 iterations were not enough")


def test_it_converges_to_the_direct_solution(truth, model):
    exact_answer, answer = truth.push(TOP, PUSH, 10.0), model.push(TOP, PUSH, 10.0, tolerance=1e-6)
    assert np.linalg.norm(exact_answer.displacement) > 1
    assert np.abs(answer.displacement - exact_answer.displacement).max() < 1e-5 * 5
    np.testing.assert_allclose(answer.force, exact_answer.force, atol=1e-5 * np.linalg.norm(exact_answer.force))
    assert answer.error <= 1e-6


def test_several_contacts_at_once_agree_with_the_direct_solution(truth, model):
    points = np.array([[14.0, 14.0, 50.0], [36.0, 30.0, 50.0], [50.0, 25.0, 25.0]])
    moves = np.array([[0.0, 1.0, -3.0], [1.0, 0.0, 2.0], [-4.0, 0.0, 0.0]])
    reference = truth.push(points, moves, [9, 10, 11])
    answer = model.push(points, moves, [9, 10, 11], tolerance=1e-5)
    np.testing.assert_allclose(answer.force, reference.force, atol=1e-4 * np.abs(reference.force).max())
    np.testing.assert_allclose(answer.realised, moves, atol=1e-12)
    assert answer.state == ("stick",) * 3


def test_the_tool_is_where_it_is_and_the_energy_falls_in_every_iteration(truth, model):
    found = contacts(model.tissue, TOP, PUSH, 10.0)
    energies = []
    for u, _ in answers(model, range(9)):
        np.testing.assert_allclose(found.patches[0].weights @ u[found.patches[0].nodes], PUSH, atol=1e-12)
        energies.append(energy_norm(truth, u) ** 2)
    assert (np.diff(energies) < 1e-9 * energies[0]).all()
    assert energies[-1] < 0.99 * energies[0]


def test_the_force_along_the_push_errs_by_the_square_of_the_displacement(truth, model):
    reference = truth.push(TOP, PUSH, 10.0)
    whole = energy_norm(truth, reference.displacement)
    for u, force in answers(model, (0, 1, 2, 3)):
        error = energy_norm(truth, u - reference.displacement) / whole
        assert force @ PUSH / (reference.force @ PUSH) - 1 == pytest.approx(error**2, rel=1e-3, abs=1e-9)


def test_tool_and_support_forces_sum_to_zero(tissue, model):
    answer = model.push(TOP, PUSH, 10.0, tolerance=1e-6)
    outside = model.iteration.internal_force(np.array(answer.displacement))
    assert np.linalg.norm(answer.force) > 0.01
    support = outside[tissue.fixed].sum(axis=0)
    np.testing.assert_allclose(support - answer.force, 0, atol=1e-5 * np.linalg.norm(answer.force))


def test_the_preconditioner_is_symmetric_and_positive(tissue, model):
    rng = np.random.default_rng(3)
    a, b = (rng.standard_normal(tissue.mesh.nodes.shape) * ~tissue.held[:, None] for _ in range(2))
    Ba, Bb = model.iteration.precondition(a), model.iteration.precondition(b)
    assert np.vdot(b, Ba) == pytest.approx(np.vdot(a, Bb), abs=1e-5 * np.vdot(a, Ba))
    assert np.vdot(a, Ba) > 0
    assert not Ba[tissue.held].any()


@pytest.mark.parametrize(
    ("element", "poisson", "most"), [("P1", 0.3, 6), ("P1", 0.45, 6), ("smoothed", 0.3, 8), ("smoothed", 0.45, 12)]
)
def test_finer_meshes_need_no_more_iterations(element, poisson, most):
    """Smoothed elements are preconditioned by P1, which costs them some iterations; measured: 8, 6, 6 and 12, 11, 10."""
    solids = [block(n, poisson=poisson, element=element) for n in (6, 11, 15 if element == "smoothed" else 17)]
    counts = [iterations_to(solid, 1e-3, TOP, PUSH, 10.0) for solid in solids]
    assert max(counts) <= most


@pytest.mark.parametrize(("element", "most"), [("P1", 6), ("smoothed", 12)])
def test_a_stiff_lump_in_a_stuffed_organ_needs_no_more_iterations(element, most):
    z, y, x = np.meshgrid(*[np.arange(44.0) - 22] * 3, indexing="ij")
    inside = (x / 20) ** 2 + ((y + 0.01 * x**2) / 15) ** 2 + (z / 13) ** 2 < 1
    lump = (x - 6) ** 2 + y**2 + (z - 4) ** 2 < 16
    labels = pp.Labels(inside.astype(np.int32) + (inside & lump), pp.Grid((44, 44, 44), (1, 1, 1), (0, 0, 0)))
    mesh = pp.tetrahedralize(labels, 1, 2.6, inclusions=[2])
    assert len(mesh.nodes) > 1500
    body = pp.Tissue(mesh, {1: 5.0, 2: 50.0}, 0.45, pp.resting_on(mesh, (0, 0, -1)), element=element)
    top = mesh.nodes[np.argmax(mesh.nodes[:, 2])]
    assert iterations_to(body, 1e-3, top, [1.0, 0.0, -3.0], 2 * body.edge) <= most


def test_one_iteration_a_tick_follows_a_sliding_tool(truth, model):
    state = model.start()
    surface = model.tissue.surface
    for tick in range(60):  # 100 mm/s at 1 kHz
        spot = surface.patch(surface.closest(np.array([20 + 0.1 * tick, 25.0, 50.0])), 10.0)
        force = model.iteration.relax(state, spot, np.array([0.0, 0.0, -5.0]), 1)
    reference = truth.push([25.9, 25.0, 50.0], [0.0, 0.0, -5.0], 10.0)
    error = energy_norm(truth, state.u - reference.displacement) / energy_norm(truth, reference.displacement)
    cold = next(answers(model, (1,), [25.9, 25.0, 50.0], [0.0, 0.0, -5.0]))[0]
    assert error < 0.002
    assert error < 0.1 * energy_norm(truth, cold - reference.displacement) / energy_norm(truth, reference.displacement)
    np.testing.assert_allclose(force, reference.force, atol=1e-3 * np.linalg.norm(reference.force))


def test_a_tick_of_one_iteration_is_the_first_of_a_push(model):
    found = contacts(model.tissue, TOP, PUSH, 10.0)
    exact, force = next(answers(model, (1,)))
    state = model.start()
    felt = model.iteration.relax(state, found.patches[0], PUSH, 1)
    np.testing.assert_allclose(state.u, exact, atol=1e-5 * np.linalg.norm(PUSH))
    np.testing.assert_allclose(felt, force, atol=1e-5 * np.linalg.norm(force))


def test_thousands_of_ticks_do_not_drift(truth, model):
    state = model.start()
    surface = model.tissue.surface
    for tick in range(3000):
        x = np.array([25 + 12 * np.sin(0.02 * tick), 25 + 9 * np.sin(0.013 * tick), 50.0])
        model.iteration.relax(state, surface.patch(surface.closest(x), 10.0), np.array([0.0, 0.0, -5.0]), 1)
    for _ in range(12):
        force = model.iteration.relax(state, surface.patch(surface.closest(x), 10.0), np.array([0.0, 0.0, -5.0]), 2)
    reference = truth.push(x, [0.0, 0.0, -5.0], 10.0)
    np.testing.assert_allclose(force, reference.force, atol=1e-5 * np.linalg.norm(reference.force))
    np.testing.assert_allclose(state.u, reference.displacement, atol=1e-4)


def test_let_go_the_tissue_is_home(model):
    state = model.push(TOP, PUSH, 10.0).warm
    assert np.abs(state.u).max() > 4
    np.testing.assert_array_equal(model.iteration.relax(state, None, np.zeros(3), 1), 0)
    np.testing.assert_array_equal(state.u, 0)


def test_a_warm_start_is_nearer_after_as_many_iterations(truth, model):
    point = [26.0, 25.0, 50.0]
    reference = truth.push(point, PUSH, 10.0).displacement
    found = contacts(model.tissue, point, PUSH, 10.0)
    state = model.push(TOP, PUSH, 10.0, tolerance=1e-6).warm
    model.iteration.solve(state, found.patches, found.displacement, 1)
    cold = next(answers(model, (1,), point))[0]
    assert energy_norm(truth, state.u - reference) < 0.5 * energy_norm(truth, cold - reference)


def test_equal_inputs_give_equal_bits(tissue):
    ways = []
    for _ in range(2):
        model = pp.model(tissue, "multigrid")
        state, surface = model.start(), tissue.surface
        for tick in range(20):
            spot = surface.patch(surface.closest(np.array([20 + 0.3 * tick, 25.0, 50.0])), 10.0)
            force = model.iteration.relax(state, spot, PUSH, 1)
        ways.append((state.u.copy(), force))
    np.testing.assert_array_equal(ways[0][0], ways[1][0])
    np.testing.assert_array_equal(ways[0][1], ways[1][1])


def test_a_session_and_its_replay_agree(tissue):
    commands = [Command(True, TOP, np.array([0.02 * t, 0.0, -0.05 * t])) for t in range(60)] + [None] * 5
    session = pp.Session(pp.model(tissue, "multigrid"), sweeps=2)
    forces = session.step(commands)
    assert np.linalg.norm(forces[50]) > 0.01
    np.testing.assert_array_equal(forces[-1], 0)
    again = pp.Session(pp.model(tissue, "multigrid"), sweeps=2)
    assert again.replay(session.record()) is None


def test_the_bound_holds_on_random_meshes_contacts_and_materials():
    seen = [one for case in islice(cases(20, 11), 20) for one in outcomes(case)]
    for name in ("blocks", "multigrid"):
        mine = [one for one in seen if one.name == name]
        assert len(mine) == 20
        assert not any(one.violated for one in mine)
        assert np.median([one.bound / one.true for one in mine if one.true > 1e-9]) < 3


def test_a_model_too_big_to_factor_says_so_and_estimates(tissue, truth, monkeypatch):
    monkeypatch.setattr("palpate.tissue.models.multigrid.MOST_NODES", 10)
    model = pp.model(tissue, "multigrid")
    assert not model.certified
    answer = model.push(TOP, PUSH, 10.0, tolerance=1e-3)
    reference = truth.push(TOP, PUSH, 10.0).displacement
    true = energy_norm(truth, answer.displacement - reference) / energy_norm(truth, reference)
    assert true <= answer.error <= 1e-3
    assert answer.error < 10 * true


def test_the_benchmarks_truth_agrees_with_the_direct_solver():
    case = next(cases(1, 5))
    u, _ = exact(case)
    answer = pp.finite_elements(case.tissue).push(case.points, case.displacements, case.radii)
    np.testing.assert_allclose(answer.displacement, u, atol=1e-8 * np.abs(u).max())


@pytest.mark.parametrize(
    ("options", "message"),
    [({"cell": 0.5}, "cell: 0.5"), ({"smoothing": 0}, "smoothing: 0"), ({"relaxation": 2.0}, "relaxation: 2.0")],
)
def test_settings_that_cannot_be_are_refused(tissue, options, message):
    with pytest.raises(ValueError, match=message):
        pp.model(tissue, "multigrid", **options)


def test_contacts_that_cannot_be_are_refused(tissue, model):
    x, y = (g.ravel() for g in np.meshgrid(np.linspace(8, 42, 5), np.linspace(8, 42, 5)))
    points = np.stack([x, y, np.full(25, 50.0)], axis=1)
    with pytest.raises(ValueError, match="at most 16 contacts"):
        model.push(points, np.tile([0, 0, -1.0], (25, 1)), 6.0)
    other = pp.model(block(4), "multigrid").start()
    with pytest.raises(ValueError, match="another model"):
        model.push(TOP, [0, 0, -1.0], 10.0, warm=other)
