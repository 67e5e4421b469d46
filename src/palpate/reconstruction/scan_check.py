"""Checks a scan before anything is reconstructed from it."""

import numpy as np

from palpate.arrays import Float32, Float64
from palpate.errors import GeometryError
from palpate.reconstruction.alternatives import alternatives, other_values
from palpate.reconstruction.coarse_fit import ITERATIONS, OFFSET, Fit, fit_object
from palpate.reconstruction.default_grid import central_point, covering_grid
from palpate.reconstruction.depth_check import check_depth
from palpate.reconstruction.multiresolution import coarser_scan
from palpate.reconstruction.open_beam_check import check_open_beam
from palpate.reconstruction.projector import Projector
from palpate.scans.consistency import CentreOfMass, centre_of_mass, outline, whole_views
from palpate.scans.finding import Finding
from palpate.scans.grid_placement import check_grid, field_in_grid
from palpate.scans.intensity_correction import line_integrals
from palpate.scans.object_placement import CLOSE, check_field, check_outline
from palpate.scans.plausibility import check_counts, check_distance, check_geometry
from palpate.scans.scan import Scan
from palpate.scans.views import Views, from_above
from palpate.volumes.grid import Grid

ATTENUATION = (0.005, 0.1)  # 1/mm, of soft tissue and bone at the energies of diagnosis
DEPTH = 0.15  # of the distance of the focal spots: how thick an object is taken to be where no grid says it
SUSPECT = 0.02  # misfit above which a scan is compared with its alternatives
HOPELESS = 0.15  # misfit that is an alarm even if no alternative is better
BETTER = 0.4  # times the misfit: an alternative that fits so well is named
LEAST = 0.003  # of the contrast: smaller misfits are all the same
FIRST_LOOK, SECOND_LOOK = 12, 7  # iterations in which all alternatives are tried; how many are then fitted to the end
FREE_OFFSET = 0.4  # of the line integrals: an open beam off by half as much again
FEWEST_VIEWS = 4  # with fewer, one cannot be told from the others
OFF_CENTRE = 1.0, 4.0  # pixels, and times the others' median: a view whose centre of mass lies elsewhere
MOST_WHOLE = 0.8  # share of the views that must show the whole object, for its outline to be known well
SMEARED = 3.0  # times thinner than it is: how far few angles smear a dense object along its depth
MARGIN = 0.15  # of the field and of the grid's depth: how far the fitted object may reach beyond them
MEDIUM, COARSE = 60_000, 2600  # pixels of a panel, at most: for moments and for fits
MOST_VOXELS = (72, 72, 24)  # along x, y, z
MOST_VIEWS = 24  # of a longer scan, some are taken


def check_scan(
    scan: Scan, grid: Grid | None = None, *, attenuation: tuple[float, float] = ATTENUATION
) -> list[Finding]:
    """Look for mistakes in the geometry, the counts and the grid of a scan.

    Lengths, angles and counts are judged by themselves. Then a coarse object is fitted to all views. If it leaves much of
    them unexplained, the scan is compared with what it would be without one of the mistakes that are often made.

    Parameters
    ----------
    scan : Scan
        The projections.
    grid : Grid, optional
        Voxels that are to be reconstructed. With them the check sees more, because it knows how deep the object is.
    attenuation : tuple of float, optional
        Least and largest attenuation of the dense part of the object, 1/mm.

    Returns
    -------
    list of Finding
        What is wrong, the most likely cause first; empty if nothing is. Some mistakes cannot be seen in the data, see
        `docs/scan-check.md`.

    Raises
    ------
    AttributeError
        If `scan` is not a scan.

    References
    ----------
    Clackdoyle & Desbat, Phys. Med. Biol. 58:8437, 2013. Aichert et al., IEEE TMI 34:2205, 2015.

    Examples
    --------
    >>> pp.check_scan(scan, grid)
    []
    >>> wrong = pp.Scan(scan.counts, 100, scan.views)
    >>> [found.cause for found in pp.check_scan(wrong, grid)]
    ['incident']
    """
    found = check_geometry(scan.views) + check_counts(scan)
    if found:
        return found
    medium, binned = _at_most(scan, MEDIUM)
    l = line_integrals(medium).astype(np.float64)
    whole = whole_views(medium, l)
    if grid is not None:
        found += check_grid(medium.views, grid, {int(k): l[k] for k in np.flatnonzero(whole)})
    if any(f.cause == "grid origin order" for f in found):
        return found
    coarse, pixels = _at_most(medium, COARSE)
    some = np.unique(np.linspace(0, len(scan.views) - 1, min(MOST_VIEWS, len(scan.views))).astype(int)).tolist()
    coarse = coarse[some]
    fit = _fit(coarse, grid)
    if fit is None:
        return found
    centre = centre_of_mass(medium, l, whole)
    odd = _off_centre(centre, binned)
    if odd is not None:
        return [odd, *found]
    if fit.misfit > SUSPECT:
        better = _better(coarse, grid, fit, some, binned * pixels)
        found = better + found
        if not better and fit.misfit > HOPELESS:
            words = f"{fit.misfit:.0%} of the views' contrast fits no object: check angles, panel and the order of the files"
            found.append(Finding("unknown", words))
    if not found:
        found += check_open_beam(coarse, fit.grid)
    if grid is not None and from_above(scan.views, grid.bounds.mean(axis=0)).all():
        found += _check_placement(medium, l, centre, grid)
    found += _check_attenuation(fit, attenuation) + check_distance(scan.views) + _left_handed(scan.views)
    causes = [finding.cause for finding in found]
    return [finding for k, finding in enumerate(found) if finding.cause not in causes[:k]]


def _at_most(scan: Scan, most: int) -> tuple[Scan, int]:
    """The scan with pixels so large that a panel has few of them, and how many of the old ones they are wide."""
    times = 1
    while scan.shape[1] * scan.shape[2] > most:
        scan, times = coarser_scan(scan), 2 * times
    return scan, times


def _better(scan: Scan, grid: Grid | None, fit: Fit, numbers: list[int], pixels: int) -> list[Finding]:
    """The causes without which the scan would fit far better, best first."""
    best: dict[str, tuple[float, Finding]] = {}

    def judge(misfit: float, cause: str, words: str) -> None:
        if misfit + LEAST < min(BETTER * (fit.misfit + LEAST), best[cause][0] + LEAST if cause in best else np.inf):
            seen = f"unexplained: {fit.misfit:.1%} of the views' contrast, otherwise {misfit:.1%}"
            best[cause] = misfit, Finding(cause, f"{words} ({seen})")

    tries = [
        (_fit(other.scan, grid, iterations=FIRST_LOOK), other) for other in [*alternatives(scan), *other_values(scan)]
    ]
    seen = [(first.misfit, other) for first, other in tries if first is not None]
    for _, other in sorted(seen, key=lambda pair: pair[0])[:SECOND_LOOK]:
        tried = _fit(other.scan, grid)
        if tried is not None:
            judge(tried.misfit, other.cause, other.words)
    free = _fit(scan, grid, offset=np.inf)
    if free is not None and abs(free.offset) > FREE_OFFSET:
        times = np.exp(free.offset)
        judge(free.misfit, "incident", f"the views agree better if incident is {times:.2g} times too large")
    k = int(fit.left.argmax())
    rest = [v for v in range(len(numbers)) if v != k]
    others = _fit(scan[rest], grid) if len(rest) >= FEWEST_VIEWS else None
    if others is not None:
        expected = Projector(scan.views[k], others.grid)(others.values)[0]
        offset = pixels * _offset(fit.measured[k], expected, fit.weight[k])
        if offset.any():
            judge(others.misfit, "view shifted", _shifted(numbers[k], offset).message)
    # A flipped axis and a sweep the other way may differ by a mirror image alone: then the panel's axes say which it is.
    likely = "axis flipped" if _left_handed(scan.views) else "view order"
    ranked = sorted(best.values(), key=lambda pair: (round(pair[0] / LEAST), pair[1].cause != likely))
    return [finding for misfit, finding in ranked if misfit + LEAST < 2 * (ranked[0][0] + LEAST)]


def _off_centre(centre: CentreOfMass | None, pixels: int) -> Finding | None:
    """A view whose centre of mass lies elsewhere than all others say."""
    if centre is None or centre.whole.sum() < FEWEST_VIEWS:
        return None
    far = np.where(centre.whole, np.linalg.norm(centre.offsets, axis=1), 0)
    k, (least, times) = int(far.argmax()), OFF_CENTRE
    rest = np.delete(far, k).max()
    return _shifted(k, pixels * centre.offsets[k]) if far[k] > max(least, times * rest) else None


def _left_handed(views: Views) -> list[Finding]:
    """A panel whose rows and columns are those of an image seen from behind: right for some, and no data can tell."""
    turned = [(s - p.origin) @ p.normal < 0 for s, p in zip(views.source, views.panels, strict=True)]
    if not any(turned):
        return []
    words = (
        "seen from the tube, column_axis and row_axis are those of an image from behind the panel; if it is none, the "
    )
    return [Finding("mirrored panel", words + "volume is mirrored, which no data can tell", alarm=False)]


def _shifted(view: int, offset: Float64) -> Finding:
    rows, columns = offset
    return Finding(
        "view shifted",
        f"view {view} alone does not fit the others: it lies about {rows:+.1f} rows and {columns:+.1f} columns off; "
        f"check its panel, its angle and its file",
    )


def _offset(measured: Float32, expected: Float32, weight: Float32, most: int = 8) -> Float64:
    """(rows, columns) by which a measured image lies further on than the expected one, whole pixels."""
    known, inner = weight > 0, (slice(most, -most), slice(most, -most))
    best = (np.inf, np.zeros(2))
    for r in range(-most, most + 1):
        for c in range(-most, most + 1):
            there = known[inner] & np.roll(known, (r, c), (0, 1))[inner]
            error = (measured[inner] - np.roll(expected, (r, c), (0, 1))[inner])[there] ** 2
            if there.any() and error.mean() < best[0]:
                best = float(error.mean()), np.array([r, c], dtype=np.float64)
    return best[1]


def _check_placement(scan: Scan, l: Float64, centre: CentreOfMass | None, grid: Grid) -> list[Finding]:
    """Where the object, or of a truncated one the views' field, lies in the grid."""
    pixel = max(scan.views.panels[0].pitch)
    if centre is not None:
        few, sides = bool(centre.whole.mean() <= MOST_WHOLE), outline(scan, l, centre)
        close = bool((np.ptp(sides, axis=0) > CLOSE * np.ptp(grid.bounds[:, :2], axis=0)).all())
        found = check_outline(sides, grid, field_in_grid(scan.views, grid), pixel, few)
        found += check_depth(scan, l, centre, grid, close)
        return sorted(found, key=lambda finding: not finding.alarm)
    try:
        seen = covering_grid(scan.views, float(np.ptp(grid.bounds[:, 2])))
    except GeometryError:
        return []
    return check_field(seen.bounds[:, :2], grid, pixel)


def _check_attenuation(fit: Fit, allowed: tuple[float, float]) -> list[Finding]:
    """Whether the dense part of the fitted object attenuates as tissue does."""
    inner = fit.values[fit.values > 0.5 * np.quantile(fit.values, 0.99)]
    dense = float(np.median(inner)) if inner.size else 0.0
    least, most = allowed
    if least / SMEARED <= dense <= most:
        return []
    words = f"the dense part of the object attenuates {dense:.3g} / mm, tissue {least:g} to {most:g}"
    return [Finding("attenuation", f"{words}: check the pixel pitch, the distances and the units")]


def _fit(scan: Scan, grid: Grid | None, offset: float = OFFSET, iterations: int = ITERATIONS) -> Fit | None:
    try:
        return fit_object(scan, _field(scan.views, grid), offset, iterations)
    except GeometryError:
        return None


def _field(views: Views, grid: Grid | None) -> Grid:
    """Coarse voxels over all that the views see, as deep as the grid and a little more."""
    middles = [p.points((np.array(p.shape) - 1) / 2)[0] for p in views.panels]
    depth = DEPTH * float(np.median(np.linalg.norm(views.source - middles, axis=1)))
    if grid is not None:
        depth = float(np.ptp(grid.bounds[:, 2]))
    seen = covering_grid(views, depth if from_above(views, central_point(views)).all() else None)
    low, high = seen.bounds
    if grid is not None and not from_above(views, grid.bounds.mean(axis=0)).all():
        low, high = grid.bounds - MARGIN * np.outer((1, -1), np.ptp(grid.bounds, axis=0))
        shape = np.clip(np.ceil((high - low) / seen.spacing[::-1]), 1, MOST_VOXELS[:1] * 3).astype(int)
        return Grid(shape[::-1], ((high - low) / shape)[::-1], origin=low + (high - low) / shape / 2)
    if grid is not None:
        level = all(abs(abs(p.normal[2]) - 1) < 1e-6 for p in views.panels)
        low[2] = low[2] if level else grid.bounds[0, 2] - MARGIN * depth
        high[2] = grid.bounds[1, 2] + MARGIN * depth
    beside = MARGIN * (high - low)[:2]
    low[:2], high[:2] = low[:2] - beside, high[:2] + beside
    shape = np.clip(np.ceil((high - low) / seen.spacing[::-1]), 1, MOST_VOXELS).astype(int)
    step = (high - low) / shape
    return Grid(shape[::-1], step[::-1], origin=low + step / 2)
