"""Line integrals of a volume along the rays of a scan, and their exact transpose."""

import warnings

import numpy as np
from numpy.typing import ArrayLike

from palpate import _core
from palpate.arrays import Float32, Float64, float32
from palpate.errors import DataError, GeometryError
from palpate.scans.views import Views
from palpate.volumes.grid import Grid

TOLERANCE = 3e-3  # relative L2 error of a view of independent voxel values, uniform in [0, 1]


class Projector:
    """The linear map from a volume to its projections, separable in x and y on each slice.

    A(x):   (z, y, x) 1/mm           -> (views, rows, columns), no unit: line integrals averaged over each pixel
    A.T(p): (views, rows, columns)   -> (z, y, x), the exact transpose

    tolerance: relative L2 error of each view against exact line integrals through the voxels, for independent voxel
    values uniform in [0, 1] (smooth volumes are far below it). It decides how many products of 1-D weights a slice is
    made of where a source lies off both axes, and the shadow moves along both while the ray crosses the slice; time
    grows with them; rows of voxels that need fewer have fewer. And how little a voxel may weigh in a pixel before its
    neighbour there gets its weight: all that it saves is time. It holds for panels parallel to the slices and for those
    turned about x or y alone; any other panel is averaged from a parallel one of half its pitch, which adds about
    0.5 %. The error is estimated on sample voxels of each view. Rays run on beyond a panel that cuts the grid.
    `geometry` is what the kernels share.

    Raises `GeometryError` when the grid reaches a focal spot or lies behind a panel, or when no ray meets it.
    Source: distance-driven weights after De Man & Basu, Phys. Med. Biol. 49, 2004; separable trapezoids after Long,
    Fessler & Balter, IEEE TMI 29, 2010; their product corrected by Legendre moments over the slice (cpp/weights.h).
    """

    def __init__(self, views: Views, grid: Grid, tolerance: float = TOLERANCE) -> None:
        if not 1e-6 <= tolerance <= 0.5:
            raise GeometryError(f"tolerance: expected a relative error between 1e-6 and 0.5, got {tolerance!r}")
        check_meeting(views, grid)
        self.views, self.grid, self.tolerance = views, grid, tolerance
        self.domain_shape, self.range_shape = grid.shape, views.shape
        panels = views.panels
        self.geometry = _core.Geometry(
            source=np.ascontiguousarray(views.source),
            origin=np.array([p.origin for p in panels]),
            row_axis=np.array([p.row_axis for p in panels]),
            column_axis=np.array([p.column_axis for p in panels]),
            pitch=np.array([p.pitch for p in panels], dtype=np.float64),
            rows=panels[0].shape[0],
            columns=panels[0].shape[1],
            shape=np.array(grid.shape, dtype=np.float64),
            spacing=np.array(grid.spacing),
            grid_origin=np.array(grid.origin),
            tolerance=tolerance,
        )
        self.T = Transpose(self)

    def __call__(self, x: ArrayLike, out: Float32 | None = None) -> Float32:
        """Projections (views, rows, columns) of a volume (z, y, x). Raises `DataError`."""
        values = float32("volume", x, self.domain_shape)
        out = _output(out, self.range_shape)
        _core.project(self.geometry, values, out)
        return out


class Transpose:
    """A.T: projections back into the volume. A.T.T is A."""

    def __init__(self, projector: Projector) -> None:
        self.T = projector
        self.domain_shape, self.range_shape = projector.range_shape, projector.domain_shape

    def __call__(self, p: ArrayLike, out: Float32 | None = None) -> Float32:
        """Volume (z, y, x) of projections (views, rows, columns). Raises `DataError`."""
        values = float32("projections", p, self.domain_shape)
        out = _output(out, self.range_shape)
        _core.backproject(self.T.geometry, values, out)
        return out


def check_meeting(views: Views, grid: Grid) -> None:
    """Raises `GeometryError` unless the grid lies between sources and panels and some ray meets it."""
    corners = _corners(grid)
    shadow_low, shadow_high = [], []
    missing = []
    for view, (source, panel) in enumerate(zip(views.source, views.panels, strict=True)):
        if source[2] - corners[:, 2].max() < grid.spacing[0]:
            raise GeometryError(
                f"grid reaches up to z = {corners[:, 2].max():g} mm, but the source of view {view} is at "
                f"z = {source[2]:g} mm: slices must lie below every focal spot, by one slice at least; lower the grid "
                f"or check the z axis"
            )
        towards = np.sign((source - panel.origin) @ panel.normal) * panel.normal
        height = (corners - panel.origin) @ towards
        if height.max() <= 0:
            raise GeometryError(
                f"geometry misses the volume: the grid lies behind the panel of view {view} (nearest corner "
                f"{-height.max():g} mm behind); move the grid's origin or the panel"
            )
        if height.max() >= (source - panel.origin) @ towards:
            raise GeometryError(
                f"grid reaches behind the focal spot of view {view} at {_mm(source)}, as seen from its panel; "
                f"the object lies between source and panel: check the panel's origin and axes"
            )
        # The part of the box in front of the panel casts the shadow: corners behind it are brought to the panel.
        landed = views[view].project(corners[height > 0])[0]
        shadow_low.append(landed.min(axis=0))
        shadow_high.append(landed.max(axis=0))
        if (landed.max(axis=0) <= -0.5).any() or (landed.min(axis=0) >= np.array(panel.shape) - 0.5).any():
            missing.append(view)
    if len(missing) == len(views):
        low, high = np.min(shadow_low, axis=0), np.max(shadow_high, axis=0)
        raise GeometryError(
            f"geometry misses the volume: its shadow covers rows {low[0]:.0f} to {high[0]:.0f} and columns "
            f"{low[1]:.0f} to {high[1]:.0f}, but the panel has rows 0 to {views.shape[1] - 1} and columns 0 to "
            f"{views.shape[2] - 1}; check the grid's origin, the panel's origin and axes, and the units"
        )
    if missing:  # lawful, for a wide sweep over a small object, but seldom meant
        warnings.warn(f"the volume's shadow misses the panel in views {missing}; they tell nothing of it", stacklevel=3)


def _mm(point: Float64) -> str:
    return "(" + ", ".join(f"{value:g}" for value in point) + ") mm"


def _corners(grid: Grid) -> Float64:
    low, high = grid.bounds
    return np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])


def _output(out: Float32 | None, shape: tuple[int, int, int]) -> Float32:
    if out is None:
        return np.empty(shape, dtype=np.float32)
    if out.shape != shape or out.dtype != np.float32 or not out.flags.c_contiguous:
        raise DataError(f"out: expected a C-contiguous float32 array of shape {shape}, got {out.shape} {out.dtype}")
    return out
