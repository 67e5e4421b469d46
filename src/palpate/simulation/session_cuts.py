"""What a record keeps of the cuts in a session."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from palpate.arrays import Float64, Int64
from palpate.meshes.cutting.blade import Blade

CutKind = Literal["cut", "extend", "undo"]
KINDS: tuple[CutKind, ...] = get_args(CutKind)
CUT_COLUMNS = ("cuts", "cut_sizes", "cut_points", "cut_triangles")


@dataclass(frozen=True, eq=False)
class RecordedCut:
    """A cut of a session. tick: the first that ran on the tissue after it. blade: what cut; None for "undo".

    kind: "cut" is one more; "extend" takes the place of the last one; "undo" takes that back.
    """

    tick: int
    kind: CutKind
    blade: Blade | None = None


def plain_cut(one: RecordedCut) -> list[object]:
    """A cut as lists of numbers."""
    blade = one.blade
    return [one.tick, one.kind, *([] if blade is None else [blade.points.tolist(), blade.triangles.tolist()])]


def cut_of(plain: list[object]) -> RecordedCut:
    """The cut in what `plain_cut` gave. Raises `ValueError`, `TypeError` or `DataError` for anything else."""
    tick, kind, *blade = plain
    if not isinstance(tick, int) or kind not in KINDS or len(blade) != (0 if kind == "undo" else 2):
        raise ValueError(f"a cut {str(plain)[:80]}")
    shapes = [np.array(part) for part in blade]
    return RecordedCut(tick, kind, Blade(*shapes) if blade else None)


def cut_columns(cuts: tuple[RecordedCut, ...]) -> dict[str, Float64 | Int64]:
    """Cuts as arrays: (c, 2) tick and kind, (c, 2) numbers of points and triangles, (P, 3) mm, (F, 3)."""
    blades = [one.blade for one in cuts if one.blade is not None]
    return {
        "cuts": np.array([(one.tick, KINDS.index(one.kind)) for one in cuts], dtype=np.int64).reshape(-1, 2),
        "cut_sizes": np.array(
            [(0, 0) if one.blade is None else (len(one.blade.points), len(one.blade.triangles)) for one in cuts],
            dtype=np.int64,
        ).reshape(-1, 2),
        "cut_points": np.concatenate([np.empty((0, 3)), *(blade.points for blade in blades)]),
        "cut_triangles": np.concatenate([np.empty((0, 3), dtype=np.int64), *(blade.triangles for blade in blades)]),
    }


def cuts_in(columns: dict[str, Float64 | Int64]) -> tuple[RecordedCut, ...]:
    """The cuts in what `cut_columns` gave. Raises `ValueError` or `DataError` for anything else."""
    heads, sizes = np.asarray(columns["cuts"]), np.asarray(columns["cut_sizes"])
    if heads.ndim != 2 or heads.shape != sizes.shape or heads.shape[1:] != (2,) or (sizes < 0).any():
        raise ValueError("cuts")
    if (heads[:, 1] < 0).any() or (heads[:, 1] >= len(KINDS)).any():
        raise ValueError("cuts: a kind that there is not")
    points, triangles = np.asarray(columns["cut_points"]), np.asarray(columns["cut_triangles"])
    if sizes.sum(axis=0).tolist() != [len(points), len(triangles)]:
        raise ValueError("cut_sizes")
    ends = np.cumsum(sizes, axis=0)
    found = []
    for (tick, kind), (size, faces), (p, f) in zip(heads.tolist(), sizes.tolist(), ends.tolist(), strict=True):
        if (KINDS[kind] == "undo") != (faces == 0):
            raise ValueError("cuts: a blade without triangles")
        blade = Blade(points[p - size : p], triangles[f - faces : f]) if faces else None
        found.append(RecordedCut(tick, KINDS[kind], blade))
    return tuple(found)
