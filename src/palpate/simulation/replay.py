"""A device that replays a record."""

from palpate import _core
from palpate.simulation.recording import Record


class Replay:
    """A device that gives the commands of a record, each from its tick on.

    Parameters
    ----------
    record : Record
        The record.

    Examples
    --------
    >>> session = pp.Session(pp.model(tissue, "compliance"), radius=10, sweeps=10)
    >>> _ = session.step([pp.Command(True, tuple(top), (0, 0, -2))] * 20)
    >>> device = pp.Replay(session.record())
    """

    def __init__(self, record: Record) -> None:
        self.record = record
        self.core = _core.simulation.Replay(
            record.ticks,
            record.tools,
            record.kinds,
            record.points,
            record.displacements,
            record.switches,
            record.lacking,
            recorded=True,
        )
