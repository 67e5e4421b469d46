"""One iteration of MAP on W1, and the time to the same error in a region, next to mbirjax.

Ours: Poisson likelihood, Lange prior over 26 neighbours, PS,P,CD; fixed 512x512 panel. mbirjax: Gaussian likelihood with
the counts as weights, q-generalised Gaussian prior over 6 neighbours with the strength it chooses itself, vectorised
coordinate descent; 1712x1712 panel that follows the source, outside the real one weight 0 (`mbir.py`). Both start from
their own direct reconstruction, whose time counts; compilation does not. Sources sit on multiples of the pixel pitch.
"""

import time
from collections.abc import Iterator

import numpy as np

import palpate as pp
from benchmarks import installed, mbir
from benchmarks.timing import header, row
from benchmarks.workloads import circular, smooth

PHOTONS = 20_000
ITERATIONS = 6
SLICES = (8, 18, 30, 40)  # at the inserts' heights: 38, 48, 60, 70 mm
PRIOR = pp.Prior("lange")

Course = list[tuple[float, float]]  # seconds, NRMSE in the region


def lines() -> Iterator[str]:
    """Both comparisons."""
    views, grid = circular(snap=0.4)
    phantom = pp.slab_phantom()
    scan = pp.simulate_scan(phantom, views, incident=PHOTONS, seed=1)
    truth = phantom.volume(grid).values
    ours_each = _one_iteration(scan, grid)
    yield f"W1, {PHOTONS} photons, slab phantom. One PS,P,CD iteration with the 26-neighbour Lange prior, objective "
    yield f"watched: {ours_each:.3f} s wall.\n"
    ours = _course_of_ours(scan, grid, truth)
    if not installed("mbirjax"):
        yield "mbirjax is not installed: pip install 'palpate[bench]'.\n"
        return
    peer = mbir.Translation(scan, grid)
    agreed = _agreement(peer, views, grid)
    theirs = _course_of_mbirjax(peer, scan, truth)
    yield from _table(ours_each, ours, theirs, agreed)


def _one_iteration(scan: pp.Scan, grid: pp.Grid) -> float:
    """Median of the iterations after the first, as a user's loop sees them."""
    steps = pp.iterates(scan, grid, levels=1, iterations=8, tolerance=0, prior=PRIOR, optimiser="descent")
    return float(np.median(np.diff([step.seconds for step in steps])[1:]))


def _course_of_ours(scan: pp.Scan, grid: pp.Grid, truth: np.ndarray) -> Course:
    """M-MAP-3 with its defaults; iterates of the coarse levels are judged on the fine grid too."""
    course, apart = [], 0.0
    for step in pp.iterates(scan, grid, prior=PRIOR):
        now = time.perf_counter()
        course.append((step.seconds - apart, _error(pp.resample(step.volume, grid).values, truth)))
        apart += time.perf_counter() - now  # judging is not part of it
    return course


def _course_of_mbirjax(peer: mbir.Translation, scan: pp.Scan, truth: np.ndarray) -> Course:
    """The second of two runs; the first, of one iteration, compiles it."""
    p = np.log(scan.incident / np.maximum(scan.counts, 1)).astype(np.float32)
    course: Course = []
    for iterations in (1, ITERATIONS):
        course.clear()
        peer.iterates(p, scan.counts, iterations, lambda s, f: course.append((s, _error(f, truth))))
    return course


def _error(values: np.ndarray, truth: np.ndarray) -> float:
    """Root mean square over the slices through the inserts, 8 voxels off any wall, of each slice's NRMSE.

    Each slice is brought to the truth's mean and contrast first: 8 views within 14° of the vertical cannot tell how a
    broad slab's attenuation is spread over its depth, whatever the method.
    """
    inside = (slice(28, 228), slice(28, 228))
    return float(np.sqrt(np.mean([pp.nmse(values[k][inside], truth[k][inside], scaled=True) for k in SLICES])))


def _agreement(peer: mbir.Translation, views: pp.Views, grid: pp.Grid) -> float:
    """NRMSE of its projections of a smooth volume against ours, on the real panel."""
    A = pp.Projector(views, grid)
    ours, on = peer.placed(A(smooth(grid))), peer.placed(np.ones(views.shape, np.float32)) > 0
    theirs = peer.project(smooth(grid)) * on
    return float(np.linalg.norm(theirs - ours) / np.linalg.norm(ours))


def _table(ours_each: float, ours: Course, theirs: Course, agreed: float) -> Iterator[str]:
    """Ratios; the error that both reach is the larger of their lowest, and 1 % more."""
    theirs_each = float(np.median(np.diff([s for s, _ in theirs])))
    common = 1.01 * max(min(e for _, e in ours), min(e for _, e in theirs))
    first = [next(s for s, e in course if e <= common) for course in (ours, theirs)]
    yield f"mbirjax's projections of a smooth volume differ from ours by {100 * agreed:.2g} %. Error: contrast-normalised "
    yield "NRMSE in the four slices through the inserts.\n"
    yield header("", "ours", "mbirjax", "ratio")
    yield row("one iteration, wall s", ours_each, theirs_each, theirs_each / ours_each)
    yield row(f"MAP to an error of {common:.3f}, wall s", *first, first[1] / first[0])
    yield row("lowest error, iterations", *(f"{min(e for _, e in c):.3f}, {len(c)}" for c in (ours, theirs)), "")
    yield ""
