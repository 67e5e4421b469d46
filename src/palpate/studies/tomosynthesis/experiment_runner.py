"""Makes the runs of the study, and says what is kept of each."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from palpate.studies.tomosynthesis.convergence_traces import ConvergenceTrace, ReconstructionProblem, trace_convergence
from palpate.studies.tomosynthesis.experiments import BETA_DOSE, Experiment, Record
from palpate.studies.tomosynthesis.ghost_shape import ghost_shape
from palpate.studies.tomosynthesis.image_quality import ImageQuality
from palpate.studies.tomosynthesis.local_trial import local_quality, local_volumes
from palpate.studies.tomosynthesis.ordered_subsets_trial import trace_subsets
from palpate.volumes.volume import Volume

# (Φ − Φ*) / Φ* of the negative log-posterior Φ, Φ* the least that any run found: where times are compared.
GAPS = (1e-2, 3e-3)
Key = tuple[int, int]  # dose and seed


class ExperimentRunner:
    """Makes the runs: each scan once, with its problem, and the converged posterior of each from its first run."""

    def __init__(self, image_quality: ImageQuality, passed: Callable[[str], np.ndarray]) -> None:
        self.image_quality, self.setting = image_quality, image_quality.setting
        self._passed = passed
        self.problem = lru_cache(maxsize=4)(self._problem)
        self.converged: dict[Key, float] = {}  # the least posterior so far
        self.stopped: dict[tuple[int, int, str, str], float] = {}  # the least at the stop of multi-resolution
        self.target: dict[Key, float] = {}  # that of descent after the passes that ordered subsets are given

    def _problem(self, motion: str, dose: int, seed: int) -> ReconstructionProblem:
        """A scan and its posterior."""
        return ReconstructionProblem.of(self.setting.scan(self._passed(motion), motion, dose, seed), self.image_quality)

    def run(self, experiment: Experiment) -> tuple[Record, dict[str, Volume]]:
        """A record without NaN, and by the end of their files' names the volumes at the stopping rule."""
        about = experiment.about
        problem = self.problem(about["motion"], about["dose"], about["seed"])
        if about["experiment"] == "local":
            found = local_volumes(problem)
            return {**about, "quality": local_quality(found, self.image_quality)}, {
                f"-{n}": v for n, v in found.items()
            }
        seen = self._traced(experiment, problem, self._options(experiment, problem))
        trace = {name: values for name, values in seen.trace.items() if not np.isnan(values).any()}
        record: Record = {**about, "trace": trace, "stop": seen.stop}
        if seen.volume is None:
            return record, {}
        quality = self.image_quality.quality(seen.volume.values)
        record |= {"quality": quality, "starts": problem.starts}
        record["spread"] = self.image_quality.spread(seen.volume.values).tolist()
        if about["experiment"] == "motions":
            quality |= ghost_shape(seen.volume.values, self.image_quality)
        return record, {"": seen.volume}

    def _options(self, experiment: Experiment, problem: ReconstructionProblem) -> dict[str, Any]:
        about = experiment.about
        if about["experiment"] == "doses" and about["method"] == "map":
            return self._with_strength(problem, experiment.options["strength"])
        if about["experiment"] == "strengths":
            assert problem.prior.strength is not None
            return {"prior": replace(problem.prior, strength=about["share"] * problem.prior.strength)}
        return dict(experiment.options)

    def _traced(
        self, experiment: Experiment, problem: ReconstructionProblem, options: dict[str, Any]
    ) -> ConvergenceTrace:
        about, s = experiment.about, self.setting
        key = about["dose"], about["seed"]
        if about["experiment"] == "subsets":
            momentum = about["momentum"] != "plain"
            return trace_subsets(problem, about["subsets"], momentum, self.target[key], 2 * s.passes)
        if about["experiment"] not in ("convergence", "sampling"):
            return trace_convergence(problem, options, posterior=False, every=about["experiment"] == "baselines")
        fixed = about.get("method") == "F-MAP"
        every = about["seed"] == 0 or about["experiment"] == "sampling"  # of these all iterates are drawn
        more = about["seed"] < s.few
        if more and key not in self.converged:
            return trace_convergence(problem, options, beyond=s.reference, every=every)
        # Fixed resolution goes on until it is as far as multi-resolution was at its stop, or for long.
        enough = self.stopped.get((*key, about["optimiser"], about["start"]), np.inf) if fixed else np.inf
        if more:
            gap = GAPS[-1] if about["experiment"] == "convergence" else GAPS[0]
            # A little below: the best of all runs, known only in the end, may lie below that of the reference.
            enough = min(enough, self.converged[key] * (1 + 0.9 * gap))
        beyond = s.beyond if fixed else s.beyond // 6 if more else 0
        return trace_convergence(problem, options, beyond=beyond, enough=enough, every=every)

    def take_note(self, record: Record) -> None:
        """Takes note of a run's posterior, from a record made now or by an earlier run."""
        if record["experiment"] != "convergence":
            return
        key, posterior = (record["dose"], record["seed"]), record["trace"]["posterior"]
        self.converged[key] = min(self.converged.get(key, np.inf), *posterior)
        if record["method"] != "F-MAP":
            run = *key, record["optimiser"], record["start"]
            self.stopped[run] = min(self.stopped.get(run, np.inf), posterior[record["stop"]])
        elif (record["optimiser"], record["start"]) == ("descent", "backprojection"):
            self.target[key] = posterior[min(self.setting.passes, len(posterior)) - 1]

    def _with_strength(self, problem: ReconstructionProblem, strength: str) -> dict[str, Any]:
        """Options of M-MAP-3 with the strength that suits each dose, or that of one dose, or the β of that dose."""
        middle = self.problem("circular", BETA_DOSE, 0)
        if strength == "tuned":
            return {}
        assert middle.prior.strength is not None
        same = middle.prior.strength if strength == "same strength" else middle.beta / problem.curvature
        return {"prior": replace(middle.prior, strength=same)}
