"""Labels of lumens whose centre line is known."""

import numpy as np

import palpate as pp

R = 7.0  # mm, of straight and bent tubes


def labels_of(inside, shape, spacing, direction=None):
    """Labels of where a function of points (…, 3), mm, is true."""
    grid = pp.Grid(shape, spacing, (-3.0, 5.0, 11.0), direction)
    points = grid.points(np.stack(np.indices(shape), axis=-1).reshape(-1, 3)).reshape(*shape, 3)
    return pp.Labels(inside(points).astype(np.uint8), grid, {1: "tube"})


def straight(spacing=(1.5, 1.5, 1.5), radius=R, length=45.0, direction=None):
    """A tube along the grid's first axis that both sides of the volume cut, and its axis: a point and a unit vector."""
    size = np.array([length, 2 * radius + 12, 2 * radius + 12])
    shape = tuple(np.round(size / spacing).astype(int).tolist())
    grid = pp.Grid(shape, spacing, (-3.0, 5.0, 11.0), direction)
    middle = grid.points((np.array(shape) - 1) / 2).ravel()
    axis = (grid.points(np.array([1, 0, 0])) - grid.points(np.array([0, 0, 0]))).ravel()
    axis /= np.linalg.norm(axis)

    def inside(x):
        apart = x - middle
        return np.linalg.norm(apart - (apart @ axis)[..., None] * axis, axis=-1) < radius

    return labels_of(inside, shape, spacing, direction), middle, axis


def bent(radius=5.0, bend=25.0, spacing=1.0):
    """A quarter of a torus in the plane of y and z, cut at both ends; its centre, from which the bend is measured."""
    side = round((bend + radius + 6) / spacing)
    shape = (side, side, round((2 * radius + 12) / spacing))
    grid = pp.Grid(shape, (spacing,) * 3, (-3.0, 5.0, 11.0))
    center = grid.bounds[0].copy()
    center[0] = grid.bounds.mean(axis=0)[0]

    def inside(x):
        across = np.hypot(np.hypot(x[..., 1] - center[1], x[..., 2] - center[2]) - bend, x[..., 0] - center[0])
        return across < radius

    return labels_of(inside, shape, (spacing,) * 3), center


def forked(radius=5.0, spacing=1.0):
    """A tube along z with a narrower one that leaves it at 45 degrees; open at both ends and at the branch's."""
    shape = tuple(round(n / spacing) for n in (84, 60, 26))
    grid = pp.Grid(shape, (spacing,) * 3, (-3.0, 5.0, 11.0))
    low, high = grid.bounds
    x0, y0, z0 = (low[0] + high[0]) / 2, low[1] + 14, low[2] + 15

    def inside(x):
        u = x - (x0, y0, z0)
        main = np.hypot(u[..., 0], u[..., 1]) < radius
        along = (u[..., 1] + u[..., 2]) / np.sqrt(2)
        branch = (np.hypot(u[..., 0], (u[..., 1] - u[..., 2]) / np.sqrt(2)) < 0.7 * radius) & (along > 0)
        return main | branch

    return labels_of(inside, shape, (spacing,) * 3)


def blind(radius=8.0, spacing=1.0):
    """A ball of lumen, closed all around."""
    side = round((2 * radius + 12) / spacing)
    grid = pp.Grid((side,) * 3, (spacing,) * 3, (-3.0, 5.0, 11.0))
    middle = grid.bounds.mean(axis=0)
    return labels_of(lambda x: np.linalg.norm(x - middle, axis=-1) < radius, (side,) * 3, (spacing,) * 3), middle
