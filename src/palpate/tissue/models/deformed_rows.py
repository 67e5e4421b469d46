"""The dissertation's deformed-node index table: springs solved row by row outwards, only as far as they move."""

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.arrays import ArrayLike, Float64, Int32
from palpate.errors import DataError
from palpate.tissue.contact_patches import contacts
from palpate.tissue.models.mass_spring import SpringModel
from palpate.tissue.models.tissue_model import too_many_contacts

ALL_ROWS = 2**31 - 1


@dataclass(frozen=True, eq=False)
class DeformedRows:
    """rows: the table, node indices of row 1 (the touched nodes) and outwards; all other nodes stay at home.

    displacement: (N, 3) mm. force: (3,) N of the tissue on the tool. sweeps: done. warm: hand it to the next call, which
    finds its memory there, but starts from rest.
    """

    rows: tuple[Int32, ...]
    displacement: Float64
    force: Float64
    sweeps: int
    warm: Any = None

    @property
    def nodes(self) -> int:
        """How many the table holds."""
        return sum(map(len, self.rows))


def deformed_rows(
    model: SpringModel,
    point: ArrayLike,
    displacement: ArrayLike,
    radius: float,
    least: float,
    whole: bool = False,
    warm: Any = None,
    most_sweeps: int = 20_000,
) -> DeformedRows:
    """Springs from rest by the table. point, displacement: (3,) mm. radius: mm.

    least: mm; a row is joined while some node of the last one has moved by as much, and the sweeps end when no node
    steps by as much. whole: all rows from the start, under the same rule of the sweeps. Raises `DataError` for
    contacts that cannot be, and a `least` that is not positive.
    """
    if not (np.isfinite(least) and least > 0):
        raise DataError(f"least: {least} mm; give the displacement below which a node counts as still, such as 0.01")
    found = contacts(model.tissue, point, displacement, radius)
    state = model.start() if warm is None else warm
    start = ALL_ROWS if whole else 1
    solved = model.springs.solve_rows(state, found.patches, found.displacement, least, start, most_sweeps)
    if solved is None:
        raise too_many_contacts(found)
    force, count, sweeps = solved
    row = model.springs.rows(state)
    order = np.argsort(row, kind="stable").astype(np.int32)
    ends = np.searchsorted(row[order], np.arange(count + 1), side="right")
    table = tuple(order[a:b] for a, b in itertools.pairwise(ends))
    return DeformedRows(table, state.u.copy(), force[0], sweeps, state)
