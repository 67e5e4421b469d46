"""What the study found: numbers first, and sentences built from them, whatever they turn out to be."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.report.tables import Row, distinct, where
from palpate.studies.tomosynthesis.config import Setting
from palpate.studies.tomosynthesis.experiments import GAPS, SAMPLING_DOSE, Record
from palpate.studies.tomosynthesis.tables import error_at, mean_and_spread, seconds_below, spread

# What is compared: name, fixed resolution, multi-resolution; each (optimiser, start).
PAIRS = (
    ("descent, uniform start", ("descent", "uniform"), ("descent", "uniform")),
    ("descent, backprojection start", ("descent", "backprojection"), ("descent", "backprojection")),
    ("momentum, uniform start", ("momentum", "uniform"), ("momentum", "uniform")),
    ("momentum, backprojection start", ("momentum", "backprojection"), ("momentum", "backprojection")),
    ("fixed by descent from uniform, multi as by default", ("descent", "uniform"), ("auto", "backprojection")),
)
SAME = 0.02  # share below which two image errors or times count as equal


@dataclass(frozen=True)
class Factor:
    """F-MAP over M-MAP-3 at a dose: above 1, multi-resolution is better.

    time: processor seconds until the posterior that M-MAP-3 had when it stopped, geometric mean over the seeds, and least
    and most. bound: "at least" where F-MAP never came so far, and the seconds that it spent in vain were taken.
    equal_time: region NMSE of F-MAP when M-MAP-3 stopped, over that of M-MAP-3. at_rule: each at its own stop.
    """

    pair: str
    dose: int
    time: tuple[float, float, float]
    bound: str
    equal_time: tuple[float, float, float]
    at_rule: tuple[float, float, float]

    @property
    def row(self) -> Row:
        """As a row of a table."""
        row: Row = {"pair": self.pair, "dose": self.dose, "time_bound": self.bound}
        for name in ("time", "equal_time", "at_rule"):
            row[name], row[f"{name}_least"], row[f"{name}_most"] = getattr(self, name)
        return row


def factors(records: Sequence[Record], setting: Setting) -> list[Factor]:
    """Every pair at every dose."""
    runs, found = where(records, experiment="convergence"), []
    for pair, (optimiser, start), (optimiser_m, start_m) in PAIRS:
        for dose in setting.doses:
            fixed = where(runs, dose=dose, method="F-MAP", optimiser=optimiser, start=start)
            multi = where(runs, dose=dose, method="M-MAP-3", optimiser=optimiser_m, start=start_m)
            times, equal, rule, came = [], [], [], []
            for f, m in zip(fixed, multi, strict=True):
                stop = m["stop"]
                seconds, reached = seconds_below(f, m["trace"]["posterior"][stop])
                times.append(seconds / m["trace"]["cpu"][stop])
                came.append(reached)
                error = m["quality"]["nmse_region"]
                equal.append(error_at(f, m["trace"]["cpu"][stop]) / error)
                rule.append(f["quality"]["nmse_region"] / error)
            bound = "" if all(came) else "at least"
            found.append(Factor(pair, dose, _ranged(times), bound, _ranged(equal), _ranged(rule)))
    return found


def _ranged(values: Sequence[float]) -> tuple[float, float, float]:
    x = np.asarray(values)
    return float(np.exp(np.log(x).mean())), float(x.min()), float(x.max())


def headlines(found: Sequence[Factor]) -> list[str]:
    """By what factor multi-resolution is sooner, and its image better, at each dose."""
    lines = []
    for pair, *_ in (PAIRS[0], PAIRS[3], PAIRS[4]):
        mine = [f for f in found if f.pair == pair]
        times = ", ".join(f"{f.bound + ' ' if f.bound else ''}{f.time[0]:.2f} at {_photons(f.dose)}" for f in mine)
        errors = ", ".join(f"{f.equal_time[0]:.2f} at {_photons(f.dose)}" for f in mine)
        lines.append(
            f"{pair[0].upper()}{pair[1:]}: to the posterior at which M-MAP-3 stops, F-MAP takes longer by the factor {times} "
            f"photons. At that time F-MAP's error in the region, over that of M-MAP-3, is {errors}: above 1, M-MAP-3's image "
            f"is the better one."
        )
    return lines


def factor_table(found: Sequence[Factor]) -> list[list[str]]:
    """All pairs for the reader."""
    head = [
        "pair",
        "photons",
        "time of F-MAP / M-MAP-3",
        "error of F-MAP / M-MAP-3 after the same time",
        "at own stops",
    ]
    body = [
        [f.pair, f"{f.dose:,}", f"{'≥ ' if f.bound else ''}{_of(f.time)}", _of(f.equal_time), _of(f.at_rule)]
        for f in found
    ]
    return [head, *body]


def _of(ranged: tuple[float, float, float]) -> str:
    return f"{ranged[0]:.2f} ({ranged[1]:.2f} to {ranged[2]:.2f})"


def _photons(dose: int) -> str:
    return f"{dose // 1000}k" if dose % 1000 == 0 else str(dose)


def _best_share(rows: Sequence[Row]) -> float:
    shares = sorted({row["share"] for row in rows})
    return float(min(shares, key=lambda share: spread(r["nmse_region"] for r in rows if r["share"] == share)[0]))


def _verdict(ratios: Sequence[tuple[float, float]]) -> str:
    """Of (least, most) over the seeds at each dose, against 1."""
    held = sum(least > 1 + SAME for least, _ in ratios)
    if held in (0, len(ratios)):
        return "holds at every dose" if held else "holds at no dose"
    return f"holds at {held} of {len(ratios)} doses"


def claims(found: Sequence[Factor], tables: dict[str, list[Row]], setting: Setting) -> list[tuple[str, str]]:
    """The dissertation's claims: (claim, what the numbers say of it)."""
    said_of = []
    for pair in (PAIRS[0][0], PAIRS[3][0]):
        mine = [f for f in found if f.pair == pair]
        for claim, factor in (
            ("M-MAP needs less computation than F-MAP", "time"),
            ("M-MAP's images are better than F-MAP's after the same time", "equal_time"),
        ):
            ranged = [getattr(f, factor) for f in mine]
            numbers = ", ".join(f"{_photons(f.dose)} {mean:.2f}" for f, (mean, *_) in zip(mine, ranged, strict=True))
            said_of.append((f"{claim} ({pair})", f"{_verdict([r[1:] for r in ranged])}: factors {numbers}"))
    for what, column, lower in (("error of the region", "nmse_region", True), ("contrast to noise", "cnr", False)):
        ratios, each_dose = [], []
        for dose in setting.doses:
            back = where(tables["baselines"], dose=dose, method="backprojection")
            multi = where(tables["convergence"], dose=dose, method="M-MAP-3", optimiser="descent", start="uniform")
            pairs = [(b[column], m[column]) for b in back for m in where(multi, seed=b["seed"])]
            each = [b / m if lower else m / b for b, m in pairs]
            ratios.append((min(each), max(each)))
            each_dose.append(f"{_photons(dose)} {_ranged(each)[0]:.2f}")
        claim = f"M-MAP-3 (descent, uniform start) is better than backprojection: {what}"
        said_of.append((claim, f"{_verdict(ratios)}: factors {', '.join(each_dose)}"))
    return said_of


def winner(rows: Sequence[Row], by: str, column: str, form: str, lower: bool = True) -> tuple[str, str]:
    """Which choice of `by` is best in a column, compared scan by scan, and whether the seeds agree; and the numbers."""
    names = distinct(rows, by)
    means = {name: spread(row[column] for row in rows if row[by] == name)[0] for name in names}
    order = sorted(names, key=lambda name: means[name] if lower else -means[name])
    first = order[0]
    numbers = ", ".join(
        f"{_plain(name)} {mean_and_spread((r[column] for r in rows if r[by] == name), form)}" for name in order
    )
    ties = [name for name in order[1:] if not _always_better(rows, by, column, first, name, lower)]
    if not ties:
        return _plain(first), numbers
    if len(ties) == len(names) - 1:
        return "no clear winner", numbers
    return f"{_plain(first)}, not surely before {' and '.join(map(_plain, ties))}", numbers


def _plain(choice: object) -> str:
    return f"{choice:g} times" if isinstance(choice, float) else str(choice)


def _always_better(rows: Sequence[Row], by: str, column: str, first: str, other: str, lower: bool) -> bool:
    """On every scan, and by more than what counts as equal on the mean."""
    a, b = ([r[column] for r in rows if r[by] == name] for name in (first, other))
    sign = 1 if lower else -1
    ahead = np.array([sign * (y - x) for x, y in zip(a, b, strict=True)])
    return bool((ahead > 0).all() and ahead.mean() > SAME * abs(np.mean(b)))


def findings(tables: dict[str, list[Row]], setting: Setting) -> list[list[str]]:
    """Every question that has a winner: question, answer, numbers."""
    rows = [["question", "best", "numbers"], *_sampling(tables["sampling"])]
    for dose in setting.doses:
        ranked = winner(where(tables["priors"], dose=dose), "prior", "nmse_region", ".3f")
        rows.append([f"prior, {_photons(dose)}: error of the region", *ranked])
    for dose in setting.doses:
        for column, of, form in (
            ("nmse_region", "error of the region", ".3f"),
            ("ssim", "SSIM", ".3f"),
            ("cnr", "contrast to noise", ".1f"),
        ):
            ranked = winner(where(tables["strengths"], dose=dose), "share", column, form, lower=column == "nmse_region")
            rows.append([f"strength of the prior against that which the data choose, {_photons(dose)}: {of}", *ranked])
    for dose in setting.doses:
        rows.append([f"M-MAP-3 and baselines, {_photons(dose)}: error of the region", *_rivals(tables, dose)])
    for dose in setting.curve:
        ranked = winner(where(tables["doses"], dose=dose, method="map"), "strength", "nmse_region", ".3f")
        rows.append([f"strength over dose, {_photons(dose)}: error of the region", *ranked])
    for method, name in (("backprojection", "backprojection"), ("map", "M-MAP-3")):
        some = where(tables["motions"], method=method)
        rows.append([f"motion, {name}: error of the region", *winner(some, "motion", "nmse_region", ".3f")])
        rows.append([f"motion, {name}: spread in depth, mm", *winner(some, "motion", "depth_mm", ".1f")])
    return rows


def _rivals(tables: dict[str, list[Row]], dose: int) -> tuple[str, str]:
    """Each rival at its best iterate; M-MAP-3 at its own stop, with the strength from the data and with the best one."""
    rows = [{**r, "nmse_region": r["best_nmse_region"]} for r in where(tables["baselines"], dose=dose)]
    rows += [{**m, "method": "M-MAP-3"} for m in where(tables["priors"], dose=dose, prior="lange")]
    best = _best_share(where(tables["strengths"], dose=dose))
    more = where(tables["strengths"], dose=dose, share=best)
    rows += [{**m, "method": f"M-MAP-3 at {best:g} times the strength"} for m in more]
    return winner(rows, "method", "nmse_region", ".3f")


def _sampling(rows: Sequence[Row]) -> list[list[str]]:
    """Which interpolator and down-sampler win."""
    lines = []
    for what, by, other, fixed in (
        ("interpolator", "interpolation", "downsample", "sum"),
        ("down-sampler", "downsample", "interpolation", "linear"),
    ):
        some = where(rows, **{other: fixed})
        for column, of, form in (
            ("nmse_region_at_finest_start", "error of the region when the finest level starts", ".3f"),
            ("nmse_region", "error of the region at the stop", ".3f"),
            (f"cpu_s_to_{GAPS[0]:g}", f"seconds to within {GAPS[0]:.0%} of the best posterior", ".2f"),
        ):
            late = sum(not r[f"reached_{GAPS[0]:g}"] for r in some) if column.startswith("cpu") else 0
            note = f" ({late} of {len(some)} runs did not come so far, and count with what they spent)" if late else ""
            best, numbers = winner(some, by, column, form)
            lines.append([f"{what}, {_photons(SAMPLING_DOSE)}: {of}", best, numbers + note])
    return lines
