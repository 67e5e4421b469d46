"""The default grid of a scan."""

import numpy as np

from palpate.arrays import Float64
from palpate.errors import GeometryError
from palpate.scans.views import Panel, Views, from_above
from palpate.volumes.grid import Grid

COARSEST_SLICE = 8  # in-plane voxels
MOST_VOXELS = 2e9  # 8 GB of float32


def covering_grid(views: Views, thickness: float | None, spacing: float | None = None) -> Grid:
    """Return the box that at least half of the views see.

    Above a horizontal panel the box begins at the panel. Otherwise it surrounds the point nearest to all central rays.
    The slice thickness is such that the parallax of a voxel over half of the sources' range is one voxel.

    Where the views look from several sides, the box reaches as far around that point as all of them see, with cubic voxels.

    Parameters
    ----------
    views : Views
        The geometry.
    thickness : float, optional
        Depth of the box, mm. Views from above cannot do without it: they do not know how thick the object is.
    spacing : float, optional
        Voxel size in the slice, mm. The default is the pixel pitch at mid-depth.

    Returns
    -------
    Grid
        The box.

    Raises
    ------
    GeometryError
        If there is no thickness, the views share no field there, or the grid would be too large.

    Examples
    --------
    >>> pp.covering_grid(views, thickness=40, spacing=4).spacing[1:]
    (4.0, 4.0)
    """
    if spacing is not None and not (np.isfinite(spacing) and spacing > 0):
        raise GeometryError(
            f"spacing: expected a positive length in mm, got {spacing!r}; leave it out for the pixel's own"
        )
    if (thickness is None or thickness > 0) and not from_above(views, central_point(views)).all():
        return _surrounding_grid(views, thickness, spacing)
    if thickness is None or not thickness > 0:
        raise GeometryError(
            f"thickness: how deep the object is cannot be known from the geometry, got {thickness!r}; give thickness=... "
            f"in mm (palpate reconstruct --thickness), or a Grid"
        )
    level = [abs(abs(p.normal[2]) - 1) < 1e-6 for p in views.panels]
    centre = central_point(views)
    low_z = max(float(p.origin[2]) for p in views.panels) if all(level) else float(centre[2]) - thickness / 2
    middle = low_z + thickness / 2
    if views.source[:, 2].min() <= low_z + thickness:
        raise GeometryError(
            f"thickness: {thickness:g} mm reaches z = {low_z + thickness:g} mm, the lowest focal spot is at "
            f"z = {views.source[:, 2].min():g} mm; give the thickness of the object in mm"
        )
    fields = np.array(
        [_field(s, p, z) for s, p in zip(views.source, views.panels, strict=True) for z in (low_z, low_z + thickness)]
    )
    low, high = np.median(fields[:, 0], axis=0), np.median(fields[:, 1], axis=0)
    if (high <= low).any():
        raise GeometryError("thickness: the views share no field at this depth; give a Grid")
    width = spacing if spacing is not None else _pixel_at(views, middle)
    depth = _slice(views, np.array([*(low + high) / 2, middle]), width)
    shape = np.maximum(np.floor([thickness / depth, *((high - low) / width)[::-1]]), 1)
    _check_size(shape, width)
    step = np.array([thickness / shape[0], width, width])
    corner = np.array([*((low + high) / 2 - shape[:0:-1] * width / 2), low_z])
    return Grid(shape, step, corner + step[::-1] / 2, views.direction)


def _surrounding_grid(views: Views, thickness: float | None, spacing: float | None) -> Grid:
    """The box around the central point that all views see, each axis by itself; cubic voxels of the pixels' size there."""
    centre = central_point(views)
    half, pitch = np.full(3, np.inf), []
    for source, panel in zip(views.source, views.panels, strict=True):
        middle = panel.points([(n - 1) / 2 for n in panel.shape])[0]
        shrunk = np.linalg.norm(centre - source) / np.linalg.norm(middle - source)
        pitch.append(min(panel.pitch) * shrunk)
        for axis, n, d in zip((panel.row_axis, panel.column_axis), panel.shape, panel.pitch, strict=True):
            along = np.abs(axis)
            half = np.minimum(half, np.where(along > 0.5, n * d * shrunk / 2 / np.maximum(along, 0.5), np.inf))
    if thickness is not None:
        half[2] = thickness / 2
    half = np.where(np.isfinite(half), half, np.max(half, where=np.isfinite(half), initial=0))
    width = spacing if spacing is not None else float(np.mean(pitch))
    shape = np.maximum(np.floor(2 * half[::-1] / width), 1)
    _check_size(shape, width)
    return Grid(shape, (width,) * 3, centre - (shape[::-1] - 1) / 2 * width, views.direction)


def _check_size(shape: Float64, width: float) -> None:
    """Raises `GeometryError` for more voxels than are taken."""
    if shape.prod() > MOST_VOXELS:
        raise GeometryError(
            f"spacing: {width:g} mm makes {shape.prod() / 1e9:.3g} thousand million voxels, at most {MOST_VOXELS / 1e9:.3g} "
            f"are taken; give a larger one (palpate reconstruct --spacing)"
        )


def _field(source: Float64, panel: Panel, z: float) -> Float64:
    """(2, 2): lowest and highest (x, y) at height z that the panel sees, mm."""
    rows, columns = panel.shape
    corners = panel.points([(r, c) for r in (-0.5, rows - 0.5) for c in (-0.5, columns - 0.5)])
    rays = corners - source
    at = source + ((z - source[2]) / rays[:, 2])[:, None] * rays
    return np.stack([at[:, :2].min(axis=0), at[:, :2].max(axis=0)])


def central_point(views: Views) -> Float64:
    """The point nearest to all central rays."""
    normal, offset = np.zeros((3, 3)), np.zeros(3)
    for source, panel in zip(views.source, views.panels, strict=True):
        line = panel.points([(n - 1) / 2 for n in panel.shape])[0] - source
        ray = line / np.linalg.norm(line)
        across = np.eye(3) - np.outer(ray, ray)
        normal = normal + across
        offset = offset + across @ source
    return np.asarray(np.linalg.lstsq(normal, offset, rcond=None)[0], dtype=np.float64)


def _pixel_at(views: Views, z: float) -> float:
    """Pixel pitch as seen at height z, mm; the mean view."""
    pitches = []
    for source, panel in zip(views.source, views.panels, strict=True):
        middle = panel.points([(n - 1) / 2 for n in panel.shape])[0]
        pitches.append(min(panel.pitch) * (source[2] - z) / (source[2] - middle[2]))
    return float(np.mean(pitches))


def _slice(views: Views, centre: Float64, width: float) -> float:
    """Slice thickness, mm: over it the extreme rays part by two voxels."""
    slopes = (views.source[:, :2] - centre[:2]) / (views.source[:, 2] - centre[2])[:, None]
    half = np.ptp(slopes, axis=0).max() / 2
    return float(np.clip(width / max(half, 1e-9), width, COARSEST_SLICE * width))
