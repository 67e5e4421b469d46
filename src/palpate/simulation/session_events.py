"""What happens in a session and belongs in its record: commands, digests, models, cuts and claims, each with its tick."""

from collections.abc import Sequence
from typing import Any

from palpate.errors import DataError
from palpate.meshes.cutting.blade import Blade
from palpate.simulation.event_log import EventLog
from palpate.simulation.session_cuts import CutKind, RecordedCut
from palpate.simulation.session_journal import SessionJournal
from palpate.simulation.session_notes import MOST_NOTES, SessionNote, checked_note

GUIDED, FREED = 2, 3  # marks beside those of `Session.mark`: a tool is guided by another hand, and is not any more


class SessionEvents:
    """The events of a session, out of the loop's bounded queues. journal: takes them as they come, if there is one; then
    the loop's are kept there alone, so that a session of hours takes no more memory.

    The loop says at which ticks another model or body began; what it was is told to `model` or `cut` before, in the same
    order. marks: (tick, what, tool) of each claim, and of each guidance. notes: those there are now.
    """

    def __init__(self) -> None:
        self.journal: SessionJournal | None = None
        self.marks: list[tuple[int, int, int]] = []
        self.notes: tuple[SessionNote, ...] = ()
        self._log = EventLog()
        self._asked: list[tuple[str, int] | RecordedCut] = []  # model and sweeps, or a cut whose tick is not known yet
        self._begun: list[int] = []  # first ticks of these

    def model(self, name: str, sweeps: int) -> None:
        """Another model was asked for."""
        self._asked.append((name, sweeps))

    def cut(self, kind: CutKind, blade: Blade | None) -> None:
        """A cut was asked for."""
        self._asked.append(RecordedCut(-1, kind, blade))

    def add_note(self, tick: int, point: Sequence[float], text: str) -> None:
        """Raises `DataError` for a note that is not valid or one too many."""
        if len(self.notes) >= MOST_NOTES:
            raise DataError(f"note: there are {MOST_NOTES} already; remove one first")
        x, y, z = (float(number) for number in point)
        self.notes += (checked_note(tick, (x, y, z), text),)

    def remove_note(self, index: int) -> None:
        """Raises `DataError` if there is no such note."""
        if not 0 <= index < len(self.notes):
            raise DataError(f"note {index}: there are {len(self.notes)}")
        self.notes = self.notes[:index] + self.notes[index + 1 :]

    def collect(self, loop: Any) -> None:
        """Takes what there is in the loop's queues, and frees the model that a change has replaced."""
        events = loop.drain()
        self._begun += loop.changes()
        loop.free_retired()
        if self.journal and not loop.dropped():
            self.journal.append(events, self.changes, self.marks, self.cuts, self.notes)
        else:
            self._log.add(events)

    @property
    def changes(self) -> tuple[tuple[int, str, int], ...]:
        """(tick, model, sweeps) of each later model."""
        begun = zip(self._begun, self._asked, strict=False)
        return tuple((tick, *asked) for tick, asked in begun if not isinstance(asked, RecordedCut))

    @property
    def cuts(self) -> tuple[RecordedCut, ...]:
        """Each cut, with its tick."""
        begun = zip(self._begun, self._asked, strict=False)
        return tuple(
            RecordedCut(tick, asked.kind, asked.blade) for tick, asked in begun if isinstance(asked, RecordedCut)
        )

    def columns(self) -> dict[str, Any]:
        """What a `Record` holds of all events so far."""
        told = {"changes": self.changes, "marks": tuple(self.marks), "cuts": self.cuts, "notes": self.notes}
        journaled = self.journal.columns() if self.journal else None
        return {**self._log.columns(journaled), **told}
