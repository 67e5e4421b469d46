"""The nested solids of a mesh: the organ with all inclusions, then each inclusion."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from palpate.arrays import Bool, Float64, Int32, Int64
from palpate.errors import DataError
from palpate.meshes.stuffing.level_set import box_of, inner_distance
from palpate.meshes.stuffing.organ_parts import Keep, kept_parts
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Labels


@dataclass(frozen=True, eq=False)
class Solid:
    """mask: (z, y, x) bool, all that one closed surface holds; value, name: the label between it and the next inside.

    grid: its spacing; corner: (3,) index of the mask's first voxel in the labels.
    """

    mask: Bool
    value: int
    name: str
    grid: Grid
    corner: Int64

    @property
    def volume(self) -> float:
        """mm³."""
        return float(np.count_nonzero(self.mask)) * self.grid.voxel_volume

    def coarse(self, length: float) -> tuple[Bool, Float64]:
        """Every so many voxels of the mask, no more than `length` mm apart, and their spacing."""
        steps = np.maximum(np.array(length) // np.array(self.grid.spacing), 1).astype(int)
        return self.mask[:: steps[0], :: steps[1], :: steps[2]], steps * np.array(self.grid.spacing)

    def thickness(self, length: float) -> float:
        """mm across the thickest place, to about `length`."""
        return 2 * float(inner_distance(*self.coarse(length)).max(initial=0))

    def depth(self, other: "Solid") -> float:
        """Thinnest layer of `other` around this solid in mm, by its voxels; for neighbours, the gap between them."""
        if (self.mask & other.mask).any():
            inside = inner_distance(other.mask, self.grid.spacing)[self.mask].min()
        else:
            inside = inner_distance(~other.mask, self.grid.spacing)[self.mask].min()
        return max(float(inside) - min(self.grid.spacing), 0.0)


def solids(
    labels: Labels,
    label: int | str,
    inclusions: Sequence[int | str],
    *,
    keep: Keep,
    fill_holes: bool,
    closed_at_border: bool,
) -> list[Solid]:
    """The organ (with its inclusions) and each inclusion, cropped alike, each after the one that encloses it."""
    value = labels.value_of(label)
    inner = [labels.value_of(other) for other in inclusions]
    if value in inner or len(set(inner)) < len(inner):
        raise DataError(f"inclusions {list(inclusions)}: each label once, and not the organ {label!r} itself")
    box = box_of(np.isin(labels.values, [value, *inner]))
    cropped = labels.values[box]
    corner = np.array([s.start for s in box])
    grid = Grid(cropped.shape, labels.grid.spacing)
    name = labels.names.get(value, str(value))
    whole = kept_parts(np.isin(cropped, [value, *inner]), np.isin(cropped, inner), keep, name, labels.grid, corner)
    if fill_holes:
        whole = _filled(whole, cropped, grid, name, labels)
    if not closed_at_border:
        _check_border(whole, corner, labels, name)
    found = [Solid(whole, value, name, grid, corner)]
    held = []
    for v in inner:
        mask = (cropped == v) & whole
        title = labels.names.get(v, str(v))
        if not mask.any():
            raise DataError(
                f"inclusion {title!r} lies outside the part of {name!r} that is kept; choose its part, or use keep='all'"
            )
        around = ndimage.binary_fill_holes(mask)
        held.append(Solid((around & np.isin(cropped, inner)) | mask, v, title, grid, corner))
    return found + sorted(held, key=lambda body: -body.volume)


def _filled(mask: Bool, values: Int32, grid: Grid, name: str, labels: Labels) -> Bool:
    filled: Bool = ndimage.binary_fill_holes(mask)
    hole = filled & ~mask
    if hole.any():
        inside = [labels.names.get(int(v), str(v)) for v in np.unique(values[hole]) if v != 0]
        what = f", labelled {', '.join(map(repr, inside))} (name it in inclusions to keep it apart)" if inside else ""
        volume = np.count_nonzero(hole) * grid.voxel_volume / 1000
        warnings.warn(f"{name!r} has closed voids of {volume:.3g} ml{what}: filled", stacklevel=4)
    return filled


def _check_border(mask: Bool, corner: Int64, labels: Labels, name: str) -> None:
    sides = []
    for axis, letter in enumerate("zyx"):
        first = np.take(mask, 0, axis)
        last = np.take(mask, -1, axis)
        if corner[axis] == 0 and first.any():
            sides.append((f"first {letter} layer", np.count_nonzero(first)))
        if corner[axis] + mask.shape[axis] == labels.grid.shape[axis] and last.any():
            sides.append((f"last {letter} layer", np.count_nonzero(last)))
    if sides:
        where = ", ".join(f"{count} voxels in the {side}" for side, count in sides)
        raise DataError(
            f"{name!r} touches the border of the volume ({where}), so part of it may be missing; crop the volume less, "
            f"or close it there with a flat wall: closed_at_border=True"
        )
