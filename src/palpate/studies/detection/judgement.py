"""What the records say: measures of each method, and MAP by resolution against the best rival with intervals."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from palpate.arrays import Int64
from palpate.report.tables import Row
from palpate.studies.detection.config import (
    CALCIFICATION,
    FALSE,
    MASS,
    RESAMPLES,
    SLACK,
    TARGETS,
    Setting,
    Target,
)
from palpate.studies.detection.methods import JUDGED, OURS
from palpate.studies.detection.observers import Scores, Seen, detectability, found_share, hotelling_scores, roc_areas
from palpate.studies.detection.run import FREE, PROJECTIONS, Record
from palpate.studies.detection.signals import size_name

FOLDS = 5
Measure = Callable[[Int64], float]  # of the breasts with these numbers


@dataclass(frozen=True)
class Claim:
    """MAP by resolution against the best rival at a dose: a ratio or a difference, its 95 % interval, and what was asked."""

    measure: str
    dose: int
    rival: str
    value: float
    low: float
    high: float
    least: float

    @property
    def met(self) -> bool:
        """Whether the interval's lower end lies above the target, or at most `SLACK` below it."""
        return self.low > self.least - SLACK


@dataclass(frozen=True, eq=False)
class Judgement:
    """records: by (kind, seed)."""

    records: Mapping[tuple[str, int], Record]
    setting: Setting

    @cached_property
    def methods(self) -> list[str]:
        """All that made images, in order."""
        first = next(iter(self.records.values()))
        names = dict.fromkeys(name.split("|")[1] for name in first)
        return [name for name in names if name != PROJECTIONS]

    @cached_property
    def rivals(self) -> list[str]:
        """Those that are not ours."""
        return [name for name in self.methods if name not in OURS]

    def measures(self, dose: int, method: str) -> dict[str, Measure]:
        """By name, each a function of which breasts to take; of the projections all but RMSE."""
        found: dict[str, Measure] = {}
        for size in (MASS, *map(size_name, self.setting.sizes)):
            scores = self._scores(dose, method, size)
            found[f"{size} d_A"] = _detectability(scores)
            found[f"{size} found"] = lambda at, scores=scores: found_share([scores[k] for k in at], FALSE)  # type: ignore[misc]
        if method != PROJECTIONS:
            errors = np.array([float(r[f"{dose}|{method}|rmse"]) for r in self.records.values()])
            found["1 / RMSE"] = lambda at: 1 / float(np.mean(errors[at]))
        return found

    def _scores(self, dose: int, method: str, size: str) -> list[Scores]:
        observer = MASS if size == MASS else CALCIFICATION
        names = [f"{dose}|{method}|{what}" for what in (f"{size}|present", f"{size}|absent", f"{observer}|{FREE}")]
        seen = [Seen(*(np.asarray(r[name], np.float64) for name in names)) for r in self.records.values()]
        return hotelling_scores(seen, min(FOLDS, len(seen)))

    @cached_property
    def all_breasts(self) -> Int64:
        """Their numbers."""
        return np.arange(len(self.records))

    @cached_property
    def rows(self) -> list[Row]:
        """A row for each dose and method, of all breasts."""
        rows = []
        for dose in self.setting.doses:
            for method in (*self.methods, PROJECTIONS):
                values = {name: f(self.all_breasts) for name, f in self.measures(dose, method).items()}
                rows.append({"dose": dose, "method": method, **values})
        return rows

    @cached_property
    def resamples(self) -> list[Int64]:
        """Breasts drawn with replacement within each kind: the same draws for every method."""
        kinds = np.array([kind for kind, _ in self.records])
        groups = [np.flatnonzero(kinds == kind) for kind in dict.fromkeys(kinds)]
        rng = np.random.default_rng(0)
        return [np.concatenate([rng.choice(g, len(g)) for g in groups]) for _ in range(RESAMPLES)]

    @cached_property
    def claims(self) -> list[Claim]:
        """Every target at every dose."""
        return [self._claim(target, dose) for dose in self.setting.doses for target in TARGETS]

    def _claim(self, target: Target, dose: int) -> Claim:
        reached = {row["method"]: row.get(target.measure, 0.0) for row in self.rows if row["dose"] == dose}
        rival = max(self.rivals, key=lambda name: reached[name])
        own, other = (self.measures(dose, name)[target.measure] for name in (JUDGED, rival))

        def compared(at: Int64) -> float:
            a, b = own(at), other(at)
            return a / max(b, 1e-9) if target.ratio else a - b

        low, high = np.quantile([compared(at) for at in self.resamples], [0.025, 0.975]).tolist()
        least = target.low if target.low is not None and dose == min(self.setting.doses) else target.least
        return Claim(target.measure, dose, rival, compared(self.all_breasts), low, high, least)


def _detectability(scores: Sequence[Scores]) -> Measure:
    areas = roc_areas(scores)
    signals, free = (np.array([len(getattr(s, name)) for s in scores], float) for name in ("present", "free"))

    def of(at: Int64) -> float:
        weights = np.outer(signals[at], free[at])
        return detectability(float((areas[np.ix_(at, at)] * weights).sum() / weights.sum()), int(weights.sum()))

    return of
