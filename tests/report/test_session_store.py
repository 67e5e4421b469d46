"""A store of sessions: rows, exports, deletion that leaves no byte, and the report by the command."""

import csv
import sqlite3
from dataclasses import asdict

import numpy as np
import pytest
from support.running_server import ended

import palpate as pp
from palpate.errors import DataError, FileError
from palpate.simulation.scoring import Claim


def score(seconds=10.0, force=2.0, found=1, wrong=0):
    claims = tuple(Claim(1.0, "lump", 0, False) for _ in range(wrong))
    numbers = (seconds, (100.0, 20.0), 3, 0, force / 2, force, 0.5, 4.0, 0.2, 0.0, 0.0)
    return pp.Score(pp.Task("lump"), "lump", *numbers, claims, found, 1, *[np.zeros(2)] * 4)


@pytest.fixture
def store(tmp_path):
    """Three novices and three experts, some attempts each, with known numbers."""
    path = tmp_path / "class.db"
    for person, group, attempts in (
        ("N101", "novice", 4),
        ("N102", "novice", 3),
        ("N103", "novice", 2),
        ("X201", "expert", 2),
        ("X202", "expert", 2),
        ("X203", "expert", 1),
    ):
        for n in range(1, attempts + 1):
            record = tmp_path / "session.h5"
            record.write_bytes(f"{person} {n}".encode())
            slow = (20.0 if group == "novice" else 8.0) - 2.0 * n + int(person[-1])
            row = pp.add_session(path, record, score(slow, 3.0 + 0.1 * n, wrong=n % 2), "kidney", person, group)
            assert row.attempt == n
    return path


def test_rows_are_kept_and_a_session_is_not_added_twice(store, tmp_path):
    rows = pp.read_sessions(store)
    assert len(rows) == 14
    first = rows[0]
    assert (first.person, first.group, first.task, first.tissue, first.channel) == (
        "N101",
        "novice",
        "lump",
        "kidney",
        "screen",
    )
    assert (first.seconds, first.path, first.max_force, first.found, first.sought, first.wrong) == (
        19.0,
        120.0,
        3.1,
        1,
        1,
        1,
    )
    with pytest.raises(DataError, match=r"in .* already"):
        pp.add_session(store, tmp_path / "session.h5", score(), "kidney", "X203", "expert")
    assert pp.read_sessions(store) == rows


def test_attempts_count_by_task_tissue_and_channel(store, tmp_path):
    (tmp_path / "other.h5").write_bytes(b"other")
    row = pp.add_session(store, tmp_path / "other.h5", score(), "kidney", "N101", "novice", "sound")
    assert row.attempt == 1


@pytest.mark.parametrize("person", ["Anna", "anna.smith@example.org", "P07; DROP TABLE", "", "Müller1"])
def test_names_are_refused(tmp_path, person):
    (tmp_path / "session.h5").write_bytes(b"x")
    with pytest.raises(DataError, match="a code and no name"):
        pp.add_session(tmp_path / "class.db", tmp_path / "session.h5", score(), "kidney", person, "novice")
    assert not (tmp_path / "class.db").exists()


def test_a_deleted_person_leaves_no_byte(store, tmp_path):
    """In the store, beside it, and in what was exported; the others stay."""
    table = tmp_path / "class.csv"
    assert pp.export_sessions(store, table) == 14
    kept = [row for row in pp.read_sessions(store) if row.person != "N102"]
    assert b"N102" in store.read_bytes()
    assert b"N102" in table.read_bytes()
    assert pp.delete_person(store, "N102") == (3, [table])
    for file in tmp_path.iterdir():
        assert b"N102" not in file.read_bytes(), file
    assert pp.read_sessions(store) == kept
    with table.open() as lines:
        assert [row["person"] for row in csv.DictReader(lines)] == [row.person for row in kept]
    with pytest.raises(DataError, match="holds no session of 'N102'"):
        pp.delete_person(store, "N102")


def test_the_table_has_every_number(store, tmp_path):
    pp.export_sessions(store, tmp_path / "class.csv")
    with (tmp_path / "class.csv").open() as lines:
        table = list(csv.DictReader(lines))
    for row, stored in zip(table, pp.read_sessions(store), strict=True):
        assert row == {name: str(value) for name, value in asdict(stored).items()}


def test_what_is_no_store_is_refused_and_left_as_it_was(tmp_path):
    (tmp_path / "session.h5").write_bytes(b"x")
    (tmp_path / "text.db").write_text("no database, but a text that is long enough to be looked at" * 20)
    other = tmp_path / "other.db"
    with sqlite3.connect(other) as database:
        database.execute("CREATE TABLE sessions (a)")
    for path in (tmp_path / "text.db", other):
        before = path.read_bytes()
        with pytest.raises(FileError, match=path.name):
            pp.read_sessions(path)
        with pytest.raises(FileError, match=path.name):
            pp.add_session(path, tmp_path / "session.h5", score(), "kidney", "P1", "novice")
        assert path.read_bytes() == before
    with pytest.raises(FileError, match="no such store"):
        pp.read_sessions(tmp_path / "missing.db")
    with pytest.raises(FileError, match=r"missing\.h5"):
        pp.add_session(tmp_path / "class.db", tmp_path / "missing.h5", score(), "kidney", "P1", "novice")
    pp.add_session(tmp_path / "class.db", tmp_path / "session.h5", score(), "kidney", "P1", "novice")
    with pytest.raises(FileError, match=r"written as \.csv"):
        pp.export_sessions(tmp_path / "class.db", tmp_path / "class.txt")


def test_a_report_of_one_session_says_that_it_is_too_little(tmp_path):
    (tmp_path / "session.h5").write_bytes(b"x")
    pp.add_session(tmp_path / "class.db", tmp_path / "session.h5", score(), "kidney", "P1", "novice")
    page = pp.session_report(tmp_path / "class.html", tmp_path / "class.db").read_text()
    assert "too few sessions" in page
    assert "ICC(2,1) of 0 people" in page


def test_commands_list_export_report_and_delete(store, tmp_path):
    code, out, err = ended("sessions list class.db", tmp_path)
    assert code == 0, err
    assert "14 sessions of 6 people" in out
    code, out, err = ended("sessions report class.db -o class.html", tmp_path)
    assert code == 0, err
    page = (tmp_path / "class.html").read_text()
    for words in ("expert - novice", "ICC(2,1) of 5 people", "a doubling of practice", "deviations from the experts"):
        assert words in page
    code, out, err = ended("sessions export class.db -o class.csv", tmp_path)
    assert code == 0, err
    code, out, err = ended("sessions delete class.db --person N103", tmp_path)
    assert code == 0, err
    assert "2 sessions of N103 deleted" in out
    assert b"N103" not in (tmp_path / "class.csv").read_bytes()
    code, out, err = ended("sessions delete class.db --person N103", tmp_path)
    assert code == 2
    assert "holds no session of 'N103'" in err
