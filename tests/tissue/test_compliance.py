"""Model `compliance`: finite elements by tables, exact wherever they came from, and gentle where they are late."""

import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.brick_meshes import block
from support.example_organs import organ
from support.running_server import until

import palpate as pp
from palpate import _core
from palpate.errors import DataError
from palpate.tissue.contact_patches import contacts, patch
from palpate.tissue.models.compliance import ComplianceModel

PUSH = np.array([0.4, -0.2, -3.0])


@functools.cache
def cube():
    """11³ nodes of 5 mm: its finite elements, its model."""
    tissue = block(11)
    return pp.finite_elements(tissue), pp.model(tissue, "compliance")


@functools.cache
def lumpy():
    tissue = organ(11)
    return pp.finite_elements(tissue), pp.model(tissue, "compliance")


@pytest.fixture(autouse=True, scope="module")
def forget():
    """The native objects go before the interpreter does."""
    yield
    cube.cache_clear()
    lumpy.cache_clear()


def spot(model, point, radius=10.0):
    return patch(model.tissue, np.asarray(point, float), radius)


def line(count, start=(12.0, 23.0, 50.0), end=(38.0, 30.0, 50.0)):
    return np.linspace(start, end, count)


@settings(max_examples=25, deadline=None)
@given(st.sampled_from([cube, lumpy]), st.integers(1, 3), st.integers(0, 2**31))
def test_a_push_is_that_of_finite_elements(make, many, seed):
    truth, model = make()
    rng = np.random.default_rng(seed)
    free = model.vertices[np.isin(model.vertices, model.tissue.mesh.surface_nodes)]
    nodes = model.tissue.mesh.nodes[rng.choice(free, many, replace=False)]
    push, radii = rng.normal(0, 2, (many, 3)), rng.uniform(4, 16, many)
    try:
        expected = truth.push(nodes, push, radii)
    except DataError:  # two patches too near each other
        return
    answer = model.push(nodes, push, radii)
    deepest = np.abs(expected.displacement).max()
    assert np.abs(answer.displacement - expected.displacement).max() < 1e-9 * deepest
    assert np.abs(answer.force - expected.force).max() < 1e-9 * np.abs(expected.force).max()
    assert np.abs(answer.realised - push).max() < 1e-9
    assert 0 < answer.error < 1e-6


@settings(max_examples=25, deadline=None)
@given(st.floats(-14, -2), st.integers(0, 2**31))
def test_the_bound_holds_whatever_the_error(digits, seed):
    """The certificate of a field that is off by a known amount."""
    _, model = cube()
    found = contacts(model.tissue, [25.0, 25.0, 50.0], PUSH, 12.0)
    nodes, load = model.loads(found)
    whole = np.zeros((len(model.places), 3))
    whole[nodes] = (load @ PUSH).reshape(-1, 3)
    exact = model.factors.solve(whole.ravel())
    wrong = exact + 10**digits * np.abs(exact).max() * np.random.default_rng(seed).standard_normal(len(exact))
    K = model.elements.K[model.elements.free][:, model.elements.free]
    off = wrong - exact
    true = np.sqrt(off @ (K @ off) / (exact @ (K @ exact)))
    bound = model._certified_error(wrong, whole.ravel())
    assert bound >= true
    assert bound == np.inf or bound / (1 + bound) < 1000 * true + 1e-9  # near 1 the bound grows without end


@pytest.mark.parametrize("make", [cube, lumpy])
def test_force_of_the_loop_is_that_of_finite_elements(make):
    truth, model = make()
    rng = np.random.default_rng(5)
    state = model.start()
    for node in rng.choice(model.tissue.mesh.surface_nodes[~model.tissue.held[model.tissue.mesh.surface_nodes]], 12):
        x, push = model.tissue.mesh.nodes[node], rng.normal(0, 2, 3)
        expected = truth.push(x, push, 12.0).force
        model.native.relax(state, None, np.zeros(3), 1)
        force = model.native.relax(state, spot(model, x, 12.0), push, 1)
        assert np.abs(force - expected).max() < 1e-4 * np.abs(expected).max()  # a tenth of what is promised
        assert not state.stale


def test_a_patch_of_one_node_is_felt_too():
    """A radius of 0 at a node, so its table reaches nowhere; in lockstep, and by a thread of its own."""
    _, model = cube()
    x, push = np.array([[25.0, 25.0, 50.0]]), np.array([0.1, 0.0, -0.5])
    expected = model.push(x[0], push, 0.0).force
    state = model.start()
    under = spot(model, x[0], 0.0)
    assert len(under.nodes) == 1
    assert np.abs(model.native.relax(state, under, push, 1) - expected).max() < 1e-4 * np.abs(expected).max()
    surface = model.tissue.surface
    _, _, force, cold, _ = _core.benchmark.time_stroke(
        model.native, model.start(), surface, 0.0, x.repeat(600, 0), push, 1, 1, True
    )
    assert not cold[-1]
    assert np.abs(force[-1] - expected).max() < 1e-4 * np.abs(expected).max()


def test_tables_give_the_same_bits_whoever_made_them_and_when():
    _, model = cube()
    fresh, ready = model.start(), model.start()
    every = np.arange(len(model.vertices), dtype=np.int32)
    ready.make_near(np.random.default_rng(1).permutation(every), 60.0)
    for x in line(40):
        forces = [model.native.relax(state, spot(model, x), PUSH, 1) for state in (fresh, ready)]
        assert (forces[0] == forces[1]).all()
    assert fresh.made[0] < len(every) / 3


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([0.03, 0.06, 256.0]))
def test_nor_does_what_was_thrown_away_or_made_wider_change_them(seed, memory):
    """Patches anywhere, of any breadth, one after the other, with room for a few tables or for all."""
    _, model = cube()
    rng, held = np.random.default_rng(seed), ComplianceModel(model.tissue, memory=memory)
    state = held.start()
    for _ in range(30):
        under = spot(model, (*rng.uniform(0, 50, 2), 50.0), rng.uniform(3, 14))
        force = held.native.relax(state, under, PUSH, 1)
        assert (force == model.native.relax(model.start(), under, PUSH, 1)).all()
        held.native.relax(state, None, np.zeros(3), 1)  # or the new force would be led up to from the last one
    assert (state.made[2] > 0) == (memory < 1)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**31))
def test_looking_ahead_changes_no_bit(seed):
    """Whatever patches are expected, the ones that come or not: a tick answers as one that expected nothing."""
    _, model = cube()
    rng = np.random.default_rng(seed)
    plain, told = model.start(), model.start()
    way = np.cumsum(rng.normal(0, 1.5, (40, 3)), axis=0) * (1, 1, 0) + (25.0, 25.0, 50.0)
    for x, coming in zip(way, [*way[1:], way[0]], strict=True):
        under = spot(model, np.clip(x, 0, 50))
        forces = [model.native.relax(state, under, PUSH, 1) for state in (plain, told)]
        assert (forces[0] == forces[1]).all()
        about = [spot(model, np.clip(coming + rng.normal(0, spread, 3) * (1, 1, 0), 0, 50)) for spread in (0, 4)]
        model.native.prefetch(told, about[: rng.integers(0, 3)])
    assert (
        model.native.displayed_displacement(plain, model.vertices)
        == model.native.displayed_displacement(told, model.vertices)
    ).all()


def test_letting_go_leaves_nothing_behind():
    _, model = cube()
    state, other = model.start(), model.start()
    model.native.relax(state, spot(model, (15.0, 15.0, 50.0)), PUSH, 1)
    assert (model.native.relax(state, None, np.zeros(3), 1) == 0).all()
    assert np.abs(model.native.displayed_displacement(state, model.vertices)).max() == 0
    again = [model.native.relax(s, spot(model, (30.0, 25.0, 50.0)), PUSH, 1) for s in (state, other)]
    assert (again[0] == again[1]).all()


def test_displays_agree_with_finite_elements():
    truth, model = lumpy()
    state = model.start()
    x = (5.0, 3.0, 24.0)
    expected = truth.push(x, PUSH, 12.0).displacement
    under = spot(model, x, 12.0)
    model.native.relax(state, under, PUSH, 1)
    direct = model.native.displayed_displacement(state, model.vertices)
    number = np.full(len(model.tissue.mesh.nodes), -1, np.int32)
    number[model.vertices] = np.arange(len(model.vertices))
    assert not state.has_columns(number[under.nodes])
    state.make_columns(number[under.nodes])
    assert state.has_columns(number[under.nodes])
    contracted = model.native.displayed_displacement(state, model.vertices)
    for shown in (direct, contracted):
        assert np.abs(shown - expected[model.vertices]).max() < 1e-4 * np.abs(PUSH).max()
    assert (direct != contracted).any()  # two ways, not one twice


def test_a_session_shows_and_keeps_the_whole_field():
    truth, model = cube()
    session = pp.Session(model, radius=10.0)
    session.step([pp.Command(True, (25.0, 25.0, 50.0), tuple(PUSH))] * 400)
    expected = truth.push([25.0, 25.0, 50.0], PUSH, 10.0)
    assert np.abs(session.displacement - expected.displacement).max() < 1e-4
    assert np.abs(session.frame().shown - expected.displacement[session.shown]).max() < 1e-4
    assert np.abs(session.frame().force[0] - expected.force).max() < 1e-4 * np.abs(expected.force).max()


def test_the_budget_is_kept_and_what_is_in_use_stays():
    truth, model = cube()
    model = ComplianceModel(model.tissue, memory=0.2)
    state = model.start()
    most = 0
    for x in line(60, (5.0, 5.0, 50.0), (45.0, 45.0, 50.0)):
        force = model.native.relax(state, spot(model, x), PUSH, 1)
        most = max(most, state.bytes)
    assert state.made[2] > 10  # the path needs more than the budget holds
    assert most < 0.2 * 2**20
    expected = truth.push(x, PUSH, 10.0).force
    assert np.abs(force - expected).max() < 1e-4 * np.abs(expected).max()
    for x in line(60, (45.0, 45.0, 50.0), (5.0, 5.0, 50.0)):
        back = model.native.relax(state, spot(model, x), PUSH, 1)
    expected = truth.push(x, PUSH, 10.0).force
    assert np.abs(back - expected).max() < 1e-4 * np.abs(expected).max()


def glide(ticks):
    """A hand that holds at 3 mm and slides at 100 mm/s, mm a tick."""
    return [pp.Command(True, (10.0 + 0.1 * i, 25.0, 50.0), (0.0, 0.0, -3.0)) for i in range(ticks)]


def lateness(session, switches, ticks=300):
    """Forces of a session whose tables come late between the ticks of `switches`."""
    commands = glide(ticks)
    device = _core.simulation.Replay(
        np.arange(ticks, dtype=np.int64),
        np.zeros(ticks, dtype=np.uint8),
        np.ones(ticks, dtype=np.uint8),
        np.array([c.point for c in commands]),
        np.array([c.displacement for c in commands]),
        np.array(switches, dtype=np.int64),
        (np.arange(len(switches)) % 2 == 0).astype(np.uint8),
    )
    return session.loop.step(device, ticks)[:, 0]


@pytest.mark.parametrize("late", [20, 60, 100])
def test_late_tables_step_the_force_by_two_per_cent_at_most(late):
    _, model = cube()
    prompt = lateness(pp.Session(model, radius=10.0), [])
    waited = lateness(pp.Session(model, radius=10.0), [100, 100 + late])
    assert (prompt[:100] == waited[:100]).all()
    assert np.abs(waited - prompt)[100 : 100 + late].max() > 1e-4  # the tables were missed
    force = np.linalg.norm(waited, axis=1)
    step = np.linalg.norm(np.diff(waited, axis=0), axis=1)
    own = np.linalg.norm(np.diff(prompt, axis=0), axis=1)  # what the surface itself does under a moving hand
    assert (step[90:] <= 0.02 * force[90:-1] + own[90:]).all()
    assert np.abs(waited[-20:] - prompt[-20:]).max() < 0.01 * force[-1]


def test_a_cold_first_touch_grows_from_nothing():
    _, model = cube()
    waited = np.linalg.norm(lateness(pp.Session(model, radius=10.0), [0, 40]), axis=1)
    prompt = np.linalg.norm(lateness(pp.Session(model, radius=10.0), []), axis=1)
    assert (waited[:40] == 0).all()
    assert (np.diff(waited) <= 0.02 * prompt[1:] + np.abs(np.diff(prompt)) + 1e-9).all()
    assert abs(waited[-1] - prompt[-1]) < 1e-3 * prompt[-1]


def test_a_session_by_the_clock_replays_to_the_bit_cold_ticks_included():
    _, model = cube()
    live = pp.Session(model, radius=10.0)
    pointer = pp.Pointer()
    with live:
        live.start(pointer)
        for i, command in enumerate(glide(250)[::5]):
            pointer.send(command, i + 1)
            until(lambda i=i: live.frame().serial >= i + 1)
    record = live.record()
    assert len(record.switches) > 0  # the first touch, at least, found no tables
    again = pp.Session(model, radius=10.0)
    assert again.replay(record) is None
    assert (again.displacement == live.displacement).all()


def test_a_record_remembers_when_tables_were_late(tmp_path):
    _, model = cube()
    session = pp.Session(model, radius=10.0)
    lateness(session, [50, 90])
    record = session.record()
    assert (record.switches.tolist(), record.lacking.tolist()) == ([50, 90], [1, 0])
    pp.write_record(tmp_path / "late.h5", record)
    again = pp.Session(model, radius=10.0)
    assert again.replay(pp.read_record(tmp_path / "late.h5")) is None


def test_what_cannot_be_is_refused():
    truth, model = cube()
    for memory in (0, -1, np.nan):
        with pytest.raises(DataError, match="memory"):
            ComplianceModel(model.tissue, memory=memory)
    inner = int(np.setdiff1d(np.arange(1331), truth.tissue.mesh.surface_nodes)[0])
    with pytest.raises(ValueError, match="not a free vertex"):
        model.native.relax(model.start(), _core.tissue.ContactPatch(np.array([inner], np.int32), np.ones(1)), PUSH, 1)
    with pytest.raises(ValueError, match="not there"):
        model.start().make_near(np.array([10**6], np.int32), 5.0)
