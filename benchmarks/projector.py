"""Projection and backprojection: time, distance from the roofline, memory, and RTK on the same geometry."""

from collections.abc import Iterator

import numpy as np

import palpate as pp
from benchmarks import installed, rtk_projector
from benchmarks.interleaved_timing import header, medians, row
from benchmarks.peak_memory import above_arrays
from benchmarks.roofline import least
from benchmarks.workloads import WORKLOADS, smooth

AGAINST_RTK = {"W1 circular-8": 15, "W2 dbt-15": 5}  # runs: the shorter, the more


def lines() -> Iterator[str]:
    """Every table of this file."""
    yield from ours()
    yield from against_rtk()


def ours() -> Iterator[str]:
    """Times of our kernels beside the least time that memory or arithmetic allows."""
    yield "Projector, default tolerance. Least time: volume and projections moved once, or the multiply-adds of undivided "
    yield "slices, whichever takes longer (`roofline.py`); the last column is time over least time.\n"
    yield header(
        "workload",
        "kernel",
        "products a slice",
        "wall ms",
        "CPU ms",
        "giga voxel-views/CPU-s",
        "memory ms",
        "arithmetic ms",
        "times the least",
    )
    for name, make in WORKLOADS.items():
        views, grid = make()
        A = pp.Projector(views, grid)
        x, p = np.random.default_rng(0).random(grid.shape, np.float32), np.empty(views.shape, np.float32)
        f = np.empty_like(x)
        taken = medians({"forward": lambda: A(x, out=p), "back": lambda: A.T(p, out=f)}, 5)  # noqa: B023
        memory, arithmetic = least(views, grid)
        products = [A.geometry.products(view) for view in range(len(views))]
        for kernel, time in taken.items():
            rate = grid.size * len(views) / time.cpu / 1e9
            times = time.wall / max(memory, arithmetic)
            yield row(
                name,
                kernel,
                f"{min(products)}-{max(products)}",
                1e3 * time.wall,
                1e3 * time.cpu,
                rate,
                1e3 * memory,
                1e3 * arithmetic,
                times,
            )
    yield (
        "\nPeak memory above volume and projections, MB: "
        + ", ".join(f"{n} {above_arrays(n):.1f}" for n in WORKLOADS)
        + ".\n"
    )


def against_rtk() -> Iterator[str]:
    """The same geometry, the same arrays, taken in turn."""
    if not installed("itk-rtk"):
        yield "RTK is not installed: pip install 'palpate[bench]'.\n"
        return
    yield "RTK's Joseph pair in the same run. NRMSE: RTK's projections against ours, of a smooth volume and of voxels "
    yield "uniform in [0, 1).\n"
    yield header(
        "workload",
        "kernel",
        "ours wall s",
        "RTK wall s",
        "ratio",
        "ours CPU s",
        "RTK CPU s",
        "ratio",
        "NRMSE smooth",
        "NRMSE random",
        "adjoint ours",
        "adjoint RTK",
    )
    for name in AGAINST_RTK:
        yield from _compared(name, *WORKLOADS[name]())


def _compared(name: str, views: pp.Views, grid: pp.Grid) -> Iterator[str]:
    A, peer = pp.Projector(views, grid), rtk_projector.Joseph(views, grid)
    rng = np.random.default_rng(0)
    x, y = rng.random(grid.shape, np.float32), rng.random(views.shape, np.float32)
    s = smooth(grid)
    p, f = A(x), A.T(y)
    works = {"forward": lambda: A(x, out=p), "back": lambda: A.T(y, out=f)}
    peers = {"forward": peer.forward(x), "back": peer.back(y)}
    apart = [_nrmse(peer.forward(s)(), A(s)), _nrmse(peers["forward"](), p)]
    gaps = [_gap(p, x, f, y), _gap(peers["forward"](), x, peers["back"](), y)]
    for kernel in works:
        taken = medians({"ours": works[kernel], "RTK": peers[kernel]}, AGAINST_RTK[name], warm=False)
        o, r = taken["ours"], taken["RTK"]
        yield row(name, kernel, o.wall, r.wall, r.wall / o.wall, o.cpu, r.cpu, r.cpu / o.cpu, *apart, *gaps)


def _nrmse(p: np.ndarray, truth: np.ndarray) -> float:
    return float(np.linalg.norm((p - truth).ravel()) / np.linalg.norm(truth.ravel()))


def _gap(p: np.ndarray, x: np.ndarray, f: np.ndarray, y: np.ndarray) -> float:
    """|<Ax, y> - <x, A'y>| over the norms of Ax and y, sums in float64."""
    p, x, f, y = (a.ravel().astype(np.float64) for a in (p, x, f, y))
    return float(abs(p @ y - x @ f) / (np.linalg.norm(p) * np.linalg.norm(y)))
