"""What the hull keeps of random bodies, and what it does to the reconstruction, as a Markdown table.

    python -m benchmarks.support --first 0 --last 100

Each seed draws a breast-like or chest-like body, a geometry and an exposure. Bodies are half or whole ellipsoids with a
thin fold of tissue along their edge (0.5 to 2 mm thick), dense balls, and in some a lung of a quarter of the attenuation.
Some are truncated by one or two sides of the panel, some lie under a paddle, some leave no air. Every tenth seed has 20,000
photons a pixel, the others 2,000. A voxel is the object's if its centre is. Constants were set on seeds from 1000 on.
"""

import argparse
import time
import warnings
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

import palpate as pp

WATER = 0.038  # 1/mm at 30 keV
PIXEL, VOXEL, SLICE = 1.0, 1.0, 2.0  # mm
OUTER = 2.0  # mm
KINDS = ("free", "one side", "two sides", "paddle", "no air")


@dataclass(frozen=True, eq=False)
class Body:
    """What a seed draws."""

    kind: str
    lung: bool
    phantom: pp.Phantom  # without paddle
    scan: pp.Scan
    grid: pp.Grid


def body(seed: int) -> Body:
    """The body, its scan and the grid of the reconstruction."""
    rng = np.random.default_rng(seed)
    kind, lung = KINDS[seed % len(KINDS)], bool(rng.random() < 0.4)
    rows, columns = 72, 96
    width, depth = columns * PIXEL * 0.85, rows * PIXEL * 0.85  # of the field in the object, mm
    thick = rng.uniform(24, 44)
    middle = np.array([0, depth / 2, 5 + thick / 2])
    radii = np.array([rng.uniform(0.24, 0.34) * width, rng.uniform(0.24, 0.34) * depth, thick / 2])
    if kind == "one side" and rng.random() < 0.7:  # a chest wall at y = 0, beyond which the object goes on
        middle[1], radii[1] = 0, rng.uniform(0.5, 0.75) * depth
    elif kind == "one side":  # along the sweep
        middle[0], radii[0] = width / 2, rng.uniform(0.5, 0.75) * width
    elif kind == "two sides":
        middle[:2], radii[:2] = (width / 2, 0), (rng.uniform(0.5, 0.75) * width, rng.uniform(0.5, 0.75) * depth)
    elif kind == "no air":
        radii[:2] = 3 * width, 3 * depth
    bulge = rng.choice([1.0, 2.0])
    turn = rng.uniform(0, np.pi) if kind in ("free", "paddle") else 0.0
    c, s = np.cos(turn), np.sin(turn)
    axes = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    fold = rng.uniform(0.5, 2)
    tissue = WATER * rng.uniform(0.9, 1.2)
    low = middle[2] - radii[2] * rng.uniform(0.2, 0.8)  # where the fold lies
    wide = radii + [rng.uniform(2, 6), rng.uniform(2, 6), 0]
    disc = pp.Intersection(
        [pp.Ellipsoid((*middle[:2], low), (wide[0], wide[1], 50), axes), pp.Box((0, 0, low), (1e3, 1e3, fold))]
    )
    round_, plates = pp.Ellipsoid(middle, radii * [1, 1, bulge], axes), pp.Box(middle, (1e3, 1e3, thick))
    core = pp.Intersection([round_, plates])  # bulge 1: an ellipsoid; more: pressed flat between plates
    parts = [(core, tissue), (disc, tissue), (pp.Intersection([core, disc]), -tissue)]
    if lung:
        parts.append((pp.Ellipsoid(middle, 0.75 * radii, axes), -0.75 * tissue))
    for _ in range(4):
        at = middle + axes @ (rng.uniform(-0.5, 0.5, 3) * radii)
        parts.append((pp.Ellipsoid(at, rng.uniform(2, 5)), tissue * rng.uniform(0.2, 0.6)))
    panel = pp.Panel((rows, columns), (PIXEL, PIXEL), (-(columns - 1) / 2 * PIXEL, 0.5 * PIXEL, 0))
    views = pp.arc_views(panel, np.linspace(-25, 25, 11), radius=650, pivot=(0, 0, 40))
    phantom = pp.Phantom(parts)
    seen = phantom
    if kind == "paddle":
        plate = pp.Box((0, 0, 5 + thick + rng.uniform(8, 12)), (1e3, 1e3, rng.uniform(2, 4)))
        seen = pp.Phantom([*parts, (plate, rng.uniform(0.03, 0.05))])
    photons = 20_000 if seed % 10 == 9 else 2_000
    high = 5 + thick + 7
    shape = int(high / SLICE), int(depth / VOXEL), int(width / VOXEL)
    grid = pp.Grid.centred(shape, (SLICE, VOXEL, VOXEL), y=shape[1] * VOXEL / 2, z=shape[0] * SLICE / 2)
    return Body(kind, lung, phantom, pp.simulate_scan(seen, views, photons, seed=seed), grid)


def inside(phantom: pp.Phantom, grid: pp.Grid) -> np.ndarray:
    """(z, y, x) of bool: voxels whose centre is in the body."""
    z, y, x = np.meshgrid(*(grid.axis(a) for a in "zyx"), indexing="ij")
    values = phantom.attenuation(np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1))
    return (values > 1e-6).reshape(grid.shape)


@dataclass(frozen=True)
class Result:
    """Of one seed. rmse: root mean square error over the field with the hull, over that without."""

    kind: str
    lung: bool
    kept: float
    outer: float
    cut: float  # share of the air's voxels
    rmse: float
    said: bool
    seconds: float


def measured(seed: int, reconstruct: bool = True) -> Result:
    """All that is told of a seed."""
    b = body(seed)
    truly = inside(b.phantom, b.grid)
    skin = truly & (distance_transform_edt(truly, b.grid.spacing) <= OUTER)
    began = time.perf_counter()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        hull = pp.support_hull(b.scan, b.grid).values > 0
    seconds = time.perf_counter() - began
    rmse = np.nan
    if reconstruct:
        truth = b.phantom.volume(b.grid).values
        seen = pp.Projector(b.scan.views, b.grid).T(b.scan.mask.astype(np.float32)) > 0
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            errors = [pp.reconstruct(b.scan, b.grid, support=given).values - truth for given in ("none", "hull")]
        without, with_hull = (float(np.sqrt(np.mean(e[seen] ** 2))) for e in errors)
        rmse = with_hull / without
    return Result(
        b.kind, b.lung, hull[truly].mean(), hull[skin].mean(), 1 - hull[~truly].mean() if (~truly).any() else np.nan,
        rmse, any("nothing is cut" in str(w.message) for w in said), seconds,
    )  # fmt: skip


def picture(path: str, seed: int = 1003) -> None:
    """Sections of a body under a paddle: the truth, without and with the hull."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    b = body(seed)
    hull = pp.support_hull(b.scan, b.grid).values
    volumes = {"truth": b.phantom.volume(b.grid).values}
    for name, given in (("support none", "none"), ("support hull", "hull")):
        volumes[name] = pp.reconstruct(b.scan, b.grid, support=given).values
    figure, axes = plt.subplots(2, 3, figsize=(9, 4.4), layout="constrained")
    z, y = b.grid.shape[0] // 2, b.grid.shape[1] // 2
    for k, (name, values) in enumerate(volumes.items()):
        for ax, part, line, ratio in (
            (axes[0, k], values[z], hull[z], 1),
            (axes[1, k], values[:, y], hull[:, y], SLICE),
        ):
            ax.imshow(part, cmap="gray", vmin=0, vmax=0.06, origin="lower", aspect=ratio / VOXEL)
            ax.contour(line, [0.5], colors="tab:orange", linewidths=1)
            ax.set_axis_off()
        axes[0, k].set_title(name)
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.support", description=__doc__)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--last", type=int, default=100)
    parser.add_argument("--verbose", action="store_true", help="print every seed")
    parser.add_argument("--hull-only", action="store_true", help="do not reconstruct")
    parser.add_argument("--picture", metavar="FILE", help="write sections of one body instead")
    chosen = parser.parse_args()
    if chosen.picture:
        return picture(chosen.picture)
    found = []
    for seed in range(chosen.first, chosen.last):
        found.append(measured(seed, not chosen.hull_only))
        if chosen.verbose:
            print(seed, found[-1], flush=True)
    columns = (
        "object kept %: mean, least",
        "outer 2 mm kept %",
        "air cut %",
        "RMSE with / without: mean, worst",
        "uncut",
    )
    print(f"| bodies | | {' | '.join(columns)} |\n|{'---|' * 7}")
    for kind in (*KINDS, "lung", "all with air", "all"):
        some = [r for r in found if kind in ("all", r.kind) or (kind == "lung" and r.lung)]
        if kind == "all with air":
            some = [r for r in found if r.kind != "no air"]
        if not some:
            continue
        kept, outer, cut, rmse, uncut = (
            np.array([getattr(r, n) for r in some]) for n in ("kept", "outer", "cut", "rmse", "said")
        )
        shares = [f"{100 * a.mean():.2f}, {100 * a.min():.2f}" for a in (kept, outer)]
        error = f"{np.mean(rmse):.3f}, {np.max(rmse):.3f}"
        print(
            f"| {kind} | {len(some)} | {' | '.join(shares)} | {100 * np.nanmean(cut):.0f} | {error} | {uncut.sum()} |"
        )
    print(f"\nThe hull takes {np.median([r.seconds for r in found]):.2f} s (median).")


if __name__ == "__main__":
    main()
