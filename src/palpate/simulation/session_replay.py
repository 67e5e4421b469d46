"""Replay of a record: what it has still to do at each tick, and where its states differ from the recorded ones."""

import numpy as np

from palpate.simulation.recording import Record
from palpate.simulation.replay import Replay
from palpate.simulation.session_compatibility import settings_after_change
from palpate.simulation.session_cuts import RecordedCut
from palpate.tissue.models.registry import model as build
from palpate.tissue.models.registry import name_of
from palpate.tissue.models.tissue_model import TissueModel
from palpate.tissue.tissue import Tissue


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

    def model(self, name: str, tissue: Tissue, first: TissueModel) -> TissueModel:
        """The model of a name of the session's present tissue. first: that with which the session began."""
        settings = settings_after_change(self.record, name)
        if tissue is not first.tissue:
            return build(tissue, name, **settings)
        if name not in self.models:
            self.models[name] = first if name == name_of(first) else build(tissue, name, **settings)
        return self.models[name]

    def cut_at(self, tick: int) -> RecordedCut | None:
        """The cut that takes over at a tick, once."""
        return self._cuts.pop(0) if self._cuts and self._cuts[0].tick == tick else None

    def stop(self, tick: int, wanted: int) -> int:
        """The last tick up to `wanted` that can be reached from `tick` without another event."""
        later = [*(at for at, *_ in (*self._changes, *self.record.marks)), *(one.tick for one in self._cuts)]
        return min([wanted, *(at for at in later if at > tick)])


def first_difference(record: Record, again: Record) -> int | None:
    """The first tick with a digest in which a replay differs from its record; None if all digests agree."""
    both = min(len(record.digests), len(again.digests))
    if len(again.digests) != len(record.digests) or (again.digest_ticks != record.digest_ticks).any():
        return int(record.digest_ticks[both - 1]) if both else 0
    wrong = np.flatnonzero(again.digests != record.digests)
    return int(record.digest_ticks[wrong[0]]) if len(wrong) else None
