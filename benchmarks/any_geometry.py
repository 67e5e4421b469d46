"""Sources and panels anywhere: random poses against exact integrals; a full orbit and a parallel beam against RTK's SART.

`python -m benchmarks.any_geometry` (half an hour and more); `--poses 50 --first 0` for some others.
"""

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import palpate as pp
from benchmarks import installed
from benchmarks.interleaved_timing import header, row

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from support.random_poses import box, boxes, ellipsoid, random_pose, random_voxels
from support.reference_projector import projections

PIXELS = 24  # of each pose, in the shadow
DEFAULT = 3e-3  # tolerance of a projector; at half of it views from above get fine pixels too
BODIES = {"box": box, "ellipsoid": ellipsoid, "boxes": boxes, "random voxels": random_voxels}
SETTLED = 1e-3  # relative change of the oracle when its rays are made twice as dense
SIDE, VOXEL = 96, 1.5  # of the volume, voxels and mm
VIEWS, PASSES = 200, (1, 2, 3)
RELAXATIONS = (0.3, 1.0)  # RTK's default, and ours
NOISE_SEED = 2001


def lines(first: int = 1000, poses: int = 1000) -> Iterator[str]:
    """Both tables."""
    yield from random_poses(first, poses)
    yield from against_rtk()


def random_poses(first: int, poses: int) -> Iterator[str]:
    """Adjoint and line integrals of poses around the whole sphere."""
    yield f"{poses} random poses (seeds from {first}), a third of them parallel beams, panels tilted by some 15°, spun and "
    yield f"off-centre. NRMSE of {PIXELS} pixels in the shadow against exact line integrals averaged over each pixel "
    yield "(float64, independent code): a box of voxels, an ellipsoid of voxels, several boxes, voxels uniform in [0, 1). "
    yield "Adjoint: |<Ax, y> - <x, A'y>| over the norms of Ax and y. From above: those views that version 0.1 took.\n"
    yield header("views", "tolerance", "number", "", *("adjoint", *(f"{name}, %" for name in BODIES)))
    seeds = {"from above": [], "from elsewhere": []}
    for seed in range(first, first + poses):
        seeds["from above" if pp.Projector(*random_pose(seed)).upright else "from elsewhere"].append(seed)
    unsettled = 0
    for name, tolerance in (("from elsewhere", DEFAULT), ("from above", DEFAULT), ("from above", DEFAULT / 2)):
        found = np.array([_judged(seed, tolerance) for seed in seeds[name]])
        unsettled += int(np.isnan(found[:, 1]).sum())
        for quantile, share in (("worst", 1), ("99 %", 0.99), ("median", 0.5)):
            adjoint, *errors = np.nanquantile(found, share, axis=0).tolist()
            yield row(name, tolerance, len(found), quantile, adjoint, *(100 * e for e in errors))
    yield f"\nIn {unsettled} of these the exact integrals did not settle within {SETTLED:g}: there only the adjoint counts.\n"


def _judged(seed: int, tolerance: float) -> tuple[float, ...]:
    """Of one pose: the adjoint's gap and the error of each body; NaN where the oracle does not settle."""
    views, grid = random_pose(seed)
    rng = np.random.default_rng(seed + 1_000_000)
    A, y = pp.Projector(views, grid, tolerance), rng.standard_normal(views.shape).astype(np.float32)
    volumes = np.stack([make(grid, seed) for make in BODIES.values()], axis=-1)
    p = np.stack([A(np.ascontiguousarray(volumes[..., k]))[0] for k in range(len(BODIES))], axis=-1)
    x, Ax, Aty = (a.astype(np.float64) for a in (volumes[..., -1], p[None, ..., -1], A.T(y)))
    gap = float(abs(np.vdot(Ax, y) - np.vdot(x, Aty)) / (np.linalg.norm(Ax) * np.linalg.norm(y)))
    shadow = np.argwhere(p[..., -1] > 0.05 * p[..., -1].max())
    pixels = shadow[rng.integers(0, len(shadow), PIXELS)]
    try:
        exact = projections(volumes, views, grid, 0, pixels, SETTLED)
    except AssertionError:
        return gap, *[np.nan] * len(BODIES)
    error = np.linalg.norm(p[tuple(pixels.T)] - exact, axis=0) / np.linalg.norm(exact, axis=0)
    return gap, *error.tolist()


def body() -> pp.Phantom:
    """Ellipsoids off every axis, 1/mm."""
    at = [
        (pp.Ellipsoid((0, 0, 0), (58, 46, 52)), 0.02),
        (pp.Ellipsoid((22, 8, -14), (14, 9, 11)), 0.01),
        (pp.Ellipsoid((-24, -6, 10), (9, 16, 12)), -0.012),
        (pp.Ellipsoid((4, -20, 22), (5, 5, 5)), 0.02),
        (pp.Ellipsoid((-6, 24, -20), (3, 3, 3)), 0.03),
    ]
    return pp.Phantom(at)


def scans() -> Iterator[tuple[str, pp.Scan]]:
    """A full orbit and a parallel beam, 200 views each, with quantum noise."""
    about = {"count": VIEWS, "axis": (0, 1, 0)}
    for name, views in (
        ("orbit", pp.orbit_views((120, 120), (2, 2), source_to_centre=500, source_to_panel=800, **about)),
        ("parallel", pp.parallel_views((110, 110), (1.4, 1.4), centre_to_panel=200, **about)),
    ):
        yield name, pp.simulate_scan(body(), views, incident=20_000, seed=NOISE_SEED)


def against_rtk() -> Iterator[str]:
    """SART of both at equal passes and relaxation, and our default, on the same scans."""
    grid = pp.Grid((SIDE,) * 3, (VOXEL,) * 3, (-(SIDE - 1) / 2 * VOXEL,) * 3)
    truth = body().volume(grid).values
    yield f"{VIEWS} views, {SIDE}³ voxels of {VOXEL} mm, 20,000 photons a pixel; ellipsoids, known in closed form. RMSE in "
    yield "1e-4 / mm over the whole grid. SART with f >= 0 from zero. RTK projects back by voxels as it comes, or by the "
    yield "transpose of its projector. It gets the parallel beam as its own parallel geometry.\n"
    if not installed("itk-rtk"):
        yield "RTK is not installed: pip install 'palpate[bench]'. Ours alone.\n"
    yield header("scan", "method", "relaxation", *(f"RMSE, {n} passes" for n in PASSES), "seconds a pass")
    for name, scan in scans():
        for relaxation in RELAXATIONS:
            yield row(name, "SART, ours", relaxation, *_ours(scan, grid, truth, relaxation))
            if installed("itk-rtk"):
                yield row(name, "SART, RTK as it comes", relaxation, *_rtk(scan, grid, truth, relaxation, False))
                yield row(name, "SART, RTK, its transpose", relaxation, *_rtk(scan, grid, truth, relaxation, True))
        began = time.perf_counter()
        found = pp.reconstruct(scan, grid)
        taken = time.perf_counter() - began
        yield row(
            name, "map, default", "", f"{_rmse(found.values, truth):.3g} at its end", "", "", f"{taken:.3g} in all"
        )


def _ours(scan: pp.Scan, grid: pp.Grid, truth: np.ndarray, relaxation: float) -> Iterator[float]:
    """RMSE after each number of passes, then seconds a pass."""
    began = time.perf_counter()
    A, data = pp.Projector(scan.views, grid), pp.Transmission.of(scan)
    run = pp.sart(A, data, np.zeros(grid.shape, np.float32), relaxation)
    for done, (values, _) in enumerate(run, 1):
        if done in PASSES:
            yield _rmse(values, truth)
        if done == PASSES[-1]:
            break
    yield (time.perf_counter() - began) / PASSES[-1]


def _rtk(scan: pp.Scan, grid: pp.Grid, truth: np.ndarray, relaxation: float, matched: bool) -> Iterator[float]:
    """The same of RTK, which begins anew from the volume of the passes before."""
    from palpate.studies.rtk_reference import rtk_sart

    values, done, began = np.zeros(grid.shape, np.float32), 0, time.perf_counter()
    for passes in PASSES:
        values, done = rtk_sart(scan, grid, passes - done, values, relaxation, matched), passes
        yield _rmse(values, truth)
    yield (time.perf_counter() - began) / PASSES[-1]


def _rmse(values: np.ndarray, truth: np.ndarray) -> float:
    return 1e4 * float(np.sqrt(np.mean((values - truth) ** 2, dtype=np.float64)))


if __name__ == "__main__":
    words = argparse.ArgumentParser(prog="python -m benchmarks.any_geometry", description=__doc__)
    words.add_argument("--first", type=int, default=1000, help="seed of the first pose")
    words.add_argument("--poses", type=int, default=1000)
    words.add_argument("--part", choices=("poses", "rtk"), help="one table alone")
    given = words.parse_args()
    parts = {"poses": lambda: random_poses(given.first, given.poses), "rtk": against_rtk}
    for part in [given.part] if given.part else parts:
        for line in parts[part]():
            print(line, flush=True)
