"""Pictures of the study that show volumes: slices beside each other, and lines through them."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from palpate.studies.axes import COLOURS, TRUTH, canvas, finish
from palpate.studies.pictures import INK
from palpate.studies.tomosynthesis.setting import DEPTHS, PROFILE_Y, PROFILE_Z
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Volume

WINDOW = (0.0, 0.045)  # 1/mm, of every picture of a slice


def slice_at(grid: Grid, z: float) -> int:
    """Index of the slice nearest to z mm."""
    return int(np.argmin(np.abs(grid.axis("z") - z)))


def depth_slices(volumes: Mapping[str, Volume], depths: Sequence[float] = DEPTHS) -> Figure:
    """A row a volume, a column a depth, one window for all."""
    return _table(
        [[(volume, z) for z in depths] for volume in volumes.values()],
        list(volumes),
        [f"z = {z:g} mm" for z in depths],
    )


def methods(volumes: Mapping[str, Mapping[str, Volume]], z: float = PROFILE_Z) -> Figure:
    """A row a dose, a column a method, all at one depth."""
    first = next(iter(volumes.values()))
    return _table([[(v, z) for v in row.values()] for row in volumes.values()], list(volumes), list(first))


def _table(cells: Sequence[Sequence[tuple[Volume, float]]], rows: Sequence[str], heads: Sequence[str]) -> Figure:
    across, down = len(heads), len(rows)
    side = 12.5 / across
    tight = ConstrainedLayoutEngine(w_pad=0.02, h_pad=0.02, wspace=0, hspace=0)
    figure = Figure(figsize=(12.8, side * down + 0.45), layout=tight)
    for i, line in enumerate(figure.subplots(down, across, squeeze=False)):
        for j, axes in enumerate(line):
            volume, z = cells[i][j]
            shown = volume.values[slice_at(volume.grid, z)]
            axes.imshow(shown, cmap="gray", vmin=WINDOW[0], vmax=WINDOW[1], interpolation="nearest")
            axes.set_xticks([])
            axes.set_yticks([])
            if i == 0:
                axes.set_title(heads[j], fontsize=9, color=INK)
            if j == 0:
                axes.set_ylabel(rows[i], fontsize=9, color=INK)
    return figure


def profiles(truth: Volume, volumes: Mapping[str, Mapping[str, Volume]]) -> Figure:
    """A panel a dose: attenuation along x through the slice at 48 mm."""
    figure, panels = canvas(len(volumes), 4.3)
    x = truth.grid.axis("x")
    row = int(np.argmin(np.abs(truth.grid.axis("y") - PROFILE_Y)))
    k = slice_at(truth.grid, PROFILE_Z)
    for axes, (title, shown) in zip(panels, volumes.items(), strict=True):
        axes.plot(x, truth.values[k, row], color=TRUTH, lw=2.2, label="phantom")
        for colour, (name, volume) in zip(COLOURS, shown.items(), strict=False):
            axes.plot(x, volume.values[k, row], color=colour, lw=1.2, label=name)
        finish(axes, title, "x, mm", "attenuation, 1/mm")
        axes.set_ylim(-0.002, 0.052)
    panels[-1].legend(frameon=False, fontsize=8)
    return figure
