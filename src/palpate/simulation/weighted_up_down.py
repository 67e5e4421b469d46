"""The weighted up-down staircase."""

import numpy as np

from palpate.errors import DataError


class WeightedUpDown:
    """Weighted up-down staircase: the level falls after a right answer and rises by a larger step after a wrong one.

    The steps are in the ratio in which the level stays where a share `target` of the answers is right: three to one for
    75 %. They are factors, so the level stays above 0.

    Parameters
    ----------
    level : float
        Level to begin with, easy, above 0.
    step : float, optional
        Factor by which the level falls after a right answer, above 1.
    target : float, optional
        Share of right answers to be reached, between 0.5 and 1.
    reversals : int, optional
        Number of reversals after which `done`.
    discard : int, optional
        Number of reversals at the beginning that do not count.
    lowest, highest : float, optional
        Ends of the levels. At an end the level stays.

    Raises
    ------
    DataError
        If level, step or target is out of its range, or fewer than two reversals count.

    References
    ----------
    Kaernbach, Percept. Psychophys. 49 (1991) 227.

    Examples
    --------
    >>> staircase = pp.WeightedUpDown(1.0)
    >>> observer, rng = pp.PsychometricFunction(0.2, 1.5), np.random.default_rng(1)
    >>> while not staircase.done:
    ...     level = staircase.next_level()
    ...     staircase.answer(level, rng.random() < observer.probability(level))
    >>> found = pp.fit_psychometric(staircase.asked, staircase.right)
    >>> found.interval[0] < 0.2 < found.interval[1]
    True
    """

    def __init__(
        self,
        level: float,
        *,
        step: float = 1.12,
        target: float = 0.75,
        reversals: int = 16,
        discard: int = 4,
        lowest: float = 0.0,
        highest: float = np.inf,
    ) -> None:
        if not (0 <= lowest < highest and lowest <= level <= highest and 0 < level < np.inf):
            raise DataError(f"level: {level}; give one above 0 and from {lowest:g} to {highest:g}")
        if not 1 < step < np.inf:
            raise DataError(f"step: {step}; give a factor above 1, such as 1.12")
        if not 0.5 < target < 1:
            raise DataError(f"target: {target}; give a share of right answers between 0.5 and 1")
        if not 0 <= discard <= reversals - 2:
            raise DataError(f"reversals: {reversals}, of which {discard} do not count; let two or more count")
        self.down = np.log(step)
        self.up = self.down * target / (1 - target)
        self.target, self.reversals, self.discard = target, reversals, discard
        self.lowest, self.highest = lowest, highest
        self.asked: list[float] = []
        self.right: list[bool] = []
        self._level = float(level)
        self._reversed: list[int] = []  # trials whose answer was right and the last one's wrong, or otherwise round

    @property
    def done(self) -> bool:
        """Whether there were as many reversals as were asked for."""
        return len(self._reversed) >= self.reversals

    @property
    def estimate(self) -> float:
        """Level at which the share `target` is right: geometric mean of the levels at the reversals that count, in pairs.

        NaN before there are two. It has no interval: give the answers to `fit_psychometric`.
        """
        counted = self._reversed[self.discard :]
        counted = counted[len(counted) % 2 :]  # as many upper as lower ones
        if not counted:
            return float("nan")
        return float(np.exp(np.mean([np.log(self.asked[trial]) for trial in counted])))

    def next_level(self) -> float:
        """Return the level to ask next.

        Returns
        -------
        float
            The level.
        """
        return self._level

    def answer(self, level: float, right: bool) -> None:
        """Take an answer, and step up or down from its level.

        Parameters
        ----------
        level : float
            Level that was asked, above 0.
        right : bool
            Whether the answer was right.

        Raises
        ------
        DataError
            If the level is out of its range.
        """
        if not (0 < level < np.inf and self.lowest <= level <= self.highest):
            raise DataError(f"level: {level}; give one above 0 and from {self.lowest:g} to {self.highest:g}")
        if self.right and bool(right) != self.right[-1]:
            self._reversed.append(len(self.asked))
        self.asked.append(float(level))
        self.right.append(bool(right))
        moved = level * np.exp(-self.down if right else self.up)
        self._level = float(np.clip(moved, self.lowest, self.highest))
