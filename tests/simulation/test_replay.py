"""A replay is the session again: its forces, its states, its scores."""

import math
import os
import subprocess
import sys

import numpy as np
import pytest
from support.scored_session import TOP, hold, needle, session_of, stepped

import palpate as pp
from palpate.simulation.scoring import SessionScorer
from palpate.simulation.session import LUMP, SAMPLE


def busy_commands(ticks):
    """Two hands, a needle and a tool in space, all at once."""
    s = np.arange(ticks) / 1000
    return [
        [
            hold((8 + 6 * t, 0.0, 24.0), (0, 0.2, -3 * min(1, t))),
            needle(18 * min(1.0, t), (-4.0, 0.0, 24.5)),
            pp.Command(True, (20.0, 8.0 - 4 * t, 22 - 5 * math.sin(2 * t)), kind="free"),
        ]
        for t in s
    ]


def equal(one, other):
    """To the bit."""
    assert one.values() == other.values()
    for name in ("time", "force", "strain_time", "strain"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes()


def test_scores_of_a_replay_are_those_of_the_session(models, tissue, tmp_path):
    """Watched as it happens, and from the file: several tools, a needle, marks, a change of model."""
    session = session_of(models["blocks"])
    task = pp.Task("biopsy", strain=0.1, force=0.5)
    watch = SessionScorer(session, task)
    commands = busy_commands(1300)
    for at, until in ((0, 405), (405, 900), (900, 1300)):
        stepped(session, commands[at:until], watch)
        session.mark(SAMPLE, 1)
        watch.mark(SAMPLE, 1)
        session.change(models["compliance"])
    pp.write_record(tmp_path / "session.h5", session.record())
    again = pp.score(pp.read_record(tmp_path / "session.h5"), tissue, task)
    equal(watch.score(), again)
    assert again.punctures == 1
    assert again.claims[1].right
    assert again.max_force > 0.5
    assert again.over_strain > 0
    assert all(again.path[:3])
    assert [name for _, name, _ in session.record().changes] == ["compliance"] * 2


def live(model, change, milliseconds=900):
    """A session by the clock, cold at first, with all that can happen in it; what a page saw, by tick."""
    session = session_of(model, sweeps=4)
    pointer, seen = pp.Pointer(), {}
    with session:
        session.start(pointer)
        for at, commands in enumerate(busy_commands(milliseconds)):
            if at % 12:
                continue
            for tool, command in enumerate(commands):
                pointer.send(command, at + 1, tool)
            if at == 360:
                session.mark(LUMP, 0)
                assert session.change(change, sweeps=4)
            if at == 720:
                session.mark(SAMPLE, 1)
            while (frame := session.frame()).serial < at + 1 or frame.tick < at:
                pass
            seen[frame.tick] = (frame.force, frame.displacement, frame.tip, frame.insertion, frame.work)
    return session, seen


@pytest.mark.parametrize(("first", "then"), [("compliance", "blocks"), ("blocks", "compliance")])
def test_what_a_hand_felt_by_the_clock_is_felt_again_in_the_replay(models, tissue, tmp_path, first, then):
    session, seen = live(models[first], models[then])
    pp.write_record(tmp_path / "live.h5", session.record())
    record = pp.read_record(tmp_path / "live.h5")
    assert len(record.changes) == 1
    assert len(record.marks) == 2
    again, met = session_of(models[first], sweeps=4), 0
    for tick, _ in again.replayed(record, 1):
        if tick in seen:
            frame = again.frame()
            assert seen[tick] == (frame.force, frame.displacement, frame.tip, frame.insertion, frame.work)
            met += 1
    assert met > 40
    assert session_of(models[first], sweeps=4).replay(record) is None
    equal(pp.score(record, tissue, pp.Task("lump")), pp.score(record, tissue, pp.Task("lump")))


def test_a_model_that_comes_cold_beside_one_that_is_warm_does_so_in_the_replay(models, tissue):
    """By the clock, the same tables twice: the model at work has them, its successor not yet."""
    model, commands = models["compliance"], [hold(TOP, (0, 0, -3.0))] * 400
    session, pointer = session_of(model), pp.Pointer()
    with session:
        session.start(pointer)
        pointer.send(commands[0], 1)
        while session.frame().tick < 300:
            pass
        assert session.change(model)
        while session.frame().tick < 900:
            pass
    record = session.record()
    assert 2 in record.lacking  # the newcomer alone
    again = session_of(model)
    assert again.replay(record) is None
    assert again.displacement.tobytes() == session.displacement.tobytes()


def test_tables_that_come_late_are_late_in_the_replay(models, tissue, tmp_path):
    """A fresh model by the clock has none: the replay answers without them in the same ticks."""
    model = pp.model(tissue, "compliance")
    session, seen = live(model, models["blocks"], 400)
    record = session.record()
    assert len(record.switches) > 0
    again = session_of(pp.model(tissue, "compliance"), sweeps=4)
    assert again.replay(record) is None
    assert again.displacement.tobytes() == session.displacement.tobytes()
    assert seen


ELSEWHERE = """
import importlib.util, sys
spec = importlib.util.spec_from_file_location("palpate._core", sys.argv[1])
core = importlib.util.module_from_spec(spec)
import palpate
sys.modules["palpate._core"] = palpate._core = core
spec.loader.exec_module(core)
import numpy as np, palpate as pp
from palpate.simulation.recorded_session import like
record, tissue = pp.read_record(sys.argv[2]), pp.read_tissue(sys.argv[3])
session = like(record, tissue)
forces = np.concatenate([force for _, force in session.replayed(record, 10)])
np.savez(sys.argv[4], forces=forces, displacement=session.displacement, instructions=core.instruction_set())
"""


@pytest.mark.parametrize(("name", "tools"), [("blocks", 3), ("compliance", 3)])
def test_another_instruction_set_replays_within_a_micrometre(models, tissue, tmp_path, name, tools):
    """PALPATE_OTHER_CORE: a core built with -DPALPATE_BASELINE (CXXFLAGS), say; see docs/contributing.md."""
    other = os.environ.get("PALPATE_OTHER_CORE")
    if not other:
        pytest.skip("no core of another instruction set: PALPATE_OTHER_CORE=path to its _core*.so")
    session = session_of(models[name])
    forces = stepped(session, [commands[:tools] for commands in busy_commands(900)])
    pp.write_record(tmp_path / "session.h5", session.record())
    pp.write_tissue(tmp_path / "tissue.vtu", tissue)
    words = [other, tmp_path / "session.h5", tmp_path / "tissue.vtu", tmp_path / "out.npz"]
    subprocess.run([sys.executable, "-c", ELSEWHERE, *map(str, words)], check=True, timeout=300)
    there = np.load(tmp_path / "out.npz")
    assert str(there["instructions"]) != session.record().instructions.split(",")[0]
    off = np.abs(there["forces"] - forces).max(), np.abs(there["displacement"] - session.displacement).max()
    print(f"\n{there['instructions']}: {1e3 * off[0]:.2g} mN, {1e3 * off[1]:.2g} µm")
    assert 0 < max(off) < 1e-3  # N, and mm: other bits, the same session
