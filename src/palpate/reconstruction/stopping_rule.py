"""When a level of a reconstruction ends: after a number of iterations, or when the objective hardly falls."""

from collections.abc import Sequence
from dataclasses import dataclass

COARSE_LEVELS = 20.0  # times the tolerance; level 1 takes a quarter of it, and so on


@dataclass(frozen=True)
class StoppingRule:
    """Ends a level after a number of iterations, or when an iteration lowers the objective by less than a share of it.

    The share is `tolerance` on the finest level and 5 times that on level 1, whose volume is only a start for the finest.
    An iteration costs a quarter as much on the next coarser level, so the share there is a quarter, too. Low spatial
    frequencies converge fast on coarse levels and slowly on fine ones, with coordinate descent above all.

    iterations: limit for each level, finest first.
    """

    iterations: Sequence[int]
    tolerance: float

    def finished(self, level: int, iteration: int, objective: float, previous: float | None) -> bool:
        """Return whether `level` ends after this iteration. previous: the objective one iteration ago, if any."""
        share = self.tolerance * (COARSE_LEVELS / 4**level if level else 1.0)
        gained = previous is not None and abs(previous - objective) > share * abs(objective)
        return iteration >= self.iterations[level] or (previous is not None and not gained)
