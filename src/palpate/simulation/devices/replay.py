"""A recorded session as a device: it makes a session a test."""

from palpate import _core
from palpate.simulation.record import Record


class Replay:
    """Device of a session that obeys a record's commands, each from its tick on, whatever the clock says."""

    def __init__(self, record: Record) -> None:
        self.record = record
        self.core = _core.Replay(
            record.ticks,
            record.tools,
            record.kinds,
            record.points,
            record.displacements,
            record.switches,
            record.lacking,
        )
