"""The pictures of the reports: projections, slices, surfaces, curves. Each function gives one figure."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.colors import LightSource
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

from palpate.arrays import AnyArray, Float64, Int32
from palpate.meshes.tet_mesh import TetMesh
from palpate.report.plot_axes import INK
from palpate.volumes.notebook_figure import figure_of_frames, line_style
from palpate.volumes.patient_axes import patient_grid
from palpate.volumes.plane_picture import OUTLINES, draw_plane, plane_size
from palpate.volumes.volume import Volume


def projections(
    values: AnyArray,
    titles: Sequence[str],
    marks: Float64 | None = None,
    window: tuple[float, float] | None = None,
) -> Figure:
    """Views (views, rows, columns) side by side; marks: (views, 2) (row, column) of a ring to draw on each."""
    figure = _row(len(values), values.shape[1] / values.shape[2])
    low, high = window or np.percentile(values, [1, 99.7]).tolist()
    for k, (axes, title) in enumerate(zip(figure.axes, titles, strict=True)):
        axes.imshow(values[k], cmap="gray", vmin=low, vmax=high)
        axes.set_title(title, fontsize=9, color=INK)
        axes.axis("off")
        if marks is not None:
            axes.plot(marks[k, 1], marks[k, 0], "o", ms=11, mfc="none", mec="#ff7f50", mew=1.6)
    return figure


def slice_table(
    rows: Mapping[str, Sequence[tuple[Volume, float]]],
    windows: Sequence[tuple[float, float]],
    heads: Sequence[str] | None = None,
    y_up: bool = False,
) -> Figure:
    """A table of slices: named rows of (volume, z mm), each row with its black and white; heads: instead of each z."""
    points = {name: [_point(volume, z) for volume, z in cells] for name, cells in rows.items()}
    sizes = [[plane_size(v.grid, at, 0) for (v, _), at in zip(rows[name], points[name], strict=True)] for name in rows]
    figure, frames = figure_of_frames(sizes, tallest=2.2 * len(rows) + 2)
    frames.pop().remove()  # without a colour bar
    places = iter(frames)
    for i, ((name, cells), window) in enumerate(zip(rows.items(), windows, strict=True)):
        for j, (volume, _) in enumerate(cells):
            frame = next(places)
            words = None if heads is None else heads[j] if i == 0 else ""
            draw_plane(frame, volume, points[name][j], 0, window, y_up=y_up, words=words)
            if j == 0:
                frame.text(
                    -0.03, 0.5, name, transform=frame.transAxes, rotation=90, fontsize=9, ha="right", va="center"
                )
    return figure


def _point(volume: Volume, z: float) -> Float64:
    """The middle of the slice nearest to z mm."""
    upright = patient_grid(volume.grid)
    slices = np.arange(upright.shape[0])
    middle = upright.points(np.stack([slices, *(np.full_like(slices, n // 2) for n in upright.shape[1:])], axis=1))
    nearest: Float64 = middle[np.argmin(np.abs(middle[:, 2] - z))]
    return nearest


def surfaces(mesh: TetMesh, faces: Mapping[str, Int32], eye: tuple[float, float] = (25, -60)) -> Figure:
    """Each named set of triangles (F, 3) of a mesh, shaded, from elevation and azimuth `eye` in degrees."""
    figure = Figure(figsize=(5.2 * len(faces), 4.8), layout="constrained")
    for i, (name, triangles) in enumerate(faces.items()):
        axes = figure.add_subplot(1, len(faces), i + 1, projection="3d")
        draw_solid(axes, mesh.nodes, triangles, OUTLINES[i % len(OUTLINES)])
        draw_frame(axes, mesh.nodes[np.unique(triangles)], eye)
        axes.set_title(name, fontsize=10, color=INK)
    return figure


def surface_map(
    mesh: TetMesh, points: Float64, values: Float64, unit: str, eye: tuple[float, float] = (25, -60)
) -> Figure:
    """Values (P,) at surface points (P, 3) mm, drawn as dots on the organ's shaded skin."""
    figure = Figure(figsize=(8.5, 4.6), layout="constrained")
    axes = figure.add_subplot(projection="3d")
    draw_solid(axes, mesh.nodes, mesh.surface, "#b8c4cf", alpha=0.35)
    order = np.argsort(np.abs(values))
    size = 14 + 60 * np.abs(values[order]) / max(np.abs(values).max(), 1e-30)
    dots = axes.scatter(*points[order].T, c=values[order], s=size, cmap="viridis", depthshade=False)
    bar = figure.colorbar(dots, ax=axes, shrink=0.7, pad=0.02)
    bar.set_label(unit)
    draw_frame(axes, mesh.nodes, eye)
    return figure


def curves(x: AnyArray, lines: Mapping[str, AnyArray], xlabel: str, ylabel: str, log: bool = False) -> Figure:
    """Lines over a common x (a line may be shorter)."""
    figure = Figure(figsize=(7.5, 3.6), layout="constrained")
    axes = figure.subplots()
    for i, (name, y) in enumerate(lines.items()):
        axes.plot(x[: len(y)], y, label=name, lw=1.8, **line_style(i))
    axes.set_xlabel(xlabel)
    axes.set_ylabel(ylabel)
    if log:
        axes.set_yscale("log")
    if len(lines) > 1:
        figure.legend(loc="outside right upper", frameon=False, fontsize=9)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.grid(alpha=0.25)
    return figure


def _row(count: int, aspect: float) -> Figure:
    columns = min(count, 4)
    rows = -(-count // columns)
    figure = Figure(figsize=(13, 13 / columns * aspect * rows + 0.4 * rows), layout="constrained")
    for axes in figure.subplots(rows, columns, squeeze=False).ravel()[count:]:
        axes.remove()
    return figure


def draw_solid(axes: object, nodes: Float64, triangles: Int32, colour: object, alpha: float = 1.0) -> None:
    """Shaded triangles (F, 3), of one colour or of one each."""
    skin = Poly3DCollection(nodes[triangles], facecolors=colour, shade=True, lightsource=LightSource(225, 45))
    skin.set_alpha(alpha)
    axes.add_collection3d(skin)  # type: ignore[attr-defined]


def draw_frame(axes: object, points: Float64, eye: tuple[float, float]) -> None:
    """Limits, labels and the view of a solid in mm."""
    low, high = points.min(axis=0), points.max(axis=0)
    for name, a, b in zip("xyz", low, high, strict=True):
        getattr(axes, f"set_{name}lim")(a, b)
    axes.set_box_aspect(np.maximum(high - low, 1e-6), zoom=1.05)  # type: ignore[attr-defined]
    axes.view_init(*eye)  # type: ignore[attr-defined]
    for words, pad in (("x mm", 4), ("y mm", 4), ("z", -1)):  # there is little room beside the last one
        getattr(axes, f"set_{words[0]}label")(words, fontsize=8, labelpad=pad)
    axes.tick_params(labelsize=7)  # type: ignore[attr-defined]
