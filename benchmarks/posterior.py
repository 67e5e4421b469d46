"""Whether samples of the posterior are those of the posterior, and what they cost, as Markdown tables.

    python -m benchmarks.posterior covariance ranks spread cost

covariance: 5,000 samples on 6 x 8 x 8 voxels against (Aᵀ W A + β K)⁻¹ of dense matrices. A is the tests' oracle (Siddon's
method), K comes from the formula of the pairs' weights. ranks: truths drawn from the prior, Poisson counts, and the rank of
each truth among 15 samples; χ² over the 16 ranks of each functional. spread: standard deviation of samples after the few
default iterations over that of converged ones of the same noise. cost: time of 30 samples over that of a default
run, in turn, median and range of repeats. No constant was chosen on these seeds.
"""

import argparse
import sys
import time
import warnings
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter
from scipy.stats import chi2

import palpate as pp
from palpate.arrays import Bool, Float64
from palpate.reconstruction.laplace_approximation import LaplaceApproximation
from palpate.reconstruction.models.likelihood import Transmission
from palpate.reconstruction.optimizers.coordinate_descent import data_curvature
from palpate.reconstruction.posterior import ITERATIONS, approximate_posterior
from palpate.reconstruction.prior_parameters import median_curvature
from palpate.reconstruction.projector import Projector

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from support.reference_projector import pixel_means

GRID = pp.Grid.centred((6, 8, 8), (3, 2, 2.5), z=20)
VIEWS = pp.arc_views(pp.Panel((16, 22), (2, 2), (-21, -15, 0)), np.linspace(-25, 25, 6), radius=300, pivot=(0, 0, 20))
INCIDENT, LEVEL, BETA = 20_000.0, 0.03, 1e4
CONVERGED = 60
EXACT = {"levels": 1, "iterations": CONVERGED, "tolerance": 0, "sample_iterations": CONVERGED}
VOLUMES: dict[str, Callable[[Float64], float]] = {
    "a voxel": lambda f: float(f[2, 4, 3]),
    "mean": lambda f: float(f.mean()),
    "a slice": lambda f: float(f[3].mean()),
    "contrast of a block": lambda f: float(f[1:4, 2:5, 2:5].mean() - f[1:4].mean()),
    "slope in depth": lambda f: float(f[3:].mean() - f[:3].mean()),
    "maximum": lambda f: float(f.max()),
    "ratio of two slices": lambda f: float(f[1].mean() / f[4].mean()),
}


def dense() -> tuple[Float64, Float64]:
    """A, (pixels, voxels), and K, (voxels, voxels)."""
    size = int(np.prod(GRID.shape))
    voxels = np.moveaxis(np.eye(size).reshape(size, *GRID.shape), 0, -1)
    pixels = np.stack(np.unravel_index(np.arange(16 * 22), (16, 22)), axis=1)
    A = np.concatenate([pixel_means(voxels, VIEWS, GRID, view, pixels, 8) for view in range(len(VIEWS))])
    spacing, at = np.array(GRID.spacing), np.array(list(np.ndindex(GRID.shape)))
    steps = np.abs(at[:, None] - at[None])
    distance = np.sqrt(((steps * spacing) ** 2).sum(-1))
    pair = steps.max(-1) == 1
    K = -np.where(pair, spacing.prod() / (np.where(pair, distance, 1) * spacing.min()), 0)
    return A, K - np.diag(K.sum(1))


def sampled(truth: Float64, samples: int, seed: int) -> pp.Posterior:
    """Samples of the posterior after Poisson counts of a truth."""
    mean = INCIDENT * np.exp(-Projector(VIEWS, GRID)(truth.astype(np.float32)).astype(float))
    scan = pp.Scan(np.random.default_rng([seed, 1]).poisson(mean), INCIDENT, VIEWS)
    known = data_curvature(Projector(VIEWS, GRID), Transmission.of(scan))
    prior = pp.Prior("quadratic", strength=BETA / median_curvature(known))
    return pp.posterior(scan, GRID, samples=samples, seed=seed, prior=prior, **EXACT)


def covariance(samples: int = 5000) -> None:
    """Prints the table."""
    A, K = dense()
    found = sampled(np.full(GRID.shape, LEVEL), samples, seed=101)
    weights = INCIDENT * np.exp(-A @ found.map.values.ravel().astype(float))
    exact = np.linalg.inv(A.T @ (weights[:, None] * A) + BETA * K)
    changes = (found.samples - found.map.values).reshape(samples, -1).astype(float)
    ratio = changes.std(axis=0) / np.sqrt(exact.diagonal()) - 1
    white = changes @ np.linalg.cholesky(np.linalg.inv(exact))
    print("| of the samples, over that of the dense posterior | off | standard error of the sampling |\n|---|---|---|")
    error = 1 / np.sqrt(2 * samples)
    print(f"| standard deviation of a voxel, largest of {ratio.size} | {abs(ratio).max():.1%} | {error:.1%} each |")
    print(f"| the same, root mean square | {np.sqrt((ratio**2).mean()):.1%} | {error:.1%} |")
    zero = np.zeros(GRID.shape)
    for name in list(VOLUMES)[:5]:  # the linear ones
        g = np.array([VOLUMES[name](zero + e.reshape(GRID.shape)) for e in np.eye(ratio.size)])
        true = np.sqrt(g @ exact @ g)
        first = found.linear_std(g.reshape(GRID.shape)) / true - 1
        print(f"| {name} | {(changes @ g).std() / true - 1:+.1%} (one solve {first:+.2%}) | {error:.1%} |")
    print(f"| variance of all whitened components | {white.var() - 1:+.2%} | {np.sqrt(2 / white.size):.2%} |")


def ranks(truths: int = 240, samples: int = 15) -> None:
    """Prints the table."""
    _, K = dense()
    values, vectors = np.linalg.eigh(BETA * K)
    root = vectors[:, 1:] / np.sqrt(values[1:])  # the prior does not know the mean, which stays the same
    found, smallest = [], np.inf
    for number in range(truths):
        truth = LEVEL + (root @ np.random.default_rng([102, number]).standard_normal(values.size - 1)).reshape(
            GRID.shape
        )
        drawn = sampled(truth, samples, seed=1000 + number)
        smallest = min(smallest, truth.min(), drawn.samples.min())
        found.append([sum(of(f) < of(truth) for f in drawn.samples.astype(float)) for of in VOLUMES.values()])
    print(
        f"{truths} truths from the prior, {samples} samples each; the smallest voxel of all is {smallest:.3f} 1/mm.\n"
    )
    print(f"| functional | ranks 0 to {samples}, expected {truths / (samples + 1):.1f} each | p | p, corrected |")
    print("|---|---|---|---|")
    for name, each in zip(VOLUMES, np.transpose(found), strict=True):
        counts, expected = np.bincount(each, minlength=samples + 1), truths / (samples + 1)
        p = chi2.sf(((counts - expected) ** 2 / expected).sum(), samples)
        print(f"| {name} | {' '.join(map(str, counts))} | {p:.2f} | {min(1, p * len(VOLUMES)):.2f} |")


def breast(voxel: float) -> tuple[pp.Scan, pp.Grid]:
    """Half an ellipsoid with balls in it, 15 views; slices are 1 mm, or 2 mm where voxels are wider than that half."""
    thick = 1.0 if voxel < 0.5 else 2.0
    shape = round(50 / thick), round(102.4 / voxel), round(160 / voxel)
    grid = pp.Grid(shape, (thick, voxel, voxel), ((voxel - 160) / 2, voxel / 2, 31))
    pitch = 0.85 * voxel
    panel = pp.Panel((round(1.5 * shape[1]), round(1.28 * shape[2])), (pitch, pitch), (-87, pitch / 2, 0))
    angles = np.radians(np.linspace(-25, 25, 15))
    views = pp.Views(np.stack([650 * np.sin(angles), 0 * angles, 40 + 650 * np.cos(angles)], axis=1), panel)
    low, size, rng = grid.bounds[0], np.ptp(grid.bounds, axis=0), np.random.default_rng(103)
    middle = low + size / 2
    shapes = [(pp.Ellipsoid((middle[0], low[1], middle[2]), (0.45 * size[0], 0.9 * size[1], 0.48 * size[2])), 0.05)]
    for _ in range(30):
        at = middle + (rng.random(3) - 0.5) * size * [0.5, 0.5, 0.8]
        shapes.append((pp.Ellipsoid(at, rng.uniform(1, 6)), 0.01))
    return pp.simulate_scan(pp.Phantom(shapes), views, incident=20_000, seed=104), grid


PRIORS: dict[str, tuple[float, dict[str, Any]]] = {
    "--resolution 0.6mm, voxels 0.4 mm": (0.4, {"resolution": 0.6}),
    "--resolution 1.2mm, voxels 0.8 mm": (0.8, {"resolution": 1.2}),
    "quadratic, strength by dose, voxels 0.8 mm": (0.8, {"prior": pp.Prior("quadratic")}),
}


def changes(laplace: LaplaceApproximation, inside: Bool, iterations: int, draws: int) -> list[float]:
    """Root mean square of the draws about the centre: of voxels, and of means of blocks of 7 and 20 mm."""
    centre, problem = laplace.levels[0]
    of = [laplace.draw(105, k, iterations) - centre for k in range(draws)]
    sizes = [(1, 1, 1), *(tuple(max(1, round(mm / s)) for s in problem.A.grid.spacing) for mm in (7, 20))]
    return [float(np.sqrt(np.mean([uniform_filter(f, size)[inside] ** 2 for f in of]))) for size in sizes]


def spread(draws: int = 2) -> None:
    """Prints the table."""
    print("| prior | iterations | a voxel | mean of a block of 7 mm | of 20 mm |\n|---|---|---|---|---|")
    for name, (voxel, options) in PRIORS.items():
        scan, grid = breast(voxel)
        last = deque(pp.iterates(scan, grid, **options), maxlen=1)[0]
        laplace = approximate_posterior(scan, grid, last, options)
        inside = last.volume.values > 0.01
        converged = changes(laplace, inside, 60, draws)
        for iterations in (ITERATIONS, 2 * ITERATIONS, 5 * ITERATIONS):
            ratios = np.divide(changes(laplace, inside, iterations, draws), converged)
            print(f"| {name} | {iterations} | {' | '.join(f'{r:.2f}' for r in ratios)} |", flush=True)


def cost(repeats: int = 5, samples: int = 30) -> None:
    """Prints the table."""
    print("| prior | voxels | default run, s | the same prior's run, s | 30 samples, s | in default runs |")
    print("|---|---|---|---|---|---|")
    for name, (voxel, options) in PRIORS.items():
        scan, grid = breast(voxel)
        times = np.array([seconds(scan, grid, options, samples // repeats) for _ in range(repeats)])
        runs, own, prepared, drawn = times.T
        took = prepared + repeats * drawn
        ratios = took / runs
        print(
            f"| {name} | {' x '.join(map(str, grid.shape))} | {np.median(runs):.2f} | {np.median(own):.2f} | "
            f"{np.median(took):.1f} | {np.median(ratios):.1f} ({ratios.min():.1f} to {ratios.max():.1f}) |",
            flush=True,
        )


def seconds(scan: pp.Scan, grid: pp.Grid, options: dict[str, Any], samples: int) -> tuple[float, ...]:
    """Seconds of a default run, of one with the options, of what prepares the samples, and of some samples."""
    at = [time.perf_counter()]
    deque(pp.iterates(scan, grid), maxlen=0)
    at.append(time.perf_counter())
    last = deque(pp.iterates(scan, grid, **options), maxlen=1)[0]
    at.append(time.perf_counter())
    laplace = approximate_posterior(scan, grid, last, options)
    at.append(time.perf_counter())
    for number in range(samples):
        laplace.draw(106, number, ITERATIONS)
    at.append(time.perf_counter())
    return tuple(np.diff(at))


PARTS: dict[str, Callable[[], None]] = {"covariance": covariance, "ranks": ranks, "spread": spread, "cost": cost}


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.posterior", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []], default=list(PARTS))
    warnings.simplefilter("ignore")
    for part in parser.parse_args().parts:
        PARTS[part]()
        print()


if __name__ == "__main__":
    main()
