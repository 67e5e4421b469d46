"""How wide a small sphere becomes under a prior of a stated resolution: `python -m benchmarks.prior_resolution` (minutes).

Small spheres in a slab, at random voxels of the middle slice, scanned without noise by exact line integrals. Two
reconstructions, with and without the spheres, run until the objective falls no more. Their difference is the image of the
spheres. Its full width at half maximum is the mean over the spheres, along the wider axis of the slice, with the standard
error of that mean: single spheres differ, because their shadows fall differently between pixels. Voxels are 0.4 mm; over the
voxels that are drawn from, the shadow moves by one or two whole pixels against them where pixels are 0.4 mm too.
*By dose* is the largest change of a single sphere's width at a hundredth of the dose. CPU seconds are those of the choice.
The constants of `local_response.py` were chosen with other places (seed 5; these are of seed 11).
"""

import argparse
import time
import warnings

import numpy as np
from scipy.interpolate import CubicSpline

import palpate as pp
from palpate.arrays import Float64
from palpate.reconstruction.local_response import strength_for_resolution

VOXEL, SIDE, SEED = 0.4, 65, 11
LOW, HIGH = 1_000, 100_000  # photons


def geometries() -> dict[str, tuple[pp.Views, pp.Grid]]:
    """Name, views and grid."""
    thick, thin = (pp.Grid.centred((nz, SIDE, SIDE), (dz, VOXEL, VOXEL), z=21) for nz, dz in ((12, 2), (20, 1)))
    turned = np.linspace(-15, 15, 9)
    return {
        "arc ±20°, 13 views, pixels 0.4 mm": (
            pp.arc_views(panel(0.4, 29, 45), np.linspace(-20, 20, 13), radius=600),
            thick,
        ),
        "the same, pixels 0.2 mm": (pp.arc_views(panel(0.2, 29, 45), np.linspace(-20, 20, 13), radius=600), thick),
        "circle, 9 views, pixels 0.4 mm": (
            pp.circular_views(panel(0.4, 60, 60), radius=200, height=500, count=9),
            thick,
        ),
        "the same, pixels 0.25 mm, slices 1 mm": (
            pp.circular_views(panel(0.25, 60, 60), radius=200, height=500, count=9),
            thin,
        ),
        "C-arm ±15°, 9 views, pixels 0.4 mm": (
            pp.rotating_views(panel(0.4, 29, 45), turned, source=(0, 0, 600), pivot=(0, 0, 20)),
            thick,
        ),
    }


def panel(pitch: float, height: float, width: float) -> pp.Panel:
    """About (0, 0, 0), mm."""
    rows, columns = (round(n / pitch) | 1 for n in (height, width))
    return pp.Panel((rows, columns), (pitch, pitch), (-(columns - 1) / 2 * pitch, -(rows - 1) / 2 * pitch, 0))


def measured(views: pp.Views, grid: pp.Grid, resolution: float, incident: float, times: int) -> tuple[float, Float64]:
    """Strength that was chosen; widths of the spheres along (y, x), (spheres, 2), mm. times: how often spheres are drawn."""
    rng = np.random.default_rng(SEED)
    z, middle = grid.shape[0] // 2, SIDE // 2
    slab = (pp.Box((0, 0, 21), tuple(0.95 * np.ptp(grid.bounds, axis=0))), 0.02)

    def image(spheres: list[tuple[pp.Ellipsoid, float]]) -> pp.Step:
        scan = pp.simulate_scan(pp.Phantom([slab, *spheres]), views, incident=incident, seed=None, subrays=8)
        return list(pp.iterates(scan, grid, resolution=resolution, levels=1, iterations=500, tolerance=0))[-1]

    without = image([])
    wide = resolution > 2 * VOXEL  # these are measured one by one, nearer to the middle, at a higher contrast
    widths = []
    for _ in range(2 * times if wide else times):
        places = spread(rng, 1 if wide else 6, 13 if wide else 26) + middle
        spheres = [(pp.Ellipsoid(grid.points((z, *at))[0], VOXEL / 5), 6.0 if wide else 3.0) for at in places]
        added = image(spheres).volume.values[z].astype(float) - without.volume.values[z]
        widths += [(width(added[:, x], y), width(added[y], x)) for y, x in places]
    assert without.prior is not None
    return float(without.prior.strength or 0), VOXEL * np.array(widths)


def spread(rng: np.random.Generator, count: int, half: int) -> np.ndarray:
    """(y, x) of voxels about 0, 15 apart at least."""
    chosen: list[np.ndarray] = []
    while len(chosen) < count:
        at = rng.integers(-half, half + 1, 2)
        if all(np.hypot(*(at - other)) >= 15 for other in chosen):
            chosen.append(at)
    return np.array(chosen)


def width(line: Float64, at: int) -> float:
    """Full width at half maximum about a sample, in samples, on a cubic spline."""
    roots = CubicSpline(np.arange(len(line)), line - line[at] / 2).roots(extrapolate=False)
    return float(roots[roots > at].min() - roots[roots < at].max())


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.prior_resolution", description=__doc__)
    parser.add_argument("--widths", type=float, nargs="+", default=[0.5, 0.6, 0.8, 1.2])
    wanted = parser.parse_args().widths
    warnings.simplefilter("ignore")
    print(
        f"| geometry | asked, mm | strength, 1/mm, at {LOW:,} and {HIGH:,} photons | width, mm | off | by dose | CPU s |"
    )
    print("|---|---|---|---|---|---|---|")
    for resolution in wanted:
        for name, (views, grid) in geometries().items():
            began = time.process_time()
            strength_for_resolution(pp.Prior("quadratic"), views, grid, resolution)
            spent = time.process_time() - began
            strength, widths = measured(views, grid, resolution, HIGH, 5)
            lower, few = measured(views, grid, resolution, LOW, 1)
            along = int(np.argmax(widths.mean(axis=0)))
            mean, error = widths[:, along].mean(), widths[:, along].std(ddof=1) / np.sqrt(len(widths))
            by_dose = float(np.abs(few / widths[: len(few)] - 1).max())
            print(
                f"| {name} | {resolution} | {lower:.4g}, {strength:.4g} | {mean:.3f} ± {error:.3f} | "
                f"{mean / resolution - 1:+.1%} | {by_dose:.1%} | {spent:.1f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
