"""Ratios over the scans as a mean with its interval, and what that says of a claim."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from palpate.studies.tomosynthesis.tables import ENOUGH

LEVEL = 0.95
SAME = 0.02  # share by which two image errors or amounts of work may differ and count as equal


@dataclass(frozen=True)
class Interval:
    """Geometric mean of ratios, one a scan, and its interval: Student's t of their logarithms.

    Of fewer scans than a deviation is told of, low and high are the least and the most. bound: some of the ratios are
    lower bounds, so that mean and low are, and high says nothing.
    """

    mean: float
    low: float
    high: float
    count: int
    bound: bool = False

    @classmethod
    def of(cls, ratios: Iterable[float], bound: bool = False) -> "Interval":
        """From ratios that all are above 0."""
        logs = np.log(np.array(list(ratios), np.float64))
        mean, n = float(logs.mean()), len(logs)
        if n < ENOUGH:
            low, high = float(logs.min()), float(logs.max())
        else:
            half = float(stats.t.ppf((1 + LEVEL) / 2, n - 1) * logs.std(ddof=1) / np.sqrt(n))
            low, high = mean - half, mean + half
        return cls(float(np.exp(mean)), float(np.exp(low)), float(np.exp(high)), n, bound)

    @property
    def words(self) -> str:
        """As in "1.243 (1.238 to 1.248)"."""
        form = ".3f" if self.mean < 10 else ".1f"
        if self.bound:
            return f"≥ {self.mean:{form}} (from {self.low:{form}})"
        return f"{self.mean:{form}} ({self.low:{form}} to {self.high:{form}})"

    @property
    def says(self) -> str:
        """Of the claim that the ratio is above 1: "holds", "equal", "opposite" or "open"."""
        if self.low > 1 + SAME:
            return "holds"
        if self.bound:
            return "open"
        if self.high < 1 - SAME:
            return "opposite"
        return "equal" if self.low >= 1 - SAME and self.high <= 1 + SAME else "open"


OTHERWISE = {"opposite": "the opposite holds", "equal": f"equal within {SAME:.0%}", "open": "not decided"}


def held(each: Sequence[tuple[str, Interval]], what: str = "dose") -> str:
    """What named intervals say of a claim: where it holds, and what is so elsewhere."""
    said = [(name, one.says) for name, one in each]
    count = sum(word == "holds" for _, word in said)
    if count == len(said):
        return f"holds at every {what}" if len(said) > 1 else "holds"
    plural = f"holds at {count} of {len(said)} {what}s" if count else f"holds at no {what}"
    if len(said) == 1:
        plural = "does not hold"
    rest = [
        f"{words} {'' if len(said) == 1 else 'at ' + ', '.join(name for name, word in said if word == key)}".rstrip()
        for key, words in OTHERWISE.items()
        if any(word == key for _, word in said)
    ]
    return f"{plural} ({'; '.join(rest)})"
