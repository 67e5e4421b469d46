"""Phantoms whose line integrals are known in closed form. They share no code with the projector."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from palpate.arrays import ArrayLike, Bool, Float32, Float64, float64
from palpate.errors import GeometryError
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Volume

Spans = tuple[Float64, Float64]


class Solid(Protocol):
    """A convex body. Straight lines enter and leave it once."""

    def span(self, start: Float64, ray: Float64) -> Spans:
        """Where lines start + t·ray, both (N, 3) mm, are inside: t from (N,) to (N,); empty where from > to."""

    def bounds(self) -> Float64:
        """(2, 3): lowest and highest corner of a box around it, mm."""


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """An ellipsoid, for a `Phantom`.

    Parameters
    ----------
    centre : array_like, (3,)
        Centre (x, y, z), mm.
    radii : array_like, (3,) or float
        Semi-axes, mm, or one number for a ball.
    axes : array_like, (3, 3), optional
        Rotation whose columns are the ellipsoid's axes.

    Raises
    ------
    DataError
        If a radius is not positive.

    Examples
    --------
    >>> ball = pp.Ellipsoid(centre=(0, 0, 24), radii=10)
    >>> pp.Phantom([(ball, 0.02)]).attenuation([(0, 0, 24), (0, 0, 40)])
    array([0.02, 0.  ])
    """

    centre: ArrayLike
    radii: ArrayLike
    axes: ArrayLike = ((1, 0, 0), (0, 1, 0), (0, 0, 1))

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", float64("ellipsoid centre", self.centre, (3,)))
        object.__setattr__(self, "radii", _lengths("ellipsoid radii", self.radii))
        turn = float64("ellipsoid axes", self.axes, (3, 3))
        if not np.allclose(turn.T @ turn, np.eye(3), atol=1e-6):
            raise GeometryError(f"ellipsoid axes: expected orthogonal unit columns, got {self.axes!r}")
        object.__setattr__(self, "axes", turn)

    def span(self, start: Float64, ray: Float64) -> Spans:
        """Return where lines enter and leave the ellipsoid.

        Parameters
        ----------
        start, ray : ndarray, (N, 3)
            A point on each line and its direction, mm.

        Returns
        -------
        tuple of ndarray, (N,)
            Parameters t of entry and exit.
        """
        turn = np.asarray(self.axes) / np.asarray(self.radii)
        s, d = (start - np.asarray(self.centre)) @ turn, ray @ turn
        a = np.einsum("ij,ij->i", d, d)
        nearest = -np.einsum("ij,ij->i", s, d) / a
        gap = s + nearest[:, None] * d  # from the centre to the line: no difference of large squares
        half = (1 - np.einsum("ij,ij->i", gap, gap)) / a
        half = np.where(half > 0, np.sqrt(np.abs(half)), -np.inf)
        return nearest - half, nearest + half

    def bounds(self) -> Float64:
        """Return the corners of the bounding box, (2, 3), mm.

        Returns
        -------
        ndarray, (2, 3)
            Lowest and highest corner (x, y, z), mm.
        """
        half = np.linalg.norm(np.asarray(self.axes) * np.asarray(self.radii), axis=1)
        return np.stack([np.asarray(self.centre) - half, np.asarray(self.centre) + half])


@dataclass(frozen=True, eq=False)
class Box:
    """A box with edges along x, y and z, for a `Phantom`.

    Parameters
    ----------
    centre : array_like, (3,)
        Centre (x, y, z), mm.
    size : array_like, (3,) or float
        Edge lengths, mm, or one number for a cube.

    Raises
    ------
    DataError
        If a length is not positive.

    Examples
    --------
    >>> cube = pp.Box(centre=(0, 0, 0), size=10)
    >>> pp.Phantom([(cube, 0.03)]).line_integrals([(0, 0, -9)], [(0, 0, 9)])
    array([0.3])
    """

    centre: ArrayLike
    size: ArrayLike

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", float64("box centre", self.centre, (3,)))
        object.__setattr__(self, "size", _lengths("box size", self.size))

    def span(self, start: Float64, ray: Float64) -> Spans:
        """Return where lines enter and leave the box.

        Parameters
        ----------
        start, ray : ndarray, (N, 3)
            A point on each line and its direction, mm.

        Returns
        -------
        tuple of ndarray, (N,)
            Parameters t of entry and exit.
        """
        low, high = self.bounds()
        enter, leave = np.full(len(ray), -np.inf), np.full(len(ray), np.inf)
        for axis in range(3):
            s, d = start[:, axis], ray[:, axis]
            level = d == 0  # parallel to these two faces: inside all the way, or never
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                a, b = (low[axis] - s) / d, (high[axis] - s) / d
            inside = (s >= low[axis]) & (s <= high[axis])
            first = np.where(level, np.where(inside, -np.inf, np.inf), np.minimum(a, b))
            last = np.where(level, np.where(inside, np.inf, -np.inf), np.maximum(a, b))
            enter, leave = np.maximum(enter, first), np.minimum(leave, last)
        return enter, leave

    def bounds(self) -> Float64:
        """Return the corners of the box.

        Returns
        -------
        ndarray, (2, 3)
            Lowest and highest corner (x, y, z), mm.
        """
        half = np.asarray(self.size) / 2
        return np.stack([np.asarray(self.centre) - half, np.asarray(self.centre) + half])


@dataclass(frozen=True, eq=False)
class Intersection:
    """The intersection of convex solids, for a `Phantom`.

    Parameters
    ----------
    solids : sequence of solid
        For example a ball and a box that cuts it.

    Raises
    ------
    DataError
        If no solid is given.

    Examples
    --------
    >>> half = pp.Intersection([pp.Ellipsoid((0, 0, 0), 10), pp.Box((0, 0, 10), 20)])
    >>> pp.Phantom([(half, 0.02)]).line_integrals([(0, 0, -20)], [(0, 0, 20)]).round(6)
    array([0.2])
    """

    solids: Sequence[Solid]

    def span(self, start: Float64, ray: Float64) -> Spans:
        """Return where lines enter and leave all solids.

        Parameters
        ----------
        start, ray : ndarray, (N, 3)
            A point on each line and its direction, mm.

        Returns
        -------
        tuple of ndarray, (N,)
            Parameters t of entry and exit.
        """
        spans = [solid.span(start, ray) for solid in self.solids]
        return np.max([s[0] for s in spans], axis=0), np.min([s[1] for s in spans], axis=0)

    def bounds(self) -> Float64:
        """Return the corners of the intersection of the bounding boxes.

        Returns
        -------
        ndarray, (2, 3)
            Lowest and highest corner (x, y, z), mm.
        """
        corners = np.array([solid.bounds() for solid in self.solids])
        return np.stack([corners[:, 0].max(axis=0), corners[:, 1].min(axis=0)])


@dataclass(frozen=True, eq=False)
class Phantom:
    """Solids with known attenuation, whose line integrals are exact.

    Parameters
    ----------
    parts : sequence of (solid, float)
        Each solid with the attenuation that it adds, 1/mm. Where two overlap, their values add up: an insert of 0.03 in
        tissue of 0.02 adds 0.01, and a hole adds −0.02.

    Raises
    ------
    DataError
        If a part is not a solid and a number.

    Examples
    --------
    >>> body = pp.Phantom([(pp.Ellipsoid((0, 0, 0), 10), 0.02)])
    >>> body.line_integrals([(0, 0, -20)], [(0, 0, 20)]).round(6)
    array([0.4])
    """

    parts: Sequence[tuple[Solid, float]]

    def line_integrals(self, start: ArrayLike, end: ArrayLike) -> Float64:
        """Return exact line integrals of attenuation along segments.

        Parameters
        ----------
        start, end : array_like, (N, 3)
            Ends of the segments (x, y, z), mm.

        Returns
        -------
        ndarray, (N,)
            Line integrals, no unit.
        """
        s, e = (np.atleast_2d(np.asarray(p, dtype=np.float64)) for p in (start, end))
        s = np.broadcast_to(s, e.shape)
        ray = e - s
        length = np.linalg.norm(ray, axis=1)
        total = np.zeros(len(ray))
        for solid, attenuation in self.parts:
            near = np.flatnonzero(_near(solid, s, ray, length))
            enter, leave = solid.span(s[near], ray[near])
            inside = np.maximum(np.minimum(leave, 1) - np.maximum(enter, 0), 0)
            total[near] += attenuation * inside * length[near]
        return total

    def attenuation(self, points: ArrayLike) -> Float64:
        """Return the attenuation at points.

        Parameters
        ----------
        points : array_like, (N, 3)
            Points (x, y, z), mm.

        Returns
        -------
        ndarray, (N,)
            Attenuation, 1/mm.
        """
        p = np.atleast_2d(np.asarray(points, dtype=np.float64))
        upward = np.broadcast_to(np.array([0.0, 0.0, 1.0]), p.shape)
        total = np.zeros(len(p))
        for solid, attenuation in self.parts:
            enter, leave = solid.span(p, upward)
            total += attenuation * ((enter <= 0) & (leave >= 0))
        return total

    def volume(self, grid: Grid, samples: int = 3) -> Volume:
        """Return the phantom on a grid: the truth to compare a reconstruction with.

        Parameters
        ----------
        grid : Grid
            The grid, in its own frame.
        samples : int, optional
            Each voxel is the mean over samples² lines along z, exact on each line.

        Returns
        -------
        Volume
            Attenuation, 1/mm.
        """
        values: Float32 = np.zeros(grid.shape, np.float32)
        offsets = ((np.arange(samples) + 0.5) / samples - 0.5)[:, None]
        for solid, attenuation in self.parts:
            low, high = (solid.bounds() - grid.bounds[0])[:, ::-1] / grid.spacing
            first = np.clip(np.floor(low), 0, grid.shape).astype(int)
            last = np.clip(np.ceil(high), 0, grid.shape).astype(int)
            if (last <= first).any():
                continue
            part = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
            x, y = ((grid.axis(n)[part[2 - i]] + offsets * grid.spacing[2 - i]).T.ravel() for i, n in enumerate("xy"))
            values[part] += attenuation * _filled(solid, x, y, grid.axis("z")[part[0]], grid.spacing[0], samples)
        return Volume(values, grid)

    def bounds(self) -> Float64:
        """Return the corners of a box around all parts.

        Returns
        -------
        ndarray, (2, 3)
            Lowest and highest corner (x, y, z), mm.
        """
        corners = np.array([solid.bounds() for solid, _ in self.parts])
        return np.stack([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])

    def grid(self, spacing: float) -> Grid:
        """Return a grid of cubic voxels that covers all parts.

        Parameters
        ----------
        spacing : float
            Voxel size, mm.

        Returns
        -------
        Grid
            The grid.
        """
        low, high = self.bounds()
        n = np.ceil((high - low) / spacing).astype(int)
        return Grid(n[::-1], (spacing,) * 3, low + spacing / 2)


def _near(solid: Solid, start: Float64, ray: Float64, length: Float64) -> Bool:
    """(N,) which lines pass the sphere around a solid's box: small inserts are missed by most."""
    low, high = solid.bounds()
    towards = (low + high) / 2 - start
    along = np.einsum("ij,ij->i", towards, ray) / np.maximum(length, 1e-300)
    beside = np.einsum("ij,ij->i", towards, towards) - along**2  # squared distance of the centre from the line
    near: Bool = beside <= ((high - low) ** 2).sum() / 4 * (1 + 1e-9) + 1e-12 * along**2
    return near


def slab_phantom() -> Phantom:
    """Return a slab of soft tissue with inserts at four depths.

    The slab is 120 × 120 × 44 mm and begins at z = 32 mm. The inserts are brighter or darker than the slab, so that
    leakage from one depth to another is visible. Attenuations are near that of water, 0.02 1/mm.

    Returns
    -------
    Phantom
        The slab.

    Examples
    --------
    >>> pp.slab_phantom().bounds()[:, 2].tolist()
    [32.0, 76.0]
    """
    parts: list[tuple[Solid, float]] = [
        (Box((0, 0, 54), (120, 120, 44)), 0.020),
        (Ellipsoid((-28, -24, 38), (12, 8, 3)), 0.012),
        (Box((26, -26, 38), (16, 16, 4)), -0.008),
        (Ellipsoid((0, 18, 48), (16, 10, 3.5)), 0.015),
        (Box((-30, 20, 48), (10, 22, 5)), 0.008),
        (Ellipsoid((28, 8, 60), 6), 0.020),
        (Ellipsoid((-6, -8, 60), (8, 14, 3)), -0.010),
        (Box((6, 34, 70), (28, 8, 4)), 0.010),
        (Ellipsoid((-34, -4, 70), 4), 0.030),
    ]
    return Phantom(parts)


def breast_phantom() -> Phantom:
    """Return a compressed breast with a dense ball.

    The breast is 50 mm thick, with the panel cover at z = 0 and the chest wall at y = 0. Attenuations are those of
    20 keV: adipose 0.0456, fibroglandular 0.0802 and lesion 0.0902 1/mm.

    Returns
    -------
    Phantom
        The breast.

    Examples
    --------
    >>> pp.breast_phantom().bounds()[1, 2].round(1).item()
    50.0
    """
    outline = Intersection([Ellipsoid((0, 0, 25), (80, 60, 90)), Box((0, 50, 25), (200, 100, 50))])
    inside = Intersection([Ellipsoid((0, 8, 25), (54, 34, 20)), Box((0, 50, 25), (200, 100, 50))])
    ducts = [(Ellipsoid((x, 30, z), (5, 12, 4)), 0.0173) for x, z in ((-40, 14), (-18, 38), (28, 12), (44, 34))]
    return Phantom([(outline, 0.0456), (inside, 0.0173), *ducts, (Ellipsoid((14, 24, 28), 5), 0.0273)])


def _filled(solid: Solid, x: Float64, y: Float64, z: Float64, thickness: float, samples: int) -> Float64:
    """Share (slices, rows, columns) of each voxel inside a solid; x, y hold `samples` lines a voxel."""
    Y, X = np.meshgrid(y, x, indexing="ij")
    start = np.stack([X.ravel(), Y.ravel(), np.zeros(X.size)], axis=1)
    upward = np.broadcast_to(np.array([0.0, 0.0, 1.0]), start.shape)
    enter, leave = (t.reshape(X.shape) for t in solid.span(start, upward))
    shape = (len(y) // samples, samples, len(x) // samples, samples)
    shares = []
    for middle in z:
        inside = np.minimum(leave, middle + thickness / 2) - np.maximum(enter, middle - thickness / 2)
        shares.append(np.maximum(inside, 0).reshape(shape).mean(axis=(1, 3)) / thickness)
    return np.array(shares)


def _lengths(name: str, values: ArrayLike) -> Float64:
    three = float64(name, np.broadcast_to(np.asarray(values, dtype=np.float64), (3,)))
    if (three <= 0).any():
        raise GeometryError(f"{name}: expected positive lengths in mm, got {values!r}")
    return three
