"""Plots the projections of a scan."""

from typing import Protocol

import numpy as np

from palpate.arrays import AnyArray, Bool, Float32
from palpate.errors import DataError
from palpate.scans.views import Views, beam_in_words
from palpate.volumes.display_window import default_window
from palpate.volumes.notebook_figure import Picture, draw_image, figure_of_frames, html_block, title
from palpate.volumes.plane_picture import PIXELS
from palpate.volumes.volume_plots import value_range

VIEWS, ACROSS = 8, 4  # that a montage shows unless told which, and side by side
LEAST = np.float32(0.5)  # photons taken where none were counted above the background


class Projections(Protocol):
    """What a plot needs of a `Scan`; this module may not import it."""

    @property
    def counts(self) -> Float32: ...  # noqa: D102
    @property
    def incident(self) -> Float32: ...  # noqa: D102
    @property
    def background(self) -> Float32: ...  # noqa: D102
    @property
    def mask(self) -> Bool: ...  # noqa: D102
    @property
    def views(self) -> Views: ...  # noqa: D102
    @property
    def shape(self) -> tuple[int, int, int]: ...  # noqa: D102


def plot_scan(scan: Projections, views: list[int] | None = None, counts: bool = False) -> Picture:
    """Draw some projections, with a scale bar on the panel and a colour bar.

    Pixels that were not measured stay blank.

    Parameters
    ----------
    scan : Scan
        What to draw.
    views : list of int, optional
        Which views. The default is up to eight, evenly spread.
    counts : bool, optional
        Draw counts instead of line integrals log(b / (y − r)).

    Returns
    -------
    Picture
        A Matplotlib figure.

    Raises
    ------
    DataError
        If a view does not exist.

    Examples
    --------
    >>> figure = pp.plot_scan(scan, views=[0, 4])
    """
    total, rows, columns = scan.shape
    chosen = np.unique(np.linspace(0, total - 1, min(VIEWS, total)).astype(int)).tolist() if views is None else views
    if not chosen or not all(0 <= k < total for k in chosen):
        raise DataError(f"views: {views!r} are not all there; the scan has views 0 to {total - 1}")
    pitch = scan.views.panels[0].pitch
    step = max(1, -(-max(rows, columns) // PIXELS))
    shown = [_view(scan, k, step, counts) for k in chosen]
    window = default_window(np.stack(shown))
    across = min(ACROSS, len(shown))
    size = (columns * pitch[1], rows * pitch[0])
    figure, frames = figure_of_frames([[size] * across] * -(-len(shown) // across))
    for frame, values, k in zip(frames, shown, chosen, strict=False):
        picture = draw_image(frame, values, size, window)
        title(frame, f"view {k}, {beam_in_words(scan.views, k).replace('source at', 'source')}")
    figure.colorbar(picture, cax=frames[-1], label="photons" if counts else "line integral")
    return figure


def scan_html(scan: Projections) -> str:
    """Shape, pitch, counts and a montage, for a notebook."""
    views, rows, columns = scan.shape
    dv, du = scan.views.panels[0].pitch
    masked = "" if scan.mask.all() else f", {1 - scan.mask.mean():.2%} of the pixels not measured"
    words = (
        f"Scan: {views} views of {rows} × {columns} pixels (rows, columns) of {dv:.3g} × {du:.3g} mm, counts "
        f"{value_range(scan.counts)}, incident {value_range(scan.incident)}{masked}"
    )
    return html_block(words, plot_scan(scan))


def _view(scan: Projections, k: int, step: int, counts: bool) -> AnyArray:
    y, b, r, measured = (a[k, ::step, ::step] for a in (scan.counts, scan.incident, scan.background, scan.mask))
    blank = np.float32(np.nan)
    if counts:
        return np.where(measured, y, blank)
    lines: Float32 = np.log(np.where(measured, b, np.float32(1)) / np.maximum(y - r, LEAST))
    return np.where(measured, lines, blank)
