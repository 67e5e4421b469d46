"""Sessions on file: the same session replayed gives the same states."""

import dataclasses
import threading
import time

import h5py
import numpy as np
import pytest
from support.example_organs import ellipsoid, organ

import palpate as pp

TOP = (0.0, 0.0, 25.0)
FIXED = {"radius": 10.0, "sweeps": 6}


def stroke(ticks=600):
    """In, along, out, and a pause."""
    for i in range(ticks):
        held = i % 300 < 250
        x = 0.02 * (i % 300)
        yield pp.Command(held, (x, 0.0, 25.0), (0.0, 0.1, -4.0 * min(1.0, i / 100))) if held else None


@pytest.fixture(scope="module")
def model():
    return pp.model(organ(), "blocks")


@pytest.fixture(scope="module")
def recorded(model):
    session = pp.Session(model, **FIXED)
    session.step(list(stroke()))
    return session.record(), session.displacement


@pytest.mark.parametrize("name", ["blocks", "springs", "compliance"])
def test_replay_gives_the_same_states_to_the_bit(tmp_path, name):
    model = pp.model(organ(), name)
    first = pp.Session(model, **FIXED)
    force = first.step(list(stroke()))
    assert np.abs(force).max() > 0.1  # the session has something to repeat
    pp.write_record(tmp_path / "session.h5", first.record())
    again = pp.Session(model, **FIXED)
    assert again.replay(pp.read_record(tmp_path / "session.h5")) is None
    assert again.displacement.tobytes() == first.displacement.tobytes()
    assert len(first.record().digests) == 6


def test_session_by_the_clock_replays_in_lockstep(model):
    live = pp.Session(model, **FIXED)
    pointer = pp.Pointer()
    with live:
        live.start(pointer)
        for i, command in enumerate(stroke(300)):
            if i % 10 == 0:
                pointer.send(command or pp.Command())
                while live.frame().serial < i // 10 + 1:
                    pass
    record = live.record()
    assert record.kinds.any()
    assert len(record.ticks) > 20
    again = pp.Session(model, **FIXED)
    assert again.replay(record) is None
    assert again.displacement.tobytes() == live.displacement.tobytes()


def test_replay_device_by_the_clock_gives_the_recorded_states(model, recorded):
    record, _ = recorded
    live = pp.Session(model, **FIXED)
    with live:
        live.start(pp.Replay(record))
        while live.frame().tick <= record.length:
            pass
    mine = live.record()
    np.testing.assert_array_equal(mine.digests[: len(record.digests)], record.digests)


def test_a_record_that_was_altered_is_seen(model, recorded):
    record, _ = recorded
    displacements = record.displacements.copy()
    late = np.searchsorted(record.ticks, 150)
    displacements[late:, 0] += 1e-9  # one tick so little off would be forgotten, as is all when the tissue goes home
    altered = dataclasses.replace(record, displacements=displacements)
    assert pp.Session(model, **FIXED).replay(altered) == 200


def test_a_record_holds_every_command_once(recorded):
    record, _ = recorded
    assert record.length == 600
    given = list(stroke())
    held = np.array([c is not None for c in given])
    assert record.kinds.sum() == held.sum()  # each tick's command differs from the one before
    assert (record.kinds == held[record.ticks]).all()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"tissue": "0" * 32}, ("tissue", "0000", "open the tissue")),
        ({"model": "springs"}, ("springs", "blocks", "make the session of that model")),
    ],
)
def test_record_of_something_else_is_refused(model, recorded, change, words):
    with pytest.raises(pp.errors.DataError) as refusal:
        pp.Session(model, **FIXED).replay(dataclasses.replace(recorded[0], **change))
    for word in words:
        assert word in str(refusal.value)


def test_record_made_with_other_settings_is_refused(model, recorded):
    with pytest.raises(pp.errors.DataError, match=r"sweeps = 6.*not 7"):
        pp.Session(model, radius=10.0, sweeps=7).replay(recorded[0])


def test_any_change_of_the_tissue_changes_its_fingerprint(recorded):
    mesh = ellipsoid()
    fixed = pp.resting_on(mesh, (0, 0, -1), depth=8.0)
    stiffer = pp.Tissue(mesh, {"organ": 5.0, "lump": 50.000001}, 0.45, fixed)
    with pytest.raises(pp.errors.DataError, match="tissue"):
        pp.Session(pp.model(stiffer, "blocks"), **FIXED).replay(recorded[0])


def test_a_session_that_has_run_cannot_replay(model, recorded):
    session = pp.Session(model, **FIXED)
    session.step([None])
    with pytest.raises(pp.errors.DataError, match="fresh"):
        session.replay(recorded[0])


def test_missing_record(tmp_path):
    with pytest.raises(pp.errors.FileError, match=r"nowhere\.h5: no such file.*palpate touch"):
        pp.read_record(tmp_path / "nowhere.h5")


def test_file_of_another_kind_is_no_record(tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file.attrs["format"] = "palpate scan"
    with pytest.raises(pp.errors.FileError, match=r"other\.h5.*'palpate scan'.*'palpate session', 4.*--record"):
        pp.read_record(tmp_path / "other.h5")


def test_idle_session_has_a_record(tmp_path, model):
    session = pp.Session(model, **FIXED)
    session.step([None] * 50)
    pp.write_record(tmp_path / "idle.h5", session.record())
    assert pp.Session(model, **FIXED).replay(pp.read_record(tmp_path / "idle.h5")) is None


def test_damaged_record(tmp_path, recorded):
    """A bit that turned over in the commands is seen by the checksum."""
    path = tmp_path / "session.h5"
    pp.write_record(path, recorded[0])
    with h5py.File(path) as file:
        chunk = file["displacements"].id.get_chunk_info(0)
    data = bytearray(path.read_bytes())
    data[chunk.byte_offset + chunk.size // 2] ^= 4
    path.write_bytes(data)
    with pytest.raises(pp.errors.FileError, match=r"session\.h5.*damaged"):
        pp.read_record(path)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.95])
def test_truncated_record(tmp_path, recorded, share):
    path = tmp_path / "session.h5"
    pp.write_record(path, recorded[0])
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(pp.errors.FileError, match=r"session\.h5.*truncated.*record the session again"):
        pp.read_record(path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"ticks": lambda r: r.ticks[::-1]}, "ticks do not rise"),
        ({"length": lambda r: 5}, "the length 5"),
        ({"points": lambda r: r.points[:-1]}, "points has shape"),
    ],
)
def test_record_that_contradicts_itself(tmp_path, recorded, change, words):
    path = tmp_path / "session.h5"
    name, value = next(iter(change.items()))
    pp.write_record(path, dataclasses.replace(recorded[0], **{name: value(recorded[0])}))
    with pytest.raises(pp.errors.FileError, match=words) as refusal:
        pp.read_record(path)
    assert "session.h5" in str(refusal.value)
    assert "again" in str(refusal.value)


def test_record_into_a_missing_folder(tmp_path, recorded):
    with pytest.raises(pp.errors.FileError, match="mkdir"):
        pp.write_record(tmp_path / "no" / "session.h5", recorded[0])
    assert list(tmp_path.iterdir()) == []


def test_what_memory_held_before_is_nothing_to_a_session(model):
    """A NaN left there once made the work of a whole session one."""
    for _ in range(20):
        left = [np.full(size, np.nan) for size in range(64, 2048, 8)]
        del left
        session = pp.Session(model, radius=9.0, sweeps=2)
        session.step([None] * 3)
        assert session.frame().work == 0


def test_a_frame_is_only_looked_at_and_the_record_is_kept_all_the_same(monkeypatch):
    """`frame` takes nothing out of the loop's queues; while it runs, something else does, also if nobody looks."""
    monkeypatch.setattr("palpate.simulation.event_collector.COLLECT_INTERVAL", 0.05)
    session = pp.Session(pp.model(organ(), "springs"), radius=10.0, sweeps=1)
    drained, loop = [], session.loop

    class Watched:
        def __getattr__(self, name):
            if name == "drain":
                drained.append(threading.current_thread())
            return getattr(loop, name)

    session.loop = Watched()
    pointer = pp.Pointer()
    session.start(pointer)
    for depth in range(1, 6):
        pointer.send(pp.Command(True, (0.0, 0.0, 25.0), (0.0, 0.0, -float(depth))))
        time.sleep(0.05)
        for _ in range(20):
            session.frame()
    assert drained
    assert threading.current_thread() not in drained
    session.stop()
    assert drained[-1] is threading.current_thread()
    record = session.record()
    assert np.unique(record.displacements[record.kinds == 1, 2]).tolist() == [-5, -4, -3, -2, -1]
    assert not [thread for thread in threading.enumerate() if thread in drained and thread is not drained[-1]]
