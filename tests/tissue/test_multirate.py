"""Finite strain at two rates: the force between solutions, the solutions, and what a hand feels of both in a session."""

import numpy as np
import pytest
from support.brick_meshes import block
from support.example_organs import organ
from support.running_server import until

import palpate as pp
from palpate import _core
from palpate.simulation.recorded_session import session_like
from palpate.simulation.scripted_device import ScriptedDevice
from palpate.tissue.contact_patches import contacts

RADIUS, TOP = 12.0, np.array([25.0, 25.0, 50.0])
TISSUE = block(7, poisson=0.45)


def local(energy, d, gradient, curvature, stiffens=False):
    return _core.hyperelastic.LocalForce(energy, d, gradient, curvature, stiffens)


def random_local(seed, contacts=2, stiffens=False):
    rng = np.random.default_rng(seed)
    n = 3 * contacts
    K, d = rng.standard_normal((n, n)), rng.standard_normal(n)
    if stiffens:  # an energy that grows as a power from 2 to 5
        energy = rng.uniform(0.5, 2)
        gradient = rng.standard_normal(n)
        gradient += (rng.uniform(2, 5) * energy - gradient @ d) / (d @ d) * d
        return local(energy, d, gradient, K + K.T, stiffens), rng
    return local(rng.standard_normal(), d, rng.standard_normal(n), K + K.T), rng


@pytest.mark.parametrize("stiffens", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_the_local_force_is_the_gradient_of_its_energy(seed, stiffens):
    """Everywhere: then no closed way of the tools does work."""
    P, rng = random_local(seed, stiffens=stiffens)
    for _ in range(20):
        d, way = rng.standard_normal(6), rng.standard_normal(6)
        h = 1e-5
        slope = (P.at(d + h * way)[0] - P.at(d - h * way)[0]) / (2 * h)
        assert P.at(d)[1] @ way == pytest.approx(slope, rel=1e-6, abs=1e-8)


def test_the_local_force_meets_the_solution_and_rest():
    d0, g = np.array([1.0, -2.0, 0.5]), np.array([0.3, 0.2, -0.4])
    K = np.array([[2.0, 0.1, 0.3], [0.1, 1.0, -0.2], [0.3, -0.2, 3.0]])
    P = local(0.7, d0, g, K)
    assert P.at(d0)[0] == pytest.approx(0.7)
    np.testing.assert_allclose(P.at(d0)[1], g, atol=1e-14)
    h = 1e-6
    for side in (1, -1):  # the two pieces of the polynomial meet
        step = h * np.array([0.4, -1.0, 0.2]) * side
        np.testing.assert_allclose((P.at(d0 + step)[1] - g) / h, K @ step / h, atol=1e-4)
    for direction in np.eye(3):
        np.testing.assert_allclose(P.at(1e-4 * direction)[1], 0, atol=1e-6)  # stiffness at rest is the linear one


@pytest.mark.parametrize("degree", [3, 4, 5])
def test_a_power_of_the_displacement_is_met_between_rest_and_the_solution(degree):
    """Energies |d|^n, n to 5, along the way to the solution."""
    d0 = np.array([0.0, 0.0, -2.0])
    size = 2.0
    gradient = degree * size ** (degree - 2) * d0
    K = degree * size ** (degree - 2) * (np.eye(3) + (degree - 2) * np.outer(d0, d0) / size**2)
    P = local(size**degree, d0, gradient, K)
    for s in (0.2, 0.5, 0.9):
        energy, force = P.at(s * d0)
        assert energy == pytest.approx((s * size) ** degree)
        assert force[2] == pytest.approx(-degree * (s * size) ** (degree - 1))


def test_beyond_the_solution_tissue_that_stiffens_grows_as_a_power():
    """|d|⁴ from its value and slope alone: a tenth beyond, to the part of its second derivative that fades."""
    d0, s = np.array([0.0, 0.0, -2.0]), 1.1
    exact = 4 * (2 * s) ** 3
    force = [-local(16.0, d0, 16 * d0, np.zeros((3, 3)), stiffens).at(s * d0)[1][2] for stiffens in (False, True)]
    assert force[1] == pytest.approx(exact, rel=0.01)
    assert force[0] < 0.8 * exact


def solver():
    return _core.hyperelastic.EquilibriumSolver(pp.model(TISSUE, "neo-hookean").equilibrium)


def solved(by, displacement, from_rest=True):
    found = contacts(TISSUE, TOP, displacement, RADIUS)
    return by.solve(found.patches, found.displacement, from_rest)


def test_a_solution_has_the_force_and_stiffness_of_the_equilibrium():
    """Against pushes solved to 1e-8 and their differences; its own error is told to be below 1 %."""
    model, d = pp.model(TISSUE, "neo-hookean"), np.array([2.0, 1.0, -8.0])
    by = solver()
    for attempt in range(3):  # a tool that is held: the response of the solution before is made better
        error, realised, force, stiffness = solved(by, d, from_rest=attempt == 0)
    exact = pp.model(TISSUE, "neo-hookean").push(TOP, d, RADIUS, tolerance=1e-8).force
    np.testing.assert_allclose(realised[0], d, atol=1e-8)
    off = np.linalg.norm(force[0] - exact) / np.linalg.norm(exact)
    assert off < 0.01
    assert error < 0.01
    h, columns = 0.01, []
    for e in np.eye(3):
        after, before = (model.push(TOP, d + s * h * e, RADIUS, tolerance=1e-9).force for s in (1, -1))
        columns.append((before - after) / (2 * h))
    expected = np.stack(columns, axis=1)
    np.testing.assert_allclose(stiffness, expected, atol=0.04 * np.abs(expected).max())


def test_a_solution_from_the_one_before_is_the_one_from_rest():
    by = solver()
    for depth in (3.0, 6.0, 9.0):
        force = solved(by, (0, 0, -depth), from_rest=depth == 3)[2]
    again = solved(solver(), (0, 0, -9.0))[2]
    np.testing.assert_allclose(force, again, rtol=0.01, atol=0.01 * np.abs(again).max())


def test_the_support_bears_what_a_patch_puts_on_a_fixed_node():
    """A patch of a free node and of a fixed one moves the free one twice as far, with half the force on it."""
    free, fixed = int(np.argmin(np.linalg.norm(TISSUE.mesh.nodes - TOP, axis=1))), int(TISSUE.fixed[0])
    both = _core.tissue.ContactPatch(np.array([free, fixed], np.int32), np.array([0.5, 0.5]))
    alone = _core.tissue.ContactPatch(np.array([free], np.int32), np.array([1.0]))
    far = solver().solve([both], np.array([[0.0, 0.0, -0.5]]), True)[2]
    near = solver().solve([alone], np.array([[0.0, 0.0, -1.0]]), True)[2]
    np.testing.assert_allclose(far, 2 * near, rtol=0.03, atol=0.03 * np.abs(near).max())


def pressed(depth, ticks, hold=0, back=True):
    """Commands that press at a steady speed, hold, and come back."""
    way = np.concatenate(
        [np.linspace(0, depth, ticks), np.full(hold, depth), np.linspace(depth, 0, ticks if back else 0)]
    )
    return [pp.Command(True, tuple(TOP), (0, 0, -float(d))) for d in way]


def quasi_static(displacements):
    """N on the tool for each displacement, from pushes solved one after the other."""
    model, warm, out = pp.model(TISSUE, "neo-hookean"), None, []
    for d in displacements:
        answer = model.push(TOP, d, RADIUS, tolerance=1e-4, warm=warm)
        warm = answer.warm
        out.append(answer.force)
    return np.array(out)


def felt(model, commands, every=10):
    """Displacement of the contact, and force of the model, at every tenth tick; a tool follows its command with a lag."""
    session, out = pp.Session(model, radius=RADIUS), []
    for first in range(0, len(commands), every):
        session.step(commands[first : first + every])
        frame = session.frame()
        out.append((frame.displacement[0], frame.model_force[0]))
    return tuple(np.array(part) for part in zip(*out, strict=True))


def test_a_hand_feels_the_quasi_static_force_of_a_fast_deep_press():
    """15 of 50 mm at 100 mm/s, down, held and back: within 5 % RMS of the largest force, at worst 15 %."""
    commands = pressed(15.0, 150, hold=60)
    displacements, force = felt(pp.model(TISSUE, "neo-hookean"), commands)
    truth = quasi_static(displacements)
    off = np.linalg.norm(force - truth, axis=1) / np.linalg.norm(truth, axis=1).max()
    assert np.sqrt((off**2).mean()) < 0.05
    assert off.max() < 0.15
    linear = felt(pp.model(TISSUE, "compliance"), commands)[1]
    assert np.abs(linear - truth).max() > 0.08 * truth.max()  # which linear elasticity is not


def test_a_hand_that_slides_and_sinks_a_little_feels_the_quasi_static_force():
    """Over the top of a round organ at 200 mm/s: what the place does to the force is no stiffness against the depth."""
    tissue, radius = organ(9), 9.0
    ends = np.array([[11.461, -9.364, 0.0], [11.461, -9.364, 2.0624], [-3.786, 2.741, 2.235]])
    x, y, depth = np.concatenate([np.linspace(*ends[:2], 10), np.linspace(*ends[1:], 93)]).T
    z = 25 * np.sqrt(1 - (x / 40) ** 2 - (y / 30) ** 2)
    there = [pp.Command(True, at, (0, 0, -d)) for *at, d in zip(x, y, z, depth, strict=True)]
    model = pp.model(tissue, "neo-hookean")
    session, warm, off = pp.Session(model, radius=radius), None, []
    for first in range(0, len(there), 5):
        session.step(there[first : first + 5])
        frame = session.frame()
        answer = model.push(frame.point[0], frame.displacement[0], radius, tolerance=1e-4, warm=warm)
        warm = answer.warm
        off.append(np.linalg.norm(frame.model_force[0] - answer.force))
    assert max(off) < 0.1 * np.linalg.norm(answer.force)


def test_no_solution_comes_with_a_step():
    commands = pressed(15.0, 400, hold=100, back=False)
    force = pp.Session(pp.model(TISSUE, "neo-hookean"), radius=RADIUS).step(commands)[:, 2]
    assert np.abs(np.diff(force)).max() < 0.02 * force.max()


def test_a_held_push_settles_on_the_equilibrium():
    force = pp.Session(pp.model(TISSUE, "neo-hookean"), radius=RADIUS).step(pressed(12.0, 100, hold=150, back=False))
    truth = quasi_static([(0, 0, -4.0), (0, 0, -8.0), (0, 0, -12.0)])[-1]
    assert np.linalg.norm(force[-1] - truth) < 0.01 * np.linalg.norm(truth)


def test_a_session_is_at_rest_once_its_tools_are_gone():
    session = pp.Session(pp.model(TISSUE, "neo-hookean"), radius=RADIUS)
    session.step([*pressed(8.0, 50, back=False), None])
    assert not session.displacement.any()
    first = session.step(pressed(5.0, 60, back=False))
    again = pp.Session(pp.model(TISSUE, "neo-hookean"), radius=RADIUS).step(pressed(5.0, 60, back=False))
    np.testing.assert_allclose(first, again, atol=0.01 * np.abs(again).max())


def by_the_clock(model, commands, tools=None):
    session = pp.Session(model, radius=RADIUS, sweeps=1)
    ticks = list(range(len(commands))) if tools is None else [i // 2 for i in range(len(commands))]
    with session:
        session.start(ScriptedDevice(ticks, commands, tools))
        until(lambda: session.frame().tick > ticks[-1] + 50)
    return session


def test_a_session_by_the_clock_replays_to_the_bit():
    """Solutions come when the thread has them; the record says at which ticks."""
    commands = [*pressed(12.0, 200, hold=100), pp.Command()]
    model = pp.model(TISSUE, "neo-hookean")
    session = by_the_clock(model, commands)
    record = session.record()
    assert (record.lacking & 8).any()  # a solution was taken
    assert pp.Session(model, radius=RADIUS, sweeps=1).replay(record) is None


def test_so_does_one_of_two_tools_that_come_and_go():
    first = [*pressed(8.0, 150, hold=150), *[pp.Command()] * 50]
    second = [*[pp.Command()] * 100, *[pp.Command(True, (12.0, 12.0, 50.0), (0, 0, -4.0))] * 150]
    second += [pp.Command()] * (len(first) - len(second))
    both = [command for pair in zip(first, second, strict=True) for command in pair]
    model = pp.model(TISSUE, "neo-hookean")
    session = by_the_clock(model, both, [0, 1] * len(first))
    assert pp.Session(model, radius=RADIUS, sweeps=1).replay(session.record()) is None


def test_a_record_of_the_descent_in_the_ticks_replays():
    """As version 0.1 ran it: `interval` is 0, and part of the record."""
    model = pp.model(TISSUE, "neo-hookean", interval=0)
    session = pp.Session(model, radius=RADIUS, sweeps=1)
    session.step(pressed(3.0, 50))
    record = session.record()
    assert record.settings["interval"] == 0
    assert session_like(record, TISSUE).replay(record) is None
    with pytest.raises(pp.errors.DataError, match="interval"):
        pp.Session(pp.model(TISSUE, "neo-hookean"), radius=RADIUS, sweeps=1).replay(record)


def test_linear_elasticity_hands_over_without_a_step():
    session = pp.Session(pp.model(TISSUE, "compliance"), radius=RADIUS)
    before = session.step(pressed(12.0, 200, hold=50, back=False))
    assert session.change(pp.model(TISSUE, "neo-hookean"))
    held = session.step([pp.Command(True, tuple(TOP), (0, 0, -12.0))] * 500)
    force = np.linalg.norm(np.concatenate([before[-1:], held]), axis=1)
    truth = np.linalg.norm(quasi_static([(0, 0, -6.0), (0, 0, -12.0)])[-1])
    assert abs(force[0] / truth - 1) > 0.05
    assert force[-1] == pytest.approx(truth, rel=0.01)
    assert np.abs(np.diff(force)).max() < 0.02 * truth


def test_the_age_of_the_solution_is_said():
    session = pp.Session(pp.model(TISSUE, "neo-hookean", interval=30), radius=RADIUS)
    session.step(pressed(10.0, 200, back=False))
    assert 0.03 <= session.frame().solution_age <= 0.061
    assert 0 < session.frame().solution_error < 0.2
    session.step([None])
    assert session.frame().solution_age == 0


def test_what_cannot_be_is_refused():
    with pytest.raises(pp.errors.DataError, match="interval"):
        pp.model(TISSUE, "neo-hookean", interval=-1)
    with pytest.raises(ValueError, match="3 numbers a contact"):
        local(1.0, np.zeros(4), np.zeros(4), np.eye(4))


@pytest.mark.parametrize(
    ("interval", "stride", "words"),
    [(0, 1.0, "interval"), (20, 0.0, "stride"), (20, -1.0, "stride"), (20, np.nan, "stride")],
)
def test_rates_that_cannot_be_are_refused_by_the_core(interval, stride, words):
    model = pp.model(TISSUE, "neo-hookean")
    with pytest.raises(ValueError, match=words):
        _core.multirate.MultirateModel(model.linear.native, model.equilibrium, interval, stride)
