"""How far the force is from that of the continuum, at random places: smoothed and P1 elements.

    python -m benchmarks.continuum_force --places 30 cube kidney lump

The cube of 11³ nodes, a kidney of the sample CT, and an ellipsoid with a lump ten times stiffer, 6 mm below its top. The
truth: benchmarks/continuum_truth.py, bisected until two answers agree to 0.5 %. The patch has a radius of two edges. On the
cube it lies on one face, above the middle of the cube; elsewhere no node of the support is nearer than a radius.
Prints mean ± standard deviation and the worst, in % of the true force, along the normal and sideways.
"""

import argparse
import itertools
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import palpate as pp
from benchmarks.continuum_truth import compliances
from benchmarks.mesh_within import STIFFER, lump
from palpate.tissue.spring_fitting import scattered_points

Array = NDArray[np.float64]
RATIOS = {"cube": (0.3, 0.45, 0.49), **dict.fromkeys(("kidney 4 mm", "kidney 8 mm", "lump 4 mm"), (0.45, 0.49))}
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


def bodies(name: str) -> tuple[pp.TetMesh, pp.TetMesh, list[NDArray[np.bool_]]]:
    """A mesh, one of the same shape for the truth, and the held nodes of both."""
    if name == "cube":
        mesh, coarse = cube(10), cube(6)
        return mesh, coarse, [m.nodes[:, 2] == 0 for m in (mesh, coarse)]
    solid, edge, _ = name.split()
    if solid == "lump":
        labels, label, options, way = lump()
        mesh = pp.tetrahedralize(labels, label, float(edge), **options)
        return mesh, mesh, [pp.resting_on(mesh, way)] * 2
    labels = pp.read_labels(next(Path(pp.__file__).parent.rglob("abdomen/labels.nii.gz")))
    mesh = pp.tetrahedralize(labels, "kidney_left", float(edge))
    return mesh, mesh, [pp.resting_on(mesh, (0, 1, 0), depth=12.0)] * 2


def young(mesh: pp.TetMesh) -> dict[int, float]:
    """kPa, by region."""
    return {int(region): 5.0 * (STIFFER if region == 2 else 1.0) for region in np.unique(mesh.region)}


def converged(tissues: Sequence[pp.Tissue], point: Array, radius: float, first: int = 1) -> list[Array]:
    """(3, 3) mm/N of each tissue, by more and more bisections; first: how many to begin with."""
    before = np.array(compliances(tissues, point, radius, first))
    for levels in range(first + 2, MOST_LEVELS, 2):
        now = np.array(compliances(tissues, point, radius, levels))
        change = np.diagonal(now, axis1=1, axis2=2) / np.diagonal(before, axis1=1, axis2=2) - 1
        if np.abs(change).max() < 0.005:
            return list(now)
        before = now
    raise RuntimeError(f"no convergence at {point}")


def errors(name: str, places: int) -> Iterator[dict[tuple[float, str], Array]]:
    """At each place, by ratio and element: % along the normal and the worse of two ways along the surface."""
    mesh, coarse, (fixed, below) = bodies(name)
    made = {(nu, e): pp.Tissue(mesh, young(mesh), nu, fixed, element=e) for nu in RATIOS[name] for e in ELEMENTS}
    plain = [pp.Tissue(coarse, young(coarse), nu, below, element="P1") for nu in RATIOS[name]]
    tissue = next(iter(made.values()))
    radius = 10.0 if name == "cube" else 2 * tissue.edge  # two edges
    solvers = {key: pp.finite_elements(each) for key, each in made.items()}
    found = 0
    for point in scattered_points(tissue, 20 * places):
        normal = tissue.surface.normal(tissue.surface.closest(point))
        if name == "cube":
            if (np.abs(point - 25) > 25 - radius).sum() > 1 or point[2] < 25:
                continue  # a patch round an edge, where normals are those of the mesh; by the support, whose rim is singular
        elif np.linalg.norm(mesh.nodes[fixed] - point, axis=1).min() < radius:
            continue
        side = np.linalg.svd(normal[None])[2][1:]
        axes = np.stack([normal, *side])
        truths = [np.linalg.inv(axes @ C @ axes.T) for C in converged(plain, point, radius)]
        true = dict(zip(RATIOS[name], truths, strict=True))
        felt = {}
        for key, solver in solvers.items():
            S = axes @ np.stack([-solver.push(point, way, radius).force for way in np.eye(3)], axis=1) @ axes.T
            off = 100 * (np.diag(S) / np.diag(true[key[0]]) - 1)
            felt[key] = np.array([off[0], off[1:][np.argmax(np.abs(off[1:]))]])
        yield felt
        found += 1
        if found == places:
            return


def main() -> None:
    """Prints a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("solids", nargs="*", default=["cube"], help='cube, kidney, lump, or one of them: "kidney 8 mm"')
    parser.add_argument("--places", type=int, default=30)
    options = parser.parse_args()
    print("| solid | ν | element | places | normal, % | worst | sideways, % | worst |")
    print("|---|---|---|---|---|---|---|---|")
    for name in RATIOS:
        if not any(name.startswith(solid) for solid in options.solids):
            continue
        began = time.perf_counter()
        seen = list(errors(name, options.places))
        for poisson, element in seen[0]:
            off = np.array([one[poisson, element] for one in seen])
            cells = [f"{m:.1f} ± {s:.1f} | {w:.1f}" for m, s, w in zip(
                off.mean(axis=0), off.std(axis=0), off[np.abs(off).argmax(axis=0), [0, 1]], strict=True
            )]  # fmt: skip
            print(f"| {name} | {poisson} | {element} | {len(seen)} | {' | '.join(cells)} |", flush=True)
        print(f"<!-- {time.perf_counter() - began:.0f} s -->", flush=True)


if __name__ == "__main__":
    main()
