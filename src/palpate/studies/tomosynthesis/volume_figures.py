"""Pictures of the study that show volumes: slices beside each other, and lines through them."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from palpate.report.figures import slice_table
from palpate.report.plot_axes import TRUTH, canvas, finish
from palpate.studies.tomosynthesis.config import DEPTHS, PROFILE_Y, PROFILE_Z
from palpate.volumes.notebook_figure import line_style
from palpate.volumes.volume import Volume

WINDOW = (0.0, 0.045)  # 1/mm, of every picture of a slice


def depth_slices(volumes: Mapping[str, Volume], depths: Sequence[float] = DEPTHS) -> Figure:
    """A row a volume, a column a depth, one window for all."""
    rows = {name: [(volume, z) for z in depths] for name, volume in volumes.items()}
    return slice_table(rows, [WINDOW] * len(rows), [f"z = {z:g} mm" for z in depths])


def methods(volumes: Mapping[str, Mapping[str, Volume]], z: float = PROFILE_Z) -> Figure:
    """A row a dose, a column a method, all at one depth."""
    rows = {name: [(volume, z) for volume in row.values()] for name, row in volumes.items()}
    return slice_table(rows, [WINDOW] * len(rows), list(next(iter(volumes.values()))))


def profiles(volumes: Mapping[str, Mapping[str, Volume]]) -> Figure:
    """A panel a dose: attenuation along x through the slice at 48 mm; the first volume is the truth."""
    figure, panels = canvas(len(volumes), 4.3)
    for axes, (title, shown) in zip(panels, volumes.items(), strict=True):
        for i, (name, volume) in enumerate(shown.items()):
            k, row = (
                int(np.argmin(np.abs(volume.grid.axis(a) - at))) for a, at in (("z", PROFILE_Z), ("y", PROFILE_Y))
            )
            look = line_style(i - 1) | {"lw": 1.2} if i else {"color": TRUTH, "lw": 2.2}
            axes.plot(volume.grid.axis("x"), volume.values[k, row], label=name, **look)
        finish(axes, title, "x, mm", "attenuation, 1/mm")
        axes.set_ylim(-0.002, 0.052)
    panels[-1].legend(frameon=False, fontsize=8)
    return figure
