"""Error of projections against exact line integrals, in float64, averaged over each pixel by the tests' own oracle.

NRMSE = |p - exact| / |exact| over a patch of the panel, for the view in which it is worst. The default tolerance, the same
kernels as in the times.
"""

import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

import palpate as pp
from benchmarks import THREADS
from benchmarks.interleaved_timing import header, row
from benchmarks.workloads import WORKLOADS, smooth

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from support.reference_projector import projections

NAMES = ("W1 circular-8", "W2 dbt-15", "W5 diagonal-4")
SIDE = 10  # pixels of a patch
SETTLED = 1e-3  # relative change of the oracle when its rays are made twice as dense


def lines() -> Iterator[str]:
    """One row a workload and patch."""
    yield "Worst view's NRMSE, %, against exact line integrals averaged over pixels (float64, independent code), default "
    yield f"tolerance; patches of {SIDE}x{SIDE} pixels. Random: voxels uniform in [0, 1). Zero-mean: the same less 0.5.\n"
    yield header("workload", "patch", "smooth", "random", "zero-mean", "of its view")
    for name in NAMES:
        views, grid = WORKLOADS[name]()
        random = np.random.default_rng(0).random(grid.shape, np.float32)
        A, humps, flat = pp.Projector(views, grid), smooth(grid), np.full(grid.shape, 0.5, np.float32)
        p = np.stack([A(humps), A(random), A(random - flat)], axis=-1)
        volumes = np.stack([humps, random, flat], axis=-1)
        for patch, corner in (("centre", _centre), ("chest-wall corner", _corner)):
            with ProcessPoolExecutor(THREADS, get_context("fork"), _hold, (p, volumes, views, grid, corner)) as pool:
                errors = np.array(list(pool.map(_errors, range(len(views)))))
            yield row(name, patch, *(100 * errors[..., 0]).max(axis=0).tolist(), 100 * float(errors[:, 2, 1].max()))


def _hold(*held: object) -> None:
    """What the worker processes share with this one, too big to send."""
    global _held
    _held = held


def _errors(view: int) -> np.ndarray:
    """(volumes, 2): NRMSE over the patch; the same error over the whole view's root mean square.

    Held are the projections of the smooth, the random and the zero-mean volume; the smooth one, the random one and what
    is taken off it; the geometry; where the patch is.
    """
    p, volumes, views, grid, corner = _held
    first = corner(views, grid, view)
    rows, columns = np.indices((SIDE, SIDE)).reshape(2, -1) + first[:, None]
    exact = projections(volumes, views, grid, view, np.stack([rows, columns], axis=1), SETTLED)
    exact[:, 2] = exact[:, 1] - exact[:, 2]  # random less flat: so the oracle need not settle on what is nearly 0
    error = np.linalg.norm(p[view, rows, columns] - exact, axis=0)
    whole = np.sqrt((p[view].astype(np.float64) ** 2).mean(axis=(0, 1))) * SIDE
    return np.stack([error / np.linalg.norm(exact, axis=0), error / whole], axis=1)


def _centre(views: pp.Views, grid: pp.Grid, view: int) -> np.ndarray:
    """First pixel of the patch around the shadow of the grid's centre."""
    return _around(views, view, grid.bounds.mean(axis=0))


def _corner(views: pp.Views, grid: pp.Grid, view: int) -> np.ndarray:
    """Around a point near the grid's corner at least x and y, 6 % inside, halfway up."""
    return _around(views, view, grid.bounds[0] + (0.06, 0.06, 0.5) * (grid.bounds[1] - grid.bounds[0]))


def _around(views: pp.Views, view: int, point: np.ndarray) -> np.ndarray:
    landed = np.round(views[view].project(point[None])[0, 0]).astype(int)
    return np.clip(landed - SIDE // 2, 0, np.array(views.shape[1:]) - SIDE)
