"""Draws what a check of a scan found: the geometry, the verdict, and what a volume leaves of the views."""

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.arrays import Float32
from palpate.reconstruction.residuals import Residuals
from palpate.scans.finding import Finding
from palpate.scans.geometry_plots import draw_geometry
from palpate.scans.intensity_correction import line_integrals
from palpate.scans.scan import Scan
from palpate.volumes.grid import Grid
from palpate.volumes.notebook_figure import Picture

SHOWN = 3  # views
SIGMAS = 5.0  # at the ends of the scale of residuals


def plot_check(
    scan: Scan, found: Sequence[Finding], grid: Grid | None = None, left: Residuals | None = None
) -> Picture:
    """Draw the geometry of a scan, some views, and what a check found.

    Parameters
    ----------
    scan : Scan
        The projections.
    found : sequence of Finding
        Of `check_scan`.
    grid : Grid, optional
        The voxels.
    left : Residuals, optional
        Of `residuals`: drawn instead of the line integrals, in standard deviations of the noise.

    Returns
    -------
    Picture
        A Matplotlib figure.

    Raises
    ------
    AttributeError
        If `scan` is not a scan.

    Examples
    --------
    >>> figure = pp.plot_check(scan, pp.check_scan(scan, grid), grid)
    >>> figure.texts[0].get_text()
    'no mistake found'
    """
    figure = Picture(figsize=(11, 7), layout="constrained")
    parts: Any = figure.subfigures(2, 1, height_ratios=(3, 2))
    top, bottom = parts
    draw_geometry(top.add_subplot(1, 2, 1, projection="3d"), scan.views, grid)
    lines = [f"{k}. {'' if f.alarm else '(note) '}{f}" for k, f in enumerate(found, 1)] or ["no mistake found"]
    verdict = "\n\n".join(textwrap.fill(line, 56) for line in lines)
    figure.text(0.56, 0.96, verdict, va="top", fontsize=9)
    some = np.unique(np.linspace(0, len(scan.views) - 1, min(SHOWN, len(scan.views))).astype(int))
    images = line_integrals(scan) if left is None else _deviations(scan, left)
    if left is not None:
        some = np.sort(np.argsort(-left.unexplained)[:SHOWN])
    frames = bottom.subplots(1, len(some), squeeze=False)[0]
    for frame, k in zip(frames, some, strict=True):
        limits = {"vmin": -SIGMAS, "vmax": SIGMAS, "cmap": "RdBu"} if left is not None else {"cmap": "gray"}
        image = frame.imshow(images[k], interpolation="none", **limits)
        title = f"view {k}" if left is None else f"view {k}: deviance {left.deviance[k]:.3g} a pixel"
        frame.set(title=title, xlabel="column", ylabel="row")
    unit = "line integral" if left is None else "(counts − expected) / √expected"
    bottom.colorbar(image, ax=list(frames), label=unit)
    return figure


def _deviations(scan: Scan, left: Residuals) -> Float32:
    """(counts − expected) / √expected, 0 where not measured."""
    noise = np.sqrt(np.maximum(left.expected, np.float32(1e-6)))
    return np.where(scan.mask, (scan.counts - left.expected) / noise, 0)
