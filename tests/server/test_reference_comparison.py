"""The difference from finite elements over the wire: who asks gets it, who goes stops it, and what cannot be said."""

import asyncio
import contextlib
import struct
import time

import numpy as np
import pytest
from support.brick_meshes import block
from support.example_organs import organ
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

import palpate as pp
from palpate.errors import MaterialError
from palpate.server import messages, reference_comparison
from palpate.server.live_session import LiveSession
from palpate.server.loopback_server import loopback_socket
from palpate.server.message_kinds import ComparisonState
from palpate.server.touch import running_session
from palpate.simulation.fem_reference import DisplayedTick
from palpate.simulation.pointer import Pointer

TOP = (0.0, 0.0, 25.0)
PRESS = messages.encode(messages.ToolCommand(0, 1, 1, TOP, (0.0, 0.0, -3.0)))
ASK, NO_MORE = (messages.encode(messages.Compare(on)) for on in (1, 0))
FRAME, DIFFERENCE = 2, 6
LAYOUT = "<Bd12fffI"  # after the kind


@contextlib.contextmanager
def served(model, organs=None):
    session = pp.Session(model, radius=10.0, sweeps=8)
    live = LiveSession(session, Pointer(), organs=organs or {})
    with running_session(live, loopback_socket(None)) as address:
        yield live, address


def page_at(address):
    base, token = address.split("/?")
    return connect(f"{base.replace('http', 'ws')}/socket?{token}", origin=base, max_queue=None)


def differences(page, most=600):
    """Of the next so many messages, those that are differences: state, tick, force (4, 3) N, off, distances mm."""
    for _ in range(most):
        data = page.recv(timeout=10)
        if data[0] == DIFFERENCE:
            state, tick, *force, off, step, count = struct.unpack_from(LAYOUT, data, 1)
            start = (1 + struct.calcsize(LAYOUT) + 3) // 4 * 4
            assert len(data) == start + 2 * count
            yield state, tick, np.reshape(force, (4, 3)), off, step * np.frombuffer(data, "<u2", offset=start)


def settled(page):
    """A difference that says the same as the one before."""
    before = None
    for state, _, force, off, distance in differences(page):
        same = before is not None and len(distance) == len(before) > 0
        if state == ComparisonState.compared and same and np.abs(distance - before).max() < 1e-3 * distance.max():
            return force, off, distance
        before = distance
    return pytest.fail("no difference, or none that settles")


@pytest.fixture(scope="module")
def springs():
    with served(pp.model(organ(), "springs")) as (live, address):
        yield live, address


@pytest.fixture
def counted(monkeypatch):
    """Ticks that were compared."""
    ticks, compare = [], reference_comparison.fem_difference
    monkeypatch.setattr(
        reference_comparison,
        "fem_difference",
        lambda exact, tick, *rest: ticks.append(tick.number) or compare(exact, tick, *rest),
    )
    return ticks


def test_who_asks_gets_the_distance_to_the_direct_solution(springs):
    live, address = springs
    with page_at(address) as page:
        page.send(PRESS)
        page.send(ASK)
        force, off, distance = settled(page)
    tissue, shown = live.session.first.tissue, live.session.shown
    truth = pp.finite_elements(tissue).push(TOP, (0, 0, -3.0), 10.0)
    mine = pp.model(tissue, "springs").push(TOP, (0, 0, -3.0), 10.0, tolerance=1e-5)
    expected = np.linalg.norm(mine.displacement - truth.displacement, axis=1)[shown]
    np.testing.assert_allclose(distance, expected, atol=0.01 * expected.max())
    np.testing.assert_allclose(force[0], truth.force, rtol=1e-4, atol=1e-5)
    assert (force[1:] == 0).all()
    assert off == pytest.approx(np.linalg.norm(mine.force - truth.force) / np.linalg.norm(truth.force), abs=0.005)


def test_a_page_that_does_not_ask_gets_frames_only(springs):
    with page_at(springs[1]) as asks, page_at(springs[1]) as other:
        asks.send(ASK)
        for _ in range(3):
            next(differences(asks))
        assert {other.recv(timeout=10)[0] for _ in range(60)} == {FRAME}


@pytest.mark.parametrize("how", ["no more", "gone"])
def test_a_page_that_leaves_stops_the_work(springs, counted, how):
    live, address = springs
    with page_at(address) as page:
        page.send(ASK)
        for _ in range(3):
            next(differences(page))
        assert len(counted) >= 2
        if how == "no more":
            page.send(NO_MORE)
            wait(lambda: not live.comparison.pages)
        else:
            page.close()
            wait(lambda: not live.pages)
        wait(lambda: live.comparison.task.done())
        so_far = len(counted)
        time.sleep(0.5)
        assert len(counted) == so_far
        assert live.comparison.newest == b""


def wait(what):
    for _ in range(1000):
        if what():
            return
        time.sleep(0.01)
    pytest.fail("it does not come to that")


def test_each_is_of_a_newer_tick(springs, counted):
    with page_at(springs[1]) as page:
        page.send(ASK)
        ticks = [tick for _, tick, *_ in differences(page, 120)]
    assert len(ticks) > 2
    assert (np.diff(ticks) > 0).all()
    assert set(ticks) <= set(counted)


@pytest.mark.parametrize(
    ("took", "rest"), [(0.0, reference_comparison.MIN_INTERVAL), (0.3, 0.3 * (1 / reference_comparison.TIME_SHARE - 1))]
)
def test_the_next_one_waits_its_time(monkeypatch, took, rest):
    """A tenth of a second; longer where a comparison takes long: the loop needs the machine."""
    session, now = pp.Session(pp.model(organ(), "springs"), radius=10.0, sweeps=1), [100.0]
    exact, bare = pp.model(organ(), "compliance"), reference_comparison.compare

    def slow(*given):
        now[0] += took
        return bare(*given)

    async def make(tissue, name):
        return exact

    async def once():
        comparison = reference_comparison.ReferenceComparison(make)
        comparison.request("a page", True)
        await comparison.update(session, session.frame())
        now[0] += 0.99 * rest
        assert comparison.update(session, session.frame()) is None
        now[0] += 0.02 * rest
        again = comparison.update(session, session.frame())
        assert again is not None
        await again

    monkeypatch.setattr(reference_comparison, "monotonic", lambda: now[0])
    monkeypatch.setattr(reference_comparison, "compare", slow)
    asyncio.run(once())


def read_on(page):
    for _ in range(600):
        page.recv(timeout=10)


@pytest.mark.parametrize(
    "message", [b"\5", b"\5\1", b"\5\2\0\0", ASK + b"\0", b"\6\1\0\0", messages.encode(messages.Compare(255))]
)
def test_malformed_wishes_close_the_socket(springs, message):
    with page_at(springs[1]) as page:
        page.send(message)
        with pytest.raises(ConnectionClosed):
            read_on(page)
        assert page.close_code == 1008


def test_another_organ_has_a_reference_of_its_own():
    soft, hard = block(5, young=5.0), block(5, young=50.0)
    press = messages.encode(messages.ToolCommand(0, 1, 1, (25.0, 25.0, 50.0), (0.0, 0.0, -3.0)))
    forces = []
    with served(pp.model(soft, "springs"), {"soft": soft, "hard": hard}) as (live, address):
        for organ_number in (0, 1):
            with page_at(address) as page:
                if organ_number:
                    page.send(messages.encode(messages.Selection(1, 1)))
                    with pytest.raises(ConnectionClosed):
                        read_on(page)
            with page_at(address) as page:
                page.send(press)
                page.send(ASK)
                forces.append(settled(page)[0][0, 2])
            wait(lambda: not live.pages)
        radius = live.session.settings.radius
    for tissue, force, r in ((soft, forces[0], 10.0), (hard, forces[1], radius)):
        truth = pp.finite_elements(tissue).push((25.0, 25.0, 50.0), (0, 0, -3.0), r)
        assert force == pytest.approx(truth.force[2], rel=1e-4)


def state_of(data):
    return data[0], data[1], struct.unpack_from("<I", data, 66)[0]


def test_tools_on_the_same_nodes_are_said_to_have_no_reference():
    tissue = organ()
    exact, session = pp.model(tissue, "compliance"), pp.Session(pp.model(tissue), radius=10.0, sweeps=1)
    ways = np.array([(0.0, 0.0, -3.0), (0.0, 0.0, 1.0)])
    tick = DisplayedTick(7, (0, 1), np.array([TOP, TOP]), ways, 0 * ways, np.zeros((len(session.shown), 3), np.float32))
    assert state_of(reference_comparison.compare(exact, tick, 10.0, session.shown)) == (
        DIFFERENCE,
        ComparisonState.contacts_overlap,
        0,
    )


def test_a_mesh_without_a_reference_says_so_and_is_not_tried_again():
    session, tried = pp.Session(pp.model(organ(), "springs"), radius=10.0, sweeps=1), []

    async def make(tissue, name):
        tried.append(name)
        raise MaterialError("the stiffness is not positive definite")

    async def twice():
        comparison = reference_comparison.ReferenceComparison(make)
        comparison.request("a page", True)
        for _ in range(2):
            comparison._due = 0.0
            await comparison.update(session, session.frame())
            assert state_of(comparison.newest) == (DIFFERENCE, ComparisonState.no_reference, 0)

    asyncio.run(twice())
    assert tried == ["compliance"]


def test_while_the_reference_is_made_that_is_said_and_frames_go_on():
    session = pp.Session(pp.model(organ(), "springs"), radius=10.0, sweeps=1)

    async def once():
        ready = asyncio.Event()

        async def make(tissue, name):
            await ready.wait()
            return pp.model(tissue, name)

        comparison = reference_comparison.ReferenceComparison(make)
        assert comparison.update(session, session.frame()) is None  # nobody asks
        comparison.request("a page", True)
        task = comparison.update(session, session.frame())
        await asyncio.sleep(4 * reference_comparison.PREPARING_DELAY)
        assert state_of(comparison.newest) == (DIFFERENCE, ComparisonState.preparing, 0)
        assert comparison.update(session, session.frame()) is None  # one at a time
        ready.set()
        await task
        assert state_of(comparison.newest) == (DIFFERENCE, ComparisonState.compared, 0)  # at rest: zero everywhere

    asyncio.run(once())


def test_a_model_that_two_ask_for_at_once_is_built_once(monkeypatch):
    """Also where the first to ask has gone before it is there; one that cannot be built is tried anew when asked."""
    tissue, built, fails = organ(), [], False

    def build(of, name):
        built.append(name)
        time.sleep(0.1)
        if fails:
            raise MaterialError("too stiff")
        return pp.model(of, "blocks")

    live = LiveSession(pp.Session(pp.model(tissue, "blocks"), radius=10.0, sweeps=4), Pointer())
    monkeypatch.setattr("palpate.server.live_session.build", build)

    async def together(name):
        gone, *asking = (asyncio.create_task(live.build_model(tissue, name)) for _ in range(3))
        await asyncio.sleep(0.02)
        gone.cancel()
        return await asyncio.gather(*asking, return_exceptions=True)

    async def asked():
        nonlocal fails
        one, other = await together("blocks")
        assert one is other
        assert await live.build_model(tissue, "blocks") is one
        assert built == ["blocks"]
        fails = True
        assert all(isinstance(problem, MaterialError) for problem in await together("compliance"))
        fails = False
        assert (await live.build_model(tissue, "compliance")).tissue is tissue
        assert built == ["blocks", "compliance", "compliance"]

    asyncio.run(asked())
