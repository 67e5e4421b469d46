"""Labels as a notebook shows them: three planes, and each label's voxels and volume."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from palpate.arrays import Float32
from palpate.volumes.grid import Grid
from palpate.volumes.notebook_card import notebook_card
from palpate.volumes.notebook_figure import figure_of_frames, html_block
from palpate.volumes.patient_axes import LabelImage
from palpate.volumes.plane_picture import draw_plane, plane_size

MOST = 12  # labels that are listed
WINDOW, TALLEST = (-0.2, 1.6), 3.0  # dark and light gray; inches


@dataclass(frozen=True, eq=False)
class _Inside:
    """1 where there is a label."""

    values: Float32
    grid: Grid
    unit: str = ""


def labels_html(labels: LabelImage, names: Mapping[int, str]) -> str:
    """Grid, planes with outlines through the middle of what is labelled, and the labels."""
    values, grid = np.asarray(labels.values), labels.grid
    present, count = np.unique(values[values != 0], return_counts=True)
    shape = " × ".join(map(str, grid.shape))
    words = f"Labels: {shape} voxels (z, y, x) of {' × '.join(f'{d:.3g}' for d in grid.spacing)} mm"
    milliliters = float(np.prod(grid.spacing)) / 1000
    rows = [
        (names.get(label, f"label {label}"), f"{n:,} voxels, {n * milliliters:.4g} mL")
        for label, n in zip(present.tolist(), count.tolist(), strict=True)
    ]
    if len(rows) > MOST:
        rows = [*rows[:MOST], ("", f"and {len(rows) - MOST} more")]
    if not rows:
        return notebook_card(words, [("Labels", "none: the mask is empty")])
    middle = np.round(np.argwhere(values != 0).mean(axis=0)).astype(int)
    inside = _Inside((values != 0).astype(np.float32), grid)
    at = grid.points(middle)[0]
    picture, frames = figure_of_frames([[plane_size(grid, at, cut) for cut in range(3)]], tallest=TALLEST)
    frames.pop().remove()  # there is nothing to measure by a color bar
    for cut, frame in enumerate(frames):
        draw_plane(frame, inside, at, cut, WINDOW, labels=labels.values)
    return html_block(words, picture) + notebook_card(f"{len(present)} labels", rows)
