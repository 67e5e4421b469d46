"""One run against another on the same scan: how much work, and which error, the one has over the other."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.report.tables import Row, where
from palpate.studies.tomosynthesis.convergence_traces import columns
from palpate.studies.tomosynthesis.experiments import Record
from palpate.studies.tomosynthesis.intervals import Interval
from palpate.studies.tomosynthesis.tables import first_below

ERRORS = ("nmse", "nmse_region")


@dataclass(frozen=True)
class Pair:
    """F-MAP by (optimiser, start) against multi-resolution by (method, optimiser, start). claimed: made on every scan."""

    words: str
    fixed: tuple[str, str]
    multi: tuple[str, str, str]
    claimed: bool = True

    @property
    def same(self) -> bool:
        """Whether an iteration of one costs what one of the other does."""
        return self.fixed[0] == self.multi[1]


PAIRS = (
    *(
        Pair(f"{method}, descent, {start} start", ("descent", start), (method, "descent", start))
        for method in ("M-MAP-3", "M-MAP-2")
        for start in ("uniform", "backprojection")
    ),
    Pair(
        "M-MAP-3, momentum, backprojection start",
        ("momentum", "backprojection"),
        ("M-MAP-3", "momentum", "backprojection"),
    ),
    Pair("M-MAP-3, momentum, uniform start", ("momentum", "uniform"), ("M-MAP-3", "momentum", "uniform"), False),
    Pair(
        "M-MAP-3 as by default, F-MAP by descent from uniform",
        ("descent", "uniform"),
        ("M-MAP-3", "auto", "backprojection"),
        False,
    ),
)


def pair_rows(records: Sequence[Record]) -> list[Row]:
    """A row a pair, dose and scan: F-MAP over multi-resolution, so that above 1 multi-resolution is better.

    passes, cpu: work until the log-posterior at which multi-resolution stopped; *_bound: F-MAP never came so far, and
    what it spent in vain was taken. equal_*: errors after the same work, passes where both have the same optimiser, else
    processor time. stop_*: errors, each at its own stop.
    """
    runs, rows = where(records, experiment="convergence"), []
    for pair in PAIRS:
        method, *chosen = pair.multi
        for m in where(runs, method=method, optimiser=chosen[0], start=chosen[1]):
            same = {"dose": m["dose"], "seed": m["seed"]}
            for f in where(runs, method="F-MAP", optimiser=pair.fixed[0], start=pair.fixed[1], **same):
                rows.append({"pair": pair.words, **same, **_compared(f, m, "passes" if pair.same else "cpu")})
    return rows


def _compared(fixed: Record, multi: Record, work: str) -> Row:
    stop = multi["stop"]
    row: Row = {}
    for unit in ("passes", "cpu"):
        needed, reached = first_below(fixed, multi["trace"]["posterior"][stop], unit)
        row |= {unit: needed / multi["trace"][unit][stop], f"{unit}_bound": not reached}
    for error in ERRORS:
        mine = multi["quality"][error]
        row[f"equal_{error}"] = error_after(fixed, multi["trace"][work][stop], work, error) / mine
        row[f"stop_{error}"] = fixed["quality"][error] / mine
    return row


def error_after(record: Record, spent: float, work: str, error: str) -> float:
    """The error of the last iterate that was there after so much work; of the start before any."""
    t = columns(record["trace"])
    done = np.flatnonzero(t[work] <= spent)
    return float(t[error][done[-1]]) if done.size else float(record["starts"][record["start"]][error])


def subset_rows(records: Sequence[Record], passes: int) -> list[Row]:
    """A row a trial of ordered subsets: passes to the log-posterior that descent has after `passes` from the same start.

    reached: whether it came so far; else passes are those spent in vain. others: the fewest of what has no subsets.
    """
    rows: list[Row] = []
    for r in where(records, experiment="subsets"):
        same = {"dose": r["dose"], "seed": r["seed"]}
        fixed = {"experiment": "convergence", "method": "F-MAP", "start": "backprojection", **same}
        (descent,), (momentum,) = (where(records, optimiser=name, **fixed) for name in ("descent", "momentum"))
        posterior = descent["trace"]["posterior"]
        target = posterior[min(passes, len(posterior)) - 1]
        (needed, reached), cpu = first_below(r, target, "passes"), first_below(r, target, "cpu")[0]
        others, seconds = (
            [first_below(one, target, unit)[0] for one in (descent, momentum)] for unit in ("passes", "cpu")
        )
        row = {**same, "momentum": r["momentum"], "subsets": r["subsets"], "passes": needed, "reached": reached}
        row |= {"cpu_s": cpu, "others_s": min(seconds)}
        rows.append({**row, "descent": others[0], "memory_gradient": others[1], "others": min(others)})
    return rows


def interval(rows: Sequence[Row], column: str) -> Interval:
    """Of a column of such rows."""
    return Interval.of([row[column] for row in rows], any(row.get(f"{column}_bound", False) for row in rows))


def pair_table(rows: Sequence[Row]) -> list[list[str]]:
    """All pairs for the reader."""
    heads = ["pair", "photons", "scans", "passes", "processor time", "NMSE after the same work", "NMSE at own stops"]
    body = []
    for pair in PAIRS:
        for dose in sorted({row["dose"] for row in rows}, reverse=True):
            some = where(rows, pair=pair.words, dose=dose)
            if some:
                work = [interval(some, unit).words if pair.same or unit == "cpu" else "" for unit in ("passes", "cpu")]
                errors = [interval(some, f"{at}_nmse").words for at in ("equal", "stop")]
                body.append([pair.words, f"{dose:,}", str(len(some)), *work, *errors])
    return [heads, *body]
