"""Pointers in a page: mouse, pen, fingers. They send commands and feel no force."""

from dataclasses import dataclass
from typing import Literal

from palpate import _core
from palpate.arrays import Float64, float64
from palpate.errors import DataError

Vector = tuple[float, float, float]


Kind = Literal["hold", "needle", "free", "blade", "carry"]
CommandKind = _core.simulation.CommandKind
ContactState = _core.simulation.ContactState
PieceState = _core.simulation.PieceState
KINDS = tuple(kind.name for kind in CommandKind)
TOOLS: int = _core.simulation.MAX_TOOLS


@dataclass(frozen=True)
class Command:
    """What the hand wants of one tool. The newest command replaces all earlier ones.

    Parameters
    ----------
    held : bool, optional
        False releases the tissue.
    point : tuple of float, (3,), optional
        "hold", "needle", "blade": the point on the surface at rest, mm. "free": where the tool's tip is in space, mm.
        "carry": on a piece that a cut has freed, where that came free, mm.
    displacement : tuple of float, (3,), optional
        "hold", "carry": displacement of the tissue, or the piece, mm. "needle": where the tip is, from `point`, mm.
        "blade": into the tissue, as long as the edge is deep, mm.
    kind : {"hold", "needle", "free", "blade", "carry"}, optional
        A free tool touches, sticks and slides as it meets the tissue. A blade feels what a cut along the surface takes; the
        cut itself is made by `Session.cut`. What carries feels the weight.

    Attributes
    ----------
    number : int
        Number of the kind; 0 if it releases.

    Examples
    --------
    >>> pp.Command(True, (0, 0, 40), (0, 0, -2)).kind
    'hold'
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
    """A device whose commands come from another thread. The newest command wins.

    Raises
    ------
    DataError
        By `send`, if a command is not valid.

    Examples
    --------
    >>> pointer = pp.Pointer()
    >>> pointer.send(pp.Command(True, tuple(top), (0, 0, -1)))
    """

    def __init__(self) -> None:
        self.core = _core.simulation.Pointer()
        self.serial = 0  # of the newest command

    def send(self, command: Command, serial: int | None = None, tool: int = 0) -> None:
        """Hand over a command without waiting. Only one thread may send.

        Parameters
        ----------
        command : Command
            What the hand wants.
        serial : int, optional
            Number that the first frame after it carries. By default commands are counted.
        tool : int, optional
            Which tool.
        """
        self.serial = self.serial + 1 if serial is None else serial
        self.core.send(tool, command.number, command.point, command.displacement, self.serial)


def bounded_vector(name: str, vector: Float64 | Vector, most: float) -> Vector:
    """`vector` as three finite numbers with a length of at most `most` mm. Raises `DataError`."""
    x, y, z = float64(name, vector, (3,)).tolist()
    if x * x + y * y + z * z > most * most:
        raise DataError(f"{name}: {(x, y, z)} is more than {most:g} mm long; no tool reaches that far")
    return x, y, z
