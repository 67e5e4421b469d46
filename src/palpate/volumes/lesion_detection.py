"""Finds the brightest ball in an organ by a blob detector, and makes it a label."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from palpate.arrays import Bool, Float32, Float64
from palpate.errors import DataError
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Volume

STEP = 2**0.5  # between scales; radius is refined between them


@dataclass(frozen=True)
class Inclusion:
    """centre: (x, y, z) mm, patient space. radius: mm. contrast: attenuation above its surroundings, 1/mm.

    prominence: its blob response over that of the next best place, more than a radius away: near 1 is a guess.
    """

    centre: tuple[float, float, float]
    radius: float
    contrast: float
    prominence: float


def find_inclusion(volume: Volume, inside: Bool, smallest: float = 1.0, largest: float | None = None) -> Inclusion:
    """The bright ball in `inside` (z, y, x) whose slices answer a disc-shaped blob detector most strongly.

    The detector is the lesser of the two principal curvatures of the Gaussian-smoothed slice, scale-normalised (Lindeberg,
    IJCV 30, 1998): a disc curves down both ways, a vessel or the skin only one. It works within slices, since a
    limited-angle volume smears along z: depth is the centroid of the response there, and the ball is assumed as deep as it
    is wide. A disc of radius r answers most at sigma = r/sqrt(2). smallest, largest: radii to look for, mm;
    `largest` defaults to a quarter of the organ's smallest extent. Raises `DataError` when `inside` is empty or nothing
    in it is brighter than its surroundings.
    """
    mask = np.asarray(inside, dtype=bool)
    if mask.shape != volume.grid.shape or not mask.any():
        raise DataError(f"inside: expected a mask of shape {volume.grid.shape} with voxels in it, got {mask.shape}")
    spacing = np.array(volume.grid.spacing)
    if largest is None:
        extents = [np.ptp(np.flatnonzero(mask.any(axis=tuple({0, 1, 2} - {i})))) * spacing[i] for i in range(3)]
        largest = max(min(extents) / 4, smallest * STEP**2)
    # From the organ's median, which also fills the outside: its own edge is no blob, the margin of one sigma does the rest.
    values = np.where(mask, volume.values - np.median(volume.values[mask]), 0).astype(np.float32)
    depth_in_slice = _distance_in_slices(mask, spacing)
    sigmas = smallest / np.sqrt(2) * STEP ** np.arange(np.ceil(np.log(largest / smallest) / np.log(STEP)) + 1)
    responses = [_response(values, sigma, spacing, depth_in_slice) for sigma in sigmas]
    peaks = np.array([r.max() for r in responses])
    best = int(np.argmax(peaks))
    if not peaks[best] > 1e-4 * np.abs(volume.values).max():  # float32 noise of the filters
        raise DataError("inside: nothing there is brighter than its surroundings; give a mask of the organ alone")
    # Off its middle a ball is a smaller disc that answers as strongly at a smaller scale: size and place are read again
    # in the slice of the centroid.
    strongest = np.max(responses, axis=0)
    middle = round(float(_centroid(strongest, _place(strongest))[0]))
    near = _square(_place(strongest), largest / 2, spacing, mask.shape)
    across = np.array([r[middle][near].max() for r in responses])
    best = int(np.argmax(across))
    radius = float(np.sqrt(2) * sigmas[best] * STEP ** _vertex(across, best))
    local = np.zeros(mask.shape, np.float32)
    local[middle][near] = responses[best][middle][near]
    peak = _place(local)
    index = _centroid(strongest, peak)
    centre = volume.grid.points(index)[0]
    away = np.ones(mask.shape, dtype=bool)
    away[:, *_square(peak, radius, spacing, mask.shape)] = False
    rival = max(float((r * away).max()) for r in responses)
    return Inclusion(
        centre=(float(centre[0]), float(centre[1]), float(centre[2])),
        radius=radius,
        contrast=_contrast(values, peak, radius, spacing, mask),
        prominence=float(peaks[best]) / max(rival, 1e-30),
    )


def ball(grid: Grid, centre: tuple[float, float, float], radius: float) -> Bool:
    """(z, y, x) mask of the voxels whose centre is within `radius` mm of `centre` (x, y, z) mm, patient space."""
    i = grid.indices(centre)[0]
    z, y, x = np.ogrid[: grid.shape[0], : grid.shape[1], : grid.shape[2]]
    dz, dy, dx = grid.spacing
    inside: Bool = ((z - i[0]) * dz) ** 2 + ((y - i[1]) * dy) ** 2 + ((x - i[2]) * dx) ** 2 <= radius**2
    return inside


def _response(values: Float32, sigma: float, spacing: Float64, depth: Float64) -> Float32:
    def second(along_y: int, along_x: int) -> Float32:
        smooth = ndimage.gaussian_filter(values, widths, order=(0, along_y, along_x), truncate=3)
        return np.asarray(smooth * sigma**2 / (spacing[1] ** along_y * spacing[2] ** along_x))

    widths = (0, sigma / spacing[1], sigma / spacing[2])
    yy, xx, xy = second(2, 0), second(0, 2), second(1, 1)
    lesser = -(yy + xx) / 2 - np.hypot((yy - xx) / 2, xy)
    return np.where(depth > 2 * sigma, lesser, 0).astype(np.float32)


def _distance_in_slices(mask: Bool, spacing: Float64) -> Float64:
    # The volume's own edge is no edge of the organ (a breast goes on at the chest wall), so nothing is padded.
    depth = np.zeros(mask.shape)
    for slice_of, m in zip(depth, mask, strict=True):
        slice_of[...] = np.inf if m.all() else ndimage.distance_transform_edt(m, sampling=spacing[1:])
    return depth


def _vertex(values: Float64, i: int) -> float:
    """Offset of the vertex of the parabola through values[i-1 : i+2], within half a step."""
    if i == 0 or i == len(values) - 1:
        return 0.0
    bend = values[i - 1] - 2 * values[i] + values[i + 1]
    return float(np.clip(0.5 * (values[i - 1] - values[i + 1]) / bend, -0.5, 0.5)) if bend < 0 else 0.0


def _square(peak: tuple[int, int, int], radius: float, spacing: Float64, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Rows and columns of the slice within two radii of the peak."""
    reach = np.ceil(2 * radius / spacing[1:]).astype(int)
    low = [max(int(p) - int(n), 0) for p, n in zip(peak[1:], reach, strict=True)]
    high = [min(int(p) + int(n) + 1, m) for p, n, m in zip(peak[1:], reach, shape[1:], strict=True)]
    return slice(low[0], high[0]), slice(low[1], high[1])


def _place(response: Float32) -> tuple[int, int, int]:
    z, y, x = np.unravel_index(int(np.argmax(response)), response.shape)
    return int(z), int(y), int(x)


def _centroid(response: Float32, peak: tuple[int, int, int]) -> Float64:
    """Centroid (z, y, x) of the part above half the peak that holds the peak."""
    parts, _ = ndimage.label(response > response[peak] / 2)
    weight = np.where(parts == parts[peak], response - response[peak] / 2, 0)
    return np.array(ndimage.center_of_mass(weight))


def _contrast(values: Float32, peak: tuple[int, int, int], radius: float, spacing: Float64, mask: Bool) -> float:
    z = int(peak[0])
    y, x = np.ogrid[: values.shape[1], : values.shape[2]]
    r = np.hypot((y - peak[1]) * spacing[1], (x - peak[2]) * spacing[2])
    core, ring = r <= 0.7 * radius, (r > 1.5 * radius) & (r < 2.5 * radius) & mask[z]
    if not ring.any() or not core.any():
        return 0.0
    return float(values[z][core].mean() - np.median(values[z][ring]))
