"""One reconstruction, watched: what each iterate cost and how good it was."""

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from palpate.arrays import Float32
from palpate.reconstruction.baselines.sirt import backproject, uniform_volume
from palpate.reconstruction.models.likelihood import Transmission
from palpate.reconstruction.models.mrf_prior import Prior
from palpate.reconstruction.optimizers.coordinate_descent import coordinate_descent, data_curvature
from palpate.reconstruction.optimizers.memory_gradient import memory_gradient
from palpate.reconstruction.prior_parameters import choose_prior_parameters, median_curvature
from palpate.reconstruction.projector import Projector
from palpate.reconstruction.reconstruct import iterates
from palpate.scans.scan import Scan
from palpate.studies.tomosynthesis.config import EDGE_PRESERVING
from palpate.studies.tomosynthesis.image_quality import ImageQuality
from palpate.volumes.resample import resample
from palpate.volumes.volume import Volume

# passes: voxels updated so far, on all levels, over those of the finest grid: work that no busy machine lengthens.
COLUMNS = ("level", "iteration", "passes", "objective", "posterior", "nmse", "nmse_region", "cpu", "wall")


@dataclass(frozen=True)
class ReconstructionProblem:
    """A scan, and the posterior on the finest grid that every method which has one descends."""

    scan: Scan
    image_quality: ImageQuality
    A: Projector
    data: Transmission
    prior: Prior
    beta: float
    curvature: float

    @classmethod
    def of(cls, scan: Scan, image_quality: ImageQuality) -> "ReconstructionProblem":
        """With the prior that `tune` chooses from the scan, as in `iterates`."""
        A, data = Projector(scan.views, image_quality.setting.grid), Transmission.of(scan)
        known = data_curvature(A, data)
        prior, middle = choose_prior_parameters(EDGE_PRESERVING, A, data, known), median_curvature(known)
        assert prior.strength is not None
        return cls(scan, image_quality, A, data, prior, prior.strength * middle, middle)

    def posterior(self, values: Float32) -> float:
        """Negative log-posterior on the finest grid."""
        return self.data.value(self.A(values)) + self.beta * self.prior.value(values, self.A.grid)

    @cached_property
    def starts(self) -> dict[str, dict[str, float]]:
        """Posterior and errors of each start on the finest grid."""
        found = {}
        for name, make in (("uniform", uniform_volume), ("backprojection", backproject)):
            values = make(self.A, self.data)
            full, region = self.image_quality.errors(values)
            found[name] = {"posterior": self.posterior(values), "nmse": full, "nmse_region": region}
        return found


@dataclass
class ConvergenceTrace:
    """trace: a list a column, one entry an iterate that was judged. volume, stop: where the stopping rule ended the run."""

    trace: dict[str, list[float]] = field(default_factory=lambda: {name: [] for name in COLUMNS})
    volume: Volume | None = None
    stop: int = -1


def trace_convergence(
    problem: ReconstructionProblem,
    options: Mapping[str, Any],
    *,
    beyond: int = 0,
    enough: float | None = None,
    posterior: bool = True,
    every: bool = True,
) -> ConvergenceTrace:
    """Runs `iterates` to its own stopping rule, and, for the curves, up to `beyond` iterations more on the finest level.

    Only the iterations are timed (processor time of all threads, and wall time), not the judging between them. A coarse
    iterate is judged on the finest grid, where the run's own interpolator takes it. enough: posterior at which to end.
    every: judge every iterate of coarse levels too, not only the last of each, which is all that a comparison needs.
    """
    seen, passes, interpolation = ConvergenceTrace(), 0.0, options.get("interpolation", "linear")
    clock = CpuClock()
    steps = clock.timed(lambda: iterates(problem.scan, problem.A.grid, **options))
    before: Float32 | None = None
    for step in clock.each(steps):
        passes += step.volume.values.size / math.prod(problem.A.grid.shape)
        if not step.finished:
            before = step.volume.values
        seen.volume = step.volume
        if step.level and not (every or step.finished):
            continue
        fine = resample(step.volume, problem.A.grid, interpolation) if step.level else step.volume
        note(seen, problem, fine.values, (step.level, step.iteration, passes, step.objective), clock, posterior)
    seen.stop = len(seen.trace["level"]) - 1
    done = int(seen.trace["iteration"][-1])
    if beyond and not _reached(seen, enough):
        assert seen.volume is not None
        solver = _onward(problem, options["optimizer"], seen.volume.values, before)
        for iteration, (values, objective) in enumerate(clock.each(solver), done + 1):
            passes += 1
            note(seen, problem, values, (0, iteration, passes, objective), clock)
            if iteration >= done + beyond or _reached(seen, enough):
                break
    return seen


def _onward(
    problem: ReconstructionProblem, optimiser: str, values: Float32, before: Float32 | None
) -> Iterator[tuple[Float32, float]]:
    A, data, prior, beta = problem.A, problem.data, problem.prior, problem.beta
    if optimiser == "descent":
        return coordinate_descent(A, data, prior, beta, values)
    same = before is not None and before.shape == values.shape
    return memory_gradient(A, data, prior, beta, values, previous=before if same else None)


def _reached(seen: ConvergenceTrace, enough: float | None) -> bool:
    return enough is not None and seen.trace["posterior"][-1] <= enough


def note(
    seen: ConvergenceTrace,
    problem: ReconstructionProblem,
    values: Float32,
    known: tuple[int, int, float, float],
    clock: "CpuClock",
    posterior: bool = True,
) -> None:
    """One row more, of an iterate on the finest grid. known: its level, iteration, passes and objective."""
    full, region = problem.image_quality.errors(values)
    level, *_, objective = known  # on the finest level that is the posterior itself
    there = float("nan") if not posterior else problem.posterior(values) if level else objective
    for name, value in zip(COLUMNS, (*known, there, full, region, clock.cpu, clock.wall), strict=True):
        seen.trace[name].append(value)


class CpuClock:
    """Processor and wall seconds spent within what is timed."""

    def __init__(self) -> None:
        self.cpu = self.wall = 0.0

    def timed(self, act: Any) -> Any:
        """The result of `act`, whose time is added."""
        cpu, wall = time.process_time(), time.perf_counter()
        try:
            return act()
        finally:
            self.cpu += time.process_time() - cpu
            self.wall += time.perf_counter() - wall

    def each(self, steps: Iterator[Any]) -> Iterator[Any]:
        """The steps, with the time that each takes added."""
        end = object()
        while (step := self.timed(lambda: next(steps, end))) is not end:
            yield step


def columns(trace: Mapping[str, list[float]]) -> dict[str, np.ndarray]:
    """A trace as arrays."""
    return {name: np.asarray(values, np.float64) for name, values in trace.items()}
