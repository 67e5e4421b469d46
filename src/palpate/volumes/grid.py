"""Where voxels are."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import Float64
from palpate.errors import GeometryError


@dataclass(frozen=True, eq=False, init=False)
class Grid:
    """A box of equal voxels.

    shape: voxels along (z, y, x). spacing: mm along (z, y, x). origin: centre (x, y, z) of voxel (0, 0, 0), mm.
    direction: 3x3 rotation whose columns are the grid's x, y, z axes in patient space (LPS); it serves the file
    formats, reconstruction works in the grid's own frame. Raises `GeometryError`.
    """

    shape: tuple[int, int, int]
    spacing: tuple[float, float, float]
    origin: tuple[float, float, float]
    direction: Float64

    def __init__(
        self, shape: ArrayLike, spacing: ArrayLike, origin: ArrayLike = (0, 0, 0), direction: ArrayLike | None = None
    ) -> None:
        def three(name: str, values: ArrayLike) -> Float64:
            array = np.asarray(values, dtype=np.float64)
            if array.shape != (3,) or not np.isfinite(array).all():
                raise GeometryError(f"grid {name}: expected 3 finite numbers, got {values!r}")
            return array

        n, d, o = three("shape", shape), three("spacing", spacing), three("origin", origin)
        if (n < 1).any() or (n != np.round(n)).any():
            raise GeometryError(f"grid shape: expected 3 whole numbers (z, y, x) of at least 1, got {shape!r}")
        if (d <= 0).any():
            raise GeometryError(f"grid spacing: expected 3 positive lengths (z, y, x) in mm, got {spacing!r}")
        if (n * d > 10_000).any() or (d < 1e-4).any():
            raise GeometryError(
                f"grid spacing {d.tolist()} mm makes a box of {(n * d).tolist()} mm; lengths are mm: check the units"
            )
        turn = np.eye(3) if direction is None else np.array(direction, dtype=np.float64)
        if turn.shape != (3, 3) or not np.allclose(turn.T @ turn, np.eye(3), atol=1e-4):
            raise GeometryError(f"grid direction: expected a 3x3 rotation, got {direction!r}")
        if np.linalg.det(turn) < 0:
            raise GeometryError("grid direction: determinant -1 mirrors the patient; flip one axis of the data instead")
        turn.flags.writeable = False
        object.__setattr__(self, "shape", tuple(int(v) for v in n))
        object.__setattr__(self, "spacing", tuple(float(v) for v in d))
        object.__setattr__(self, "origin", tuple(float(v) for v in o))
        object.__setattr__(self, "direction", turn)

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Grid)
            and self.shape == other.shape
            and np.allclose(self.spacing, other.spacing, rtol=1e-5)
            and np.allclose(self.origin, other.origin, atol=1e-3 * min(self.spacing))
            and np.allclose(self.direction, other.direction, atol=1e-4)
        )

    __hash__ = None  # type: ignore[assignment]

    @property
    def size(self) -> int:
        """Number of voxels."""
        return int(np.prod(self.shape, dtype=np.int64))

    @property
    def voxel_volume(self) -> float:
        """mm³."""
        return float(np.prod(self.spacing))

    def axis(self, name: str) -> Float64:
        """Voxel centres along "x", "y" or "z" in the grid's own frame, mm."""
        i = "xyz".index(name)
        values: Float64 = self.origin[i] + self.spacing[2 - i] * np.arange(self.shape[2 - i], dtype=np.float64)
        return values

    @property
    def bounds(self) -> Float64:
        """(2, 3): the lowest and highest corner of the box (outer voxel faces) in x, y, z, mm, grid's own frame."""
        spacing, n = np.array(self.spacing[::-1]), np.array(self.shape[::-1])
        low = np.array(self.origin) - spacing / 2
        return np.stack([low, low + n * spacing])

    def points(self, indices: ArrayLike) -> Float64:
        """Positions (N, 3) in x, y, z mm, patient space, of (possibly fractional) indices (N, 3) in z, y, x order."""
        steps = np.atleast_2d(np.asarray(indices, dtype=np.float64))[:, ::-1] * np.array(self.spacing[::-1])
        points: Float64 = np.array(self.origin) + steps @ self.direction.T
        return points

    def indices(self, points: ArrayLike) -> Float64:
        """Fractional indices (N, 3) in z, y, x order of positions (N, 3) in x, y, z mm: the inverse of `points`."""
        steps = (np.atleast_2d(np.asarray(points, dtype=np.float64)) - np.array(self.origin)) @ self.direction
        return np.asarray((steps / np.array(self.spacing[::-1]))[:, ::-1], dtype=np.float64)
