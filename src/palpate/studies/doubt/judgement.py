"""What the records say: how often intervals hold the truth, how wide they are, and how far probabilities can be trusted."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.stats import beta

from palpate.arrays import Bool, Float64
from palpate.report.tables import Row
from palpate.studies.doubt.config import CALIBRATED, COVERAGE, LEVEL, WIDTH
from palpate.studies.doubt.run import Record
from palpate.tissue.interval_correction import IntervalCorrection, sample_interval
from palpate.tissue.lump_uncertainty import WEBER, WEBER_TOLD

JUDGED = "diameter", "depth", "added"
BINS = 5  # of the probabilities in the reliability diagram


@dataclass(frozen=True)
class Claim:
    """What was asked, what was found, and whether it is met."""

    what: str
    value: float
    asked: str
    met: bool


@dataclass(frozen=True, eq=False)
class Judgement:
    """train, judge: records of the breasts that teach and of those that judge."""

    train: Sequence[Record]
    judge: Sequence[Record]

    @cached_property
    def corrections(self) -> dict[str, IntervalCorrection]:
        """Learnt on the breasts that teach alone."""
        return {
            name: IntervalCorrection.learn([r[f"samples|{name}"] for r in self.train], _truths(self.train, name))
            for name in (*JUDGED, "share")
        }

    def intervals(self, name: str, corrected: bool) -> Float64:
        """(breasts, 2) of the breasts that judge."""
        own = self.corrections[name].interval if corrected else sample_interval
        return np.array([own(r[f"samples|{name}"], LEVEL) for r in self.judge])

    def held(self, name: str, corrected: bool) -> Bool:
        """(breasts,) whether the interval holds the truth."""
        low, high = self.intervals(name, corrected).T
        truth = _truths(self.judge, name)
        return np.asarray((low <= truth) & (truth <= high))

    def population(self, name: str) -> tuple[float, float]:
        """The interval of the breasts that teach: what is known of a lump without a scan."""
        tail = (1 - LEVEL) / 2
        low, high = np.quantile(_truths(self.train, name), [tail, 1 - tail], method="weibull")
        return float(low), float(high)

    @cached_property
    def rows(self) -> list[Row]:
        """A row for each quantity."""
        rows: list[Row] = []
        for name in JUDGED:
            row: Row = {"quantity": name}
            for words, corrected in (("raw", False), ("corrected", True)):
                held = self.held(name, corrected)
                low, high = binomial_interval(int(held.sum()), len(held))
                width = float(np.median(np.ptp(self.intervals(name, corrected), axis=1)))
                row |= {
                    f"{words} held": float(held.mean()),
                    f"{words} low": low,
                    f"{words} high": high,
                    f"{words} width": width,
                }
            ends = self.population(name)
            rows.append(row | {"population width": ends[1] - ends[0]})
        return rows

    def probabilities(self, weber: float, corrected: bool) -> Float64:
        """(breasts,) that a hand feels the lump."""
        samples = [r["samples|share"] for r in self.judge]
        if corrected:
            return np.array([self.corrections["share"].probability_above(s, weber) for s in samples])
        return np.array([float(np.mean(s > weber)) for s in samples])

    def felt(self, weber: float) -> Bool:
        """(breasts,) whether the truth is felt."""
        return np.asarray(_truths(self.judge, "share") > weber)

    @cached_property
    def felt_rows(self) -> list[Row]:
        """A row for each Weber fraction: Brier scores, and Spiegelhalter's statistic of the corrected probabilities."""
        rows: list[Row] = []
        for weber in WEBER_TOLD:
            felt = self.felt(weber)
            base = np.full(len(felt), float(np.mean(_truths(self.train, "share") > weber)))
            raw, own = (self.probabilities(weber, corrected) for corrected in (False, True))
            rows.append(
                {
                    "weber": weber,
                    "felt": float(felt.mean()),
                    "base rate": brier_score(base, felt),
                    "raw": brier_score(raw, felt),
                    "corrected": brier_score(own, felt),
                    "z": spiegelhalter(own, felt),
                }
            )
        return rows

    def reliability(self, weber: float, corrected: bool) -> list[Row]:
        """A row for each bin of the probabilities that has breasts: their mean, and the share that is felt."""
        p, felt = self.probabilities(weber, corrected), self.felt(weber)
        index = np.minimum((p * BINS).astype(int), BINS - 1)
        rows: list[Row] = []
        for k in np.unique(index):
            here = index == k
            low, high = binomial_interval(int(felt[here].sum()), int(here.sum()))
            shown = {"told": float(p[here].mean()), "felt": float(felt[here].mean())}
            rows.append({"weber": weber, "breasts": int(here.sum()), **shown, "low": low, "high": high})
        return rows

    @cached_property
    def first_order(self) -> tuple[Float64, Float64]:
        """(breasts,) standard deviation of the contrast by samples and to first order, where both were found, 1/mm."""
        both = [r for r in (*self.train, *self.judge) if "contrast_std" in r]
        samples = np.array([float(r["samples|contrast"].std(ddof=1)) for r in both])
        return samples, np.array([float(r["contrast_std"]) for r in both])

    @cached_property
    def claims(self) -> list[Claim]:
        """Every target."""
        claims = []
        for row in self.rows:
            held, width = float(row["corrected held"]), float(row["corrected width"]) / float(row["population width"])
            asked = f"{COVERAGE[0]:.0%} to {COVERAGE[1]:.0%}"
            name = row["quantity"]
            claims.append(Claim(f"{name}: truths held", held, asked, bool(COVERAGE[0] <= held <= COVERAGE[1])))
            claims.append(Claim(f"{name}: width over the population's", width, f"≤ {WIDTH:g}", bool(width <= WIDTH)))
        own = next(row for row in self.felt_rows if row["weber"] == WEBER)
        ratio, z = float(own["corrected"]) / max(float(own["base rate"]), 1e-9), float(own["z"])
        claims.append(Claim("felt: Brier score over the base rate's", ratio, "< 1", bool(ratio < 1)))
        claims.append(Claim("felt: size of Spiegelhalter's z", abs(z), f"< {CALIBRATED:g}", bool(abs(z) < CALIBRATED)))
        return claims


def brier_score(told: Float64, felt: Bool) -> float:
    """Mean square of probability less outcome (Brier, Mon. Weather Rev. 78:1, 1950)."""
    return float(np.mean(np.square(told - felt)))


def spiegelhalter(told: Float64, felt: Bool) -> float:
    """Standard normal if the probabilities are calibrated (Spiegelhalter, Stat. Med. 5:421, 1986)."""
    lever = 1 - 2 * told
    variance = float(np.sum(lever**2 * told * (1 - told)))
    return float(np.sum((felt - told) * lever) / np.sqrt(max(variance, 1e-12)))


def binomial_interval(count: int, of: int, level: float = 0.95) -> tuple[float, float]:
    """Clopper & Pearson's interval of a share."""
    tail = (1 - level) / 2
    low = float(beta.ppf(tail, count, of - count + 1)) if count else 0.0
    high = float(beta.ppf(1 - tail, count + 1, of - count)) if count < of else 1.0
    return low, high


def _truths(records: Sequence[Record], name: str) -> Float64:
    return np.array([float(r[f"true|{name}"]) for r in records])
