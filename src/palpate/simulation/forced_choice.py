"""A two-interval forced-choice experiment: what is asked, in which order, and what was answered."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.errors import DataError
from palpate.simulation.psychometrics import positive_levels
from palpate.simulation.quest import Quest
from palpate.simulation.weighted_up_down import WeightedUpDown

CHANNELS = ("screen", "sound", "gamepad", "device")  # how the force comes to the person
QUESTIONS = {"stiffness": "Which is stiffer?", "lump": "Which holds the lump?"}
PROCEDURES = ("quest", "staircase")
LEVELS = tuple(np.geomspace(0.02, 2, 31).round(4).tolist())
MOST_TRIALS = 10_000


@dataclass(frozen=True)
class ForcedChoice:
    """An experiment with two intervals in each trial: in one of them there is more, and the person says in which.

    The orders are drawn from the seed, the levels follow from the answers, and nothing else is drawn. So the same answers
    lead to the same next trial.

    Parameters
    ----------
    question : {"stiffness", "lump"}, optional
        Which interval holds the stiffer organ, E (1 + level) against E; or which one holds a lump of E (1 + level).
    procedure : {"quest", "staircase"}, optional
        How levels are chosen: `Quest` or `WeightedUpDown`.
    trials : int, optional
        Number of trials; a staircase may end before.
    levels : sequence of float, optional
        Relative differences of Young's modulus that can be shown. A staircase begins at the greatest and stays between
        the ends.
    seed : int, optional
        Of the orders, and of the lump's place.
    channel : {"screen", "sound", "gamepad", "device"}, optional
        How the force comes to the person.
    feedback : bool, optional
        Whether the person is told after each answer if it was right.
    diameter : float, optional
        Of the lump, mm.
    pause : int, optional
        Trials after which a break is offered. 0: none is.

    Raises
    ------
    DataError
        If a word is not one of those above, or a number is out of its range.

    References
    ----------
    N. A. Macmillan & C. D. Creelman, Detection Theory, 2nd ed. (2005): two-interval forced choice.

    Examples
    --------
    >>> experiment = pp.ForcedChoice("stiffness", trials=40, seed=3)
    >>> sorted(experiment.orders) == [1] * 20 + [2] * 20
    True
    """

    question: str = "stiffness"
    procedure: str = "quest"
    trials: int = 60
    levels: tuple[float, ...] = LEVELS
    seed: int = 0
    channel: str = "screen"
    feedback: bool = False
    diameter: float = 15.0
    pause: int = 20

    def __post_init__(self) -> None:
        for name, words in (("question", tuple(QUESTIONS)), ("procedure", PROCEDURES), ("channel", CHANNELS)):
            if getattr(self, name) not in words:
                raise DataError(f"{name}: {getattr(self, name)!r} is none; choose one of {', '.join(words)}")
        if not 1 <= self.trials <= MOST_TRIALS:
            raise DataError(f"trials: {self.trials}; give 1 to {MOST_TRIALS}")
        if self.seed < 0 or self.pause < 0:
            raise DataError(f"seed, pause: {self.seed}, {self.pause}; give 0 or more of each")
        if not (np.isfinite(self.diameter) and self.diameter > 0):
            raise DataError(f"diameter: {self.diameter} mm; give more than 0")
        levels = np.unique(positive_levels(self.levels))
        if len(levels) < 2:
            raise DataError(f"levels: {len(levels)} of them; give two or more that differ")
        object.__setattr__(self, "levels", tuple(levels.tolist()))

    @property
    def asked(self) -> str:
        """The question in words."""
        return QUESTIONS[self.question]

    @property
    def orders(self) -> tuple[int, ...]:
        """In which interval there is more, 1 or 2, for each trial. Both come as often, in all trials together."""
        half = np.random.default_rng([self.seed, 2]).permutation(self.trials) % 2
        return tuple(int(one) + 1 for one in half)

    def next_level(self, answered: Sequence[tuple[float, bool]]) -> float | None:
        """Return the level of the next trial.

        Parameters
        ----------
        answered : sequence of (float, bool)
            Level of each trial so far, and whether the answer was right.

        Returns
        -------
        float or None
            The level; None if the procedure is done.
        """
        if len(answered) >= self.trials:
            return None
        low, high = self.levels[0], self.levels[-1]
        if self.procedure == "quest":
            quest = Quest(self.levels)
            for level, right in answered:
                quest.answer(level, right)
            return quest.next_level()
        staircase = WeightedUpDown(high, lowest=low, highest=high)
        for level, right in answered:
            staircase.answer(level, right)
        return None if staircase.done else staircase.next_level()


@dataclass(frozen=True)
class Trial:
    """A trial that was answered.

    Parameters
    ----------
    trial : int
        Its number, from 1 on.
    question : str
        What was asked.
    level : float
        Relative difference of Young's modulus.
    order : int
        Interval with more: 1 or 2.
    answer : int
        Interval that the person named.
    seconds : float
        From the beginning of the trial to the answer.
    channel : str
        How the force came to the person.
    force : tuple of float
        Largest force in intervals 1 and 2, N.

    Raises
    ------
    DataError
        If order or answer is not an interval, or a number is out of its range.

    Examples
    --------
    >>> pp.Trial(1, "stiffness", 0.2, order=2, answer=2, seconds=8.5, channel="screen", force=(1.2, 1.4)).right
    True
    """

    trial: int
    question: str
    level: float
    order: int
    answer: int
    seconds: float
    channel: str
    force: tuple[float, float]

    def __post_init__(self) -> None:
        if self.order not in (1, 2) or self.answer not in (1, 2):
            raise DataError(f"trial {self.trial}: order {self.order}, answer {self.answer}; each is interval 1 or 2")
        if self.channel not in CHANNELS or self.question not in QUESTIONS:
            raise DataError(f"trial {self.trial}: question {self.question!r} by {self.channel!r} is none")
        numbers = [self.level, self.seconds, *self.force]
        if len(self.force) != 2 or not np.isfinite(numbers).all() or self.level <= 0:
            raise DataError(f"trial {self.trial}: level, seconds and forces are {numbers}; they must be finite numbers")

    @property
    def right(self) -> bool:
        """Whether the answer names the interval with more."""
        return self.answer == self.order
