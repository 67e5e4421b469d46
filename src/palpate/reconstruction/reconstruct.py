"""From a scan to a volume: the levels, the methods, the stopping rule."""

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from palpate.arrays import Float32
from palpate.errors import DataError
from palpate.reconstruction.baselines import backproject, sirt, uniform
from palpate.reconstruction.cover import covering_grid
from palpate.reconstruction.descent import data_curvature, descend
from palpate.reconstruction.filtered import Window, check_window, fbp
from palpate.reconstruction.likelihood import (
    CURVATURES,
    Curvature,
    Gaussian,
    Likelihood,
    Transmission,
    WeightedLeastSquares,
)
from palpate.reconstruction.momentum import accelerate
from palpate.reconstruction.multires import Downsample, default_levels, pyramid
from palpate.reconstruction.prior import Prior
from palpate.reconstruction.projector import Projector
from palpate.reconstruction.sart import check_relaxation, sart
from palpate.reconstruction.step import Step
from palpate.reconstruction.subsets import Pace, default_subsets, ordered_subsets
from palpate.reconstruction.swept import sweep_then_accelerate, sweeps_are_cheap
from palpate.reconstruction.tune import median_curvature, tune
from palpate.reconstruction.tv import tv
from palpate.scans.scan import Scan
from palpate.volumes.grid import Grid
from palpate.volumes.resample import INTERPOLATIONS, Interpolation, resample
from palpate.volumes.volume import Volume

Method = Literal["map", "ml", "tv", "sirt", "sart", "fbp", "backprojection"]
DIRECT = ("backprojection", "fbp")  # done in one step
Optimiser = Literal["auto", "momentum", "descent", "subsets"]
LikelihoodOf = Literal["poisson", "gaussian", "least-squares"] | Callable[[Scan], Likelihood]
LIKELIHOODS: dict[str, Callable[[Scan], Likelihood]] = {
    "poisson": Transmission.of,
    "gaussian": Gaussian.of,
    "least-squares": WeightedLeastSquares.of,
}
TOLERANCE = 1e-3
COARSE = 20.0  # see _Rule


@dataclass(frozen=True)
class _Rule:
    """When a level is finished: after so many iterations, or when one gains less than a share of the objective.

    The share is `tolerance` on the finest level. A coarse level is but a start: once what it still gains is small beside
    what the step to the finer grid costs and brings, its own posterior is not wanted. But what is broad is found nowhere
    so cheaply, and by descent hardly at all on the finest grid. Level 1 ends at 5 times the tolerance. An iteration costs a
    quarter as much a level further down, so it is worth making there for a quarter of the gain: each level down the share
    is a quarter.

    iterations: the most a level, finest first.
    """

    iterations: Sequence[int]
    tolerance: float

    def finished(self, level: int, iteration: int, objective: float, previous: float | None) -> bool:
        share = self.tolerance * (COARSE / 4**level if level else 1.0)
        gained = previous is not None and abs(previous - objective) > share * abs(objective)
        return iteration >= self.iterations[level] or (previous is not None and not gained)


def iterates(
    scan: Scan,
    grid: Grid,
    *,
    levels: int | None = None,
    method: Method = "map",
    prior: Prior | None = None,
    likelihood: LikelihoodOf = "poisson",
    start: Literal["backprojection", "uniform"] | Volume = "backprojection",
    curvature: Curvature = "precomputed",
    optimiser: Optimiser | Sequence[Optimiser] = "auto",
    iterations: int | Sequence[int] = 50,
    tolerance: float = TOLERANCE,
    downsample: Downsample = "sum",
    interpolation: Interpolation = "linear",
    window: Window = "hann",
    cutoff: float = 1.0,
    relaxation: float = 1.0,
    resume: Step | None = None,
) -> Iterator[Step]:
    """Every iterate of a reconstruction, coarsest level first (M-MAP-L; `levels=1` is F-MAP).

    levels: None takes as many as the grid asks for, 3 or more (`default_levels`). method: "map" minimises
    -log likelihood + β R, "ml" without prior (β = 0); "tv", "sirt", "sart", "fbp" and "backprojection" are baselines on the
    finest level. prior: `Prior()` if None; what it leaves open the data choose; "tv" takes from it the strength alone (see
    `tv` for its meaning there).
    likelihood: "poisson" for counts, "gaussian" for counts with a variance that follows the mean (`Gaussian`),
    "least-squares" for intensities that are none, or a function from a scan to a likelihood. start: on the coarsest level.
    curvature: see `Transmission.curvature`. optimiser: of "map" and "ml", one or one a level, finest first: "momentum"
    (`accelerate`), "descent" (`descend`), "subsets" (`ordered_subsets`), or "auto", which is momentum, with several
    levels after three sweeps of descent where the panel is parallel to the slices (`sweep_then_accelerate`).
    iterations: at most so many on the finest level and twice as many a level down, or a number a level, finest first.
    tolerance: a level ends when an iteration lowers the objective by less than this share; level 1 at 5 times it, and a
    level down at a quarter of that. downsample, interpolation: see `pyramid`, `resample`. window, cutoff: of `fbp`.
    relaxation: of `sart`. resume: the step after which to go on, exactly as if never stopped. Raises `DataError` and
    `GeometryError` at once, before any work.
    """
    levels = default_levels(scan, grid) if levels is None else levels
    most = _per_level(iterations, levels)
    _choices(method, curvature, interpolation, start, likelihood, tolerance)
    optimisers = _optimisers(optimiser, levels)
    check_window(window, cutoff)
    check_relaxation(relaxation)
    chosen = LIKELIHOODS[likelihood] if isinstance(likelihood, str) else likelihood
    scans = pyramid(scan, grid, levels if method in ("map", "ml") else 1, downsample)
    A = Projector(scan.views, grid)  # a geometry that cannot be is refused here
    if levels == 1 or not sweeps_are_cheap(A):  # "auto" begins with sweeps: see `sweep_then_accelerate`
        optimisers = ["momentum" if name == "auto" else name for name in optimisers]
    rule = _Rule(most, tolerance)
    prior = prior if prior is not None else Prior()
    knobs = (window, cutoff, relaxation)
    steps = _run(scans, A, method, prior, chosen, start, curvature, optimisers, rule, interpolation, resume, knobs)
    return steps


def reconstruct(
    scan: Scan,
    grid: Grid | None = None,
    *,
    thickness: float | None = None,
    spacing: float | None = None,
    **options: object,
) -> Volume:
    """The attenuation (z, y, x), 1/mm, behind a scan: the last of `iterates`, whose options it takes.

    grid: None covers the field that the views share, over `thickness` mm of depth, with voxels of `spacing` mm in the slice
    (see `covering_grid`). Raises `DataError` and `GeometryError`.
    """
    grid = covering_grid(scan.views, thickness, spacing) if grid is None else grid
    last = deque(iterates(scan, grid, **options), maxlen=1)  # type: ignore[arg-type]
    return last[0].volume


def _run(
    scans: Sequence[tuple[Scan, Grid]],
    A: Projector,
    method: Method,
    prior: Prior,
    likelihood: Callable[[Scan], Likelihood],
    start: str | Volume,
    curvature: Curvature,
    optimisers: Sequence[Optimiser],
    rule: _Rule,
    interpolation: Interpolation,
    resume: Step | None,
    knobs: tuple[Window, float, float],
) -> Iterator[Step]:
    began = time.perf_counter() - (resume.seconds if resume else 0)
    A, data = finest = A, likelihood(scans[0][0])
    prior = Prior("quadratic", 0.0) if method == "ml" else prior
    prior, beta = _weighed(prior, A, data) if method == "map" else (prior, 0.0)
    last = resume
    for level in reversed(range(len(scans))):
        if last is not None and (last.level < level or (last.level == level and last.finished)):
            continue
        level_scan, grid = scans[level]
        A, data = (Projector(level_scan.views, grid), likelihood(level_scan)) if level else finest
        # Twice the strength a level: a jump between two regions then weighs about the same on every grid. A level has a
        # quarter of the pairs across it, each of twice the weight in mm (half and once where slices stay as thick).
        weight = beta * 2**level
        if last is not None and last.level == level:
            values, done, objective, before = last.volume.values, last.iteration, last.objective, last.previous
        else:
            values = (
                resample(last.volume, grid, interpolation).values if last else _first(start, A, data, interpolation)
            )
            done, objective, before = 0, None, None
        remembers = method in ("map", "ml") and optimisers[level] != "descent"
        pace = None
        if remembers and optimisers[level] == "subsets":
            pace = Pace.of(before, last.pace) if last and before is not None else Pace(default_subsets(len(A.views)))
            part = _parts(level_scan, likelihood)
            solver = ordered_subsets(A, data, prior, weight, values, part, pace, curvature)
        elif remembers and optimisers[level] == "auto":
            solver = sweep_then_accelerate(A, data, prior, weight, values, curvature, done, before)
        elif remembers:
            solver = accelerate(A, data, prior, weight, values, curvature, before)
        else:
            solver = _solver(method, A, data, prior, weight, values, curvature, knobs)
        for iteration, (f, now) in enumerate(solver, done + 1):
            finished = method in DIRECT or rule.finished(level, iteration, now, objective)
            # Never written to again by the solver: no copy, for a volume can be gigabytes.
            handed = method in ("map", "ml") and pace is None
            if handed and not finished:
                f.flags.writeable = False
            volume = Volume(f if handed else f.copy(), grid)
            previous, told = (values, ()) if pace is None else pace.state()
            if finished or not remembers:
                previous, told = None, ()
            last = Step(volume, now, level, iteration, time.perf_counter() - began, finished, previous, told)
            objective, values = now, volume.values
            yield last
            if finished:
                break


def _parts(scan: Scan, likelihood: Callable[[Scan], Likelihood]) -> Callable[[list[int]], Likelihood]:
    """The likelihood of some of the views."""
    return lambda views: likelihood(scan[views])


def _weighed(prior: Prior, A: Projector, data: Likelihood) -> tuple[Prior, float]:
    """The prior with nothing left open, and β, frozen on the finest grid."""
    known = data_curvature(A, data)
    prior = tune(prior, A, data, known)
    assert prior.strength is not None
    return prior, prior.strength * median_curvature(known)


def _solver(
    method: Method,
    A: Projector,
    data: Likelihood,
    prior: Prior,
    beta: float,
    values: Float32,
    curvature: Curvature,
    knobs: tuple[Window, float, float],
) -> Iterator[tuple[Float32, float]]:
    window, cutoff, relaxation = knobs
    if method in DIRECT:
        values = backproject(A, data) if method == "backprojection" else fbp(A, data, window, cutoff)
        return iter([(values, data.value(A(values)))])
    if method == "sirt":
        return sirt(A, data, values)
    if method == "sart":
        return sart(A, data, values, relaxation)
    if method == "tv":
        return tv(A, data, values, prior.strength)
    return descend(A, data, prior, beta, values, curvature)


def _first(start: str | Volume, A: Projector, data: Likelihood, interpolation: Interpolation) -> Float32:
    if isinstance(start, Volume):
        return np.maximum(resample(start, A.grid, interpolation).values, 0)
    return uniform(A, data) if start == "uniform" else backproject(A, data)


def _per_level(iterations: int | Sequence[int], levels: int) -> Sequence[int]:
    each = [iterations * 2**k for k in range(levels)] if isinstance(iterations, int) else list(iterations)
    if len(each) != levels or any(n < 1 for n in each):
        raise DataError(f"iterations: expected a number of at least 1, or {levels} (finest first), got {iterations!r}")
    return each


def _optimisers(optimiser: Optimiser | Sequence[Optimiser], levels: int) -> Sequence[Optimiser]:
    each = [optimiser] * levels if isinstance(optimiser, str) else list(optimiser)
    for name in each:
        if name not in get_args(Optimiser):
            raise DataError(f"optimiser: there is no {name!r}; choose from {', '.join(get_args(Optimiser))}")
    if len(each) != levels:
        raise DataError(f"optimiser: expected one, or {levels} (finest first), got {optimiser!r}")
    return each


def _choices(
    method: str, curvature: str, interpolation: str, start: object, likelihood: object, tolerance: float
) -> None:
    """Refuses names that there are not, with those that there are."""
    for name, value, there in (
        ("method", method, get_args(Method)),
        ("curvature", curvature, CURVATURES),
        ("interpolation", interpolation, INTERPOLATIONS),
        ("start", start, ("backprojection", "uniform")),
        ("likelihood", likelihood, tuple(LIKELIHOODS)),
    ):
        if value not in there and not (isinstance(value, Volume) or callable(value)):
            raise DataError(f"{name}: there is no {value!r}; choose from {', '.join(there)}")
    if not 0 <= tolerance < 1:
        raise DataError(f"tolerance: expected a share of the objective from 0 to below 1, got {tolerance!r}")
