"""Line integrals of a volume along the rays of a scan, and their exact transpose."""

import math
import warnings
from abc import ABC, abstractmethod

import numpy as np

from palpate import _core
from palpate.arrays import ArrayLike, Float32, Float64, as_numpy, float32
from palpate.errors import DataError, GeometryError
from palpate.reconstruction.slicing import ORDER, slicings
from palpate.scans.views import Views
from palpate.volumes.grid import Grid

TOLERANCE = 3e-3  # relative L2 error of a view of independent voxel values, uniform in [0, 1]
UPRIGHT = (
    "works for focal spots above the slices only (z = constant, central rays within 60° of z); for other views take "
    "the methods map or ml with the optimizers auto, momentum or subsets, or tv, sirt, sart, backprojection"
)


class LinearMap(ABC):
    """What a projector and its transpose share: `A @ x`, and what `scipy.sparse.linalg.aslinearoperator(A)` asks for."""

    dtype = np.dtype(np.float32)
    domain_shape: tuple[int, int, int]
    range_shape: tuple[int, int, int]
    T: "LinearMap"

    @abstractmethod
    def __call__(self, x: ArrayLike, out: Float32 | None = None) -> Float32:
        """A x, of shape `range_shape`."""

    def __matmul__(self, x: ArrayLike) -> Float32:
        return self(x)

    @property
    def shape(self) -> tuple[int, int]:
        """Of the matrix: (size of the range, size of the domain)."""
        return math.prod(self.range_shape), math.prod(self.domain_shape)

    def matvec(self, x: ArrayLike) -> Float32:
        """A x of a flat array, as a flat array."""
        return self(as_numpy("x", x).reshape(self.domain_shape)).ravel()

    def rmatvec(self, y: ArrayLike) -> Float32:
        """Aᵀ y of a flat array, as a flat array."""
        return self.T.matvec(y)


class Projector(LinearMap):
    """The linear map from a volume to its projections.

    `A(x)` gives the line integrals averaged over each pixel. `A.T(p)` is the exact transpose. On each slice the weights
    are products of one-dimensional weights in x and y.

    Parameters
    ----------
    views : Views
        The geometry.
    grid : Grid
        The voxels, in the grid's own frame.
    tolerance : float, optional
        Largest relative L2 error of a view against exact line integrals, for voxels that are independent and uniform in
        [0, 1]. Smooth volumes err far less. A smaller tolerance takes more time. It holds for panels that are parallel to
        the slices or turned about one axis alone. Any other panel is averaged from a parallel one of half its pitch (errors
        of about 1 %), or of a fifth (0.3 %) if the tolerance is below 3e-3 or the view does not look from above.

    Attributes
    ----------
    T : Transpose
        The transpose.
    domain_shape, range_shape : tuple of int
        Shapes of the volume and of the projections.

    Raises
    ------
    GeometryError
        If the grid reaches a focal spot or lies behind a panel, or if no ray meets it.

    References
    ----------
    De Man & Basu, Phys. Med. Biol. 49:2463, 2004 (distance-driven weights). Long, Fessler & Balter, IEEE TMI 29:1839,
    2010 (separable footprints).

    Examples
    --------
    >>> A = pp.Projector(views, grid)
    >>> p = A(volume.values)
    >>> x = np.random.default_rng(0).random(grid.shape)
    >>> float(np.vdot(A(x), p)) == pytest.approx(float(np.vdot(x, A.T(p))), rel=1e-5)
    True
    """

    def __init__(self, views: Views, grid: Grid, tolerance: float = TOLERANCE) -> None:
        if not 1e-6 <= tolerance <= 0.5:
            raise GeometryError(f"tolerance: expected a relative error between 1e-6 and 0.5, got {tolerance!r}")
        check_field_of_view(views, grid)
        self.views, self.grid, self.tolerance = views, grid, tolerance
        self.domain_shape, self.range_shape = grid.shape, views.shape
        self.slicings = slicings(views, grid, tolerance)
        self.T: Transpose = Transpose(self)

    def __call__(self, x: ArrayLike, out: Float32 | None = None) -> Float32:
        """Projections (views, rows, columns) of a volume (z, y, x). Raises `DataError`."""
        values = float32("volume", x, self.domain_shape)
        out = _output(out, self.range_shape)
        self.project(values, out)
        return out

    @property
    def upright(self) -> bool:
        """Whether all views look at the slices z = constant from above."""
        return len(self.slicings) == 1 and self.slicings[0].upright

    @property
    def geometry(self) -> _core.projection.ScanGeometry:
        """Views and grid as the kernels see them. Raises `GeometryError` unless all look at the slices from above."""
        check_upright(self, "this")
        return self.slicings[0].geometry

    def project(self, values: Float32, out: Float32) -> None:
        """Write A values, without the checks of a call.

        Parameters
        ----------
        values : ndarray, (z, y, x)
            The volume, C-contiguous float32.
        out : ndarray, (views, rows, columns)
            Where the projections go, likewise.
        """
        for s in self.slicings:
            if len(s.views) == len(self.views):
                _core.projection.project(s.geometry, values if s.upright else s.sliced(values), out)
                return
            some = np.empty((len(s.views), *self.range_shape[1:]), np.float32)
            _core.projection.project(s.geometry, s.sliced(values), some)
            out[s.views] = some

    def backproject(self, p: Float32, out: Float32) -> None:
        """Write Aᵀ p, without the checks of a call.

        Parameters
        ----------
        p : ndarray, (views, rows, columns)
            The projections, C-contiguous float32.
        out : ndarray, (z, y, x)
            Where the volume goes, likewise.
        """
        if self.upright:
            _core.projection.backproject(self.slicings[0].geometry, p, out)
            return
        for k, s in enumerate(self.slicings):
            some = p if len(s.views) == len(self.views) else np.ascontiguousarray(p[s.views])
            sliced = np.empty([self.domain_shape[axis] for axis in ORDER[s.axis]], np.float32)
            _core.projection.backproject(s.geometry, some, sliced)
            s.put(sliced, out, add=k > 0)

    def project_slices(self, first: int, end: int, values: Float32, out: Float32) -> None:
        """Write the line integrals through some slices, or add them where slices before them have been projected.

        Parameters
        ----------
        first, end : int
            The slices `first` to `end` - 1; all of them, unless all views are `upright`.
        values : ndarray, (z, y, x)
            The volume, C-contiguous float32.
        out : ndarray, (views, rows, columns)
            Where the projections go, likewise: written from slice 0 on, added to from any other.
        """
        if (first, end) == (0, self.domain_shape[0]):
            self.project(values, out)
        else:
            _core.projection.project(self.geometry.slices(first, end), values[first:end], out, add=first > 0)

    def backproject_slices(self, first: int, end: int, p: Float32, out: Float32) -> None:
        """Write some slices of Aᵀ p.

        Parameters
        ----------
        first, end : int
            The slices `first` to `end` - 1; all of them, unless all views are `upright`.
        p : ndarray, (views, rows, columns)
            The projections, C-contiguous float32.
        out : ndarray, (z, y, x)
            The volume in which these slices are written.
        """
        if (first, end) == (0, self.domain_shape[0]):
            self.backproject(p, out)
        else:
            _core.projection.backproject(self.geometry.slices(first, end), p, out[first:end])


class Transpose(LinearMap):
    """A.T: projections back into the volume. A.T.T is A."""

    def __init__(self, projector: Projector) -> None:
        self.T: Projector = projector
        self.domain_shape, self.range_shape = projector.range_shape, projector.domain_shape

    def __call__(self, p: ArrayLike, out: Float32 | None = None) -> Float32:
        """Volume (z, y, x) of projections (views, rows, columns). Raises `DataError`."""
        values = float32("projections", p, self.domain_shape)
        out = _output(out, self.range_shape)
        self.T.backproject(values, out)
        return out


def check_upright(A: Projector, what: str) -> None:
    """Raises `GeometryError`, naming what asks for it, unless all views look at the slices from above."""
    if not A.upright:
        raise GeometryError(f"{what} {UPRIGHT}")


def check_field_of_view(views: Views, grid: Grid) -> None:
    """Raises `GeometryError` unless the grid lies between sources and panels and some ray meets it."""
    corners = _corners(grid)
    shadow_low, shadow_high = [], []
    missing = []
    for view, (source, panel) in enumerate(zip(views.source, views.panels, strict=True)):
        towards = np.sign((source - panel.origin) @ panel.normal) * panel.normal
        height = (corners - panel.origin) @ towards
        if height.max() <= 0:
            raise GeometryError(
                f"geometry misses the volume: the grid lies behind the panel of view {view} (nearest corner "
                f"{-height.max():g} mm behind); move the grid's origin or the panel"
            )
        if height.max() >= (source - panel.origin) @ towards:
            raise GeometryError(
                f"grid reaches behind the focal spot of view {view} at {_mm(source)}, as seen from its panel: it spans "
                f"{grid.bounds.tolist()} mm, and the object lies between source and panel; lower the grid's origin, or check "
                f"the panel's origin and axes"
            )
        # Only the part of the box in front of the panel has a shadow on it.
        landed = views[view].project(corners[height > 0])[0]
        shadow_low.append(landed.min(axis=0))
        shadow_high.append(landed.max(axis=0))
        if (landed.max(axis=0) <= -0.5).any() or (landed.min(axis=0) >= np.array(panel.shape) - 0.5).any():
            missing.append(view)
    if len(missing) == len(views):
        low, high = np.min(shadow_low, axis=0), np.max(shadow_high, axis=0)
        raise GeometryError(
            f"geometry misses the volume: its shadow covers rows {low[0]:.0f} to {high[0]:.0f} and columns "
            f"{low[1]:.0f} to {high[1]:.0f}, but the panel has rows 0 to {views.shape[1] - 1} and columns 0 to "
            f"{views.shape[2] - 1}; check the grid's origin, the panel's origin and axes, and the units"
        )
    if missing:  # possible for a wide sweep over a small object, but seldom intended
        warnings.warn(f"the volume's shadow misses the panel in views {missing}; they tell nothing of it", stacklevel=3)


def _mm(point: Float64) -> str:
    return "(" + ", ".join(f"{value:g}" for value in point) + ") mm"


def _corners(grid: Grid) -> Float64:
    low, high = grid.bounds
    return np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])


def _output(out: Float32 | None, shape: tuple[int, int, int]) -> Float32:
    if out is None:
        return np.empty(shape, dtype=np.float32)
    if out.shape != shape or out.dtype != np.float32 or not out.flags.c_contiguous:
        raise DataError(f"out: expected a C-contiguous float32 array of shape {shape}, got {out.shape} {out.dtype}")
    return out
