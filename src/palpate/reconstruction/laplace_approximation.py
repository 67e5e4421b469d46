"""The posterior as a normal distribution about the MAP estimate, and draws from it by local perturbations."""

import math
from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import islice, product
from typing import Self

import numpy as np
from scipy.sparse.linalg import LinearOperator, cg

from palpate import _core
from palpate.arrays import ArrayLike, Bool, Float32, float32
from palpate.errors import DataError
from palpate.reconstruction.models.blurred import Blurred
from palpate.reconstruction.models.blurred_least_squares import BlurredLeastSquares
from palpate.reconstruction.models.likelihood import Likelihood, WeightedLeastSquares
from palpate.reconstruction.multiresolution import coarser_support, pyramid
from palpate.reconstruction.optimizers.memory_gradient import majoriser, memory_gradient
from palpate.reconstruction.optimizers.problem import OUTLINE, Problem
from palpate.reconstruction.projector import Projector
from palpate.scans.scan import Scan
from palpate.volumes.grid import Grid
from palpate.volumes.resample import resample
from palpate.volumes.volume import Volume

STEP = 0.02  # of a line integral, for the difference quotient of a likelihood's slope
PRECISE = 1e-5  # residual at which conjugate gradients end, relative
MOST = 2000  # of their steps
# Behind a blur fine detail of a draw converges slowly where the prior is weak: it goes on until a step is that small, of
# what the draw differs by from the centre, at most so many times the iterations that are asked for.
STILL, LONGER = 0.02, 50
Squares = WeightedLeastSquares | BlurredLeastSquares


@dataclass(frozen=True, eq=False)
class LaplaceApproximation:
    """The normal distribution whose log-density has the objective's second derivatives at the MAP estimate.

    Its precision matrix is H = Aᵀ W A + β K, with the likelihood's second derivatives W at the estimate and the Hessian K
    of R. Behind a blur W is Sᵀ D S, see `BlurredLeastSquares`, with the second derivatives D by what the pixels show; what
    is left out has the mean 0 over the noise. The finest level comes first; the coarser ones only give each draw a start.

    levels: on each level the centre f̂, (z, y, x) 1/mm, and the problem ‖A f − A f̂‖²_W / 2 + β R(f) − ⟨linear, f⟩, whose
    minimum over f >= 0 it is.
    """

    levels: Sequence[tuple[Float32, Problem]]

    @classmethod
    def of(cls, problem: Problem, volume: Volume, scan: Scan, levels: int) -> Self:
        """About a volume that has come near to the minimum of a problem. scan: the problem's, for the coarser panels."""
        centre, grid = volume.values, volume.grid
        A, support = problem.A, problem.support
        weights = pixel_weights(problem.likelihood, A(centre))
        slope = problem.gradient(centre)
        # Where f = 0 holds against a slope the draws shall feel it, too (the multiplier of Karush, Kuhn & Tucker). Elsewhere
        # it is what the run has left; without it the draws lie about the volume that was given.
        multiplier = np.where((centre <= 0) & (slope > 0), slope, np.float32(0))
        beta, made = problem.beta, []
        for level, (coarse, coarse_grid) in enumerate(pyramid(scan, grid, levels)):
            if level:
                thick = coarse_grid.shape[0] == grid.shape[0]
                centre = resample(Volume(centre, grid), coarse_grid, "linear").values
                multiplier = np.where(centre <= 0, restricted(multiplier, grid, coarse_grid), np.float32(0))
                support = None if support is None else coarser_support(support, grid)
                A, grid, weights = Projector(coarse.views, coarse_grid), coarse_grid, _pixel_sums(weights)
                # For smooth volumes R of 2 x 2 x 2 voxels is that of the fine ones. Where slices stay as thick, pairs in
                # depth keep half of their part in it, and those in the slice all of it: in between.
                beta *= math.sqrt(2) if thick else 1
            data: Squares
            if coarse.blur is None:
                data = WeightedLeastSquares(A(centre), weights)
            else:
                data = BlurredLeastSquares.about(A(centre), weights, coarse.blur.taps(coarse.views))
            here = Problem(A, data, problem.prior, beta, "precomputed", support)
            made.append((centre, replace(here, linear=here.prior_surrogate(centre)[0] - multiplier)))
        return cls(made)

    def draw(self, seed: int, number: int, iterations: int) -> Float32:
        """Draw a volume, (z, y, x) 1/mm. Equal seeds and numbers give equal draws.

        iterations: on the finest level; three times as many on level 1, and twice as many on each coarser one. Behind a blur
        more, until the draw hardly moves.
        """
        (_, fine), *_ = self.levels
        stream = np.random.Generator(np.random.SFC64([seed, number, 0]))
        noise = stream.standard_normal(fine.A.range_shape, np.float32) * np.sqrt(squares(fine).weights)
        linear = prior_noise(fine, (seed, number, 1))
        perturbations, grid = [(noise, linear)], fine.A.grid
        for _, problem in self.levels[1:]:
            noise, linear = _pixel_sums(noise), restricted(linear, grid, problem.A.grid)
            perturbations.append((noise, linear))
            grid = problem.A.grid
        change: Volume | None = None
        for level in reversed(range(len(self.levels))):
            centre, problem = self.levels[level]
            noise, linear = perturbations[level]
            start = centre
            if change is not None:
                start = np.maximum(centre + resample(change, problem.A.grid, "linear").values, 0)
                start = start if problem.support is None else start * (problem.support > 0)
            most = iterations if level == 0 else 3 * iterations * 2 ** (level - 1)
            values = _minimum(problem, noise, linear, start, most, centre)
            change = Volume(values - centre, problem.A.grid)
        return values

    def standard_deviation(self, weights: ArrayLike) -> float:
        """Return the standard deviation √(gᵀ H⁻¹ g) of Σ g_j f_j, by one solve; voxels at 0 are held there."""
        centre, problem = self.levels[0]
        free = centre > 0
        g = float32("weights", weights, centre.shape) * free
        if not g.any():
            return 0.0
        data = squares(problem)
        x = solve_hessian(problem, replace(data, line_integrals=np.zeros_like(data.line_integrals)), free, g)
        return math.sqrt(float(np.vdot(g.astype(np.float64), x)))


def solve_hessian(problem: Problem, data: Squares, free: Bool, g: Float32) -> Float32:
    """x of (Aᵀ W A + β K) x = g among the free voxels, 0 elsewhere, by conjugate gradients; for a quadratic prior alone.

    data: ‖l‖²_W / 2. free, g: (z, y, x). Raises `DataError` if they do not come to an end.
    """
    A, shape = problem.A, g.shape

    def hessian(x: Float32) -> Float32:
        f = np.ascontiguousarray(x.reshape(shape), np.float32)
        answer = A.T(data.slope(A(f))) + problem.prior_surrogate(f)[0]
        return np.where(free, answer, f).ravel()

    diagonal = (
        majoriser(A, data.curvature(data.line_integrals))[0]
        + 2 * problem.prior_surrogate(np.zeros(shape, np.float32))[1]
    )
    inverse = LinearOperator((g.size, g.size), lambda x: (x.reshape(shape) / np.where(free, diagonal, 1)).ravel())
    x, unfinished = cg(
        LinearOperator((g.size, g.size), hessian, dtype=np.float32),
        (g * free).ravel(),
        rtol=PRECISE,
        maxiter=MOST,
        M=inverse,
    )
    if unfinished:
        raise DataError(f"the Hessian's solution: conjugate gradients have not come to an end in {MOST} steps")
    return np.asarray(x.reshape(shape), np.float32)


def pixel_weights(likelihood: Likelihood, l: Float32) -> Float32:
    """(views, rows, columns): second derivatives by what each pixel shows, which without blur is its line integral."""
    if isinstance(likelihood, Blurred):
        return second_derivative(likelihood.pixels, likelihood.seen(l))
    return second_derivative(likelihood, l)


def second_derivative(likelihood: Likelihood, l: Float32) -> Float32:
    """(views, rows, columns), >= 0: h'' at line integrals, by central differences of the slope, which any likelihood has."""
    step = np.float32(STEP)
    difference = likelihood.slope(l + step) - likelihood.slope(l - step)
    return np.asarray(np.maximum(difference / (2 * step), 0), np.float32)


def _minimum(
    problem: Problem, noise: Float32, linear: Float32, start: Float32, least_iterations: int, centre: Float32
) -> Float32:
    """The minimum of a problem whose gradient is perturbed by −Aᵀ noise − linear, or −Aᵀ Sᵀ noise where it is blurred."""
    data = squares(problem)
    shift = np.divide(noise, data.weights, out=np.zeros_like(noise), where=data.weights > 0)
    data = replace(data, line_integrals=data.line_integrals + shift)
    assert problem.linear is not None
    linear = problem.linear + linear
    run = memory_gradient(problem.A, data, problem.prior, problem.beta, start, support=problem.support, linear=linear)
    values, least = start, math.inf
    most = least_iterations if isinstance(data, WeightedLeastSquares) else LONGER * least_iterations
    for iteration, (f, objective) in enumerate(islice(run, most), 1):
        if objective >= least:
            break
        settled = iteration > least_iterations and np.linalg.norm(f - values) < STILL * np.linalg.norm(f - centre)
        values, least = f, objective
        if settled:
            break
    return values


def squares(problem: Problem) -> Squares:
    """The data term of a level."""
    assert isinstance(problem.likelihood, Squares)
    return problem.likelihood


def prior_noise(problem: Problem, seed: Sequence[int]) -> Float32:
    """(z, y, x), mm, with the covariance β K: the slope of each pair is perturbed by noise of variance β ω.

    The noise of a pair is uniform, which takes a quarter of the time: a voxel sums up that of its 6 to 26 pairs, and a draw
    that of thousands, so that it is normal all the same. Slices have random streams of their own, so that the number of
    threads does not matter. Pairs across an object's outline do not count in R, and have none.
    """
    grid, support = problem.A.grid, problem.support
    one = np.zeros((3, 3, 3), np.float32)
    one[1, 1, 1] = 1
    weights = -problem.beta * problem.prior.surrogate(one, Grid(one.shape, grid.spacing))[0]
    forward = [
        (step, weights[tuple(np.add(step, 1))]) for step in product((0, 1), (-1, 0, 1), (-1, 0, 1)) if step > (0, 0, 0)
    ]
    e = np.zeros(grid.shape, np.float32)
    height, width = grid.shape[1:]

    def perturb(z: int) -> None:
        """The pairs within a slice, and those with the next."""
        stream = np.random.Generator(np.random.SFC64([*seed, z]))
        for (dz, dy, dx), weight in forward:
            if weight > 0 and z + dz < len(e):
                (here, there), (left, right) = _pairs(dy, height), _pairs(dx, width)
                first = e[z, here, left]
                noise = np.frombuffer(stream.bytes(2 * first.size), np.int16).reshape(first.shape).astype(np.float32)
                noise *= np.float32(math.sqrt(3 * weight) / 2**15)
                if support is not None:
                    a, b = support[z, here, left], support[z + dz, there, right]
                    noise *= np.maximum(a, b) - np.minimum(a, b) != OUTLINE
                first += noise
                e[z + dz, there, right] -= noise

    with ThreadPoolExecutor(_core.base.threads()) as pool:
        for parity in (0, 1):  # a slice writes to itself and the next
            deque(pool.map(perturb, range(parity, len(e), 2)), maxlen=0)
    return e


def _pairs(step: int, size: int) -> tuple[slice, slice]:
    """Where the first and the second of two neighbours lie along an axis."""
    return slice(max(-step, 0), size - max(step, 0)), slice(max(step, 0), size + min(step, 0))


def restricted(volume: Float32, fine: Grid, coarse: Grid) -> Float32:
    """The transpose of linear interpolation from a coarser grid: each voxel's value is shared among coarse ones."""
    for axis in range(3):
        if coarse.shape[axis] != fine.shape[axis]:
            v = np.moveaxis(volume, axis, 0)
            v = np.concatenate([v, np.zeros_like(v[:1])]) if len(v) % 2 else v
            cells = np.float32(0.75) * (v[0::2] + v[1::2])
            cells[1:] += np.float32(0.25) * v[1:-1:2]
            cells[:-1] += np.float32(0.25) * v[2::2]
            cells[0] += np.float32(0.25) * v[0]
            cells[-1] += np.float32(0.25) * v[-1]
            volume = np.asarray(np.moveaxis(cells, 0, axis), np.float32)
    return np.ascontiguousarray(volume)


def _pixel_sums(a: Float32) -> Float32:
    """Over 2 x 2 pixels, those missing at odd sizes left out."""
    for axis in (1, 2):
        a = np.add.reduceat(a, np.arange(0, a.shape[axis], 2), axis=axis)
    return np.ascontiguousarray(a)
