"""Reads the force of an indenter over its depth from a table."""

import csv
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate.arrays import Float64, float64
from palpate.bounded_read import read_text
from palpate.errors import DataError, FileError

LEAST = 5  # points
UNITS = {
    "depth": {"mm": 1.0, "um": 1e-3, "µm": 1e-3, "m": 1e3},
    "force": {"N": 1.0, "mN": 1e-3, "uN": 1e-6, "µN": 1e-6},
}
_HEAD = re.compile(r"(?P<name>[A-Za-z]+)[\s_\[(]+(?P<unit>[A-Za-zµ]+)[\])]?")


@dataclass(frozen=True, eq=False)
class IndentationCurve:
    """The force of an indenter over its depth.

    Parameters
    ----------
    depth : array_like, (n,)
        How far the indenter went in, mm, positive into the tissue, in the order in which it was measured.
    force : array_like, (n,)
        The force on it, N, positive when the tissue pushes back.

    Raises
    ------
    DataError
        If the lengths differ, a number is not finite, there are fewer than 5 points, or the depth never changes.

    Examples
    --------
    >>> curve = pp.IndentationCurve(np.linspace(0, 2, 5), np.linspace(0, 0.3, 5))
    >>> float(curve.depth.max())
    2.0
    """

    depth: Float64
    force: Float64

    def __post_init__(self) -> None:
        depth, force = float64("depth", self.depth), float64("force", self.force)
        if depth.ndim != 1 or depth.shape != force.shape or len(depth) < LEAST:
            raise DataError(
                f"indentation: depth {depth.shape} and force {force.shape}; give {LEAST} or more pairs, mm and N"
            )
        object.__setattr__(self, "depth", depth)
        object.__setattr__(self, "force", force)
        if np.ptp(depth) == 0:
            raise DataError("indentation: the depth never changes; give a curve of pressing in")


def read_indentation(path: str | Path) -> IndentationCurve:
    """Read the curve of an indenter from a table.

    Parameters
    ----------
    path : str or Path
        A text of values separated by commas, semicolons or tabs. Its first line names the columns with their units, such as
        `depth mm, force N` or `force [mN]; depth [um]`. Other columns are ignored, and so are lines that begin with #.

    Returns
    -------
    IndentationCurve
        Depth in mm and force in N.

    Raises
    ------
    FileError
        If the file is missing, a column or its unit is, or a number is not one.

    Examples
    --------
    >>> _ = Path("curve.csv").write_text("depth mm,force mN\\n0,0\\n0.5,60\\n1,130\\n1.5,200\\n2,270\\n")
    >>> float(pp.read_indentation("curve.csv").force[-1])
    0.27
    """
    path = Path(path)
    numbered = enumerate(read_text(path).lstrip("\ufeff").splitlines(), 1)
    lines = [(n, line) for n, line in numbered if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        raise FileError(f"{path}: is empty; the first line names the columns: depth mm,force N")
    mark = max(",;\t", key=lines[0][1].count)
    table = [[cell.strip() for cell in next(csv.reader([line], delimiter=mark))] for _, line in lines]
    columns = {name: _column(path, table[0], name) for name in UNITS}
    found = {
        name: np.array(
            [scale * _number(path, n, name, row, at) for (n, _), row in zip(lines[1:], table[1:], strict=True)]
        )
        for name, (at, scale) in columns.items()
    }
    try:
        return IndentationCurve(found["depth"], found["force"])
    except DataError as problem:
        raise FileError(f"{path}: {problem}") from None


def _column(path: Path, head: list[str], name: str) -> tuple[int, float]:
    """The column's place and what its unit is, in mm or N."""
    named = [(at, _HEAD.fullmatch(cell)) for at, cell in enumerate(head)]
    units = [(at, m["unit"]) for at, m in named if m and m["name"].lower() == name and m["unit"] in UNITS[name]]
    if len(units) != 1:
        known = ", ".join(UNITS[name])
        raise FileError(
            f"{path}: {len(units) or 'no'} column of {name} with its unit in {head}; name one, such as "
            f"{name!r} and {known.split(', ')[0]!r}: {name} {known.split(', ')[0]} (known units: {known})"
        )
    at, unit = units[0]
    return at, UNITS[name][unit]


def _number(path: Path, line: int, name: str, row: list[str], column: int) -> float:
    found = row[column] if column < len(row) else ""
    try:
        return float(found)
    except ValueError:
        raise FileError(f"{path}, line {line}: {name} is no number: {found!r}; write decimals with a point") from None
