"""The way of a blade on its way to a cut."""

import asyncio
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.brick_meshes import block
from support.example_organs import organ
from support.fake_devices.servo_rig import settled

import palpate as pp
from palpate import _core
from palpate.server.cutting_stroke import MOST_POINTS, Cutting, simplified
from palpate.server.held_tools import HeldTools
from palpate.server.message_checks import decode
from palpate.server.message_kinds import CutStep
from palpate.server.messages import Scalpel, ToolCommand, encode
from palpate.simulation.pointer import ContactState


def distance(point, way):
    """mm from a polyline."""
    a, b = way[:-1], way[1:]
    along = b - a
    t = np.clip(((point - a) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-30), 0, 1)
    return np.linalg.norm(point - a - t[:, None] * along, axis=1).min()


@settings(max_examples=60, deadline=None)
@given(st.integers(2, 80), st.floats(0.01, 5), st.integers(0, 2**31))
def test_no_point_left_out_is_far_from_the_way(count, tolerance, seed):
    way = np.cumsum(np.random.default_rng(seed).normal(0, 1, (count, 3)), axis=0)
    less = simplified(way, tolerance)
    assert np.array_equal(less[[0, -1]], way[[0, -1]])
    assert max(distance(point, less) for point in way) <= tolerance + 1e-9
    assert len(simplified(np.linspace((0, 0, 0), (9, 0, 0), 50), 0.1)) == 2


@pytest.mark.parametrize("depth", [0.0, -1.0, float("nan"), float("inf")])
def test_a_scalpel_without_a_depth_is_refused(depth):
    with pytest.raises(pp.errors.DataError, match="Scalpel"):
        decode(encode(Scalpel(CutStep.begin, depth, (0.0, 0.0, 25.0))))


def run(steps, replaced=False):
    """The session after these steps of pages (page, Scalpel), ticked meanwhile, and what was told.

    replaced: another session has taken its place.
    """
    whole = organ(9)
    session = pp.Session(pp.model(whole, "compliance"), radius=9.0, sweeps=4)
    running = object() if replaced else session
    told, changes = [], []

    async def tell(text, only=None):
        told.append(text)

    async def go():
        cutting = Cutting(asyncio.Lock(), lambda: running, lambda: changes.append(session.bodies), tell)
        tasks = []
        for page, message in steps:
            if message is None:
                cutting.leave(page)
            else:
                tasks.append(cutting.obey(page, session, message))
            await asyncio.sleep(0)
        waiting = asyncio.gather(*(task for task in tasks if task))
        for _ in range(2000):
            if waiting.done():
                break
            session.step([None] * 2)
            await asyncio.sleep(0.005)
        assert waiting.done(), "the stroke never ends"
        await waiting
        assert cutting.stroke is None

    asyncio.run(go())
    session.told = told
    return session, [text for text in told if not text.startswith("Cut of ")], changes


def over_the_top(count=30):
    """Points over the ellipsoid's top."""
    x = np.linspace(-15, 15, count)
    return [(float(a), 0.0, float(25 * np.sqrt(1 - (a / 40) ** 2))) for a in x]


def stroke(page, way, depth=14.0, direction=(0.0, 0.0, 0.0)):
    kinds = [CutStep.begin] + [CutStep.move] * (len(way) - 2) + [CutStep.end]
    return [(page, Scalpel(kind, depth, point, direction)) for kind, point in zip(kinds, way, strict=True)]


def test_a_stroke_is_one_cut_of_its_depth():
    session, told, changes = run(stroke("page", over_the_top()))
    assert told == []
    assert session.cuts == 1
    assert changes == list(range(1, session.bodies + 1))
    blade = session.mesh.blades[0]
    assert len(session.mesh.blades) == 1
    assert blade.points[:, 2].min() == pytest.approx(25 * np.sqrt(1 - (15 / 40) ** 2) - 14.0, abs=1.0)
    assert np.ptp(blade.points[:, 0]) == pytest.approx(30, abs=1.5)


def felt(session, steps):
    """N on the hand of a page that makes these strokes, (samples, 3)."""
    pointer, forces = pp.Pointer(), []

    async def go():
        cutting = Cutting(
            asyncio.Lock(), lambda: session, lambda: None, lambda *_: asyncio.sleep(0), HeldTools(pointer)
        )
        tasks = []
        for page, message in steps:
            tasks.append(cutting.obey(page, session, message))
            for _ in range(4):
                forces.append(session._advance(pointer.core, 5)[-1, 0])
                await asyncio.sleep(0.002)
        while cutting.stroke:
            session._advance(pointer.core, 2)
            await asyncio.sleep(0.002)
        await asyncio.gather(*(task for task in tasks if task))

    asyncio.run(go())
    return np.array(forces)


def test_a_hand_feels_its_blade_while_it_cuts_and_nothing_after_it():
    """N that the tissue's toughness asks for at this depth, whatever the cut behind it does meanwhile."""
    session = pp.Session(pp.model(organ(9), "compliance"), radius=9.0, sweeps=4, toughness=164)
    forces = felt(session, stroke("page", over_the_top(), 12.0))
    size = np.linalg.norm(forces, axis=1)
    assert session.cuts == 1
    assert np.allclose(size[12:-4], 0.164 * 12, rtol=0.02)
    assert forces[12:-4, 0].max() < 0, "against its way"
    assert size[-1] == 0


def test_a_blade_along_the_line_of_sight_is_felt_as_deep_as_the_organ_is():
    """Through all of it, from beyond one edge to beyond the other: by the chords of the ellipsoid."""
    x, z = 26.0, np.linspace(-22, 22, 40)
    half = 30 * np.sqrt(np.maximum(1 - (x / 40) ** 2 - (z / 25) ** 2, 0))
    way = [(x, float(b), float(c)) for b, c in zip(-half, z, strict=True)][::-1]
    session = pp.Session(pp.model(organ(13), "compliance"), radius=9.0, sweeps=4, toughness=164)
    forces = np.linalg.norm(felt(session, stroke("page", way, 100.0, (0.0, 1.0, 0.0))), axis=1)
    assert forces.max() == pytest.approx(0.164 * 2 * half.max(), rel=0.05)


def test_who_presses_while_the_cut_still_follows_holds_on():
    session = pp.Session(pp.model(organ(9), "compliance"), radius=9.0, sweeps=4, toughness=164)
    tools = HeldTools(pp.Pointer())

    async def go():
        cutting = Cutting(asyncio.Lock(), lambda: session, lambda: None, lambda *_: asyncio.sleep(0), tools)
        tasks = [cutting.obey("page", session, message) for _, message in stroke("page", over_the_top(), 12.0)]
        tools.command("page", 0, pp.Command(True, (0.0, 9.0, 23.0), (0.0, 0.0, -2.0)), 1)
        while cutting.stroke:
            session._advance(tools.pointer.core, 2)
            await asyncio.sleep(0.002)
        await asyncio.gather(*(task for task in tasks if task))

    asyncio.run(go())
    assert session.cuts == 1
    assert tools.holders == {0: ("page", 0)}
    assert np.linalg.norm(session._advance(tools.pointer.core, 200)[-1, 0]) > 0.05


def test_a_stroke_that_is_refused_leaves_no_blade_behind(monkeypatch):
    session = pp.Session(pp.model(organ(9), "compliance"), radius=9.0, sweeps=4, toughness=164)
    tools = HeldTools(pp.Pointer())

    def refused(blade, extend):
        raise pp.errors.MaterialError("blade: 1 of 2 pieces come free")

    monkeypatch.setattr(session, "cut", refused)

    async def go():
        cutting = Cutting(asyncio.Lock(), lambda: session, lambda: None, lambda *_: asyncio.sleep(0), tools)
        first, *_ = [cutting.obey("page", session, message) for _, message in stroke("page", over_the_top(), 12.0)[:-1]]
        assert tools.holders == {0: ("page", 0)}
        await first

    asyncio.run(go())
    assert tools.holders == {}
    assert not session._advance(tools.pointer.core, 5).any()


def test_a_device_with_motors_cuts_with_its_second_button_and_feels_that():
    """Its own loop and the session's, tick by tick; the hand presses down, cuts along x, and lets the button go."""
    whole = organ(9)
    session = pp.Session(pp.model(whole, "compliance"), radius=9.0, sweeps=4, toughness=164)
    servo = _core.haptics.Servo(settled(stiffness=2.0))
    device = _core.haptics.ServoDevice(servo)
    ticks, felt, told = itertools.count(1000), [], []

    async def tell(text, only=None):
        told.append(text)

    async def go():
        cutting = Cutting(asyncio.Lock(), lambda: session, lambda: None, tell)
        tasks = []

        async def hand(place, buttons):
            felt.append(servo.tick(place, buttons, 1_000_000 * next(ticks)))
            session.loop.step(device, 1)
            if task := cutting.follow(session, session.frame()):
                tasks.append(task)
            await asyncio.sleep(0)

        for height in np.linspace(2, -0.5, 200):
            await hand((-15.0, 0.0, float(25 * np.sqrt(1 - (15 / 40) ** 2) + height)), 0)
        for _ in range(40):  # without a depth it has no blade
            await hand((-15.0, 0.0, over_the_top()[0][2] - 0.5), 2)
        assert not cutting.stroke
        device.edge = 12.0
        for x, _, z in over_the_top(800):
            await hand((x, 0.0, z - 0.5), 2)
        assert cutting.stroke
        begun = len(felt)
        while cutting.stroke:
            await hand((15.0, 0.0, over_the_top()[-1][2] + 5.0), 0)
        await asyncio.gather(*tasks)
        return begun

    begun = asyncio.run(go())
    assert session.cuts == 1
    assert [text.startswith("Cut of") for text in told] == [True]
    along = np.array(felt)[begun - 500 : begun, 0]
    assert np.allclose(along, -0.164 * 12, rtol=0.1)
    assert np.ptp(session.mesh.blades[0].points[:, 0]) > 25
    assert np.linalg.norm(felt[-1]) < 1e-9


def test_the_edge_of_a_devices_blade_goes_into_the_surface_that_it_met():
    """On the side of a brick near its bottom: an edge that hung down would come out there."""
    session = pp.Session(pp.model(block(7), "compliance"), radius=9.0, sweeps=4, toughness=164)
    servo = _core.haptics.Servo(settled(stiffness=2.0))
    device = _core.haptics.ServoDevice(servo)
    ticks = itertools.count(1000)

    def hand(y, buttons):
        servo.tick((50.0 + 2.0 - 2.5 * min(1.0, len(seen) / 200), y, 6.0), buttons, 1_000_000 * next(ticks))
        session.loop.step(device, 1)
        seen.append(np.linalg.norm(session.frame().force[0]))

    seen = []
    for _ in range(240):
        hand(12.0, 0)
    device.edge = 20.0
    for y in np.linspace(12, 30, 500):
        hand(float(y), 2)
    assert session.frame().contact[0] == ContactState.cutting
    assert seen[-1] == pytest.approx(0.164 * 20, rel=0.01)


def test_no_page_commands_a_blade_by_itself():
    with pytest.raises(pp.errors.DataError, match="kind 4"):
        decode(encode(ToolCommand(0, 4, 1, (0.0, 0.0, 25.0), (0.0, 0.0, -9.0))))


def test_a_page_that_goes_ends_its_stroke_and_another_one_cannot_disturb_it():
    way = over_the_top()
    others = [("other", Scalpel(CutStep.move, 9.0, (0.0, 25.0, 8.0))), ("other", Scalpel(CutStep.begin, 9.0, way[3]))]
    session, told, _ = run([*stroke("page", way)[:-1], *others, ("other", None), ("page", None)])
    assert told == ["Another cut goes on: wait until it has ended."]
    assert session.cuts == 1
    assert np.abs(session.mesh.blades[0].points[:, 1]).max() < 1.0


def test_a_stroke_through_the_organ_frees_a_piece_which_is_told():
    """Along the line of sight, from beyond one edge to beyond the other, as a page sends it."""
    x, z = 33.0, np.linspace(-22, 22, 30)
    front = -30 * np.sqrt(np.maximum(1 - (x / 40) ** 2 - (z / 25) ** 2, 0))
    way = [(x, float(b), float(c)) for b, c in zip(front, z, strict=True)][::-1]
    session, told, _ = run(stroke("page", way, 100.0, (0.0, 1.0, 0.0)))
    assert told == []
    assert session.mesh.nodes[np.unique(session.mesh.tets)][:, 0].max() > x, "copies keep their shape"
    assert session.mesh.places[:, 0].max() == pytest.approx(x)
    beyond = session.first.tissue.mesh.volumes.sum() - session.mesh.volumes.sum()
    assert beyond == pytest.approx(np.pi * 30 * 25 * 40 * (2 / 3 - 0.825 + 0.825**3 / 3), rel=0.1)
    assert session.told[-1].endswith(f"{beyond / 1000:.2g} ml came free. Pull or Grasp takes it out.")


def test_what_lies_far_off_or_is_no_way_is_told_or_nothing():
    begin = Scalpel(CutStep.begin, 9.0, (0.0, 0.0, 25.0))
    session, told, _ = run([("page", begin), ("page", Scalpel(CutStep.end, 9.0, (1e38, 0.0, 0.0)))])
    assert session.bodies == 0
    assert len(told) == 1
    assert "off the surface" in told[0]
    session, told, _ = run([("page", begin), ("page", Scalpel(CutStep.end, 9.0, begin.point))])
    assert (session.bodies, told) == (0, [])
    session, told, _ = run([("page", Scalpel(CutStep.undo, 0.0, (0.0, 0.0, 0.0)))])
    assert session.bodies == 0
    assert "nothing has been cut" in told[0]


def test_a_point_far_off_costs_the_hand_that_feels_no_more_than_another():
    session = pp.Session(pp.model(organ(6), "compliance"), radius=12.0, sweeps=4, toughness=164)
    begin = Scalpel(CutStep.begin, 9.0, (0.0, 0.0, 25.0))
    forces = felt(
        session, [("page", begin), *(("page", Scalpel(k, 9.0, (1e38, 0.0, 0.0))) for k in (CutStep.move, CutStep.end))]
    )
    assert np.isfinite(forces).all()
    assert session.cuts == 0


def test_a_stroke_ends_with_its_session():
    """That ticks no more: a cut would wait for ever."""
    session, told, changes = run(stroke("page", over_the_top()), replaced=True)
    assert (session.bodies, told, changes) == (0, [], [])


def test_a_way_is_bounded():
    there = over_the_top(40)
    endless = (there + there[::-1]) * (MOST_POINTS // 40)
    session, told, _ = run(stroke("page", endless[: 3 * MOST_POINTS], 3.0)[:6] + [("page", None)])
    assert (told, session.cuts <= 1) == ([], True)
