"""What the numbers of a scan alone give away: lengths, angles and counts that cannot be."""

import numpy as np

from palpate.arrays import AnyArray, Float64
from palpate.scans.finding import Finding
from palpate.scans.scan import Scan
from palpate.scans.source_path import degrees_as_radians
from palpate.scans.views import Views

WIDEST, SMALLEST = 1000.0, 25.0  # mm, a panel's longer side
NEAREST, FARTHEST = 150.0, 5000.0  # mm, from a panel to its focal spot
SHORT = 500.0  # mm, the same: mammographs have 600 to 700, C-arms 900 to 1300, chest stands up to 2000
LEAST_SWEEP, MOST_SWEEP = 3.0, 150.0  # degrees, between the two views that differ most
MOST_STEP = 50.0  # degrees, from one view of an orbit to the next
STEEPEST = 75.0  # degrees, of a central ray from the panel's normal
ABOVE = 0.02  # share of the pixels that may count more than the open beam
BRIGHT = 1.15  # times the open beam: what counts as more
DARK, FEW = 0.9, 0.25  # open beam / incident of air; least share of the border that shows air
FEWEST, DRIFT = 20, 0.06  # pixels of a rim; of the level, from view to view
PIXELS = 200  # along a side, to look at
LEVELS, SQUARES, WIDE = 6, 100, 1.05  # of the noise: means, squares of each, and the range of the means
NEGATIVE, STEEP = -1.0, 1.6  # slopes of the noise that photons cannot have
BRIGHTEST = 0.85  # of the brightest pixels: nothing is brighter than air
FLAT = 1.5  # standard deviations of a Poisson number around one level


def check_geometry(views: Views) -> list[Finding]:
    """What is wrong with the lengths and angles of a geometry, whatever the data."""
    found = []
    middles = np.array([p.points((np.array(p.shape) - 1) / 2)[0] for p in views.panels])
    normals = np.array([p.normal for p in views.panels])
    towards = views.source - middles
    height = np.einsum("ij,ij->i", towards, normals)
    cone = ~views.parallel
    far = float(np.median(np.abs(height[cone]))) if cone.any() else SHORT  # parallel beams have no distance
    side = max(n * d for n, d in zip(views.panels[0].shape, views.panels[0].pitch, strict=True))
    steep = np.degrees(np.arccos(np.clip(np.abs(height) / np.linalg.norm(towards, axis=1), -1, 1)))
    if degrees_as_radians(views.source):
        step = 360 / len(views)
        words = f"the focal spots step by {step:.4g} radians along a closed path, as if by {step:.4g}°: "
        found.append(Finding("angle units", words + "were degrees taken as radians?"))
    elif len(set(np.sign(height))) > 1 or steep.max() > STEEPEST:
        found.append(
            Finding(
                "angle units",
                f"some focal spots lie beside or behind the panel (central rays up to {steep.max():.0f}° off its normal): "
                f"were degrees taken as radians?",
            )
        )
    if far < NEAREST:
        which = "all lengths" if side < SMALLEST * 2 else "the source positions"
        found.append(
            Finding(
                "length units",
                f"the focal spot is {far:.3g} mm from a panel of {side:.3g} mm: are {which} in centimetres? "
                f"Positions and pitch are mm",
            )
        )
    elif far > FARTHEST:
        found.append(Finding("length units", f"the focal spot is {far / 1000:.3g} m from the panel: lengths are mm"))
    if side > WIDEST or (side < SMALLEST and far >= NEAREST):
        pitch = views.panels[0].pitch
        found.append(
            Finding(
                "pixel pitch",
                f"a pitch of {pitch[0]:g} x {pitch[1]:g} mm makes a panel of {side:.4g} mm; panels have 50 to 500 mm",
            )
        )
    sweep = largest_angle(views)
    step = largest_angle(views, neighbours=True)
    if sweep > MOST_SWEEP and step > MOST_STEP and not found:
        words = (
            f"the views differ by up to {sweep:.0f}° and from one to the next by up to {step:.0f}°: were degrees taken as "
            f"radians?"
        )
        found.append(Finding("angle units", words))
    if len(views) > 2 and sweep < LEAST_SWEEP:
        found.append(
            Finding(
                "angle units",
                f"the views differ by {sweep:.2g}° at most: are the angles in radians? They are given in degrees",
            )
        )
    return found


def check_distance(views: Views) -> list[Finding]:
    """A note on focal spots that are nearer to the panel than those of units for patients; benches have such."""
    if views.parallel.any():
        return []
    far = float(np.median([abs((s - p.origin) @ p.normal) for s, p in zip(views.source, views.panels, strict=True)]))
    if far >= SHORT:
        return []
    words = (
        f"the focal spots are {far:.3g} mm from the panel, in units for patients 600 to 2000 mm: check the distances; the "
        f"data fit a path of the focal spots that is scaled, so they cannot tell"
    )
    return [Finding("length units", words, alarm=False)]


def largest_angle(views: Views, neighbours: bool = False) -> float:
    """Between two views, or between a view and the next, degrees.

    Seen from the panels' middle, or from where the central rays meet if the panels turn.
    """
    middles = np.array([p.points((np.array(p.shape) - 1) / 2)[0] for p in views.panels])
    rays = views.source - (middles if len({p.normal.tobytes() for p in views.panels}) > 1 else middles.mean(axis=0))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    cosines = np.einsum("ij,ij->i", rays[1:], rays[:-1]) if neighbours else rays @ rays.T
    return float(np.degrees(np.arccos(np.clip(cosines, -1, 1))).max(initial=0.0))


def check_counts(scan: Scan) -> list[Finding]:
    """What is wrong with counts and incident, whatever the geometry."""
    some = (slice(None), *(slice(None, None, max(1, n // PIXELS)) for n in scan.shape[1:]))  # enough for shares
    y, b, r, measured = scan.counts[some], scan.incident[some], scan.background[some], scan.mask[some]
    values, beam = y[measured], b[measured]
    net = values - r[measured]
    level = float(np.median(beam))
    top = float(np.quantile(values, 0.999))
    if top < 30 and top < 0.02 * level:
        what = "line integrals" if (values != np.round(values)).any() else "incident"
        return [
            Finding(
                what,
                f"no pixel counts more than {top:.3g} of {level:.4g} incident photons: are these line integrals, not counts?"
                if what == "line integrals"
                else f"no pixel counts more than {top:.3g} of {level:.4g} incident photons: check incident",
            )
        ]
    rims = [_rim(scan, k) for k in range(len(scan.views))]
    rim = np.concatenate(rims)
    dark, bright = float(np.median(rim)) if rim.size else 1.0, float(np.quantile(net / beam, 0.99))
    if dark < 0.12 and bright > 3 * dark + 0.02:
        # Both look alike: the air is dark. Only counts of photons that are missing scatter as those of the open beam do.
        first, second = (
            ("inverted counts", "line integrals") if top > 0.5 * level else ("line integrals", "inverted counts")
        )
        seen = "the border of the panel is dark and the middle is bright"
        said = {
            "inverted counts": f"{seen}: are the counts inverted? (Or mask what a collimator hides)",
            "line integrals": f"{seen}: are these line integrals, or a multiple of them, not counts?",
        }
        return [Finding(first, said[first]), Finding(second, said[second])]
    slope = noise_slope(scan)
    if slope is not None and slope > STEEP:
        words = "the noise grows faster than the numbers, as that of line integrals: are these counts of photons?"
        return [Finding("line integrals", words)]
    if slope is not None and slope < NEGATIVE:
        words = (
            "the noise falls where the counts rise, but photons scatter by the root of their number: are they inverted?"
        )
        return [Finding("inverted counts", words)]
    over = net > BRIGHT * beam + 5 * np.sqrt(beam)
    if over.mean() > ABOVE:
        times = float(np.median(net[over] / beam[over]))
        seen = f"{over.mean():.0%} of the pixels count more than the open beam, {times:.3g} times as much"
        found = [Finding("incident", f"{seen}: incident is too small")]
        if (net < beam).mean() > ABOVE:  # not all of them: then the numbers may mean something else
            found.append(Finding("line integrals", f"{seen}: are these line integrals, or other numbers, not counts?"))
        return found
    air = _air(rims, level)
    if air is not None and air > BRIGHTEST * bright and not DARK < air < 1 / DARK:
        return [
            Finding(
                "incident",
                f"air reads {air:.3g} of incident at the border of every view: incident is too "
                f"{'large' if air < 1 else 'small'}; `incident: estimate` in the geometry file takes it from the views",
            )
        ]
    return []


def noise_slope(scan: Scan) -> float | None:
    """d log(variance) / d log(mean): 1 for photons, below 0 for inverted counts, about l for line integrals l.

    None if it cannot be told.

    The variance is that of (a - b - c + d) / 2 over squares of 2 x 2 pixels, in which all that is linear cancels, by the
    median of its absolute value over many squares of about one mean: edges do not matter.
    """
    rows, columns = (n - n % 2 for n in scan.shape[1:])
    y = scan.counts[:, :rows, :columns]
    a, b, c, d = (y[:, i::2, j::2] for i in (0, 1) for j in (0, 1))
    known = scan.mask[:, :rows:2, :columns:2] & scan.mask[:, 1:rows:2, 1:columns:2]
    mean, noise = ((a + b + c + d) / 4)[known], (np.abs(a - b - c + d) / 2)[known]
    if mean.size < LEVELS * SQUARES:
        return None
    order = np.array_split(np.argsort(mean), LEVELS)
    levels, spread = (np.array([np.median(v[part]) for part in order]) for v in (mean, noise))
    if levels[0] <= 0 or spread.min() <= 0 or levels[-1] < WIDE * levels[0]:
        return None
    return float(2 * np.polyfit(np.log(levels), np.log(spread), 1)[0])


def _rim(scan: Scan, view: int) -> Float64:
    """Net counts over incident of the measured pixels along the panel's rim."""

    def along(a: AnyArray) -> AnyArray:
        return np.concatenate([a[view, [0, -1]].ravel(), a[view, 1:-1, [0, -1]].ravel()])

    net, beam, measured = along(scan.counts) - along(scan.background), along(scan.incident), along(scan.mask)
    return np.asarray(net[measured] / beam[measured], dtype=np.float64)


def _air(rims: list[Float64], incident: float) -> float | None:
    """Open beam over incident where the rim of every view shows one level with Poisson noise, None where one does not."""
    levels = []
    for rim in rims:
        values = np.sort(rim[rim > 0])
        if len(values) < FEWEST:
            return None
        spread = FLAT * np.sqrt(values / incident)
        held = np.searchsorted(values, values + spread) - np.searchsorted(values, values - spread)
        bright = np.flatnonzero(held >= FEW * len(rim))
        if not len(bright):
            return None
        levels.append(values[bright[held[bright].argmax()]])
    return float(np.median(levels)) if np.std(levels) < DRIFT * np.mean(levels) else None
