"""Draws what a calibration from balls measured, where it re-projects the balls, and what is left."""

import numpy as np

from palpate.arrays import ArrayLike, float64
from palpate.errors import DataError
from palpate.scans.ball_calibration import BallCalibration
from palpate.scans.intensity_correction import line_integrals
from palpate.scans.scan import Scan
from palpate.scans.views import Views
from palpate.volumes.display_window import default_window
from palpate.volumes.notebook_figure import COLOURS, Picture


def plot_ball_calibration(
    scan: Scan, balls: ArrayLike, found: BallCalibration, start: Views | None = None, view: int | None = None
) -> Picture:
    """Draw a view with its balls, the residual of every ball, and the residual of every view.

    Parameters
    ----------
    scan : Scan
        The views of the phantom.
    balls : array_like, (N, 3) or (N, 4)
        As they were given to `calibrate_from_balls`.
    found : BallCalibration
        What it found.
    start : Views, optional
        The geometry that it started from. The default is that of the scan.
    view : int, optional
        Which view. The default is the middle one.

    Returns
    -------
    Picture
        A Matplotlib figure.

    Raises
    ------
    DataError
        If the view does not exist, or there are other balls than were calibrated with.

    Examples
    --------
    >>> nothing = np.full((5, 8, 2), np.nan)
    >>> found = pp.BallCalibration(views, nothing, nothing, nothing, (), np.zeros(0), np.zeros(0), ())
    >>> figure = pp.plot_ball_calibration(scan, np.zeros((8, 3)), found)
    """
    places = float64("balls", balls, (found.centres.shape[1], None))[:, :3]
    k = len(scan.views) // 2 if view is None else view
    if not 0 <= k < len(scan.views):
        raise DataError(f"view: {k} is not there; the scan has views 0 to {len(scan.views) - 1}")
    again = found.views.project(places)
    before = (start or scan.views).project(places)[k]
    figure = Picture(figsize=(13, 4.6), layout="constrained")
    image, gaps, course = figure.subplots(1, 3)
    p = line_integrals(scan[[k]])[0]
    low, high = default_window(p)
    image.imshow(p, cmap="gray", vmin=low, vmax=high)
    image.plot(before[:, 1], before[:, 0], "x", color=COLOURS[1], ms=6, label="start")
    image.plot(again[k, :, 1], again[k, :, 0], "+", color="#4cc9f0", ms=9, label="re-projected")
    image.plot(
        found.centres[k, :, 1], found.centres[k, :, 0], "o", mfc="none", color="#ffd166", ms=10, label="measured"
    )
    image.set(
        title=f"view {k}", xlabel="column", ylabel="row", xlim=(-0.5, p.shape[1] - 0.5), ylim=(p.shape[0] - 0.5, -0.5)
    )
    image.legend(fontsize=8, loc="lower right")
    for j in range(len(scan.views)):
        gaps.plot(found.residuals[j, :, 1], found.residuals[j, :, 0], ".", color=COLOURS[5], ms=3, alpha=0.6)
    gaps.plot(found.residuals[k, :, 1], found.residuals[k, :, 0], "o", color=COLOURS[0], ms=5, label=f"view {k}")
    gaps.set(title="measured − re-projected", xlabel="columns, pixels", ylabel="rows, pixels", aspect="equal")
    gaps.axhline(0, color="gray", lw=0.6)
    gaps.axvline(0, color="gray", lw=0.6)
    gaps.legend(fontsize=8)
    used = np.asarray(np.isfinite(found.residuals).all(axis=2))
    squares = np.where(used[..., None], found.residuals, 0) ** 2
    rms = np.sqrt(squares.sum(axis=1) / np.maximum(used.sum(axis=1), 1)[:, None])
    for column, words, colour in ((0, "rows", COLOURS[0]), (1, "columns", COLOURS[1])):
        course.plot(rms[:, column], "o-", ms=4, color=colour, label=words)
    variance = (np.where(used[..., None], found.noise, 0) ** 2).sum(axis=(1, 2)) / np.maximum(2 * used.sum(axis=1), 1)
    course.plot(np.sqrt(variance), "--", color=COLOURS[5], label="by the noise alone")
    course.set(title=f"{used.sum()} shadows of balls", xlabel="view", ylabel="RMS, pixels")
    course.set_ylim(bottom=0)
    course.legend(fontsize=8)
    return figure
