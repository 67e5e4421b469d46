"""The object's support: its visual hull, from pixels that see nothing but air, as a constraint f = 0 outside."""

import warnings
from statistics import NormalDist

import numpy as np
from scipy.ndimage import binary_dilation, uniform_filter

from palpate.arrays import AnyArray, Bool, Float32, Float64, UInt8, UInt16
from palpate.errors import DataError, GeometryError
from palpate.reconstruction.air_level import air_levels, expected_in_air, without_sheet
from palpate.reconstruction.multiresolution import coarser_grid, coarser_scan
from palpate.reconstruction.optimizers.problem import OUTLINE
from palpate.reconstruction.prior_parameters import box_lengths
from palpate.reconstruction.projector import Projector
from palpate.scans.scan import Scan
from palpate.scans.views import Panel, Views
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Labels, Volume

FALSE_ALARM = 1e-3  # share of the pixels in air that noise alone makes part of the shadow
THIN = 0.02  # line integral that a window must be large enough to show: 0.5 mm of water at 30 keV
POWER = 0.99  # probability with which it is then seen
WIDEST = 31  # pixels along a window
CELLS = 256  # along a slice, at most
VIEWS, SHARE = 2, 0.1  # views that must see air, at least, and of those that see the voxel
TOUCHED = 0.01  # of a voxel's footprint; less is rounding
UNSEEN = 0.02  # share of the shadow's pixels whose ray a mask may miss

Support = str | Labels | Volume | AnyArray


def support_hull(scan: Scan, grid: Grid) -> Labels:
    """Find the voxels that may hold the object: its visual hull, with the noise of the counts taken into account.

    A pixel sees air if its counts are compatible with those in air. In windows W of 1, 3, 7, ... pixels, up to the size at
    which a line integral of 0.02 is seen with a probability of 99 %, a pixel belongs to the object's shadow if

        2 √(Σ λ + 1/8) − 2 √(Σ y + 3/8) > z,   sums over the pixels of W that no smaller window has found,

    where y are the counts, λ those expected in air, and z the normal quantile for 0.1 % false alarms in all windows
    together (Anscombe's transform, which makes Poisson counts nearly normal). λ = incident · e^(−a sec θ) + background.
    The sheet a, such as a compression paddle, is read from the brightest even region of each view; θ is the angle between
    ray and panel normal.

    A voxel is outside if, in at least two views and a tenth of those that see it, its whole footprint lies on the panel
    and sees air, at least a pixel away from the shadow and from pixels that were not measured. So what leaves the panel
    is kept, and so is all of the grid where no view sees air; a warning says so. Grids of more than 256 voxels along a
    slice are cut by cells of 2 x 2 voxels, 4 x 4, ..., with pixels as much larger.

    Parameters
    ----------
    scan : Scan
        The projections. Scatter belongs into its `background`: what brightens the air hides thin rims.
    grid : Grid
        The voxels.

    Returns
    -------
    Labels
        1 ("support") where the object may be, 0 outside.

    Raises
    ------
    GeometryError
        If the grid does not fit the scan.

    References
    ----------
    Laurentini, IEEE PAMI 16:150, 1994 (visual hull). Anscombe, Biometrika 35:246, 1948.

    Examples
    --------
    >>> inside = pp.support_hull(scan, grid)
    >>> inside.names
    {1: 'support'}
    >>> bool(inside.values[volume.values > 0].all())
    True
    """
    air, seen = _air_views(scan, grid)
    return Labels(_hull(air, seen).astype(np.int32), grid, {1: "support"})


def _air_views(scan: Scan, grid: Grid) -> tuple[UInt16, UInt16]:
    """(z, y, x) each: how many views show a voxel in air, and how many show all of its footprint.

    Of a large grid by cells of several voxels, from pixels as much larger: a cell is in air if all of it is.
    """
    Projector(scan.views, grid)  # raises GeometryError before any work
    fine = grid
    while max(grid.shape[1:]) > CELLS and min(*grid.shape[1:], *scan.shape[1:]) > CELLS / 4:
        scan, grid = coarser_scan(scan), coarser_grid(grid)
    air, seen = (np.zeros(grid.shape, np.uint16) for _ in range(2))
    for k, level in enumerate(air_levels(scan)):
        shadow = object_shadow(scan, k, level)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                back = Projector(_with_margin(scan.views[k]), grid).T
        except GeometryError:
            continue  # this view alone does not see the grid
        within = np.pad(shadow.astype(np.float32), 1)[None]
        beyond = np.pad(np.zeros_like(shadow, np.float32), 1, constant_values=1)[None]
        whole = back(np.ones_like(within))
        on_panel = (whole > 0) & (back(beyond) <= TOUCHED * whole)
        seen += on_panel
        air += on_panel & (back(within) <= TOUCHED * whole)
    for axis, step in enumerate(np.round(np.array(grid.spacing) / fine.spacing).astype(int)):
        air, seen = (np.repeat(a, step, axis).take(range(fine.shape[axis]), axis) for a in (air, seen))
    return air, seen


def _hull(air: UInt16, seen: UInt16) -> Bool:
    """(z, y, x): voxels that too few views show in air. Warns where that is all of them, or none."""
    inside = np.asarray(air < np.maximum(VIEWS, np.ceil(SHARE * seen)), np.bool_)
    if not inside.any():
        warnings.warn("support: all views show air everywhere; nothing is cut", stacklevel=3)
        inside[:] = True
    elif inside.all():
        warnings.warn("support: no view shows air beside the object; nothing is cut", stacklevel=3)
    return inside


def _with_margin(view: Views) -> Views:
    """One view whose panel has a pixel more on each side: what leaves the panel lands there."""
    p = view.panels[0]
    shape = p.shape[0] + 2, p.shape[1] + 2
    return Views(view.source, [Panel(shape, p.pitch, p.points([-1, -1])[0], p.row_axis, p.column_axis)], view.direction)


def chosen_support(support: Support, method: str, scan: Scan, grid: Grid) -> tuple[UInt8, Scan, bool]:
    """(z, y, x): 0 outside, 1 inside a hull, `OUTLINE` inside a mask; the scan without a sheet; whether a flat start fits.

    The hull is not held where rays bring attenuation from beyond the grid's sides: it would press that into the object.
    Raises `DataError`; warns of that, and of a mask that the counts contradict.
    """
    if method not in ("map", "ml"):
        raise DataError(f"support: of the methods map and ml only, got {method!r}; leave it out")
    if isinstance(support, str):
        if support != "hull":
            raise DataError(f"support: there is no {support!r}; choose from none, hull, or give a mask")
        air, seen = _air_views(scan, grid)
        inside = _hull(air, seen).astype(np.uint8)
        if inside.all():
            return inside, scan, False
        crossed = rays_leave_support((air == 0) & (seen >= VIEWS), scan.views, grid)
        if crossed:
            words = (
                "the object reaches beyond a side of the grid that rays cross, and f = 0 outside the hull is not held"
            )
            warnings.warn(f"support: {words}; take a wider grid if the panel sees more", stacklevel=3)
            inside[:] = 1
        return inside, without_sheet(scan), not crossed
    if isinstance(support, Labels | Volume) and support.grid != grid:
        raise DataError(
            f"support: expected a mask on the grid {grid!r}, got one on {support.grid!r}; resample it first"
        )
    mask = np.asarray(support)
    if mask.shape != grid.shape or mask.dtype.kind not in "biuf":
        raise DataError(f"support: expected a mask of shape {grid.shape}, got {mask.shape} of {mask.dtype}")
    if not np.isfinite(mask).all():
        raise DataError("support: the mask is not finite everywhere; write 0 outside and 1 inside")
    inside = np.ascontiguousarray(mask > 0, np.uint8)
    if not inside.any():
        raise DataError("support: the mask is empty; it is above 0 where the object may be")
    _warn_of_missed_object(inside, scan, grid)
    flat = not rays_leave_support(inside, scan.views, grid)
    return OUTLINE * inside, scan if inside.all() else without_sheet(scan), flat


def _warn_of_missed_object(inside: UInt8, scan: Scan, grid: Grid) -> None:
    """Warns if rays that pass the grid, but not the mask, are attenuated."""
    hit = Projector(scan.views, grid)(inside.astype(np.float32)) > 0
    missed = total = 0
    for k, level in enumerate(air_levels(scan)):
        object_seen = seen_object(scan, k, level) & (box_lengths(scan.views[[k]], grid)[0] > 0)
        total += int(object_seen.sum())
        missed += int((object_seen & ~hit[k]).sum())
    if missed > UNSEEN * total:
        words = f"support: {missed / total:.0%} of the rays through an object within the grid do not meet the mask"
        warnings.warn(f"{words}; it leaves out a part of the object, or lies elsewhere", stacklevel=4)


def rays_leave_support(inside: AnyArray, views: Views, grid: Grid) -> bool:
    """Whether the object reaches a side of the grid that rays cross: they bring attenuation from beyond."""
    height = grid.shape[0] * grid.spacing[0]
    source = grid.indices(views.source)  # (z, y, x)
    drop = np.maximum(np.abs(source[:, 0]) * grid.spacing[0], 1e-9)
    for axis in (1, 2):
        for face, end in ((0, -0.5), (-1, grid.shape[axis] - 0.5)):
            run = np.abs(source[:, axis] - end) * height / drop  # voxels that a ray near the face goes across it
            if run.max() > 1 and inside.take(face, axis).any():
                return True
    return False


def object_shadow(scan: Scan, view: int, level: float) -> Bool:
    """(rows, columns): where the panel does not surely see air, and a pixel around it."""
    unknown = seen_object(scan, view, level) | ~scan.mask[view]
    return np.asarray(binary_dilation(unknown, np.ones((3, 3), np.bool_)), np.bool_)


def seen_object(scan: Scan, view: int, level: float) -> Bool:
    """(rows, columns): measured pixels that see more than air, see `support_hull`."""
    y, expected, left = scan.counts[view], expected_in_air(scan, view, level), scan.mask[view].copy()
    widths = windows(float(np.median(expected[left])) if left.any() else 1.0)
    z = quantile(FALSE_ALARM / len(widths))
    for width in widths:
        summed, wanted = (_summed(np.where(left, a, 0), width) for a in (y, expected))
        left &= 2 * (np.sqrt(wanted + 1 / 8) - np.sqrt(summed + 3 / 8)) <= z
    return np.asarray(scan.mask[view] & ~left, np.bool_)


def quantile(tail: float) -> float:
    """What a normal variable exceeds with this probability."""
    return -NormalDist().inv_cdf(tail)


def windows(counts: float) -> list[int]:
    """Pixels along each window, for so many counts a pixel in air: 1, 3, 7, ... until a line integral `THIN` is seen."""
    needed = ((quantile(FALSE_ALARM) + quantile(1 - POWER)) / THIN) ** 2
    widths = [1]
    while widths[-1] ** 2 * counts < needed and widths[-1] < WIDEST:
        widths.append(2 * widths[-1] + 1)
    return widths


def _summed(values: Float32, width: int) -> Float64:
    """Over windows around each pixel."""
    exact: Float64 = values.astype(np.float64)
    return exact if width == 1 else np.maximum(uniform_filter(exact, width, mode="constant") * width**2, 0)
