"""A blade that follows a tissue's surface."""

import numpy as np

from palpate import _core
from palpate.arrays import ArrayLike, Float64, float64
from palpate.errors import DataError
from palpate.meshes.cutting.blade import Blade
from palpate.tissue.tissue import Tissue

FARTHEST = 4.0  # mean edges from the surface that a point of the way may lie: it leaves the organ there
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
        If the path has fewer than two points, one of them lies more than four mean edges off the surface, the depth is not
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
    if max(far) > FARTHEST * tissue.edge:
        bad = int(np.argmax(far))
        raise DataError(
            f"path: point {corners[bad].tolist()} lies {far[bad]:.3g} mm off the surface; give points on it"
        )
    given = None if direction is None else float64("direction", direction, (3,)).tolist()
    upper, way = _core.cutting.incision(tissue.surface, corners, STEP * tissue.edge, tissue.edge, given)
    if not any(way):
        raise DataError("direction: (0, 0, 0) points nowhere; give the way of the blade, such as (0, 0, -1)")
    return Blade.swept(upper, way, depth + tissue.edge)


def incision_way(tissue: Tissue, path: ArrayLike, direction: ArrayLike | None = None) -> Float64:
    """(3,) unit way into the tissue of the blade that `incision` gives, of one point or more; 0 if it has none."""
    given = None if direction is None else float64("direction", direction, (3,)).tolist()
    corners = float64("path", path, (None, 3))
    return np.array(_core.cutting.incision(tissue.surface, corners, STEP * tissue.edge, 0.0, given)[1])
