"""Segmentation by thresholds, connected parts, hole filling and seeds."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import ndimage

from palpate.arrays import ArrayLike, Bool, Float64, Int32
from palpate.errors import DataError
from palpate.plugins import names, part
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Labels, Volume


def segment(
    volume: Volume,
    lower: float | None = None,
    upper: float | None = None,
    *,
    keep: Literal["all", "largest"] = "all",
    seed: ArrayLike | None = None,
    least_volume: float = 0.0,
    fill_holes: bool = False,
    fill_slices: bool = False,
    smooth: float = 0.0,
    opening: float = 0.0,
    name: str = "organ",
    onto: Labels | None = None,
    inside: int | str | None = None,
    method: str = "threshold",
) -> Labels:
    """Label the voxels whose value lies between two thresholds.

    The steps are: smoothing, thresholds, opening, choice of parts, filling. Parts connect through voxel faces.

    Parameters
    ----------
    volume : Volume
        The values.
    lower, upper : float, optional
        Thresholds, in the volume's unit. With neither, the lower one is Otsu's threshold.
    keep : {"all", "largest"}, optional
        Which connected parts remain.
    seed : array_like, (3,) or (N, 3), optional
        Points (x, y, z) in patient space, mm. Only the parts that hold one remain.
    least_volume : float, optional
        Smallest volume of a part, mm³.
    fill_holes : bool, optional
        Fill closed voids.
    fill_slices : bool, optional
        Fill voids that are closed within a z slice.
    smooth : float, optional
        Standard deviation of a Gaussian applied to the volume first, mm.
    opening : float, optional
        Radius of the ball that must fit, mm. It removes thin bridges.
    name : str, optional
        Name of the new label.
    onto : Labels, optional
        Labels on the same grid, which the new label is added to.
    inside : int or str, optional
        Label only within this label of `onto`.
    method : str, optional
        "threshold", or the name of a registered segmenter (`register_segmenter`). It replaces the thresholds.

    Returns
    -------
    Labels
        The new label, and those of `onto`.

    Raises
    ------
    DataError
        If no voxel is left, or an argument is not valid.

    Examples
    --------
    >>> organ = pp.segment(volume, lower=0.01, name="organ")
    >>> both = pp.segment(volume, lower=0.03, name="lump", onto=organ, inside="organ")
    >>> both.names
    {1: 'organ', 2: 'lump'}
    """
    _check(volume, lower, upper, keep, smooth, opening, least_volume, onto, inside)
    values: Float64 = volume.values.astype(np.float64)
    if smooth > 0:
        values = ndimage.gaussian_filter(values, smooth / np.array(volume.grid.spacing), mode="nearest")
    within = np.ones(values.shape, dtype=bool)
    if onto is not None and inside is not None:
        within = onto.values == onto.value_of(inside)
    own = _segmenter(method, lower, upper)
    if lower is None and upper is None and own is None:
        lower = otsu(values[within])
    low, high = -np.inf if lower is None else lower, np.inf if upper is None else upper
    if own is None:
        mask: Bool = (values >= low) & (values <= high) & within
    else:
        mask = np.asarray(own(Volume(values.astype(np.float32), volume.grid, volume.unit)), dtype=bool)
        if mask.shape != values.shape or not (mask & within).any():
            raise DataError(
                f"segment: method {method!r} gave a mask of shape {mask.shape} with {np.count_nonzero(mask)} voxels; "
                f"expected some, within shape {values.shape}"
            )
        mask = mask & within
    if not mask.any():
        shown = values[within]
        raise DataError(
            f"segment: no voxel of {name!r} from {low:g} to {high:g} {volume.unit}; values run from {shown.min():.4g} "
            f"to {shown.max():.4g} (median {np.median(shown):.4g}); choose thresholds between these"
        )
    if opening > 0:
        mask = morphological_opening(mask, volume.grid, opening)
    mask = _chosen(mask, volume.grid, keep, seed, least_volume, name)
    if fill_holes:
        mask = ndimage.binary_fill_holes(mask) & within
    if fill_slices:
        mask = np.stack([ndimage.binary_fill_holes(layer) for layer in mask]) & within
    return _labelled(mask, volume.grid, name, onto)


@dataclass(frozen=True, eq=False)
class Part:
    """A connected part of a mask: volume in mm³, centre (x, y, z) mm in patient space, mask (z, y, x)."""

    volume: float
    centre: Float64
    mask: Bool


def connected_parts(mask: Bool, grid: Grid, least_volume: float = 0.0) -> list[Part]:
    """The parts of a mask that connect through voxel faces, the largest first, without those below `least_volume` mm³.

    Of equal volumes the one that comes first in the array comes first.
    """
    part, _ = ndimage.label(mask)
    sizes = np.bincount(part.ravel())[1:] * grid.voxel_volume
    order = np.argsort(-sizes, kind="stable")
    order = order[sizes[order] >= least_volume]
    made = []
    for i in order + 1:
        here = part == i
        made.append(Part(float(sizes[i - 1]), grid.points(np.argwhere(here)).mean(axis=0), here))
    return made


def morphological_opening(mask: Bool, grid: Grid, radius: float) -> Bool:
    """Morphological opening by a ball of `radius` mm: removes bridges and spikes that are thinner.

    Off the grid the mask is taken to go on, so that an organ is not eaten away where the volume ends.
    """
    eroded = ndimage.distance_transform_edt(np.pad(mask, 1, mode="edge"), sampling=grid.spacing) > radius
    core = eroded[1:-1, 1:-1, 1:-1]
    if not core.any():
        return np.zeros_like(mask)
    grown: Bool = ndimage.distance_transform_edt(~core, sampling=grid.spacing) <= radius
    return grown & mask


def contrast(volume: Volume, mask: Bool, inner: float, outer: float) -> Float64:
    """(z, y, x) how many standard deviations a ball of `inner` mm stands out from its surroundings within the mask.

    The mean (Gaussian of `inner` mm) less the mean of the surroundings (Gaussian of `outer` mm), both over masked
    voxels only, divided by 1.4826 times the median absolute deviation of that difference over the mask. 0 off the mask.
    """
    if not 0 < inner < outer:
        raise DataError(f"contrast: expected 0 < inner < outer in mm, got {inner!r} and {outer!r}")
    if mask.shape != volume.grid.shape or not mask.any():
        raise DataError(f"contrast: expected a mask of shape {volume.grid.shape} that is not empty, got {mask.shape}")
    weight = mask.astype(np.float64)

    def mean(width: float) -> Float64:
        sigma = width / np.array(volume.grid.spacing)
        total = ndimage.gaussian_filter(weight * volume.values, sigma, mode="constant")
        share = ndimage.gaussian_filter(weight, sigma, mode="constant")
        answer: Float64 = total / np.maximum(share, 1e-12)
        return answer

    difference = np.where(mask, mean(inner) - mean(outer), 0.0)
    spread = 1.4826 * float(np.median(np.abs(difference[mask] - np.median(difference[mask]))))
    return difference / spread if spread > 0 else np.zeros_like(difference)


def otsu(values: Float64) -> float:
    """The threshold that parts values into two classes of least spread (Otsu, IEEE Trans. SMC 9, 62, 1979)."""
    from skimage.filters import threshold_otsu

    if values.min() == values.max():
        raise DataError(f"segment: all values are {values.min():g}, no threshold parts them; give lower or upper")
    return float(threshold_otsu(values))


def label_volumes(labels: Labels) -> dict[int, float]:
    """Volume in ml of each label that is present."""
    value, count = np.unique(labels.values[labels.values != 0], return_counts=True)
    return {int(v): float(n) * labels.grid.voxel_volume / 1000 for v, n in zip(value, count, strict=True)}


def _segmenter(method: str, lower: float | None, upper: float | None) -> Callable[[Volume], ArrayLike] | None:
    """The registered segmenter; None for the built-in thresholds."""
    if method not in names("segmenter"):
        raise DataError(f"segment: there is no method {method!r}; choose from {', '.join(names('segmenter'))}")
    if method != "threshold" and not (lower is None and upper is None):
        raise DataError(f"segment: method {method!r} takes no thresholds; leave out lower and upper")
    found: Callable[[Volume], ArrayLike] | None = part("segmenter", method)
    return found


def _check(
    volume: Volume,
    lower: float | None,
    upper: float | None,
    keep: str,
    smooth: float,
    opening: float,
    least_volume: float,
    onto: Labels | None,
    inside: int | str | None,
) -> None:
    for what, value in (("lower", lower), ("upper", upper)):
        if value is not None and not np.isfinite(value):
            raise DataError(f"segment: {what} must be a number in {volume.unit}, got {value!r}")
    if lower is not None and upper is not None and lower >= upper:
        raise DataError(f"segment: lower {lower:g} is not below upper {upper:g} ({volume.unit}); swap them")
    for what, value in (("smooth", smooth), ("opening", opening), ("least_volume", least_volume)):
        if not (np.isfinite(value) and value >= 0):
            raise DataError(f"segment: {what} must be 0 or more (mm; mm³ for a volume), got {value!r}")
    if keep not in ("all", "largest"):
        raise DataError(f"segment: keep is 'all' or 'largest', got {keep!r}")
    if onto is not None and onto.grid != volume.grid:
        raise DataError(
            f"segment: labels of shape {onto.grid.shape} at {onto.grid.origin} mm are on another grid than the volume "
            f"of shape {volume.grid.shape} at {volume.grid.origin} mm; resample one of them"
        )
    if inside is not None and onto is None:
        raise DataError(f"segment: inside={inside!r} needs the labels that hold it; give them as onto")


def _chosen(mask: Bool, grid: Grid, keep: str, seed: ArrayLike | None, least_volume: float, name: str) -> Bool:
    found, count = ndimage.label(mask)
    part: Int32 = found.astype(np.int32)
    if count == 0:
        raise DataError(f"segment: the opening leaves nothing of {name!r}; use a smaller radius")
    if seed is not None:
        part[~np.isin(part, _seeded(part, grid, seed))] = 0
    sizes = np.bincount(part.ravel()) * grid.voxel_volume
    sizes[0] = 0
    wanted = sizes >= max(least_volume, 1e-12)
    if not wanted.any():
        raise DataError(
            f"segment: the largest part of {name!r} has {sizes.max():.4g} mm³, none reaches least_volume "
            f"{least_volume:g} mm³; lower it"
        )
    if keep == "largest":
        wanted = np.arange(len(sizes)) == int(np.argmax(sizes))
    wanted[0] = False
    chosen: Bool = wanted[part]
    return chosen


def _seeded(part: Int32, grid: Grid, seed: ArrayLike) -> Sequence[int]:
    points = np.atleast_2d(np.asarray(seed, dtype=np.float64))
    if points.shape[1] != 3 or not np.isfinite(points).all():
        raise DataError(f"segment: a seed is x, y, z in mm, got {seed!r}")
    index = np.round(grid.indices(points)).astype(int)
    outside = ((index < 0) | (index >= np.array(grid.shape))).any(axis=1)
    if outside.any():
        corners = grid.points(np.array([(0, 0, 0), grid.shape]) - [[0], [1]])
        raise DataError(
            f"segment: seed {points[outside][0].tolist()} mm lies outside the volume, whose corners are at "
            f"{corners.min(axis=0).round(1).tolist()} and {corners.max(axis=0).round(1).tolist()} mm (patient space)"
        )
    found = part[tuple(index.T)]
    if (found == 0).any():
        off = points[found == 0][0]
        there = np.argwhere(part > 0)
        nearest = grid.points(there)[np.argmin(np.linalg.norm(grid.points(there) - off, axis=1))]
        raise DataError(
            f"segment: seed {off.tolist()} mm lies on no voxel within the thresholds; the nearest that does is at "
            f"{nearest.round(1).tolist()} mm"
        )
    return [int(v) for v in np.unique(found)]


def _labelled(mask: Bool, grid: Grid, name: str, onto: Labels | None) -> Labels:
    if onto is None:
        return Labels(mask.astype(np.int32), grid, {1: name})
    if name in onto.names.values():
        raise DataError(f"segment: the labels already hold {name!r}; choose another name")
    value = max(int(onto.values.max()), *onto.names, 0) + 1
    return Labels(np.where(mask, value, onto.values), grid, {**onto.names, value: name})
