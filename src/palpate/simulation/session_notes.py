"""Notes of a session: a short text at a point of the tissue."""

import unicodedata
from dataclasses import dataclass

import numpy as np

from palpate.arrays import AnyArray
from palpate.errors import DataError

MOST_NOTES = 100
LONGEST_NOTE = 200  # characters; in UTF-8 at most four bytes each
NOTES = np.dtype([("tick", "<i8"), ("point", "<f8", (3,)), ("text", f"S{4 * LONGEST_NOTE}")])
JOINERS = "\u200c\u200d"  # without a width of their own, but some scripts and emoji need them


@dataclass(frozen=True)
class SessionNote:
    """A note. tick: at which it was made. point: mm, on the surface at rest. text: as `clean_text` gives it."""

    tick: int
    point: tuple[float, float, float]
    text: str


def clean_text(text: str) -> str:
    """The text in one line, without characters that no one sees: controls, and those that turn the direction of writing.

    Raises `DataError` if nothing is left, or more than `LONGEST_NOTE` characters.
    """
    shown = (c if c in JOINERS or unicodedata.category(c)[0] not in "CZ" else " " for c in text)
    clean = " ".join("".join(shown).split())
    if not clean.strip(JOINERS) or len(clean) > LONGEST_NOTE:
        raise DataError(f"note: {len(clean)} characters, expected 1 to {LONGEST_NOTE}; write less, or something")
    return clean


def checked_note(tick: int, point: tuple[float, float, float], text: str) -> SessionNote:
    """A note with its text cleaned. Raises `DataError`."""
    if not np.isfinite(point).all():
        raise DataError(f"note: point {point}, expected finite numbers")
    return SessionNote(int(tick), (float(point[0]), float(point[1]), float(point[2])), clean_text(text))


def note_rows(notes: tuple[SessionNote, ...]) -> AnyArray:
    """The notes as rows of a file."""
    return np.array([(note.tick, note.point, note.text.encode()) for note in notes], dtype=NOTES)


def notes_in(rows: AnyArray) -> tuple[SessionNote, ...]:
    """The notes of a file's rows. Raises `DataError` or `ValueError` for what no session wrote."""
    if rows.ndim != 1 or len(rows) > MOST_NOTES:
        raise DataError(f"notes: shape {rows.shape}, expected {MOST_NOTES} rows at most")
    return tuple(checked_note(tick, tuple(point.tolist()), text.decode()) for tick, point, text in rows)
