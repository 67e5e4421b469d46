"""Local tomosynthesis: a region alone is reconstructed finely, what lies around it is modelled from a coarse volume."""

from collections import deque
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import AnyArray, Float32, Float64, float64
from palpate.errors import DataError, GeometryError
from palpate.reconstruction.multires import default_levels, pyramid
from palpate.reconstruction.projector import Projector
from palpate.reconstruction.reconstruct import iterates
from palpate.reconstruction.step import Step
from palpate.scans.scan import Scan
from palpate.scans.views import Panel, Views
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Volume

BORDER = 1  # pixels beyond the region's shadow
OPAQUE = 50.0  # a longer line integral lets no photon through, and its exponential must not become 0
COARSEST = 8  # voxels and pixels a side


def region_grid(grid: Grid, low: ArrayLike, high: ArrayLike) -> Grid:
    """The voxels of `grid` whose centres lie between the corners low and high, (x, y, z) mm in the grid's own frame.

    Raises `GeometryError` for a box that leaves the grid or is thinner than a voxel.
    """
    box = np.stack([float64("region low", low, (3,)), float64("region high", high, (3,))])
    spacing = np.array(grid.spacing[::-1])
    slack = 1e-6 * spacing
    if (box[0] < grid.bounds[0] - slack).any() or (box[1] > grid.bounds[1] + slack).any():
        raise GeometryError(
            f"region: {box.tolist()} mm reaches beyond the grid, which spans {grid.bounds.tolist()} mm, lowest and highest "
            f"(x, y, z); choose it inside"
        )
    if (box[1] - box[0] < spacing - slack).any():
        raise GeometryError(
            f"region: {box.tolist()} mm is thinner than a voxel of {spacing.tolist()} mm (x, y, z); the corners are "
            f"lowest, then highest"
        )
    first = np.ceil((box[0] - grid.bounds[0]) / spacing - 0.5 - 1e-6).astype(int)
    last = np.floor((box[1] - grid.bounds[0]) / spacing + 0.5 + 1e-6).astype(int)
    origin = np.array(grid.origin) + grid.direction @ (first * spacing)
    return Grid(np.maximum(last - first, 1)[::-1], grid.spacing, origin, grid.direction)


def local_scan(scan: Scan, grid: Grid, region: Grid, outside: Volume | None = None, **options: Any) -> Scan:
    """The scan as it would be of the region alone, on the part of the panel that the region's shadow meets.

    The incident beam is taken to have passed all that lies outside the region: incident · e^−l, l the line integrals of
    `outside` without its part in the region, so that counts stay what they are and Poisson. Whatever reconstructs a scan
    then reconstructs the region, with time and memory of the region's size:
    `reconstruct(local_scan(scan, grid, region), region)`. grid: covers the whole object. outside: attenuation of the
    whole object; None takes the last of `around`, with its `options`. Of a voxel that a face of the region cuts the share
    outside counts. Raises `DataError`, and `GeometryError` for a region that leaves the grid or that no view sees.
    Source: the idea of Ziegler, Nielsen & Grass, Med. Phys. 35:1317, 2008.
    """
    _check(grid, region)
    local = cropped(scan, region)
    if outside is None:
        outside = deque(around(scan, grid, **options), maxlen=1)[0].volume
    inside = overlapped(outside, region)
    l = Projector(local.views, outside.grid)(outside.values) - Projector(local.views, region)(inside)
    incident = local.incident * np.exp(-np.clip(l, 0, OPAQUE))
    return Scan(local.counts, incident, local.views, local.background, local.mask)


def around(scan: Scan, grid: Grid, *, halvings: int = 1, levels: int | None = None, **options: Any) -> Iterator[Step]:
    """Every iterate of the full field at a resolution halved `halvings` times; levels and options as for `iterates`.

    One halving leaves a region about as good as if all were fine; two cost a fraction and the rim suffers. Fewer are
    taken, and fewer levels, where less than 8 voxels or pixels a side would be left. Raises `DataError`.
    """
    if halvings < 0 or halvings != int(halvings):
        raise DataError(f"halvings: expected a whole number of at least 0, got {halvings!r}")
    possible = int(np.log2(max(1, min(*grid.shape[1:], *scan.shape[1:]) / COARSEST)))
    halvings = min(halvings, possible)
    coarse, field = pyramid(scan, grid, halvings + 1)[-1]
    levels = default_levels(coarse, field) if levels is None else levels
    return iterates(coarse, field, levels=min(levels, possible - halvings + 1), **options)


def cropped(scan: Scan, region: Grid) -> Scan:
    """The pixels that the region's shadow meets: one window a view, all of one size. Nothing is said of what lies around.

    Raises `GeometryError` if the shadow misses every panel.
    """
    views = scan.views
    low, high = region.bounds
    corners = [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    landed = views.project(corners)
    shape = np.array(views.shape[1:])
    first = np.floor(landed.min(axis=1) + 0.5).astype(int) - BORDER
    last = np.ceil(landed.max(axis=1) + 0.5).astype(int) + BORDER
    if ((last <= 0) | (first >= shape)).any(axis=1).all():
        raise GeometryError("region: its shadow misses every panel; choose it where the views see the object")
    size = (np.minimum(last, shape) - np.maximum(first, 0)).max(axis=0)
    first = np.clip(first, 0, shape - size)
    panels = [
        Panel(size, p.pitch, p.points(corner)[0], p.row_axis, p.column_axis)
        for p, corner in zip(views.panels, first, strict=True)
    ]
    y, b, r, mask = (
        np.stack([a[k, v : v + size[0], u : u + size[1]] for k, (v, u) in enumerate(first)])
        for a in (scan.counts, scan.incident, scan.background, scan.mask)
    )
    return Scan(y, b, Views(views.source, panels, views.direction), r, mask)


def overlapped(volume: Volume, grid: Grid) -> Float32:
    """(z, y, x) on `grid`: the mean of the volume over each voxel, by the shares in which its own voxels overlap it."""
    values: AnyArray = volume.values
    offset = grid.direction.T @ (np.array(grid.origin) - np.array(volume.grid.origin))
    for axis in range(3):
        old, new = volume.grid.spacing[axis], grid.spacing[axis]
        share = _shares(values.shape[axis], grid.shape[axis], new / old, float(offset[2 - axis]) / old)
        values = np.moveaxis(np.tensordot(share, values, (1, axis)), 0, axis)
    return np.ascontiguousarray(values, np.float32)


def _shares(old: int, new: int, width: float, first: float) -> Float64:
    """(new, old): the share of each new cell in each old one; lengths in old cells, the first new centre at `first`."""
    low = first + (np.arange(new)[:, None] - 0.5) * width
    edges = np.arange(old) - 0.5
    both = np.minimum(low + width, edges + 1) - np.maximum(low, edges)
    shares: Float64 = np.maximum(both, 0) / width
    return shares


def _check(grid: Grid, region: Grid) -> None:
    if not np.allclose(grid.direction, region.direction, atol=1e-4):
        raise GeometryError("region: grid and region have different directions; only shifts and spacings can differ")
    offset = grid.direction.T @ (np.array(region.origin) - np.array(grid.origin))
    low = offset[::-1] / grid.spacing - (np.array(region.spacing) / grid.spacing - 1) / 2
    high = low + np.array(region.shape) * region.spacing / np.array(grid.spacing)
    if (low < -1e-3).any() or (high > np.array(grid.shape) + 1e-3).any():
        raise GeometryError(
            f"region: {region.bounds.tolist()} mm reaches beyond the grid, which spans {grid.bounds.tolist()} mm, lowest "
            f"and highest (x, y, z); choose it inside"
        )
