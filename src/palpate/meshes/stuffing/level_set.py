"""A smooth surface of a mask of voxels, with the same volume."""

from functools import cached_property

import numpy as np
from scipy import ndimage

from palpate.arrays import ArrayLike, Bool, Float64, Int64

SCATTER = 1 / 1.2207440846057596 ** np.arange(1, 4)  # Roberts' sequence: fills a cube evenly, one point after another
LOW, HIGH = 0.02, 0.98  # no level of a smoothed mask lies outside these


class Level:
    """A mask smoothed by a Gaussian, and the level of it that encloses a wanted volume.

    mask: (z, y, x) bool. spacing: mm, (z, y, x). width: standard deviation of the Gaussian along each axis, mm, which
    turns the staircase of the voxels into a slope. Points are mm in x, y, z from the centre of voxel (0, 0, 0).
    """

    def __init__(self, mask: Bool, spacing: ArrayLike, width: ArrayLike) -> None:
        self.spacing = np.array(spacing, dtype=np.float64)
        sigma = np.array(width) / self.spacing
        box = box_of(mask)
        margin = np.ceil(4 * sigma).astype(int) + 2
        padded = np.pad(mask[box], [(int(m), int(m)) for m in margin]).astype(np.float32)
        self._first = np.array([span.start for span in box]) - margin  # index of the first voxel that is kept
        self.smooth = ndimage.gaussian_filter(padded, sigma, mode="constant")
        self.level = 0.5

    def __call__(self, points: Float64) -> Float64:
        """(N,) positive inside, at (N, 3) mm."""
        index = (points[:, ::-1] / self.spacing - self._first).T
        values: Float64 = ndimage.map_coordinates(
            self.smooth, index, output=np.float64, order=1, mode="constant", cval=0.0, prefilter=False
        )
        return values - self.level

    def enclose(self, volume: float) -> None:
        """Sets the level inside which lie `volume` mm³."""
        between, above, each = self._samples
        at = float(np.clip(len(between) + above - volume / each, 0, len(between) - 1))
        low = min(int(at), len(between) - 2)
        self.level = float(np.interp(at, [low, low + 1], between[low : low + 2]))

    def triangles(self) -> tuple[Float64, Int64]:
        """The surface itself: (V, 3) mm and (T, 3), by marching cubes, triangles about the size of a voxel."""
        from skimage.measure import marching_cubes

        vertices, faces, _, _ = marching_cubes(self.smooth, self.level)
        points: Float64 = ((vertices.astype(np.float64) + self._first) * self.spacing)[:, ::-1]
        return points, faces.astype(np.int64)

    @cached_property
    def _samples(self) -> tuple[Float64, int, float]:
        """The smooth mask at scattered points: its values from LOW to HIGH, sorted, how many lie above, mm³ of each.

        One point in each cell of a finer grid; scattered, or all of a flat face would change sides at one level.
        """
        fine = int(np.clip((4e6 / self.smooth.size) ** (1 / 3), 1, 4))
        values = self.smooth
        for axis in range(3 if fine > 1 else 0):
            steps = (np.arange(values.shape[axis] * fine) + 0.5) / fine - 0.5
            low = np.clip(np.floor(steps).astype(int), 0, values.shape[axis] - 2)
            part = np.clip(steps - low, 0, 1).astype(np.float32)
            shape = [-1 if i == axis else 1 for i in range(3)]
            part = part.reshape(shape)
            values = np.take(values, low, axis) * (1 - part) + np.take(values, low + 1, axis) * part
        near = (ndimage.maximum_filter(values, 3) > LOW) & (ndimage.minimum_filter(values, 3) < HIGH)
        cell = np.argwhere(near)
        index = (cell + np.arange(1, len(cell) + 1)[:, None] * SCATTER % 1) / fine - 0.5
        found = ndimage.map_coordinates(self.smooth, index.T, order=1, mode="nearest", prefilter=False)
        between = np.sort(found[(found > LOW) & (found < HIGH)].astype(np.float64))
        above = np.count_nonzero(values[~near] >= HIGH) + np.count_nonzero(found >= HIGH)
        each = float(np.prod(self.spacing)) / fine**3
        return np.concatenate([[LOW], between, [HIGH]]), int(above), each


def box_of(mask: Bool) -> tuple[slice, slice, slice]:
    """The smallest box of voxels that holds a mask, which must not be empty."""
    spans = []
    for axis in range(3):
        there = np.flatnonzero(mask.any(axis=tuple(i for i in range(3) if i != axis)))
        spans.append(slice(int(there[0]), int(there[-1]) + 1))
    return spans[0], spans[1], spans[2]


def inner_distance(mask: Bool, spacing: ArrayLike) -> Float64:
    """(z, y, x) mm from each voxel of the mask to the nearest one outside; voxels off the grid count as outside."""
    padded = np.pad(mask, 1)
    distance: Float64 = ndimage.distance_transform_edt(padded, sampling=np.asarray(spacing, dtype=np.float64))
    return distance[1:-1, 1:-1, 1:-1]
