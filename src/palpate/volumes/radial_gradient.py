"""Finds a lump's place and radius by the gradient across its outline: where a circle is the best edge."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from palpate.arrays import ArrayLike, Bool, Float32, Float64, Int64, float64
from palpate.errors import DataError
from palpate.volumes.volume import Volume

ANGLES = 24  # along a circle
STEP, RADIUS_STEP = 1.0, 0.5  # mm between the centres and the radii that are tried
SMOOTH = 0.8  # mm, standard deviation of the Gaussian before the gradient
RADII = 3.0, 11.0  # mm, of the balls that are looked for
FAVOUR = 0.25  # exponent of the radius: a longer circle averages more of the texture
SKIN = 2  # voxels below the organ's outline that are left out: the step from skin to air is no lump's


@dataclass(frozen=True)
class Ball:
    """centre: (x, y, z) mm, patient space. radius: mm."""

    centre: tuple[float, float, float]
    radius: float


def ball_near(
    volume: Volume,
    near: ArrayLike,
    reach: float = 5.0,
    depth_reach: float | None = None,
    radii: tuple[float, float] = RADII,
    inside: Bool | None = None,
) -> Ball:
    """The bright ball near a place whose outline in a slice has the steepest mean radial gradient.

    Circles of every slice, centre and radius within reach are compared by the mean of −∂f/∂r along them (Kupinski & Giger,
    IEEE Trans. Med. Imaging 17:510, 1998), times the fourth root of the radius. Slices alone are looked at, since depth
    is smeared in a limited-angle volume; the middle slice has the sharpest circle, and the ball is as deep as wide.

    near: (3,) mm. reach, depth_reach: mm from it, across and in depth; None: all slices. radii: least and greatest, mm.
    inside: (z, y, x) the organ; what is outside counts as its median, and the ball lies between its first and last slice.
    Raises `DataError` if nothing is in reach.
    """
    spacing, low, high = np.array(volume.grid.spacing), *radii
    if not (0 < low < high and reach > 0 and (depth_reach is None or depth_reach > 0)):
        raise DataError(f"ball: expected 0 < radii and reach in mm, got radii {radii}, reach {reach}, {depth_reach}")
    at = volume.grid.indices(float64("near", near, (3,)))[0]
    if ((at < -0.5) | (at > np.array(volume.grid.shape) - 0.5)).any():
        raise DataError(f"near: {np.asarray(near).tolist()} mm lies outside the volume {volume.grid}")
    slices = np.arange(volume.grid.shape[0])
    if depth_reach is not None:
        slices = slices[np.abs(slices - at[0]) <= max(depth_reach / spacing[0], 0.5)]
    wide = np.ceil((reach + high + 4 * SMOOTH) / spacing[1:]).astype(int) + 1
    first = np.maximum(np.round(at[1:]).astype(int) - wide, 0)
    box = slice(slices[0], slices[-1] + 1), *(slice(a, a + 2 * n + 1) for a, n in zip(first, wide, strict=True))
    values = _within(volume.values, inside, box)
    offsets = np.arange(-np.floor(reach / STEP), reach / STEP + 1e-9) * STEP
    middle = (at[1:] - first) * spacing[1:]
    tried = np.arange(low, high + 1e-9, RADIUS_STEP)
    score = _mean_radial_gradient(values, spacing, middle, offsets, tried) * tried**FAVOUR
    if inside is not None:
        score = np.where(_fits(inside, slices, tried / spacing[0])[:, None, None, :], score, -np.inf)
        if not np.isfinite(score).any():
            raise DataError(f"radii: the organ is thinner than a ball of {low:g} mm radius within reach")
    best = np.unravel_index(int(np.argmax(score)), score.shape)
    z, dy, dx, r = (float(k) + _vertex(score, best, axis) for axis, k in enumerate(best))
    across = [middle[i] + offsets[0] + STEP * step for i, step in enumerate((dy, dx))]
    centre = volume.grid.points(np.array([[slices[0] + z, *(first + across / spacing[1:])]]))[0]
    return Ball((float(centre[0]), float(centre[1]), float(centre[2])), low + RADIUS_STEP * r)


def _within(values: Float32, inside: Bool | None, box: tuple[slice, ...]) -> Float64:
    """The box of the volume, with the organ's median outside the organ and just below its outline."""
    part = values[box].astype(np.float64)
    if inside is None:
        return part
    here = np.pad(inside[box], ((0, 0), (SKIN, SKIN), (SKIN, SKIN)), mode="edge")
    core = ndimage.binary_erosion(here, np.ones((1, 3, 3), dtype=bool), iterations=SKIN, border_value=1)[
        :, SKIN:-SKIN, SKIN:-SKIN
    ]
    if not core.any():
        raise DataError("near: nothing of the organ is in reach; give a place inside it")
    return np.where(core, part, np.median(part[core]))


def _mean_radial_gradient(
    values: Float64, spacing: Float64, middle: Float64, offsets: Float64, radii: Float64
) -> Float64:
    """(slices, y, x, radii): the mean of −∂f/∂r, per mm, along circles about middle + offsets, mm in the box."""
    smooth = ndimage.gaussian_filter(values, (0, SMOOTH / spacing[1], SMOOTH / spacing[2]), mode="nearest")
    slopes = [np.gradient(smooth, spacing[axis], axis=axis) for axis in (1, 2)]
    angle = 2 * np.pi * np.arange(ANGLES) / ANGLES
    way = np.sin(angle), np.cos(angle)
    shape = len(offsets), len(offsets), len(radii), ANGLES
    y = (middle[0] + offsets[:, None, None, None] + radii[:, None] * way[0]) / spacing[1]
    x = (middle[1] + offsets[:, None, None] + radii[:, None] * way[1]) / spacing[2]
    places = np.stack([np.broadcast_to(y, shape), np.broadcast_to(x, shape)])
    found = np.empty((len(values), *shape[:3]))
    for k in range(len(values)):
        along = [
            ndimage.map_coordinates(slope[k], places, order=1, mode="nearest") * w
            for slope, w in zip(slopes, way, strict=True)
        ]
        found[k] = -(along[0] + along[1]).mean(axis=-1)
    return found


def _fits(inside: Bool, slices: Int64, radii: Float64) -> Bool:
    """(slices, radii): whether a ball of so many slices' radius lies between the organ's first and last slice."""
    filled = np.flatnonzero(inside.any(axis=(1, 2)))
    room = np.minimum(slices - filled[0], filled[-1] - slices) + 0.5
    return np.asarray(room[:, None] >= radii)


def _vertex(score: Float64, best: tuple[np.intp, ...], axis: int) -> float:
    """Offset of the vertex of the parabola through the best place and its neighbours along an axis, within half a step."""
    line = score[tuple(slice(None) if k == axis else i for k, i in enumerate(best))]
    i = int(best[axis])
    if i in (0, len(line) - 1):
        return 0.0
    if not np.isfinite(line[[i - 1, i + 1]]).all():
        return 0.0
    bend = line[i - 1] - 2 * line[i] + line[i + 1]
    return float(np.clip(0.5 * (line[i - 1] - line[i + 1]) / bend, -0.5, 0.5)) if bend < 0 else 0.0
