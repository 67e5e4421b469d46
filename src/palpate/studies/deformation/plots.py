"""The study's pictures, a column or two of panels wide, so that a telephone shows them."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from palpate.arrays import Float64
from palpate.studies.axes import COLOURS, TRUTH
from palpate.studies.deformation.feel import peak_to_peak
from palpate.studies.deformation.setting import DEPTH, DEPTHS, MARKS, SIDE
from palpate.studies.pictures import INK
from palpate.studies.tables import Row, where

BIN = 2.5  # mm of distance over which the greatest difference is taken
COLOUR = {"springs": COLOURS[1], "blocks": COLOURS[0], "multigrid": COLOURS[2], "compliance": COLOURS[3],
          "neo-hookean": COLOURS[4], "direct solve": COLOURS[5], "finite elements": TRUTH,
          "linear finite elements": TRUTH}  # fmt: skip


def panels(count: int, height: float = 3.3) -> tuple[Figure, list[Axes]]:
    """Up to three panels below each other, more in two columns."""
    across = 1 if count <= 3 else 2
    down = -(-count // across)
    figure = Figure(figsize=(6.6 if across == 1 else 8.6, height * down + 0.3), layout="constrained")
    axes = list(figure.subplots(down, across, squeeze=False).ravel())
    for spare in axes[count:]:
        spare.remove()
    return figure, axes[:count]


def finish(axes: Axes, title: str, xlabel: str, ylabel: str) -> None:
    """Titles, labels, a faint grid, no box."""
    axes.set_title(title, fontsize=11, color=INK)
    axes.set_xlabel(xlabel, fontsize=10)
    axes.set_ylabel(ylabel, fontsize=10)
    axes.tick_params(labelsize=9)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.grid(alpha=0.25)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_formatter(NullFormatter())


def legend(figure: Figure, axes: Axes, columns: int = 3) -> None:
    """Of one panel, below all."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside lower center", ncols=min(columns, len(labels)), frameon=False, fontsize=10
    )


def laws_of(rows: Sequence[Row]) -> list[str]:
    """The spring laws that a table of profiles holds."""
    names = dict.fromkeys(head.rsplit(":", 1)[0] for row in rows[:1] for head in row if ":" in head)
    return [name for name in names if name != "fem"]


def field(rows: Sequence[Row], who: str) -> Float64:
    """(N, 3) mm at a push of `DEPTH`."""
    return np.array([[row[f"{who}:{axis}"] for axis in "xyz"] for row in rows])


def section(rows: Sequence[Row], law: str, depth: float) -> Figure:
    """The nodes of the plane nearest the contact, moved: finite elements and springs over each other."""
    some = [row for row in rows if abs(row["y"] - SIDE / 2) < 1e-6] or [
        row for row in rows if row["y"] == min((r["y"] for r in rows), key=lambda y: abs(y - SIDE / 2))
    ]
    n = round(len(some) ** 0.5)
    x = np.array([[row["x"], row["z"]] for row in some]).reshape(n, n, 2)
    figure, (axes,) = panels(1, 4.8)
    for who, colour, width, label in (
        ("fem", TRUTH, 1.8, "finite elements (P2)"),
        (law, COLOURS[1], 1.1, f"springs, {law}"),
    ):
        moved = x + field(some, who)[:, [0, 2]].reshape(n, n, 2) * depth / DEPTH
        for k in range(n):
            axes.plot(*moved[k].T, color=colour, lw=width, label=label if k == 0 else None)
            axes.plot(*moved[:, k].T, color=colour, lw=width)
    axes.set_aspect("equal")
    finish(axes, f"cut through the middle, pushed {depth:g} mm", "x, mm", "z, mm")
    legend(figure, axes)
    return figure


def displacement(rows: Sequence[Row], law: str) -> Figure:
    """Each node's displacement over its distance to the contact, a panel a depth."""
    distance = np.array([row["distance_mm"] for row in rows])
    figure, axes = panels(len(DEPTHS), 2.9)
    for one, depth in zip(axes, DEPTHS, strict=True):
        for who, colour, label in (("fem", TRUTH, "finite elements (P2)"), (law, COLOURS[1], f"springs, {law}")):
            size = np.linalg.norm(field(rows, who), axis=1) * depth / DEPTH
            one.plot(distance, size, ".", ms=3.5, color=colour, alpha=0.7, label=label)
        finish(one, f"pushed {depth:g} mm", "distance to the contact, mm", "displacement, mm")
    legend(figure, axes[0])
    return figure


def difference(groups: Mapping[str, tuple[Sequence[Row], float]], of: str, limit: float | None) -> Figure:
    """Greatest difference over the distance, a panel a group (its nodes, its depth); of: "mm", "push" or "own"."""
    figure, axes = panels(len(groups), 3.0)
    for one, (title, (rows, depth)) in zip(axes, groups.items(), strict=True):
        distance, true = np.array([row["distance_mm"] for row in rows]), field(rows, "fem")
        for k, law in enumerate(laws_of(rows)):
            gap = np.linalg.norm(field(rows, law) - true, axis=1) * depth / DEPTH
            if of != "mm":
                gap = (
                    gap / depth
                    if of == "push"
                    else gap / np.maximum(np.linalg.norm(true, axis=1) * depth / DEPTH, 1e-9)
                )
            one.plot(*_binned(distance, gap), color=COLOURS[k], lw=1.8, label=law)
        if limit is not None:
            one.axhline(limit, color=TRUTH, lw=1, ls=":")
        words = {"mm": "difference, mm", "push": "difference, share of push", "own": "difference, share of own"}[of]
        finish(one, title, "distance to the contact, mm", words)
    legend(figure, axes[0], 2)
    return figure


def _binned(distance: Float64, values: Float64) -> tuple[Float64, Float64]:
    """Greatest value in each bin that has any, and the bin's middle."""
    k = (distance / BIN).astype(int)
    bins = np.unique(k)
    return (bins + 0.5) * BIN, np.array([values[k == b].max() for b in bins])


def over_rsc(curves: Sequence[Row], best: Sequence[Row], contact: str, column: str) -> Figure:
    """Error over |RSC0| of the exponential law, a line a Poisson's ratio, the best as dots; a panel a kind of edges."""
    figure, axes = panels(2, 3.9)
    for one, weights in zip(axes, ("equal", "cotangent"), strict=True):
        some = where(curves, contact=contact, weights=weights, law="exponential")
        for k, poisson in enumerate(dict.fromkeys(row["poisson"] for row in some)):
            line = where(some, poisson=poisson)
            one.plot(
                [-r["rsc"] for r in line], [r[column] for r in line], color=COLOURS[k], lw=1.7, label=f"{poisson:g}"
            )
            (dot,) = where(best, contact=contact, weights=weights, law="exponential", poisson=poisson, least=column)
            one.plot(-dot["rsc"], dot[column], "o", color=COLOURS[k], ms=6)
        for mark in MARKS:
            one.axvline(mark, color=TRUTH, lw=0.9, ls=":")
        one.set_xscale("symlog", linthresh=1e-3)
        one.set_xlim(-2, -1e-3)
        one.set_ylim(0, None)
        one.set_xticks([-1, -0.18, -0.1, -0.01], ["−1", "−0.18", "−0.1", "−0.01"])
        finish(one, f"{weights} edges", "RSC0", {"worst_mm": "worst, mm", "rms_mm": "RMS, mm"}[column])
    legend(figure, axes[0], 5)
    return figure


def convergence(rows: Sequence[Row]) -> Figure:
    """True error (full) and certified bound (dotted) over sweeps, a panel a size."""
    sizes = list(dict.fromkeys(row["nodes"] for row in rows))
    figure, axes = panels(len(sizes), 3.2)
    for one, nodes in zip(axes, sizes, strict=True):
        for name in dict.fromkeys(row["model"] for row in where(rows, nodes=nodes)):
            line = where(rows, nodes=nodes, model=name)
            one.plot(
                [r["sweeps"] for r in line],
                [max(r["error"], 1e-9) for r in line],
                color=COLOUR.get(name, INK),
                lw=1.8,
                label=name,
            )
            bound = [(r["sweeps"], r["bound"]) for r in line if r["bound"] is not None]
            if bound:
                one.plot(*zip(*bound, strict=True), color=COLOUR.get(name, INK), lw=1.1, ls=":")
        one.set_xscale("log")
        one.set_yscale("log")
        one.set_xticks([5, 20, 100, 500], ["5", "20", "100", "500"])
        one.set_ylim(1e-8, 3)
        finish(one, f"{nodes}³ nodes", "sweeps from rest", "error, share of push")
    legend(figure, axes[0])
    return figure


def pareto(rows: Sequence[Row], column: str) -> Figure:
    """Error over the processor time of a push from rest, a panel a size, a line a model."""
    sizes = list(dict.fromkeys(row["nodes"] for row in rows))
    figure, axes = panels(len(sizes), 3.9)
    for one, nodes in zip(axes, sizes, strict=True):
        for name in dict.fromkeys(row["model"] for row in where(rows, nodes=nodes)):
            line = [r for r in where(rows, nodes=nodes, model=name) if column in r]
            style = "s" if name == "direct solve" else "o-"
            one.plot(
                [1e3 * r["seconds"] for r in line],
                [max(r[column], 1e-6) for r in line],
                style,
                ms=4,
                color=COLOUR.get(name, INK),
                lw=1.5,
                label=name,
            )
        one.axvline(1.0, color=TRUTH, lw=0.9, ls=":")
        one.set_xscale("log")
        one.set_yscale("log")
        finish(
            one,
            f"{nodes}³ nodes",
            "processor ms of a push from rest",
            "error, share of push" if "force" not in column else "force error, share",
        )
    legend(figure, axes[0])
    return figure


def ripple(rows: Sequence[Row]) -> Figure:
    """Stiffness along the line, as a share of its mean, the parabola taken out; a panel a radius."""
    radii = list(dict.fromkeys(row["radius_edges"] for row in rows))
    figure, axes = panels(len(radii), 2.9)
    for one, radius in zip(axes, radii, strict=True):
        for name in dict.fromkeys(row["model"] for row in rows):
            line = where(rows, radius_edges=radius, model=name)
            f = np.array([r["force_n"] for r in line])
            way = np.hypot(*(np.array([r[a] for r in line]) - line[0][a] for a in "xy"))
            s = np.linspace(0, 1, len(f))
            rest = 100 * (f - np.polyval(np.polyfit(s, f, 2), s)) / f.mean()
            one.plot(
                way,
                rest,
                color=COLOUR.get(name, INK),
                lw=1.5,
                label=name,
                ls="--" if name == "finite elements" else "-",
            )
        peak = max(
            peak_to_peak(np.array([r["force_n"] for r in where(rows, radius_edges=radius, model=m)]))
            for m in dict.fromkeys(r["model"] for r in rows)
        )
        finish(one, f"radius {radius:g} edges: up to {100 * peak:.1f} %", "way along the top, mm", "stiffness, % off")
    legend(figure, axes[0])
    return figure


def loops(rows: Sequence[Row]) -> Figure:
    """Net work of each loop over the most that was stored, a panel a way of running, a bar a model."""
    hows = list(dict.fromkeys(row["how"] for row in rows))
    paths, models = list(dict.fromkeys(row["path"] for row in rows)), list(dict.fromkeys(row["model"] for row in rows))
    figure, axes = panels(len(hows), 0.6 + 0.55 * len(paths))
    high = 0.8 / len(models)
    for one, how in zip(axes, hows, strict=True):
        for k, name in enumerate(models):
            some = [next(iter(where(rows, how=how, path=path, model=name))) for path in paths]
            y = np.arange(len(paths)) + (k - (len(models) - 1) / 2) * high
            share = [100 * r["net_nmm"] / r["stored_nmm"] for r in some]
            one.barh(y, share, high * 0.9, color=COLOUR.get(name, INK), label=name)
        one.axvline(-1, color=TRUTH, lw=1, ls=":")
        one.set_yticks(range(len(paths)), paths)
        one.invert_yaxis()
        finish(one, how, "net work put in by the hand, % of the most stored", "")
    legend(figure, axes[0])
    return figure


def kidneys(rows: Sequence[Row]) -> Figure:
    """Processor time of a 5 mm push to 1 % against nodes, with one sweep of a tick below."""
    figure, (one,) = panels(1, 3.8)
    for name in dict.fromkeys(row["model"] for row in rows):
        line = where(rows, model=name)
        nodes = [r["nodes"] for r in line]
        one.plot(
            nodes,
            [1e3 * r["push_s_0.01"] for r in line],
            "o-",
            color=COLOUR.get(name, INK),
            label=f"{name}: a push to 1 %",
        )
        if all(r["sweep_s"] for r in line):
            one.plot(
                nodes, [1e3 * r["sweep_s"] for r in line], "s:", color=COLOUR.get(name, INK), label=f"{name}: a sweep"
            )
    one.axhline(1000 / 30, color=TRUTH, lw=0.9, ls=":")
    one.axhline(1.0, color=TRUTH, lw=0.9, ls=":")
    one.set_xscale("log")
    one.set_yscale("log")
    sizes = list(dict.fromkeys(row["nodes"] for row in rows))
    one.set_xticks(sizes, [f"{n:,}" for n in sizes])
    finish(one, "", "nodes", "processor ms")
    legend(figure, one, 2)
    return figure


def large(rows: Sequence[Row]) -> Figure:
    """How far linear models are from finite strain: displacement and force over the depth."""
    figure, axes = panels(2, 3.2)
    for name in dict.fromkeys(row["model"] for row in rows):
        line = where(rows, model=name)
        depth = np.array([r["depth_mm"] for r in line])
        for one, y in zip(axes, ([r["worst_mm"] for r in line], [100 * r["force_error"] for r in line]), strict=True):
            one.plot(depth, y, "o-", color=COLOUR.get(name, INK), label=name)
    finish(axes[0], "displacement", "push, mm", "worst difference, mm")
    finish(axes[1], "force", "push, mm", "difference, %")
    legend(figure, axes[0])
    return figure
