"""Plays a record in lockstep to any tick, forwards, and backwards by way of the start."""

from collections.abc import Callable

from palpate.simulation.recording import Record
from palpate.simulation.session import Session
from palpate.simulation.session_compatibility import recorded_settings
from palpate.simulation.session_replay import ReplaySteps
from palpate.tissue.models.tissue_model import TissueModel

CHUNK = 500  # ticks before it looks whether it is still wanted


class RecordPlayer:
    """A session that replays a record up to any tick.

    No states are kept: to go back, a fresh session runs from the start. So it takes the memory of one session, and every
    state is that of playing, to the bit; going back takes the time of computing the ticks before.

    Parameters
    ----------
    session : Session
        A fresh session that can replay the record.
    record : Record
        The record.
    """

    def __init__(self, session: Session, record: Record) -> None:
        self.record = record
        self.session = session
        self._models: dict[str, TissueModel] = {}
        self._begin()

    def _begin(self) -> None:
        self.session.use_weights_of(self.record)
        self._steps = ReplaySteps(self.record, self._models)

    @property
    def tick(self) -> int:
        """How many ticks have been replayed."""
        return self.session.ticks

    def go_to(self, tick: int, wanted: Callable[[], bool] = lambda: True) -> bool:
        """Goes to a tick of the record, or to its end.

        Parameters
        ----------
        tick : int
            The tick.
        wanted : callable, optional
            Called now and then; the player stops where it is if it gives False.

        Returns
        -------
        bool
            Whether it is there.
        """
        tick = max(0, min(int(tick), self.record.length))
        if tick < self.tick:
            before = self.session
            self.session = Session(before.first, **recorded_settings(self.record), tension=before.tension)
            self._begin()
        while self.tick < tick:
            if not wanted():
                return False
            self.session.replay_step(self._steps, min(tick, self.tick + CHUNK))
        return True
