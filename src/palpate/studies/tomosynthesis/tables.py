"""The records of the runs as tables: one row a run, one file a table."""

from collections.abc import Iterable, Sequence

import numpy as np

from palpate.reconstruction.multiresolution import pyramid
from palpate.report.tables import Row, where
from palpate.scans.scan import Scan
from palpate.studies.tomosynthesis.config import Setting
from palpate.studies.tomosynthesis.convergence_traces import columns
from palpate.studies.tomosynthesis.experiment_runner import GAPS
from palpate.studies.tomosynthesis.experiments import Record

MEASURED = ("experiment", "trace", "stop", "quality", "starts", "spread")  # of a record, beside what the run is
COMPARED = ("convergence", "sampling")  # experiments whose posteriors are
ENOUGH = 5  # values of which a standard deviation is told


def best_posterior(records: Sequence[Record]) -> dict[tuple[int, int], float]:
    """By dose and seed the lowest negative log-posterior that any run found."""
    best: dict[tuple[int, int], float] = {}
    for r in records:
        if r["experiment"] in COMPARED:
            key = r["dose"], r["seed"]
            best[key] = min(best.get(key, np.inf), *r["trace"]["posterior"])
    return best


def gaps(record: Record, best: float) -> np.ndarray:
    """(iterates,) how far above the best its negative log-posterior is, as a share of the best."""
    return (np.asarray(record["trace"]["posterior"]) - best) / best


def first_below(record: Record, posterior: float, unit: str) -> tuple[float, bool]:
    """Work (a column of the trace) until the finest level's negative log-posterior is as low, or all that was spent in
    vain, and whether it was.
    """
    t = columns(record["trace"])
    there = np.flatnonzero((t["posterior"] <= posterior) & (t["level"] == 0))
    return (float(t[unit][there[0]]), True) if there.size else (float(t[unit][-1]), False)


def make_tables(records: Sequence[Record], setting: Setting) -> dict[str, list[Row]]:
    """By name, each a list of rows."""
    best = best_posterior([r for r in records if r["seed"] < setting.few])  # of the others none was brought to its end
    tables = {name: [_converged(r, best) for r in where(records, experiment=name)] for name in COMPARED}
    tables["levels"] = levels(setting, tables["convergence"])
    for name in ("direct", "motions", "priors", "strengths", "baselines", "doses"):
        tables[name] = [_judged(r) for r in where(records, experiment=name)]
    local = where(records, experiment="local")
    tables["local"] = [
        {"dose": r["dose"], "seed": r["seed"], "method": m, **q} for r in local for m, q in r["quality"].items()
    ]
    return tables


def _judged(record: Record) -> Row:
    """Quality at the stopping rule (or the last iterate), and the best region NMSE of all iterates: an oracle's stop."""
    t, stop = columns(record["trace"]), record["stop"]
    row: Row = {name: value for name, value in record.items() if name not in MEASURED} | record["quality"]
    row |= {"cpu_s": t["cpu"][stop], "passes": t["passes"][stop], "iterations": sum(_iterations(record).values())}
    least = int(np.argmin(t["nmse_region"]))
    row |= {"best_nmse_region": t["nmse_region"][least], "best_iteration": int(t["iteration"][least])}
    return row


def _iterations(record: Record) -> dict[int, int]:
    """Up to the stop, by level."""
    t, stop = columns(record["trace"]), record["stop"]
    level, iteration = t["level"][: stop + 1], t["iteration"][: stop + 1]
    return {k: int(iteration[level == k].max(initial=0)) for k in range(3)}


def _converged(record: Record, best: dict[tuple[int, int], float]) -> Row:
    t, row = columns(record["trace"]), _judged(record)
    coarse = np.flatnonzero(t["level"] > 0)
    if coarse.size:
        row["nmse_region_at_finest_start"] = t["nmse_region"][coarse[-1]]
    row |= {f"iterations_level_{level}": count for level, count in _iterations(record).items()}
    star = best.get((record["dose"], record["seed"]))
    if star is not None:
        row["gap_at_stop"] = float(gaps(record, star)[record["stop"]])
        for gap in GAPS:
            for unit in ("passes", "cpu"):
                row[f"{unit}_to_{gap:g}"], row[f"reached_{gap:g}"] = first_below(record, star * (1 + gap), unit)
    return row


def levels(setting: Setting, convergence: Sequence[Row]) -> list[Row]:
    """The dissertation's table: resolution of volume and projections, and iterations, of each algorithm and level."""
    views = setting.views("circular")
    blank = Scan(np.ones(views.shape, np.float32), 1.0, views)
    rows = []
    every = pyramid(blank, setting.grid, 3)
    for method, count in (("F-MAP", 1), ("M-MAP-2", 2), ("M-MAP-3", 3)):
        for optimiser in ("descent", "momentum", "auto"):
            some = where(convergence, method=method, optimiser=optimiser)
            for level in reversed(range(count)) if some else ():
                scan, grid = every[level]
                row: Row = {"method": method, "optimiser": optimiser, "level": level}
                row["voxels"] = " x ".join(map(str, grid.shape))
                row["voxel_mm"] = " x ".join(f"{d:g}" for d in grid.spacing)
                row["pixels"] = " x ".join(map(str, scan.shape[1:]))
                row["pixel_mm"] = f"{scan.views.panels[0].pitch[0]:g}"
                for dose in setting.doses:
                    mine = [r[f"iterations_level_{level}"] for r in where(some, dose=dose)]
                    row[f"iterations_{dose}"] = float(np.mean(mine))
                rows.append(row)
    return rows


def photons(dose: int) -> str:
    """As in 20k."""
    return f"{dose // 1000}k" if dose % 1000 == 0 else str(dose)


def spread(values: Iterable[float]) -> tuple[float, float]:
    """Mean and standard deviation over the seeds (0 for a single one)."""
    x = np.array(list(values), np.float64)
    return float(x.mean()), float(x.std(ddof=1)) if len(x) > 1 else 0.0


def whiskers(values: Iterable[float]) -> tuple[float, float, float]:
    """Mean, and how far below and above it a figure's whiskers end: at the deviation, or at the least and the most."""
    x = np.array(list(values), np.float64)
    mean, deviation = spread(x)
    below, above = (deviation, deviation) if len(x) >= ENOUGH else (mean - float(x.min()), float(x.max()) - mean)
    return mean, max(below, 0.0), max(above, 0.0)


def mean_and_spread(values: Iterable[float], form: str = ".3f") -> str:
    """Mean ± standard deviation as words; of fewer values than a deviation needs, mean (least to most)."""
    x = list(values)
    mean, deviation = spread(x)
    if len(x) >= ENOUGH:
        return f"{mean:{form}} ± {deviation:{form}}"
    return f"{mean:{form}} ({min(x):{form}} to {max(x):{form}})" if len(x) > 1 else f"{mean:{form}}"


def summary(rows: Sequence[Row], by: Sequence[str], of: Sequence[tuple[str, str, str]]) -> list[list[str]]:
    """A table for the reader, a row a group of `by`; of: (column, heading, format), each as mean ± deviation."""
    groups: dict[tuple[object, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in by), []).append(row)
    head = [*(b.replace("dose", "photons") for b in by), *(heading for _, heading, _ in of)]
    body = [
        [
            *(f"{v:,}" if isinstance(v, int) else str(v) for v in key),
            *(mean_and_spread((r[c] for r in some), f) for c, _, f in of),
        ]
        for key, some in groups.items()
    ]
    return [head, *body]
