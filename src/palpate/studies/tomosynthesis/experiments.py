"""Every run of the study: which scan, and which method. Those behind the chapter's claims are made on more scans."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from palpate.reconstruction.models.mrf_prior import Prior
from palpate.reconstruction.models.potential import NAMES
from palpate.studies.tomosynthesis.config import EDGE_PRESERVING, MOTIONS, VIEWS, Setting

Record = dict[str, Any]  # of one run, as it is kept in JSON
SAMPLING_DOSE, MOTION_DOSE, BETA_DOSE, LOCAL_DOSE = 2_000, 20_000, 20_000, 20_000
BASELINES = ("backprojection", "fbp", "sart", "sirt", "ml", "tv")
LIMITS = {"sart": 20, "sirt": 40, "ml": 40, "tv": 20}  # iterations: past the best of each
SHARES = (0.3, 1.0, 3.0, 10.0, 30.0)  # times the strength that the data choose
STARTS = ("uniform", "backprojection")
SUBSETS = (1, 2, 4, VIEWS)  # 1 is the same algorithm without subsets


@dataclass(frozen=True)
class Experiment:
    """One run. name: of its file. about: what it is. options: of `iterates`. keep: its volume is shown."""

    name: str
    about: Mapping[str, Any]
    options: Mapping[str, Any]
    keep: bool = False


def experiments(setting: Setting) -> Iterator[Experiment]:
    """All runs: references before what they are compared with, and every experiment once before any again."""
    for seed in range(setting.seeds):
        more = seed < setting.few
        for dose in setting.doses:
            yield from _convergence(dose, seed, more)
            yield from _direct(dose, seed)
            yield from _subsets(dose, seed)
            if more:
                yield from _sampling(dose, seed) if dose == SAMPLING_DOSE else ()
                yield from _priors(dose, seed)
                yield from _strengths(dose, seed)
                yield from _baselines(dose, seed)
        yield from _motions(seed)
        if more:
            for dose in setting.curve:
                yield from _doses(dose, seed)
            yield _experiment({"experiment": "local", "dose": LOCAL_DOSE, "seed": seed}, {}, keep=seed == 0)


def _convergence(dose: int, seed: int, more: bool) -> Iterator[Experiment]:
    """Multi-resolution before fixed resolution, which goes on until it is as far.

    more: not only what the chapter's claims rest on.
    """
    runs = [("auto", 3, "backprojection")] if more else []
    runs += [("momentum", level, start) for level in (3, 1) for start in (STARTS[::-1] if more else STARTS[1:])]
    runs += [("descent", level, start) for level in (3, 2, 1) for start in STARTS]
    for optimiser, levels, start in runs:
        about = {"experiment": "convergence", "dose": dose, "seed": seed, "method": _label(levels)}
        about |= {"optimiser": optimiser, "start": start}
        options = {
            "levels": levels,
            "optimizer": optimiser,
            "start": start,
            "iterations": 150,
            "prior": EDGE_PRESERVING,
        }
        yield _experiment(about, options, keep=seed == 0)


def _label(levels: int) -> str:
    return "F-MAP" if levels == 1 else f"M-MAP-{levels}"


def _direct(dose: int, seed: int) -> Iterator[Experiment]:
    about = {"experiment": "direct", "dose": dose, "seed": seed, "method": "backprojection"}
    yield _experiment(about, {"method": "backprojection"}, keep=seed == 0)


def _subsets(dose: int, seed: int) -> Iterator[Experiment]:
    for momentum in ("plain", "with momentum"):
        for subsets in SUBSETS:
            about = {"experiment": "subsets", "dose": dose, "seed": seed, "subsets": subsets, "momentum": momentum}
            yield _experiment(about, {})


def _motions(seed: int) -> Iterator[Experiment]:
    for motion in MOTIONS:
        for method in ("backprojection", "fbp", "map"):
            about = {"experiment": "motions", "dose": MOTION_DOSE, "seed": seed, "motion": motion, "method": method}
            options = {"prior": EDGE_PRESERVING} if method == "map" else {}
            yield _experiment(about, {"method": method, **options}, keep=seed == 0)


def _sampling(dose: int, seed: int) -> Iterator[Experiment]:
    choices = [("sum", name) for name in ("linear", "nearest", "median")]
    choices += [(name, "linear") for name in ("linear", "nearest", "median")]
    for downsample, interpolation in choices:
        about = {"experiment": "sampling", "dose": dose, "seed": seed}
        about |= {"downsample": downsample, "interpolation": interpolation}
        options = {"optimizer": "descent", "start": "uniform", "iterations": 150, "prior": EDGE_PRESERVING}
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
