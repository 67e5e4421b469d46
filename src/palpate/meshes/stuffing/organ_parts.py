"""Which of an organ's parts that do not touch is meshed: one of two kidneys, not the specks beside it."""

import warnings
from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from palpate.arrays import AnyArray, Bool, Float64, Int64
from palpate.errors import DataError
from palpate.volumes.grid import Grid

SIDES = {
    "left": (0, 1),
    "right": (0, -1),
    "posterior": (1, 1),
    "anterior": (1, -1),
    "superior": (2, 1),
    "inferior": (2, -1),
}
SPECK = 0.1  # of the largest part: what is smaller is no kidney
Keep = str | int | Sequence[float]
EXPECTED = (
    f"'largest', 'all', a side ({', '.join(SIDES)}), a rank by size (1 is the largest), or a point (x, y, z) in mm"
)


def kept_parts(mask: Bool, held: Bool, keep: Keep, name: str, grid: Grid, corner: Int64) -> Bool:
    """`mask` (z, y, x) without the parts that are not kept; a warning tells which are.

    held: voxels of the inclusions; "largest" is the part with most of them, if any has some. grid: of the labels; corner:
    (3,) index of the mask's first voxel there. Raises `DataError`.
    """
    wanted = _checked(keep)
    part, count = ndimage.label(mask)
    if count == 1:
        return mask
    if isinstance(wanted, str) and wanted == "all":
        warnings.warn(f"{name!r} has {count} parts that do not touch; all are meshed", stacklevel=5)
        return mask
    sizes = np.bincount(part.ravel())[1:]
    number, why = _chosen(part, sizes, held, wanted, name, grid, corner)
    rest = float(sizes.sum() - sizes[number - 1]) * grid.voxel_volume
    warnings.warn(
        f"{name!r} has {count} parts that do not touch; {why} is kept, {rest / 1000:.3g} ml dropped (keep='all' keeps them)",
        stacklevel=5,
    )
    return np.asarray(part == number)


def _checked(keep: Keep) -> str | int | Float64:
    if isinstance(keep, str) and (keep in ("largest", "all") or keep in SIDES):
        return keep
    if isinstance(keep, int) and not isinstance(keep, bool) and keep >= 1:
        return keep
    if not isinstance(keep, str | int):
        try:
            point = np.asarray(keep, dtype=np.float64)
        except (TypeError, ValueError):
            point = np.empty(0)
        if point.shape == (3,) and np.isfinite(point).all():
            return point
    raise DataError(f"keep: expected {EXPECTED}, got {keep!r}")


def _chosen(
    part: AnyArray, sizes: AnyArray, held: Bool, keep: str | int | Float64, name: str, grid: Grid, corner: Int64
) -> tuple[int, str]:
    """The number of a part, and what a note calls it."""
    count = len(sizes)
    if isinstance(keep, int):
        if keep > count:
            raise DataError(f"keep: {keep}, but {name!r} has {count} parts")
        return int(np.argsort(-sizes, kind="stable")[keep - 1]) + 1, f"number {keep} by size"
    centres = grid.points(np.array(ndimage.center_of_mass(part > 0, part, range(1, count + 1))) + corner)
    if not isinstance(keep, str):
        index = np.rint(grid.indices(keep[None])[0]).astype(int) - corner
        there = (index >= 0).all() and (index < part.shape).all()
        number = int(part[tuple(index)]) if there else 0
        if number == 0:
            places = "; ".join(
                f"({', '.join(f'{x:.0f}' for x in centre)})" for centre in centres[np.argsort(-sizes)][:6]
            )
            raise DataError(f"keep: no part of {name!r} at {keep.tolist()} mm; the middles of its parts are {places}")
        return number, f"the one at {keep.tolist()} mm"
    if keep in SIDES:
        axis, sign = SIDES[keep]
        large = sizes > SPECK * sizes.max()
        return int(np.argmax(np.where(large, sign * centres[:, axis], -np.inf))) + 1, f"the {keep} one"
    inside = np.bincount(part[held], minlength=count + 1)[1:]
    inside[inside == sizes] = 0  # an inclusion beside the organ
    if inside.any():
        number = int(np.argmax(inside)) + 1
        return number, "the largest" if number == np.argmax(sizes) + 1 else "the one that holds the inclusions"
    return int(np.argmax(sizes)) + 1, "the largest"
