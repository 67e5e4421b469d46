"""Views: one focal spot and one flat panel for each projection."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.arrays import ArrayLike, Bool, Float64, as_numpy
from palpate.errors import GeometryError

FAR = 10_000.0  # mm; no X-ray room is longer, but 1,500 mm given in micrometres is
PARALLEL = 1e8  # mm; rays from so far away are parallel: over 500 mm of depth they part by less than 0.003 mm


@dataclass(frozen=True, eq=False, init=False)
class Panel:
    """A flat panel: where its pixels are.

    Parameters
    ----------
    shape : array_like, (2,)
        Number of (rows, columns).
    pitch : array_like, (2,)
        Distance between rows and between columns, mm.
    origin : array_like, (3,)
        Centre (x, y, z) of pixel (0, 0), mm.
    row_axis, column_axis : array_like, (3,), optional
        Directions in which the row and the column index grow. They must be orthogonal and are made unit length.

    Raises
    ------
    GeometryError
        If a length is not positive or the axes are not orthogonal.

    Examples
    --------
    >>> panel = pp.Panel(shape=(40, 48), pitch=(2, 2), origin=(-47, -39, 0))
    >>> panel.points([(0, 0), (39, 47)]).tolist()
    [[-47.0, -39.0, 0.0], [47.0, 39.0, 0.0]]
    """

    shape: tuple[int, int]
    pitch: tuple[float, float]
    origin: Float64
    row_axis: Float64
    column_axis: Float64

    def __init__(
        self,
        shape: ArrayLike,
        pitch: ArrayLike,
        origin: ArrayLike,
        row_axis: ArrayLike = (0, 1, 0),
        column_axis: ArrayLike = (1, 0, 0),
    ) -> None:
        n, d = _numbers("panel shape", shape, 2), _numbers("panel pitch", pitch, 2)
        o = _numbers("panel origin", origin, 3)
        row, column = _numbers("panel row_axis", row_axis, 3), _numbers("panel column_axis", column_axis, 3)
        if (n < 1).any() or (n != np.round(n)).any():
            raise GeometryError(f"panel shape: expected 2 whole numbers (rows, columns) of at least 1, got {shape!r}")
        if (d <= 0).any():
            raise GeometryError(f"panel pitch: expected 2 positive lengths (dv, du) in mm, got {pitch!r}")
        if (n * d > FAR).any() or (np.abs(o) > FAR).any():
            raise GeometryError(
                f"panel of {(n * d).tolist()} mm at {o.tolist()} mm exceeds {FAR:g} mm; check the units"
            )
        lengths = np.linalg.norm(row), np.linalg.norm(column)
        if min(lengths) < 1e-9 or abs(row @ column) > 1e-6 * lengths[0] * lengths[1]:
            raise GeometryError(
                f"panel axes: row_axis {row.tolist()} and column_axis {column.tolist()} are not orthogonal directions"
            )
        object.__setattr__(self, "shape", (int(n[0]), int(n[1])))
        object.__setattr__(self, "pitch", (float(d[0]), float(d[1])))
        object.__setattr__(self, "origin", _frozen(o))
        object.__setattr__(self, "row_axis", _frozen(row / lengths[0]))
        object.__setattr__(self, "column_axis", _frozen(column / lengths[1]))

    @property
    def normal(self) -> Float64:
        """Unit vector column_axis × row_axis. It points to the source if the panel is not mirrored."""
        return np.cross(self.column_axis, self.row_axis)

    def points(self, pixels: ArrayLike) -> Float64:
        """Return the positions of pixels.

        Parameters
        ----------
        pixels : array_like, (N, 2)
            Pixels in (row, column) order; they may be fractional.

        Returns
        -------
        ndarray, (N, 3)
            Positions (x, y, z), mm.
        """
        rc = np.atleast_2d(np.asarray(pixels, dtype=np.float64))
        steps = rc[:, :1] * self.pitch[0] * self.row_axis + rc[:, 1:] * self.pitch[1] * self.column_axis
        points: Float64 = self.origin + steps
        return points


@dataclass(frozen=True, eq=False, init=False)
class Views:
    """The focal spot and the panel of each view.

    `views[::2]` is every second view.

    Parameters
    ----------
    source : array_like, (views, 3)
        Focal spots (x, y, z), mm. A spot at least 1e8 mm away makes a parallel beam, see `parallel_views`.
    panel : Panel or sequence of Panel
        One panel for all views, or one for each view, all of one shape.
    direction : array_like, (3, 3), optional
        Rotation whose columns are the world's x, y and z axes in patient space (LPS). A volume inherits it.

    Attributes
    ----------
    panels : tuple of Panel
        The panel of each view.

    Raises
    ------
    GeometryError
        If shapes differ or a position is not finite.

    Examples
    --------
    >>> panel = pp.Panel((40, 48), (2, 2), (-47, -39, 0))
    >>> views = pp.Views([(0, 0, 500), (50, 0, 500)], panel)
    >>> views.shape
    (2, 40, 48)
    >>> views[:1].shape
    (1, 40, 48)
    """

    source: Float64
    panels: tuple[Panel, ...]
    direction: Float64

    def __init__(self, source: ArrayLike, panel: Panel | Sequence[Panel], direction: ArrayLike | None = None) -> None:
        s = np.array(as_numpy("source", source), dtype=np.float64)
        if s.ndim != 2 or s.shape[1] != 3 or len(s) == 0:
            raise GeometryError(f"source: expected shape (views, 3), got {s.shape}")
        panels = (panel,) * len(s) if isinstance(panel, Panel) else tuple(panel)
        if len(panels) != len(s):
            raise GeometryError(f"panels: expected one, or {len(s)} (one a view), got {len(panels)}")
        if len({p.shape for p in panels}) > 1:
            raise GeometryError(f"panels: all must share one shape, got {sorted({p.shape for p in panels})}")
        for view, (position, p) in enumerate(zip(s, panels, strict=True)):
            if not np.isfinite(position).all():
                raise GeometryError(f"source of view {view} is not finite: {position}")
            distance = float((position - p.origin) @ p.normal)
            if np.abs(position).max() > FAR and np.linalg.norm(position) < PARALLEL:
                raise GeometryError(
                    f"source of view {view} is {np.abs(position).max() / 1000:g} m away at {position.tolist()} mm; "
                    f"lengths are mm: check the units"
                )
            if abs(distance) < 1:
                raise GeometryError(
                    f"source of view {view} at {position.tolist()} mm lies in its panel's plane; check origin and axes"
                )
        object.__setattr__(self, "source", _frozen(s))
        object.__setattr__(self, "panels", panels)
        turn = np.eye(3) if direction is None else np.array(as_numpy("direction", direction), dtype=np.float64)
        if turn.shape != (3, 3) or not np.allclose(turn.T @ turn, np.eye(3), atol=1e-4) or np.linalg.det(turn) < 0:
            raise GeometryError(f"views direction: expected a 3x3 rotation, got {direction!r}")
        object.__setattr__(self, "direction", _frozen(turn))

    def __len__(self) -> int:
        return len(self.source)

    def __getitem__(self, views: int | slice | Sequence[int]) -> "Views":
        chosen = np.atleast_1d(np.arange(len(self))[views])
        return Views(self.source[chosen], [self.panels[i] for i in chosen], self.direction)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of (views, rows, columns)."""
        return (len(self), *self.panels[0].shape)

    @property
    def parallel(self) -> Bool:
        """(views,): True where the beam is parallel."""
        return np.asarray(np.linalg.norm(self.source, axis=1) >= PARALLEL)

    def project(self, points: ArrayLike) -> Float64:
        """Return where rays through points meet each panel.

        Parameters
        ----------
        points : array_like, (N, 3)
            Points (x, y, z), mm.

        Returns
        -------
        ndarray, (views, N, 2)
            Fractional (row, column).
        """
        points = np.atleast_2d(np.asarray(points, dtype=np.float64))
        landed = np.empty((len(self), len(points), 2))
        for view, (s, panel) in enumerate(zip(self.source, self.panels, strict=True)):
            ray = points - s
            reach = ((panel.origin - s) @ panel.normal) / (ray @ panel.normal)
            hit = s + reach[:, None] * ray - panel.origin
            landed[view, :, 0] = hit @ panel.row_axis / panel.pitch[0]
            landed[view, :, 1] = hit @ panel.column_axis / panel.pitch[1]
        return landed


def from_above(views: Views, point: ArrayLike) -> Bool:
    """(views,): True where the ray through a point (x, y, z) runs down, within 60 degrees of z."""
    ray = np.asarray(point, dtype=np.float64) - views.source
    return np.asarray(-ray[:, 2] >= np.linalg.norm(ray, axis=1) / 2)


def beam_in_words(views: Views, view: int) -> str:
    """Where the rays of a view come from."""
    source = views.source[view]
    if not views.parallel[view]:
        return "source at (" + ", ".join(f"{v:.0f}" for v in source) + ") mm"
    return "parallel beam along (" + ", ".join(f"{-v:.3g}" for v in source / np.linalg.norm(source)) + ")"


def _numbers(name: str, values: ArrayLike, count: int) -> Float64:
    array = np.array(as_numpy(name, values), dtype=np.float64)
    if array.shape != (count,) or not np.isfinite(array).all():
        raise GeometryError(f"{name}: expected {count} finite numbers, got {values!r}")
    return array


def _frozen(array: Float64) -> Float64:
    array.flags.writeable = False
    return array
