"""Whether `palpate mesh --within 3` gives meshes of that accuracy: python -m benchmarks.mesh_within --places 20.

A kidney of the sample CT and an ellipsoid with a lump ten times stiffer, 6 mm below its top, are meshed with edges of 8 mm
(--before) and then as `pp.adaptive_mesh` finds it for a contact radius of 16 mm and Poisson's ratio 0.45. At random places,
which had no part in that (and over the lump, where the error is largest), the force of a push along the normal is compared
with the continuum's (benchmarks/continuum_truth.py, on the same polyhedron), at ν = 0.45 and 0.49. Places nearer to the
support than a radius are left out. Prints % of the true force: mean, the share of places within 3 %, 95 %, worst, and the
ratio of the mean estimate and the mean error.
"""

import argparse
import time
from pathlib import Path

import numpy as np

import palpate as pp
from benchmarks.continuum_truth import compliance
from palpate.tissue.spring_fitting import scattered_points, surface_normals

EDGE, RADIUS, WITHIN, STIFFER = 8.0, 16.0, 0.03, 10.0
RATIOS = (0.45, 0.49)
SEED = 2026
LEVELS = {"8 mm": 3, "within 3 %": 1}  # of bisection: more change the error by less than 0.1 % of the force


def kidney() -> tuple[pp.Labels, str, dict[str, object], tuple[float, float, float]]:
    labels = pp.read_labels(Path(pp.__file__).parent / "samples" / "abdomen" / "labels.nii.gz")
    return labels, "kidney_left", {}, (0, 1, 0)


def lump() -> tuple[pp.Labels, str, dict[str, object], tuple[float, float, float]]:
    grid = pp.Grid((56, 66, 86), (1, 1, 1), (-42.5, -32.5, -27.5))
    x = grid.points(np.argwhere(np.ones(grid.shape)))
    values = (np.linalg.norm(x / (40, 30, 25), axis=1) < 1).astype(int)
    values[np.linalg.norm(x - (0, 0, 10), axis=1) < 9] = 2
    labels = pp.Labels(values.reshape(grid.shape), grid, {1: "organ", 2: "lump"})
    return labels, "organ", {"inclusions": ["lump"]}, (0, 0, -1)


def judged(tissue: pp.Tissue, places: int, levels: int) -> np.ndarray:
    """(places, 2): error against the continuum, and its estimate."""
    x = scattered_points(tissue, 20 * places, SEED)
    held = tissue.mesh.nodes[tissue.fixed]
    x = np.array([point for point in x if np.linalg.norm(held - point, axis=1).min() > RADIUS][:places])
    if len(np.unique(tissue.young)) > 1:
        x[0] = tissue.surface.closest(np.array([0.0, 0, 25])).point
    estimate = pp.force_error_map(tissue, RADIUS, x).estimate
    elements, error = pp.finite_elements(tissue), []
    for point, normal in zip(x, surface_normals(tissue, x), strict=True):
        force = elements.push(point, -normal, RADIUS).force @ normal
        C = compliance(tissue, point, RADIUS, levels, reach=1.3 if levels == 1 else 1.7)
        error.append(force / (np.linalg.solve(C, normal) @ normal) - 1)
    return np.stack([error, estimate], axis=1)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mesh_within", description=__doc__.splitlines()[0])
    parser.add_argument("solids", nargs="*", default=["kidney", "lump"])
    parser.add_argument("--places", type=int, default=20)
    parser.add_argument("--before", action="store_true", help="the meshes of 8 mm too")
    chosen = parser.parse_args()
    print("| solid | mesh | nodes | ν | places | mean, % | within 3 % | 95 % | worst | estimate/error |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for name in chosen.solids:
        labels, label, options, way = {"kidney": kidney, "lump": lump}[name]()
        stiffer = {"lump": STIFFER} if name == "lump" else {}
        began = time.perf_counter()
        made = pp.adaptive_mesh(labels, label, WITHIN, EDGE, RADIUS, rest_on=way, stiffer=stiffer, **options)
        print(f"<!-- {time.perf_counter() - began:.0f} s: {made.text()} -->", flush=True)
        meshes = {"within 3 %": made.mesh}
        if chosen.before:
            meshes["8 mm"] = pp.tetrahedralize(labels, label, EDGE, **options)
        for which, mesh in meshes.items():
            young = {int(v): 5.0 * (STIFFER if v == 2 and name == "lump" else 1.0) for v in np.unique(mesh.region)}
            for nu in RATIOS:
                tissue = pp.Tissue(mesh, young, nu, pp.resting_on(mesh, way))
                error, told = judged(tissue, chosen.places, LEVELS[which]).T
                size = 100 * np.abs(error)
                print(
                    f"| {name} | {which} | {len(mesh.nodes)} | {nu} | {len(error)} | {100 * error.mean():.1f} | "
                    f"{(size <= 3).mean():.0%} | {np.quantile(size, 0.95):.1f} | {size.max():.1f} | "
                    f"{told.mean() / error.mean():.2f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
