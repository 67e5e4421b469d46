"""How far the force is from that of the continuum, at random places: smoothed and P1 elements.

    python -m benchmarks.continuum_force --places 30 cube kidney

The truth: benchmarks/continuum_truth.py, bisected until two answers agree to 0.5 %. The patch has a radius of two edges
and, on the cube, lies on one face, above the middle of the cube.
Prints mean ± standard deviation and the worst, in % of the true force, along the normal and sideways.
"""

import argparse
import itertools
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import palpate as pp
from benchmarks.continuum_truth import compliance
from palpate.tissue.spring_fitting import scattered_points

Array = NDArray[np.float64]
RATIOS = {"cube": (0.3, 0.45, 0.49), "kidney 4 mm": (0.45, 0.49), "kidney 8 mm": (0.45, 0.49)}
ELEMENTS = ("smoothed", "P1")
MOST_LEVELS = 9  # three of them halve the edges


def cube(cells: int) -> pp.TetMesh:
    """50 mm, six tets a cell."""
    counts = (cells + 1,) * 3
    corner = np.stack(np.meshgrid(*[np.arange(cells)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    tets = []
    for path in itertools.permutations(range(3)):
        walk = np.concatenate([np.zeros((1, 3), int), np.cumsum(np.eye(3, dtype=int)[list(path)], axis=0)])
        odd = np.linalg.det(np.eye(3)[list(path)]) < 0
        index = [np.ravel_multi_index((corner + step).T, counts) for step in walk]
        tets.append(np.stack([index[k] for k in ((0, 2, 1, 3) if odd else (0, 1, 2, 3))], axis=1))
    nodes = np.stack(np.meshgrid(*[np.linspace(0, 50, cells + 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return pp.TetMesh(nodes, np.concatenate(tets))


def tissues(name: str, poisson: float) -> tuple[dict[str, pp.Tissue], pp.Tissue]:
    """By element, and one of the same shape for the truth."""
    if name == "cube":
        mesh, coarse = cube(10), cube(6)
        fixed = [m.nodes[:, 2] == 0 for m in (mesh, coarse)]
    else:
        labels = pp.read_labels(next(Path(pp.__file__).parent.rglob("abdomen/labels.nii.gz")))
        mesh = coarse = pp.tetrahedralize(labels, "kidney_left", edge=float(name.split()[1]))
        fixed = [pp.resting_on(mesh, (0, 1, 0), depth=12.0)] * 2
    made = {e: pp.Tissue(mesh, 5.0, poisson, fixed[0], element=e) for e in ELEMENTS}
    return made, pp.Tissue(coarse, 5.0, poisson, fixed[1], element="P1")


def converged(tissue: pp.Tissue, point: Array, radius: float) -> Array:
    """(3, 3) mm/N, by more and more bisections."""
    before = compliance(tissue, point, radius, 3)
    for levels in range(5, MOST_LEVELS, 2):
        now = compliance(tissue, point, radius, levels)
        if np.abs(np.diag(now) / np.diag(before) - 1).max() < 0.005:
            return now
        before = now
    raise RuntimeError(f"no convergence at {point}")


def errors(name: str, poisson: float, places: int) -> Iterator[dict[str, Array]]:
    """At each place, by element: % along the normal and the worse of two ways along the surface."""
    made, plain = tissues(name, poisson)
    tissue = made["smoothed"]
    radius = 10.0 if name == "cube" else 2 * tissue.edge  # two edges
    solvers = {element: pp.finite_elements(each) for element, each in made.items()}
    found = 0
    for point in scattered_points(tissue, 20 * places):
        normal = tissue.surface.normal(tissue.surface.closest(point))
        if name == "cube" and ((np.abs(point - 25) > 25 - radius).sum() > 1 or point[2] < 25):
            continue  # a patch round an edge, where normals are those of the mesh; by the support, whose rim is singular
        side = np.linalg.svd(normal[None])[2][1:]
        axes = np.stack([normal, *side])
        true = np.linalg.inv(axes @ converged(plain, point, radius) @ axes.T)
        felt = {}
        for element, solver in solvers.items():
            S = axes @ np.stack([-solver.push(point, way, radius).force for way in np.eye(3)], axis=1) @ axes.T
            off = 100 * (np.diag(S) / np.diag(true) - 1)
            felt[element] = np.array([off[0], off[1:][np.argmax(np.abs(off[1:]))]])
        yield felt
        found += 1
        if found == places:
            return


def main() -> None:
    """Prints a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("solids", nargs="*", default=["cube"], help='cube, kidney, or one of them: "kidney 8 mm"')
    parser.add_argument("--places", type=int, default=30)
    options = parser.parse_args()
    print("| solid | ν | element | places | normal, % | worst | sideways, % | worst |")
    print("|---|---|---|---|---|---|---|---|")
    for name, ratios in RATIOS.items():
        if not any(name.startswith(solid) for solid in options.solids):
            continue
        for poisson in ratios:
            began = time.perf_counter()
            seen = list(errors(name, poisson, options.places))
            for element in ELEMENTS:
                off = np.array([one[element] for one in seen])
                cells = [f"{m:.1f} ± {s:.1f} | {w:.1f}" for m, s, w in zip(
                    off.mean(axis=0), off.std(axis=0), off[np.abs(off).argmax(axis=0), [0, 1]], strict=True
                )]  # fmt: skip
                print(f"| {name} | {poisson} | {element} | {len(seen)} | {' | '.join(cells)} |", flush=True)
            print(f"<!-- {time.perf_counter() - began:.0f} s -->", flush=True)


if __name__ == "__main__":
    main()
