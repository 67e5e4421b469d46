"""A device that obeys given commands."""

from collections.abc import Sequence

import numpy as np

from palpate import _core
from palpate.simulation.pointer import Command


class ScriptedDevice:
    """A device that obeys given commands, each from its tick on. tools: of each command; all are the first by default."""

    def __init__(self, ticks: Sequence[int], commands: Sequence[Command], tools: Sequence[int] | None = None) -> None:
        self.core = _core.simulation.Replay(
            np.array(ticks, dtype=np.int64),
            np.array([0] * len(commands) if tools is None else tools, dtype=np.uint8),
            np.array([c.number for c in commands], dtype=np.uint8),
            np.array([c.point for c in commands], dtype=np.float64).reshape(-1, 3),
            np.array([c.displacement for c in commands], dtype=np.float64).reshape(-1, 3),
            np.empty(0, dtype=np.int64),
            np.empty(0, dtype=np.uint8),
        )
