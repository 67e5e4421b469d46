"""Where the object lies in the grid: whether it is inside, in the middle, and as large as the grid was made for."""

import numpy as np

from palpate.arrays import Float64
from palpate.scans.finding import Finding
from palpate.volumes.grid import Grid

TOLERATED, FEW_TOLERATED = (
    0.5,
    2.0,
)  # pixels by which the object may seem to reach beyond the grid; seen whole by few views
CLOSE = 0.75  # of the grid's width: a grid around an object that is wider was made for it
OFF_MIDDLE = 2.0  # pixels off the middle of a grid that was made for the object, or for the field
SMALL, NARROW = 0.6, 0.9  # of the grid's width: an object and a field that are too small for it
ALIKE = 0.85  # least ratio of the widths of grid and field: the grid was made for the field


def check_outline(outline: Float64, grid: Grid, field: Float64, pixel: float, few: bool) -> list[Finding]:
    """Whether the object, which some views show whole, lies in the grid; its depth is too blurred to be judged.

    outline: (2, 2), lowest and highest (x, y) of the object, mm. field: the same of what the median view sees.
    few: whether few of the views show the whole object, so that its outline is less certain.
    """
    room = outline[0] - grid.bounds[0, :2], grid.bounds[1, :2] - outline[1]
    spans = [
        f"{name} {low:.4g} to {high:.4g} mm, the grid {first:.4g} to {last:.4g} mm"
        for name, (low, high), (first, last) in zip("xy", outline.T, grid.bounds.T[:2], strict=True)
    ]
    beyond = np.minimum(*room) < -(FEW_TOLERATED if few else TOLERATED) * pixel
    if beyond.any():
        where = " and ".join(span for span, out in zip(spans, beyond, strict=True) if out)
        words = f"the views put the object at {where}: check the origins of the grid and of the panel"
        return [Finding("object outside the grid", words)]
    filled, seen = (float((np.ptp(a, axis=0) / np.ptp(grid.bounds[:, :2], axis=0)).min()) for a in (outline, field))
    if filled < SMALL and seen < NARROW:
        words = (
            f"the views put the object at {' and '.join(spans)}, and see {seen:.0%} of the grid's width: the object is "
            f"{1 / filled:.2g} times smaller than the grid; are pitch, distances and units right?"
        )
        return [Finding("pixel pitch", words)]
    return _off_middle(room[0] - room[1], pixel, "the object, at " + " and ".join(spans)) if filled > CLOSE else []


def check_field(field: Float64, grid: Grid, pixel: float) -> list[Finding]:
    """Whether a grid that is as wide as what the views see of a truncated object lies there.

    field: (2, 2), lowest and highest (x, y) of the box that at least half of the views see, mm.
    """
    ratio = np.ptp(field, axis=0) / np.ptp(grid.bounds[:, :2], axis=0)
    if min(ratio.min(), 1 / ratio.max()) < ALIKE:
        return []
    spans = " and ".join(
        f"{name} {low:.4g} to {high:.4g} mm, the grid {first:.4g} to {last:.4g} mm"
        for name, (low, high), (first, last) in zip("xy", field.T, grid.bounds.T[:2], strict=True)
    )
    return _off_middle((field - grid.bounds[:, :2]).sum(axis=0), pixel, f"the field of the views, {spans},")


def _off_middle(unequal: Float64, pixel: float, what: str) -> list[Finding]:
    """A note, for a common shift of all panels has no other sign: the data fit an object that is moved and sheared."""
    off = unequal / 2
    if np.abs(off).max() <= OFF_MIDDLE * pixel:
        return []
    words = (
        f"{what} lies {off[0]:+.3g} mm in x and {off[1]:+.3g} mm in y off the grid's middle: if the grid was put around it, "
        f"check the panel's origin; no data can tell a shift of all panels"
    )
    return [Finding("panel shifted", words, alarm=False)]
