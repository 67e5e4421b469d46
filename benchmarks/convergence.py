"""Time to the converged posterior on W1: `python -m benchmarks.convergence` (a part: `--phantoms slab --doses 20000`).

Gap: (Φ − Φ*) / (Φ of the uniform start − Φ*), on the finest level. Φ* comes from M-MAP with momentum gone on with for ten
times the iterations that it takes to the smallest gap shown. One pass is a projection and a backprojection, timed beside the
runs. F-MAP: coordinate descent on the finest level alone from a uniform volume. M-MAP-3: three levels, each optimiser.
β and edge are what `tune` chooses from each scan, the same for all runs of it. Scans are analytic, with Poisson noise.
"""

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

import palpate as pp
from benchmarks.timing import medians
from benchmarks.workloads import circular
from palpate.reconstruction.baselines import uniform
from palpate.reconstruction.descent import data_curvature
from palpate.reconstruction.likelihood import Transmission
from palpate.reconstruction.tune import median_curvature, tune
from palpate.scans.phantom import Ellipsoid, Phantom

GAPS = (1e-2, 1e-3, 1e-4)


def lump_phantom() -> Phantom:
    """A body of soft tissue amid air, 104 x 84 x 40 mm, with inserts; no face of it follows the voxels."""
    turn = np.linalg.qr(np.array([[1, 0.4, 0.1], [-0.4, 1, 0.2], [0.1, -0.3, 1]]))[0]
    parts = [
        (Ellipsoid((0, 0, 54), (52, 42, 20), turn), 0.020),
        (Ellipsoid((-18, -8, 50), (14, 10, 6), turn.T), 0.010),
        (Ellipsoid((16, 12, 58), (8, 16, 5)), -0.008),
        (Ellipsoid((20, -14, 54), 5), 0.020),
        (Ellipsoid((-6, 18, 60), 3), 0.030),
    ]
    return Phantom(parts)


PHANTOMS = {"slab": pp.slab_phantom, "lump": lump_phantom}


@dataclass(frozen=True)
class Seen:
    """A step of a run, and the CPU and wall seconds until it came."""

    level: int
    objective: float
    cpu: float
    wall: float


def timed(run: Callable[[], Iterator[pp.Step]], enough: float) -> list[Seen]:
    """Steps of a run, its preparation included, until the finest level's objective is low enough."""
    began = time.process_time(), time.perf_counter()
    steps = run()
    cpu, wall = time.process_time() - began[0], time.perf_counter() - began[1]
    seen: list[Seen] = []
    while not (seen and seen[-1].level == 0 and seen[-1].objective <= enough):
        before = time.process_time(), time.perf_counter()
        step = next(steps, None)
        if step is None:
            break
        cpu, wall = cpu + time.process_time() - before[0], wall + time.perf_counter() - before[1]
        seen.append(Seen(step.level, step.objective, cpu, wall))
    return seen


def measure(scan: pp.Scan, grid: pp.Grid, unit: tuple[float, float], most: int) -> Iterator[str]:
    """Lines of the table for one scan."""
    A, data = pp.Projector(scan.views, grid), Transmission.of(scan)
    known = data_curvature(A, data)
    prior = tune(pp.Prior(), A, data, known)
    beta = prior.strength * median_curvature(known)
    flat = uniform(A, data)
    top = data.value(A(flat)) + beta * prior.value(flat, grid)

    def run(levels: int, optimiser: str) -> Callable[[], Iterator[pp.Step]]:
        # Levels stop by their own rule, as a user's would: a gap that the default rule never asks for shows as "-".
        return lambda: pp.iterates(
            scan,
            grid,
            levels=levels,
            prior=prior,
            optimiser=optimiser,
            start="uniform" if levels == 1 else "backprojection",
            iterations=[most, 50, 50][:levels],
            tolerance=1e-5 if levels == 1 else 1e-3,
        )

    star = converged(scan, grid, prior, top)
    runs = {
        "F-MAP descent": run(1, "descent"),
        "F-MAP momentum": run(1, "momentum"),
        "M-MAP-3 descent": run(3, "descent"),
        "M-MAP-3 momentum": run(3, "momentum"),
    }
    yield f"  edge {prior.edge:.3g}/mm, beta {beta:.3g}, objective of the uniform start {top:.6g}, converged {star:.6g}"
    slowest: dict[float, tuple[str, float]] = {}
    for name, start in runs.items():
        seen = timed(start, star + GAPS[-1] * (top - star))
        cells = []
        for gap in GAPS:
            first = next((s for s in seen if s.level == 0 and s.objective <= star + gap * (top - star)), None)
            if name == "F-MAP descent":  # what the others are compared with; a bound where it stopped before
                slowest[gap] = (" " if first else ">", (first or seen[-1]).cpu)
            if first is None:
                cells.append(f"{'-':>38}")
                continue
            count = sum(s.level == 0 for s in seen[: seen.index(first) + 1])
            sign, ratio = slowest[gap][0], slowest[gap][1] / first.cpu
            cells.append(
                f"{first.wall:7.2f} {first.cpu:7.2f} {first.cpu / unit[1]:7.1f} {count:5} {sign}{ratio:6.1f}x "
            )
        yield f"  {name:18}" + "|".join(cells)


def converged(scan: pp.Scan, grid: pp.Grid, prior: pp.Prior, top: float) -> float:
    """Φ*, by going on ten times as long as it takes until an iteration gains less than a tenth of the smallest gap."""
    steps = pp.iterates(scan, grid, prior=prior, optimiser="momentum", iterations=[10**6, 50, 50], tolerance=0.0)
    before, needed = np.inf, 0
    for step in steps:
        if step.level > 0:
            continue
        if not needed and before - step.objective < 0.1 * GAPS[-1] * (top - step.objective):
            needed = step.iteration
        if needed and step.iteration >= 10 * needed:
            return step.objective
        before = step.objective
    raise AssertionError("the run does not end")


def lines(
    phantoms: list[str] | None = None,
    doses: tuple[float, ...] = (2e3, 2e4, 2e5),
    seeds: tuple[int, ...] = (1, 2),
    most: int = 60,
) -> Iterator[str]:
    """The table of all scans."""
    views, grid = circular()
    A, f = pp.Projector(views, grid), np.full(grid.shape, 0.02, np.float32)
    p = A(f)
    unit = medians({"pass": lambda: A.T(A(f, out=p), out=f)})["pass"]
    yield "```"
    yield f"one pass: {unit.wall:.3f} s wall, {unit.cpu:.3f} s CPU"
    yield f"{'to a gap of':20}" + "|".join(f"{gap:^38.0e}" for gap in GAPS)
    yield f"{'':20}" + "|".join(f"{'wall s':>7} {'CPU s':>7} {'passes':>7} {'iter.':>5} {'sooner':>7}  " for _ in GAPS)
    for name in phantoms or PHANTOMS:
        for dose in doses:
            for seed in seeds:
                yield f"{name}, {dose:g} photons, seed {seed}"
                scan = pp.simulate_scan(PHANTOMS[name](), views, dose, seed=seed)
                yield from measure(scan, grid, (unit.wall, unit.cpu), most)
    yield "```"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--phantoms", nargs="+", choices=PHANTOMS, default=list(PHANTOMS))
    parser.add_argument("--doses", nargs="+", type=float, default=[2e3, 2e4, 2e5], help="photons a pixel")
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--most", type=int, default=60, help="iterations of a run on the finest level")
    given = parser.parse_args()
    for line in lines(given.phantoms, tuple(given.doses), tuple(given.seeds), given.most):
        print(line, flush=True)


if __name__ == "__main__":
    main()
