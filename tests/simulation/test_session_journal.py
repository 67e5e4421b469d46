"""The journal of a session: whatever cuts it short, what is left is a record that replays to the bit."""

import json
import os
import tracemalloc
import warnings
import zlib

import numpy as np
import pytest
from support.scored_session import hold, session_of

import palpate as pp
from palpate.errors import FileError
from palpate.simulation.event_log import COLUMNS
from palpate.simulation.recording import start_journal
from palpate.simulation.session_journal import journal_path, read_journal

LENGTH = 1234


@pytest.fixture(scope="module")
def written(models, tmp_path_factory):
    """The record of a session of several tools, models and marks, and the bytes of its journal."""
    path = tmp_path_factory.mktemp("journal") / "session.h5"
    session, rng = session_of(models["compliance"], sweeps=4), np.random.default_rng(3)
    session.journal = start_journal(path, session.description())
    given = [
        [hold((0, 0, 25), (0, 0, -0.01 * k)), hold((20, 0, 21), (0.1, 0, -0.005 * k)) if k % 7 else None]
        for k in range(LENGTH)
    ]
    while given:
        count = int(rng.integers(1, 90))
        session.step(given[:count])
        given = given[count:]
        if 300 < len(given) < 400:
            session.mark(0, 1)
        if 500 < len(given) < 590:
            session.change(models["blocks"], 3)
    return session.record(), journal_path(path).read_bytes()


def test_every_cut_of_a_journal_is_the_beginning_of_the_record(written, models, tmp_path):
    record, whole = written
    assert record.length == LENGTH
    assert len(record.changes) == 1
    assert len(record.marks) > 1
    path, lengths = tmp_path / "session.h5", set()
    for cut in [*np.random.default_rng(1).integers(len(whole) // 4, len(whole), 25), len(whole)]:
        journal_path(path).write_bytes(whole[:cut])
        with pytest.warns(UserWarning, match=r"session\.h5\.journal: a session that was cut short"):
            left = pp.read_record(path)
        lengths.add(left.length)
        for name in ("ticks", "tools", "kinds", "points", "displacements"):
            assert np.array_equal(getattr(left, name), getattr(record, name)[record.ticks < left.length]), name
        kept = record.digest_ticks <= left.length
        assert left.digest_ticks[-1] == left.length
        assert np.array_equal(left.digests, record.digests[kept])
        assert left.changes == tuple(change for change in record.changes if change[0] < left.length)
        assert set(left.marks) <= set(record.marks)
    assert max(lengths) == LENGTH // 100 * 100
    assert len(lengths) > 5
    assert left.marks == tuple(mark for mark in record.marks if mark[0] <= left.length)
    assert session_of(models["compliance"], sweeps=4).replay(left) is None, "it replays to the bit"


def test_a_session_with_a_journal_has_the_record_of_one_without(models, tmp_path):
    """While it goes on, when it is closed, and when the disk takes nothing."""
    plain, kept = (session_of(models["compliance"], sweeps=4) for _ in range(2))
    kept.journal = start_journal(tmp_path / "session.h5", kept.description())
    for part in range(3):
        for session in (plain, kept):
            session.step([hold((0, 0, 25), (0, 0, -0.01 * k)) for k in range(part, part + 250)])
            session.mark(0, 0)
        if part == 1:
            full = os.open(os.devnull, os.O_RDONLY)  # takes nothing
            journal, kept.journal._file = kept.journal._file, full
            with pytest.warns(UserWarning, match="is kept in memory"):
                kept.step([None] * 200)
            kept.journal._file = journal
            plain.step([None] * 200)
        assert_same(kept.record(), plain.record())
    kept.journal.close()
    assert_same(kept.record(), plain.record())


def assert_same(one, other):
    for name in COLUMNS:
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
        assert getattr(one, name).dtype == getattr(other, name).dtype
    assert (one.length, one.marks) == (other.length, other.marks)


def test_a_long_session_with_a_journal_takes_no_more_memory(models, tmp_path):
    grown = {}
    for kept in (False, True):
        session = session_of(models["compliance"], sweeps=4)
        if kept:
            session.journal = start_journal(tmp_path / "session.h5", session.description())
        session.step([hold((0, 0, 25), (0, 0, -0.01 * k)) for k in range(100)])
        tracemalloc.start()
        for part in range(600):  # as often as a session of five minutes by the clock is collected
            session.step([hold((0, 0, 25), (0, 0, -0.0005 * (part + k))) for k in range(30)])
        grown[kept] = tracemalloc.get_traced_memory()[0]
        tracemalloc.stop()
    assert grown[False] > 8e5  # 18,000 commands
    assert grown[True] < 0.1 * grown[False]


def test_damage_in_the_middle_ends_the_journal_there(written, tmp_path):
    record, whole = written
    damaged = bytearray(whole)
    damaged[len(whole) // 2] ^= 1
    journal_path(tmp_path / "session.h5").write_bytes(damaged)
    with pytest.warns(UserWarning, match="cut short"):
        left = pp.read_record(tmp_path / "session.h5")
    assert 0 < left.length < LENGTH
    assert np.array_equal(left.ticks, record.ticks[record.ticks < left.length])


def test_a_session_that_died_at_once_hides_no_older_record(written, tmp_path):
    path = tmp_path / "session.h5"
    pp.write_record(path, written[0])
    journal_path(path).write_bytes(written[1][:100])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert pp.read_record(path).length == LENGTH


def test_a_session_that_was_cut_short_is_kept_when_the_next_takes_its_name(written, tmp_path):
    path = tmp_path / "session.h5"
    for name in ("session-recovered-1.h5", "session-recovered-2.h5"):
        journal_path(path).write_bytes(written[1])
        with pytest.warns(UserWarning, match=name):
            journal = start_journal(path, {})
        journal.remove()
        assert pp.read_record(tmp_path / name).length == LENGTH // 100 * 100
    assert sorted(p.name for p in tmp_path.iterdir()) == ["session-recovered-1.h5", "session-recovered-2.h5"]


def test_two_sessions_do_not_write_one_record(tmp_path):
    first = start_journal(tmp_path / "session.h5", {})
    with pytest.raises(FileError, match="if another session records there"):
        start_journal(tmp_path / "session.h5", {})
    first.remove()
    start_journal(tmp_path / "session.h5", {}).remove()


def test_a_journal_takes_up_what_a_full_disk_refused(monkeypatch, tmp_path):
    """Every third write goes half way and fails. Nothing is missing once there is room."""
    calls, write = [0], os.write

    def full(file, data):
        calls[0] += 1
        if calls[0] % 3:
            return write(file, data)
        write(file, data[: len(data) // 2])
        raise OSError(28, "No space left on device")

    journal = start_journal(tmp_path / "session.h5", {})
    marks = [(k, 0, 0) for k in range(20)]
    none = [np.empty(0)] * len(COLUMNS)
    monkeypatch.setattr(os, "write", full)
    with pytest.warns(UserWarning, match="No space left on device; the session goes on") as said:  # noqa: PT031
        for k in range(10):
            journal.append(none, [], marks[: 2 * k])
    assert len(said) == 1, "said once"
    monkeypatch.undo()
    digest = [np.array([100], np.int64) if name.startswith("digest") else np.empty(0) for name in COLUMNS]
    journal.append(digest, [], marks)
    left = read_journal(journal.path)
    journal.remove()
    assert left["marks"] == tuple(marks)


def line_of(content):
    text = json.dumps(content).encode() if not isinstance(content, bytes) else content
    return b"%08x %s\n" % (zlib.crc32(text), text)


def test_a_journal_that_lies_behind_right_checksums_is_refused_or_read(written, tmp_path):
    """One value of one line is another: too long, too short, of another kind, missing, new, nested too deep."""
    _, whole = written
    lines = [json.loads(line.partition(b" ")[2]) for line in whole.splitlines()]
    path, rng, refused = tmp_path / "session.h5", np.random.default_rng(2), 0
    junk = [
        None,
        -1,
        2**70,
        1e300,
        "",
        "A",
        "AAAA",
        "AAAAAAAAAAA=",
        "é",
        [],
        [1],
        [[1]],
        [[0, 0]],
        [["x", 1, 1]],
        {},
        {"a": []},
        [[3, "undo"]],
        [[3, "cut", [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]]],
        [[3, "cut", [[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]]]],
        [[3, "cut", [[0]], [["x"]]]],
        [["3", "cut"]],
    ]
    for _ in range(300):
        made = [dict(line) for line in lines]
        line = made[rng.integers(len(made)) if rng.random() < 0.7 else 0]
        name = str(rng.choice([*line, "points", "cuts", "lesson", "new"]))
        if rng.random() < 0.2:
            line.pop(name, None)
        else:
            line[name] = junk[rng.integers(len(junk))]
        journal_path(path).write_bytes(b"".join(map(line_of, made)))
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                record = pp.read_record(path)
        except FileError as problem:
            refused += "session.h5.journal" in str(problem) or "session.h5" in str(problem)
        else:
            assert record.points.shape == record.displacements.shape == (len(record.ticks), 3)
            pp.write_record(tmp_path / "again.h5", record)
            assert pp.read_record(tmp_path / "again.h5").length == record.length
    assert refused > 100
    journal_path(path).write_bytes(line_of(b"[" * 100_000 + b"]" * 100_000))
    with pytest.raises(FileError, match="nested too deep"):
        pp.read_record(path)


def test_a_journal_without_line_ends_takes_no_memory(tmp_path):
    path = tmp_path / "session.h5"
    with journal_path(path).open("wb") as file:
        file.truncate(2**40)  # a terabyte, none of it on the disk
    with pytest.raises(FileError, match=r"session\.h5"):
        pp.read_record(path)
