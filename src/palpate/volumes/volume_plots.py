"""Plots of volumes: three planes, and values along a line."""

from collections.abc import Mapping

import numpy as np
from scipy.ndimage import map_coordinates

from palpate.arrays import AnyArray, ArrayLike, Float64, float64
from palpate.errors import DataError
from palpate.volumes.display_window import default_window, sample, window_presets
from palpate.volumes.notebook_figure import Picture, figure_of_frames, html_block, line_style
from palpate.volumes.patient_axes import LabelImage, VoxelImage, patient_grid
from palpate.volumes.plane_picture import draw_plane, plane_size

EXACT = 20_000_000  # voxels whose range is found from all of them


def plot_volume(
    volume: VoxelImage,
    at: ArrayLike | None = None,
    window: tuple[float, float] | None = None,
    *,
    labels: LabelImage | None = None,
    reach: float | None = None,
    y_up: bool = False,
) -> Picture:
    """Draw the three planes of a volume through a point, to one scale.

    The picture has a scale bar in mm and a colour bar. A patient's right side is on the left, as
    radiologists look at it, in whatever order a file stores the voxels. Letters at the edges say the directions.

    Parameters
    ----------
    volume : Volume
        What to draw.
    at : array_like, (3,), optional
        Point (x, y, z), mm. The default is the middle.
    window : tuple of float, optional
        The values drawn black and white. The default is the 0.5th to the 99.8th percentile, or soft tissue for HU.
    labels : Labels, optional
        Labels on the same grid, to be outlined.
    reach : float, optional
        How much to show on either side of the point, mm. The default is all.
    y_up : bool, optional
        Draw y upwards in the plane across z, for a system whose y is vertical.

    Returns
    -------
    Picture
        A Matplotlib figure.

    Raises
    ------
    DataError
        If the point lies outside the volume, the window has no width, or the labels are on another grid.

    Examples
    --------
    >>> figure = pp.plot_volume(volume, at=(0, 0, 30), labels=labels)
    >>> figure.savefig("planes.png")
    """
    window = _window(volume, window)
    if labels is not None and labels.grid != volume.grid:
        raise DataError("labels: their grid is not the volume's; resample one of them first")
    if at is None:
        upright = patient_grid(volume.grid)  # or the middle of an even number would depend on the file's order
        at = upright.points(np.array(upright.shape) // 2)[0]
    figure, frames = figure_of_frames([[plane_size(volume.grid, at, cut, reach) for cut in range(3)]])
    for cut, frame in enumerate(frames[:3]):
        outlined = None if labels is None else labels.values
        picture = draw_plane(frame, volume, at, cut, window, labels=outlined, reach=reach, y_up=y_up)
    figure.colorbar(picture, cax=frames[-1], label=volume.unit)
    return figure


def plot_profile(volumes: VoxelImage | Mapping[str, VoxelImage], start: ArrayLike, end: ArrayLike) -> Picture:
    """Plot values along a line.

    Values are interpolated linearly between voxels. The curve has a gap where the line is outside a volume.

    Parameters
    ----------
    volumes : Volume or mapping of str to Volume
        One volume, or several by name.
    start, end : array_like, (3,)
        Ends of the line, (x, y, z), mm.

    Returns
    -------
    Picture
        A Matplotlib figure, with the distance from `start` in mm.

    Raises
    ------
    DataError
        If the line meets no volume.

    Examples
    --------
    >>> figure = pp.plot_profile({"truth": volume}, start=(-30, 0, 24), end=(30, 0, 24))
    """
    named = dict(volumes) if isinstance(volumes, Mapping) else {"": volumes}
    a, b = float64("start", start, (3,)), float64("end", end, (3,))
    figure = Picture(figsize=(8, 3.4), layout="constrained")
    axes = figure.subplots()
    lines = {name: along_line(volume, a, b) for name, volume in named.items()}
    if all(np.isnan(values).all() for _, values in lines.values()):
        raise DataError(f"profile: the line from {a.tolist()} to {b.tolist()} mm lies outside; points are (x, y, z) mm")
    for i, (name, (distance, values)) in enumerate(lines.items()):
        axes.plot(distance, values, label=name, lw=1.6, **(line_style(i) if len(lines) > 1 else {}))
    axes.set_xlabel("mm")
    axes.set_ylabel(", ".join(dict.fromkeys(volume.unit for volume in named.values())))
    if len(named) > 1:
        axes.legend(frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25)
    return figure


def along_line(volume: VoxelImage, start: Float64, end: Float64) -> tuple[Float64, Float64]:
    """Distances (N,) mm and values (N,) at half the finest spacing; linear between voxels, NaN outside."""
    long = float(np.linalg.norm(end - start))
    count = max(2, int(np.ceil(2 * long / min(volume.grid.spacing))) + 1)
    share = np.linspace(0, 1, count)
    index = volume.grid.indices(start + share[:, None] * (end - start))
    values: Float64 = map_coordinates(volume.values, index.T, output=np.float64, order=1, mode="nearest")
    outside = ((index < -0.5) | (index > np.array(volume.grid.shape) - 0.5)).any(axis=1)
    return share * long, np.where(outside, np.nan, values)


def volume_html(volume: VoxelImage) -> str:
    """Shape, spacing, range and three planes, for a notebook."""
    shape = " × ".join(map(str, volume.grid.shape))
    spacing = " × ".join(f"{d:.3g}" for d in volume.grid.spacing)
    words = f"Volume: {shape} voxels (z, y, x) of {spacing} mm, {value_range(volume.values)} {volume.unit}"
    return html_block(words, plot_volume(volume))


def value_range(values: AnyArray) -> str:
    """Lowest to highest value; of an array too large to search while one waits, of a sample."""
    some, about = (values, "") if values.size <= EXACT else (sample(values), "about ")
    return f"{about}{np.nanmin(some):.4g} to {np.nanmax(some):.4g}"


def _window(volume: VoxelImage, window: tuple[float, float] | None) -> tuple[float, float]:
    if window is None:
        return (
            window_presets(volume.values[:1], "HU")["Soft tissue"][:2]
            if volume.unit == "HU"
            else default_window(volume.values)
        )
    if not window[1] > window[0]:
        raise DataError(f"window: {window} has no width; give (black, white) with white above black")
    return window
