"""Reads the places of a phantom's balls from a table."""

import csv
from pathlib import Path

import numpy as np

from palpate.arrays import Float64
from palpate.bounded_read import read_text
from palpate.errors import FileError
from palpate.scans.views import FAR

COLUMNS = ("x", "y", "z")


def read_balls(path: str | Path) -> Float64:
    """Read a table of balls: columns x, y, z and, if you like, diameter.

    Parameters
    ----------
    path : str or Path
        A text of comma-separated values whose first line names the columns. Lengths are in mm. Other columns are ignored,
        and so are lines that begin with #.

    Returns
    -------
    ndarray, (N, 3) or (N, 4)
        Centres (x, y, z) and diameter of each ball, mm.

    Raises
    ------
    FileError
        If the file is missing, a column is, or a number is not one.

    Examples
    --------
    >>> _ = Path("balls.csv").write_text("x,y,z,diameter\\n0,0,30,3\\n20,0,40,3\\n")
    >>> pp.read_balls("balls.csv").tolist()
    [[0.0, 0.0, 30.0, 3.0], [20.0, 0.0, 40.0, 3.0]]
    """
    path = Path(path)
    numbered = [(n, line) for n, line in enumerate(read_text(path).lstrip("\ufeff").splitlines(), 1)]
    lines = [(n, line) for n, line in numbered if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        raise FileError(f"{path}: is empty; the first line names the columns: x,y,z,diameter")
    table = [[cell.strip() for cell in next(csv.reader([line]))] for _, line in lines]
    head = [cell.lower() for cell in table[0]]
    for name in COLUMNS:
        if name not in head:
            raise FileError(f"{path}: column {name!r} is missing; the first line must name x,y,z (mm), got {table[0]}")
    for name in {*COLUMNS, "diameter"}:
        if head.count(name) > 1:
            raise FileError(f"{path}: column {name!r} is there {head.count(name)} times; keep one")
    wanted = [head.index(name) for name in (*COLUMNS, "diameter") if name in head]
    balls = np.array(
        [[_length(path, n, head[c], row, c) for c in wanted] for (n, _), row in zip(lines[1:], table[1:], strict=True)]
    )
    if not len(balls):
        raise FileError(f"{path}: holds no ball; give each one a line below {','.join(table[0])}")
    return balls


def _length(path: Path, line: int, name: str, row: list[str], column: int) -> float:
    found = row[column] if column < len(row) else ""
    try:
        value = float(found)
    except ValueError:
        raise FileError(f"{path}, line {line}: {name} is no number: {found!r}; give mm, with a decimal point") from None
    if not np.isfinite(value) or abs(value) > FAR:
        raise FileError(f"{path}, line {line}: {name} is {found}; expected mm within ±{FAR:g}")
    if name == "diameter" and value <= 0:
        raise FileError(f"{path}, line {line}: diameter is {found}; expected mm above 0")
    return value
