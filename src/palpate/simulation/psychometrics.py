"""The psychometric function of two-alternative forced choice, and Bayesian inference of its parameters on a grid."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from palpate.arrays import ArrayLike, Float64, float64
from palpate.errors import DataError

GUESS = 0.5  # chance of a right answer by guessing between two
SLOPES = (
    0.5,
    8.0,
)  # d' in proportion to the level is about 1.3, vision about 3.5; a factor of four to either side of 2
LAPSES = (0.0, 0.06)  # Wichmann & Hill, Percept. Psychophys. 63 (2001) 1293
CLOSE = 1e-12  # probabilities stay as far from 0 and 1, so that one answer cannot exclude a parameter for good
OVERFLOW = 700.0  # less than the logarithm of the largest float

Range = tuple[float, float]


@dataclass(frozen=True)
class PsychometricFunction:
    """Probability of a right answer over the level of a stimulus: a Weibull function.

    The level is what makes the question easy: the relative difference of two stiffnesses, the diameter of a lump. It has a
    zero, at which the answer is a guess.

    Parameters
    ----------
    threshold : float
        Level at which 1 − 1/e = 63 % of the way from guess to lapse is gone, in the unit of the level. That is a probability
        of 0.816 without lapses.
    slope : float
        Exponent of the level over the threshold.
    lapse : float, optional
        Chance of a wrong answer to the easiest question beyond that of the guess, below 1 − `guess`.
    guess : float, optional
        Chance of a right answer at level zero.

    Raises
    ------
    DataError
        If threshold or slope is not positive, or a chance is out of its range.

    References
    ----------
    Weibull, J. Appl. Mech. 18 (1951) 293; Wichmann & Hill, Percept. Psychophys. 63 (2001) 1293.

    Examples
    --------
    >>> observer = pp.PsychometricFunction(threshold=0.2, slope=1.5, lapse=0.02)
    >>> observer.probability([0, 0.2, 10]).round(3).tolist()
    [0.5, 0.803, 0.98]
    """

    threshold: float
    slope: float
    lapse: float = 0.0
    guess: float = GUESS

    def __post_init__(self) -> None:
        for name in ("threshold", "slope"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise DataError(f"{name}: {value}; give a finite number above 0")
        if not 0 <= self.guess < 1:
            raise DataError(f"guess: {self.guess}; give a chance from 0 to less than 1, such as 0.5")
        if not 0 <= self.lapse < 1 - self.guess:
            raise DataError(f"lapse: {self.lapse}; give a chance from 0 to less than 1 - guess = {1 - self.guess:g}")

    def probability(self, level: ArrayLike) -> Float64:
        """Return the probability of a right answer.

        Parameters
        ----------
        level : array_like
            Levels, 0 or more.

        Returns
        -------
        ndarray
            Probabilities, of the shape of the levels.

        Raises
        ------
        DataError
            If a level is negative.
        """
        x = float64("level", level)
        if (x < 0).any():
            raise DataError(f"level: {x.min()} is negative; a level is the size of a difference")
        rise = -np.expm1(-((x / self.threshold) ** self.slope))
        return np.reshape(self.guess + (1 - self.guess - self.lapse) * rise, np.shape(level))

    def level(self, probability: float) -> float:
        """Return the level at which the probability of a right answer is this.

        Parameters
        ----------
        probability : float
            Between `guess` and 1 − `lapse`.

        Returns
        -------
        float
            The level.

        Raises
        ------
        DataError
            If the function nowhere has that probability.
        """
        if not self.guess < probability < 1 - self.lapse:
            raise DataError(
                f"probability: {probability}; give one between guess and 1 - lapse, {self.guess:g} and {1 - self.lapse:g}"
            )
        rise = (probability - self.guess) / (1 - self.guess - self.lapse)
        return float(self.threshold * (-np.log1p(-rise)) ** (1 / self.slope))


def weibull(
    log_level: Float64, log_threshold: Float64 | float, slope: Float64 | float, lapse: Float64 | float, guess: float
) -> Float64:
    """Probability of a right answer, kept off 0 and 1. The arrays broadcast."""
    left = np.exp(-np.exp(np.minimum(slope * (log_level - log_threshold), OVERFLOW)))
    return np.asarray(np.clip(guess + (1 - guess - lapse) * (1 - left), CLOSE, 1 - CLOSE))


def weibull_gradient(
    log_level: Float64, log_threshold: float, slope: float, lapse: float, guess: float
) -> tuple[Float64, Float64, Float64]:
    """Derivatives of `weibull` by log threshold, log slope and lapse."""
    way = slope * (log_level - log_threshold)
    rate = np.exp(np.minimum(way, OVERFLOW))
    left = np.exp(-rate)
    steep = (1 - guess - lapse) * left * rate
    return -slope * steep, way * steep, left - 1


@dataclass(frozen=True, eq=False)
class ParameterGrid:
    """Cells of equal prior probability: uniform in log threshold, log slope and lapse.

    ranges: of the three, the first two as logarithms. shape: number of cells of each. Weights are over all cells, (cells,).
    """

    ranges: tuple[Range, Range, Range]
    shape: tuple[int, int, int]
    guess: float = GUESS

    def edges(self, axis: int) -> Float64:
        """Ends of the cells of one parameter, (n + 1,)."""
        return np.linspace(*self.ranges[axis], self.shape[axis] + 1)

    def middles(self, axis: int) -> Float64:
        """Middles of the cells of one parameter, (n,)."""
        ends = self.edges(axis)
        return np.asarray((ends[1:] + ends[:-1]) / 2)

    @cached_property
    def cells(self) -> tuple[Float64, Float64, Float64]:
        """Log threshold, slope and lapse of each cell, (cells,) each."""
        a, b, c = np.meshgrid(*(self.middles(axis) for axis in range(3)), indexing="ij")
        return a.ravel(), np.exp(b).ravel(), c.ravel()

    def probability(self, levels: Float64) -> Float64:
        """Of a right answer: (levels, cells)."""
        return weibull(np.log(levels)[:, None], *self.cells, self.guess)

    def log_likelihood(self, levels: Float64, right: Float64, wrong: Float64) -> Float64:
        """Of so many right and wrong answers at each level, (..., levels): (..., cells)."""
        p = self.probability(levels)
        return np.asarray(right @ np.log(p) + wrong @ np.log1p(-p))

    def marginal(self, weights: Float64, axis: int) -> Float64:
        """Posterior of one parameter, (n,)."""
        others = tuple({0, 1, 2} - {axis})
        return np.asarray(weights.reshape(self.shape).sum(axis=others))

    def mean(self, weights: Float64) -> PsychometricFunction:
        """Posterior mean of log threshold, log slope and lapse."""
        a, b, c = (float(self.marginal(weights, axis) @ self.middles(axis)) for axis in range(3))
        return PsychometricFunction(float(np.exp(a)), float(np.exp(b)), c, self.guess)

    def interval(self, weights: Float64, axis: int = 0, share: float = 0.95) -> Range:
        """Central credible interval of threshold (axis 0) or slope (1). A cell's weight is spread evenly over it."""
        below = np.concatenate([[0.0], np.cumsum(self.marginal(weights, axis))])
        low, high = np.exp(np.interp(np.array([1 - share, 1 + share]) / 2 * below[-1], below, self.edges(axis)))
        return float(low), float(high)


def posterior(log_likelihood: Float64) -> Float64:
    """Weights of the cells."""
    weights = np.exp(log_likelihood - log_likelihood.max())
    return np.asarray(weights / weights.sum())


def prior_ranges(threshold: Range, slope: Range, lapse: Range, guess: float) -> tuple[Range, Range, Range]:
    """The ranges of a `ParameterGrid`, or a `DataError`."""
    for name, ends in (("threshold", threshold), ("slope", slope)):
        if not (len(ends) == 2 and np.isfinite(ends).all() and 0 < ends[0] < ends[1]):
            raise DataError(f"{name}: {tuple(ends)}; give its least and greatest value, above 0 and different")
    if not 0 <= guess < 1:
        raise DataError(f"guess: {guess}; give a chance from 0 to less than 1, such as 0.5")
    if not (len(lapse) == 2 and 0 <= lapse[0] <= lapse[1] < 1 - guess):
        raise DataError(f"lapse: {tuple(lapse)}; give its least and greatest chance, from 0 to below {1 - guess:g}")
    (a, b), (c, d) = np.log(threshold), np.log(slope)
    return (float(a), float(b)), (float(c), float(d)), (float(lapse[0]), float(lapse[1]))


def positive_levels(levels: ArrayLike) -> Float64:
    """Levels of a stimulus as an array (n,), or a `DataError`."""
    x = float64("levels", levels, (None,))
    if len(x) == 0 or x.min() <= 0:
        raise DataError(f"levels: {f'{x.min()} is not above 0' if len(x) else 'none'}; give levels above 0")
    return x


def yes_or_no(right: ArrayLike, count: int) -> Float64:
    """Whether each of so many answers was right, as zeros and ones, or a `DataError`."""
    y = float64("right", right, (None,))
    if len(y) != count:
        raise DataError(f"right: {len(y)} answers to {count} levels; give one for each")
    if not np.isin(y, (0, 1)).all():
        raise DataError(f"right: {y[~np.isin(y, (0, 1))][0]}; give True or False, or 1 or 0")
    return y
