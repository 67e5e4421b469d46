"""Draws the force map over a lump with its band."""

import numpy as np

from palpate.errors import DataError
from palpate.report.figures import draw_frame, draw_solid
from palpate.report.plot_axes import INK, finish
from palpate.tissue.lump_uncertainty import WEBER, LumpUncertainty
from palpate.volumes.notebook_figure import Picture

EYE = 50, -70  # elevation and azimuth, degrees
LUMP = "#0b6e99"


def plot_lump_uncertainty(doubt: LumpUncertainty, level: float = 0.9) -> Picture:
    """Draw where a hand would feel a lump, and the band of the force at every place of the force map.

    Left: what the lump adds to the force at each place, the median. Right: the same with its band, over the distance from
    where the hand pushes.

    Parameters
    ----------
    doubt : LumpUncertainty
        Of `lump_uncertainty`, with `places`.
    level : float, optional
        Probability with which the band holds the value of each place.

    Returns
    -------
    Picture
        A Matplotlib figure.

    Raises
    ------
    DataError
        If there are no places, or the draws are too few for the level.

    Examples
    --------
    >>> found = pp.posterior(scan, grid, samples=9, levels=1)
    >>> doubt = pp.lump_uncertainty(found, tissue, lump=(50, 10), near=(0, 0, 27), radius=10, places=[top])
    >>> pp.plot_lump_uncertainty(doubt, level=0.8).savefig("band.png")
    """
    if len(doubt.places) == 0:
        raise DataError("places: the force map has none; give places to lump_uncertainty")
    mesh = doubt.tissue.mesh
    low, high = (100 * end for end in doubt.band("share", level))
    middle = 100 * np.median(doubt.forces / doubt.plain_forces - 1, axis=0)
    figure = Picture(figsize=(12, 4.8), layout="constrained")
    axes = figure.add_subplot(1, 2, 1, projection="3d")
    draw_solid(axes, mesh.nodes, mesh.surface, "#b8c4cf", alpha=0.3)
    dots = axes.scatter(*doubt.places.T, c=middle, s=45, cmap="viridis", depthshade=False)
    figure.colorbar(dots, ax=axes, shrink=0.7, pad=0.02).set_label("added force, %")
    draw_frame(axes, mesh.nodes, EYE)
    band = figure.add_subplot(1, 2, 2)
    away = np.linalg.norm(doubt.places - doubt.point, axis=1)
    order = np.argsort(away)
    bars = np.stack([middle - low, high - middle])[:, order]
    band.errorbar(away[order], middle[order], np.maximum(bars, 0), fmt="o", ms=4, capsize=2, color=LUMP)
    near = 300 * float((doubt.forces / doubt.plain_forces - 1).max()) > 100 * WEBER
    if near:
        band.axhline(100 * WEBER, color=INK, lw=1, ls="--")
    words = f"{WEBER:.0%}, above which it is felt, is {'dashed' if near else 'far above'}"
    finish(
        band,
        f"added force, {level:.0%} band; {words}",
        "mm from where the hand pushes",
        "% of the force without the lump",
    )
    return figure
