"""A small shaded picture of a solid and the regions inside it, as a notebook shows it."""

import io
from collections.abc import Mapping
from typing import Protocol

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from palpate.arrays import Float64, Int32

TURN, RISE = -0.5, 0.42  # radians: where the page looks from at first, from the front, slightly from the side and above
LIGHT = (-0.4, 0.6, 0.7)  # to the right, up, and towards the eye
SKIN, INSIDE = "#c98b76", ("#7d4fb0", "#2a7d9d", "#c2185b", "#2a9d8f", "#b8860b")
SHEER = 0.45  # opacity of the skin above regions inside
SIZE, DPI = 1.9, 150  # inches


class Solid(Protocol):
    """What a picture needs of a `TetMesh`; this module may not import it."""

    @property
    def nodes(self) -> Float64: ...  # noqa: D102
    @property
    def tets(self) -> Int32: ...  # noqa: D102
    @property
    def region(self) -> Int32: ...  # noqa: D102
    @property
    def names(self) -> dict[int, str]: ...  # noqa: D102
    @property
    def boundary(self) -> tuple[Float64, Int32]: ...  # noqa: D102
    @property
    def surface_nodes(self) -> Int32: ...  # noqa: D102
    @property
    def volumes(self) -> Float64: ...  # noqa: D102


def solid_png(mesh: Solid, inside: Mapping[int, Int32], held: Int32 | None = None) -> bytes:
    """The surface, the triangles around regions inside, and the held nodes as dots, on no ground; held: indices of nodes."""
    right = np.array([np.cos(TURN), np.sin(TURN), 0])
    eye = np.array([np.sin(TURN) * np.cos(RISE), -np.cos(TURN) * np.cos(RISE), np.sin(RISE)])
    turn = np.stack([right, np.cross(eye, right), eye], axis=1)  # x to the right, y up, z to the eye
    (places, triangles), seen = mesh.boundary, mesh.nodes @ turn
    figure = Figure(figsize=(SIZE, SIZE))
    axes = figure.add_axes((0, 0, 1, 1))
    for i, faces in enumerate(inside.values()):
        _draw(axes, seen, faces, INSIDE[i % len(INSIDE)], 1.0)
    _draw(axes, places @ turn, triangles, SKIN, SHEER if inside else 1.0)
    if held is not None:
        dots = seen[np.intersect1d(held, mesh.surface_nodes)]
        axes.plot(dots[:, 0], dots[:, 1], "o", ms=1.6, mew=0, color="#3f7fd0")
    low, high = seen[:, :2].min(axis=0), seen[:, :2].max(axis=0)
    half = 0.52 * (high - low).max()
    x, y = (low + high) / 2
    axes.set_xlim(x - half, x + half)
    axes.set_ylim(y - half, y + half)
    axes.set_axis_off()
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=DPI, transparent=True)
    return file.getvalue()


def _draw(axes: object, seen: Float64, triangles: Int32, color: str, opacity: float) -> None:
    """The triangles that face the eye, from back to front, by Lambert's law."""
    corners = seen[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    front = normal[:, 2] > 0
    corners, normal = corners[front], normal[front]
    order = np.argsort(corners[:, :, 2].mean(axis=1))
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    bright = 0.45 + 0.55 * np.clip(normal @ (np.array(LIGHT) / np.linalg.norm(LIGHT)), 0, 1)
    colors = np.clip(bright[:, None] * np.array(to_rgb(color)) * 1.15, 0, 1)[order]
    axes.add_collection(  # type: ignore[attr-defined]
        PolyCollection(list(corners[order, :, :2]), facecolors=colors, edgecolors=colors, linewidths=0.2, alpha=opacity)
    )


def size_rows(mesh: Solid) -> list[tuple[str, str]]:
    """How many nodes and tetrahedra, how large, and the edges, for a notebook."""
    x, y, z = np.ptp(mesh.nodes, axis=0)
    ends = mesh.nodes[mesh.tets[:, [0, 0, 0, 1, 1, 2, 1, 2, 3, 2, 3, 3]].reshape(-1, 2, 6)]
    edges = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=-1)
    return [
        ("Mesh", f"{len(mesh.nodes):,} nodes, {len(mesh.tets):,} tetrahedra"),
        ("Size", f"{x:.4g} × {y:.4g} × {z:.4g} mm, volume {mesh.volumes.sum() / 1000:.4g} mL"),
        ("Edges", f"{edges.mean():.3g} mm in the mean of all tetrahedra"),
    ]


def region_rows(mesh: Solid, values: Mapping[str, tuple[Float64, str]]) -> list[tuple[str, str]]:
    """A row for each region: how many tetrahedra, and the range of each named value (M,) with its unit."""
    rows = []
    for label in np.unique(mesh.region).tolist():
        here = mesh.region == label
        parts = [f"{name} {_range(value[here])}{unit}" for name, (value, unit) in values.items()]
        name = mesh.names.get(label, f"region {label}")
        rows.append((name, ", ".join([*parts, f"{np.count_nonzero(here):,} tetrahedra"])))
    return rows


def _range(values: Float64) -> str:
    low, high = f"{values.min():.3g}", f"{values.max():.3g}"
    return low if low == high else f"{low} to {high}"
