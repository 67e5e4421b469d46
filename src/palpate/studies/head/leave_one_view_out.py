"""Views predicted from the others: what each method may choose, and the choice made without the view that is judged."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain, islice

import numpy as np
from scipy import ndimage

from palpate.arrays import AnyArray, Bool, Float32, Float64
from palpate.reconstruction.baselines.filtered_backprojection import Window, fbp
from palpate.reconstruction.baselines.sart import sart
from palpate.reconstruction.baselines.sirt import backproject, sirt
from palpate.reconstruction.models.likelihood import WeightedLeastSquares
from palpate.reconstruction.models.mrf_prior import Prior
from palpate.reconstruction.optimizers.coordinate_descent import data_curvature
from palpate.reconstruction.optimizers.memory_gradient import memory_gradient
from palpate.reconstruction.prior_parameters import choose_prior_parameters, median_curvature
from palpate.reconstruction.projector import Projector
from palpate.scans.intensity_correction import line_integrals
from palpate.scans.scan import Scan
from palpate.studies.rtk_reference import installed, rtk_estimates
from palpate.volumes.grid import Grid
from palpate.volumes.resample import resample
from palpate.volumes.volume import Volume

ERODED, DENSE, FINE = 16, 0.15, 8.0  # pixels off the field's edge; least line integral; sigma of the high pass, pixels
# Times the default strength (8-bit values are no counts). Each fit ends when an iteration lowers the objective by less than
# this share of it, or after so many: an unconverged fit leaves ghosts, some cm wide, in the view left out.
STRENGTHS, LEAST, MOST = (1.0, 0.5, 0.25, 0.12), 3e-4, 100
# Of the rivals: relaxations, passes or iterations on the coarse grid, and of the first candidate. A list grows until its last
# candidates, of which each has run nearly half as long again as the one before, predict worse than an earlier one.
RELAXATIONS = (1.0, 0.5, 0.25)
COARSE_SART, SART_EVERY = 20, 2  # at relaxation 1; a shorter step needs as many more passes
COARSE_SIRT, SIRT_EVERY = 600, 25
WORSE, LONGEST = 3, 18  # candidates: so many worse ones end a list; so many are tried at most
WINDOW: Window = "hann"
CUTOFFS = (1.0, 0.5, 0.25, 0.12, 0.06, 0.03)  # of FBP's window

Level = tuple[Scan, Grid]
Candidates = Iterator[tuple[str, Float32]]
Paths = Iterator[Candidates]  # of a method: lists of candidates, each of which may be left before its end


def correlation(a: AnyArray, b: AnyArray, region: Bool) -> float:
    """Pearson's, over the region: blind to each image's gain and offset."""
    return float(np.corrcoef(a[region], b[region])[0, 1])


def measured_region(scan: Scan, binning: int = 1) -> Bool:
    """(views, rows, columns) pixels on which images are judged: inside the field and behind something dense."""
    inner = [ndimage.binary_erosion(m, iterations=ERODED // binning, border_value=1) for m in scan.mask]
    return np.asarray(np.stack(inner) & (line_integrals(scan) > DENSE))


@dataclass(frozen=True, eq=False)
class ViewScore:
    """A view as it was measured, beside which predictions are scored."""

    measured: Float32
    mask: Bool
    region: Bool
    fine: float = FINE

    @cached_property
    def _detail(self) -> Float64:
        return self.detail(self.measured)

    @cached_property
    def _weight(self) -> Float64:
        weight = ndimage.gaussian_filter(self.mask.astype(np.float64), self.fine)
        return np.asarray(np.maximum(weight, 1e-6))

    def detail(self, image: AnyArray) -> Float64:
        """What is left of an image without its mean over about `fine` pixels, unmeasured pixels not counted."""
        summed = ndimage.gaussian_filter(np.where(self.mask, image, 0).astype(np.float64), self.fine)
        return np.asarray(np.where(self.mask, image - summed / self._weight, 0))

    def __call__(self, image: AnyArray) -> Float64:
        """Correlations (full band, high-passed) with what was measured."""
        both = (image, self.measured), (self.detail(image), self._detail)
        return np.array([correlation(a, b, self.region) for a, b in both])


def view_scores(scan: Scan, binning: int = 1) -> list[ViewScore]:
    """One a view. binning: how many of the panel's pixels make one of the scan's, each way."""
    parts = zip(line_integrals(scan), scan.mask, measured_region(scan, binning), strict=True)
    return [ViewScore(*three, FINE / binning) for three in parts]


def null_scores(panel: Sequence[ViewScore]) -> Float64:
    """(views, 2): how well the mean of its two neighbours predicts each view; at the ends the one neighbour there is."""
    beside = [[panel[i].measured for i in (k - 1, k + 1) if 0 <= i < len(panel)] for k in range(len(panel))]
    return np.array([score(np.mean(images, axis=0)) for score, images in zip(panel, beside, strict=True)])


def map_estimates(levels: Sequence[Level]) -> Paths:
    """M-MAP, by the strength of the prior."""
    yield _map_candidates(levels)


def _map_candidates(levels: Sequence[Level]) -> Candidates:
    """The coarse grid first, then strengths from strong to weak, each going on from the one before to its end."""
    scan, grid = levels[0]
    values = _onto(grid, Volume(coarse_map(levels), levels[-1][1]))
    for factor, estimate in map_path(scan, grid, STRENGTHS, MOST, values, LEAST):
        yield f"strength x {factor:g}", estimate


def coarse_map(levels: Sequence[Level], values: Float32 | None = None) -> Float32:
    """The MAP volume of the coarsest level at the default strength. values: the start, None backprojection."""
    ((_, values),) = map_path(*levels[-1], (1.0,), MOST, values, LEAST)
    return values


def map_path(
    scan: Scan,
    grid: Grid,
    factors: Sequence[float],
    most: int,
    values: Float32 | None = None,
    least: float = 0.0,
) -> Iterator[tuple[float, Float32]]:
    """MAP volumes at factors of the default strength, each from where the factor before ended.

    most: iterations of each; fewer where one lowers the objective by less than `least` times it. values: the start, None
    backprojection.
    """
    A, data = Projector(scan.views, grid), WeightedLeastSquares.of(scan)
    known = data_curvature(A, data)
    prior = choose_prior_parameters(Prior(), A, data, known)
    assert prior.strength is not None
    values = backproject(A, data) if values is None else values
    for factor in factors:
        strength = prior.strength * factor
        solver = memory_gradient(A, data, replace(prior, strength=strength), strength * median_curvature(known), values)
        previous = np.inf
        for following, objective in islice(solver, most):
            values = following
            if previous - objective < least * objective:
                break
            previous = objective
        yield factor, values


def sart_estimates(levels: Sequence[Level]) -> Paths:
    """SART, started from its like on the coarse grid: a path for each relaxation."""
    for relaxation in RELAXATIONS:
        coarse, every = (round(number / relaxation) for number in (COARSE_SART, SART_EVERY))
        solver = partial(sart, relaxation=relaxation)
        yield _iterates(levels, solver, coarse, every, f"relaxation {relaxation:g}: {{}} passes")


def sirt_estimates(levels: Sequence[Level]) -> Paths:
    """SIRT, started from its like on the coarse grid."""
    yield _iterates(levels, sirt, COARSE_SIRT, SIRT_EVERY, "{} iterations")


def fbp_estimates(levels: Sequence[Level]) -> Paths:
    """Filtered backprojection, by the window's cut-off."""
    A, data = _finest(levels)
    yield ((f"{WINDOW}, cut-off {cutoff:g}", fbp(A, data, WINDOW, cutoff)) for cutoff in CUTOFFS)


def backprojections(levels: Sequence[Level]) -> Paths:
    """Backprojection has nothing to choose."""
    yield iter([("-", backproject(*_finest(levels)))])


METHODS: Mapping[str, Callable[[Sequence[Level]], Paths]] = {
    "M-MAP": map_estimates,
    "SART": sart_estimates,
    "SIRT": sirt_estimates,
    "FBP": fbp_estimates,
    "backprojection": backprojections,
}


def methods() -> Mapping[str, Callable[[Sequence[Level]], Paths]]:
    """`METHODS`, and RTK's SART where itk-rtk is installed."""
    return {**METHODS, "RTK's SART": rtk_estimates} if installed() else METHODS


def groups(views: int) -> list[tuple[int, ...]]:
    """Views left out together, two or three far from each other: what is learnt from one's prediction serves the others."""
    step = max(2, -(-views // 3))
    return [tuple(range(first, views, step)) for first in range(step)]


def unexplained_variance(scores: AnyArray) -> Float64:
    """What choices are made by, least is best: log of the geometric mean of 1 - correlation over both bands."""
    return np.asarray(np.log(np.maximum(1 - np.asarray(scores), 1e-9)).mean(axis=-1))


def choose_candidate(view: int, views: int, inner: Mapping[tuple[int, ...], Mapping[str, Float64]]) -> str:
    """The candidate that best predicts the views that were left out together with this one (not the outermost).

    inner: for each group, scores (views of the group, 2) by candidate: full band and high-passed.
    """
    ((group, scores),) = ((group, scores) for group, scores in inner.items() if view in group)
    others = [n for n, k in enumerate(group) if k != view]
    others = [n for n in others if 0 < group[n] < views - 1] or others
    return min(scores, key=lambda name: float(np.mean(unexplained_variance(scores[name][others]))))


def leave_out(levels: Sequence[Level], left: Sequence[int]) -> list[Level]:
    """The levels' scans without some of their views."""
    kept = [k for k in range(len(levels[0][0].views)) if k not in left]
    return [(scan[kept], grid) for scan, grid in levels]


def _finest(levels: Sequence[Level]) -> tuple[Projector, WeightedLeastSquares]:
    scan, grid = levels[0]
    return Projector(scan.views, grid), WeightedLeastSquares.of(scan)


def candidate_counts() -> Iterator[int]:
    """1, 2, 3, 4, 6, 8, 12, ...: passes or iterations of the candidates, over those of the first."""
    yield from islice(chain([1], (count << doubled for doubled in range(LONGEST) for count in (2, 3))), LONGEST)


def path_of(candidate: str) -> str:
    """What candidates of one path have in common; nothing if their method has only one."""
    return candidate.rpartition(": ")[0]


def past_the_best(views: int, group: tuple[int, ...], scores: Mapping[str, Float64]) -> bool:
    """Whether for each view of a group, the last `WORSE` candidates of a path are worse choices than one before them."""
    last = list(scores)[-WORSE:]
    return len(scores) > WORSE and all(choose_candidate(k, views, {group: scores}) not in last for k in group)


def _iterates(
    levels: Sequence[Level],
    solver: Callable[..., Iterator[tuple[Float32, float]]],
    coarse: int,
    every: int,
    name: str,
) -> Candidates:
    """So many iterations on the coarsest grid from backprojection; from there on the finest, a candidate at each count."""
    A, data = _finest(levels[-1:])
    *_, (values, _) = islice(solver(A, data, backproject(A, data)), coarse)
    iterates, done = solver(*_finest(levels), _onto(levels[0][1], Volume(values, levels[-1][1]))), 0
    for count in candidate_counts():
        *_, (values, _) = islice(iterates, every * count - done)
        done = every * count
        yield name.format(done), values


def _onto(grid: Grid, volume: Volume) -> Float32:
    return resample(volume, grid, "linear").values
