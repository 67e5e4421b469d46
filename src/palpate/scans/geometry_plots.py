"""Plots a scan's geometry in three dimensions: sources, panels and the volume."""

from typing import Any

import numpy as np

from palpate.arrays import Float64
from palpate.scans.views import Panel, Views
from palpate.volumes.grid import Grid
from palpate.volumes.notebook_figure import Picture

# Corners of a box by bits (x, y, z), in an order that draws each of its edges.
BOX = (0, 1, 3, 2, 0, 4, 5, 1, 5, 7, 3, 7, 6, 2, 6, 4)


def plot_geometry(views: Views, grid: Grid | None = None) -> Picture:
    """Draw focal spots, panels and the volume in three dimensions.

    A thin line joins each focal spot with the centre of its panel. That of a parallel beam is as long as all else is wide.

    Parameters
    ----------
    views : Views
        The geometry.
    grid : Grid, optional
        The box of the volume, drawn in its own frame.

    Returns
    -------
    Picture
        A Matplotlib figure; its axes are in mm.

    Raises
    ------
    AttributeError
        If `views` has no geometry, such as a scan; give `scan.views`.

    Examples
    --------
    >>> figure = pp.plot_geometry(views, grid)
    >>> [line.get_label() for line in figure.axes[0].lines][:2]
    ['focal spots', 'panels']
    """
    figure = Picture(figsize=(7, 6), layout="constrained")
    draw_geometry(figure.add_subplot(projection="3d"), views, grid)
    return figure


def draw_geometry(axes: Any, views: Views, grid: Grid | None) -> None:
    """The same in three-dimensional axes that are there."""
    distinct = {
        panel.origin.tobytes() + panel.row_axis.tobytes() + panel.column_axis.tobytes(): panel for panel in views.panels
    }
    outlines = [_outline(panel) for panel in distinct.values()]
    starts = ray_starts(views, np.concatenate(outlines if grid is None else [*outlines, grid.bounds]))
    spots = starts[~views.parallel]
    if len(spots):
        axes.plot(*spots.T, "o", color="tab:red", label="focal spots")
    if views.parallel.any():
        axes.plot(*starts[views.parallel].T, "_", color="tab:red", label="parallel beams")
    for k, outline in enumerate(outlines):
        axes.plot(*outline.T, color="tab:blue", lw=1.2, label="_" * (k > 0) + "panels")
    for panel, start in zip(views.panels, starts, strict=True):
        ray = np.stack([start, _outline(panel)[:4].mean(axis=0)])
        axes.plot(*ray.T, color="tab:gray", lw=0.6, label="_ray")
    if grid is not None:
        low, high = grid.bounds
        corners = [np.where([k & 1, k & 2, k & 4], high, low) for k in BOX]
        axes.plot(*np.transpose(corners), color="tab:green", lw=1.2, label="volume")
        outlines.append(np.array(corners))
    axes.set(xlabel="x, mm", ylabel="y, mm", zlabel="z, mm")
    aspect = np.ptp(np.concatenate([*outlines, starts]), axis=0).clip(1e-9)
    axes.set_box_aspect(aspect)
    for axis, extent in zip("xyz", aspect / aspect.max(), strict=True):
        axes.locator_params(axis, nbins=max(2, round(8 * extent)))
    axes.legend(frameon=False)


def ray_starts(views: Views, shown: Float64) -> Float64:
    """(views, 3) mm: the focal spots; of a parallel beam a point on its central ray, as far from the panel as all is wide."""
    starts = views.source.copy()
    size = float(np.linalg.norm(np.ptp(shown, axis=0)))
    for k in np.flatnonzero(views.parallel):
        middle = _outline(views.panels[k])[:4].mean(axis=0)
        way = starts[k] - middle
        starts[k] = middle + size / np.linalg.norm(way) * way
    return starts


def _outline(panel: Panel) -> Float64:
    """The panel's border: (5, 3) mm, the first corner twice."""
    rows, columns = panel.shape
    top, left, bottom, right = -0.5, -0.5, rows - 0.5, columns - 0.5
    return panel.points([(top, left), (top, right), (bottom, right), (bottom, left), (top, left)])
