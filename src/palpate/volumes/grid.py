"""The grid: positions of voxels in space."""

from dataclasses import dataclass

import numpy as np

from palpate.arrays import ArrayLike, Float64, as_numpy
from palpate.errors import GeometryError


@dataclass(frozen=True, eq=False, init=False)
class Grid:
    """A box of equal voxels.

    Parameters
    ----------
    shape : array_like, (3,)
        Number of voxels along (z, y, x).
    spacing : array_like, (3,)
        Voxel size along (z, y, x), mm.
    origin : array_like, (3,), optional
        Centre (x, y, z) of voxel (0, 0, 0), mm: a point, in the order of all points, not that of the axes. Write it by
        name. `Grid.centred` takes the middle of the box instead.
    direction : array_like, (3, 3), optional
        Rotation whose columns are the grid's x, y and z axes in patient space (LPS). File formats use it;
        reconstruction works in the grid's own frame. The default is the identity.

    Raises
    ------
    GeometryError
        If a length is not positive or `direction` is not a rotation.

    Examples
    --------
    >>> grid = pp.Grid(shape=(4, 5, 6), spacing=(3, 1, 1))
    >>> grid.size
    120
    >>> grid.bounds.tolist()
    [[-0.5, -0.5, -1.5], [5.5, 4.5, 10.5]]
    """

    shape: tuple[int, int, int]
    spacing: tuple[float, float, float]
    origin: tuple[float, float, float]
    direction: Float64

    def __init__(
        self, shape: ArrayLike, spacing: ArrayLike, origin: ArrayLike = (0, 0, 0), direction: ArrayLike | None = None
    ) -> None:
        def three(name: str, values: ArrayLike) -> Float64:
            array = np.asarray(as_numpy(f"grid {name}", values), dtype=np.float64)
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
        turn = np.eye(3) if direction is None else np.array(as_numpy("grid direction", direction), dtype=np.float64)
        if turn.shape != (3, 3) or not np.allclose(turn.T @ turn, np.eye(3), atol=1e-4):
            raise GeometryError(f"grid direction: expected a 3x3 rotation, got {direction!r}")
        if np.linalg.det(turn) < 0:
            raise GeometryError("grid direction: determinant -1 mirrors the patient; flip one axis of the data instead")
        turn.flags.writeable = False
        object.__setattr__(self, "shape", tuple(int(v) for v in n))
        object.__setattr__(self, "spacing", tuple(float(v) for v in d))
        object.__setattr__(self, "origin", tuple(float(v) for v in o))
        object.__setattr__(self, "direction", turn)

    @classmethod
    def centred(cls, shape: ArrayLike, spacing: ArrayLike, *, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> "Grid":
        """Return the box around a point.

        Parameters
        ----------
        shape : array_like, (3,)
            Number of voxels along (z, y, x).
        spacing : array_like, (3,)
            Voxel size along (z, y, x), mm.
        x, y, z : float, optional
            Middle of the box, mm. By name, so that no order can be mistaken.

        Returns
        -------
        Grid
            The box, in the axes of the scan.
        """
        at_zero = cls(shape, spacing)
        return cls(shape, spacing, origin=np.array([x, y, z]) - at_zero.bounds.mean(axis=0))

    def __repr__(self) -> str:
        nz, ny, nx = self.shape
        span = ", ".join(f"{a} {low:g} to {high:g}" for a, (low, high) in zip("xyz", self.bounds.T, strict=True))
        turned = "" if np.array_equal(self.direction, np.eye(3)) else ", turned"
        return f"Grid({nz} x {ny} x {nx} voxels (z, y, x), spacing {self.spacing} mm (z, y, x), {span} mm{turned})"

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
        """Volume of a voxel, mm³."""
        return float(np.prod(self.spacing))

    def axis(self, name: str) -> Float64:
        """Return the voxel centres along one axis, in the grid's own frame.

        Parameters
        ----------
        name : {"x", "y", "z"}
            The axis.

        Returns
        -------
        ndarray, (n,)
            Positions, mm.
        """
        i = "xyz".index(name)
        values: Float64 = self.origin[i] + self.spacing[2 - i] * np.arange(self.shape[2 - i], dtype=np.float64)
        return values

    @property
    def bounds(self) -> Float64:
        """Lowest and highest corner (x, y, z) of the box, (2, 3), mm, in the grid's own frame."""
        spacing, n = np.array(self.spacing[::-1]), np.array(self.shape[::-1])
        low = np.array(self.origin) - spacing / 2
        return np.stack([low, low + n * spacing])

    def points(self, indices: ArrayLike) -> Float64:
        """Return the positions of voxel indices in patient space.

        Parameters
        ----------
        indices : array_like, (N, 3)
            Indices in (z, y, x) order; they may be fractional.

        Returns
        -------
        ndarray, (N, 3)
            Positions (x, y, z), mm.
        """
        steps = np.atleast_2d(np.asarray(indices, dtype=np.float64))[:, ::-1] * np.array(self.spacing[::-1])
        points: Float64 = np.array(self.origin) + steps @ self.direction.T
        return points

    def indices(self, points: ArrayLike) -> Float64:
        """Return the voxel indices of positions: the inverse of `points`.

        Parameters
        ----------
        points : array_like, (N, 3)
            Positions (x, y, z) in patient space, mm.

        Returns
        -------
        ndarray, (N, 3)
            Fractional indices in (z, y, x) order.
        """
        steps = (np.atleast_2d(np.asarray(points, dtype=np.float64)) - np.array(self.origin)) @ self.direction
        return np.asarray((steps / np.array(self.spacing[::-1]))[:, ::-1], dtype=np.float64)
