"""Where a grid lies: before the panel, in the views' field, around what they show."""

from collections.abc import Iterator, Mapping
from types import MappingProxyType

import numpy as np
from scipy.spatial import ConvexHull

from palpate.arrays import Float64
from palpate.errors import GeometryError
from palpate.scans.finding import Finding
from palpate.scans.views import Panel, Views, from_above
from palpate.volumes.grid import Grid

DENSE = 0.15  # of a view's 95th percentile: line integrals above it are the object, not air or scatter
OUTSIDE = 0.02  # share of the grid's shadow by which the object may reach beyond it
SEEN = 0.5  # least area that grid and field share, of the smaller of both
NEARLY = 0.9  # the same, below which an exchanged order is looked for
NARROW, HALF = 0.9, 0.55  # of the grid's width: too narrow a field if it holds the whole object; if it does not
BETTER = 0.1  # by how much the swapped origin must be better


def check_grid(views: Views, grid: Grid, whole: Mapping[int, Float64] = MappingProxyType({})) -> list[Finding]:
    """What is wrong with where a grid lies.

    whole: line integrals (rows, columns) of views that show the whole object, by the number of the view. Without them,
    only the geometry is judged.
    """
    if not from_above(views, grid.bounds.mean(axis=0)).all():
        return _check_from_all_sides(views, grid, whole)
    below, seen, outside = faults = _faults(views, grid, whole)
    span = ", ".join(f"{a:.4g} to {b:.4g}" for a, b in grid.bounds.T) + " mm (x, y, z)"
    words = None
    if below > grid.spacing[0] / 2:
        words = f"the grid, {span}, reaches {below:.3g} mm below the panel"
    elif seen < SEEN:
        words = f"the grid, {span}, lies beside what the views see: check its origin"
    elif outside > OUTSIDE:
        words = (
            f"the object reaches {outside:.0%} of its width beyond the grid, {span}: check its origin and the panel's"
        )
    found = [Finding("object outside the grid", words)] if words else []
    share = float((np.ptp(field_in_grid(views, grid), axis=0) / np.ptp(grid.bounds[:, :2], axis=0)).min())
    shows_all = len(whole) > len(views) / 2
    if share < (NARROW if shows_all else HALF):
        words = f"the views show {'the whole object, but ' if shows_all else ''}only {share:.0%} of the grid's width"
        found.insert(
            0, Finding("pixel pitch", f"{words}: are pitch, distances and units right, or is the grid too large?")
        )
    try:
        swapped = Grid(grid.shape, grid.spacing, grid.origin[::-1], grid.direction)
        better = _badness(grid, faults) - _badness(grid, _faults(views, swapped, whole))
    except GeometryError:
        return found
    if better > BETTER and (found or seen < NEARLY):
        there = ", ".join(f"{v:g}" for v in swapped.origin)
        words = f"with origin ({there}) the grid would lie where the rays are: origin is (x, y, z), spacing (z, y, x)"
        found.insert(0, Finding("grid origin order", words))
    return found


def _check_from_all_sides(views: Views, grid: Grid, whole: Mapping[int, Float64]) -> list[Finding]:
    """The same for views that are not all from above: each must see the grid's middle, and the object lie within."""
    landed = views.project(grid.bounds.mean(axis=0))[:, 0]
    misses = np.flatnonzero(((landed < -0.5) | (landed > np.array(views.shape[1:]) - 0.5)).any(axis=1))
    span = ", ".join(f"{a:.4g} to {b:.4g}" for a, b in grid.bounds.T) + " mm (x, y, z)"
    if len(misses) > len(views) / 2:
        words = f"{len(misses)} of {len(views)} views do not see the middle of the grid, {span}: check its origin"
        return [Finding("object outside the grid", words)]
    outside = max(_overhangs(views, grid, whole), default=0.0)
    if outside <= OUTSIDE:
        return []
    words = f"the object reaches {outside:.0%} of its width beyond the grid, {span}: check its origin and the panel's"
    return [Finding("object outside the grid", words)]


def _badness(grid: Grid, faults: tuple[float, float, float]) -> float:
    """One number for how badly a grid lies: the shares of its depth, its area and its width that are wrong."""
    below, seen, outside = faults
    return below / float(np.ptp(grid.bounds[:, 2])) + 1 - seen + outside


def _faults(views: Views, grid: Grid, whole: Mapping[int, Float64]) -> tuple[float, float, float]:
    """How far a grid reaches below the panels, mm; what it shares with the field; the object's overhang."""
    below = max(0.0, *(_below(panel, grid) for panel in views.panels))
    return below, _shared(grid, field_in_grid(views, grid)), max(_overhangs(views, grid, whole), default=0.0)


def _shared(grid: Grid, field: Float64) -> float:
    """Area that the grid's middle slice shares with the views' field, over the smaller of both."""
    low, high = grid.bounds[:, :2]
    both = np.maximum(np.minimum(high, field[1]) - np.maximum(low, field[0]), 0)
    return float(np.prod(both) / min(np.prod(high - low), np.prod(field[1] - field[0])))


def field_in_grid(views: Views, grid: Grid) -> Float64:
    """(2, 2): lowest and highest (x, y) that the median view sees of the grid's middle slice, mm."""
    low, high = grid.bounds
    z = (low[2] + high[2]) / 2
    fields = []
    for source, panel in zip(views.source, views.panels, strict=True):
        rows, columns = panel.shape
        rays = panel.points([(r, c) for r in (-0.5, rows - 0.5) for c in (-0.5, columns - 0.5)]) - source
        at = source + ((z - source[2]) / np.where(rays[:, 2] == 0, 1e-9, rays[:, 2]))[:, None] * rays
        fields.append([at[:, :2].min(axis=0), at[:, :2].max(axis=0)])
    return np.asarray(np.median(fields, axis=0))


def _overhangs(views: Views, grid: Grid, whole: Mapping[int, Float64]) -> Iterator[float]:
    """Of each view of the whole object: how far it reaches beyond the grid's shadow, as a share of that."""
    low, high = grid.bounds
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    for k, l in whole.items():
        landed = views[k].project(corners)[0]
        sides = ConvexHull(landed).equations
        object_at = np.argwhere(l > DENSE * np.quantile(l, 0.95))
        beyond = (object_at @ sides[:, :2].T + sides[:, 2]).max(axis=1)
        yield max(float(np.quantile(beyond, 0.995)) - 1, 0) / float(np.ptp(landed, axis=0).min())


def _below(panel: Panel, grid: Grid) -> float:
    """How far the grid's lowest corner lies behind a level panel, mm; 0 for one that is turned."""
    return float(panel.origin[2] - grid.bounds[0, 2]) if abs(abs(panel.normal[2]) - 1) < 1e-6 else 0.0
