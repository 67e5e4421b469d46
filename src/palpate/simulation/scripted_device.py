"""A device that obeys given commands."""

from collections.abc import Iterator, Sequence

import numpy as np

from palpate import _core
from palpate.errors import DataError
from palpate.simulation.pointer import TOOLS, Command

IDLE = Command()
Given = Command | None | Sequence[Command | None]  # for one tool, or for up to four


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


def new_commands(first: int, commands: Sequence[Given]) -> Iterator[tuple[int, int, Command]]:
    """(tick, tool, command) where a tool's command is another than the tick before; a tool that is not named lets go."""
    current = [IDLE] * TOOLS
    for tick, given in enumerate(commands, first):
        named = [given] if given is None or isinstance(given, Command) else list(given)
        if len(named) > TOOLS:
            raise DataError(f"step: {len(named)} tools, at most {TOOLS} can be at work")
        for tool in range(TOOLS):
            command = (named[tool] if tool < len(named) else None) or IDLE
            if command is not current[tool]:
                current[tool] = command
                yield tick, tool, command
