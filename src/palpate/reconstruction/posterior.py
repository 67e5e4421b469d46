"""Samples of the posterior by perturb-and-MAP: how far a reconstruction can be trusted, voxel by voxel or as a whole."""

import warnings
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate.arrays import ArrayLike, Float32
from palpate.errors import DataError
from palpate.reconstruction.default_grid import covering_grid
from palpate.reconstruction.iterate import Step
from palpate.reconstruction.laplace_approximation import LaplaceApproximation
from palpate.reconstruction.local_response import strength_for_resolution
from palpate.reconstruction.models.mrf_prior import Prior
from palpate.reconstruction.multiresolution import default_levels
from palpate.reconstruction.optimizers.coordinate_descent import data_curvature
from palpate.reconstruction.optimizers.problem import Problem
from palpate.reconstruction.prior_parameters import choose_prior_parameters, median_curvature
from palpate.reconstruction.projector import Projector
from palpate.reconstruction.reconstruct import LIKELIHOODS, LikelihoodOf, iterates
from palpate.reconstruction.support import Support, chosen_support
from palpate.scans.scan import Scan
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Volume

ITERATIONS = 2
COARSEST = 64  # voxels along a side of the slice: a draw's coarsest level has fewer


@dataclass(frozen=True, eq=False)
class Posterior:
    """What `posterior` finds: the MAP estimate, and the spread of samples about it.

    Parameters
    ----------
    map : Volume
        The MAP estimate, 1/mm: what `reconstruct` gives.
    mean, std : Volume
        Mean and standard deviation of the samples, 1/mm.
    laplace : LaplaceApproximation
        The distribution that was sampled.
    samples : ndarray, (samples, z, y, x), optional
        The samples, 1/mm, float32; none if they were not kept.

    Examples
    --------
    >>> found = pp.posterior(scan, grid, samples=5, resolution=6, levels=1)
    >>> found.std.values.shape == grid.shape
    True
    """

    map: Volume
    mean: Volume
    std: Volume
    laplace: LaplaceApproximation
    samples: Float32 | None = None

    def interval(self, functional: Callable[[Volume], float], level: float = 0.9) -> tuple[float, float]:
        """Return the interval that holds a function of the volume with a probability.

        Parameters
        ----------
        functional : callable
            A number of a volume, such as the contrast or the diameter of a structure.
        level : float, optional
            The probability. Its two ends are quantiles of the samples, so that few samples allow no high level.

        Returns
        -------
        tuple of float
            The lower and the upper end.

        Raises
        ------
        DataError
            If the samples were not kept, or are too few for the level.

        Examples
        --------
        >>> found = pp.posterior(scan, grid, samples=9, resolution=6, levels=1)
        >>> low, high = found.interval(lambda volume: volume.values.mean(), level=0.8)
        >>> low < high
        True
        """
        if self.samples is None:
            raise DataError("interval: the samples were not kept; give keep=True to posterior")
        tail, n = (1 - level) / 2, len(self.samples)
        if not 0 < level < 1 or tail * (n + 1) < 1 - 1e-9:
            raise DataError(
                f"level: expected a probability above 0, and of {n} samples at most {(n - 1) / (n + 1):.3g}, got {level!r}; "
                f"more samples allow more"
            )
        values = [functional(Volume(sample, self.map.grid, self.map.unit)) for sample in self.samples]
        # Between the k-th of n samples and the k-th from above a further draw lies with probability (n + 1 - 2k) / (n + 1).
        low, high = np.quantile(np.asarray(values, np.float64), [tail, 1 - tail], method="weibull")
        return float(low), float(high)

    def linear_std(self, weights: ArrayLike) -> float:
        """Return the standard deviation of Σ weights · f to first order: without samples, by one linear solve.

        It takes voxels at 0 as known, and the rest as free to become negative.

        Parameters
        ----------
        weights : array_like, (z, y, x)
            Weight of each voxel, such as 1 / n in a region of n voxels and −1 / m in what is around it.

        Returns
        -------
        float
            The standard deviation, in the unit of weights · 1/mm.

        Raises
        ------
        DataError
            If the shape is not the volume's.

        Examples
        --------
        >>> found = pp.posterior(scan, grid, samples=2, resolution=6, levels=1)
        >>> found.linear_std(np.full(grid.shape, 1 / volume.values.size)) > 0
        True
        """
        return self.laplace.standard_deviation(weights)

    def _repr_html_(self) -> str:
        return f"<p>MAP estimate</p>{self.map._repr_html_()}<p>standard deviation</p>{self.std._repr_html_()}"


def posterior(
    scan: Scan,
    grid: Grid | None = None,
    *,
    samples: int = 30,
    seed: int = 0,
    keep: bool = True,
    sample_iterations: int = ITERATIONS,
    thickness: float | None = None,
    spacing: float | None = None,
    **options: Any,
) -> Posterior:
    """Return samples of the posterior: volumes that data and prior find as plausible as the MAP estimate lets them be.

    Counts and prior are perturbed, each by noise of its own covariance, and the perturbed objective is minimised, from the
    MAP estimate on. Where the objective is quadratic and f >= 0 does not bind, the samples are exact draws; elsewhere they
    are of the normal distribution with the objective's second derivatives at the MAP estimate, cut off at f = 0 and at the
    support: there each is the minimum under these constraints. What the model leaves out (scatter, motion, a prior that
    does not fit the object) is not in their spread.

    Parameters
    ----------
    scan : Scan
        The projections.
    grid : Grid, optional
        The voxels. By default they cover the field that the views share.
    samples : int, optional
        How many, at least 2. The standard deviation of n is accurate to 1 / √(2 n): 13 % of 30.
    seed : int, optional
        Of the noise.
    keep : bool, optional
        Keep the samples, 4 bytes a voxel each, for `Posterior.interval`.
    sample_iterations : int, optional
        On the finest level, for each sample; more on coarser levels. Voxels and small structures need few. More make the
        spread of what is broad, such as the mean of many slices, more accurate. Behind a blur, whose fine detail comes
        last, each sample goes on until it hardly moves.
    thickness, spacing : float, optional
        Of the default grid, as for `reconstruct`.
    **options
        As for `reconstruct`. The prior must be quadratic; by default it is, and the data choose its strength.

    Returns
    -------
    Posterior
        The MAP estimate, mean and standard deviation, and the samples.

    Raises
    ------
    DataError, GeometryError
        If an argument is not valid, or the prior is not quadratic, before any work is done.

    References
    ----------
    Papandreou & Yuille, Gaussian sampling by local perturbations, NIPS 2010. Orieux, Feron & Giovannelli, IEEE Signal
    Process. Lett. 19:251, 2012.

    Examples
    --------
    >>> found = pp.posterior(scan, grid, samples=9, seed=1, resolution=6, levels=1)
    >>> low, high = found.interval(lambda volume: volume.values[2:4].mean(), level=0.8)
    >>> low < high
    True
    """
    check_sampling(samples, seed, sample_iterations)
    check_blur(scan, options.get("likelihood", "poisson"))
    options["prior"] = quadratic_prior(options.get("prior"), options.get("resolution"), options.get("method", "map"))
    grid = covering_grid(scan.views, thickness, spacing) if grid is None else grid
    last = deque(iterates(scan, grid, **options), maxlen=1)[0]
    laplace = approximate_posterior(scan, grid, last, options)
    kept = np.empty((samples, *grid.shape), np.float32) if keep else None
    last = deque(sample_steps(laplace, last, samples, seed, sample_iterations, kept), maxlen=1)[0]
    mean, std = mean_and_std(last)
    return Posterior(last.volume, mean, std, laplace, kept)


def quadratic_prior(prior: Prior | None, resolution: float | None, method: str = "map") -> Prior | None:
    """The prior of a posterior that can be sampled. Raises `DataError` for one that is not quadratic."""
    if method != "map":
        raise DataError(f'posterior: only of the method "map", which has a prior; got {method!r}')
    if prior is None:
        return None if resolution is not None else Prior("quadratic")
    if prior.potential != "quadratic":
        name = prior.potential if isinstance(prior.potential, str) else type(prior.potential).__name__
        raise DataError(
            f"posterior: samples need a quadratic prior, since the posterior of {name} is far from normal; give a "
            f'resolution, or take the potential "quadratic"'
        )
    if prior.strength == 0:
        raise DataError("posterior: a prior of strength 0 leaves voxels undetermined; give a strength above 0")
    return prior


def check_sampling(samples: int, seed: int, iterations: int = ITERATIONS) -> None:
    """Raises `DataError`."""
    for name, value, least in (("samples", samples, 2), ("seed", seed, 0), ("sample_iterations", iterations, 1)):
        if value != int(value) or value < least:
            raise DataError(f"{name}: expected a whole number of at least {least}, got {value!r}")


def check_blur(scan: Scan, likelihood: object) -> None:
    """Raises `DataError` for a scan with blur and a likelihood whose second derivatives behind it are not known."""
    if scan.blur is not None and likelihood != "poisson":
        raise DataError('samples: with blur in the model only of the likelihood "poisson"; leave the blur out')


def approximate_posterior(scan: Scan, grid: Grid, last: Step, options: Mapping[str, Any]) -> LaplaceApproximation:
    """About the last step of `iterates` with these options."""
    likelihood: LikelihoodOf = options.get("likelihood", "poisson")
    support: Support = options.get("support", "none")
    inside = None
    if not (isinstance(support, str) and support == "none"):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the reconstruction has said it
            inside, scan, _ = chosen_support(support, "map", scan, grid)
    if scan.blur is not None:
        scan = replace(scan, blur=scan.blur.through(grid))
    A = Projector(scan.views, grid)
    data = (LIKELIHOODS[likelihood] if isinstance(likelihood, str) else likelihood)(scan)
    prior = last.prior
    known = data_curvature(A, data)
    if prior is None:  # the step was read from a checkpoint
        given = options.get("prior") or Prior("quadratic")
        if options.get("resolution") is not None:
            given = replace(given, resolution=options["resolution"])
        local = None
        if given.resolution is not None:
            local = strength_for_resolution(given, A.views, grid, given.resolution, scan.blur)
        prior = choose_prior_parameters(given, A, data, known, local)
    assert prior.strength is not None
    problem = Problem(A, data, prior, prior.strength * median_curvature(known), "precomputed", inside)
    levels = options.get("levels")
    if levels is None:
        levels = default_levels(scan, grid)
        while min(grid.shape[1:]) >> (levels - 1) >= COARSEST:
            levels += 1
    return LaplaceApproximation.of(problem, last.volume, scan, levels)


def sample_steps(
    laplace: LaplaceApproximation,
    last: Step,
    samples: int,
    seed: int,
    iterations: int = ITERATIONS,
    kept: Float32 | None = None,
) -> Iterator[Step]:
    """After each sample a step whose state holds the moments of all so far, and whose iteration counts them.

    last: the reconstruction's last step, or one of these, after which to go on. kept: receives the samples.
    """
    done = last.iteration if "mean" in last.state else 0
    mean, squares = (
        np.array(last.state[n]) if done else np.zeros_like(last.volume.values) for n in ("mean", "squares")
    )
    for number in range(done, samples):
        sample = laplace.draw(seed, number, iterations)
        if kept is not None:
            kept[number] = sample
        change = sample - mean  # Welford, Technometrics 4:419, 1962
        mean = mean + change / np.float32(number + 1)
        squares = squares + change * (sample - mean)
        state = {"mean": mean, "squares": squares}
        yield replace(last, iteration=number + 1, finished=number + 1 == samples, state=state)


def mean_and_std(last: Step) -> tuple[Volume, Volume]:
    """Of all samples: the last of `sample_steps`."""
    n, grid = last.iteration, last.volume.grid
    notes = {**last.volume.notes, "samples": f"{n} of the posterior"}
    std = np.sqrt(last.state["squares"] / np.float32(n - 1))
    mean = Volume(last.state["mean"], grid, notes=notes)
    return mean, Volume(std, grid, notes={**notes, "values": "standard deviation"})


def std_path(output: str | Path) -> Path:
    """breast-std.nii.gz of breast.nii.gz."""
    stem, dot, suffixes = Path(output).name.partition(".")
    return Path(output).with_name(f"{stem}-std{dot}{suffixes}")
