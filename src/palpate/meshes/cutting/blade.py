"""The surface that a blade sweeps."""

from dataclasses import dataclass

import numpy as np

from palpate import _core
from palpate.arrays import ArrayLike, Float64, Int32, float64
from palpate.errors import DataError

MOST_TRIANGLES = 100_000
LEAST_HEIGHT = 1e-6  # mm: a flatter triangle has no plane


@dataclass(frozen=True, eq=False, init=False)
class Blade:
    """The surface that a blade sweeps: triangles in space, of any shape, open or closed.

    Parameters
    ----------
    points : array_like, (P, 3)
        Corners (x, y, z), mm.
    triangles : array_like, (F, 3)
        Indices of the corners. Triangles that share an edge share its two corners. The side to which the normals of most
        triangles point is side 1 of the cut, the other one is side -1.

    Raises
    ------
    DataError
        If an index is out of range, or a triangle is flat.

    Examples
    --------
    >>> blade = pp.Blade([(0, 0, 0), (20, 0, 0), (0, 0, 20)], [(0, 1, 2)])
    >>> blade.area
    200.0
    """

    points: Float64
    triangles: Int32

    def __init__(self, points: ArrayLike, triangles: ArrayLike) -> None:
        x = float64("points", points, (None, 3)).copy(order="C")
        t = np.array(triangles, order="C")
        if t.ndim != 2 or t.shape[1] != 3 or not 0 < len(t) <= MOST_TRIANGLES or t.dtype.kind not in "iu":
            raise DataError(
                f"triangles: expected whole numbers of shape (F, 3), F from 1 to {MOST_TRIANGLES}, got {t.shape} {t.dtype}"
            )
        if t.min() < 0 or t.max() >= len(x):
            raise DataError(f"triangles: point {int(t.max())} or {int(t.min())}; points are 0 to {len(x) - 1}")
        corner = x[t]
        longest = np.linalg.norm(corner - corner[:, [1, 2, 0]], axis=2).max(axis=1)
        twice = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
        if (twice <= LEAST_HEIGHT * longest).any():
            bad = int(np.argmax(twice <= LEAST_HEIGHT * longest))
            raise DataError(
                f"triangles: triangle {bad} with corners {np.round(corner[bad], 6).tolist()} is flat; give a blade a width"
            )
        for name, value in (("points", x), ("triangles", t.astype(np.int32))):
            value.flags.writeable = False
            object.__setattr__(self, name, value)

    @classmethod
    def swept(cls, path: ArrayLike, direction: ArrayLike, depth: float) -> "Blade":
        """Return what a straight edge sweeps that goes along a path.

        Parts that lie in one plane but for a millionth of the path's length are made to lie in it.

        Parameters
        ----------
        path : array_like, (P, 3)
            Where the edge's upper end goes, a polyline, mm; curved if it has many points.
        direction : array_like, (3,)
            From the upper end to the tip, any length.
        depth : float
            Length of the edge, mm.

        Returns
        -------
        Blade
            Two triangles for each part of the path.

        Raises
        ------
        DataError
            If the path has fewer than two points, runs along the edge, or the depth is not positive.
        """
        x = float64("path", path, (None, 3))
        way = float64("direction", direction, (3,))
        length = float(np.linalg.norm(way))
        if len(x) < 2:
            raise DataError(f"path: {len(x)} points; give two or more")
        if length == 0:
            raise DataError("direction: (0, 0, 0) points nowhere; give the way from the blade's upper end to its tip")
        if not (np.isfinite(depth) and depth > 0):
            raise DataError(f"depth: {depth} mm; give a finite depth above 0")
        if len(x) > 2 and np.isfinite(x).all():
            x = _core.cutting.straightened(x, way.tolist())
        k, n = np.arange(len(x) - 1), len(x)
        triangles = np.concatenate([np.stack([k, k + 1, k + 1 + n], axis=1), np.stack([k, k + 1 + n, k + n], axis=1)])
        return cls(np.concatenate([x, x + depth / length * way]), triangles)

    @property
    def area(self) -> float:
        """Of all triangles, mm²."""
        a, b, c = (self.points[self.triangles[:, k]] for k in range(3))
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)
