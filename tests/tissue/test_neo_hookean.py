"""Neo-Hookean tissue: forces from an energy, no element turned, linear elasticity in the limit, and an independent Newton."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from support.brick_meshes import block, brick

import palpate as pp
from palpate import _core
from palpate.errors import DataError, MaterialError
from palpate.tissue.models.neo_hookean import neo_hookean_energy
from palpate.tissue.reference.finite_strain import NEO_HOOKEAN
from palpate.tissue.reference.linear_elasticity import lame

TOP = np.array([25.0, 25.0, 50.0])
RADIUS = 14.0


elements_of = neo_hookean_energy


@pytest.fixture(scope="module", params=itertools.product(["smoothed", "P1"], [0.0, {1: 3.0, 2: 8.0}]), ids=str)
def mixed(request):
    """An irregular block of two materials, which may stiffen, and 33 tets past a whole number of lanes."""
    element, stiffening = request.param
    mesh = brick((3, 4, 5), (30, 40, 50), warp=0.3, region=lambda x: 1 + (x[:, 2] > 25))
    bottom = mesh.nodes[:, 2] == 0
    return pp.Tissue(mesh, {1: 5.0, 2: 20.0}, {1: 0.45, 2: 0.2}, bottom, element=element, stiffening=stiffening)


def bent(tissue, size, seed=0):
    """A smooth large displacement with some noise, (N, 3) mm."""
    x, rng = tissue.mesh.nodes, np.random.default_rng(seed)
    smooth = np.sin(x @ rng.normal(0, 0.05, (3, 3)) + rng.uniform(0, 6, 3))
    return size * (smooth + 0.05 * rng.standard_normal(x.shape))


def test_the_energy_of_linear_elements_is_the_stated_one(mixed):
    """That of smoothed ones: test_smoothed_elements.py."""
    mixed = pp.Tissue(mixed.mesh, mixed.young, mixed.poisson, mixed.fixed, element="P1")
    u = bent(mixed, 4.0)
    edges = [(mixed.mesh.nodes + w)[mixed.mesh.tets] for w in (0 * u, u)]
    X, x = ((e[:, 1:] - e[:, :1]).transpose(0, 2, 1) for e in edges)
    F = x @ np.linalg.inv(X)
    J, (lam, mu) = np.linalg.det(F), lame(mixed.young, mixed.poisson)
    W = mu / 2 * ((F**2).sum(axis=(1, 2)) - 3) - mu * np.log(J) + lam / 2 * np.log(J) ** 2
    value, _, least = elements_of(mixed).energy(u)
    assert value == pytest.approx((W * mixed.mesh.volumes).sum(), rel=1e-12)
    assert least == pytest.approx(J.min(), rel=1e-12)
    assert J.min() < 0.8  # the strain is large


def test_force_is_the_slope_of_the_energy_and_the_tangent_that_of_the_force(mixed):
    elements, u = elements_of(mixed), bent(mixed, 4.0)
    way = bent(mixed, 1.0, seed=1)
    h = 1e-4
    (high, force_high, _), (low, force_low, _) = (elements.energy(u + s * h * way) for s in (1, -1))
    force = elements.energy(u)[1]
    assert (high - low) / (2 * h) == pytest.approx((force * way).sum(), rel=1e-6)
    change = elements.tangent(u, way)
    np.testing.assert_allclose(change, (force_high - force_low) / (2 * h), atol=1e-6 * np.abs(change).max())
    other = bent(mixed, 1.0, seed=2)
    assert (other * change).sum() == pytest.approx((way * elements.tangent(u, other)).sum(), rel=1e-12)


def test_at_rest_the_tangent_is_the_linear_stiffness(mixed):
    fe, way = pp.finite_elements(mixed), bent(mixed, 1.0)
    flat = np.zeros(fe.K.shape[0])
    flat[fe.nodal] = way
    linear = (fe.K @ flat)[fe.nodal]
    np.testing.assert_allclose(
        elements_of(mixed).tangent(np.zeros_like(way), way), linear, atol=1e-12 * np.abs(linear).max()
    )


def test_turning_the_body_turns_the_forces_and_leaves_the_energy(mixed):
    elements, u, x = elements_of(mixed), bent(mixed, 4.0), mixed.mesh.nodes
    turn = Rotation.from_rotvec([1.0, -2.0, 0.5]).as_matrix()
    value, force, _ = elements.energy(u)
    turned, turned_force, _ = elements.energy((x + u) @ turn.T + [3.0, 5.0, -7.0] - x)
    assert turned == pytest.approx(value, rel=1e-10)
    np.testing.assert_allclose(turned_force, force @ turn.T, atol=1e-10 * np.abs(force).max())
    assert np.abs(force.sum(axis=0)).max() < 1e-12 * np.abs(force).sum()


def test_a_flat_or_turned_element_costs_infinite_energy(mixed):
    elements, u = elements_of(mixed), np.zeros_like(mixed.mesh.nodes)
    u[-1] = mixed.mesh.nodes[0] - mixed.mesh.nodes[-1]
    value, _, least = elements.energy(u)
    assert value == np.inf
    assert least < 0


@pytest.mark.parametrize("push", [[0, 0, -9.0], [6.0, 3.0, -4.0], [0, 0, 9.0]])
def test_the_model_agrees_with_newtons_method_on_other_code(push):
    tissue = block(6, poisson=0.4)
    truth = pp.finite_strain(tissue).push(TOP, push, RADIUS)
    answer = pp.model(tissue, "neo-hookean").push(TOP, push, RADIUS, tolerance=1e-7)
    assert truth.error < 1e-9
    np.testing.assert_allclose(answer.force, truth.force, atol=1e-6 * np.linalg.norm(truth.force))
    np.testing.assert_allclose(answer.displacement, truth.displacement, atol=1e-5)
    np.testing.assert_allclose(answer.realised, push, atol=1e-8)
    linear = pp.finite_elements(tissue).push(TOP, push, RADIUS)
    assert np.linalg.norm(linear.force - truth.force) > 0.02 * np.linalg.norm(truth.force)  # so this is another model


def test_small_pushes_are_linear_elasticity_and_the_difference_is_of_second_order():
    tissue = block(5, poisson=0.4)
    model, truth = pp.model(tissue, "neo-hookean"), pp.finite_elements(tissue)
    gap = []
    for depth in (0.5, 0.25, 0.125):
        push = depth * np.array([0.3, -0.2, -1.0])
        a, b = model.push(TOP, push, 18.0, tolerance=1e-9), truth.push(TOP, push, 18.0)
        gap.append([np.abs(a.displacement - b.displacement).max(), np.linalg.norm(a.force - b.force)])
    order = np.log2(np.array(gap[:-1]) / gap[1:])
    assert np.array(gap).min() > 1e-6
    np.testing.assert_allclose(order, 2, atol=0.15)


def test_the_estimate_of_the_error_is_near_the_error():
    """It is no bound: here it must lie between half the error in the tangent's norm and four times that."""
    tissue = block(7, poisson=0.45)
    model, elements = pp.model(tissue, "neo-hookean"), elements_of(tissue)
    for push in ([0, 0, -10.0], [5.0, 0, -3.0], [0, 2.0, 8.0]):
        exact = pp.finite_strain(tissue).push(TOP, push, RADIUS).displacement
        size = (exact * elements.tangent(exact, exact)).sum()
        for tolerance in (0.1, 1e-2, 1e-3, 1e-4):
            answer = model.push(TOP, push, RADIUS, tolerance=tolerance)
            off = np.ascontiguousarray(answer.displacement - exact)
            error = np.sqrt((off * elements.tangent(exact, off)).sum() / size)
            assert answer.error <= tolerance
            assert 0.25 * answer.error < error < 2 * answer.error


def test_tool_and_support_forces_sum_to_zero():
    tissue = block(6, poisson=0.4)
    answer = pp.model(tissue, "neo-hookean").push(TOP, [3.0, 0, -8.0], RADIUS, tolerance=1e-8)
    force = elements_of(tissue).energy(answer.displacement)[1]
    np.testing.assert_allclose(force[tissue.fixed].sum(axis=0), answer.force, atol=1e-6 * np.linalg.norm(answer.force))
    torque = np.cross(tissue.mesh.nodes + answer.displacement, force).sum(axis=0)
    assert np.abs(torque).max() < 1e-10 * np.abs(np.cross(tissue.mesh.nodes, force)).sum()


def test_pushing_fifteen_millimetres_into_eleven_cubed_turns_no_element():
    tissue = block(11)
    answer = pp.model(tissue, "neo-hookean").push(TOP, [0, 0, -15.0], 10.0)
    linear = pp.finite_elements(tissue).push(TOP, [0, 0, -15.0], 10.0)
    elements = elements_of(tissue)
    assert elements.energy(linear.displacement)[2] < 0  # which linear elasticity does
    assert elements.energy(answer.displacement)[2] > 0.2
    assert answer.error <= 1e-3
    np.testing.assert_allclose(answer.realised, [0, 0, -15], atol=1e-8)


@settings(max_examples=25, deadline=None)
@given(
    way=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1),
    depth=st.floats(0.1, 30),
    place=st.tuples(st.floats(5, 25), st.floats(5, 35)),
    steps=st.integers(1, 12),
)
def test_no_step_however_wild_turns_an_element(mixed, way, depth, place, steps):
    """Cut off anywhere on the way, on an irregular mesh of two materials, and let go."""
    model = pp.model(mixed, "neo-hookean")
    state, elements = model.start(), elements_of(mixed)
    hit = mixed.surface.closest(np.array([*place, 60.0]))
    patch = mixed.surface.patch(hit, 16.0)
    push = depth * np.array(way) / np.linalg.norm(way)
    force = model.equilibrium.relax(state, patch, push, steps)
    assert elements.energy(state.u)[2] > 0
    assert np.isfinite(force).all()
    assert (state.u[mixed.fixed] == 0).all()
    model.equilibrium.relax(state, None, np.zeros(3), 3)
    assert elements.energy(state.u)[2] > 0


def test_the_work_over_a_closed_loop_of_pushes_is_zero():
    """Down, sideways, up and back, in 0.25 mm steps: what the hand puts in it gets back; half-way it is stored."""
    tissue = block(5, poisson=0.4)
    model, elements = pp.model(tissue, "neo-hookean"), elements_of(tissue)
    corners = np.array([[0, 0, 0], [0, 0, -6], [4, 0, -6], [4, 0, -1], [0, 0, 0]], dtype=float)
    path = [corners[0]]
    for a, b in itertools.pairwise(corners):
        n = int(np.ceil(np.linalg.norm(b - a) / 0.25))
        path += [a + (b - a) * k / n for k in range(1, n + 1)]
    state, before, work, most = model.start(), np.zeros(3), 0.0, 0.0
    for a, b in itertools.pairwise(path):
        answer = model.push(TOP, b, 18.0, tolerance=1e-6, warm=state)
        work -= (answer.force + before) / 2 @ (b - a)
        before = answer.force
        stored = elements.energy(answer.displacement)[0]
        most = max(most, stored)
        assert work == pytest.approx(stored, abs=2e-3 * max(stored, most))
    assert most > 1
    assert abs(work) < 1e-3 * most


def test_one_step_a_tick_gives_the_hand_no_energy():
    """As the loop runs it: a tenth of a millimetre a tick, one step of descent each, far from converged."""
    tissue = block(7, poisson=0.45)
    model, elements = pp.model(tissue, "neo-hookean"), elements_of(tissue)
    patch = tissue.surface.patch(tissue.surface.closest(TOP), RADIUS)
    corners = np.array([[0, 0, 0], [0, 0, -8], [6, 0, -8], [6, 4, -2], [0, 0, 0]], dtype=float)
    path = np.concatenate(
        [np.linspace(a, b, int(10 * np.linalg.norm(b - a)) + 1)[1:] for a, b in itertools.pairwise(corners)]
    )
    state, force, work, most, least = model.start(), np.zeros(3), 0.0, 0.0, 0.0
    for a, b in itertools.pairwise(path):
        now = model.equilibrium.relax(state, patch, b, 1)
        work -= (now + force) / 2 @ (b - a)
        force, stored = now, elements.energy(state.u)[0]
        most, least = max(most, stored), min(least, work - stored)
    assert most > 1
    assert least > -0.01 * most
    assert work < 0.05 * most  # nor is much lost


def test_a_sliding_contact_ends_where_a_fresh_one_begins(mixed):
    model = pp.model(mixed, "neo-hookean")
    state = model.start()
    for x in np.linspace(10, 18, 9):
        warm = model.push([x, 20, 50], [0, 0, -5.0], 16.0, warm=state, tolerance=1e-6)
    cold = model.push([18, 20, 50], [0, 0, -5.0], 16.0, tolerance=1e-6)
    np.testing.assert_allclose(warm.displacement, cold.displacement, atol=1e-4)
    np.testing.assert_allclose(warm.force, cold.force, rtol=1e-4, atol=1e-5)


def test_let_go_the_tissue_goes_home(mixed):
    model = pp.model(mixed, "neo-hookean")
    state = model.push([15, 20, 50], [0, 0, -8.0], 16.0).warm
    assert np.abs(state.u).max() > 4
    model.equilibrium.relax(state, None, np.zeros(3), 40)
    assert np.abs(state.u).max() < 1e-6


def test_two_tools_at_once_and_a_stiff_lump():
    mesh = brick((6, 6, 6), region=lambda x: 1 + (np.linalg.norm(x - [25, 25, 33], axis=1) < 12))
    bottom = mesh.nodes[:, 2] == 0
    points, push = [[12.0, 25, 50], [38.0, 25, 50]], [[0, 0, -6.0], [1.0, 0, -3.0]]
    soft, lumpy = (pp.Tissue(mesh, {1: 5.0, 2: young}, 0.4, bottom) for young in (5.0, 50.0))
    answers = [pp.model(t, "neo-hookean").push(points, push, RADIUS, tolerance=1e-7) for t in (soft, lumpy)]
    for tissue, answer in zip((soft, lumpy), answers, strict=True):
        truth = pp.finite_strain(tissue).push(points, push, RADIUS)
        np.testing.assert_allclose(answer.force, truth.force, atol=1e-6 * np.abs(truth.force).max())
        np.testing.assert_allclose(answer.realised, push, atol=1e-8)
    assert (answers[1].force[:, 2] > 1.05 * answers[0].force[:, 2]).all()


def test_a_session_replays_to_the_bit():
    tissue = block(5)
    rest = [pp.Command(held=True, point=TOP, displacement=[0, 0, -0.2 * k]) for k in range(20)]
    force = [pp.Session(pp.model(tissue, "neo-hookean"), radius=18, sweeps=2).step([*rest, None]) for _ in range(2)]
    assert np.linalg.norm(force[0][-2]) > 0.01
    np.testing.assert_array_equal(force[0], force[1])


def test_what_cannot_be_is_refused():
    tissue = block(5, poisson=0.5, element="mixed")
    with pytest.raises(MaterialError, match="compressible"):
        pp.model(tissue, "neo-hookean")
    with pytest.raises(MaterialError, match=r"0\.5"):
        pp.finite_strain(tissue, "P2")
    tissue = block(5)
    with pytest.raises(MaterialError, match="P2"):
        pp.finite_strain(tissue, "mixed")
    model = pp.model(tissue, "neo-hookean")
    with pytest.raises(DataError, match=r"stuck .* smaller push"):
        model.push(TOP, [0, 0, -60.0], 18.0)
    with pytest.raises(DataError, match="smaller push"):
        pp.finite_strain(tissue).push(TOP, [0, 0, -60.0], 18.0)
    edge = np.linspace(0, 50, 5)
    many = [[x, y, 50] for x in edge for y in edge][:17]
    with pytest.raises(DataError, match="at most 16 contacts"):
        model.push(many, np.zeros((17, 3)), 5.0)
    with pytest.raises(ValueError, match="another model"):
        model.equilibrium.solve(pp.model(tissue, "neo-hookean").start(), [], np.zeros((0, 3)), 1, 1e-3)
    constants = (*lame(tissue.young, tissue.poisson), tissue.stiffening)
    with pytest.raises(ValueError, match="does not have"):
        _core.hyperelastic.NeoHookean(tissue.mesh.nodes, tissue.mesh.tets + 100, *constants)
    with pytest.raises(ValueError, match="as many as"):
        _core.hyperelastic.NeoHookean(tissue.mesh.nodes, tissue.mesh.tets, *constants[:2], constants[2][1:])
    elements = elements_of(tissue)
    with pytest.raises(ValueError, match="nodes, 3"):
        elements.energy(np.zeros((4, 3)))
    with pytest.raises(ValueError, match="moving"):
        _core.hyperelastic.HyperelasticModel(
            elements, pp.finite_elements(tissue).factors.native, np.arange(3, dtype=np.int32)
        )


@pytest.mark.parametrize("b", [None, 0.7])
def test_the_laws_derivatives_are_those_of_its_energy(b):
    rng = np.random.default_rng(4)
    F, D = np.eye(3) + 0.3 * rng.standard_normal((2, 50, 3, 3))
    lam, mu = rng.uniform(1, 5, (2, 50))

    def energy(F):
        J = np.linalg.det(F)
        S = (F**2).sum(axis=(1, 2)) - 3 - 2 * np.log(J)
        return mu / 2 * (S if b is None else np.expm1(b * S) / b) + lam / 2 * np.log(J) ** 2

    good = np.linalg.det(F) > 0.2
    assert good.sum() > 20
    h = 1e-6
    slope = (energy(F + h * D) - energy(F - h * D))[good] / (2 * h)
    constants = (lam, mu) if b is None else (lam, mu, np.full(50, b))
    P = NEO_HOOKEAN.stress(F, *constants)
    np.testing.assert_allclose((P * D).sum(axis=(1, 2))[good], slope, rtol=1e-5)
    change = np.einsum("mijkl,mkl->mij", NEO_HOOKEAN.tangent(F, *constants), D)
    finite = (NEO_HOOKEAN.stress(F + h * D, *constants) - NEO_HOOKEAN.stress(F - h * D, *constants)) / (2 * h)
    np.testing.assert_allclose(change[good], finite[good], rtol=1e-4, atol=1e-4)
