"""Reconstructs a volume from a scan: levels, methods, optimizers."""

import math
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Literal, get_args

import numpy as np

from palpate.arrays import Float32, UInt8
from palpate.errors import DataError
from palpate.plugins import BUILT_IN, names, part
from palpate.reconstruction.baselines.filtered_backprojection import Window, check_window, fbp
from palpate.reconstruction.baselines.sart import check_relaxation, sart
from palpate.reconstruction.baselines.sirt import backproject, sirt, uniform_volume
from palpate.reconstruction.baselines.total_variation import tv
from palpate.reconstruction.default_grid import covering_grid
from palpate.reconstruction.iterate import Step
from palpate.reconstruction.local_response import strength_for_resolution
from palpate.reconstruction.models.blurred import poisson
from palpate.reconstruction.models.likelihood import (
    CURVATURES,
    Curvature,
    Gaussian,
    Likelihood,
    Transmission,
    WeightedLeastSquares,
)
from palpate.reconstruction.models.mrf_prior import Prior
from palpate.reconstruction.multiresolution import Downsample, coarser_support, default_levels, pyramid
from palpate.reconstruction.optimizers.coordinate_descent import coordinate_descent, data_curvature
from palpate.reconstruction.optimizers.hybrid_descent import hybrid_descent, sweeps_are_cheap
from palpate.reconstruction.optimizers.memory_gradient import memory_gradient
from palpate.reconstruction.optimizers.ordered_subsets import SubsetsState, default_subsets, ordered_subsets
from palpate.reconstruction.optimizers.problem import Problem
from palpate.reconstruction.prior_parameters import choose_prior_parameters, median_curvature
from palpate.reconstruction.projector import Projector, check_upright
from palpate.reconstruction.stopping_rule import StoppingRule
from palpate.reconstruction.support import Support, chosen_support
from palpate.scans.grid_placement import check_grid
from palpate.scans.scan import Scan
from palpate.volumes.grid import Grid
from palpate.volumes.resample import INTERPOLATIONS, Interpolation, resample
from palpate.volumes.volume import Volume, finite_volume

Method = Literal["map", "ml", "tv", "sirt", "sart", "fbp", "backprojection"]
DIRECT = ("backprojection", "fbp")  # done in one step
LikelihoodOf = Literal["poisson", "gaussian", "least-squares"] | Callable[[Scan], Likelihood]
Baseline = Callable[
    [Projector, Likelihood, Float32], Iterator[tuple[Float32, float]]
]  # a method without a prior of ours
LIKELIHOODS: dict[str, Callable[[Scan], Likelihood]] = {
    "poisson": poisson,
    "gaussian": Gaussian.of,
    "least-squares": WeightedLeastSquares.of,
}
OLD_SPELLING = "the old spelling is taken until version 0.3"
TOLERANCE = 1e-3


def iterates(
    scan: Scan,
    grid: Grid,
    *,
    levels: int | None = None,
    method: Method = "map",
    prior: Prior | None = None,
    resolution: float | None = None,
    likelihood: LikelihoodOf = "poisson",
    start: Literal["auto", "backprojection", "uniform"] | Volume = "auto",
    curvature: Curvature = "precomputed",
    optimizer: str | Sequence[str] = "auto",
    iterations: int | Sequence[int] = 50,
    tolerance: float = TOLERANCE,
    downsample: Downsample = "sum",
    interpolation: Interpolation = "linear",
    window: Window = "hann",
    cutoff: float = 1.0,
    relaxation: float = 1.0,
    support: Support = "none",
    resume: Step | None = None,
    optimiser: str | Sequence[str] | None = None,
) -> Iterator[Step]:
    """Yield every iterate of a reconstruction, coarsest level first.

    Several levels are the dissertation's M-MAP; `levels=1` is its F-MAP. "map" minimizes −log likelihood + β R.

    Parameters
    ----------
    scan : Scan
        The projections.
    grid : Grid
        The voxels of the finest level.
    levels : int, optional
        Number of resolutions. By default the grid decides, 3 or more.
    method : str, optional
        "map"; "ml", which has no prior; or a baseline on the finest level: "tv", "sirt", "sart", "fbp", "backprojection".
    prior : Prior, optional
        By default `Prior()`, a middle way. The data choose what it leaves open. `Prior(smooth=True)` is for objects that are
        even but for large structures. "tv" uses its strength only.
    resolution : float, optional
        Of "map", mm: short for `prior=Prior("quadratic", resolution=...)`, which keeps what is small and faint.
    likelihood : str or callable, optional
        "poisson" for counts, "gaussian" for counts with a variance that follows the mean, "least-squares" for intensities,
        or a function from a scan to a likelihood. Only "poisson", or one that models it, takes a scan with blur.
    start : str or Volume, optional
        "backprojection", "uniform" or a volume, on the coarsest level. "auto" is uniform within a support,
        unless rays bring attenuation from beyond the grid's sides, and else backprojection.
    curvature : str, optional
        As in `Transmission.curvature`.
    optimizer : str or sequence of str, optional
        Of "map" and "ml", one or one for each level, finest first: "momentum", "descent", "subsets", or "auto", which is
        momentum, after three sweeps of coordinate descent on each of several levels if the panel is parallel to the slices.
        "descent" needs focal spots above the slices; so does the method "fbp".
        Names of `register_optimizer` serve too.
    iterations : int or sequence of int, optional
        Most iterations on the finest level (twice as many one level down), or a number for each level, finest first.
    tolerance : float, optional
        A level ends when an iteration lowers the objective by less than this share. Level 1 takes 5 times as much, and each
        coarser level a quarter of the one above.
    downsample : str, optional
        How pixels are combined on coarse levels: "sum" keeps Poisson counts; "linear", "nearest", "median" do not.
    interpolation : str, optional
        How a volume goes to the next level, see `resample`.
    window, cutoff : optional
        Of `fbp`.
    relaxation : float, optional
        Of `sart`.
    support : str, Labels, Volume or array_like of bool, (z, y, x), optional
        Of "map" and "ml": where the object may be. Outside f = 0 at every level. "hull" is
        `support_hull`, which is not held where the object reaches beyond a side of the grid that rays cross. "none" is all of
        the grid. A mask on the finest grid has 0 outside. It is taken for the object's outline: the prior has no neighbours
        beyond it. A sheet over all of the field, such as a paddle, is taken out of the incident beam, since it lies outside.
    resume : Step, optional
        The step after which to go on, exactly as if the run had never stopped.
    optimiser : str, optional
        The old spelling of `optimizer`, until version 0.3.

    Yields
    ------
    Step
        Each iterate.

    Raises
    ------
    DataError, GeometryError
        If an argument is not valid, before any work is done.

    References
    ----------
    Chen, PhD dissertation, University of Delaware, 2006. Erdogan & Fessler, IEEE TMI 18:801, 1999.

    Examples
    --------
    >>> steps = list(pp.iterates(scan, grid, levels=1, iterations=3))
    >>> steps[-1].objective < steps[0].objective
    True
    """
    optimizer = _new_spelling(optimizer, optimiser)
    levels = default_levels(scan, grid) if levels is None else levels
    most = _per_level(iterations, levels)
    _check_choices(method, curvature, interpolation, start, likelihood, tolerance)
    optimizers = _optimizers(optimizer, levels)
    check_window(window, cutoff)
    check_relaxation(relaxation)
    chosen = LIKELIHOODS[likelihood] if isinstance(likelihood, str) else likelihood
    inside, notes, flat = None, dict(scan.notes), False
    if not (isinstance(support, str) and support == "none"):
        measured = scan
        inside, scan, flat = chosen_support(support, method, scan, grid)
        name = support if isinstance(support, str) else "mask"
        sheet = ", behind a sheet over all of the field" if scan is not measured else ""
        notes["support"] = f"{name}, {(inside > 0).mean():.0%} of the voxels{sheet}"
    if scan.blur is not None:
        scan = replace(scan, blur=scan.blur.through(grid) if method in ("map", "ml") else None)
        notes |= {} if scan.blur is None else {"blur": str(scan.blur)}
    scans = pyramid(scan, grid, levels if method in ("map", "ml") else 1, downsample)
    A = Projector(scan.views, grid)  # raises GeometryError before any work
    if method == "fbp" or (method in ("map", "ml") and "descent" in optimizers):
        check_upright(A, "fbp" if method == "fbp" else "the optimizer descent")
    for finding in check_grid(scan.views, grid):
        warnings.warn(str(finding), stacklevel=2)
    if levels == 1 or not sweeps_are_cheap(A):  # then "auto" has no sweeps: see `hybrid_descent`
        optimizers = ["momentum" if name == "auto" else name for name in optimizers]
    if isinstance(start, str) and start == "auto":
        start = "uniform" if flat else "backprojection"
    rule = StoppingRule(most, tolerance)
    prior = _resolved(prior, resolution, method)
    local = None
    if prior.resolution is not None:
        local = strength_for_resolution(prior, A.views, grid, prior.resolution, scan.blur)
    baseline = _baseline(method, prior, window, cutoff, relaxation)
    return _run(
        scans,
        A,
        method,
        prior,
        local,
        chosen,
        start,
        curvature,
        optimizers,
        rule,
        interpolation,
        resume,
        baseline,
        inside,
        notes,
    )


OPTIONS = tuple(iterates.__kwdefaults__ or ())


def reconstruct(
    scan: Scan,
    grid: Grid | None = None,
    *,
    thickness: float | None = None,
    spacing: float | None = None,
    levels: int | None = None,
    method: Method = "map",
    prior: Prior | None = None,
    resolution: float | None = None,
    likelihood: LikelihoodOf = "poisson",
    start: Literal["auto", "backprojection", "uniform"] | Volume = "auto",
    curvature: Curvature = "precomputed",
    optimizer: str | Sequence[str] = "auto",
    iterations: int | Sequence[int] = 50,
    tolerance: float = TOLERANCE,
    downsample: Downsample = "sum",
    interpolation: Interpolation = "linear",
    window: Window = "hann",
    cutoff: float = 1.0,
    relaxation: float = 1.0,
    support: Support = "none",
    resume: Step | None = None,
    optimiser: str | Sequence[str] | None = None,
) -> Volume:
    """Return the volume behind a scan: the last of `iterates`.

    Parameters
    ----------
    scan : Scan
        The projections.
    grid : Grid, optional
        The voxels. By default they cover the field that the views share, see `covering_grid`.
    thickness : float, optional
        Depth of the default grid, mm.
    spacing : float, optional
        Voxel size of the default grid in the slice, mm.
    levels, method, prior, resolution, likelihood, start, curvature, optimizer, iterations, tolerance : optional
        As for `iterates`.
    downsample, interpolation, window, cutoff, relaxation, support, resume, optimiser : optional
        As for `iterates`.

    Returns
    -------
    Volume
        Attenuation (z, y, x), 1/mm.

    Raises
    ------
    DataError, GeometryError
        If an argument is not valid, before any work is done.

    Examples
    --------
    >>> found = pp.reconstruct(scan, grid, levels=1, iterations=20)
    >>> pp.nmse(found.values, volume.values) < 0.3
    True
    """
    given = locals() | {"optimizer": _new_spelling(optimizer, optimiser), "optimiser": None}
    grid = covering_grid(scan.views, thickness, spacing) if grid is None else grid
    return deque(iterates(scan, grid, **{name: given[name] for name in OPTIONS}), maxlen=1)[0].volume


def _run(
    scans: Sequence[tuple[Scan, Grid]],
    A: Projector,
    method: Method,
    prior: Prior,
    local: float | None,
    likelihood: Callable[[Scan], Likelihood],
    start: str | Volume,
    curvature: Curvature,
    optimizers: Sequence[str],
    rule: StoppingRule,
    interpolation: Interpolation,
    resume: Step | None,
    baseline: Baseline,
    inside: UInt8 | None,
    notes: Mapping[str, str],
) -> Iterator[Step]:
    began = time.perf_counter() - (resume.seconds if resume else 0)
    A, data = finest = A, _models_blur(likelihood(scans[0][0]), scans[0][0])
    prior = Prior("quadratic", 0.0) if method == "ml" else prior
    prior, beta = _prior_with_weight(prior, A, data, local) if method == "map" else (prior, 0.0)
    supports = [inside]
    for _, fine in scans[:-1]:
        supports.append(None if inside is None else (inside := coarser_support(inside, fine)))
    last = resume
    for level in reversed(range(len(scans))):
        if last is not None and (last.level < level or (last.level == level and last.finished)):
            continue
        (level_scan, grid), inside = scans[level], supports[level]
        A, data = (Projector(level_scan.views, grid), likelihood(level_scan)) if level else finest
        # The strength doubles with each level, so that an edge has about the same penalty on every grid: a coarser level
        # has a quarter of the pairs across it, each of twice the weight in mm (half and once where slices stay as thick).
        weight = beta * 2**level
        if last is not None and last.level == level:
            values, done, objective, before = last.volume.values, last.iteration, last.objective, last.previous
        else:
            values = (
                resample(last.volume, grid, interpolation).values
                if last
                else _initial_values(start, A, data, interpolation, inside)
            )
            values = values if inside is None else values * (inside > 0)
            done, objective, before = 0, None, None
        remembers = method in ("map", "ml") and optimizers[level] != "descent"
        pace, own = None, None
        if remembers and optimizers[level] == "subsets":
            pace = (
                SubsetsState.of(before, last.pace)
                if last and before is not None
                else SubsetsState(default_subsets(len(A.views)))
            )
            some = _likelihood_of_views(level_scan, likelihood)
            solver = ordered_subsets(A, data, prior, weight, values, some, pace, curvature, inside)
        elif remembers and optimizers[level] not in BUILT_IN["optimizer"]:
            state = last.state if last is not None and done else {}
            problem = Problem(A, data, prior, weight, curvature, inside)
            own = part("optimizer", optimizers[level])(problem, values.copy(), state)
            solver = _within_support(own.update, inside, optimizers[level])
        elif remembers and optimizers[level] == "auto":
            solver = hybrid_descent(A, data, prior, weight, values, curvature, done, before, inside)
        elif remembers:
            solver = memory_gradient(A, data, prior, weight, values, curvature, before, support=inside)
        elif method in ("map", "ml"):
            solver = coordinate_descent(A, data, prior, weight, values, curvature, support=inside)
        else:
            solver = baseline(A, data, values)
        for iteration, (f, now) in enumerate(solver, done + 1):
            finished = method in DIRECT or rule.finished(level, iteration, now, objective)
            # The solver does not write to it again, so it is not copied: a volume can have gigabytes.
            shared = method in ("map", "ml") and pace is None and own is None
            if shared and not finished:
                f.flags.writeable = False
            # A solver of ours steps to max(0, ...), never to NaN, and a step to infinity has no finite objective.
            known = shared and math.isfinite(now)
            volume = finite_volume(f, grid, notes) if known else Volume(f if shared else np.array(f), grid, notes=notes)
            previous, numbers = (values, ()) if pace is None else pace.state()
            if finished or not remembers or own:
                previous, numbers = None, ()
            state = {name: np.array(array) for name, array in own.state().items()} if own and not finished else {}
            seconds = time.perf_counter() - began
            used = prior if method == "map" else None
            last = Step(volume, now, level, iteration, seconds, finished, previous, numbers, state, used)
            objective, values = now, volume.values
            yield last
            if finished:
                break


def _within_support(
    update: Callable[[], tuple[Float32, float]], inside: UInt8 | None, name: str
) -> Iterator[tuple[Float32, float]]:
    """Every iterate of a registered optimizer. Raises `DataError` for one that leaves the support."""
    while True:
        f, objective = update()
        if inside is not None and f[inside == 0].any():
            raise DataError(f"optimizer {name!r} leaves the support; it must hold f = 0 where problem.support is 0")
        yield f, objective


def _models_blur(data: Likelihood, scan: Scan) -> Likelihood:
    """The likelihood. Raises `DataError` for one of ours without the scan's blur."""
    pixels = getattr(data, "likelihood", data)  # of `Hardened`
    if scan.blur is not None and isinstance(pixels, Transmission | WeightedLeastSquares):
        raise DataError(
            f"blur: the likelihood {type(pixels).__name__} has none in its model; take poisson, Blurred, or leave blur out"
        )
    return data


def _likelihood_of_views(scan: Scan, likelihood: Callable[[Scan], Likelihood]) -> Callable[[list[int]], Likelihood]:
    """The likelihood of some of the views."""
    return lambda views: likelihood(scan[views])


def _resolved(prior: Prior | None, resolution: float | None, method: str) -> Prior:
    """The prior that is meant by a prior and a resolution."""
    if resolution is not None:
        prior = replace(prior if prior is not None else Prior("quadratic"), resolution=resolution)
    prior = prior if prior is not None else Prior()
    if prior.resolution is not None and method != "map":
        raise DataError(f'resolution: the method {method!r} has no quadratic prior that sets it; take "map"')
    if prior.smooth and method != "map":
        raise DataError(f'prior smooth: the method {method!r} has no prior that it sets; take "map"')
    return prior


def _prior_with_weight(prior: Prior, A: Projector, data: Likelihood, local: float | None) -> tuple[Prior, float]:
    """The prior with all parameters chosen, and β, from the finest grid."""
    known = data_curvature(A, data)
    prior = choose_prior_parameters(prior, A, data, known, local)
    assert prior.strength is not None
    return prior, prior.strength * median_curvature(known)


def _baseline(method: Method, prior: Prior, window: Window, cutoff: float, relaxation: float) -> Baseline:
    if method in DIRECT:
        make = backproject if method == "backprojection" else partial(fbp, window=window, cutoff=cutoff)
        return lambda A, data, values: iter([(volume := make(A, data), data.value(A(volume)))])
    if method == "sart":
        return partial(sart, relaxation=relaxation)
    return partial(tv, strength=prior.strength) if method == "tv" else sirt


def _initial_values(
    start: str | Volume, A: Projector, data: Likelihood, interpolation: Interpolation, inside: UInt8 | None
) -> Float32:
    if isinstance(start, Volume):
        return np.maximum(resample(start, A.grid, interpolation).values, 0)
    return uniform_volume(A, data, inside) if start == "uniform" else backproject(A, data)


def _new_spelling(optimizer: str | Sequence[str], optimiser: str | Sequence[str] | None) -> str | Sequence[str]:
    """The optimizer, given by either spelling; the old one warns the caller's caller."""
    if optimiser is None:
        return optimizer
    warnings.warn(f"optimiser={optimiser!r}: write optimizer=; {OLD_SPELLING}", DeprecationWarning, stacklevel=3)
    return optimiser


def _per_level(iterations: int | Sequence[int], levels: int) -> Sequence[int]:
    each = [iterations * 2**k for k in range(levels)] if isinstance(iterations, int) else list(iterations)
    if len(each) != levels or any(n < 1 for n in each):
        raise DataError(f"iterations: expected a number of at least 1, or {levels} (finest first), got {iterations!r}")
    return each


def _optimizers(optimizer: str | Sequence[str], levels: int) -> Sequence[str]:
    each = [optimizer] * levels if isinstance(optimizer, str) else list(optimizer)
    for name in each:
        if name not in names("optimizer"):
            raise DataError(f"optimizer: there is no {name!r}; choose from {', '.join(names('optimizer'))}")
    if len(each) != levels:
        raise DataError(f"optimizer: expected one, or {levels} (finest first), got {optimizer!r}")
    return each


def _check_choices(
    method: str, curvature: str, interpolation: str, start: object, likelihood: object, tolerance: float
) -> None:
    """Raises `DataError` for an unknown name, and lists the known ones."""
    for name, value, there in (
        ("method", method, get_args(Method)),
        ("curvature", curvature, CURVATURES),
        ("interpolation", interpolation, INTERPOLATIONS),
        ("start", start, ("auto", "backprojection", "uniform")),
        ("likelihood", likelihood, tuple(LIKELIHOODS)),
    ):
        if value not in there and not (isinstance(value, Volume) or callable(value)):
            raise DataError(f"{name}: there is no {value!r}; choose from {', '.join(there)}")
    if not 0 <= tolerance < 1:
        raise DataError(f"tolerance: expected a share of the objective from 0 to below 1, got {tolerance!r}")
