"""Twenty label volumes that are hard to mesh, each as a function of the voxel: tests and benchmarks share them."""

from dataclasses import dataclass, field

import numpy as np
from scipy import ndimage

import palpate as pp


@dataclass(frozen=True)
class Shape:
    """labels; edge: mm, which makes 5,000 to 30,000 tets; exact: positive inside, at (N, 3) mm, None if unknown.

    options go to `tetrahedralize`. names: what the shape is a case of.
    """

    labels: pp.Labels
    edge: float
    exact: object = None
    options: dict = field(default_factory=dict)


def drawn(inside, half, spacing=(1.0, 1.0, 1.0), margin=4):
    """Labels of an implicit function over a box of half-widths `half` (x, y, z) mm about the origin."""
    shape = tuple(int(np.ceil(2 * half[2 - i] / spacing[i])) + 2 * margin for i in range(3))
    first = [-(shape[2 - i] - 1) / 2 * spacing[2 - i] for i in range(3)]
    grid = pp.Grid(shape, spacing, tuple(first))
    points = grid.points(np.argwhere(np.ones(shape)))
    return grid, points, (inside(points) > 0).reshape(shape)


def plain(inside, half, edge, spacing=(1.0, 1.0, 1.0), **options):
    grid, _, mask = drawn(inside, half, spacing)
    return Shape(pp.Labels(mask.astype(int), grid, {1: "organ"}), edge, inside, options)


def ball(centre, radius):
    return lambda p: radius - np.linalg.norm(p - np.asarray(centre, float), axis=1)


def ellipsoid(half):
    half = np.asarray(half, float)

    def inside(p):
        k = np.linalg.norm(p / half, axis=1)
        return (1 - k) * k / np.maximum(np.linalg.norm(p / half**2, axis=1), 1e-9)

    return inside


def rounded_box(half, radius):
    half = np.asarray(half, float) - radius

    def inside(p):
        q = np.abs(p) - half
        return radius - np.linalg.norm(np.maximum(q, 0), axis=1) - np.minimum(q.max(axis=1), 0)

    return inside


def capsule(a, b, radius):
    a, b = np.asarray(a, float), np.asarray(b, float)

    def inside(p):
        t = np.clip((p - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        return radius - np.linalg.norm(p - a - t[:, None] * (b - a), axis=1)

    return inside


def torus(around, thick):
    return lambda p: thick - np.hypot(np.hypot(p[:, 0], p[:, 1]) - around, p[:, 2])


def turned(inside, seed=3):
    """The same shape in a direction that no axis of the lattice has."""
    turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return lambda p: inside(p @ turn)


def both(*parts):
    return lambda p: np.min([part(p) for part in parts], axis=0)


def either(*parts):
    return lambda p: np.max([part(p) for part in parts], axis=0)


def without(whole, hole):
    return lambda p: np.minimum(whole(p), -hole(p))


def lobes(p):
    """Five bumps around a middle: no distance, but its zero is the surface."""
    turn = 2 * np.pi * np.arange(5) / 5
    centres = np.stack([11 * np.cos(turn), 11 * np.sin(turn), 3 * (-1.0) ** np.arange(5)], axis=1)
    return sum(np.exp(-(((p - c) / 6.5) ** 2).sum(axis=1)) for c in centres) - 0.45


def dome(p):
    return np.minimum(1.75 - np.abs(np.linalg.norm(p, axis=1) - 17), p[:, 2] + 4)


def noise(shape, width, seed):
    values = ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=shape), width)
    return values / values.std()


def speckled():
    """A ball of which one voxel in twelve is wrong, near it and in it."""
    grid, _, mask = drawn(ball((0, 0, 0), 16), (16, 16, 16))
    near = ndimage.binary_dilation(mask, iterations=2)
    wrong = (np.random.default_rng(1).random(mask.shape) < 1 / 12) & near
    return Shape(pp.Labels((mask ^ wrong).astype(int), grid, {1: "organ"}), 2.6)


def rough():
    """A ball whose surface is noise two voxels high."""
    grid, points, _ = drawn(ball((0, 0, 0), 18), (18, 18, 18))
    radius = np.linalg.norm(points, axis=1).reshape(grid.shape)
    return Shape(pp.Labels((radius < 16 + 1.5 * noise(grid.shape, 1.2, 2)).astype(int), grid, {1: "organ"}), 2.2)


def sponge():
    """Smooth noise above a threshold: many handles, arms of all widths."""
    grid, _, mask = drawn(ball((0, 0, 0), 18), (18, 18, 18))
    value = noise(grid.shape, 4.0, 5) > -0.3
    return Shape(pp.Labels((value & mask).astype(int), grid, {1: "organ"}), 1.9, None, {"fill_holes": False})


def regions(parts, half, edge, spacing=(1.0, 1.0, 1.0), **options):
    """The first part is the organ, each later one replaces what lies in it, also where it reaches the organ's skin."""
    grid, points, mask = drawn(parts[0], half, spacing)
    values = mask.astype(int).ravel()
    for number, part in enumerate(parts[1:], 2):
        values[(part(points) > 0) & (values > 0)] = number
    names = {1: "organ", 2: "tumour", 3: "vessel", 4: "cyst"}
    labels = pp.Labels(values.reshape(grid.shape), grid, names)
    return Shape(labels, edge, parts[0], {"inclusions": list(range(2, 1 + len(parts))), **options})


ORGAN = ellipsoid((22, 15, 13))
HALF_SPACE = lambda p: p[:, 0] - 2.3  # noqa: E731


def parts():
    apart = either(ball((-12, 0, 0), 9), ball((9, 4, 3), 8), capsule((-4, -14, -6), (10, -14, 4), 4))
    return plain(apart, (22, 19, 13), 2.2, keep="all")


def cut():
    grid, _, mask = drawn(ball((3, 0, -11), 19), (22, 19, 12))
    labels = pp.Labels(
        mask[4:-4].astype(int), pp.Grid(mask[4:-4].shape, grid.spacing, tuple(grid.points([[4, 0, 0]])[0]))
    )
    return Shape(labels, 2.6, None, {"closed_at_border": True})


SHAPES = {
    "ball": lambda: plain(ball((0.3, 0.1, -0.2), 16), (16, 16, 16), 2.5),
    "flat voxels": lambda: plain(turned(ellipsoid((22, 15, 12))), (22, 22, 22), 2.4, (3.0, 0.8, 0.8)),
    "thin plate": lambda: plain(turned(rounded_box((20, 16, 1.75), 1.7)), (24, 24, 24), 2.0, (0.7, 0.7, 0.7)),
    "thin dome": lambda: plain(dome, (19, 19, 19), 2.3, (0.8, 0.8, 0.8)),
    "rod": lambda: plain(turned(capsule((-24, 0, 0), (24, 0, 0), 3.2)), (24, 24, 24), 1.5),
    "lobed": lambda: plain(lobes, (20, 20, 14), 2.2),
    "narrow neck": lambda: plain(
        either(ball((-12, 0, 0), 10), ball((12, 1, 0), 9), capsule((-12, 0, 0), (12, 1, 0), 2.4)), (23, 11, 11), 2.2
    ),
    "ring": lambda: plain(turned(torus(15, 5)), (20, 20, 20), 2.1),
    "three handles": lambda: plain(
        without(
            rounded_box((24, 10, 6), 2), either(*(capsule((x, 0, -20), (x, 0, 20), 4) for x in (-14, 0, 14)))
        ),
        (24, 10, 6),
        2.0,
    ),
    "hollow": lambda: plain(without(ball((0, 0, 0), 17), ball((3, 1, 0), 10)), (17, 17, 17), 2.6, fill_holes=False),
    "sponge": sponge,
    "speckled": speckled,
    "rough": rough,
    "box with edges": lambda: plain(turned(rounded_box((15, 11, 9), 0.01)), (19, 19, 19), 2.2),
    "wedge": lambda: plain(
        both(rounded_box((20, 12, 8), 2), lambda p: (0.35 * (p[:, 0] + 20) - p[:, 2] - 8) / np.hypot(1, 0.35)),
        (20, 12, 8),
        2.0,
    ),
    "cut by the border": cut,
    "several parts": parts,
    "lump": lambda: regions([ORGAN, ball((4, 1, 0), 6)], (22, 15, 13), 2.4),
    "halves": lambda: regions([ORGAN, HALF_SPACE], (22, 15, 13), 2.4),
    "tumour at the skin": lambda: regions([ORGAN, ball((14, 6, 4), 8)], (22, 15, 13), 2.4),
    "tumour and vessel": lambda: regions(
        [ORGAN, ball((6, 3, 2), 7), capsule((-30, -4, 1), (30, 2, -3), 3.4)], (22, 15, 13), 2.2
    ),
    "four that meet": lambda: regions(
        [ORGAN, lambda p: np.minimum(p[:, 0] + 1, p[:, 1] - 0.4), lambda p: np.minimum(p[:, 0] + 1, 0.4 - p[:, 1]),
         lambda p: np.minimum(-p[:, 0] - 1, p[:, 2] - 1.2)],
        (22, 15, 13),
        2.3,
    ),
}  # fmt: skip
