"""The threshold that a person's answers tell, and that of an observer who knows all that the chain shows."""

from collections.abc import Sequence

import numpy as np

from palpate.arrays import ArrayLike, Float64, float64
from palpate.errors import DataError
from palpate.simulation.forced_choice import ForcedChoice, Trial
from palpate.simulation.interval_tissue import stimulus
from palpate.simulation.lesson import EXAM_FORCE, EXAM_LENGTH
from palpate.simulation.psychometric_fit import BEYOND, PsychometricFit, fit_psychometric
from palpate.simulation.session_settings import default_radius
from palpate.tissue.models.compliance import ComplianceModel
from palpate.tissue.spring_fitting import scattered_points, surface_normals
from palpate.tissue.tissue import Tissue

PLACES = 30  # where the observer looks for the largest force
SOLVED = 7  # levels of a lump at which the organ is solved; those between are interpolated
BELOW = 20.0  # times less than the least level: where the observer is asked too
GRID = 25  # levels


def fit_answers(trials: Sequence[Trial], experiment: ForcedChoice | None = None) -> PsychometricFit:
    """Fit a psychometric function to the answers of one experiment.

    Parameters
    ----------
    trials : sequence of Trial
        Answered trials, of one question and one channel.
    experiment : ForcedChoice, optional
        What was asked. The prior of the threshold then reaches from a third of its least level to three times its greatest;
        otherwise, as far about the levels of the trials.

    Returns
    -------
    PsychometricFit
        The threshold and its interval.

    Raises
    ------
    DataError
        If there are none, or they are of several questions or channels: their thresholds differ, so each is fitted alone.

    Examples
    --------
    >>> named = [1, 1, 1, 2, 1] * 6
    >>> trials = [pp.Trial(k, "stiffness", 0.1 + 0.1 * (k % 3), 1, one, 9, "screen", (1, 1)) for k, one in enumerate(named)]
    >>> pp.fit_answers(trials).function.threshold > 0
    True
    """
    if not trials:
        raise DataError("trials: none was answered; answer some first")
    for name in ("question", "channel"):
        found = sorted({getattr(one, name) for one in trials})
        if len(found) > 1:
            raise DataError(f"{name}: {' and '.join(found)} together; fit the answers of each alone")
    reach = None if experiment is None else (experiment.levels[0] / BEYOND, experiment.levels[-1] * BEYOND)
    return fit_psychometric([one.level for one in trials], [one.right for one in trials], threshold=reach)


def threshold_text(found: PsychometricFit) -> str:
    """What was found; no number where the answers do not bound it."""
    if found.bounded:
        return found.text
    return "no threshold: the answers do not bound it; ask more, at levels below and above"


def ideal_observer(
    experiment: ForcedChoice,
    organ: Tissue,
    *,
    point: ArrayLike | None = None,
    depth: float = 2.0,
    force_step: float = EXAM_FORCE,
    length_step: float = EXAM_LENGTH,
    weber: float = 0.0,
    answers: int = 400,
    seed: int = 0,
) -> PsychometricFit:
    """Measure the threshold of an observer that is limited by what the chain shows: a mark beside a person's threshold.

    It presses both intervals at one place to one depth, which it knows to a step of length, reads the forces in steps, and
    names the interval of the larger one; if both are the same, it guesses. Deeper, its threshold is less: the force rises
    with the depth, and its step does not.

    Parameters
    ----------
    experiment : ForcedChoice
        What is asked.
    organ : Tissue
        The organ.
    point : array_like, (3,), optional
        Where it presses, mm. The default is above the lump, or where the force is largest of some places.
    depth : float, optional
        How deep, mm.
    force_step : float, optional
        Step in which forces are told, N. 0: exactly.
    length_step : float, optional
        Step to which the depth is known, mm. The depth is uniform within it, drawn for each interval.
    weber : float, optional
        Standard deviation of a force that is felt, as a share of it.
    answers : int, optional
        Simulated answers at each level.
    seed : int, optional
        Of the simulated answers.

    Returns
    -------
    PsychometricFit
        Its threshold, with the interval that the simulation leaves.

    Raises
    ------
    DataError
        If a number is out of its range, or the organ cannot be used.

    References
    ----------
    W. S. Geisler, Psychol. Rev. 96 (1989) 267: ideal observers limited by the stages before them.

    Examples
    --------
    >>> plain = pp.Tissue(tissue.mesh, 5, poisson=0.4, fixed=tissue.fixed)
    >>> fine, coarse = (pp.ideal_observer(pp.ForcedChoice(), plain, force_step=step) for step in (0.01, 0.1))
    >>> fine.function.threshold < coarse.function.threshold
    True
    """
    for name, value in (("force_step", force_step), ("length_step", length_step), ("weber", weber)):
        if not (np.isfinite(value) and value >= 0):
            raise DataError(f"{name}: {value}; give 0 or more")
    if not (np.isfinite(depth) and depth > length_step / 2) or answers < 1:
        raise DataError(f"depth, answers: {depth} mm, {answers}; press by more than a step of length, and answer once")
    levels = np.geomspace(experiment.levels[0] / BELOW, experiment.levels[-1], GRID)
    less, more = _forces(experiment, organ, point, depth, levels)
    rng = np.random.default_rng(seed)

    def read(force: Float64) -> Float64:
        at = 1 + length_step / depth * (rng.random((GRID, answers)) - 0.5)
        felt = force[:, None] * at * (1 + weber * rng.standard_normal(at.shape))
        return np.asarray(force_step * np.rint(felt / force_step) if force_step else felt)

    difference = read(more) - read(np.full(GRID, less))
    right = (difference > 0) | ((difference == 0) & (rng.random(difference.shape) < 0.5))
    return fit_psychometric(np.repeat(levels, answers), right.ravel(), draws=0)


def _forces(
    experiment: ForcedChoice, organ: Tissue, point: ArrayLike | None, depth: float, levels: Float64
) -> tuple[float, Float64]:
    """N, of a press of the organ as it is, and of the stiffer one at each level (n,)."""
    what = stimulus(experiment, organ)
    base = ComplianceModel(what.tissue(organ, 0.0))
    place = what.place if point is None else float64("point", point, (3,))
    if place is None:
        places = scattered_points(organ, PLACES)
        place = places[int(np.argmax([_force(base, one, depth) for one in places]))]
    less = _force(base, place, depth)
    if experiment.question == "stiffness":  # the force of a linear elastic body is proportional to E
        return less, less * (1 + levels)
    solved = np.geomspace(experiment.levels[0], levels[-1], SOLVED)
    forces = [_force(ComplianceModel(what.tissue(organ, level)), place, depth) for level in solved]
    return less, np.interp(levels, [0, *solved], [less, *forces])


def _force(model: ComplianceModel, place: Float64, depth: float) -> float:
    """N, of a press along the normal with the contact of a session."""
    tissue = model.tissue
    inward = -depth * surface_normals(tissue, place[None])[0]
    return float(np.linalg.norm(model.push(place, inward, default_radius(tissue)).force))
