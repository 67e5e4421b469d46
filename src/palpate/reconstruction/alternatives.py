"""Scans as they would be without a mistake that is often made: what to compare a scan with that fits badly."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from palpate.arrays import Bool, Float32, Float64
from palpate.scans.scan import Scan
from palpate.scans.views import Panel, Views

IMAGES = {  # what was done to the images: rows and columns exchanged, rows reversed, columns reversed
    "axis flipped": (
        ("the rows run the other way: check row_axis", False, True, False),
        ("the columns run the other way: check column_axis", False, False, True),
        ("the images are upside down: check row_axis and column_axis", False, True, True),
    ),
    "axes exchanged": (
        (
            "rows and columns are exchanged: check the panel's axes, and the order of the stack's axes",
            True,
            False,
            False,
        ),
        ("the panel is turned by 90°: check its axes", True, True, False),
        ("the panel is turned by 90° the other way: check its axes", True, False, True),
        ("rows and columns are exchanged and reversed: check the panel's axes", True, True, True),
    ),
}
PITCHES = (0.5, 2.0)
DISTANCES = (0.6, 0.8, 1.25, 1 / 0.6)


@dataclass(frozen=True, eq=False)
class Alternative:
    """A scan without one mistake, and how to say that mistake."""

    cause: str
    words: str
    scan: Scan


def alternatives(scan: Scan) -> Iterator[Alternative]:
    """What the scan would be if one thing about its geometry or its counts were otherwise."""
    views = scan.views
    order = "the views run the other way: check the sign of the angles and the order of the files"
    yield Alternative("view order", order, with_views(scan[::-1], views))
    for axis in ("column_axis", "row_axis") if one_sided(views) else ():
        yield Alternative("view order", order, with_views(scan, mirrored_sweep(views, axis)))
    for cause, ways in IMAGES.items():
        for words, exchange, rows, columns in ways:
            yield Alternative(cause, words, turned_images(scan, exchange, rows, columns))
    for factor in PITCHES:
        words = f"the views agree better with {factor:g} times the pixel pitch"
        yield Alternative("pixel pitch", words, with_views(scan, scaled_pitch(views, factor)))
    for factor in DISTANCES:
        words = f"the views agree better with {factor:.3g} times the distance of the focal spots"
        yield Alternative("source distance", words, with_views(scan, scaled_distance(views, factor)))


def other_values(scan: Scan) -> Iterator[Alternative]:
    """What the scan would be if its numbers were no counts."""
    top = np.float32(max(scan.incident.max(), scan.counts.max()))
    for words, counts in (
        ("the numbers grow where the object is dense: are the counts inverted?", top - scan.counts),
        ("the numbers grow where the object is dense: are they line integrals?", _of_line_integrals(scan, top)),
    ):
        cause = "inverted counts" if "inverted" in words else "line integrals"
        yield Alternative(cause, words, Scan(np.maximum(counts, 0), top, scan.views, 0, scan.mask))


def _of_line_integrals(scan: Scan, top: np.float32) -> Float32:
    """Counts behind the numbers taken as line integrals, scaled so that the largest is 3."""
    largest = max(float(np.quantile(scan.counts[scan.mask], 0.999)), 1e-9)
    return np.asarray(top * np.exp(-3 * np.minimum(scan.counts / largest, 1.5)), np.float32)


def with_views(scan: Scan, views: Views) -> Scan:
    """The same data with another geometry."""
    return Scan(scan.counts, scan.incident, views, scan.background, scan.mask)


def one_sided(views: Views) -> bool:
    """Whether the panels face about one way, so that there is a mean axis to mirror a sweep across."""
    return bool(np.linalg.norm(np.mean([p.normal for p in views.panels], axis=0)) > 0.5)


def mirrored_sweep(views: Views, axis: str) -> Views:
    """The tube moves the other way along an axis of the panel: sources and panels mirrored, images as they are.

    The mirror is the plane through the middle of all panels across their mean axis. An axis that the mirror reverses is
    reversed again, so that pixel (r, c) is still pixel (r, c).
    """
    middles = np.array([_middle(p) for p in views.panels])
    across = np.mean([getattr(p, axis) for p in views.panels], axis=0)
    across = across / np.linalg.norm(across)

    def mirror(vectors: Float64) -> Float64:
        return np.asarray(vectors - 2 * np.multiply.outer(vectors @ across, across))

    centre = middles.mean(axis=0)
    sources = centre + mirror(views.source - centre)
    panels = []
    for panel, middle in zip(views.panels, middles, strict=True):
        axes = {name: mirror(getattr(panel, name)) for name in ("row_axis", "column_axis")}
        axes[axis] = -axes[axis]
        panels.append(centred_panel(panel.shape, panel.pitch, centre + mirror(middle - centre), **axes))
    return Views(sources, panels, views.direction)


def turned_images(scan: Scan, exchange: bool, rows: bool, columns: bool) -> Scan:
    """Images transposed, then with rows or columns reversed; the panel keeps its middle and its axes."""

    def turned(a: Float32 | Bool) -> Float32 | Bool:
        a = np.swapaxes(a, 1, 2) if exchange else a
        return a[:, :: -1 if rows else 1, :: -1 if columns else 1]

    def placed(panel: Panel) -> Panel:
        if not exchange:
            return panel
        return centred_panel(panel.shape[::-1], panel.pitch[::-1], _middle(panel), panel.row_axis, panel.column_axis)

    views = Views(scan.views.source, [placed(p) for p in scan.views.panels], scan.views.direction)
    y, b, r, mask = (turned(a) for a in (scan.counts, scan.incident, scan.background, scan.mask))
    return Scan(y, b, views, r, mask)


def scaled_pitch(views: Views, factor: float) -> Views:
    """Another pixel pitch; the middle of each panel stays."""
    panels = [
        centred_panel(p.shape, (p.pitch[0] * factor, p.pitch[1] * factor), _middle(p), p.row_axis, p.column_axis)
        for p in views.panels
    ]
    return Views(views.source, panels, views.direction)


def scaled_distance(views: Views, factor: float) -> Views:
    """Focal spots nearer to the middle of all panels, or farther."""
    centre = np.mean([_middle(p) for p in views.panels], axis=0)
    return Views(centre + factor * (views.source - centre), views.panels, views.direction)


def centred_panel(
    shape: tuple[int, int], pitch: tuple[float, float], middle: Float64, row_axis: Float64, column_axis: Float64
) -> Panel:
    """A panel by its middle."""
    at_zero = Panel(shape, pitch, (0, 0, 0), row_axis, column_axis)
    return Panel(shape, pitch, middle - at_zero.points((np.array(shape) - 1) / 2)[0], row_axis, column_axis)


def _middle(panel: Panel) -> Float64:
    return np.asarray(panel.points((np.array(panel.shape) - 1) / 2)[0])
