"""Pointers in a page: mouse, pen, fingers. They command and feel nothing; the page draws the force."""

from dataclasses import dataclass
from typing import Literal

from palpate import _core
from palpate.arrays import Float64, float64
from palpate.errors import DataError

Vector = tuple[float, float, float]


Kind = Literal["hold", "needle", "free"]
KINDS = ("away", "hold", "needle", "free")
TOOLS: int = _core.TOOLS


@dataclass(frozen=True)
class Command:
    """What a hand wants of one tool; complete in itself: the newest command says all.

    held=False lets go, whatever the rest says. kind "hold": the tissue at `point` (mm, on the surface at rest) is
    displaced by `displacement` mm. "needle": it enters at `point` (on the surface at rest), its tip is to be
    `displacement` from there. "free": the tool's tip is at `point` in space (mm); it touches, sticks and slides as it
    meets the tissue.
    """

    held: bool = False
    point: Vector = (0.0, 0.0, 0.0)
    displacement: Vector = (0.0, 0.0, 0.0)
    kind: Kind = "hold"

    @property
    def number(self) -> int:
        """Of its kind; 0 if it lets go."""
        return KINDS.index(self.kind) if self.held else 0


class Pointer:
    """Device of a session whose commands another thread gives; the newest wins. One thread only may send."""

    def __init__(self) -> None:
        self.core = _core.Pointer()
        self._serial = 0

    def send(self, command: Command, serial: int | None = None, tool: int = 0) -> None:
        """Hands `command` over; never waits. The frame that first obeys it bears its `serial` (default: counted)."""
        self._serial = self._serial + 1 if serial is None else serial
        self.core.send(tool, command.number, command.point, command.displacement, self._serial)


def within(name: str, vector: Float64 | Vector, most: float) -> Vector:
    """`vector` as three finite numbers no longer than `most` mm, or a `DataError`."""
    x, y, z = float64(name, vector, (3,)).tolist()
    if x * x + y * y + z * z > most * most:
        raise DataError(f"{name}: {(x, y, z)} is more than {most:g} mm long; no tool reaches that far")
    return x, y, z
