"""The study's pictures, a column or two of panels wide, so that a telephone shows them."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from palpate.arrays import ArrayLike, Float64
from palpate.report import plot_axes
from palpate.report.plot_axes import INK, TRUTH, legend_below
from palpate.report.tables import Row, distinct, where
from palpate.studies.deformation.config import DEPTH, DEPTHS, MARKS, SIDE
from palpate.studies.deformation.haptic_fidelity import peak_to_peak, without_parabola
from palpate.studies.deformation.spring_laws import by_distance
from palpate.volumes.notebook_figure import COLOURS, line_style

MODELS = ("blocks", "springs", "multigrid", "compliance", "neo-hookean", "direct solve")
FEM = line_style(6) | {"color": TRUTH}
LOOK = {name: line_style(i) for i, name in enumerate(MODELS)} | {"finite elements": FEM, "linear finite elements": FEM}
EACH = {"markevery": 1}  # a mark at each point


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
    """As for every study, in larger letters, and no numbers at minor ticks."""
    plot_axes.finish(axes, title, xlabel, ylabel, size=11)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_formatter(NullFormatter())


def legend(figure: Figure, axes: Axes, columns: int = 3) -> None:
    """Of one panel, below all."""
    legend_below(figure, axes, columns, size=10)


def line(axes: Axes, name: str, x: ArrayLike, y: ArrayLike, **more: Any) -> None:
    """A curve in the colour, dashes and marks of a model."""
    axes.plot(x, y, **LOOK.get(name, {"color": INK}) | more)


def models_of(rows: Sequence[Row], **wanted: object) -> dict[str, list[Row]]:
    """The rows that have these values, by model."""
    some = where(rows, **wanted)
    return {name: where(some, model=name) for name in distinct(some, "model")}


def laws_of(rows: Sequence[Row]) -> list[str]:
    """The spring laws that a table of profiles holds."""
    names = dict.fromkeys(head.rsplit(":", 1)[0] for row in rows[:1] for head in row if ":" in head)
    return [name for name in names if name != "fem"]


def field(rows: Sequence[Row], who: str) -> Float64:
    """(N, 3) mm at a push of `DEPTH`."""
    return np.array([[row[f"{who}:{axis}"] for axis in "xyz"] for row in rows])


def section(rows: Sequence[Row], law: str, depth: float) -> Figure:
    """The nodes of the plane nearest the contact, moved: finite elements and springs over each other."""
    middle = min((row["y"] for row in rows), key=lambda y: abs(y - SIDE / 2))
    some = where(rows, y=middle)
    n = round(len(some) ** 0.5)
    x = np.array([[row["x"], row["z"]] for row in some]).reshape(n, n, 2)
    figure, (axes,) = panels(1, 4.8)
    for who, label, colour, width, dash in (
        ("fem", "finite elements (P2)", TRUTH, 1.8, "-"),
        (law, f"springs, {law}", COLOURS[1], 1.1, "--"),
    ):
        moved = x + field(some, who)[:, [0, 2]].reshape(n, n, 2) * depth / DEPTH
        for k in range(n):
            axes.plot(*moved[k].T, color=colour, lw=width, ls=dash, label=label if k == 0 else None)
            axes.plot(*moved[:, k].T, color=colour, lw=width, ls=dash)
    axes.set_aspect("equal")
    finish(axes, f"cut through the middle, pushed {depth:g} mm", "x, mm", "z, mm")
    legend(figure, axes)
    return figure


def displacement(rows: Sequence[Row], law: str) -> Figure:
    """Each node's displacement over its distance to the contact, a panel a depth."""
    distance = np.array([row["distance_mm"] for row in rows])
    figure, axes = panels(len(DEPTHS), 2.9)
    for one, depth in zip(axes, DEPTHS, strict=True):
        for who, mark, colour, label in (
            ("fem", ".", TRUTH, "finite elements (P2)"),
            (law, "x", COLOURS[1], f"springs, {law}"),
        ):
            size = np.linalg.norm(field(rows, who), axis=1) * depth / DEPTH
            one.plot(distance, size, mark, ms=3.5, color=colour, alpha=0.7, label=label)
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
            own = np.maximum(np.linalg.norm(true, axis=1) * depth / DEPTH, 1e-9)
            gap /= {"mm": 1.0, "push": depth, "own": own}[of]
            one.plot(*by_distance(distance, gap), lw=1.8, label=law, **line_style(k))
        if limit is not None:
            one.axhline(limit, color=TRUTH, lw=1, ls=":")
        words = {"mm": "difference, mm", "push": "difference, share of push", "own": "difference, share of own"}[of]
        finish(one, title, "distance to the contact, mm", words)
    legend(figure, axes[0], 2)
    return figure


def binned_difference(rows: Sequence[Row], panel: str, each: str) -> Figure:
    """Greatest difference over the distance, a panel a value of the column `panel`, a line a value of `each`."""
    figure, axes = panels(len(distinct(rows, panel)), 3.0)
    for one, title in zip(axes, distinct(rows, panel), strict=True):
        for k, name in enumerate(distinct(rows, each)):
            some = where(rows, **{panel: title, each: name})
            x, y = [r["distance_mm"] for r in some], [r["difference_mm"] for r in some]
            one.plot(x, y, lw=1.8, label=f"{name:.2f}" if isinstance(name, float) else name, **line_style(k))
        one.axhline(1.0, color=TRUTH, lw=1, ls=":")
        finish(one, title, "distance to the contact, mm", "difference, mm")
    legend(figure, axes[0])
    return figure


def over_rsc(curves: Sequence[Row], best: Sequence[Row], contact: str, column: str) -> Figure:
    """Error over |RSC0| of the exponential law, a line a Poisson's ratio, the best as dots; a panel a kind of edges."""
    figure, axes = panels(2, 3.9)
    for one, weights in zip(axes, ("equal", "cotangent"), strict=True):
        some = where(curves, contact=contact, weights=weights, law="exponential")
        for k, poisson in enumerate(distinct(some, "poisson")):
            curve = where(some, poisson=poisson)
            x, y = [-r["rsc"] for r in curve], [r[column] for r in curve]
            one.plot(x, y, lw=1.7, label=f"{poisson:g}", **line_style(k))
            (dot,) = where(best, contact=contact, weights=weights, law="exponential", poisson=poisson, least=column)
            one.plot(-dot["rsc"], dot[column], **line_style(k) | {"ms": 8})
        for mark in MARKS:
            one.axvline(mark, color=TRUTH, lw=0.9, ls=":")
        one.set_xscale("symlog", linthresh=1e-3)
        one.set(xlim=(-2, -1e-3), ylim=(0, None))
        one.set_xticks([-1, -0.18, -0.1, -0.01], ["−1", "−0.18", "−0.1", "−0.01"])
        finish(one, f"{weights} edges", "RSC0", {"worst_mm": "worst, mm", "rms_mm": "RMS, mm"}[column])
    legend(figure, axes[0], 5)
    return figure


def convergence(rows: Sequence[Row]) -> Figure:
    """True error (full) and certified bound (dotted) over sweeps, a panel a size."""
    sizes = distinct(rows, "nodes")
    figure, axes = panels(len(sizes), 3.2)
    for one, nodes in zip(axes, sizes, strict=True):
        for name, some in models_of(rows, nodes=nodes).items():
            error = [max(r["error"], 1e-9) for r in some]
            line(one, name, [r["sweeps"] for r in some], error, lw=1.8, label=name)
            bounded = [r for r in some if r["bound"] is not None]
            line(one, name, [r["sweeps"] for r in bounded], [r["bound"] for r in bounded], ls=":", lw=1.1)
        one.set(xscale="log", yscale="log", ylim=(1e-8, 3))
        one.set_xticks([5, 20, 100, 500], ["5", "20", "100", "500"])
        finish(one, f"{nodes}³ nodes", "sweeps from rest", "error, share of push")
    legend(figure, axes[0])
    return figure


def pareto(rows: Sequence[Row], column: str) -> Figure:
    """Error over the processor time of a push from rest, a panel a size, a line a model."""
    sizes = distinct(rows, "nodes")
    figure, axes = panels(len(sizes), 3.9)
    words = "force error, share" if "force" in column else "error, share of push"
    for one, nodes in zip(axes, sizes, strict=True):
        for name, some in models_of(rows, nodes=nodes).items():
            some = [r for r in some if column in r]
            ms, error = [1e3 * r["seconds"] for r in some], [max(r[column], 1e-6) for r in some]
            alone = {"ls": ""} if name == "direct solve" else {}
            line(one, name, ms, error, lw=1.5, label=name, **EACH | alone)
        one.axvline(1.0, color=TRUTH, lw=0.9, ls=":")
        one.set(xscale="log", yscale="log")
        finish(one, f"{nodes}³ nodes", "processor ms of a push from rest", words)
    legend(figure, axes[0])
    return figure


def ripple(rows: Sequence[Row]) -> Figure:
    """Stiffness along the line, as a share of its mean, the parabola taken out; a panel a radius."""
    radii = distinct(rows, "radius_edges")
    figure, axes = panels(len(radii), 2.9)
    for one, radius in zip(axes, radii, strict=True):
        peaks = []
        for name, some in models_of(rows, radius_edges=radius).items():
            f = np.array([r["force_n"] for r in some])
            way = np.hypot(*(np.array([r[a] for r in some]) - some[0][a] for a in "xy"))
            line(one, name, way, 100 * without_parabola(f) / f.mean(), lw=1.5, label=name)
            peaks.append(peak_to_peak(f))
        title = f"radius {radius:g} edges: up to {100 * max(peaks):.1f} %"
        finish(one, title, "way along the top, mm", "stiffness, % off")
    legend(figure, axes[0])
    return figure


def loops(rows: Sequence[Row]) -> Figure:
    """Net work of each loop over the most that was stored, a panel a way of running, a bar a model."""
    hows = distinct(rows, "how")
    paths, models = distinct(rows, "path"), distinct(rows, "model")
    figure, axes = panels(len(hows), 0.6 + 0.55 * len(paths))
    high = 0.8 / len(models)
    for one, how in zip(axes, hows, strict=True):
        for k, name in enumerate(models):
            some = [next(iter(where(rows, how=how, path=path, model=name))) for path in paths]
            y = np.arange(len(paths)) + (k - (len(models) - 1) / 2) * high
            share = [100 * r["net_nmm"] / r["stored_nmm"] for r in some]
            one.barh(y, share, high * 0.9, color=LOOK.get(name, {"color": INK})["color"], label=name)
        one.axvline(-1, color=TRUTH, lw=1, ls=":")
        one.set_yticks(range(len(paths)), paths)
        one.invert_yaxis()
        finish(one, how, "net work put in by the hand, % of the most stored", "")
    legend(figure, axes[0])
    return figure


def kidneys(rows: Sequence[Row]) -> Figure:
    """Processor time of a 5 mm push to 1 % against nodes, with one sweep of a tick below."""
    figure, (one,) = panels(1, 3.8)
    for name, some in models_of(rows).items():
        nodes, push = [r["nodes"] for r in some], [1e3 * r["push_s_0.01"] for r in some]
        line(one, name, nodes, push, label=f"{name}: a push to 1 %", **EACH)
        if all(r["sweep_s"] for r in some):
            sweep = [1e3 * r["sweep_s"] for r in some]
            line(one, name, nodes, sweep, label=f"{name}: a sweep", ls=":", mfc="none", **EACH)
    for ms in (1000 / 30, 1.0):
        one.axhline(ms, color=TRUTH, lw=0.9, ls=":")
    one.set(xscale="log", yscale="log")
    sizes = distinct(rows, "nodes")
    one.set_xticks(sizes, [f"{n:,}" for n in sizes])
    finish(one, "", "nodes", "processor ms")
    legend(figure, one, 2)
    return figure


def large(rows: Sequence[Row]) -> Figure:
    """How far linear models are from finite strain: displacement and force over the depth."""
    figure, axes = panels(2, 3.2)
    for name, some in models_of(rows).items():
        depth, force = [r["depth_mm"] for r in some], [100 * r["force_error"] for r in some]
        line(axes[0], name, depth, [r["worst_mm"] for r in some], label=name, **EACH)
        line(axes[1], name, depth, force, label=name, **EACH)
    finish(axes[0], "displacement", "mm", "worst difference, mm")
    finish(axes[1], "force", "mm", "difference, %")
    legend(figure, axes[0])
    return figure
