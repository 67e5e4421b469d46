"""Pictures of the chapter that show no error: the laws, the rows that a push reaches, the kidney."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from palpate.arrays import Int32
from palpate.report.plot_axes import INK, TRUTH
from palpate.report.tables import Row, distinct, where
from palpate.studies.deformation.config import MARKS
from palpate.studies.deformation.plots import finish, legend, panels
from palpate.studies.deformation.reference import rsc
from palpate.studies.deformation.spring_laws import spring_law
from palpate.volumes.notebook_figure import COLOURS, line_style

ROWS_SHOWN = 15


def law_curves() -> Figure:
    """RSC over the row, a line a RSC0 of the chapter, a panel a law."""
    figure, axes = panels(2, 2.9)
    rows = np.arange(1.0, ROWS_SHOWN + 1)
    for one, law in zip(axes, ("linear", "exponential"), strict=True):
        for k, mark in enumerate(MARKS):
            one.plot(rows, rsc(spring_law(law, -mark, "equal"), rows), lw=1.7, label=f"{mark:.2f}", **line_style(k))
        finish(one, law, "row", "RSC")
    legend(figure, axes[0])
    return figure


def reach(rows: Sequence[Row]) -> Figure:
    """The nodes of the plane nearest the contact, moved: those of the deformed-node index table by row, others grey."""
    depths = distinct(rows, "depth_mm")
    figure, axes = panels(len(depths), 3.6)
    for one, depth in zip(axes, depths, strict=True):
        some = where(rows, depth_mm=depth)
        for inside, colour in ((False, TRUTH), (True, COLOURS[1])):
            nodes = [r for r in some if (r["row"] > 0) == inside]
            place = [r["x"] for r in nodes], [r["z"] + r["moved_z"] for r in nodes]
            size = 26.0 if inside else 6.0
            one.scatter(*place, s=size, color=colour, label="in the table" if inside else "at home")
        one.set_aspect("equal")
        most = max(r["row"] for r in some)
        finish(one, f"pushed {depth:g} mm: rows to {most}", "x, mm", "z, mm")
    legend(figure, axes[-1])
    return figure


def kidney_shapes(rows: Sequence[Row], triangles: Mapping[str, Int32]) -> Figure:
    """Each resolution pushed, as a wireframe, and pulled, shaded. triangles: (T, 3) nodes of its surface."""
    names = distinct(rows, "resolution")
    figure = Figure(figsize=(8.6, 4.0 * len(names)), layout="constrained")
    for k, (name, way) in enumerate((name, way) for name in names for way in ("push", "pull")):
        some = where(rows, resolution=name)
        place = np.array([[row[f"{way}_{axis}"] for axis in "xyz"] for row in some])
        corner = np.searchsorted([row["node"] for row in some], triangles[name])
        look = {"color": COLOURS[0]} if way == "pull" else {"color": "w", "edgecolor": INK, "shade": False}
        axes: Any = figure.add_subplot(len(names), 2, k + 1, projection="3d")
        axes.plot_trisurf(*place.T, triangles=corner, linewidth=0.3, **look)
        axes.set_box_aspect(np.ptp(place, axis=0))
        axes.view_init(elev=15, azim=-50)
        axes.set_axis_off()
        axes.set_title(f"{name}, {'pushed' if way == 'push' else 'pulled'}", fontsize=11)
    return figure
