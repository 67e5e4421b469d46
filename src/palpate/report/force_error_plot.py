"""Draws where the elements are too coarse for the contact force."""

import textwrap

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from palpate.errors import DataError
from palpate.report.figures import draw_frame, draw_solid
from palpate.report.plot_axes import INK
from palpate.tissue.force_error_map import MARGIN, ForceErrorMap
from palpate.volumes.notebook_figure import Picture

EYES = {"from +x, −y": (20, -45), "from −x, +y": (20, 135)}  # elevation and azimuth, degrees
HELD, TOO_COARSE = "#b8b8b8", "#d62728"


def plot_force_error(found: ForceErrorMap, within: float | None = None) -> Picture:
    """Draw the estimated error of the force that the mesh makes on the tissue's surface, from two sides.

    Grey is what is held.

    Parameters
    ----------
    found : ForceErrorMap
        Of `force_error_map`.
    within : float, optional
        Error that is allowed, relative to the force: above two thirds of it, as estimates run low, the surface is red.

    Returns
    -------
    Picture
        A Matplotlib figure.

    Raises
    ------
    DataError
        If `within` is not positive.

    Examples
    --------
    >>> figure = pp.plot_force_error(pp.force_error_map(tissue, radius=12), within=0.05)
    >>> figure.savefig("map.png")
    """
    if within is not None and not within > 0:
        raise DataError(f"within: {within}; give the allowed error relative to the force, above 0, such as 0.05")
    mesh, values = found.tissue.mesh, 100 * found.on_surface()
    limit = None if within is None else 100 * within / MARGIN
    known = values[np.isfinite(values)]
    most = float(known.max(initial=1e-6))
    colours = colormaps["viridis"].with_extremes(bad=HELD, over=None if limit is None else TOO_COARSE)
    scale = ScalarMappable(Normalize(min(0.0, float(known.min(initial=0))), limit or most), colours)
    figure = Picture(figsize=(10, 5.2), layout="constrained")
    for k, (name, eye) in enumerate(EYES.items()):
        axes = figure.add_subplot(1, 2, k + 1, projection="3d")
        draw_solid(axes, mesh.nodes, mesh.surface, scale.to_rgba(np.ma.masked_invalid(values)))
        draw_frame(axes, mesh.nodes, eye)
        axes.set_title(name, fontsize=9, color=INK)
    bar = figure.colorbar(scale, ax=figure.axes, shrink=0.7, pad=0.02, extend="neither" if limit is None else "max")
    bar.set_label("estimated error of the force, %" + ("" if limit is None else "; red: too coarse"))
    figure.suptitle(textwrap.fill(found.text(), 120), fontsize=9, color=INK)
    return figure
