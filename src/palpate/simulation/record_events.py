"""What happened in a recorded session, by tick: for a timeline."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from palpate.arrays import Float64
from palpate.simulation.pointer import KINDS, TOOLS
from palpate.simulation.recording import Record
from palpate.simulation.session import LUMP, SAMPLE, Session
from palpate.simulation.session_events import FREED, GUIDED

MOST_EVENTS = 1000  # of a record; later ones are left out
MOST_BINS = 2000  # of a curve of forces
HOLDS = {"hold": "holds", "needle": "drives a needle", "free": "is in space", "blade": "cuts", "carry": "takes a piece"}
MARKS = {
    LUMP: ("claim", "Claim: a lump is here"),
    SAMPLE: ("claim", "Claim: a sample from the lump"),
    GUIDED: ("guide", "Tool {} is guided"),
    FREED: ("guide", "Tool {} is guided no more"),
}


@dataclass(frozen=True)
class RecordEvent:
    """An event. kind: touch, release, cut, undo, model, claim, guide, note or limit. text: what is said of it."""

    tick: int
    kind: str
    text: str


def record_events(record: Record) -> tuple[RecordEvent, ...]:
    """What a record says by itself: tools that take hold and let go, cuts, models, claims, guidances, notes.

    Parameters
    ----------
    record : Record
        The record.

    Returns
    -------
    tuple of RecordEvent
        By tick; at most 1000.
    """
    found = [*_touches(record)]
    found += [RecordEvent(tick, "model", f"Model {name}") for tick, name, _ in record.changes]
    for tick, what, tool in record.marks:
        if what in MARKS:
            kind, text = MARKS[what]
            found.append(RecordEvent(tick, kind, text.format(tool + 1)))
    found += [RecordEvent(note.tick, "note", f"Note: {note.text}") for note in record.notes]
    words = {"cut": "Cut", "undo": "Cut taken back"}
    found += [RecordEvent(cut.tick, cut.kind, words[cut.kind]) for cut in record.cuts if cut.kind in words]
    return tuple(sorted(found, key=lambda event: event.tick)[:MOST_EVENTS])


def _touches(record: Record) -> Iterator[RecordEvent]:
    """Commands that begin and end: from away to something, and back."""
    for tool in range(TOOLS):
        mine = record.tools == tool
        kinds = np.concatenate([[0], record.kinds[mine]])
        for k in np.flatnonzero(np.diff(kinds != 0)):
            tick, kind = int(record.ticks[mine][k]), int(kinds[k + 1])
            if kind == 0:
                yield RecordEvent(tick, "release", f"Tool {tool + 1} lets go")
            else:
                yield RecordEvent(tick, "touch", f"Tool {tool + 1} {HOLDS[KINDS[kind]]}")


def bin_ticks(record: Record) -> int:
    """Ticks of a bin of the curve of forces: whole hundredths of a second, so that there are at most `MOST_BINS`."""
    return 10 * max(1, -(-record.length // (10 * MOST_BINS)))


def force_curve(session: Session, record: Record) -> Iterator[Float64]:
    """The greatest force of any tool in each bin, N, as far as it is known: again and again while a fresh session replays."""
    width = bin_ticks(record)
    most = np.zeros(-(-record.length // width))
    for tick, force in session.replayed(record, 10 * width):
        if not len(force):
            continue
        greatest = np.linalg.norm(force, axis=2).max(axis=1)
        np.maximum.at(most, np.arange(tick - len(force), tick) // width, greatest)
        yield most[: -(-tick // width)]


def limit_events(curve: Float64, width: int, limit: float) -> tuple[RecordEvent, ...]:
    """Where the force passes its limit, N, upwards."""
    over = np.concatenate([[False], curve > limit])
    begins = np.flatnonzero(~over[:-1] & over[1:])[:MOST_EVENTS]
    return tuple(RecordEvent(int(k) * width, "limit", f"Force over {limit:g} N") for k in begins)
