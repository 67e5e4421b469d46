"""A breast of clinical size, reconstructed by M-MAP: `python -m benchmarks clinical` (minutes, 8 GB).

15 views of 1664x2048 pixels of 0.13 mm on W2's arc; 1996x2457x78 voxels of 0.1x0.1x1 mm, x along 2457. The scan is that of
an analytic phantom with counting noise. `reconstruct` is left to its defaults, which are five levels here: what is broad
is found on the coarse ones, where an iteration costs a quarter a level, and sweeps find the rest. Seconds are of the wall
and of the CPU, all threads; peak memory is that of the process while it reconstructs, the scan's arrays and Python
included. As much memory is written to once before, lest a virtual machine that hands it out late be measured;
one that takes freed memory back within seconds is measured all the same.
`python -m benchmarks.clinical 4` makes panel and voxels 4 times coarser, on five levels as well, and tells how far from
the minimum each finest iterate is: gap (Φ − Φ*) / (Φ of a uniform volume − Φ*), and the last one's distance from the
minimiser as a share of that one's norm. Φ* and minimiser: after 150 finest iterations, twice as many a level down.

How it scales: CPU time inside the kernels is taken for parallel, all other for serial, however busy the machine is; on N
cores serial + parallel/N seconds are predicted. That leaves out that memory is shared, and what kernels do alone.
"""

import re
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

import palpate as pp
from benchmarks.interleaved_timing import header, row
from palpate import _core
from palpate.arrays import Float32
from palpate.reconstruction.baselines.sirt import uniform_volume
from palpate.reconstruction.models.likelihood import Transmission
from palpate.reconstruction.optimizers.coordinate_descent import data_curvature
from palpate.reconstruction.prior_parameters import choose_prior_parameters, median_curvature
from palpate.scans.analytic_phantoms import Box, Ellipsoid, Intersection, Phantom, Solid

Clock = tuple[float, float, float]  # seconds: wall, CPU of all threads, CPU of all threads inside kernels
KERNELS = {
    _core.projection: ("project", "backproject"),
    _core.icd: ("diagonal", "sweep"),
    _core.statistics: (
        *("transmission_value", "transmission_slope", "transmission_curvature", "transmission_value_and_slope"),
        "prior_value",
    ),
    _core.subspace: ("prior_curvatures", "data_curvatures", "search_direction", "subspace_step"),
    _core.volume: ("interpolate",),
    _core.base: ("all_finite",),
    _core.phantom: ("transmission",),
}
inside = 0.0  # CPU seconds in kernels so far
CORES = (2, 4, 8, 16)
LEVELS, LONG = 5, 150


def phantom() -> Phantom:
    """A compressed breast, 62 mm thick, its chest wall at y = 0: fat, gland, ducts, masses and specks. 1/mm at 20 keV."""
    half = Box((0, 150, 61), (400, 300, 62))
    parts: list[tuple[Solid, float]] = [
        (Intersection([Ellipsoid((0, 0, 61), (112, 165, 52)), half]), 0.0456),
        (Intersection([Ellipsoid((0, 20, 61), (74, 105, 26)), half]), 0.0173),
    ]
    rng = np.random.default_rng(0)
    for _ in range(12):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        at = rng.uniform((-60, 10, 45), (60, 100, 78))
        parts.append((Ellipsoid(at, rng.uniform((2, 4, 2), (5, 15, 4)), turn), 0.0173))
    parts += [(Ellipsoid(rng.uniform((-50, 20, 45), (50, 90, 78)), r), 0.0273) for r in (2.5, 3.5, 5)]
    parts += [(Ellipsoid(rng.uniform((-50, 20, 45), (50, 90, 78)), 0.25), 0.3) for _ in range(8)]
    return Phantom(parts)


def geometry(coarser: int = 1) -> tuple[pp.Views, pp.Grid]:
    """Views and grid; coarser: pixels and voxels so many times larger in the slice."""
    rows, columns, pitch = 1664 // coarser, 2048 // coarser, 0.13 * coarser
    panel = pp.Panel((rows, columns), (pitch, pitch), (-(columns - 1) / 2 * pitch, pitch / 2, 0))
    a = np.radians(np.linspace(-25, 25, 15))
    views = pp.Views(np.stack([650 * np.sin(a), 0 * a, 40 + 650 * np.cos(a)], axis=1), panel)
    ny, nx, d = 1996 // coarser, 2457 // coarser, 0.1 * coarser
    return views, pp.Grid((78, ny, nx), (1, d, d), (-(nx - 1) / 2 * d, d / 2, 30.5))


def lines(coarser: int = 1) -> Iterator[str]:
    """Stages, memory, and the model of more cores."""
    views, grid = geometry(coarser)
    for module, names in KERNELS.items():
        for name in names:
            setattr(module, name, counted(getattr(module, name)))
    began = clock()
    scan = pp.simulate_scan(phantom(), views, 20_000, seed=1)
    simulated = since(began)
    yield f"{len(views)} views of {views.shape[1]}x{views.shape[2]}, {grid.shape[1]}x{grid.shape[2]}x{grid.shape[0]} voxels"
    yield f"scan simulated in {simulated[0]:.0f} s wall, {simulated[1]:.0f} s CPU\n"
    touch(7.0 / coarser**2)
    Path("/proc/self/clear_refs").write_text("5")  # the peak so far is forgotten
    before = status("VmRSS")
    yield header("stage", "wall s", "CPU s", "serial s", "parallel s")
    begun = start = clock()
    values: list[float] = []
    made = dict.fromkeys(range(LEVELS), 0)  # iterations
    for step in pp.iterates(scan, grid, levels=LEVELS):
        made[step.level] = step.iteration
        if step.level == 0:
            values.append(step.objective)
            yield stage(f"finest iterate {step.iteration}, what leads to it included", since(begun))
            begun = clock()
    whole = since(start)
    yield stage("all", whole)
    gb = status("VmHWM") * 1024 / 1e9
    yield f"\niterations a level, coarsest first: {', '.join(str(made[k]) for k in reversed(made))}"
    yield f"peak memory {gb:.2f} GB, of which {before * 1024 / 1e9:.2f} before the start; limit 8 GB."
    yield f"{whole[0]:.0f} s wall; target 180 s on two idle cores, clinical limit 40-60 s."
    serial, parallel = parts(whole)
    predicted = ", ".join(f"{n} cores {serial + parallel / n:.0f} s" for n in CORES)
    yield f"serial {serial:.1f} s, parallel {parallel:.0f} s; predicted for idle cores, memory no limit: {predicted}"
    if coarser > 1:
        yield from gaps(scan, grid, values, step.volume.values)


def gaps(scan: pp.Scan, grid: pp.Grid, values: list[float], last: Float32) -> Iterator[str]:
    """How far from the minimum the finest iterates were, objectives `values`, and the last one from the minimiser."""
    for step in pp.iterates(scan, grid, levels=LEVELS, iterations=LONG, tolerance=0):
        best = step  # the last one's stays
    lowest, minimiser = best.objective, best.volume.values
    A, data = pp.Projector(scan.views, grid), Transmission.of(scan)
    prior = choose_prior_parameters(pp.Prior(), A, data, known := data_curvature(A, data))
    flat = uniform_volume(A, data)
    top = data.value(A(flat)) + prior.strength * median_curvature(known) * prior.value(flat, grid)
    shown = ", ".join(f"{(value - lowest) / (top - lowest):.1e}" for value in values)
    yield f"gap after each finest iteration: {shown}"
    yield f"from the minimiser: {np.linalg.norm(last - minimiser) / np.linalg.norm(minimiser):.2%}"


def touch(gb: float) -> None:
    """Has the system hand out so much memory, and gives it back."""
    np.empty(int(gb * 1e9), np.uint8)[::4096] = 1


def clock() -> Clock:
    """Now."""
    return time.perf_counter(), time.process_time(), inside


def since(began: Clock) -> Clock:
    """Seconds since then."""
    return tuple(now - then for now, then in zip(clock(), began, strict=True))  # type: ignore[return-value]


def counted(kernel: Callable[..., object]) -> Callable[..., object]:
    """The kernel, its CPU time added to that inside kernels."""

    def call(*arguments: object, **named: object) -> object:
        global inside
        began = time.process_time()
        try:
            return kernel(*arguments, **named)
        finally:
            inside += time.process_time() - began

    return call


def parts(taken: Clock) -> tuple[float, float]:
    """Serial and parallel CPU seconds."""
    return taken[1] - taken[2], taken[2]


def stage(name: str, taken: Clock) -> str:
    """A row of the table."""
    return row(name, *(f"{s:.1f}" for s in (*taken[:2], *parts(taken))))


def status(key: str) -> float:
    """Of this process, kB."""
    return int(re.search(rf"{key}:\s+(\d+) kB", Path("/proc/self/status").read_text())[1])  # type: ignore[index]


if __name__ == "__main__":
    for line in lines(*map(int, sys.argv[1:])):
        print(line, flush=True)
