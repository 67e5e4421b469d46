"""Every run of the study: which scan, which method, and what is kept of it."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from palpate.reconstruction.potential import NAMES
from palpate.reconstruction.prior import Prior
from palpate.studies.tomosynthesis.judge import Judge
from palpate.studies.tomosynthesis.traces import Problem, Watched, watch
from palpate.volumes.volume import Volume

Record = dict[str, Any]  # of one run, as it is kept in JSON
# (Φ − Φ*) / Φ* of the negative log-posterior Φ, Φ* the least that any run found: where times are compared.
GAPS, FAR = (1e-2, 3e-3), 3e-2
SAMPLING_DOSE, MOTION_DOSE, BETA_DOSE = 2_000, 20_000, 20_000
BASELINES = ("backprojection", "fbp", "sart", "sirt", "ml", "tv")
LIMITS = {"sart": 20, "sirt": 40, "ml": 40, "tv": 20}  # iterations: past the best of each
SHARES = (0.3, 1.0, 3.0, 10.0, 30.0)  # times the strength that the data choose
STARTS = ("uniform", "backprojection")


@dataclass(frozen=True)
class Cell:
    """One run. name: of its file. about: what it is. options: of `iterates`. keep: its volume is shown."""

    name: str
    about: Mapping[str, Any]
    options: Mapping[str, Any]
    keep: bool = False


def cells(judge: Judge) -> Iterator[Cell]:
    """All runs: references before what they are compared with, and every experiment once before any again."""
    s = judge.setting
    for seed in range(s.seeds):
        for dose in s.doses:
            yield from _convergence(dose, seed)
            if dose == SAMPLING_DOSE:
                yield from _sampling(dose, seed)
            if seed < s.few:
                yield from _priors(dose, seed)
                yield from _strengths(dose, seed)
                yield from _baselines(dose, seed)
        if seed < s.few:
            for dose in s.curve:
                yield from _doses(dose, seed)
            yield from _motions(seed)


def _motions(seed: int) -> Iterator[Cell]:
    for motion in ("circular", "linear"):
        for method in ("backprojection", "fbp", "map"):
            about = {"experiment": "motions", "dose": MOTION_DOSE, "seed": seed, "motion": motion, "method": method}
            yield _cell(about, {"method": method}, keep=seed == 0)


def _convergence(dose: int, seed: int) -> Iterator[Cell]:
    runs = [("auto", 3, "backprojection"), ("momentum", 3, "backprojection"), ("momentum", 3, "uniform")]
    runs += [("momentum", 1, start) for start in STARTS]
    runs += [("descent", levels, start) for levels in (1, 2, 3) for start in STARTS]
    for optimiser, levels, start in runs:
        about = {"experiment": "convergence", "dose": dose, "seed": seed, "method": _label(levels)}
        about |= {"optimiser": optimiser, "start": start}
        options = {"levels": levels, "optimiser": optimiser, "start": start, "iterations": 150}
        yield _cell(about, options, keep=seed == 0)


def _label(levels: int) -> str:
    return "F-MAP" if levels == 1 else f"M-MAP-{levels}"


def _sampling(dose: int, seed: int) -> Iterator[Cell]:
    choices = [("sum", name) for name in ("linear", "nearest", "median")]
    choices += [(name, "linear") for name in ("linear", "nearest", "median")]
    for downsample, interpolation in choices:
        about = {"experiment": "sampling", "dose": dose, "seed": seed}
        about |= {"downsample": downsample, "interpolation": interpolation}
        options = {"optimiser": "descent", "start": "uniform", "iterations": 150}
        yield _cell(about, options | {"downsample": downsample, "interpolation": interpolation})


def _priors(dose: int, seed: int) -> Iterator[Cell]:
    for name in NAMES:
        about = {"experiment": "priors", "dose": dose, "seed": seed, "prior": name}
        yield _cell(about, {"prior": Prior(name)})


def _strengths(dose: int, seed: int) -> Iterator[Cell]:
    for share in SHARES:
        yield _cell({"experiment": "strengths", "dose": dose, "seed": seed, "share": share}, {})


def _baselines(dose: int, seed: int) -> Iterator[Cell]:
    for method in BASELINES:
        about = {"experiment": "baselines", "dose": dose, "seed": seed, "method": method}
        options = {"method": method, "levels": 1, "tolerance": 0.0, "iterations": LIMITS.get(method, 1)}
        yield _cell(about, options if method in LIMITS else {"method": method}, keep=seed == 0)


def _doses(dose: int, seed: int) -> Iterator[Cell]:
    for strength in ("tuned", "same strength", "same beta"):
        about = {"experiment": "doses", "dose": dose, "seed": seed, "method": "map", "strength": strength}
        yield _cell(about, {"strength": strength})
    for method in ("backprojection", "fbp"):
        yield _cell({"experiment": "doses", "dose": dose, "seed": seed, "method": method}, {"method": method})


def _cell(about: Mapping[str, Any], options: Mapping[str, Any], keep: bool = False) -> Cell:
    about = {"motion": "circular", **about}
    known = ("experiment", "dose", "seed", "motion")
    more = [str(value) for name, value in about.items() if name not in known]
    return Cell(cell_name(*(about[n] for n in known[:3]), *more, motion=about["motion"]), about, options, keep)


def cell_name(experiment: str, dose: int, seed: int, *more: str, motion: str = "circular") -> str:
    """Of the files of a run."""
    return "-".join(str(part).replace(" ", "_").lower() for part in (motion, experiment, dose, seed, *more))


class Laboratory:
    """Makes the runs: each scan once, with its problem, and the converged posterior of each from its first run."""

    def __init__(self, judge: Judge, passed: Callable[[str], np.ndarray]) -> None:
        self.judge, self.setting = judge, judge.setting
        self._problem = lru_cache(maxsize=4)(self._new_problem)
        self._passed = passed
        self.converged: dict[tuple[int, int], float] = {}

    def problem(self, motion: str, dose: int, seed: int) -> Problem:
        """A scan and its posterior."""
        return self._problem(motion, dose, seed)

    def _new_problem(self, motion: str, dose: int, seed: int) -> Problem:
        return Problem.of(self.setting.scan(self._passed(motion), motion, dose, seed), self.judge)

    def run(self, cell: Cell) -> tuple[Record, Volume]:
        """A record without NaN, and the volume at the stopping rule."""
        about = cell.about
        problem = self.problem(about["motion"], about["dose"], about["seed"])
        options, extra = dict(cell.options), {"starts": problem.starts}
        if about["experiment"] == "doses" and about["method"] == "map":
            options = self._weighed(problem, options["strength"])
        if about["experiment"] == "strengths":
            assert problem.prior.strength is not None
            options = {"prior": replace(problem.prior, strength=about["share"] * problem.prior.strength)}
        seen = self._watched(cell, problem, options)
        assert seen.volume is not None
        trace = {name: values for name, values in seen.trace.items() if not np.isnan(values).any()}
        quality = self.judge.quality(seen.volume.values)
        record = {**about, "trace": trace, "stop": seen.stop, "quality": quality, **extra}
        record["spread"] = self.judge.spread(seen.volume.values).tolist()
        if about["experiment"] == "motions":
            record["quality"]["streaks"] = streaks(seen.volume.values - self.judge.truth.values, self.judge)
        return record, seen.volume

    def _watched(self, cell: Cell, problem: Problem, options: dict[str, Any]) -> Watched:
        experiment = cell.about["experiment"]
        if experiment not in ("convergence", "sampling"):
            return watch(problem, options, posterior=False)
        key = cell.about["dose"], cell.about["seed"]
        if cell.name == reference(*key):
            return watch(problem, options, beyond=self.setting.reference)
        gap = GAPS[-1] if experiment == "convergence" else GAPS[0]
        # A little below: the best of all runs, known only in the end, may lie below that of the reference.
        enough = self.converged[key] * (1 + 0.9 * gap)
        # Fixed resolution goes on until it is as far as multi-resolution was at its stop, or for long.
        beyond = self.setting.beyond if cell.about.get("method") == "F-MAP" else self.setting.beyond // 4
        return watch(problem, options, beyond=beyond, enough=enough)

    def learn(self, record: Record) -> None:
        """Takes note of a converged posterior, from a record made now or by an earlier run."""
        if record["experiment"] == "convergence":
            key = record["dose"], record["seed"]
            self.converged[key] = min(self.converged.get(key, np.inf), *record["trace"]["posterior"])

    def _weighed(self, problem: Problem, strength: str) -> dict[str, Any]:
        """Options of M-MAP-3 with the strength that suits each dose, or that of one dose, or the β of that dose."""
        middle = self.problem("circular", BETA_DOSE, 0)
        if strength == "tuned":
            return {}
        assert middle.prior.strength is not None
        same = middle.prior.strength if strength == "same strength" else middle.beta / problem.curvature
        return {"prior": replace(middle.prior, strength=same)}


def reference(dose: int, seed: int) -> str:
    """Name of the run whose end counts as the converged posterior."""
    return next(_convergence(dose, seed)).name


def streaks(error: np.ndarray, judge: Judge) -> float:
    """How directed an error is: mean square of its steps along y over those along x, in the slab; 1 without direction."""
    part = error[judge.slices]
    across, along = np.diff(part, axis=1)[:, :, 1:], np.diff(part, axis=2)[:, 1:]
    inside = judge.slab[judge.slices][:, 1:, 1:]
    return float((across[inside] ** 2).mean() / (along[inside] ** 2).mean())
