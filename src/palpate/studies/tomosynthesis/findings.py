"""Which choice is best, where there are several: compared scan by scan, with the numbers."""

from collections.abc import Sequence

import numpy as np

from palpate.report.tables import Row, distinct, where
from palpate.studies.tomosynthesis.config import Setting
from palpate.studies.tomosynthesis.experiment_runner import GAPS
from palpate.studies.tomosynthesis.experiments import SAMPLING_DOSE
from palpate.studies.tomosynthesis.intervals import SAME
from palpate.studies.tomosynthesis.tables import mean_and_spread, photons, spread


def _best_share(rows: Sequence[Row]) -> float:
    shares = sorted({row["share"] for row in rows})
    return float(min(shares, key=lambda share: spread(r["nmse_region"] for r in rows if r["share"] == share)[0]))


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
        rows.append([f"prior, {photons(dose)}: error of the region", *ranked])
    for dose in setting.doses:
        for column, of, form in (
            ("nmse_region", "error of the region", ".3f"),
            ("ssim", "SSIM", ".3f"),
            ("cnr", "contrast to noise", ".1f"),
        ):
            ranked = winner(where(tables["strengths"], dose=dose), "share", column, form, lower=column == "nmse_region")
            rows.append([f"strength of the prior against that which the data choose, {photons(dose)}: {of}", *ranked])
    for dose in setting.doses:
        rows.append([f"M-MAP-3 and baselines, {photons(dose)}: error of the region", *_rivals(tables, dose)])
    for dose in setting.curve:
        ranked = winner(where(tables["doses"], dose=dose, method="map"), "strength", "nmse_region", ".3f")
        rows.append([f"strength over dose, {photons(dose)}: error of the region", *ranked])
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
            (f"passes_to_{GAPS[0]:g}", f"passes to within {GAPS[0]:.0%} of the best posterior", ".1f"),
        ):
            late = sum(not r[f"reached_{GAPS[0]:g}"] for r in some) if column.startswith("passes") else 0
            note = f" ({late} of {len(some)} runs did not come so far, and count with what they spent)" if late else ""
            best, numbers = winner(some, by, column, form)
            lines.append([f"{what}, {photons(SAMPLING_DOSE)}: {of}", best, numbers + note])
    return lines
