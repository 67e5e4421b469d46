"""Pictures of volumes: three planes, and values along a line."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import map_coordinates

from palpate.arrays import AnyArray, Float64, float64
from palpate.errors import DataError
from palpate.volumes.figures import Picture, block, framed, grey, title
from palpate.volumes.orient import along_patient, knows_patient
from palpate.volumes.volume import Volume
from palpate.volumes.windows import default_window, sample, windows

PIXELS = 400  # along each side of a plane; more are not seen
EXACT = 20_000_000  # voxels whose range is found from all of them
PLANES = ((0, 1, 2), (1, 0, 2), (2, 0, 1))  # the axis cut, then those down and across
ENDS = {True: (("I", "S"), ("A", "P"), ("R", "L")), False: (("−z", "+z"), ("−y", "+y"), ("−x", "+x"))}


def plot_volume(volume: Volume, at: ArrayLike | None = None, window: tuple[float, float] | None = None) -> Picture:
    """The three planes through a point, to one scale, with a scale bar in mm and a colour bar.

    at: (x, y, z) mm, the middle if None. window: values drawn black and white; None: the 0.5th to the 99.8th
    percentile, or soft tissue for HU. A patient is seen as radiologists do, right on the left. Raises `DataError` for
    a point outside or a window without width.
    """
    low, high = _window(volume, window)
    values, grid = along_patient(volume)
    index = np.array(grid.shape) // 2 if at is None else np.rint(grid.indices(float64("at", at, (3,)))[0]).astype(int)
    if (index < 0).any() or (index >= grid.shape).any():
        raise DataError(f"at: {np.asarray(at).tolist()} mm lies outside the volume, {grid.bounds.tolist()} mm")
    sides = (np.array(grid.shape) * grid.spacing).tolist()
    sizes = [(sides[across], sides[down]) for _, down, across in PLANES]
    figure, frames = framed([sizes])
    place, ends = grid.points(index)[0], ENDS[knows_patient(volume)]
    for frame, size, (cut, down, across) in zip(frames, sizes, PLANES, strict=False):
        plane = np.take(values, index[cut], axis=cut)
        plane = plane[:: -(-plane.shape[0] // PIXELS), :: -(-plane.shape[1] // PIXELS)]
        picture = grey(frame, plane, size, (low, high), up=down == 0)
        title(frame, f"{'zyx'[cut]} = {place[2 - cut]:.1f} mm")
        for x, end, side in zip((0.02, 0.98), ends[across], ("left", "right"), strict=True):
            frame.text(x, 0.5, end, transform=frame.transAxes, color="white", fontsize=9, ha=side, va="center")
    figure.colorbar(picture, cax=frames[-1], label=volume.unit)
    return figure


def plot_profile(volumes: Volume | Mapping[str, Volume], start: ArrayLike, end: ArrayLike) -> Picture:
    """Values along the line from start to end, (x, y, z) mm, against the distance from start.

    volumes: one, or several by name. Linear between voxels; where the line is outside a volume there is a gap. Raises
    `DataError` if no volume is met.
    """
    named = {"": volumes} if isinstance(volumes, Volume) else dict(volumes)
    a, b = float64("start", start, (3,)), float64("end", end, (3,))
    figure = Picture(figsize=(8, 3.4), layout="constrained")
    axes = figure.subplots()
    lines = {name: along_line(volume, a, b) for name, volume in named.items()}
    if all(np.isnan(values).all() for _, values in lines.values()):
        raise DataError(f"profile: the line from {a.tolist()} to {b.tolist()} mm lies outside; points are (x, y, z) mm")
    for name, (distance, values) in lines.items():
        axes.plot(distance, values, label=name, lw=1.6)
    axes.set_xlabel("mm")
    axes.set_ylabel(", ".join(dict.fromkeys(volume.unit for volume in named.values())))
    if len(named) > 1:
        axes.legend(frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25)
    return figure


def along_line(volume: Volume, start: Float64, end: Float64) -> tuple[Float64, Float64]:
    """Distances (N,) mm and values (N,) at half the finest spacing; linear between voxels, NaN outside."""
    long = float(np.linalg.norm(end - start))
    count = max(2, int(np.ceil(2 * long / min(volume.grid.spacing))) + 1)
    share = np.linspace(0, 1, count)
    index = volume.grid.indices(start + share[:, None] * (end - start))
    values: Float64 = map_coordinates(volume.values, index.T, output=np.float64, order=1, mode="nearest")
    outside = ((index < -0.5) | (index > np.array(volume.grid.shape) - 0.5)).any(axis=1)
    return share * long, np.where(outside, np.nan, values)


def volume_html(volume: Volume) -> str:
    """Shape, spacing, range and three planes, for a notebook."""
    shape = " × ".join(map(str, volume.grid.shape))
    spacing = " × ".join(f"{d:.3g}" for d in volume.grid.spacing)
    words = f"Volume: {shape} voxels (z, y, x) of {spacing} mm, {value_range(volume.values)} {volume.unit}"
    return block(words, plot_volume(volume))


def value_range(values: AnyArray) -> str:
    """Lowest to highest value; of an array too large to search while one waits, of a sample."""
    some, about = (values, "") if values.size <= EXACT else (sample(values), "about ")
    return f"{about}{np.nanmin(some):.4g} to {np.nanmax(some):.4g}"


def _window(volume: Volume, window: tuple[float, float] | None) -> tuple[float, float]:
    if window is None:
        return (
            windows(volume.values[:1], "HU")["Soft tissue"][:2]
            if volume.unit == "HU"
            else default_window(volume.values)
        )
    if not window[1] > window[0]:
        raise DataError(f"window: {window} has no width; give (black, white) with white above black")
    return window
