"""Scan and grid at coarser resolutions, for M-MAP-L."""

from typing import Literal

import numpy as np

from palpate.arrays import AnyArray, Bool, Float32, UInt8
from palpate.errors import DataError
from palpate.scans.scan import Scan
from palpate.scans.views import Panel, Views
from palpate.volumes.grid import Grid

Downsample = Literal["sum", "linear", "nearest", "median"]
FINE = 128  # the coarsest slice has fewer voxels along a side
DOWNSAMPLES: tuple[Downsample, ...] = ("sum", "linear", "nearest", "median")


def pyramid(scan: Scan, grid: Grid, levels: int, downsample: Downsample = "sum") -> list[tuple[Scan, Grid]]:
    """Scan and grid of each level, finest first; each level halves the panel's and the slices' resolution.

    Depth is halved too where a slice would otherwise be thinner than its voxels are wide. downsample: "sum" adds up
    counts, so that Poisson stays Poisson; "linear" (mean), "nearest" and "median" are the dissertation's choices, whose
    noise is no longer that of counts. Raises `DataError`.
    """
    if levels < 1 or levels != int(levels):
        raise DataError(f"levels: expected a whole number of at least 1, got {levels!r}")
    if downsample not in DOWNSAMPLES:
        raise DataError(f"downsample: there is no {downsample!r}; choose from {', '.join(DOWNSAMPLES)}")
    most = _most_levels(scan, grid)
    if levels > most:
        smallest = min(*grid.shape[1:], *scan.shape[1:])
        raise DataError(
            f"levels: {levels} would halve {smallest} voxels or pixels {levels - 1} times; take at most {most}"
        )
    all_levels = [(scan, grid)]
    for _ in range(1, levels):
        scan, grid = coarser_scan(scan, downsample), coarser_grid(grid)
        all_levels.append((scan, grid))
    return all_levels


def default_levels(scan: Scan, grid: Grid) -> int:
    """3, or more while the coarsest slice keeps `FINE` / 2 voxels a side; fewer where panel, mask or slice allow no more.

    On few voxels iterations cost nothing, and what is broad is found there alone: where the coarsest grid is still fine,
    the reconstruction ends before it has come to that.
    """
    wanted = max(3, 1 + (min(grid.shape[1:]) // FINE).bit_length())
    measured = [int(np.count_nonzero(scan.mask.any(axis=axes))) for axes in ((0, 2), (0, 1))]  # rows, columns
    return max(1, min(wanted, _most_levels(scan, grid), *(n.bit_length() for n in measured)))


def _most_levels(scan: Scan, grid: Grid) -> int:
    """Until a pixel or a voxel is as wide as the panel or the slice."""
    return min(*grid.shape[1:], *scan.shape[1:]).bit_length()


def coarser_grid(grid: Grid) -> Grid:
    """Cells of 2x2 voxels in the slice, or 2x2x2 where slices are thinner than that; outer faces coincide.

    An odd number of voxels is filled up by one row beyond the last.
    """
    step = np.array([2 if grid.spacing[0] < 2 * min(grid.spacing[1:]) and grid.shape[0] > 1 else 1, 2, 2])
    shape = -(-np.array(grid.shape) // step)
    shift = grid.direction @ (((step - 1) / 2 * grid.spacing)[::-1])
    return Grid(shape, step * grid.spacing, np.array(grid.origin) + shift, grid.direction)


def coarser_support(support: UInt8, grid: Grid) -> UInt8:
    """On `coarser_grid(grid)`: a coarse voxel is in the support if any of its fine voxels is."""
    coarse = coarser_grid(grid)
    for axis in range(3):
        if coarse.shape[axis] != grid.shape[axis]:
            support = np.maximum.reduceat(support, np.arange(0, grid.shape[axis], 2), axis=axis)
    return support


def coarser_panel(panel: Panel, downsample: Downsample = "sum") -> Panel:
    """Pixels of 2x2 pixels. Their centres lie half a fine pixel on, except where one pixel stands for four."""
    shape = [(n + 1) // 2 for n in panel.shape]
    first = panel.origin if downsample == "nearest" else panel.points([0.5, 0.5])[0]
    return Panel(shape, (2 * panel.pitch[0], 2 * panel.pitch[1]), first, panel.row_axis, panel.column_axis)


def coarser_scan(scan: Scan, downsample: Downsample = "sum") -> Scan:
    """Four pixels become one: sums over its *measured* pixels only, and measured itself if at least half of them are.

    Odd sizes are filled up with unmeasured pixels.
    """
    count = _summed(scan.mask.view(np.uint8), scan.mask)
    measured = _pixel_quadruples(scan.mask)[0] if downsample == "nearest" else count >= 2
    if not measured.any():
        raise DataError("levels: no coarse pixel has half of its fine pixels measured; take fewer levels")
    arrays = scan.counts, scan.incident, scan.background
    y, b, r = (_merged(a, scan.mask, count, downsample) for a in arrays)
    panels = [coarser_panel(p, downsample) for p in scan.views.panels]
    return Scan(y, b, Views(scan.views.source, panels, scan.views.direction), r, measured, blur=scan.blur)


def _even(a: AnyArray) -> AnyArray:
    """Filled up with zeros to an even number of rows and columns."""
    _, rows, columns = a.shape
    return np.pad(a, ((0, 0), (0, rows % 2), (0, columns % 2))) if rows % 2 or columns % 2 else a


def _pixel_quadruples(a: AnyArray) -> list[AnyArray]:
    """(views, rows, columns) to four of (views, rows/2, columns/2), views of it, filled up with zeros."""
    a = _even(a)
    return [a[:, i::2, j::2] for i in (0, 1) for j in (0, 1)]


def _summed(a: AnyArray, mask: Bool) -> AnyArray:
    """Over the measured ones of four pixels. Rows first: they lie together in memory."""
    held = _even(a if mask.all() else np.where(mask, a, a.dtype.type(0)))
    rows = held[:, 0::2] + held[:, 1::2]
    summed: AnyArray = rows[:, :, 0::2] + rows[:, :, 1::2]
    return summed


def _merged(a: Float32, mask: Bool, count: UInt8, downsample: Downsample) -> Float32:
    """(views, rows, columns) made coarser, or one number a view. count: measured ones of each four pixels."""
    one_a_view = a.strides[1:] == (0, 0)  # as `Scan` keeps what was given as one number
    if one_a_view and (count == 4).all():
        return a[:, 0, 0] * np.float32(4 if downsample == "sum" else 1)
    if downsample == "nearest":
        return np.ascontiguousarray(_pixel_quadruples(a)[0])
    if downsample == "median":
        return _median(_pixel_quadruples(a), _pixel_quadruples(mask), count)
    summed = a[:, :1, :1] * count.astype(np.float32) if one_a_view else _summed(a, mask)
    if downsample == "linear":
        summed /= np.maximum(count, 1)
    return summed


def _median(quads: list[AnyArray], mask: list[AnyArray], count: UInt8) -> Float32:
    held = np.sort(np.where(mask, quads, np.inf), axis=0)
    middle = (np.maximum(count, 1) - 1) // 2, count // 2 % 4
    low, high = (np.take_along_axis(held, i[None], 0)[0] for i in middle)
    merged = np.where(count > 0, (np.where(np.isfinite(low), low, 0) + np.where(np.isfinite(high), high, 0)) / 2, 0)
    return merged.astype(np.float32)
