"""Tissue that stiffens with stretch (Demiray's law), against closed forms and an energy written here from its formula."""

import itertools

import numpy as np
import pytest
from scipy.optimize import brentq
from support.brick_meshes import block, brick

import palpate as pp
from palpate.errors import DataError, MaterialError
from palpate.simulation.recorded_session import session_like
from palpate.tissue.neo_hookean_energy import neo_hookean_energy

TOP, RADIUS = np.array([25.0, 25.0, 50.0]), 12.0
E, ELEMENTS = 5.0, ("P1", "smoothed")  # kPa


def constants(nu):
    """λ and μ, N/mm²."""
    young = 1e-3 * E
    return young * nu / ((1 + nu) * (1 - 2 * nu)), young / (2 * (1 + nu))


def uniaxial(stretch, nu, b):
    """Nominal stress N/mm² and lateral stretch of a bar with free sides, from W = μ/2b (exp(b S) − 1) + λ/2 (ln J)².

    S = l² + 2 m² − 3 − 2 ln J, J = l m², and ∂W/∂m = 0.
    """
    lam, mu = constants(nu)

    def slopes(m):
        log = np.log(stretch * m * m)
        grown = mu * np.exp(b * (stretch**2 + 2 * m**2 - 3 - 2 * log))
        return grown * (stretch - 1 / stretch) + lam * log / stretch, grown * (m - 1 / m) + lam * log / m

    lateral = brentq(lambda m: slopes(m)[1], 0.5, 2.0, xtol=1e-15)
    return slopes(lateral)[0], lateral


def unit_bar(element, nu, b, cells=(1, 1, 1), size=(2.0, 3.0, 4.0)):
    mesh = brick(cells, size)
    return pp.Tissue(mesh, E, nu, mesh.nodes[:, 2] == 0, element=element, stiffening=b)


def equilibrium(elements, u, free):
    """Newton's method on the free unknowns of u (N, 3), with the tangent as a dense matrix."""
    for _ in range(30):
        force = elements.energy(u)[1].ravel()
        if np.abs(force[free]).max() < 1e-14:
            return u
        K = np.zeros((u.size, u.size))
        for k in free:
            way = np.zeros_like(u)
            way.flat[k] = 1.0
            K[:, k] = elements.tangent(u, way).ravel()
        u = u.copy()
        u.flat[free] -= np.linalg.solve(K[np.ix_(free, free)], force[free])
    raise AssertionError("no equilibrium found")


@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize(("nu", "b"), [(0.3, 0.5), (0.3, 5.0), (0.45, 20.0), (0.0, 5.0), (0.3, 0.0)])
@pytest.mark.parametrize("stretch", [0.7, 1.05, 1.3])
def test_uniaxial_stretch_with_free_sides_is_the_closed_form(element, nu, b, stretch):
    """A bar on frictionless planes, solved: its lateral stretch and its force are those of the formula."""
    tissue = unit_bar(element, nu, b)
    x = tissue.mesh.nodes
    u = np.zeros_like(x)
    held = x == 0
    held[:, 2] |= x[:, 2] == 4.0
    free = np.flatnonzero(~held.ravel())
    for part in np.linspace(0, 1, 4)[1:]:
        u[:, 2] = part * (stretch - 1) * x[:, 2]
        u = equilibrium(neo_hookean_energy(tissue), u, free)
    stress, lateral = uniaxial(stretch, nu, b)
    np.testing.assert_allclose((x + u)[:, :2], lateral * x[:, :2], rtol=1e-6, atol=1e-9)
    force = neo_hookean_energy(tissue).energy(u)[1]
    assert force[x[:, 2] == 4.0, 2].sum() == pytest.approx(6.0 * stress, rel=1e-6)


@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize("b", [0.0, 5.0, 20.0])
def test_simple_shear_is_the_closed_form(element, b):
    """J = 1 and S = γ²: the shear stress is μ γ exp(b γ²), and no force acts on a node inside (patch test)."""
    tissue = unit_bar(element, 0.45, b, (2, 2, 3), (4.0, 6.0, 5.0))
    x, gamma = tissue.mesh.nodes, 0.4
    u = np.zeros_like(x)
    u[:, 0] = gamma * x[:, 2]
    force = neo_hookean_energy(tissue).energy(u)[1]
    stress = constants(0.45)[1] * gamma * np.exp(b * gamma**2)
    np.testing.assert_allclose(force[x[:, 2] == 5.0].sum(axis=0), [24.0 * stress, 0, 0], atol=1e-6 * 24 * stress)
    inner = ((x > 0) & (x < [4.0, 6.0, 5.0])).all(axis=1)
    assert inner.any()
    assert np.abs(force[inner]).max() < 1e-12 * np.abs(force).max()


def stated_energy(tissue, u, b):
    """By the formula, one tetrahedron after the other. b: of each region. Cells of regions do not mix."""
    shear, bulk, total = {}, {}, 0.0
    for tet, region, young, nu in zip(tissue.mesh.tets, tissue.mesh.region, tissue.young, tissue.poisson, strict=True):
        lam, mu = (m * young / E for m in constants(nu))
        X, x = (at[tet[1:]] - at[tet[0]] for at in (tissue.mesh.nodes, tissue.mesh.nodes + u))
        V, F = np.linalg.det(X) / 6, np.linalg.solve(X, x).T
        if tissue.element == "P1":
            cells = [(shear, (len(shear),), V), (bulk, (len(bulk),), V)]
        else:
            cells = [(shear, (region, *pair), V / 6) for pair in itertools.combinations(sorted(tet.tolist()), 2)]
            cells += [(bulk, (region, node), V / 4) for node in tet.tolist()]
            total += V * mu * np.log(min(np.linalg.det(F) / 0.3, 1)) ** 2
        for kind, name, part in cells:
            of = kind.setdefault(name, [0.0, 0.0, mu if kind is shear else lam, b[region]])
            of[0] += part
            of[1] = of[1] + part * (F if kind is shear else np.linalg.det(F))
    for V, F, mu, exponent in shear.values():
        F = F / V
        S = (F**2).sum() - 3 - 2 * np.log(np.linalg.det(F))
        total += V * mu / 2 * (S if exponent == 0 else np.expm1(exponent * S) / exponent)
    return total + sum(V * lam / 2 * np.log(J / V) ** 2 for V, J, lam, _ in bulk.values())


@pytest.mark.parametrize("element", ELEMENTS)
def test_the_energy_is_the_stated_one_and_the_force_its_slope(element):
    """An irregular block of two materials, one of which does not stiffen, strained by a third."""
    mesh = brick((2, 3, 3), (20, 30, 30), warp=0.3, region=lambda x: 1 + (x[:, 2] > 15))
    b = {1: 0.0, 2: 6.0}
    tissue = pp.Tissue(mesh, {1: 5.0, 2: 20.0}, {1: 0.45, 2: 0.2}, mesh.nodes[:, 2] == 0, element=element, stiffening=b)
    rng, x = np.random.default_rng(1), mesh.nodes
    u, way = (3 * np.sin(x[:, [1, 2, 0]] / 9) + size * rng.standard_normal(x.shape) for size in (0.4, 1.0))
    value, force, least = neo_hookean_energy(tissue).energy(u)
    assert least > 0
    assert value == pytest.approx(stated_energy(tissue, u, b), rel=1e-12)
    assert value > 1.05 * stated_energy(tissue, u, {1: 0.0, 2: 0.0})
    h = 1e-4
    slope = (stated_energy(tissue, u + h * way, b) - stated_energy(tissue, u - h * way, b)) / (2 * h)
    assert (force * way).sum() == pytest.approx(slope, rel=1e-6)


@pytest.mark.parametrize("element", ELEMENTS)
def test_the_limit_of_no_stiffening_is_neo_hookean(element):
    tissue = block(4, poisson=0.45, element=element)
    rng, x = np.random.default_rng(2), tissue.mesh.nodes
    u, way = np.ascontiguousarray(4 * np.sin(x / 15)), rng.standard_normal(x.shape)
    plain = neo_hookean_energy(tissue)
    value, force, _ = plain.energy(u)
    for b, most in ((1e-14, 1e-13), (1e-7, 1e-6)):
        near = neo_hookean_energy(block(4, poisson=0.45, element=element, stiffening=b))
        assert near.energy(u)[0] == pytest.approx(value, rel=most)
        np.testing.assert_allclose(near.energy(u)[1], force, atol=most * np.abs(force).max())
        change = plain.tangent(u, way)
        np.testing.assert_allclose(near.tangent(u, way), change, atol=most * np.abs(change).max())


@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize("push", [[0, 0, -9.0], [6.0, 3.0, -4.0], [0, 0, 9.0]])
def test_the_model_agrees_with_newtons_method_on_other_code(element, push):
    tissue = block(6, poisson=0.4, element=element, stiffening=6.0)
    truth = pp.finite_strain(tissue).push(TOP, push, 14.0)
    answer = pp.model(tissue, "neo-hookean").push(TOP, push, 14.0, tolerance=1e-7)
    assert truth.error < 1e-9
    np.testing.assert_allclose(answer.force, truth.force, atol=1e-6 * np.linalg.norm(truth.force))
    np.testing.assert_allclose(answer.displacement, truth.displacement, atol=1e-5)
    plain = pp.finite_strain(block(6, poisson=0.4, element=element)).push(TOP, push, 14.0)
    assert np.linalg.norm(truth.force) > 1.1 * np.linalg.norm(plain.force)


@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize("b", [5.0, 20.0])
def test_a_push_of_thirty_percent_turns_no_element(element, b):
    tissue = block(9, poisson=0.45, element=element, stiffening=b)
    answer = pp.model(tissue, "neo-hookean").push(TOP, [0, 0, -15.0], RADIUS)
    assert neo_hookean_energy(tissue).energy(answer.displacement)[2] > 0.2
    assert answer.error <= 1e-3
    np.testing.assert_allclose(answer.realised, [0, 0, -15], atol=1e-8)


def held_push(b, depth):
    """N along z: of a session at two rates that has held the push, and of the equilibrium."""
    model = pp.model(block(7, poisson=0.45, stiffening=b), "neo-hookean")
    way = np.concatenate([np.linspace(0, depth, 200), np.full(200, depth)])
    session = pp.Session(model, radius=RADIUS)
    force = session.step([pp.Command(True, tuple(TOP), (0, 0, -float(d))) for d in way])
    return force[-1, 2], model.push(TOP, (0, 0, -depth), RADIUS, tolerance=1e-5).force[2]


def test_a_held_push_settles_on_the_equilibrium_and_deep_ones_are_stiffer():
    """10 and 1 mm of 50, at the default interval."""
    ratio = {}
    for b in (0.0, 5.0):
        (deep, deep_exact), (slight, slight_exact) = held_push(b, 10.0), held_push(b, 1.0)
        assert deep == pytest.approx(deep_exact, rel=0.01)
        assert slight == pytest.approx(slight_exact, rel=0.01)
        ratio[b] = deep / slight
    assert ratio[5.0] > 1.5 * ratio[0.0]


@pytest.mark.parametrize("b", [5.0, 20.0])
def test_a_fast_deep_press_is_felt_and_gives_the_hand_no_energy(b):
    """12 of 50 mm at 120 mm/s, down, held and back, against the equilibrium at the tool's own displacement."""
    model, warm = pp.model(block(7, poisson=0.45, stiffening=b), "neo-hookean"), None
    way = np.concatenate([np.linspace(0, 12, 100), np.full(60, 12.0), np.linspace(12, 0, 100)])
    commands = [pp.Command(True, tuple(TOP), (0, 0, -float(d))) for d in way]
    session, off, most = pp.Session(model, radius=RADIUS, limit=1e3), [], 0.0
    for first in range(0, len(commands), 10):
        session.step(commands[first : first + 10])
        frame = session.frame()
        answer = model.push(TOP, frame.displacement[0], RADIUS, tolerance=1e-4, warm=warm)
        warm = answer.warm
        off.append(np.linalg.norm(frame.model_force[0] - answer.force))
        most = max(most, frame.work)
    force = model.push(TOP, (0, 0, -12.0), RADIUS).force[2]
    assert b > 5 or np.sqrt(np.mean(np.square(off))) < 0.05 * force
    session.step([commands[-1]] * 100 + [None] * 10)
    assert most > 2 * force  # N mm
    assert session.frame().work > -0.01 * most


def test_linear_models_do_not_depend_on_it():
    answers = [pp.model(block(5, stiffening=b), "compliance").push(TOP, (0, 0, -2.0), RADIUS) for b in (0.0, 9.0)]
    np.testing.assert_array_equal(answers[0].displacement, answers[1].displacement)


@pytest.mark.parametrize("element", ELEMENTS)
def test_the_error_of_linear_strain_is_that_against_this_law(element):
    tissue = block(5, poisson=0.45, element=element, stiffening=8.0)
    push = (0, 0, -6.0)
    answer = pp.model(tissue, "compliance").push(TOP, push, RADIUS)
    finite = pp.finite_strain(tissue).push(TOP, push, RADIUS).force
    told = answer.estimate.linearisation
    assert told == pytest.approx((answer.force @ push) / (finite @ push) - 1, abs=0.015)
    assert told < -0.2  # a linear force is much too small


def test_a_tissue_file_keeps_it(tmp_path):
    mesh = brick((3, 3, 3), region=lambda x: 1 + (x[:, 2] > 25))
    tissue = pp.Tissue(mesh, 5.0, 0.4, mesh.nodes[:, 2] == 0, stiffening={1: 2.0, 2: 7.5})
    pp.write_tissue(tmp_path / "tissue.vtu", tissue)
    np.testing.assert_array_equal(pp.read_tissue(tmp_path / "tissue.vtu").stiffening, tissue.stiffening)
    pp.write_tissue(tmp_path / "plain.vtu", block(3))
    assert b"stiffening" not in (tmp_path / "plain.vtu").read_bytes()
    assert not pp.read_tissue(tmp_path / "plain.vtu").stiffening.any()


def test_a_record_fits_only_its_tissue():
    tissue = block(5, stiffening=4.0)
    session = pp.Session(pp.model(tissue, "neo-hookean"), radius=RADIUS)
    session.step([pp.Command(True, tuple(TOP), (0, 0, -0.05 * k)) for k in range(60)])
    record = session.record()
    assert session_like(record, tissue).replay(record) is None
    for other in (0.0, 5.0):
        with pytest.raises(DataError, match="made on tissue"):
            pp.Session(pp.model(block(5, stiffening=other), "neo-hookean"), radius=RADIUS).replay(record)


def test_fit_keeps_it_and_fits_springs_to_small_strain():
    mesh = brick((3, 3, 3))
    fits = [pp.fit(mesh, 5.0, 0.4, mesh.nodes[:, 2] == 0, stiffening=b) for b in (0.0, 3.0)]
    assert (fits[1].stiffening == 3).all()
    assert fits[0].springs == fits[1].springs


@pytest.mark.parametrize(
    ("stiffening", "complaint"),
    [(-1.0, "-1 at tet 0"), (101.0, "101 at tet 0"), (np.nan, "not finite"), ({2: 5.0}, "no region 2")],
)
def test_what_is_no_stiffening_is_refused(stiffening, complaint):
    with pytest.raises((MaterialError, DataError), match=complaint):
        block(3, stiffening=stiffening)
