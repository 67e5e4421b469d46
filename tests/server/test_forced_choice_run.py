"""An experiment on the server: what both intervals send before a touch, what an answer waits for, what is refused."""

import asyncio

import numpy as np
import pytest
from support.example_organs import ellipsoid
from support.running_server import until

import palpate as pp
from palpate.meshes.tet_mesh import TetMesh
from palpate.server.forced_choice_run import ForcedChoiceRun
from palpate.server.frame_message import frame_bytes
from palpate.server.live_session import LiveSession
from palpate.server.message_kinds import ChoiceKind, TrialState
from palpate.server.messages import Choice, encode
from palpate.simulation.interval_tissue import stimulus
from palpate.simulation.pointer import Pointer

TOP = (0.0, 0.0, 25.0)


@pytest.fixture(scope="module")
def organ():
    mesh = ellipsoid(7)
    plain = TetMesh(mesh.nodes, mesh.tets, np.ones(len(mesh.tets), dtype=np.int32), {1: "organ"})
    return pp.Tissue(plain, 5.0, 0.45, pp.resting_on(plain, (0, 0, -1), depth=8.0))


@pytest.fixture(scope="module")
def base(organ):
    return pp.model(organ.replace(springs=None), "compliance")


def run_of(organ, base, path, **changes):
    experiment = pp.ForcedChoice(**{"trials": 8, **changes})
    path.unlink(missing_ok=True)
    pp.start_answers(path, pp.Answers(experiment, ""))
    return ForcedChoiceRun(pp.read_answers(path), path, base, stimulus(experiment, organ))


@pytest.mark.parametrize("question", ["stiffness", "lump"])
def test_until_a_touch_both_intervals_send_the_same_bytes(organ, base, tmp_path, question):
    stiffer, scenes = [], set()
    for seed in range(12):
        run = run_of(organ, base, tmp_path / "a.jsonl", question=question, seed=seed, diameter=20, levels=(0.5, 2.0))
        sent = []
        for session in run.intervals:
            live = LiveSession(session, Pointer(), "organ", exam=run)
            session.step([None] * 64)
            frame = session.frame()
            sent.append((live.scene, frame_bytes(frame, session.drawn(frame), exam=True), encode(run.status)))
        assert sent[0] == sent[1]
        scenes.add(sent[0][0])
        place, way = (TOP, (0, 0, -4.0)) if question == "stiffness" else (run.stimulus.place, -4 * run.stimulus.normal)
        press = [pp.Command(True, tuple(place), tuple(way))] * 300
        forces = [np.linalg.norm(session.step(press)[-1]) for session in run.intervals]
        pressed = [frame_bytes(f := s.frame(), s.drawn(f), exam=True) for s in run.intervals]
        assert pressed[0] != pressed[1], "they are two organs"
        stiffer.append(1 + int(forces[1] > forces[0]))
        assert stiffer[-1] == run.answers.experiment.orders[0]
        if question == "stiffness":
            assert max(forces) / min(forces) == pytest.approx(1 + run.level, rel=1e-3), "force is proportional to E"
    assert set(stiffer) == {1, 2}
    if question == "stiffness":
        assert len(scenes) == 1, "no seed, no order shows in it"


def test_what_the_loop_says_of_its_timing_is_withheld(organ, base, tmp_path):
    """It goes by the clock; only the tick, which counts on over both intervals, differs between two moments."""
    run = run_of(organ, base, tmp_path / "a.jsonl")
    session = run.intervals[0]
    session.start(Pointer())
    until(lambda: session.frame().tick > 40)
    session.stop()
    frame, still = session.frame(), run.intervals[1]
    still.step([None])
    other, ticks = still.frame(), session.frame().tick - 1
    assert frame.busy > 0
    assert frame_bytes(frame, session.drawn(frame), exam=True) == frame_bytes(
        other, still.drawn(other), exam=True, offset=ticks
    )
    assert frame_bytes(frame, session.drawn(frame)) != frame_bytes(other, still.drawn(other), offset=ticks)


def choose(run, *choices):
    """What the pages are told by these choices."""
    told = []

    async def take():
        async def swap(session):
            told.append(run.intervals.index(session) + 1 if session in run.intervals else None)

        async def tell(text):
            told.append(text)

        async def report():
            told.append((run.state, run.number, run.shown))

        if run.state == TrialState.preparing:
            run.begin()
        for kind, interval, trial, contact in choices:
            run.contact = [contact, contact]
            await run.choose(Choice(kind, interval, trial), swap, tell, report)
        await run.branches

    asyncio.run(take())
    return told


def test_a_choice_that_means_another_trial_is_left_undone(organ, base, tmp_path):
    run = run_of(organ, base, tmp_path / "a.jsonl")
    told = choose(
        run,
        (ChoiceKind.answer, 1, 1, False),
        (ChoiceKind.answer, 1, 2, True),
        (ChoiceKind.go_on, 1, 1, True),
        (ChoiceKind.answer, 1, 1, True),
        (ChoiceKind.answer, 1, 1, True),
    )
    assert told[0] == "Touch both intervals first."
    assert run.number == 2, "a second click on the same answer is no answer to the next trial"
    assert len(pp.read_answers(run.path).trials) == 1


def test_an_answer_that_cannot_be_written_is_not_taken(organ, base, tmp_path):
    run = run_of(organ, base, tmp_path / "a.jsonl")
    run.path.unlink()
    told = choose(run, (ChoiceKind.answer, 1, 1, True))
    assert any("cannot be written" in str(one) for one in told)
    assert run.number == 1
    assert run.state == TrialState.asking


def test_both_trials_that_may_follow_are_always_made(organ, base, tmp_path):
    """Also where only one is needed: the wait tells nothing."""
    for changes in ({}, {"procedure": "staircase"}, {"trials": 1}):
        run = run_of(organ, base, tmp_path / "a.jsonl", **changes)
        made = run._branches()
        assert set(made) == {True, False}
        sessions = [one for _, intervals in made.values() for one in intervals]
        assert len({id(one.first) for one in sessions if one.first is not base}) == 2
        orders = run.answers.experiment.orders
        for level, (one, two) in made.values():
            if level is not None:
                assert (two.first if orders[1] == 1 else one.first) is base


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"channel": "device"}, "device"),
        ({"trials": 7}, "trials"),
        ({"seed": 1}, "seed"),
        ({"feedback": True}, "feedback"),
    ],
)
def test_a_resumed_experiment_must_be_the_same(organ, tmp_path, changes, words):
    path = tmp_path / "answers.jsonl"
    from palpate.simulation.session_compatibility import tissue_hash

    pp.start_answers(path, pp.Answers(pp.ForcedChoice(), tissue_hash(organ)))
    before = path.read_bytes()
    with pytest.raises(pp.errors.DataError, match=words):
        pp.ask(organ, path, pp.ForcedChoice(**changes), resume=True, open_browser=False)
    stiffer = organ.replace(young=2 * organ.young)
    with pytest.raises(pp.errors.DataError, match="another organ"):
        pp.ask(stiffer, path, pp.ForcedChoice(), resume=True, open_browser=False)
    with pytest.raises(pp.errors.FileError, match="--resume"):
        pp.ask(organ, path, pp.ForcedChoice(), open_browser=False)
    assert path.read_bytes() == before
