"""How close the estimated error of the force is to the true one: python -m benchmarks.force_estimate --cases 200 --seed 1.

Each case draws an organ (cube, kidney of the sample CT, ellipsoid with a lump), its edge length, Poisson's ratio, the
stiffness of a region, a place, a radius of 1.5 to 3 edges, and a direction (along the normal or across it). The true error
is that against quadratic elements on a mesh that is bisected under the contact (benchmarks/continuum_truth.py). An estimate
is right if it is off by 1 % of the force at most, or by half of the true error.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

import palpate as pp
from benchmarks.continuum_truth import compliance

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from support.brick_meshes import brick
from support.example_organs import ellipsoid

LEVELS = 3  # of bisection
RATIOS = (0.3, 0.4, 0.45, 0.47, 0.49)


def cube(rng: np.random.Generator) -> pp.Tissue:
    """50 mm, a slab at a quarter of its height of another stiffness."""
    mesh = brick((int(rng.integers(5, 12)),) * 3, warp=float(rng.uniform(0, 0.25)), region=lambda x: 1 + (x[:, 2] > 37))
    young = {1: 5.0, 2: 5.0 * float(rng.choice([1, 1, 2, 5, 10]))}
    return pp.Tissue(mesh, young, float(rng.choice(RATIOS)), mesh.nodes[:, 2] == 0)


def kidney(rng: np.random.Generator) -> pp.Tissue:
    """The left kidney of the sample CT."""
    labels = pp.read_labels(Path(pp.__file__).parent / "samples" / "abdomen" / "labels.nii.gz")
    mesh = pp.tetrahedralize(labels, "kidney_left", edge=float(rng.uniform(5, 10)))
    return pp.Tissue(mesh, 15.0, float(rng.choice(RATIOS)), pp.resting_on(mesh, (0, 1, 0)))


def lump(rng: np.random.Generator) -> pp.Tissue:
    """An ellipsoid of 8 x 6 x 5 cm with a stiff ball near its top."""
    mesh = ellipsoid(int(rng.integers(8, 14)))
    young = {"organ": 5.0, "lump": 5.0 * float(rng.uniform(1, 10))}
    return pp.Tissue(mesh, young, float(rng.choice(RATIOS)), pp.resting_on(mesh, (0, 0, -1), depth=8.0))


def contact(tissue: pp.Tissue, rng: np.random.Generator) -> tuple[np.ndarray, float, np.ndarray]:
    """A place two radii away from what is held, its radius, and a displacement of 1 mm."""
    mesh = tissue.mesh
    corners = mesh.nodes[mesh.surface]
    middle = corners.mean(axis=1)
    held = mesh.nodes[tissue.fixed]
    while True:
        t, radius = int(rng.integers(len(middle))), float(rng.uniform(1.5, 3)) * tissue.edge
        if np.linalg.norm(held - middle[t], axis=1).min() > 2 * radius:
            break
    point = rng.dirichlet([1, 1, 1]) @ corners[t]
    normal = np.cross(corners[t, 1] - corners[t, 0], corners[t, 2] - corners[t, 0])
    normal /= np.linalg.norm(normal)
    across = np.cross(normal, rng.standard_normal(3))
    return point, radius, -normal if rng.random() < 0.5 else across / np.linalg.norm(across)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.force_estimate", description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    rows = []
    print("| organ | ν | edge, mm | radius, mm | true error | estimate |\n| --- | --- | --- | --- | --- | --- |")
    for case in range(chosen.cases):
        rng = np.random.default_rng([chosen.seed, case])
        make = (cube, kidney, lump)[case % 3]
        tissue = make(rng)
        point, radius, push = contact(tissue, rng)
        answer = pp.model(tissue, "compliance").push(point, push, radius)
        C = compliance(tissue, point, radius, levels=LEVELS)
        true = float(answer.force @ push / -(np.linalg.solve(C, push) @ push)) - 1
        rows.append((true, answer.estimate.mesh))
        named = f"{make.__name__} | {tissue.poisson[0]:g} | {tissue.edge:.1f} | {radius:.1f}"
        print(f"| {named} | {true:+.2%} | {answer.estimate.mesh:+.2%} |", flush=True)
    true, told = np.array(rows).T
    right = np.abs(told - true) <= np.maximum(0.01, np.abs(true) / 2)
    large = np.abs(true) > 0.02
    print(f"\nright: {right.sum()} of {len(right)} ({right.mean():.0%})")
    print(f"correlation where the true error is more than 2 %: {np.corrcoef(true[large], told[large])[0, 1]:.2f}")


if __name__ == "__main__":
    main()
