"""Fits a psychometric function to answers."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.special import xlogy

from palpate.arrays import ArrayLike, Float64
from palpate.errors import DataError
from palpate.simulation.psychometrics import (
    GUESS,
    LAPSES,
    SLOPES,
    ParameterGrid,
    PsychometricFunction,
    Range,
    positive_levels,
    posterior,
    prior_ranges,
    weibull,
    weibull_gradient,
    yes_or_no,
)

SHAPE = (41, 17, 6)  # cells of threshold, slope and lapse
BEYOND = 3.0  # times the levels that were asked: the range of the threshold
NARROW = 1e-4  # share of a marginal's top below which its cells are dropped
ROUNDS = 5  # of narrowing: enough for a million answers


@dataclass(frozen=True, eq=False)
class PsychometricFit:
    """What `fit_psychometric` found.

    Parameters
    ----------
    function : PsychometricFunction
        Posterior mean of log threshold, log slope and lapse.
    interval : tuple of float
        Ends of the 95 % credible interval of the threshold.
    slope_interval : tuple of float
        Ends of the 95 % credible interval of the slope.
    bounded : bool
        Whether the answers bound the threshold on both sides. If not, the interval ends where the prior does: ask more, at
        levels below and above.
    likeliest : PsychometricFunction
        The parameters of the largest likelihood within the prior's range.
    deviance : float
        Twice the log likelihood that is lacking from `likeliest` to one probability for each level.
    p : float
        Chance of a deviance as large if `likeliest` were true: of simulated answers at the same levels, each fitted again.
        A small one says that the function does not fit. NaN if none were simulated.

    Examples
    --------
    >>> found = pp.fit_psychometric([0.1] * 20 + [0.3] * 20, [1] * 12 + [0] * 8 + [1] * 19 + [0])
    >>> found.interval[0] < found.function.threshold < found.interval[1]
    True
    """

    function: PsychometricFunction
    interval: Range
    slope_interval: Range
    bounded: bool
    likeliest: PsychometricFunction
    deviance: float
    p: float

    @property
    def text(self) -> str:
        """What was found, in a few sentences."""
        (low, high), f = self.interval, self.function
        lines = [
            f"threshold {f.threshold:.3g} (95 %: {low:.3g} to {high:.3g}), slope {f.slope:.2g}, lapse {f.lapse:.1%}"
        ]
        if not self.bounded:
            lines.append("the answers do not bound the threshold: an end of the interval is the prior's")
        if self.p < 0.05:
            lines.append(f"the function does not fit the answers: deviance {self.deviance:.3g}, p = {self.p:.2g}")
        return "; ".join(lines)


def fit_psychometric(
    levels: ArrayLike,
    right: ArrayLike,
    *,
    threshold: Range | None = None,
    slope: Range = SLOPES,
    lapse: Range = LAPSES,
    guess: float = GUESS,
    draws: int = 400,
    seed: int = 0,
) -> PsychometricFit:
    """Fit a psychometric function to right and wrong answers.

    The prior is uniform in log threshold, log slope and lapse, and the interval of the threshold that of its posterior,
    whatever slope and lapse are. How the levels were chosen does not matter to the interval, so that answers of an adaptive
    procedure can be fitted too. It does to `p`, whose simulated answers do not change the levels.

    Parameters
    ----------
    levels : array_like, (n,)
        Level of each trial, above 0.
    right : array_like, (n,)
        Whether its answer was right.
    threshold : tuple of float, optional
        Range of the prior. The default is from a third of the least level to three times the greatest.
    slope : tuple of float, optional
        Range of the prior.
    lapse : tuple of float, optional
        Range of the prior. Twice the same number holds it there.
    guess : float, optional
        Chance of a right answer at level zero: 0.5 for two alternatives.
    draws : int, optional
        How many experiments to simulate for `p`; 0 for none.
    seed : int, optional
        Of the simulated answers.

    Returns
    -------
    PsychometricFit
        Threshold with its interval, slope, and goodness of fit.

    Raises
    ------
    DataError
        If a level is not above 0, an answer is neither right nor wrong, there is not one for each level, or a range is
        empty.

    References
    ----------
    Wichmann & Hill, Percept. Psychophys. 63 (2001) 1293: lapses, deviance; Kuss, Jäkel & Wichmann, J. Vis. 5 (2005) 478:
    Bayesian inference.

    Examples
    --------
    >>> observer, rng = pp.PsychometricFunction(0.2, 1.5, 0.02), np.random.default_rng(1)
    >>> levels = np.repeat([0.05, 0.1, 0.2, 0.4, 0.8], 40)
    >>> found = pp.fit_psychometric(levels, rng.random(200) < observer.probability(levels))
    >>> found.interval[0] < 0.2 < found.interval[1]
    True
    """
    x = positive_levels(levels)
    y = yes_or_no(right, len(x))
    if draws < 0:
        raise DataError(f"draws: {draws}; give 0 or more")
    ranges = prior_ranges(threshold or (float(x.min()) / BEYOND, float(x.max()) * BEYOND), slope, lapse, guess)
    asked, group = np.unique(x, return_inverse=True)
    count: Float64 = np.bincount(group).astype(np.float64)
    k = np.asarray(np.bincount(group, weights=y), dtype=np.float64)
    whole = ParameterGrid(ranges, SHAPE, guess)
    grid, weights, log_likelihood = _narrowed(whole, asked, k, count - k)
    best = int(log_likelihood.argmax())
    likeliest, most = _likeliest(grid, ranges, best, asked, k, count - k)
    saturated = float(_saturated(k, count))
    p = np.nan
    if draws:
        # The simulated deviances are those of the best cell, so it is the best cell's that they are compared with.
        chance = grid.probability(asked)[:, best]
        drawn = np.random.default_rng(seed).binomial(count.astype(int), chance, size=(draws, len(asked))).astype(float)
        lacking = _saturated(drawn, count) - 2 * grid.log_likelihood(asked, drawn, count - drawn).max(axis=1)
        at_least = np.count_nonzero(lacking >= (saturated - 2 * log_likelihood[best]) * (1 - 1e-9))
        p = (1 + at_least) / (1 + draws)
    return PsychometricFit(
        grid.mean(weights),
        grid.interval(weights),
        grid.interval(weights, 1),
        _inside(grid, weights, whole),
        likeliest,
        max(saturated - 2 * most, 0.0),
        float(p),
    )


def _saturated(k: Float64, n: Float64) -> Float64:
    """Twice the log likelihood of a probability for each level, (...,)."""
    return np.asarray(2 * (xlogy(k, k / n) + xlogy(n - k, 1 - k / n)).sum(axis=-1))


def _narrowed(
    grid: ParameterGrid, levels: Float64, right: Float64, wrong: Float64
) -> tuple[ParameterGrid, Float64, Float64]:
    """As many cells where the posterior is: the grid, its weights and log likelihood."""
    for _ in range(ROUNDS):
        log_likelihood = grid.log_likelihood(levels, right, wrong)
        weights = posterior(log_likelihood)
        kept = [np.flatnonzero((m := grid.marginal(weights, axis)) > NARROW * m.max()) for axis in range(3)]
        if all(k[-1] - k[0] + 3 >= n for k, n in zip(kept, grid.shape, strict=True)):
            break
        ends = [grid.edges(axis) for axis in range(3)]
        # One cell to either side stays: a cell's weight is that of its middle.
        a, b, c = (
            (float(e[max(k[0] - 1, 0)]), float(e[min(k[-1] + 2, n)]))
            for e, k, n in zip(ends, kept, grid.shape, strict=True)
        )
        grid = ParameterGrid((a, b, c), grid.shape, grid.guess)
    else:
        log_likelihood = grid.log_likelihood(levels, right, wrong)
        weights = posterior(log_likelihood)
    return grid, weights, log_likelihood


def _likeliest(
    grid: ParameterGrid,
    ranges: tuple[Range, Range, Range],
    cell: int,
    levels: Float64,
    right: Float64,
    wrong: Float64,
) -> tuple[PsychometricFunction, float]:
    """From the middle of the best cell up to the largest likelihood: the function and its log likelihood."""

    log_level = np.log(levels)

    def minus(x: Float64) -> tuple[float, Float64]:
        a, s, c = float(x[0]), float(np.exp(x[1])), float(x[2])
        p = weibull(log_level, a, s, c, grid.guess)
        by_p = right / p - wrong / (1 - p)
        slopes = weibull_gradient(log_level, a, s, c, grid.guess)
        return -float(right @ np.log(p) + wrong @ np.log1p(-p)), np.array([-float(by_p @ each) for each in slopes])

    threshold, slope, lapse = (values[cell] for values in grid.cells)
    start = np.array([threshold, np.log(slope), lapse])
    found = minimize(minus, start, jac=True, method="L-BFGS-B", bounds=ranges)
    end = found.x if found.fun < minus(start)[0] else start
    return PsychometricFunction(float(np.exp(end[0])), float(np.exp(end[1])), float(end[2]), grid.guess), -minus(end)[0]


def _inside(grid: ParameterGrid, weights: Float64, whole: ParameterGrid) -> bool:
    """Whether the answers and not the prior end the threshold's posterior: it is small where the prior's range ends."""
    m = grid.marginal(weights, 0)
    ends = [m[end] for end in (0, -1) if grid.ranges[0][end] == whole.ranges[0][end]]
    return bool(max(ends, default=0.0) < 0.01 * m.max())
