"""Along which axis of the volume each view is projected, slice by slice."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from palpate import _core
from palpate.arrays import Float32, Float64
from palpate.errors import GeometryError
from palpate.scans.views import Views
from palpate.volumes.grid import Grid

STEEP = 0.5  # least |cosine| between z and a ray that is sliced along z; up to there such slices serve, and are faster
# Fine pixels along a measured one, on a panel that is neither parallel to the slices nor turned about one axis. Errors of
# independent voxels are about 1 % and 0.2 %. Two serve views from above, as they always did.
COARSE, FINE, FINER_BELOW = 2, 5, 3e-3
BLOCK = 32  # voxels along x
# The volume's axes (z, y, x) as axes of the slicing: the first is the one along which it is sliced.
ORDER = {0: (2, 0, 1), 1: (1, 0, 2), 2: (0, 1, 2)}  # by the world's axis, x, y or z


@dataclass(frozen=True, eq=False)
class Slicing:
    """The views that one slicing serves, and volume and views as the kernels see them.

    The kernels take slices z = constant below every focal spot. The volume's axes are exchanged so that the world's
    `axis` becomes z, and reversed where the focal spots lie `below`. Both keep line integrals.
    """

    views: list[int]
    axis: int
    below: bool
    geometry: _core.projection.ScanGeometry

    @property
    def upright(self) -> bool:
        """Whether volume and views are as they were given."""
        return self.axis == 2 and not self.below

    def sliced(self, values: Float32) -> Float32:
        """The volume (z, y, x) with its axes exchanged."""
        out = np.empty([values.shape[axis] for axis in ORDER[self.axis]], np.float32)
        there = self.restored(out)
        for part in self._parts(values.shape):
            there[part] = values[part]
        return out

    def put(self, sliced: Float32, out: Float32, add: bool) -> None:
        """The volume with its axes as they were, written to `out` or added to it."""
        there = self.restored(sliced)
        for part in self._parts(out.shape):
            out[part] = out[part] + there[part] if add else there[part]

    def _parts(self, shape: tuple[int, ...]) -> Iterator[tuple[slice | int, ...]]:
        """All of the volume, in parts whose axes are exchanged within the cache."""
        for z in range(shape[0]):
            for x in range(0, shape[2], BLOCK) if self.axis == 0 else ():
                yield z, slice(None), slice(x, x + BLOCK)
            if self.axis:
                yield (z,)

    def restored(self, values: Float32) -> Float32:
        """A sliced volume as (z, y, x), in the same memory."""
        turned = values[::-1] if self.below else values
        return turned.transpose(np.argsort(ORDER[self.axis]))


def slicings(views: Views, grid: Grid, tolerance: float) -> list[Slicing]:
    """The views by the axis and the side from which each is projected. Raises `GeometryError` for a spot in the grid."""
    sides: dict[tuple[int, bool], list[int]] = {}
    for view, side in enumerate(_sides(views, grid)):
        sides.setdefault(side, []).append(view)
    return [
        Slicing(some, axis, below, geometry(views, grid, tolerance, some, axis, below))
        for (axis, below), some in sides.items()
    ]


def _sides(views: Views, grid: Grid) -> Iterator[tuple[int, bool]]:
    """Of each view the axis nearest to the ray through the grid's centre, and whether the focal spot is at its low end.

    A focal spot outside the box is outside its slab along one axis at least, and only such an axis serves. z is kept for
    all rays that it serves well.
    """
    low, high = grid.bounds
    slice_ = np.array(grid.spacing[::-1])
    for view, source in enumerate(views.source):
        ray = np.abs((low + high) / 2 - source)
        ray /= np.linalg.norm(ray)
        below, above = low - source, source - high
        outside = np.maximum(below, above) >= slice_
        if not outside.any():
            raise GeometryError(
                f"the source of view {view} at ({', '.join(f'{v:g}' for v in source)}) mm lies inside the grid or within "
                f"a voxel of it, which spans {grid.bounds.tolist()} mm; move the grid or make it smaller"
            )
        axis = 2 if outside[2] and ray[2] >= STEEP else int(np.where(outside, ray, -1).argmax())
        yield axis, bool(below[axis] > above[axis])


def geometry(
    views: Views, grid: Grid, tolerance: float, some: list[int], axis: int, below: bool
) -> _core.projection.ScanGeometry:
    """Those views and the grid, with axes exchanged, for the kernels."""
    order = np.array(ORDER[axis])  # of (z, y, x)
    world = 2 - order[::-1]  # of (x, y, z): the axes that become x, y and z
    sign = np.array([1.0, 1.0, -1.0 if below else 1.0])

    def turned(points: Float64) -> Float64:
        return np.ascontiguousarray(points[..., world] * sign)

    first = turned(np.array(grid.origin))
    if below:
        first[2] -= (grid.shape[order[0]] - 1) * grid.spacing[order[0]]
    panels = [views.panels[k] for k in some]
    return _core.projection.ScanGeometry(
        source=turned(views.source[some]),
        origin=turned(np.array([p.origin for p in panels])),
        row_axis=turned(np.array([p.row_axis for p in panels])),
        column_axis=turned(np.array([p.column_axis for p in panels])),
        pitch=np.array([p.pitch for p in panels], dtype=np.float64),
        rows=panels[0].shape[0],
        columns=panels[0].shape[1],
        shape=np.array(grid.shape, dtype=np.float64)[order],
        spacing=np.array(grid.spacing)[order],
        grid_origin=first,
        tolerance=tolerance,
        oversampling=COARSE if (axis, below) == (2, False) and tolerance >= FINER_BELOW else FINE,
    )
