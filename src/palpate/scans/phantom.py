"""Solids whose shadow is known in closed form, so that a simulated scan never comes from a projector of ours."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import Bool, Float32, Float64, float64
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
    """centre: (x, y, z) mm. radii: along its axes, mm, or one number for a ball. axes: 3x3, columns are its axes."""

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
        """Roots of |s + t·d|² = 1, where the ellipsoid is the unit ball."""
        turn = np.asarray(self.axes) / np.asarray(self.radii)
        s, d = (start - np.asarray(self.centre)) @ turn, ray @ turn
        a = np.einsum("ij,ij->i", d, d)
        nearest = -np.einsum("ij,ij->i", s, d) / a
        gap = s + nearest[:, None] * d  # from the centre to the line: no difference of large squares
        half = (1 - np.einsum("ij,ij->i", gap, gap)) / a
        half = np.where(half > 0, np.sqrt(np.abs(half)), -np.inf)
        return nearest - half, nearest + half

    def bounds(self) -> Float64:
        """Half-widths of an ellipsoid are the norms of the rows of axes · diag(radii)."""
        half = np.linalg.norm(np.asarray(self.axes) * np.asarray(self.radii), axis=1)
        return np.stack([np.asarray(self.centre) - half, np.asarray(self.centre) + half])


@dataclass(frozen=True, eq=False)
class Box:
    """centre: (x, y, z) mm. size: edge lengths along x, y, z, mm, or one number for a cube."""

    centre: ArrayLike
    size: ArrayLike

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", float64("box centre", self.centre, (3,)))
        object.__setattr__(self, "size", _lengths("box size", self.size))

    def span(self, start: Float64, ray: Float64) -> Spans:
        """Between the last of the three planes entered and the first left."""
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
        """Its corners."""
        half = np.asarray(self.size) / 2
        return np.stack([np.asarray(self.centre) - half, np.asarray(self.centre) + half])


@dataclass(frozen=True, eq=False)
class Common:
    """What several convex solids have in common, such as a ball cut by a box."""

    solids: Sequence[Solid]

    def span(self, start: Float64, ray: Float64) -> Spans:
        """A line is inside all of them between the last entry and the first exit."""
        spans = [solid.span(start, ray) for solid in self.solids]
        return np.max([s[0] for s in spans], axis=0), np.min([s[1] for s in spans], axis=0)

    def bounds(self) -> Float64:
        """The common part of their boxes."""
        corners = np.array([solid.bounds() for solid in self.solids])
        return np.stack([corners[:, 0].max(axis=0), corners[:, 1].min(axis=0)])


@dataclass(frozen=True, eq=False)
class Phantom:
    """parts: solids, each with the attenuation (1/mm) that it *adds*: where two overlap their values sum up.

    A bright insert in tissue of 0.02 that shall have 0.03 adds 0.01; a hole adds -0.02.
    """

    parts: Sequence[tuple[Solid, float]]

    def line_integrals(self, start: ArrayLike, end: ArrayLike) -> Float64:
        """Exact integrals (N,), no unit, of attenuation along segments from start to end, both (N, 3) mm."""
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
        """Attenuation (N,) 1/mm at points (N, 3) mm."""
        p = np.atleast_2d(np.asarray(points, dtype=np.float64))
        upward = np.broadcast_to(np.array([0.0, 0.0, 1.0]), p.shape)
        total = np.zeros(len(p))
        for solid, attenuation in self.parts:
            enter, leave = solid.span(p, upward)
            total += attenuation * ((enter <= 0) & (leave >= 0))
        return total

    def volume(self, grid: Grid, samples: int = 3) -> Volume:
        """The phantom on a grid (its own frame): the truth to compare a reconstruction with.

        Each voxel is the mean over samples² lines along z, exact on each line.
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
        """(2, 3): lowest and highest corner of a box around all parts, mm."""
        corners = np.array([solid.bounds() for solid, _ in self.parts])
        return np.stack([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])

    def grid(self, spacing: float) -> Grid:
        """Cubic voxels of `spacing` mm that cover all parts."""
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
    """A slab of soft tissue, 120 x 120 x 44 mm from z = 32 mm, with inserts at four depths, brighter and darker.

    After the idea of the dissertation's simulated phantom: regions of different attenuation in different slices, so
    that what leaks from one depth into another is seen. Attenuations are those of water (0.02 1/mm) and near it.
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
    """A compressed breast, 50 mm thick on the panel cover at z = 0, chest wall at y = 0, with a dense ball.

    Adipose 0.0456, fibroglandular 0.0802 1/mm (20 keV, the values behind the FDA sample), lesion 0.0902 1/mm.
    """
    outline = Common([Ellipsoid((0, 0, 25), (80, 60, 90)), Box((0, 50, 25), (200, 100, 50))])
    inside = Common([Ellipsoid((0, 8, 25), (54, 34, 20)), Box((0, 50, 25), (200, 100, 50))])
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
