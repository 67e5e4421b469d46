"""The centre line of a lumen, its branches and its openings."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from palpate.arrays import Bool, Float64, Int32, Int64
from palpate.errors import DataError
from palpate.volumes.volume import Labels

CENTERED = 4  # power of the ratio of largest to local radius: how strongly a path keeps to the middle
REACH = 1.5  # local radii around a path that belong to its branch
SHORTEST_BRANCH = 1.0  # radii where it leaves, beyond that reach: what sticks out less is a bump of the wall
SMOOTH = 2.0  # voxels
FEWEST_OPEN = 4  # voxels of the lumen on a side of the volume: fewer are no opening


@dataclass(frozen=True, eq=False)
class Centerline:
    """The centre line of a lumen.

    Parameters
    ----------
    points : ndarray, (n, 3)
        Points (x, y, z), mm, branch by branch, each from its root outwards.
    radius : ndarray, (n,)
        Distance from there to the wall, mm.
    branch : ndarray, (n,)
        Number of the branch. The first runs between the two widest openings, or to the far end.
    openings : ndarray, (k, 6)
        Where the side of the volume cuts the lumen: a point, mm, and the unit vector out of the lumen.

    Examples
    --------
    >>> line = pp.centerline(labels, "organ")
    >>> line.points.shape == (len(line.radius), 3)
    True
    """

    points: Float64
    radius: Float64
    branch: Int32
    openings: Float64


def centerline(labels: Labels, label: int | str) -> Centerline:
    """Find the centre line of a lumen, such as an airway, a vessel or a colon.

    Paths run from the largest opening, or from one end, to the ends that are farthest along the lumen, through its middle.
    A side branch that is longer than 2.5 times the radius there has a path of its own. The largest part of the label counts.

    Parameters
    ----------
    labels : Labels
        The labels.
    label : int or str
        The lumen, by number or name.

    Returns
    -------
    Centerline
        The line, in patient space (LPS), mm.

    Raises
    ------
    DataError
        If the label is absent or empty.

    References
    ----------
    Sato et al., Medical Image Analysis 4 (2000) 3: paths of least cost, where cost falls with the distance to the wall.

    Examples
    --------
    >>> line = pp.centerline(labels, "organ")
    >>> int(line.branch[0])
    0
    """
    from skimage.graph import MCP_Geometric  # slow to import

    value = labels.value_of(label)
    mask, corner = _largest_part(labels.values == value)
    spacing = np.array(labels.grid.spacing)
    depth = _wall_distance(mask, spacing)
    cost = np.where(mask, (depth.max() / np.maximum(depth, 1e-9)) ** CENTERED, np.inf)
    lengths = np.where(mask, 1.0, np.inf)
    openings = _openings(mask, depth, labels, corner)
    root = tuple(openings[0][0]) if openings else _farthest(lengths, spacing, tuple(np.argwhere(mask)[0]))

    paths: list[Int64] = []
    ends = [tuple(place) for place, _ in openings[1:]]
    reached, taken = np.zeros((2, *mask.shape), dtype=bool)  # near a path, and on one
    to_root = MCP_Geometric(cost, sampling=tuple(spacing))
    to_root.find_costs([root])
    while True:
        start = np.argwhere(reached) if paths else [root]
        beyond, _ = MCP_Geometric(lengths, sampling=tuple(spacing)).find_costs(start)
        beyond[~np.isfinite(beyond)] = -1
        end = ends.pop(0) if ends else tuple(np.unravel_index(np.argmax(beyond), mask.shape))
        if paths and beyond[end] <= 2 * spacing.max():
            if ends:
                continue
            break
        path = np.array(to_root.traceback(end), dtype=np.int64)
        if paths:  # the part that no other branch has
            path = path[len(path) - int(np.argmax(taken[tuple(path.T)][::-1])) - 1 :]
        if not paths or beyond[end] > SHORTEST_BRANCH * depth[tuple(path[0])]:
            paths.append(path)
            taken[tuple(path.T)] = True
        reached |= _around(path, depth, spacing, mask)
    return _smoothed(paths, depth, labels, corner, openings)


def _largest_part(inside: Bool) -> tuple[Bool, Int64]:
    """The largest connected part in the box around it, with a voxel of room, and the box's first voxel."""
    if not inside.any():
        raise DataError("lumen: the label has no voxel")
    parts, count = ndimage.label(inside, np.ones((3, 3, 3)))
    if count > 1:
        inside = parts == np.argmax(np.bincount(parts.ravel())[1:]) + 1
    where = np.argwhere(inside)
    low = np.maximum(where.min(axis=0) - 1, 0)
    high = np.minimum(where.max(axis=0) + 2, inside.shape)
    return inside[tuple(slice(a, b) for a, b in zip(low, high, strict=True))], low


def _wall_distance(mask: Bool, spacing: Float64) -> Float64:
    """Distance of each voxel's middle to the wall, mm; the sides of the volume are no wall."""
    distance = ndimage.distance_transform_edt(np.pad(mask, 1, mode="edge"), sampling=spacing)
    return np.asarray(distance[1:-1, 1:-1, 1:-1] - 0.5 * spacing.min() * mask, dtype=np.float64)


def _openings(mask: Bool, depth: Float64, labels: Labels, corner: Int64) -> list[tuple[Int64, Int64]]:
    """Of each place where a side of the volume cuts the lumen: its middle voxel, and the step out. The widest first."""
    found = []
    for axis in range(3):
        for step, side in ((-1, 0), (1, labels.grid.shape[axis] - 1)):
            at = side - corner[axis]
            if not 0 <= at < mask.shape[axis]:
                continue
            here = np.take(mask, at, axis)
            parts, count = ndimage.label(here)
            for part in range(1, count + 1):
                if np.count_nonzero(parts == part) < FEWEST_OPEN:
                    continue
                flat = np.where(parts == part, np.take(depth, at, axis), -1)
                place = np.insert(np.array(np.unravel_index(np.argmax(flat), flat.shape)), axis, at)
                out = np.zeros(3, dtype=np.int64)
                out[axis] = step
                found.append((place, out))
    return sorted(found, key=lambda one: -depth[tuple(one[0])])


def _farthest(lengths: Float64, spacing: Float64, start: tuple[int, ...]) -> tuple[int, ...]:
    """The voxel that is farthest along the lumen."""
    from skimage.graph import MCP_Geometric

    far, _ = MCP_Geometric(lengths, sampling=tuple(spacing)).find_costs([start])
    far[~np.isfinite(far)] = -1
    return tuple(int(i) for i in np.unravel_index(np.argmax(far), far.shape))


def _around(path: Int64, depth: Float64, spacing: Float64, mask: Bool) -> Bool:
    """The voxels of the lumen that are near a path."""
    on_path = np.ones(mask.shape, dtype=bool)
    on_path[tuple(path.T)] = False
    distance, nearest = ndimage.distance_transform_edt(on_path, sampling=spacing, return_indices=True)
    return np.asarray(mask & (distance <= REACH * depth[tuple(nearest)] + spacing.max()))


def _smoothed(
    paths: list[Int64], depth: Float64, labels: Labels, corner: Int64, openings: list[tuple[Int64, Int64]]
) -> Centerline:
    """The paths without the steps of their voxels, in mm."""
    points, radius, branch = [], [], []
    for number, path in enumerate(paths):
        smooth = ndimage.gaussian_filter1d(path.astype(np.float64), SMOOTH, axis=0, mode="nearest")
        smooth[[0, -1]] = path[[0, -1]]
        points.append(labels.grid.points(smooth + corner))
        radius.append(np.maximum(ndimage.map_coordinates(depth, smooth.T, order=1, mode="nearest"), 0))
        branch.append(np.full(len(path), number))
    out = np.empty((len(openings), 6))
    for i, (place, step) in enumerate(openings):
        face = labels.grid.points(place + corner + 0.5 * step)
        beyond = labels.grid.points(place + corner + 1.5 * step) - face
        out[i] = [*face.ravel(), *(beyond / np.linalg.norm(beyond)).ravel()]
    return Centerline(np.concatenate(points), np.concatenate(radius), np.concatenate(branch).astype(np.int32), out)
