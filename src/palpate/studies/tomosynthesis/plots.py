"""Pictures of the study that show numbers: curves over iterations and time, bars with the spread over the seeds."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from palpate.arrays import Float64
from palpate.report.plot_axes import TRUTH, canvas, finish, legend_below
from palpate.report.tables import Row, distinct, where
from palpate.studies.tomosynthesis.convergence_traces import columns
from palpate.studies.tomosynthesis.experiment_runner import GAPS
from palpate.studies.tomosynthesis.experiments import Record
from palpate.studies.tomosynthesis.tables import best_posterior, gaps, whiskers
from palpate.volumes.notebook_figure import COLOURS, line_style

STYLES = {"descent": "-", "momentum": "--", "auto": ":"}
REFERENCE: dict[str, Any] = {"color": TRUTH, "lw": 1.2, "ls": ":", "zorder": 0}
OF_METHOD = {name: line_style(i) for i, name in enumerate(("F-MAP", "M-MAP-2", "M-MAP-3"))}


def convergence(records: Sequence[Record], doses: Sequence[int], start: str, column: str, time: bool) -> Figure:
    """A panel a dose, one seed: a column of the traces against iterations (all levels) or processor time.

    column: "gap" is that of the log-posterior, above the best. The large mark is where the stopping rule ended the run.
    Dotted: the backprojection's error, or the gaps at which runs are compared.
    """
    figure, panels = canvas(len(doses), 4.3)
    best = best_posterior(where(records, seed=0))
    for axes, dose in zip(panels, doses, strict=True):
        (back,) = where(records, experiment="direct", dose=dose, seed=0)
        for level in GAPS if column == "gap" else (back["quality"][column],):
            axes.axhline(level, label=None if column == "gap" else "backprojection", **REFERENCE)
        for r in where(records, experiment="convergence", dose=dose, seed=0, start=start):
            t, stop = columns(r["trace"]), r["stop"]
            x = t["cpu"] if time else np.arange(1, len(t["cpu"]) + 1)
            y = np.maximum(gaps(r, best[dose, 0]), 1e-5) if column == "gap" else t[column]
            style = OF_METHOD[r["method"]] | {"ls": STYLES[r["optimiser"]]}
            axes.plot(x, y, lw=1.5, label=f"{r['method']}, {r['optimiser']}", **style)
            axes.plot(x[stop], y[stop], **style | {"ms": 9, "markevery": 1})
        finish(axes, f"{dose:,} photons", "processor time, s" if time else "iterations, all levels", _NAMES[column])
        axes.set_xscale("log")
        if column == "gap":
            axes.set_yscale("log")
    legend_below(figure, panels[-1])
    return figure


_NAMES = {
    "gap": "negative log-posterior above the best, share",
    "nmse": "NMSE, full field",
    "nmse_region": "NMSE, region",
    "ssim": "SSIM, region",
    "cnr": "contrast to noise, mean of inserts",
    "depth_mm": "spread in depth, mm",
}


def sampling(records: Sequence[Record], by: str, other: str, fixed: str) -> Figure:
    """NMSE of the region and posterior over the passes for each choice, all scans thin, a large mark where the first ended.

    Dotted: F-MAP by descent from the same start, at its own stop on the first scan.
    """
    figure, panels = canvas(2)
    best = best_posterior(records)
    some = where(records, experiment="sampling", **{other: fixed})
    names = distinct(some, by)
    for r in some:
        t, stop, name = columns(r["trace"]), r["stop"], r[by]
        style, first = line_style(names.index(name)), r["seed"] == 0
        for axes, y in zip(panels, (t["nmse_region"], gaps(r, best[r["dose"], r["seed"]])), strict=True):
            thin = {} if first else {"marker": ""}
            axes.plot(t["passes"], y, lw=1.6 if first else 0.6, label=name if first else None, **style | thin)
            if first:
                axes.plot(t["passes"][stop], y[stop], **style | {"ms": 9, "markevery": 1})
    key = {"dose": some[0]["dose"], "seed": 0}
    (fmap,) = where(records, experiment="convergence", method="F-MAP", optimiser="descent", start="uniform", **key)
    levels = fmap["quality"]["nmse_region"], gaps(fmap, best[key["dose"], 0])[fmap["stop"]]
    for axes, column, level in zip(panels, ("nmse_region", "gap"), levels, strict=True):
        axes.axhline(level, label="F-MAP at its stop", **REFERENCE)
        finish(axes, "", "passes over the voxels", _NAMES[column])
        axes.set_xscale("log")
    panels[1].set_yscale("log")
    panels[1].legend(frameon=False, fontsize=9)
    return figure


def subsets(records: Sequence[Record], doses: Sequence[int]) -> Figure:
    """A panel a dose, one scan: the log-posterior over the passes, by number of subsets, beside what has none."""
    figure, panels = canvas(len(doses), 4.3)
    best = best_posterior(where(records, seed=0))
    for axes, dose in zip(panels, doses, strict=True):
        some = where(records, dose=dose, seed=0)
        lines = [(f"{r['subsets']}, {r['momentum']}", r) for r in where(some, experiment="subsets")]
        fixed = {"experiment": "convergence", "method": "F-MAP", "start": "backprojection"}
        lines += [
            (f"{name}, no subsets", one)
            for name in ("descent", "momentum")
            for one in where(some, optimiser=name, **fixed)
        ]
        most = max(r["trace"]["passes"][-1] for _, r in lines[:-2])
        for i, (label, r) in enumerate(lines):
            t = columns(r["trace"])
            early = t["passes"] <= most
            axes.plot(t["passes"][early], gaps(r, best[dose, 0])[early], lw=1.5, label=label, **line_style(i))
        finish(axes, f"{dose:,} photons", "passes over all projections", _NAMES["gap"])
        axes.set_yscale("log")
    legend_below(figure, panels[0], columns=5)
    return figure


def bars(rows: Sequence[Row], by: str, doses: Sequence[int], of: Sequence[str]) -> Figure:
    """A panel a figure of merit: groups of bars by dose, one a choice; whiskers as `whiskers` says."""
    figure, panels = canvas(len(of), 4.2)
    names = distinct(rows, by)
    wide = 0.8 / len(names)
    for axes, column in zip(panels, of, strict=True):
        for i, name in enumerate(names):
            x = np.arange(len(doses)) + (i - (len(names) - 1) / 2) * wide
            some = [where(rows, dose=dose, **{by: name}) for dose in doses]
            means, *reach = np.array([whiskers(r[column] for r in each) for each in some]).T
            colour = COLOURS[i % len(COLOURS)]
            axes.bar(x, means, wide * 0.92, yerr=reach, color=colour, label=str(name), error_kw={"lw": 1})
        axes.set_xticks(np.arange(len(doses)), [f"{dose:,}" for dose in doses])
        finish(axes, "", "photons", _NAMES[column])
    legend_below(figure, panels[0])
    return figure


def dose_curves(rows: Sequence[Row], doses: Sequence[int]) -> Figure:
    """Error of the region and contrast to noise over the dose."""
    figure, panels = canvas(2)
    lines: list[tuple[str, str | None, str]] = [
        ("map", s, f"M-MAP-3, {s}") for s in ("tuned", "same strength", "same beta")
    ]
    lines += [(m, None, m) for m in ("backprojection", "fbp")]
    for axes, column in zip(panels, ("nmse_region", "cnr"), strict=True):
        for i, (method, strength, label) in enumerate(lines):
            more = {} if strength is None else {"strength": strength}
            each = [where(rows, dose=dose, method=method, **more) for dose in doses]
            means, *reach = np.array([whiskers(r[column] for r in some) for some in each]).T
            axes.errorbar(doses, means, reach, lw=1.5, capsize=3, label=label, **line_style(i))
        axes.set_xscale("log")
        finish(axes, "", "photons", _NAMES[column])
    legend_below(figure, panels[0])
    return figure


def over_strength(rows: Sequence[Row], doses: Sequence[int]) -> Figure:
    """Three figures of merit over the strength, a line a dose."""
    figure, panels = canvas(3)
    shares = sorted({row["share"] for row in rows})
    for axes, column in zip(panels, ("nmse_region", "ssim", "cnr"), strict=True):
        for i, dose in enumerate(doses):
            each = [where(rows, dose=dose, share=share) for share in shares]
            means, *reach = np.array([whiskers(r[column] for r in some) for some in each]).T
            label = f"{dose:,} photons"
            axes.errorbar(shares, means, reach, lw=1.5, capsize=3, label=label, **line_style(i))
        axes.set_xscale("log")
        axes.axvline(1, color=TRUTH, lw=0.8, ls=":")
        finish(axes, "", "times the strength that the data choose", _NAMES[column])
    legend_below(figure, panels[0])
    return figure


def over_iterations(records: Sequence[Record], doses: Sequence[int]) -> Figure:
    """Baselines that iterate: error of the region after each iteration; it falls, and rises again as noise is fitted."""
    return _panels(records, doses, lambda r: np.asarray(r["trace"]["nmse_region"]), "iterations", _NAMES["nmse_region"])


def _panels(
    records: Sequence[Record], doses: Sequence[int], y: Callable[[Record], Float64], xlabel: str, ylabel: str
) -> Figure:
    figure, panels = canvas(len(doses))
    for axes, dose in zip(panels, doses, strict=True):
        for i, r in enumerate(where(records, experiment="baselines", dose=dose, seed=0)):
            values = y(r)
            line = line_style(i) | {"label": r["method"], "lw": 1.5}
            if len(values) == 1:
                axes.axhline(values[0], **line)
            else:
                axes.plot(np.arange(1, len(values) + 1), values, **line)
        multi = next(iter(where(records, experiment="priors", dose=dose, seed=0, prior="lange")))
        axes.axhline(multi["quality"]["nmse_region"], color=TRUTH, lw=1.5, label="M-MAP-3")
        finish(axes, f"{dose:,} photons", xlabel, ylabel)
    legend_below(figure, panels[0])
    return figure


def depth_spread(groups: Sequence[tuple[str, Sequence[tuple[str, Record]]]], z: Float64, truth: Float64) -> Figure:
    """Artefact spread functions (slices,) of named records, a panel a group."""
    figure, panels = canvas(len(groups))
    for axes, (title, records) in zip(panels, groups, strict=True):
        axes.plot(z, truth, color=TRUTH, lw=2.2, label="phantom")
        for i, (name, record) in enumerate(records):
            axes.plot(z, record["spread"], lw=1.5, label=name, **line_style(i))
        finish(axes, title, "z, mm", "contrast, share of that in the ball's slice")
    legend_below(figure, panels[0])
    return figure
