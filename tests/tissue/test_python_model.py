"""A tissue model in Python, by the example: its force is that of its own equations, in lockstep and by the clock."""

import importlib.util
import time
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import block_array, csr_array
from scipy.sparse.linalg import spsolve
from support.brick_meshes import brick
from support.running_server import until

import palpate as pp
from palpate import plugins
from palpate.errors import MaterialError
from palpate.tissue.contact_patches import contacts
from palpate.tissue.models.registry import name_of

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_tissue_model.py"


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("own_tissue_model", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module
    del plugins._registered["tissue_model"]["fibres"]


@pytest.fixture(scope="module")
def ball(example):
    return example.soft_ball()


@pytest.fixture(scope="module")
def top(ball):
    return ball.mesh.nodes[ball.mesh.nodes[:, 2].argmax()]


def reference(K, tissue, points, displacements, radius):
    """Forces (m, 3) on the tools and u (N, 3) by one sparse solution of the saddle-point system K, W."""
    W = csr_array(np.kron(contacts(tissue, points, displacements, radius).weights(len(tissue.mesh.nodes)), np.eye(3)))
    free = np.setdiff1d(np.arange(K.shape[0]), (3 * tissue.fixed[:, None] + np.arange(3)).ravel())
    system = block_array([[K[free][:, free], -W[free]], [W[free].T, None]]).tocsc()
    solved = spsolve(system, np.concatenate([np.zeros(len(free)), np.ravel(displacements)]))
    u = np.zeros(K.shape[0])
    u[free] = solved[: len(free)]
    return -solved[len(free) :].reshape(-1, 3), u.reshape(-1, 3)


def test_its_fibres_add_their_energy_to_uniform_strain(example):
    """V (E + E_f) ε²/2 along the fibres and V E ε²/2 across, where Poisson's ratio is 0."""
    mesh = brick((2, 2, 2), (20.0, 20.0, 20.0))
    tissue = pp.Tissue(mesh, 6.0, 0.0, pp.resting_on(mesh, (0, 0, -1)))
    K = example.stiffness(tissue, np.array([1.0, 0, 0]), 30.0)
    for axis, modulus in ((0, 36.0), (1, 6.0), (2, 6.0)):
        u = np.zeros_like(mesh.nodes)
        u[:, axis] = 0.01 * mesh.nodes[:, axis]
        energy = u.ravel() @ (K @ u.ravel()) / 2
        assert energy == pytest.approx(8000 * modulus * 1e-3 * 1e-4 / 2, rel=1e-9)


def test_without_fibres_it_is_linear_elasticity(ball, top):
    push = ((0.5, 0.2, -3.0), 8.0)
    own, fem = pp.model(ball, "fibres", fibres=0.0).push(top, *push), pp.finite_elements(ball, "P1").push(top, *push)
    np.testing.assert_allclose(own.force, fem.force, rtol=1e-8)
    np.testing.assert_allclose(own.displacement, fem.displacement, atol=1e-8)
    assert own.sweeps == 1
    assert np.isnan(own.error)


def test_the_ball_is_stiffer_along_its_fibres(example):
    pulled = example.main()
    assert pulled["along"] > 1.1 * pulled["across"] > 0


def test_in_lockstep_two_tools_feel_the_force_of_its_own_equations(example, ball, top):
    model = pp.model(ball, "fibres")
    assert name_of(model) == "fibres"
    radius, side = 8.0, ball.mesh.nodes[ball.mesh.nodes[:, 0].argmax()]
    moves = [(0.4, 0.0, -2.0), (-1.5, 0.3, 0.0)]
    session = pp.Session(model, radius=radius)
    commands = [pp.Command(True, tuple(point), move) for point, move in zip((top, side), moves, strict=True)]
    felt = session.step([commands] * 400)[-1][:2]
    force, u = reference(model.stiffness, ball, [top, side], moves, radius)
    np.testing.assert_allclose(felt, force, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(session.displacement, u, atol=1e-7)
    assert np.abs(force[0]).max() > 0.02  # N


def test_by_the_clock_the_loop_keeps_its_rate_and_feels_the_same_force(ball, top):
    """The loop does not wait for Python: it makes ticks between two answers."""

    class Slow(type(pp.model(ball, "fibres"))):
        asked = 0

        def equilibrium(self, W, displacement):
            self.asked += 1
            time.sleep(0.03)
            return super().equilibrium(W, displacement)

    model, move = Slow(ball), (0.4, 0.0, -2.0)
    pointer = pp.Pointer()
    with pp.Session(model, radius=8.0, sweeps=1) as session:
        model.asked = 0
        session.start(pointer)
        pointer.send(pp.Command(True, tuple(top), move))
        force, _ = reference(model.stiffness, ball, top, move, 8.0)
        until(lambda: np.allclose(session.frame().force[0], force[0], rtol=1e-3), 30)
        first, asked = session.frame().tick, model.asked
        time.sleep(2)
        assert session.frame().tick - first > 5 * (model.asked - asked) > 0
        pointer.send(pp.Command())
        until(lambda: np.abs(session.frame().force[0]).max() == 0, 30)


def test_an_error_of_the_model_is_reported_and_its_contact_refused(ball, top, monkeypatch):
    class Broken(type(pp.model(ball, "fibres"))):
        def equilibrium(self, W, displacement):
            raise ZeroDivisionError("a bug")

    told = []
    monkeypatch.setattr("sys.unraisablehook", lambda problem: told.append(problem.exc_type))
    session = pp.Session(Broken(ball), radius=8.0, sweeps=1)
    assert (session.step([pp.Command(True, tuple(top), (0, 0, -1.0))] * 3) == 0).all()
    assert set(told) == {ZeroDivisionError}
    with pytest.raises(
        MaterialError, match="choose one of springs, blocks, multigrid, compliance, neo-hookean, compliance-P1, fibres"
    ):
        pp.model(ball, "jelly")
