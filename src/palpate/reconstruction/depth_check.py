"""Whether the object lies as deep as the grid was made for, and which mistake would move it there."""

from collections.abc import Iterator

import numpy as np

from palpate.arrays import Float64
from palpate.reconstruction.alternatives import mirrored_sweep, scaled_distance, with_views
from palpate.scans.consistency import CentreOfMass, centre_of_mass
from palpate.scans.finding import Finding
from palpate.scans.scan import Scan
from palpate.scans.views import Views
from palpate.volumes.grid import Grid

OFF, RIGHT = 0.25, 0.2  # of the grid's depth, from its middle: too far; near enough for a cause to be named
DISTANCES = (0.8, 1.25, 1 / 0.6)  # times that of the focal spots


def check_depth(scan: Scan, l: Float64, centre: CentreOfMass, grid: Grid, close: bool) -> list[Finding]:
    """Compare the depth of the object's centre, by the parallax of the views, with the depth of the grid.

    l: line integrals. close: whether the grid was made for the object, so that its middle is known to lie near the grid's.

    Tube and panel that turn the wrong way about an axis exchange what is before the axis and what is behind it. All views
    then fit an object at another depth, so the depth alone tells. A centre beyond the grid is an alarm, one that is merely
    far from the middle a note.
    """
    low, high = grid.bounds[:, 2]

    def off_middle(point: Float64) -> float:
        return float((point[2] - low) / (high - low) - 0.5)

    off = off_middle(centre.point)
    alarm = abs(off) > 0.5
    if abs(off) <= OFF or not (alarm or close):
        return []
    seen = f"parallax puts the object's centre at z {centre.point[2]:.4g} mm, the grid spans {low:.4g} to {high:.4g} mm"
    best: dict[str, tuple[float, str]] = {}
    for cause, words, views in _causes(scan.views):
        other = centre_of_mass(with_views(scan, views), l, centre.whole)
        left = abs(off_middle(other.point)) if other is not None else np.inf
        if left < min(RIGHT, best.get(cause, (np.inf, ""))[0]):
            best[cause] = left, words
    found = [
        Finding(cause, f"{seen}: {words}", alarm) for cause, (_, words) in sorted(best.items(), key=lambda c: c[1])
    ]
    return found or [Finding("object outside the grid", f"{seen}: check the distances, and the grid's z", alarm)]


def _causes(views: Views) -> Iterator[tuple[str, str, Views]]:
    """(cause, words, geometry without it) of the mistakes that move an object in depth."""
    for axis in ("column_axis", "row_axis"):
        words = "it would lie in its middle if the views ran the other way; check the sign of the angles and the order"
        yield "view order", words, mirrored_sweep(views, axis)
    for factor in DISTANCES:
        words = f"it would lie in its middle with {factor:.3g} times the distance of the focal spots"
        yield "source distance", words, scaled_distance(views, factor)
