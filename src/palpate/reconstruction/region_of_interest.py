"""Reconstruction of a region of interest; a coarse volume models the rest."""

from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from palpate.arrays import AnyArray, ArrayLike, Float32, Float64, float64
from palpate.errors import DataError, GeometryError
from palpate.reconstruction.iterate import Step
from palpate.reconstruction.models.blurred import Blurred
from palpate.reconstruction.multiresolution import default_levels, pyramid
from palpate.reconstruction.projector import Projector
from palpate.reconstruction.reconstruct import iterates
from palpate.scans.scan import Scan
from palpate.scans.views import Panel, Views
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Volume

BORDER = 1  # pixels beyond the region's shadow
OPAQUE = 50.0  # largest line integral, so that its exponential does not become 0
COARSEST = 8  # fewest voxels and pixels along a side


def region_grid(grid: Grid, low: ArrayLike, high: ArrayLike) -> Grid:
    """Return the voxels of a grid whose centres lie in a box.

    Parameters
    ----------
    grid : Grid
        The grid.
    low, high : array_like, (3,)
        Corners (x, y, z) of the box in the grid's own frame, mm.

    Returns
    -------
    Grid
        The region.

    Raises
    ------
    GeometryError
        If the box leaves the grid or is thinner than a voxel.

    Examples
    --------
    >>> pp.region_grid(grid, low=(-12, -12, 15), high=(12, 12, 35)).shape
    (4, 8, 8)
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
    """Return the scan of a region alone, on the part of the panel that the region's shadow meets.

    The incident beam is attenuated by all that lies outside the region: incident · e⁻ˡ with the line integrals l of the
    outside. The counts stay as they are and stay Poisson. Reconstruct the region from the result with any method.

    Behind a blur B the incident beam is that times B e⁻ˡ⁻ᵐ / B e⁻ᵐ, where m are the line integrals of the region as
    `outside` has it. So the model of the counts is exact where the region is as told, and off where it is not, by the
    covariance of the error of e⁻ᵐ and of e⁻ˡ within a blur's width.

    Parameters
    ----------
    scan : Scan
        The projections.
    grid : Grid
        Voxels that cover the whole object.
    region : Grid
        The voxels of the region.
    outside : Volume, optional
        Attenuation of the whole object. By default it is reconstructed coarsely.
    **options
        For that reconstruction.

    Returns
    -------
    Scan
        A scan of the region.

    Raises
    ------
    DataError
        If `outside` is not valid.
    GeometryError
        If the region leaves the grid or no view sees it.

    References
    ----------
    Ziegler, Nielsen & Grass, Med. Phys. 35:1317, 2008.

    Examples
    --------
    >>> region = pp.region_grid(grid, low=(-12, -12, 15), high=(12, 12, 35))
    >>> part = pp.local_scan(scan, grid, region, outside=volume)
    >>> pp.reconstruct(part, region, levels=1, iterations=3).values.shape
    (4, 8, 8)
    """
    _check(grid, region)
    local = crop_to_region(scan, region)
    if outside is None:
        outside = deque(reconstruct_full_field(scan, grid, **options), maxlen=1)[0].volume
    inside = average_onto(outside, region)
    whole = Projector(local.views, outside.grid)(outside.values)
    part = Projector(local.views, region)(inside)
    if local.blur is not None:
        seen = Blurred.of(local).seen
        whole, part = seen(whole), seen(part)
    incident = local.incident * np.exp(-np.clip(whole - part, 0, OPAQUE))
    return Scan(local.counts, incident, local.views, local.background, local.mask, local.notes, local.blur)


def reconstruct_full_field(
    scan: Scan, grid: Grid, *, halvings: int = 1, levels: int | None = None, **options: Any
) -> Iterator[Step]:
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
    options = {"prior": None, "resolution": None, **options}
    if options["resolution"] is not None:
        options["resolution"] *= 2**halvings
    if options["prior"] is not None and options["prior"].resolution is not None:
        options["prior"] = replace(options["prior"], resolution=options["prior"].resolution * 2**halvings)
    return iterates(coarse, field, levels=min(levels, possible - halvings + 1), **options)


def crop_to_region(scan: Scan, region: Grid) -> Scan:
    """The pixels that the region's shadow meets: one window a view, all of one size. Nothing is said of what lies around.

    A blur is that through the middle of the region. It makes the window wider by twice its reach: all of the light that
    has met the region is then seen with all of the light around it. Raises `GeometryError` if the shadow misses every panel.
    """
    views, blur, border = scan.views, None, BORDER
    if scan.blur is not None:
        blur = scan.blur.through(region)
        border += 2 * (blur.taps(views).shape[2] - 1)
    low, high = region.bounds
    corners = [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    landed = views.project(corners)
    shape = np.array(views.shape[1:])
    first = np.floor(landed.min(axis=1) + 0.5).astype(int) - border
    last = np.ceil(landed.max(axis=1) + 0.5).astype(int) + border
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
    return Scan(y, b, Views(views.source, panels, views.direction), r, mask, scan.notes, blur)


def average_onto(volume: Volume, grid: Grid) -> Float32:
    """(z, y, x) on `grid`: the mean of the volume over each voxel, by the shares in which its own voxels overlap it."""
    values: AnyArray = volume.values
    offset = grid.direction.T @ (np.array(grid.origin) - np.array(volume.grid.origin))
    for axis in range(3):
        old, new = volume.grid.spacing[axis], grid.spacing[axis]
        share = _overlap_matrix(values.shape[axis], grid.shape[axis], new / old, float(offset[2 - axis]) / old)
        values = np.moveaxis(np.tensordot(share, values, (1, axis)), 0, axis)
    return np.ascontiguousarray(values, np.float32)


def _overlap_matrix(old: int, new: int, width: float, first: float) -> Float64:
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
