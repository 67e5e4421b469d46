"""Every run of the study: which scan, which method, and what is kept of it."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from palpate.reconstruction.models.mrf_prior import Prior
from palpate.reconstruction.models.potential import NAMES
from palpate.studies.tomosynthesis.convergence_traces import ConvergenceTrace, ReconstructionProblem, trace_convergence
from palpate.studies.tomosynthesis.image_quality import ImageQuality
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
class Experiment:
    """One run. name: of its file. about: what it is. options: of `iterates`. keep: its volume is shown."""

    name: str
    about: Mapping[str, Any]
    options: Mapping[str, Any]
    keep: bool = False


def experiments(image_quality: ImageQuality) -> Iterator[Experiment]:
    """All runs: references before what they are compared with, and every experiment once before any again."""
    s = image_quality.setting
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


def _motions(seed: int) -> Iterator[Experiment]:
    for motion in ("circular", "linear"):
        for method in ("backprojection", "fbp", "map"):
            about = {"experiment": "motions", "dose": MOTION_DOSE, "seed": seed, "motion": motion, "method": method}
            yield _experiment(about, {"method": method}, keep=seed == 0)


def _convergence(dose: int, seed: int) -> Iterator[Experiment]:
    runs = [("auto", 3, "backprojection"), ("momentum", 3, "backprojection"), ("momentum", 3, "uniform")]
    runs += [("momentum", 1, start) for start in STARTS]
    runs += [("descent", levels, start) for levels in (1, 2, 3) for start in STARTS]
    for optimiser, levels, start in runs:
        about = {"experiment": "convergence", "dose": dose, "seed": seed, "method": _label(levels)}
        about |= {"optimiser": optimiser, "start": start}
        options = {"levels": levels, "optimizer": optimiser, "start": start, "iterations": 150}
        yield _experiment(about, options, keep=seed == 0)


def _label(levels: int) -> str:
    return "F-MAP" if levels == 1 else f"M-MAP-{levels}"


def _sampling(dose: int, seed: int) -> Iterator[Experiment]:
    choices = [("sum", name) for name in ("linear", "nearest", "median")]
    choices += [(name, "linear") for name in ("linear", "nearest", "median")]
    for downsample, interpolation in choices:
        about = {"experiment": "sampling", "dose": dose, "seed": seed}
        about |= {"downsample": downsample, "interpolation": interpolation}
        options = {"optimizer": "descent", "start": "uniform", "iterations": 150}
        yield _experiment(about, options | {"downsample": downsample, "interpolation": interpolation})


def _priors(dose: int, seed: int) -> Iterator[Experiment]:
    for name in NAMES:
        about = {"experiment": "priors", "dose": dose, "seed": seed, "prior": name}
        yield _experiment(about, {"prior": Prior(name)})


def _strengths(dose: int, seed: int) -> Iterator[Experiment]:
    for share in SHARES:
        yield _experiment({"experiment": "strengths", "dose": dose, "seed": seed, "share": share}, {})


def _baselines(dose: int, seed: int) -> Iterator[Experiment]:
    for method in BASELINES:
        about = {"experiment": "baselines", "dose": dose, "seed": seed, "method": method}
        options = {"method": method, "levels": 1, "tolerance": 0.0, "iterations": LIMITS.get(method, 1)}
        yield _experiment(about, options if method in LIMITS else {"method": method}, keep=seed == 0)


def _doses(dose: int, seed: int) -> Iterator[Experiment]:
    for strength in ("tuned", "same strength", "same beta"):
        about = {"experiment": "doses", "dose": dose, "seed": seed, "method": "map", "strength": strength}
        yield _experiment(about, {"strength": strength})
    for method in ("backprojection", "fbp"):
        yield _experiment({"experiment": "doses", "dose": dose, "seed": seed, "method": method}, {"method": method})


def _experiment(about: Mapping[str, Any], options: Mapping[str, Any], keep: bool = False) -> Experiment:
    about = {"motion": "circular", **about}
    known = ("experiment", "dose", "seed", "motion")
    more = [str(value) for name, value in about.items() if name not in known]
    return Experiment(cell_name(*(about[n] for n in known[:3]), *more, motion=about["motion"]), about, options, keep)


def cell_name(experiment: str, dose: int, seed: int, *more: str, motion: str = "circular") -> str:
    """Of the files of a run."""
    return "-".join(str(part).replace(" ", "_").lower() for part in (motion, experiment, dose, seed, *more))


class ExperimentRunner:
    """Makes the runs: each scan once, with its problem, and the converged posterior of each from its first run."""

    def __init__(self, image_quality: ImageQuality, passed: Callable[[str], np.ndarray]) -> None:
        self.image_quality, self.setting = image_quality, image_quality.setting
        self._passed = passed
        self.problem = lru_cache(maxsize=4)(self._problem)
        self.converged: dict[tuple[int, int], float] = {}

    def _problem(self, motion: str, dose: int, seed: int) -> ReconstructionProblem:
        """A scan and its posterior."""
        return ReconstructionProblem.of(self.setting.scan(self._passed(motion), motion, dose, seed), self.image_quality)

    def run(self, experiment: Experiment) -> tuple[Record, Volume]:
        """A record without NaN, and the volume at the stopping rule."""
        about = experiment.about
        problem = self.problem(about["motion"], about["dose"], about["seed"])
        options = dict(experiment.options)
        if about["experiment"] == "doses" and about["method"] == "map":
            options = self._with_strength(problem, options["strength"])
        if about["experiment"] == "strengths":
            assert problem.prior.strength is not None
            options = {"prior": replace(problem.prior, strength=about["share"] * problem.prior.strength)}
        seen = self._traced(experiment, problem, options)
        assert seen.volume is not None
        trace = {name: values for name, values in seen.trace.items() if not np.isnan(values).any()}
        quality = self.image_quality.quality(seen.volume.values)
        record = {**about, "trace": trace, "stop": seen.stop, "quality": quality, "starts": problem.starts}
        record["spread"] = self.image_quality.spread(seen.volume.values).tolist()
        if about["experiment"] == "motions":
            error = seen.volume.values - self.image_quality.truth.values
            quality["streaks"] = streak_energy(error, self.image_quality)
        return record, seen.volume

    def _traced(
        self, experiment: Experiment, problem: ReconstructionProblem, options: dict[str, Any]
    ) -> ConvergenceTrace:
        kind = experiment.about["experiment"]
        if kind not in ("convergence", "sampling"):
            return trace_convergence(problem, options, posterior=False)
        key = experiment.about["dose"], experiment.about["seed"]
        if experiment.name == reference(*key):
            return trace_convergence(problem, options, beyond=self.setting.reference)
        gap = GAPS[-1] if kind == "convergence" else GAPS[0]
        # A little below: the best of all runs, known only in the end, may lie below that of the reference.
        enough = self.converged[key] * (1 + 0.9 * gap)
        # Fixed resolution goes on until it is as far as multi-resolution was at its stop, or for long.
        beyond = self.setting.beyond if experiment.about.get("method") == "F-MAP" else self.setting.beyond // 4
        return trace_convergence(problem, options, beyond=beyond, enough=enough)

    def store_posterior(self, record: Record) -> None:
        """Takes note of a converged posterior, from a record made now or by an earlier run."""
        if record["experiment"] == "convergence":
            key = record["dose"], record["seed"]
            self.converged[key] = min(self.converged.get(key, np.inf), *record["trace"]["posterior"])

    def _with_strength(self, problem: ReconstructionProblem, strength: str) -> dict[str, Any]:
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


def streak_energy(error: np.ndarray, image_quality: ImageQuality) -> float:
    """How directed an error is: mean square of its steps along y over those along x, in the slab; 1 without direction."""
    part = error[image_quality.slices]
    across, along = np.diff(part, axis=1)[:, :, 1:], np.diff(part, axis=2)[:, 1:]
    inside = image_quality.slab[image_quality.slices][:, 1:, 1:]
    return float((across[inside] ** 2).mean() / (along[inside] ** 2).mean())
