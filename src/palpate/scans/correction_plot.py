"""Draws a raw view before and after its correction, a profile across it, and the map of bad pixels."""

from typing import Any

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch
from scipy import ndimage

from palpate.arrays import AnyArray, ArrayLike, Bool
from palpate.errors import DataError
from palpate.scans.bad_pixels import KINDS
from palpate.scans.intensity_correction import line_integrals
from palpate.scans.raw_correction import Correction
from palpate.volumes.display_window import default_window
from palpate.volumes.notebook_figure import COLOURS, Picture

SHADES = ("#f2f2f2", "#5b6775", "#c2185b", "#e76f51", "#b8860b", "#8d5fb0", "#0b6e99", "#111111", "#2a9d8f")  # of KINDS
DOTS = 200  # along the panel's longer side: a bad pixel is drawn at least this large


def plot_correction(raw: ArrayLike, correction: Correction, view: int | None = None) -> Picture:
    """Draw a view before and after, a profile along a row, the histogram of its line integrals, and the bad pixels.

    Parameters
    ----------
    raw : array_like, (views, rows, columns)
        What the panel read, as it was given to `correct_scan`.
    correction : Correction
        What `correct_scan` made of it.
    view : int, optional
        Which view. The default is the middle one.

    Returns
    -------
    Picture
        A Matplotlib figure. Masked pixels of the corrected view are filled from their neighbours for the eye alone.

    Raises
    ------
    DataError
        If the view does not exist or `raw` has another shape.

    Examples
    --------
    >>> raw = 2 * scan.counts + 100
    >>> figure = pp.plot_correction(raw, pp.correct_scan(raw, views, dark=100, flat=20_100, gain=2.0))
    """
    values, scan = np.asarray(raw), correction.scan
    if values.shape != scan.shape:
        raise DataError(f"raw: expected shape {scan.shape}, got {values.shape}")
    k = len(values) // 2 if view is None else view
    if not 0 <= k < len(values):
        raise DataError(f"view: {k} is not there; the scan has views 0 to {len(values) - 1}")
    before, good = np.asarray(values[k], np.float64), scan.mask[k]
    after = _filled(line_integrals(scan[[k]])[0], good)
    row = _typical_row(good)
    figure = Picture(figsize=(11, 7.6), layout="constrained")
    frames = figure.subplots(2, 3)
    for frame, image, words, unit in (
        (frames[0, 0], before, f"view {k} as read", "digital units"),
        (frames[0, 1], after, f"view {k} corrected", "line integral"),
    ):
        low, high = default_window(image)
        drawn = frame.imshow(image, cmap="gray", vmin=low, vmax=high, interpolation="nearest")
        frame.axhline(row, color=COLOURS[1], lw=0.8, ls="--")
        frame.set(title=words, xlabel="column", ylabel="row")
        figure.colorbar(drawn, cax=frame.inset_axes((1.03, 0, 0.05, 1)), label=unit)
    _draw_kinds(frames[0, 2], correction.kinds)
    reading = before[row]
    frames[1, 0].plot(np.where(good[row], reading, np.nan), color=COLOURS[0], lw=0.8)
    frames[1, 0].plot(np.flatnonzero(~good[row]), reading[~good[row]], ".", color=COLOURS[6], ms=4, label="masked")
    frames[1, 0].set(title=f"row {row} as read", xlabel="column", ylabel="digital units")
    frames[1, 1].plot(np.where(good[row], line_integrals(scan[[k]])[0][row], np.nan), color=COLOURS[0], lw=0.8)
    frames[1, 1].set(title=f"row {row} corrected", xlabel="column", ylabel="line integral")
    if (~good[row]).any():
        frames[1, 0].legend()
    measured = after[good]
    limits = np.quantile(measured, [0.001, 0.999])
    uncorrected = np.log(np.median(before[before >= np.quantile(before, 0.9)]) / np.maximum(before[good], 1))
    limits = min(limits[0], np.quantile(uncorrected, 0.01)), max(limits[1], np.quantile(uncorrected, 0.99))
    for data, colour, words in ((uncorrected, COLOURS[1], "as read"), (measured, COLOURS[0], "corrected")):
        frames[1, 2].hist(data, bins=120, range=limits, histtype="step", color=colour, label=words)
    frames[1, 2].set(title=f"line integrals of view {k}", xlabel="log(bright / value), line integral", ylabel="pixels")
    frames[1, 2].set_yscale("log")
    frames[1, 2].legend()
    return figure


def _typical_row(good: Bool) -> int:
    """A row near the middle that is not a bad line."""
    shares = good.mean(axis=1)
    usable = np.flatnonzero(shares >= 0.9 * np.median(shares))
    return int(usable[np.argmin(np.abs(usable - len(good) // 2))]) if usable.size else len(good) // 2


def _filled(image: AnyArray, good: Bool) -> AnyArray:
    nearest = ndimage.distance_transform_edt(~good, return_distances=False, return_indices=True)
    return np.asarray(image[tuple(nearest)])


def _draw_kinds(frame: Any, kinds: AnyArray) -> None:
    step = -(-max(kinds.shape) // DOTS)
    rows, columns = (-(-n // step) * step for n in kinds.shape)
    padded = np.zeros((rows, columns), np.uint8)
    padded[: kinds.shape[0], : kinds.shape[1]] = kinds
    dots = padded.reshape(rows // step, step, columns // step, step).max(axis=(1, 3))  # one bad pixel must be seen
    extent = (-0.5, columns - 0.5, rows - 0.5, -0.5)
    frame.imshow(
        dots,
        cmap=ListedColormap(SHADES),
        vmin=-0.5,
        vmax=len(KINDS) - 0.5,
        extent=extent,
        interpolation="nearest",
    )
    there = [i for i in range(1, len(KINDS)) if (kinds == i).any()]
    marks = [Patch(color=SHADES[i], label=f"{KINDS[i]}: {np.count_nonzero(kinds == i)}") for i in there]
    title = f"bad pixels: {np.count_nonzero(kinds)} ({np.mean(kinds != 0):.2%})"
    frame.set(title=title, xlabel="column", ylabel="row")
    if marks:
        frame.legend(handles=marks, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2, fontsize=8)
