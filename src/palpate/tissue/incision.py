"""A blade that follows a tissue's surface."""

from itertools import pairwise

import numpy as np

from palpate.arrays import ArrayLike, Float64, float64
from palpate.errors import DataError
from palpate.meshes.cutting.blade import Blade
from palpate.tissue.tissue import Tissue

STEP = 2.0  # mean edges between the points at which the blade follows the surface


def incision(tissue: Tissue, path: ArrayLike, depth: float, direction: ArrayLike | None = None) -> Blade:
    """Return a blade that goes along a path on a tissue's surface, everywhere equally deep in it.

    Parameters
    ----------
    tissue : Tissue
        The tissue.
    path : array_like, (P, 3)
        Points on the surface or near it, mm: where the cut begins, turns and ends.
    depth : float
        How far the blade's tip is below the surface, mm, along its direction.
    direction : array_like, (3,), optional
        Way of the blade into the tissue. The default is against the surface's mean normal along the path.

    Returns
    -------
    Blade
        For `cut`. It begins a mean edge above the surface.

    Raises
    ------
    DataError
        If the path has fewer than two points, one of them lies more than a mean edge off the surface, the depth is not
        positive, or the direction is zero.

    Examples
    --------
    >>> blade = pp.incision(tissue, [top - (8, 0, 0), top + (8, 0, 0)], depth=10)
    >>> opened = pp.cut(tissue, blade)
    """
    corners = float64("path", path, (None, 3))
    if len(corners) < 2:
        raise DataError(f"path: {len(corners)} points; give two or more")
    if not (np.isfinite(depth) and depth > 0):
        raise DataError(f"depth: {depth} mm; give a finite depth above 0")
    far = [float(tissue.surface.closest(x).distance) for x in corners]
    if max(far) > tissue.edge:
        bad = int(np.argmax(far))
        raise DataError(
            f"path: point {corners[bad].tolist()} lies {far[bad]:.3g} mm off the surface; give points on it"
        )
    points = _along(corners, STEP * tissue.edge)
    hits = [tissue.surface.closest(x) for x in points]
    way = _way(direction, np.mean([tissue.surface.normal(hit) for hit in hits], axis=0))
    on = np.array([x + way * (way @ (hit.point - x)) for x, hit in zip(points, hits, strict=True)])
    return Blade.swept(on - tissue.edge * way, way, depth + tissue.edge)


def _way(direction: ArrayLike | None, normal: Float64) -> Float64:
    way = -normal if direction is None else float64("direction", direction, (3,))
    length = float(np.linalg.norm(way))
    if not length > 1e-6:
        raise DataError("direction: (0, 0, 0) points nowhere; give the way of the blade, such as (0, 0, -1)")
    return np.asarray(way / length)


def _along(corners: Float64, step: float) -> Float64:
    """Points of a polyline, its corners among them, no farther from each other than `step` mm."""
    points = [corners[:1]]
    for a, b in pairwise(corners):
        parts = max(1, int(np.ceil(np.linalg.norm(b - a) / step)))
        points.append(a + np.arange(1, parts + 1)[:, None] / parts * (b - a))
    return np.concatenate(points)
