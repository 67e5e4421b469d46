"""One iteration of MAP on W1, and the time to the same posterior and the same image, next to mbirjax.

The iteration, on W1: ours with Poisson likelihood and Lange prior over 26 neighbours, PS,P,CD, fixed 512x512 panel; mbirjax's
vectorised coordinate descent with its q-generalised Gaussian prior over 6 neighbours, 1712x1712 panel that follows the
source, outside the real one weight 0 (`mbir.py`).

The way to the end, on W1 at a quarter of the resolution, for on W1 mbirjax would take hours. The same for both: scan, cubic
voxels, least squares with the same weights, generalised prior (q = 1.2, 6 neighbours) with the strength and edge that ours
chooses, f >= 0, the start (backprojection, not counted), two threads; so both minimise one function Φ, and it is computed for
both by our code. Not the same: mbirjax's panel has 11 times as many pixels, and it was made for processors with thousands
of lanes. Its compilation, a first run of an iteration, is not counted. Sources sit on multiples of the pixel pitch.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

import palpate as pp
from benchmarks import installed, mbirjax_reconstruction
from benchmarks.interleaved_timing import header, row
from benchmarks.workloads import circular, coarse_circular, smooth
from palpate.reconstruction.models.likelihood import WeightedLeastSquares
from palpate.reconstruction.optimizers.coordinate_descent import data_curvature
from palpate.reconstruction.prior_parameters import choose_prior_parameters, median_curvature

PHOTONS = 20_000
LONGEST = 420.0  # seconds of mbirjax on the way to the end
ITERATIONS = 4  # of mbirjax on W1, the first of which compiles
HEIGHTS = (38, 48, 60, 70)  # of the inserts, mm
MARGIN = 14.0  # mm that the region stays off the walls
GAPS = (1e-1, 1e-2, 1e-3)
NEAR = 0.05  # of the way from the start's error to the minimum's


@dataclass(frozen=True)
class Seen:
    """After an iteration: wall and CPU seconds so far, Φ, and the error in the region."""

    seconds: float
    cpu: float
    objective: float
    error: float


def lines() -> Iterator[str]:
    """Both comparisons."""
    views, grid = circular(snap=0.4)
    scan = pp.simulate_scan(pp.slab_phantom(), views, incident=PHOTONS, seed=1)
    ours = _one_iteration(scan, grid)
    yield f"W1, {PHOTONS} photons, slab phantom. One PS,P,CD iteration with the 26-neighbour Lange prior, objective "
    yield f"watched: {ours:.3f} s wall.\n"
    if not installed("mbirjax"):
        yield "mbirjax is not installed: pip install 'palpate[bench]'.\n"
        return
    peer, data = mbirjax_reconstruction.Translation(scan, grid), WeightedLeastSquares.of(scan)
    took: list[float] = []
    start = pp.backproject(pp.Projector(views, grid), data)
    peer.iterates(data.line_integrals, data.weights, start, ITERATIONS, lambda s, *_: not took.append(s))
    theirs = float(np.median(np.diff(took)))
    yield f"mbirjax's projections of a smooth volume differ from ours by {100 * _disagreement(peer, views, grid):.2g} %.\n"
    yield header("", "ours", "mbirjax", "ratio")
    yield row("one iteration on W1, wall s", ours, theirs, theirs / ours)
    yield ""
    yield from _to_the_end()


def _one_iteration(scan: pp.Scan, grid: pp.Grid) -> float:
    """Median of the iterations after the first, as a user's loop sees them."""
    prior = pp.Prior("lange")
    steps = pp.iterates(scan, grid, levels=1, iterations=8, tolerance=0, prior=prior, optimizer="descent")
    return float(np.median(np.diff([step.seconds for step in steps])[1:]))


def _disagreement(peer: mbirjax_reconstruction.Translation, views: pp.Views, grid: pp.Grid) -> float:
    """NRMSE of its projections of a smooth volume against ours, on the real panel."""
    A = pp.Projector(views, grid)
    ours, on = peer.placed(A(smooth(grid))), peer.placed(np.ones(views.shape, np.float32)) > 0
    theirs = peer.project(smooth(grid)) * on
    return float(np.linalg.norm(theirs - ours) / np.linalg.norm(ours))


def _to_the_end() -> Iterator[str]:
    """Time to gaps of one Φ, and to the image of its minimum."""
    views, grid = coarse_circular()
    phantom = pp.slab_phantom()
    scan, truth = pp.simulate_scan(phantom, views, incident=PHOTONS, seed=1), phantom.volume(grid).values
    A, data = pp.Projector(views, grid), WeightedLeastSquares.of(scan)
    known = data_curvature(A, data)
    prior = choose_prior_parameters(pp.Prior("generalized", exponent=1.2, neighbours=6), A, data, known)
    beta = prior.strength * median_curvature(known)
    start = pp.backproject(A, data)

    def judged(seconds: float, cpu: float, f: np.ndarray) -> Seen:
        f = np.maximum(np.ascontiguousarray(f, np.float32), 0)
        return Seen(seconds, cpu, data.value(A(f)) + beta * prior.value(f, grid), region_error(f, truth, grid))

    given = {"likelihood": "least-squares", "prior": prior, "start": pp.Volume(start, grid)}
    runs = {
        "ours, F-MAP": _course(lambda: pp.iterates(scan, grid, levels=1, iterations=400, tolerance=0, **given), judged),
        "ours, M-MAP-3": _course(
            lambda: pp.iterates(scan, grid, levels=3, iterations=[400, 20, 20], tolerance=0, **given), judged
        ),
    }
    last = min((course[-1] for course in runs.values()), key=lambda seen: seen.objective)
    first = judged(0, 0, start)
    lowest = last.objective + GAPS[-1] * (first.objective - last.objective)

    def enough(seen: Seen) -> bool:
        return seen.objective <= lowest and abs(seen.error - last.error) <= NEAR * abs(first.error - last.error)

    runs["mbirjax"] = _course_of_mbirjax(scan, grid, data, prior, beta, start, judged, enough)
    yield from _table(runs, first, last)


def region_error(values: np.ndarray, truth: np.ndarray, grid: pp.Grid) -> float:
    """Root mean square over the slices through the inserts, `MARGIN` off any wall, of each slice's NRMSE.

    Each slice is brought to the truth's mean and contrast first: 8 views within 14° of the vertical cannot tell how a
    broad slab's attenuation is spread over its depth, whatever the method.
    """
    y, x = (slice(int(MARGIN / d), -int(MARGIN / d)) for d in grid.spacing[1:])
    slices = [int(np.argmin(np.abs(grid.axis("z") - z))) for z in HEIGHTS]
    return float(np.sqrt(np.mean([pp.nmse(values[k, y, x], truth[k, y, x], scaled=True) for k in slices])))


def _course(run: Callable[[], Iterator[pp.Step]], judged: Callable[[float, float, np.ndarray], Seen]) -> list[Seen]:
    """Of the finest level; coarser ones count in time. Judging is not part of it."""
    course, wall, cpu = [], 0.0, 0.0
    steps = run()
    while True:
        began = time.perf_counter(), time.process_time()
        step = next(steps, None)
        if step is None:
            return course
        wall, cpu = wall + time.perf_counter() - began[0], cpu + time.process_time() - began[1]
        if step.level == 0:
            course.append(judged(wall, cpu, step.volume.values))


def _course_of_mbirjax(
    scan: pp.Scan,
    grid: pp.Grid,
    data: WeightedLeastSquares,
    prior: pp.Prior,
    beta: float,
    start: np.ndarray,
    judged: Callable[[float, float, np.ndarray], Seen],
    enough: Callable[[Seen], bool],
) -> list[Seen]:
    """The second of two runs, until enough or for `LONGEST` seconds; the first compiles it."""
    peer = mbirjax_reconstruction.Translation(scan, grid)
    peer.same_prior(prior, beta)
    course: list[Seen] = []

    def see(seconds: float, cpu: float, f: np.ndarray) -> bool:
        course.append(judged(seconds, cpu, f))
        return not enough(course[-1]) and seconds < LONGEST

    for most in (4, 1000):  # the first four use partitions of each size
        course.clear()
        peer.iterates(data.line_integrals, data.weights, start, most, see)
    return course


def _table(runs: dict[str, list[Seen]], start: Seen, last: Seen) -> Iterator[str]:
    """Times; a ratio to mbirjax's, or a bound on it where that did not arrive."""
    yield "W1 in voxels of 2 mm: "
    yield f"one Φ for all, {start.objective:.6g} at the start, {last.objective:.6g} at its minimum; error "
    yield "(contrast-normalised NRMSE in the four slices through the inserts) "
    yield f"{start.error:.3f} at the start, {last.error:.3f} at the minimum. Seconds of wall time.\n"
    yield header("", *runs, "ratio to F-MAP, wall; CPU", "ratio to M-MAP-3, wall; CPU")
    within = NEAR * abs(start.error - last.error)
    for gap in GAPS:
        level = last.objective + gap * (start.objective - last.objective)
        yield _row(
            f"to a gap of {gap:g}", [_settled(c, lambda s, o=level: s.objective <= o) for c in runs.values()], runs
        )
    there = [_settled(c, lambda s: abs(s.error - last.error) <= within) for c in runs.values()]
    yield _row(f"to an error within {NEAR:.0%} of the way from the minimum's, for good", there, runs)
    gaps = ((c[-1].objective - last.objective) / (start.objective - last.objective) for c in runs.values())
    yield row("iterations on the finest level", *(len(c) for c in runs.values()), "", "")
    yield row("gap after them", *(f"{gap:.1e}" for gap in gaps), "", "")
    yield ""


def _settled(course: list[Seen], there: Callable[[Seen], bool]) -> Seen | None:
    """The first after which all are there."""
    out = [k for k, seen in enumerate(course) if not there(seen)]
    first = out[-1] + 1 if out else 0
    return course[first] if first < len(course) else None


def _row(name: str, arrived: list[Seen | None], runs: dict[str, list[Seen]]) -> str:
    theirs, sign = (arrived[-1], "") if arrived[-1] else (runs["mbirjax"][-1], "over ")
    ratios = (
        "" if ours is None else f"{sign}{theirs.seconds / ours.seconds:.0f}; {sign}{theirs.cpu / ours.cpu:.0f}"
        for ours in arrived[:-1]
    )
    return row(name, *("not reached" if seen is None else seen.seconds for seen in arrived), *ratios)
