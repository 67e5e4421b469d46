"""The loop: ticks, grip, forces, and what it does when something is wrong."""

import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.example_organs import ellipsoid, organ

import palpate as pp
from palpate import _core

TOP = (0.0, 0.0, 25.0)
IDLE, HOLDING, REFUSED = 0, 1, 2


def press(depth, point=TOP):
    return pp.Command(True, point, (0.0, 0.0, -depth))


@pytest.fixture(scope="module")
def model():
    return pp.model(organ(), "blocks")


@pytest.fixture
def session(model):
    return pp.Session(model, radius=10.0, sweeps=20)


def test_every_tick_is_counted(session):
    session.step([press(1.0)] * 7)
    session.step([None] * 5)
    assert session.frame().tick == 12
    assert session.record().length == 12


def test_settled_force_is_that_of_push(session, model):
    force = session.step([press(4.0)] * 500)[-1]
    expected = model.push(TOP, (0, 0, -4.0), 10.0, tolerance=1e-5)
    assert np.linalg.norm(expected.force) > 0.1
    assert np.linalg.norm(force - expected.force) <= 1e-3 * np.linalg.norm(expected.force)
    np.testing.assert_allclose(session.displacement, expected.displacement, atol=4e-3 * 4.0)


def test_tissue_never_helps_the_tool(session):
    """Pressed or pulled ever further, the force opposes the displacement."""
    for sign in (1, -1):
        for depth in np.linspace(0.1, 3, 30):
            force = session.step([press(sign * depth)] * 20)[-1]
            assert force[2] * sign > 0
        session.step([None] * 2000)


def test_force_is_zero_from_the_tick_of_release(session):
    before = session.step([press(4.0)] * 100)
    after = session.step([None] * 10)
    assert np.abs(before[-1]).max() > 0.1
    assert (after == 0).all()
    assert tuple(session.frame().device_force[0]) == (0, 0, 0)


def test_released_tissue_goes_home_and_rests(session):
    session.step([press(4.0)] * 100)
    moved = np.abs(session.displacement).max()
    session.step([None] * 100)
    assert np.abs(session.displacement).max() < moved / 10
    session.step([None] * 3000)
    assert (session.displacement == 0).all()


def test_grabbed_surface_moves_as_the_tool_says(session, model):
    session.step([press(3.0)] * 300)
    patch = model.tissue.surface.patch(model.tissue.surface.closest(np.array(TOP)), 10.0)
    mean = patch.weights @ session.displacement[patch.nodes]
    np.testing.assert_allclose(mean, (0, 0, -3.0), atol=1e-5)


def test_stroking_moves_the_contact_along_the_surface(session):
    session.step([press(2.0)] * 100)
    session.step([press(2.0, (15.0, 0.0, 23.0))] * 300)
    frame = session.frame()
    assert frame.contact[0] == HOLDING
    np.testing.assert_allclose(frame.point[0], (15.0, 0.0, 23.0), atol=0.5)


def test_glide_is_smooth_between_commands(session):
    """A command that jumps by 6 mm gives no step in the force: ticks share the way."""
    force = np.linalg.norm(session.step([press(6.0)] * 300), axis=1)
    assert np.diff(force, prepend=0).max() < 0.2 * force[-1]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_command_that_is_no_number_gives_no_force_until_let_go(session, bad):
    session.step([press(3.0)] * 100)
    poisoned = pp.Command(True, TOP, (0.0, bad, -3.0))
    assert (session.step([poisoned] * 5) == 0).all()
    assert session.frame().contact[0] == REFUSED
    assert session.frame().faults == 0  # it never reached the tissue
    assert (session.step([press(3.0)] * 20) == 0).all()  # still held: not taken up again
    session.step([None])
    assert np.abs(session.step([press(3.0)] * 50)[-1]).max() > 0.1
    assert np.isfinite(session.displacement).all()


def test_held_nodes_cannot_be_taken(session):
    force = session.step([press(3.0, (0.0, 0.0, -25.0))] * 20)
    assert session.frame().contact[0] == REFUSED
    assert (force == 0).all()


def test_watchdog_sends_a_broken_tissue_home():
    """Every node tied to the middle one by a stiffness that is no number: force zero, home, the hand must let go."""
    tissue = organ()
    n = len(tissue.mesh.nodes)
    middle = n // 2
    others = np.delete(np.arange(n, dtype=np.int32), middle)
    rows = [[i, middle] if i != middle else [middle, *others] for i in range(n)]
    start = np.cumsum([0] + [len(row) for row in rows]).astype(np.int32)
    column = np.concatenate(rows).astype(np.int32)
    own = column == np.repeat(np.arange(n), np.diff(start))
    block = np.where(own[:, None, None], np.eye(3), np.nan)
    broken = _core.relaxation.BlockGaussSeidel(start, column, block, tissue.held.view(np.uint8), 1.0)
    session = pp.Session(SimpleNamespace(native=broken, tissue=tissue, relaxation=1.0), radius=10.0, sweeps=2)
    force = session.step([press(3.0)] * 10)
    assert (force == 0).all()
    assert (session.displacement == 0).all()
    frame = session.frame()
    assert frame.faults == 1
    assert frame.contact[0] == REFUSED


def test_push_on_the_device_is_limited_and_ramped():
    mesh = ellipsoid()
    stiff = pp.Tissue(mesh, 200.0, 0.45, pp.resting_on(mesh, (0, 0, -1), depth=8.0))
    session = pp.Session(pp.model(stiff, "blocks"), radius=10.0, sweeps=20, limit=3.0)
    pushed, force = [], []
    for _ in range(60):
        force.append(np.linalg.norm(session.step([press(6.0)])))
        pushed.append(np.linalg.norm(session.frame().device_force[0]))
    assert force[-1] > 10  # the tissue's own force passes the limit,
    assert np.diff(force).max() > 0.5  # and rises faster than the ramp
    assert max(pushed) == pytest.approx(3.0)
    assert np.diff(pushed, prepend=0).max() <= session.settings.ramp * (1 + 1e-12)
    assert (np.array(pushed) <= np.array(force) + 1e-12).all()


points = st.tuples(*[st.floats(-40, 40)] * 3)
moves = st.tuples(*[st.floats(-8, 8)] * 3)
commands = st.lists(st.one_of(st.none(), st.builds(pp.Command, st.just(True), points, moves)), min_size=1, max_size=6)


@settings(max_examples=25, deadline=None)
@given(commands)
def test_same_commands_give_same_bits(few):
    model = pp.model(organ(), "springs")
    ticks = [command for command in few for _ in range(25)]
    whole, parts = (pp.Session(model, radius=10.0, sweeps=4) for _ in range(2))
    together = whole.step(ticks)
    one_by_one = np.concatenate([parts.step([command]) for command in ticks])
    assert np.isfinite(together).all()
    assert together.tobytes() == one_by_one.tobytes()
    assert whole.displacement.tobytes() == parts.displacement.tobytes()


def test_late_ticks_are_counted_when_a_tick_takes_too_long(model):
    """300 sweeps of 3000 tetrahedra take several milliseconds on any machine: every tick is late, none runs twice."""
    session = pp.Session(model, radius=10.0, sweeps=300)
    pointer = pp.Pointer()
    pointer.send(press(2.0))
    with session:
        session.start(pointer)
        while session.frame().tick < 50:
            pass
    frame = session.frame()
    assert 40 <= frame.late <= frame.tick


def first_in_first_out():
    """Threads of this process that go ahead of ordinary ones: field 41 of the kernel's account is their policy."""
    accounts = [path.read_text() for path in Path("/proc/self/task").glob("*/stat")]
    return sum(account.rsplit(")", 1)[1].split()[38] == "1" for account in accounts)


@pytest.mark.skipif(sys.platform != "linux", reason="threads are read from /proc")
def test_the_loop_alone_goes_ahead_of_other_threads_where_the_system_lets_it(model):
    session = pp.Session(model, radius=9.0, sweeps=2)
    assert first_in_first_out() == 0
    with session:
        session.start(pp.Pointer())
        while session.frame().tick < 50:
            time.sleep(0.01)
        assert first_in_first_out() == _core.simulation.realtime_priority()
    assert first_in_first_out() == 0


def test_stop_lets_go(model):
    session = pp.Session(model, radius=10.0, sweeps=4)
    pointer = pp.Pointer()
    pointer.send(press(3.0))
    with session:
        session.start(pointer)
        while np.abs(session.frame().force[0]).max() < 0.05:
            pass
    frame = session.frame()
    assert frame.contact[0] == IDLE
    assert tuple(frame.force[0]) == tuple(frame.device_force[0]) == (0, 0, 0)


def test_a_pointer_s_commands_arrive_as_they_were_sent(model):
    """Every coordinate, kind and tool, at the tick that the record says."""
    session, pointer = pp.Session(model, radius=10.0, sweeps=2), pp.Pointer()
    rng, kinds = np.random.default_rng(4), ("hold", "needle", "free", "hold")
    sent = [pp.Command(True, tuple(rng.uniform(5, 30, 3)), tuple(rng.uniform(-1, 1, 3)), kind) for kind in kinds]
    for tool, command in enumerate(sent):
        pointer.send(command, 1, tool)
    with session:
        session.start(pointer)
        while session.frame().tick < 20:
            pass
    record = session.record()
    assert record.tools[:4].tolist() == [0, 1, 2, 3]
    for at, command in enumerate(sent):
        assert record.kinds[at] == command.number
        assert tuple(record.points[at]) == command.point
        assert tuple(record.displacements[at]) == command.displacement


def test_newest_command_wins(model):
    session = pp.Session(model, radius=10.0, sweeps=4)
    pointer = pp.Pointer()
    for depth in range(1, 40):
        pointer.send(press(float(depth)), serial=depth)
    pointer.send(press(2.0), serial=40)
    with session:
        session.start(pointer)
        while session.frame().tick < 300:
            pass
        frame = session.frame()
    assert frame.serial == 40
    assert frame.displacement[0][2] >= -2.0
    assert len(session.record().ticks) == 2  # the one command obeyed, and letting go


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"radius": -1.0}, ("radius", "-1", "default")),
        ({"radius": float("nan")}, ("radius", "nan", "default")),
        ({"sweeps": 0}, ("sweeps", "0", "1 to 10000")),
        ({"limit": 0.0}, ("limit", "0", "default")),
        ({"radius": 1000.0}, ("radius 1000", "256 nodes", "smaller radius")),
    ],
)
def test_settings_that_cannot_be_are_refused(model, wrong, words):
    with pytest.raises(pp.errors.DataError) as refusal:
        pp.Session(model, **wrong)
    for word in words:
        assert word in str(refusal.value)


def test_stepping_a_running_session_is_refused(model):
    session = pp.Session(model, radius=10.0, sweeps=1)
    with session:
        session.start(pp.Pointer())
        for use in (lambda: session.step([None]), session.record, lambda: session.displacement):
            with pytest.raises(pp.errors.DataError, match="stop"):
                use()
