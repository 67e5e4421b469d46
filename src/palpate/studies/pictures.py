"""The pictures of the reports: projections, slices, surfaces, curves. Each function gives one figure."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.colors import LightSource, ListedColormap
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

from palpate.arrays import AnyArray, Float64, Int32
from palpate.meshes.mesh import TetMesh
from palpate.volumes.volume import Labels, Volume

INK = "#1c2530"
LABEL_COLOURS = ListedColormap(["#00000000", "#2a9d8f", "#e76f51", "#e9c46a", "#457b9d"])


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


def slices(volume: Volume, z: Sequence[int], window: tuple[float, float] | None = None, up: bool = False) -> Figure:
    """Slices z of a volume; up: y grows upwards."""
    shown = volume.values[list(z)]
    figure = _row(len(z), shown.shape[1] * volume.grid.spacing[1] / (shown.shape[2] * volume.grid.spacing[2]))
    low, high = window or (0.0, float(np.percentile(shown, 99.8)))
    for axes, k in zip(figure.axes, z, strict=True):
        _picture(axes, volume.values[k], volume.grid.spacing[1] / volume.grid.spacing[2], low, high)
        if up:
            axes.invert_yaxis()
        axes.set_title(f"z = {volume.grid.axis('z')[k]:.1f} mm", fontsize=9, color=INK)
    return figure


def pictured(rows: Mapping[str, tuple[AnyArray, tuple[float, float]]], heads: Sequence[str]) -> Figure:
    """A table of pictures: a named row of images (columns, rows, columns) each, with its black and white."""
    (first, _), *_ = rows.values()
    side = 11 / len(heads)
    figure = Figure(
        figsize=(11.5, (side * first.shape[1] / first.shape[2] + 0.05) * len(rows) + 0.3), layout="constrained"
    )
    for line, (name, (images, (low, high))) in zip(figure.subplots(len(rows), len(heads)), rows.items(), strict=True):
        for axes, image, head in zip(line, images, heads, strict=True):
            axes.imshow(image, cmap="gray", vmin=low, vmax=high, interpolation="nearest")
            axes.set(xticks=[], yticks=[])
            if name == next(iter(rows)):
                axes.set_title(head, fontsize=9, color=INK)
        line[0].set_ylabel(name, fontsize=9, color=INK)
    return figure


def three_planes(
    volume: Volume,
    index: Sequence[int],
    labels: Labels | None = None,
    window: tuple[float, float] | None = None,
    reach: float | None = None,
    up: bool = False,
) -> Figure:
    """The three planes through voxel (z, y, x), to one scale; reach: mm shown on either side of it (all if None).

    up: y grows upwards, as a patient stands, instead of downwards, as a patient lies.
    """
    grid = volume.grid
    low, high = window or (0.0, float(np.percentile(volume.values, 99.8)))
    shown = [
        slice(None) if reach is None else slice(max(0, int(i - reach / d)), int(i + reach / d) + 1)
        for i, d in zip(index, grid.spacing, strict=True)
    ]
    sides = [len(range(*s.indices(n))) * d for s, n, d in zip(shown, grid.shape, grid.spacing, strict=True)]
    planes = ((0, 1, 2), (1, 0, 2), (2, 0, 1))  # the axis cut, then those down and across
    widths = [sides[across] for _, _, across in planes]
    height = 13 * max(sides[down] for _, down, _ in planes) / sum(widths) + 0.5
    figure = Figure(figsize=(13, min(height, 9)), layout="constrained")
    for axes, (cut, down, across) in zip(figure.subplots(1, 3, width_ratios=widths), planes, strict=True):
        values = np.take(volume.values, index[cut], axis=cut)[shown[down], shown[across]]
        _picture(axes, values, grid.spacing[down] / grid.spacing[across], low, high)
        axes.set_title(f"{'zyx'[cut]} = {grid.axis('zyx'[cut])[index[cut]]:.1f} mm", fontsize=9, color=INK)
        if labels is not None:
            _outlines(axes, np.take(labels.values, index[cut], axis=cut)[shown[down], shown[across]])
        if down == 0 or up:
            axes.invert_yaxis()
    return figure


def surfaces(mesh: TetMesh, faces: Mapping[str, Int32], eye: tuple[float, float] = (25, -60)) -> Figure:
    """Each named set of triangles (F, 3) of a mesh, shaded, from elevation and azimuth `eye` in degrees."""
    figure = Figure(figsize=(5.2 * len(faces), 4.8), layout="constrained")
    for i, (name, triangles) in enumerate(faces.items()):
        axes = figure.add_subplot(1, len(faces), i + 1, projection="3d")
        _solid(axes, mesh.nodes, triangles, LABEL_COLOURS(i + 1))
        _framed(axes, mesh.nodes[np.unique(triangles)], eye)
        axes.set_title(name, fontsize=10, color=INK)
    return figure


def surface_map(
    mesh: TetMesh, points: Float64, values: Float64, unit: str, eye: tuple[float, float] = (25, -60)
) -> Figure:
    """Values (P,) at surface points (P, 3) mm, drawn as dots on the organ's shaded skin."""
    figure = Figure(figsize=(8.5, 4.6), layout="constrained")
    axes = figure.add_subplot(projection="3d")
    _solid(axes, mesh.nodes, mesh.surface, "#b8c4cf", alpha=0.35)
    order = np.argsort(np.abs(values))
    size = 14 + 60 * np.abs(values[order]) / max(np.abs(values).max(), 1e-30)
    dots = axes.scatter(*points[order].T, c=values[order], s=size, cmap="viridis", depthshade=False)
    bar = figure.colorbar(dots, ax=axes, shrink=0.7, pad=0.02)
    bar.set_label(unit)
    _framed(axes, mesh.nodes, eye)
    return figure


def curves(x: AnyArray, lines: Mapping[str, AnyArray], xlabel: str, ylabel: str, log: bool = False) -> Figure:
    """Lines over a common x (a line may be shorter)."""
    figure = Figure(figsize=(7.5, 3.6), layout="constrained")
    axes = figure.subplots()
    for name, y in lines.items():
        axes.plot(x[: len(y)], y, label=name, lw=1.8)
    axes.set_xlabel(xlabel)
    axes.set_ylabel(ylabel)
    if log:
        axes.set_yscale("log")
    if len(lines) > 1:
        axes.legend(frameon=False)
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


def _picture(axes: object, values: AnyArray, aspect: float, low: float, high: float) -> None:
    axes.imshow(values, cmap="gray", vmin=low, vmax=high, aspect=aspect, interpolation="nearest")  # type: ignore[attr-defined]
    axes.axis("off")  # type: ignore[attr-defined]


def _outlines(axes: object, values: AnyArray) -> None:
    for value in np.unique(values):
        if value:
            axes.contour(values == value, levels=[0.5], colors=[LABEL_COLOURS(int(value) % 5)], linewidths=1.1)  # type: ignore[attr-defined]


def _solid(axes: object, nodes: Float64, triangles: Int32, colour: object, alpha: float = 1.0) -> None:
    skin = Poly3DCollection(nodes[triangles], facecolors=colour, shade=True, lightsource=LightSource(225, 45))
    skin.set_alpha(alpha)
    axes.add_collection3d(skin)  # type: ignore[attr-defined]


def _framed(axes: object, points: Float64, eye: tuple[float, float]) -> None:
    low, high = points.min(axis=0), points.max(axis=0)
    for name, a, b in zip("xyz", low, high, strict=True):
        getattr(axes, f"set_{name}lim")(a, b)
    axes.set_box_aspect(np.maximum(high - low, 1e-6), zoom=1.05)  # type: ignore[attr-defined]
    axes.view_init(*eye)  # type: ignore[attr-defined]
    for words, pad in (("x mm", 4), ("y mm", 4), ("z", -1)):  # there is little room beside the last one
        getattr(axes, f"set_{words[0]}label")(words, fontsize=8, labelpad=pad)
    axes.tick_params(labelsize=7)  # type: ignore[attr-defined]
