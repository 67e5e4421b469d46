"""Bayesian adaptive procedure: the next level is the one whose answer tells most about the threshold."""

import numpy as np

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
    yes_or_no,
)

SHAPE = (61, 9, 3)  # cells of threshold, slope and lapse


class Quest:
    """QUEST+: asks at the level at which the answer tells most about the threshold.

    The posterior of threshold, slope and lapse is kept on a grid. `next_level` is the level with the least expected entropy
    of the threshold's posterior, whatever slope and lapse are. Nothing is drawn at random: the same answers give the same
    levels. `fit_psychometric(quest.asked, quest.right)` gives the same posterior on a finer grid, and the goodness of fit.

    Parameters
    ----------
    levels : array_like, (n,)
        Levels that can be asked, above 0 and each once.
    threshold : tuple of float, optional
        Range of the prior, which is uniform in the logarithm. The default is that of the levels.
    slope : tuple of float, optional
        Range of the prior, which is uniform in the logarithm.
    lapse : tuple of float, optional
        Range of the prior, which is uniform.
    guess : float, optional
        Chance of a right answer at level zero: 0.5 for two alternatives.

    Raises
    ------
    DataError
        If there are fewer than two levels, one is not above 0, or a range is empty.

    References
    ----------
    Watson & Pelli, Percept. Psychophys. 33 (1983) 113; Watson, J. Vis. 17 (2017) 10; Prins, J. Vis. 13 (2013) 3: slope and
    lapse as nuisance parameters.

    Examples
    --------
    >>> quest = pp.Quest(np.geomspace(0.02, 2, 40))
    >>> observer, rng = pp.PsychometricFunction(0.2, 1.5, 0.02), np.random.default_rng(1)
    >>> for _ in range(60):
    ...     level = quest.next_level()
    ...     quest.answer(level, rng.random() < observer.probability(level))
    >>> quest.interval[0] < 0.2 < quest.interval[1]
    True
    """

    def __init__(
        self,
        levels: ArrayLike,
        *,
        threshold: Range | None = None,
        slope: Range = SLOPES,
        lapse: Range = LAPSES,
        guess: float = GUESS,
    ) -> None:
        self.levels = np.unique(positive_levels(levels))
        if len(self.levels) < 2:
            raise DataError(f"levels: {len(self.levels)} of them; give two or more that differ")
        span = threshold or (float(self.levels[0]), float(self.levels[-1]))
        self.grid = ParameterGrid(prior_ranges(span, slope, lapse, guess), SHAPE, guess)
        self.log_likelihood = np.zeros(len(self.grid.cells[0]))
        self.asked: list[float] = []
        self.right: list[bool] = []
        self._chance = self.grid.probability(self.levels).reshape(len(self.levels), SHAPE[0], -1)

    @property
    def weights(self) -> Float64:
        """Posterior of the cells."""
        return posterior(self.log_likelihood)

    @property
    def function(self) -> PsychometricFunction:
        """Posterior mean of log threshold, log slope and lapse."""
        return self.grid.mean(self.weights)

    @property
    def interval(self) -> Range:
        """Ends of the 95 % credible interval of the threshold."""
        return self.grid.interval(self.weights)

    def next_level(self) -> float:
        """Return the level to ask next.

        Returns
        -------
        float
            One of `levels`; of several that tell as much, the least.
        """
        weights = self.weights.reshape(SHAPE[0], -1)
        threshold = weights.sum(axis=1)
        # The expected entropy after the answer is the entropy now, less the information that the answer and the threshold
        # share: that of the answer, less that of the answer if the threshold were known.
        right = np.einsum("ltn,tn->lt", self._chance, weights) / np.maximum(threshold, 1e-300)
        told = _entropy(right @ threshold) - _entropy(right) @ threshold
        return float(self.levels[int(np.argmax(told > told.max() - 1e-12))])

    def answer(self, level: float, right: bool) -> None:
        """Take an answer.

        Parameters
        ----------
        level : float
            Level that was asked, above 0; it need not be one of `levels`.
        right : bool
            Whether the answer was right.

        Raises
        ------
        DataError
            If the level is not above 0.
        """
        x, y = positive_levels([level]), yes_or_no([right], 1)
        self.log_likelihood = self.log_likelihood + self.grid.log_likelihood(x, y, 1 - y)
        self.asked.append(float(x[0]))
        self.right.append(bool(y[0]))


def _entropy(p: Float64) -> Float64:
    """Of yes or no with this chance of yes, nats."""
    q = np.clip(p, 1e-300, 1 - 1e-16)
    return np.asarray(-q * np.log(q) - (1 - q) * np.log1p(-q))
