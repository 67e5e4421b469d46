"""Small scans of a ball, each a little different, for tests of archives."""

from pathlib import Path

import numpy as np

import palpate as pp

THICKNESS = 20.0  # mm


def small_scan(seed: int, side: int = 24) -> pp.Scan:
    """Seven views of a ball, with noise, on a panel of so many pixels of 2 mm."""
    rng = np.random.default_rng(seed)
    half = side - 1.0
    panel = pp.Panel(shape=(side, side), pitch=(2, 2), origin=(-half, -half, 0))
    views = pp.arc_views(panel, np.linspace(-15, 15, 7), radius=400, pivot=(0, 0, 10))
    grid = pp.covering_grid(views, THICKNESS, 2.0)
    z, y, x = np.indices(grid.shape)
    middle = [(n - 1) / 2 for n in grid.shape]
    ball = (z - middle[0]) ** 2 + (y - middle[1]) ** 2 + (x - middle[2]) ** 2 < (3 + seed % 3) ** 2
    volume = pp.Volume(np.where(ball, 0.05, 0).astype(np.float32), grid)
    lines = pp.Projector(views, grid)(volume.values)
    counts = rng.poisson(2e4 * np.exp(-lines)).astype(np.float32)
    return pp.Scan(counts, 2e4, views)


def small_archive(folder: Path, count: int, side: int = 24) -> Path:
    """A folder with so many scans."""
    folder.mkdir(parents=True, exist_ok=True)
    for seed in range(count):
        pp.write_scan(folder / f"scan-{seed:03d}.h5", small_scan(seed, side))
    return folder


def left_over(folder: Path) -> set[str]:
    """Files that nobody asked for."""
    asked = ("*.nii.gz", "*.nii.gz.run.json", "results.*")
    return {path.name for path in folder.iterdir()} - {path.name for pattern in asked for path in folder.glob(pattern)}
