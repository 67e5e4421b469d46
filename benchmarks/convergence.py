"""Time to the converged posterior on W1: `python -m benchmarks.convergence` (a part: `--phantoms slab --doses 20000`).

Gap: (Φ − Φ*) / (Φ of the uniform start − Φ*), Φ on the finest grid. Φ* comes from M-MAP with momentum gone on with for ten
times the iterations that it takes to the smallest gap shown. One pass is a projection and a backprojection, timed beside the
runs. F-MAP: the finest level alone from a uniform volume. M-MAP-3: three levels, each by the optimizer named. An iterate
of a coarse level is judged as what it is on the finest grid: interpolated linearly, the time for that added, and Φ worked
out there, which is left out of all times. "on the finest" counts iterates of the finest level alone. β and edge are what
`tune` chooses from each scan, the same for all runs of it. Scans are analytic, with Poisson noise. Cells are medians over
phantoms and seeds, lowest and highest in brackets; "sooner" is the median over scans of how much less CPU time it took than
F-MAP by descent on the same scan ("over": than the time at which that had not arrived yet and was stopped).
"""

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

import palpate as pp
from benchmarks.interleaved_timing import medians
from benchmarks.workloads import circular
from palpate.arrays import Float32
from palpate.reconstruction.baselines.sirt import uniform_volume
from palpate.reconstruction.models.likelihood import Transmission
from palpate.reconstruction.optimizers.coordinate_descent import data_curvature
from palpate.reconstruction.prior_parameters import choose_prior_parameters, median_curvature
from palpate.scans.analytic_phantoms import Ellipsoid, Phantom
from palpate.volumes.resample import resample

GAPS = (1e-2, 1e-3, 1e-4)
FINEST = ", on the finest"
Objective = Callable[[Float32], float]
Arrived = tuple[float, float] | None  # wall and CPU seconds to a gap


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
PLAN = {2e4: (1, 2, 3), 2e3: (1,), 2e5: (1,)}
RUNS = {
    f"{name} {optimizer}": (levels, optimizer)
    for name, levels in (("F-MAP", 1), ("M-MAP-3", 3))
    for optimizer in ("descent", "momentum", "subsets", *["auto"] * (levels > 1))
}


@dataclass(frozen=True)
class Seen:
    """A step of a run, Φ on the finest grid, and the CPU and wall seconds until it was there."""

    level: int
    objective: float
    cpu: float
    wall: float


def timed(run: Callable[[], Iterator[pp.Step]], enough: float, grid: pp.Grid, phi: Objective) -> list[Seen]:
    """Steps of a run, its preparation included, until the finest level's objective is low enough.

    phi: the objective of a volume on the finest grid.
    """
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
        if step.level == 0:
            seen.append(Seen(0, step.objective, cpu, wall))
            continue
        before = time.process_time(), time.perf_counter()
        f = resample(step.volume, grid, "linear").values
        there = cpu + time.process_time() - before[0], wall + time.perf_counter() - before[1]
        seen.append(Seen(step.level, phi(f), *there))
    return seen


def arrivals(seen: list[Seen], enough: list[float]) -> list[Arrived]:
    """When the first came whose objective is low enough, for each."""
    first = [next((s for s in seen if s.objective <= objective), None) for objective in enough]
    return [None if s is None else (s.wall, s.cpu) for s in first]


@dataclass(frozen=True)
class Course:
    """Of one run: when it arrived at each gap, and the CPU seconds at which it ended."""

    arrived: list[Arrived]
    ended: float


def measure(scan: pp.Scan, grid: pp.Grid, most: int) -> dict[str, Course]:
    """All runs of one scan, by name; F-MAP by descent first."""
    A, data = pp.Projector(scan.views, grid), Transmission.of(scan)
    known = data_curvature(A, data)
    prior = choose_prior_parameters(pp.Prior(), A, data, known)
    beta = prior.strength * median_curvature(known)

    def phi(f: Float32) -> float:
        return data.value(A(f)) + beta * prior.value(f, grid)

    top = phi(uniform_volume(A, data))

    def run(levels: int, optimizer: str) -> Callable[[], Iterator[pp.Step]]:
        # Coarse levels stop by their own rule, as a user's would.
        return lambda: pp.iterates(
            scan,
            grid,
            levels=levels,
            prior=prior,
            optimizer=optimizer,
            start="uniform" if levels == 1 else "backprojection",
            iterations=[most, 100, 200][:levels],
            tolerance=1e-5 if levels == 1 else 1e-3,
        )

    star = converged(scan, grid, prior, top)
    enough = [star + gap * (top - star) for gap in GAPS]
    courses = {}
    for name, (levels, optimizer) in RUNS.items():
        seen = timed(run(levels, optimizer), enough[-1], grid, phi)
        courses[name] = Course(arrivals(seen, enough), seen[-1].cpu)
        if levels > 1:
            finest = [s for s in seen if s.level == 0]
            courses[name + FINEST] = Course(arrivals(finest, enough), seen[-1].cpu)
    return courses


def summary(scans: list[dict[str, Course]], unit: float) -> Iterator[str]:
    """One line a run, over all scans. unit: CPU seconds of a pass."""
    for name in scans[0]:
        cells = []
        for k, _ in enumerate(GAPS):
            there = [courses[name].arrived[k] for courses in scans]
            walls, cpus = np.array([a for a in there if a is not None]).reshape(-1, 2).T
            if not len(walls):
                cells.append(f"{'in none':>42}")
                continue
            slow = [courses["F-MAP descent"] for courses in scans]
            ratios = [
                (s.arrived[k][1] if s.arrived[k] else s.ended) / a[1] for s, a in zip(slow, there, strict=True) if a
            ]
            some = "" if len(walls) == len(scans) else f" in {len(walls)} of {len(scans)}"
            over = "over " if any(s.arrived[k] is None for s in slow) else ""
            spread = f"{np.median(walls):.2f} ({walls.min():.2f}-{walls.max():.2f})"
            cells.append(
                f"{spread:>18} {np.median(cpus) / unit:5.0f} {over + f'{np.median(ratios):.1f}x':>10}{some:>7}"
            )
        yield f"  {name:34}" + " |".join(cells)


def converged(scan: pp.Scan, grid: pp.Grid, prior: pp.Prior, top: float) -> float:
    """Φ*, by going on ten times as long as it takes until an iteration gains less than a tenth of the smallest gap.

    Less long where nothing lowers Φ any more, to rounding.
    """
    steps = pp.iterates(scan, grid, prior=prior, optimizer="momentum", iterations=[10**6, 100, 200], tolerance=0.0)
    before, needed = np.inf, 0
    for step in steps:
        if step.level > 0:
            continue
        if not needed and before - step.objective < 0.1 * GAPS[-1] * (top - step.objective):
            needed = step.iteration
        if needed and step.iteration >= 10 * needed:
            return step.objective
        before = step.objective
    assert needed > 0, "the run ended before it had come near"
    return before


def lines(
    phantoms: list[str] | None = None, plan: dict[float, tuple[int, ...]] | None = None, most: int = 60
) -> Iterator[str]:
    """The table. plan: seeds for each number of photons."""
    views, grid = circular()
    A, f = pp.Projector(views, grid), np.full(grid.shape, 0.02, np.float32)
    p = A(f)
    unit = medians({"pass": lambda: A.T(A(f, out=p), out=f)})["pass"]
    yield "```"
    yield f"one pass: {unit.wall:.3f} s wall, {unit.cpu:.3f} s CPU"
    yield f"{'to a gap of':36}" + " |".join(f"{gap:^42.0e}" for gap in GAPS)
    yield f"{'':36}" + " |".join(f"{'wall s':>18} {'passes':>6} {'sooner':>9}{'':>7}" for _ in GAPS)
    for dose, seeds in (plan or PLAN).items():
        names = phantoms or list(PHANTOMS)
        scans = [
            measure(pp.simulate_scan(PHANTOMS[name](), views, dose, seed=seed), grid, most)
            for name in names
            for seed in seeds
        ]
        yield f"{dose:g} photons; {' and '.join(names)}, {len(seeds)} seed{'s' * (len(seeds) > 1)} each"
        yield from summary(scans, unit.cpu)
    yield "```"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--phantoms", nargs="+", choices=PHANTOMS, default=list(PHANTOMS))
    parser.add_argument("--doses", nargs="+", type=float, default=list(PLAN), help="photons a pixel")
    parser.add_argument("--seeds", nargs="+", type=int, help="default: three at 20000 photons, one else")
    parser.add_argument("--most", type=int, default=60, help="iterations of a run on the finest level")
    given = parser.parse_args()
    plan = {dose: tuple(given.seeds or PLAN.get(dose, (1,))) for dose in given.doses}
    for line in lines(given.phantoms, plan, given.most):
        print(line, flush=True)


if __name__ == "__main__":
    main()
