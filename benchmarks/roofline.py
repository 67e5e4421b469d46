"""What this machine can move and multiply, and the least time that a projection needs for both."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np

import palpate as pp
from benchmarks import THREADS
from benchmarks.interleaved_timing import medians

FLOATS = 1 << 26  # an array: 256 MB, beyond any cache


@cache
def bandwidth() -> float:
    """Bytes a second to and from memory by THREADS threads: the better of a copy and of a product of two long vectors."""
    a, b = np.ones(FLOATS, np.float32), np.ones(FLOATS, np.float32)
    parts = [slice(FLOATS * i // THREADS, FLOATS * (i + 1) // THREADS) for i in range(THREADS)]
    copy = _together(lambda i: np.copyto(b[parts[i]], a[parts[i]]))
    read = _together(lambda i: np.dot(a[parts[i]], b[parts[i]]))
    return 2 * a.nbytes / min(copy, read)


@cache
def flops() -> float:
    """Float32 operations a second by THREADS threads: BLAS's matrix product, the nearest to a peak that all machines have."""
    a, b = np.ones((2048, 2048), np.float32), np.ones((2048, 2048), np.float32)
    return THREADS * 2 * 2048**3 / _together(lambda i: a @ b)


def _together(work: Callable[[int], object]) -> float:
    """Least wall time of several tries in which each thread does its part once."""
    with ThreadPoolExecutor(THREADS) as pool:
        taken = [medians({"": lambda: list(pool.map(work, range(THREADS)))}, 1)[""].wall for _ in range(7)]
    return min(taken)


def moved(views: pp.Views, grid: pp.Grid) -> int:
    """Bytes of volume and projections, each moved once."""
    return 4 * (grid.size + int(np.prod(views.shape)))


def operations(views: pp.Views, grid: pp.Grid) -> float:
    """Two for each multiply-add of the two 1-D resamplings of each slice in each view.

    A voxel of width d, m times magnified and smeared by s over the slice's thickness, meets (m d + s) / pitch + 1 pixels
    on the average. The first pass resamples the rows of voxels, the second the columns of what came out (or the other
    way round, whichever is less). Panels are taken as parallel to the slices, and slices as undivided.
    """
    dz, dy, dx = grid.spacing
    ny, nx = grid.shape[1:]
    total = 0.0
    for (sx, sy, sz), panel in zip(views.source, views.panels, strict=True):
        depth = abs(float(([sx, sy, sz] - panel.origin) @ panel.normal))
        for z in grid.axis("z"):
            m = depth / (sz - z)
            shear = m * dz / (sz - z)
            u, v = (
                (m * d + shear * np.abs(grid.axis(axis) - s).mean()) / pitch + 1
                for d, axis, s, pitch in ((dx, "x", sx, panel.pitch[1]), (dy, "y", sy, panel.pitch[0]))
            )
            high, wide = (
                min(panel.shape[0], ny * m * dy / panel.pitch[0]),
                min(panel.shape[1], nx * m * dx / panel.pitch[1]),
            )
            total += 2 * min(nx * ny * u + wide * ny * v, nx * ny * v + nx * high * u)
    return total


def least(views: pp.Views, grid: pp.Grid) -> tuple[float, float]:
    """Seconds that memory and that arithmetic need at least for one projection or backprojection."""
    return moved(views, grid) / bandwidth(), operations(views, grid) / flops()


def lines() -> Iterator[str]:
    """The machine's two limits."""
    yield f"{THREADS} threads: memory {bandwidth() / 1e9:.1f} GB/s, float32 {flops() / 1e9:.0f} GFLOP/s (BLAS).\n"
