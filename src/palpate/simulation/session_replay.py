"""What a replay has still to do: the commands, changes of model and cuts of a record, each at its tick."""

from palpate.simulation.recording import Record
from palpate.simulation.replay import Replay
from palpate.simulation.session_cuts import RecordedCut
from palpate.tissue.models.tissue_model import TissueModel


class ReplaySteps:
    """Where the replay of a record stands. models: those that it changed to, by name, on the tissue without new cuts.

    A later replay may be given them, since models do not change and may be dear to make.
    """

    def __init__(self, record: Record, models: dict[str, TissueModel] | None = None) -> None:
        self.record = record
        self.models = {} if models is None else models
        self.device = Replay(record).core
        self._changes, self._cuts = list(record.changes), list(record.cuts)

    def change_at(self, tick: int) -> tuple[str, int] | None:
        """Model and sweeps that begin at a tick, once."""
        if self._changes and self._changes[0][0] == tick:
            _, name, sweeps = self._changes.pop(0)
            return name, sweeps
        return None

    def cut_at(self, tick: int) -> RecordedCut | None:
        """The cut that takes over at a tick, once."""
        return self._cuts.pop(0) if self._cuts and self._cuts[0].tick == tick else None

    def stop(self, tick: int, wanted: int) -> int:
        """The last tick up to `wanted` that can be reached from `tick` without another event."""
        later = [*(at for at, *_ in (*self._changes, *self.record.marks)), *(one.tick for one in self._cuts)]
        return min([wanted, *(at for at in later if at > tick)])
