"""A picture of a scan: its projections beside each other."""

import numpy as np

from palpate.arrays import AnyArray, Float32
from palpate.errors import DataError
from palpate.scans.scan import Scan
from palpate.volumes.figures import Picture, block, framed, grey, title
from palpate.volumes.plots import PIXELS, value_range
from palpate.volumes.windows import default_window

VIEWS, ACROSS = 8, 4  # that a montage shows unless told which, and side by side
LEAST = np.float32(0.5)  # photons taken where none were counted above the background


def plot_scan(scan: Scan, views: list[int] | None = None, counts: bool = False) -> Picture:
    """Line integrals log(b / (y - r)), or counts, of some views, with a scale bar on the panel and a colour bar.

    views: which; None: up to eight, evenly spread. Pixels that were not measured are left blank. Raises `DataError`
    for a view that is not there.
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
    figure, frames = framed([[size] * across] * -(-len(shown) // across))
    for frame, values, k in zip(frames, shown, chosen, strict=False):
        picture = grey(frame, values, size, window)
        x, y, z = scan.views.source[k]
        title(frame, f"view {k}, source ({x:.0f}, {y:.0f}, {z:.0f}) mm")
    figure.colorbar(picture, cax=frames[-1], label="photons" if counts else "line integral")
    return figure


def scan_html(scan: Scan) -> str:
    """Shape, pitch, counts and a montage, for a notebook."""
    views, rows, columns = scan.shape
    dv, du = scan.views.panels[0].pitch
    masked = "" if scan.mask.all() else f", {1 - scan.mask.mean():.2%} of the pixels not measured"
    words = (
        f"Scan: {views} views of {rows} × {columns} pixels (rows, columns) of {dv:.3g} × {du:.3g} mm, counts "
        f"{value_range(scan.counts)}, incident {value_range(scan.incident)}{masked}"
    )
    return block(words, plot_scan(scan))


def _view(scan: Scan, k: int, step: int, counts: bool) -> AnyArray:
    y, b, r, measured = (a[k, ::step, ::step] for a in (scan.counts, scan.incident, scan.background, scan.mask))
    blank = np.float32(np.nan)
    if counts:
        return np.where(measured, y, blank)
    lines: Float32 = np.log(np.where(measured, b, np.float32(1)) / np.maximum(y - r, LEAST))
    return np.where(measured, lines, blank)
