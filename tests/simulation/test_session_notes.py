"""Notes of a session: bounded, clean, kept with its record and its journal, and without effect on a replay."""

import json
import unicodedata

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis.strategies import text

import palpate as pp
from palpate.errors import DataError, FileError
from palpate.simulation.recording import start_journal
from palpate.simulation.session_notes import LONGEST_NOTE, MOST_NOTES, clean_text

PLACE = (1.0, -2.0, 24.5)


@pytest.fixture
def session(models):
    return pp.Session(models["springs"], radius=8.0, sweeps=2)


def pressed(session, ticks=200):
    session.step([pp.Command(True, (0.0, 0.0, 25.0), (0, 0, -3))] * ticks)


@given(text(max_size=250))
def test_no_note_holds_what_no_one_sees(raw):
    try:
        clean = clean_text(raw)
    except DataError:
        return
    kinds = {unicodedata.category(c) for c in clean if c not in "\u200c\u200d"}
    assert not kinds & {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}
    assert 0 < len(clean) <= LONGEST_NOTE
    assert clean == clean.strip() == clean_text(clean)


def test_escapes_turns_of_writing_and_lines_are_taken_out():
    assert clean_text(" a\x1b[31mred\r\nb\u202etxt\x00 <b>é</b>  ") == "a [31mred b txt <b>é</b>"
    assert clean_text("👩\u200d⚕️ ok").startswith("👩\u200d")
    for refused in ("", " \n\t", "\u202e\u200b", "\u200d", "a" * (LONGEST_NOTE + 1)):
        with pytest.raises(DataError, match="characters, expected 1 to 200"):
            clean_text(refused)


def test_notes_come_back_from_the_file_and_change_nothing_in_a_replay(session, models, tmp_path):
    pressed(session)
    session.note("hard\nhere", PLACE)
    pressed(session)
    session.note("é" * LONGEST_NOTE, (0, 0, 25))
    session.note("wrong", PLACE)
    session.remove_note(2)
    pp.write_record(tmp_path / "session.h5", session.record())
    record = pp.read_record(tmp_path / "session.h5")
    assert [(n.tick, n.point, n.text) for n in record.notes] == [
        (200, PLACE, "hard here"),
        (400, (0.0, 0.0, 25.0), "é" * LONGEST_NOTE),
    ]
    with h5py.File(tmp_path / "session.h5") as file:
        assert file.attrs["version"] == 4  # a reader that knows no notes takes it as ever
    assert pp.Session(models["springs"], radius=8.0, sweeps=2).replay(record) is None


def test_there_are_no_more_than_a_hundred(session):
    for k in range(MOST_NOTES):
        session.note(f"note {k}", PLACE)
    with pytest.raises(DataError, match="remove one first"):
        session.note("one more", PLACE)
    with pytest.raises(DataError, match="expected finite"):
        session.remove_note(0) or session.note("nowhere", (0, np.nan, 0))
    with pytest.raises(DataError, match="note 99: there are 99"):
        session.remove_note(99)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda rows: rows["text"].__setitem__(0, b"\xff\xfe"), "damaged"),
        (lambda rows: rows["text"].__setitem__(0, b""), "expected 1 to 200"),
        (lambda rows: rows["tick"].__setitem__(0, 10**9), "ticks of notes"),
        (lambda rows: rows["point"].__setitem__(0, np.nan), "expected finite"),
    ],
)
def test_a_file_that_no_session_wrote_is_refused(session, tmp_path, change, told):
    pressed(session)
    session.note("hard", PLACE)
    path = tmp_path / "session.h5"
    pp.write_record(path, session.record())
    with h5py.File(path, "r+") as file:
        rows = file["notes"][()]
        change(rows)
        file["notes"][...] = rows
    with pytest.raises(FileError, match=told):
        pp.read_record(path)


def test_the_journal_holds_the_notes_that_were_there_at_the_end(session, tmp_path):
    path = tmp_path / "session.h5"
    session.journal = start_journal(path, session.description())
    session.note("first", PLACE)
    pressed(session)
    session.note("second", PLACE)
    session.remove_note(0)
    pressed(session)
    session.journal.close()
    with pytest.warns(UserWarning, match="cut short"):
        assert [note.text for note in pp.read_record(path).notes] == ["second"]


def test_notes_of_an_exported_page_are_read_and_cleaned(tmp_path, session):
    pressed(session)
    record = session.record()
    saved = {
        "format": "palpate page session", "version": 1, "length": 200, "model": record.model, "tissue": record.tissue,
        "settings": record.settings, "instructions": record.instructions, "commands": [], "switches": [], "digests": [],
        "marks": [], "notes": [[12, *PLACE, "a\u0007b"]],
    }  # fmt: skip
    path = tmp_path / "session.json"
    path.write_text(json.dumps(saved))
    assert [(n.tick, n.text) for n in pp.read_record(path).notes] == [(12, "a b")]
    path.write_text(json.dumps({**saved, "notes": [[12, *PLACE, ""]]}))
    with pytest.raises(FileError, match="no session that a page saved"):
        pp.read_record(path)
