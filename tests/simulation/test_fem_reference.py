"""What is shown against finite elements: by scikit-fem's own forms and one saddle-point system of the whole tissue."""

import numpy as np
import pytest
import skfem
from scipy.sparse import bmat, csr_matrix
from scipy.sparse.linalg import spsolve
from skfem.models.elasticity import lame_parameters, linear_elasticity
from support.example_organs import organ

import palpate as pp
from palpate.simulation.fem_reference import DisplayedTick, fem_difference

RADIUS = 10.0
TOP, SIDE = (0.0, 0.0, 25.0), (36.0, 0.0, 10.0)
LUMPY = organ()
TISSUE = pp.Tissue(LUMPY.mesh, LUMPY.young, LUMPY.poisson, LUMPY.fixed, element="P1")  # which scikit-fem has, too
EXACT = pp.model(TISSUE, "compliance")


def oracle(tissue, points, displacements):
    """(N, 3) mm and (m, 3) N on the tools: K and the patches' means in one system, nothing factored beforehand."""
    mesh = tissue.mesh
    tets = skfem.MeshTet(np.ascontiguousarray(mesh.nodes.T), np.ascontiguousarray(mesh.tets.T.astype(np.int64)))
    K = 0
    for young in np.unique(tissue.young):
        here = np.flatnonzero(tissue.young == young)
        space = skfem.Basis(tets, skfem.ElementVector(skfem.ElementTetP1()), elements=here)
        K = K + linear_elasticity(*lame_parameters(1e-3 * young, tissue.poisson[0])).assemble(space)
    columns = []
    for point in points:
        spot = tissue.surface.patch(tissue.surface.closest(np.array(point)), RADIUS)
        for axis in range(3):
            columns.append(np.zeros(K.shape[0]))
            columns[-1][space.nodal_dofs[axis, spot.nodes]] = spot.weights
    W = np.stack(columns, axis=1)
    free = np.setdiff1d(np.arange(K.shape[0]), space.nodal_dofs[:, tissue.fixed])
    W = csr_matrix(W[free])
    right = np.concatenate([np.zeros(len(free)), np.ravel(displacements)])
    x = spsolve(bmat([[K[free][:, free], W], [W.T, None]], format="csc"), right)
    u = np.zeros(K.shape[0])
    u[free] = x[: len(free)]
    return u[space.nodal_dofs.T], x[len(free) :].reshape(-1, 3)


def pressed(name, commands, ticks=1500):
    session = pp.Session(pp.model(TISSUE, name), radius=RADIUS, sweeps=8)
    session.step([commands] * ticks)
    return session


def hold(point, displacement):
    return pp.Command(True, point, displacement)


@pytest.mark.parametrize("name", ["springs", "neo-hookean", "blocks"])
def test_the_error_is_the_distance_to_finite_elements_solved_on_their_own(name):
    points, ways = [TOP, SIDE], [(0.0, 1.0, -4.0), (-3.0, 0.0, 1.0)]
    session = pressed(name, [hold(*tool) for tool in zip(points, ways, strict=True)])
    found = fem_difference(EXACT, DisplayedTick.of(session.frame()), RADIUS, session.shown)
    u, force = oracle(TISSUE, points, ways)
    expected = np.linalg.norm(session.displacement - u, axis=1)[session.shown]
    np.testing.assert_allclose(found.distance, expected, atol=1e-5)
    np.testing.assert_allclose(found.force, force, atol=1e-6)
    model = np.array([session.frame().model_force[tool] for tool in (0, 1)])
    assert found.off == pytest.approx(np.linalg.norm(model - force) / np.linalg.norm(force), rel=1e-4, abs=1e-6)
    assert (expected.max() > 0.1) == (name != "blocks")  # of linear elements it solves the very same


def test_tables_of_linear_elements_err_by_rounding_only():
    push = 4.0
    session = pressed("compliance", [hold(TOP, (0.0, 0.0, -push)), hold(SIDE, (-2.0, 0.0, 0.0))])
    found = fem_difference(EXACT, DisplayedTick.of(session.frame()), RADIUS, session.shown)
    assert found.distance.max() < 2e-4 * push
    assert found.off < 2e-4


def test_nothing_held_is_nothing_displaced():
    session = pp.Session(pp.model(TISSUE, "springs"), radius=RADIUS, sweeps=1)
    session.step([hold(TOP, (0.0, 0.0, -4.0))] * 300)
    session.step([None])  # on its way home
    tick = DisplayedTick.of(session.frame())
    found = fem_difference(EXACT, tick, RADIUS, session.shown)
    np.testing.assert_allclose(found.distance, np.linalg.norm(session.displacement[session.shown], axis=1), atol=1e-6)
    assert found.distance.max() > 0.1
    assert (len(found.force), found.off) == (0, 0.0)
    session.step([None] * 3000)
    assert fem_difference(EXACT, DisplayedTick.of(session.frame()), RADIUS, session.shown).distance.max() == 0


def test_what_a_sliding_hand_pays_is_no_error_of_the_model():
    session = pp.Session(EXACT, radius=RADIUS, sweeps=1)
    line = np.linspace((10.0, 0.0, 24.0), (-20.0, 0.0, 21.0), 400)
    session.step([hold(point, (3.0, 0.0, -4.0)) for point in line])  # the tissue would drive the hand along
    frame = session.frame()
    assert np.linalg.norm(np.subtract(frame.force[0], frame.model_force[0])) > 0.01 * np.linalg.norm(
        frame.model_force[0]
    )
    assert fem_difference(EXACT, DisplayedTick.of(frame), RADIUS, session.shown).off < 2e-4


def test_a_needle_is_its_entry_with_what_the_shaft_drags_along():
    needle = pp.Command(True, TOP, (0.0, 0.0, -15.0), "needle")
    session = pressed("blocks", [None, None, None, needle], 4000)
    frame = session.frame()
    assert frame.insertion[3] > 1
    tick = DisplayedTick.of(frame)
    assert tick.tools == (3,)
    found = fem_difference(EXACT, tick, RADIUS, session.shown)
    u, force = oracle(TISSUE, tick.points, tick.displacements)
    np.testing.assert_allclose(found.distance, np.linalg.norm(tick.shown - u[session.shown], axis=1), atol=1e-5)
    np.testing.assert_allclose(found.force, force, atol=1e-6)


def test_a_tick_keeps_what_the_loop_writes_over():
    session = pressed("springs", [hold(TOP, (0.0, 0.0, -4.0))], 50)
    tick = DisplayedTick.of(session.frame())
    before = tick.shown.copy(), tick.displacements.copy(), tick.number
    session.step([hold(TOP, (0.0, 0.0, -8.0))] * 50)
    session.frame()
    assert (tick.shown == before[0]).all()
    assert (tick.displacements == before[1]).all()
    assert (tick.number, session.frame().tick) == (50, 100)
