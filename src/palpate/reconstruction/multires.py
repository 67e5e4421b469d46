"""The scan and the grid at coarser resolutions (M-MAP-L of the dissertation)."""

from typing import Literal

import numpy as np

from palpate.arrays import AnyArray, Float32
from palpate.errors import DataError
from palpate.scans.scan import Scan
from palpate.scans.views import Panel, Views
from palpate.volumes.grid import Grid

Downsample = Literal["sum", "linear", "nearest", "median"]
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
    smallest = min(*grid.shape[1:], *scan.shape[1:])
    if smallest < 2 ** (levels - 1):
        raise DataError(
            f"levels: {levels} would halve {smallest} voxels or pixels {levels - 1} times; "
            f"take at most {smallest.bit_length()}"
        )
    all_levels = [(scan, grid)]
    for _ in range(1, levels):
        scan, grid = coarser_scan(scan, downsample), coarser_grid(grid)
        all_levels.append((scan, grid))
    return all_levels


def coarser_grid(grid: Grid) -> Grid:
    """Cells of 2x2 voxels in the slice, or 2x2x2 where slices are thinner than that; outer faces coincide.

    An odd number of voxels is filled up by one row beyond the last.
    """
    step = np.array([2 if grid.spacing[0] < 2 * min(grid.spacing[1:]) and grid.shape[0] > 1 else 1, 2, 2])
    shape = -(-np.array(grid.shape) // step)
    shift = grid.direction @ (((step - 1) / 2 * grid.spacing)[::-1])
    return Grid(shape, step * grid.spacing, np.array(grid.origin) + shift, grid.direction)


def coarser_panel(panel: Panel, downsample: Downsample = "sum") -> Panel:
    """Pixels of 2x2 pixels. Their centres lie half a fine pixel on, except where one pixel stands for four."""
    shape = [(n + 1) // 2 for n in panel.shape]
    first = panel.origin if downsample == "nearest" else panel.points([0.5, 0.5])[0]
    return Panel(shape, (2 * panel.pitch[0], 2 * panel.pitch[1]), first, panel.row_axis, panel.column_axis)


def coarser_scan(scan: Scan, downsample: Downsample = "sum") -> Scan:
    """Four pixels become one: sums over its *measured* pixels only, and measured itself if at least half of them are.

    Odd sizes are filled up with unmeasured pixels.
    """
    mask = _quads(scan.mask)
    count = np.zeros(mask[0].shape, np.uint8)
    for quarter in mask:
        count += quarter
    measured = mask[0] if downsample == "nearest" else count >= 2
    if not measured.any():
        raise DataError("levels: no coarse pixel has half of its fine pixels measured; take fewer levels")
    arrays = scan.counts, scan.incident, scan.background
    y, b, r = (_merged(_quads(a), mask, count, downsample) for a in arrays)
    panels = [coarser_panel(p, downsample) for p in scan.views.panels]
    return Scan(y, b, Views(scan.views.source, panels, scan.views.direction), r, measured)


def _quads(a: AnyArray) -> list[AnyArray]:
    """(views, rows, columns) to four of (views, rows/2, columns/2), views of it, filled up with zeros."""
    _, rows, columns = a.shape
    if rows % 2 or columns % 2:
        a = np.pad(a, ((0, 0), (0, rows % 2), (0, columns % 2)))
    return [a[:, i::2, j::2] for i in (0, 1) for j in (0, 1)]


def _merged(quads: list[AnyArray], mask: list[AnyArray], count: AnyArray, downsample: Downsample) -> Float32:
    merged: Float32
    if downsample == "nearest":
        merged = quads[0].astype(np.float32)
    elif downsample == "median":
        held = np.sort(np.where(mask, quads, np.inf), axis=0)
        middle = (np.maximum(count, 1) - 1) // 2, count // 2 % 4
        low, high = (np.take_along_axis(held, i[None], 0)[0] for i in middle)
        merged = np.where(count > 0, (np.where(np.isfinite(low), low, 0) + np.where(np.isfinite(high), high, 0)) / 2, 0)
        merged = merged.astype(np.float32)
    else:
        merged = np.zeros(count.shape, np.float32)
        for quarter, there in zip(quads, mask, strict=True):
            np.add(merged, quarter, out=merged, where=there)
        if downsample == "linear":
            merged /= np.maximum(count, 1)
    return merged
