"""Fits views to the shadows of points at known places: each view by itself, over a still panel, or as one rotation."""

from dataclasses import dataclass

import numpy as np

from palpate.arrays import Bool, Float64
from palpate.errors import DataError, GeometryError
from palpate.scans.geometry_fit import GeometryFit, fit_geometry, in_words
from palpate.scans.rigid_motion import RIGID, RIGID_UNITS, rigid_motion
from palpate.scans.view_parameters import PARAMETERS, UNITS, Poses, moved, shadow_slopes, shadows

LENGTH, ANGLE, ARC = 0.02, 1.0, 10.0  # how far the start may be off: of the distance source-panel, degrees, %
# Points that a view must show: fitted by itself, so that a wrong assignment is seen; or with others.
ALONE, SHARED = 8, 4
STEP = 1e-3  # mm, degrees, %: for slopes by central differences
WEAK = 0.6  # of the balls that the typical view shows: with fewer a view's first assignment may be wrong
FLAT = 0.01  # of its width: a cloud of points thinner than that is flat


@dataclass(frozen=True, eq=False)
class FittedViews:
    """Poses; residuals (views, N, 2) pixels, NaN where unused; used (views, N); numbers fitted, as in `BallCalibration`."""

    at: Poses
    residuals: Float64
    used: Bool
    names: tuple[str, ...]
    changes: Float64
    deviations: Float64
    undetermined: tuple[str, ...]


def fit_views(
    at: Poses,
    points: Float64,
    seen: Float64,
    sure: Float64,
    *,
    rigid: bool = False,
    still_panel: bool | None = None,
    strict: bool = True,
) -> FittedViews:
    """The poses for which shadows of points (N, 3) mm come nearest to where they were seen, (views, N, 2) pixels or NaN.

    sure: their standard deviations. strict: refuse views that show too few points; otherwise they move like their
    neighbours. Raises `DataError`, and `GeometryError` if the start is not what is asked for.
    """
    still = bool((at.axes == at.axes[0]).all() and (at.middle == at.middle[0]).all())
    if still_panel and not still:
        raise GeometryError("still_panel: the start has panels that differ; give one panel for all views")
    there = np.asarray(np.isfinite(seen).all(axis=2))
    together = rigid or (still if still_panel is None else still_panel)
    fewest = SHARED if together else ALONE
    few = there.sum(axis=1) < fewest
    if few.any() and (strict or few.all()):
        k = int(np.flatnonzero(few)[0])
        raise DataError(
            f"view {k}: {there[k].sum()} of {len(points)} balls are found, {fewest} are needed; check table, diameter, start"
        )
    if rigid:
        return _as_rotation(at, points, seen, sure, there)
    if together:
        return _over_still_panel(at, points, seen, sure, there, strict)
    return _each_by_itself(at, points, seen, sure, there & ~few[:, None], strict)


def _scales(at: Poses) -> Float64:
    """(9,) how far the start may be off in each of `PARAMETERS`."""
    far = float(np.median(np.linalg.norm(at.source - at.middle, axis=1)))
    return np.array([LENGTH * far] * 6 + [ANGLE] * 3)


def _each_by_itself(at: Poses, points: Float64, seen: Float64, sure: Float64, there: Bool, strict: bool) -> FittedViews:
    scales, numbers = _scales(at), np.full((len(seen), len(PARAMETERS)), np.nan)
    deviations, residuals, used = (
        np.full(numbers.shape, np.inf),
        np.full(seen.shape, np.nan),
        np.zeros(there.shape, bool),
    )
    lost = []
    for k in np.flatnonzero(there.any(axis=1)).tolist():
        fit = _alone(at, k, points[there[k]], seen[k, there[k]], sure[k, there[k]], scales)
        numbers[k], deviations[k] = fit.numbers, fit.deviations
        used[k, there[k]] = fit.used
        residuals[k, there[k]] = np.where(fit.used[:, None], fit.residuals, np.nan)
        lost += [(k, in_words(d, scales, PARAMETERS, UNITS)) for d in fit.directions]
    numbers = _like_neighbours(numbers, used, strict)
    names = tuple(f"view {k}: {n}, {u}" for k in range(len(seen)) for n, u in zip(PARAMETERS, UNITS, strict=True))
    words = tuple(f"{_flat(points)}view {k}: {text}" for k, text in lost)
    return FittedViews(moved(at, numbers), residuals, used, names, numbers.ravel(), deviations.ravel(), words)


def _alone(at: Poses, k: int, points: Float64, seen: Float64, sure: Float64, scales: Float64) -> GeometryFit:
    one = Poses(at.source[[k]], at.middle[[k]], at.axes[[k]], at.pitch[[k]], at.shape)

    def predict(numbers: Float64) -> Float64:
        return np.asarray(shadows(moved(one, numbers[None]), points)[0])

    def slopes(numbers: Float64) -> Float64:
        return np.asarray(shadow_slopes(one, points, numbers[None])[0])

    return fit_geometry(predict, slopes, seen, sure, scales)


def _over_still_panel(
    at: Poses, points: Float64, seen: Float64, sure: Float64, there: Bool, strict: bool
) -> FittedViews:
    views, alone = len(seen), _scales(at)
    scales = np.concatenate([np.tile(alone[:3], views), alone[3:]])
    view = np.nonzero(there)[0]

    def spread(numbers: Float64) -> Float64:
        return np.column_stack([numbers[: 3 * views].reshape(views, 3), np.tile(numbers[3 * views :], (views, 1))])

    def slopes(numbers: Float64) -> Float64:
        own = shadow_slopes(at, points, spread(numbers))[there]
        J = np.zeros((len(own), 2, len(numbers)))
        for j in range(3):
            J[np.arange(len(own)), :, 3 * view + j] = own[:, :, j]
        J[:, :, 3 * views :] = own[:, :, 3:]
        return J

    fit = fit_geometry(lambda p: shadows(moved(at, spread(p)), points)[there], slopes, seen[there], sure[there], scales)
    names = tuple(f"view {k}: {n}" for k in range(views) for n in PARAMETERS[:3]) + PARAMETERS[3:]
    units = UNITS[:3] * views + UNITS[3:]
    used = np.zeros(there.shape, bool)
    used[there] = fit.used
    return _shared(
        moved(at, _like_neighbours(spread(fit.numbers), used, strict)), points, there, fit, names, units, scales
    )


def _like_neighbours(numbers: Float64, used: Bool, strict: bool) -> Float64:
    """Moves (views, 9) in which views that show far fewer balls than others take those of the nearest that does not."""
    count = used.sum(axis=1)
    weak = count < WEAK * np.median(count)
    if strict or not weak.any():
        return numbers
    good = np.flatnonzero(~weak)
    nearest = good[np.argmin(np.abs(np.arange(len(count))[:, None] - good), axis=1)]
    return np.asarray(np.where(weak[:, None], numbers[nearest], numbers))


def _as_rotation(at: Poses, points: Float64, seen: Float64, sure: Float64, there: Bool) -> FittedViews:
    motion, alone = rigid_motion(at, points.mean(axis=0)), _scales(at)
    scales = np.concatenate([alone, alone[:2], [ANGLE, ANGLE, ARC]])

    def predict(numbers: Float64) -> Float64:
        return shadows(motion.poses(numbers), points)[there]

    def slopes(numbers: Float64) -> Float64:
        steps = STEP * np.eye(len(numbers))
        return np.stack([(predict(numbers + s) - predict(numbers - s)) / (2 * STEP) for s in steps], axis=-1)

    fit = fit_geometry(predict, slopes, seen[there], sure[there], scales)
    return _shared(motion.poses(fit.numbers), points, there, fit, RIGID, RIGID_UNITS, scales)


def _shared(
    at: Poses,
    points: Float64,
    there: Bool,
    fit: GeometryFit,
    names: tuple[str, ...],
    units: tuple[str, ...],
    scales: Float64,
) -> FittedViews:
    residuals, used = np.full((*there.shape, 2), np.nan), np.zeros(there.shape, bool)
    used[there] = fit.used
    residuals[there] = np.where(fit.used[:, None], fit.residuals, np.nan)
    words = tuple(_flat(points) + in_words(d, scales, names, units) for d in fit.directions)
    told = tuple(f"{n}, {u}" for n, u in zip(names, units, strict=True))
    return FittedViews(at, residuals, used, told, fit.numbers, fit.deviations, words)


def _flat(points: Float64) -> str:
    """A reason for what is undetermined, if the points have no depth."""
    extent = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return "the balls lie in one plane: " if extent[2] < FLAT * extent[0] else ""
