"""Draws a psychometric function with the answers that it was fitted to."""

from collections.abc import Sequence

import numpy as np

from palpate.errors import DataError
from palpate.report.plot_axes import INK, finish
from palpate.simulation.forced_choice import Trial
from palpate.simulation.psychometric_fit import PsychometricFit
from palpate.volumes.notebook_figure import Picture

ANSWERS, FITTED, IDEAL = "#7a7a7a", "#0b7285", "#b3541e"
UNITS = {"stiffness": "relative difference of stiffness", "lump": "stiffness of the lump over the organ's, less 1"}


def plot_answers(
    trials: Sequence[Trial], found: PsychometricFit, ideal: PsychometricFit | None = None, title: str = ""
) -> Picture:
    """Draw the share of right answers at each level, the fit, and the threshold with its interval.

    Parameters
    ----------
    trials : sequence of Trial
        The answers; the larger a mark, the more of them at its level.
    found : PsychometricFit
        Of `fit_answers`.
    ideal : PsychometricFit, optional
        Of `ideal_observer`, drawn beside.
    title : str, optional
        Words above the picture.

    Returns
    -------
    Picture
        A Matplotlib figure.

    Raises
    ------
    DataError
        If there are no trials.

    Examples
    --------
    >>> named = [1, 1, 1, 2, 1] * 6
    >>> trials = [pp.Trial(k, "stiffness", 0.1 + 0.1 * (k % 3), 1, one, 9, "screen", (1, 1)) for k, one in enumerate(named)]
    >>> pp.plot_answers(trials, pp.fit_answers(trials)).savefig("answers.svg")
    """
    if not trials:
        raise DataError("trials: none was answered; answer some first")
    levels, group = np.unique([one.level for one in trials], return_inverse=True)
    count = np.bincount(group)
    share = np.bincount(group, weights=[one.right for one in trials]) / count
    lowest = min(levels[0], found.interval[0], *([ideal.function.threshold] if ideal else []))
    x = np.geomspace(lowest / 1.5, max(levels[-1], found.interval[1] if found.bounded else 0) * 1.2, 300)
    figure = Picture(figsize=(7, 4.5), layout="constrained")
    axes = figure.subplots()
    axes.scatter(levels, share, s=14 + 8 * count, color=ANSWERS, alpha=0.7, linewidth=0, label="answers", zorder=3)
    if found.bounded:
        axes.plot(x, found.function.probability(x), color=FITTED, label="fitted")
        axes.axvspan(*found.interval, color=FITTED, alpha=0.15, linewidth=0, label="threshold, 95 %")
        axes.axvline(found.function.threshold, color=FITTED, linewidth=1)
    if ideal is not None:
        axes.plot(x, ideal.function.probability(x), color=IDEAL, linestyle="--", label="ideal observer")
    axes.axhline(0.5, color=INK, linestyle=":", linewidth=1)
    axes.set_xscale("log")
    axes.set_ylim(-0.03, 1.03)
    none = "" if found.bounded else "the answers do not bound the threshold"
    finish(axes, "\n".join(filter(None, (title, none))), UNITS[trials[0].question], "share of right answers")
    axes.legend(frameon=False, fontsize=8, loc="lower right")
    return figure
