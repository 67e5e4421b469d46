"""Draws a fit to the force of an indenter."""

import numpy as np

from palpate.report.plot_axes import INK
from palpate.tissue.indentation import IndentationFit
from palpate.volumes.notebook_figure import Picture

MEASURED, FITTED = "#7a7a7a", "#0b7285"


def plot_indentation(found: IndentationFit, title: str = "") -> Picture:
    """Draw the measured force over the depth, the fit with its 95 % band, and what is left.

    Parameters
    ----------
    found : IndentationFit
        Of `fit_indentation`.
    title : str, optional
        Words above the picture.

    Returns
    -------
    Picture
        A Matplotlib figure.

    Examples
    --------
    >>> curve = pp.IndentationCurve(np.linspace(0, 2, 9), np.linspace(0, 0.3, 9))
    >>> figure = pp.plot_indentation(pp.fit_indentation(tissue, curve, top, punch=8))
    >>> figure.savefig("indentation.png")
    """
    order = np.argsort(found.depth)
    depth, fitted = found.depth[order], found.fitted[order]
    low, high = ((fitted - found.offset) * end / found.young + found.offset for end in found.interval)
    figure = Picture(figsize=(7, 5.5), layout="constrained")
    curve, left = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1])
    curve.plot(found.depth, found.force, ".", color=MEASURED, markersize=4, label="measured")
    curve.fill_between(depth, low, high, color=FITTED, alpha=0.25, linewidth=0, label="95 % of the stiffness")
    curve.plot(depth, fitted, color=FITTED, label="fitted")
    if found.onset != 0:
        curve.axvline(found.onset, color=INK, linestyle=":", linewidth=1, label="contact")
    curve.set_ylabel("force, N")
    curve.legend(frameon=False)
    left.axhline(0, color=FITTED, linewidth=1)
    left.plot(found.depth, 1e3 * (found.force - found.fitted), ".", color=MEASURED, markersize=3)
    left.set(xlabel="depth, mm", ylabel="left, mN")
    for axes in (curve, left):
        axes.spines[["top", "right"]].set_visible(False)
    if title:
        figure.suptitle(title, fontsize=10, color=INK, wrap=True)
    return figure
