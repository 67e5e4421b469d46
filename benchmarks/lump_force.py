"""What a stiff lump adds to the force of a push, against the continuum: python -m benchmarks.lump_force [--cases 12].

An ellipsoid of 8 x 6 x 5 cm with a ball near its top, 2 to 10 times as stiff, pushed at random places above it, with the ball
and without, on one mesh. What the ball adds should be right to 5 % of itself, or to 0.5 % of the force: as the model
has it, and with the mesh's estimated error taken out (`Answer.corrected_force`).
"""

import argparse

import numpy as np

import palpate as pp
from benchmarks.continuum_truth import compliance
from benchmarks.force_estimate import ellipsoid
from palpate.tissue.spring_fitting import surface_normals

LEVELS = 3  # of bisection
YOUNG = 5.0  # kPa


def pushed(mesh: pp.TetMesh, young: float, poisson: float, point: np.ndarray, radius: float) -> np.ndarray:
    """Force for 1 mm along the normal, N: of the model, corrected, and of the continuum."""
    tissue = pp.Tissue(mesh, {"organ": YOUNG, "lump": young}, poisson, pp.resting_on(mesh, (0, 0, -1), depth=8.0))
    push = -surface_normals(tissue, point[None])[0]
    answer = pp.model(tissue, "compliance").push(point, push, radius)
    truth = np.linalg.solve(compliance(tissue, point, radius, LEVELS), push)
    return np.array([-answer.force @ push, -answer.corrected_force @ push, truth @ push])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.lump_force", description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=12)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng, met = np.random.default_rng(options.seed), []
    print(f"`python -m benchmarks.lump_force --cases {options.cases} --seed {options.seed}`:\n")
    print(
        "| nodes | ν | times as stiff | radius, mm | the force, N | it adds, N | off, % of itself | % of the force "
        "| corrected: off, % of itself | % of the force |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for _ in range(options.cases):
        mesh = ellipsoid(int(rng.integers(9, 14)))
        edge = pp.Tissue(mesh, YOUNG, 0.45, pp.resting_on(mesh, (0, 0, -1), depth=8.0)).edge
        poisson, ratio = float(rng.choice([0.3, 0.45, 0.49])), float(rng.uniform(2, 10))
        middle = mesh.nodes[np.unique(mesh.tets[mesh.region == max(mesh.names)])].mean(axis=0)
        surface = mesh.nodes[mesh.surface_nodes]
        near = np.argsort(np.linalg.norm(surface - middle, axis=1))[:10]
        point, radius = surface[rng.choice(near)], float(rng.uniform(1.5, 3)) * edge
        forces = np.array([pushed(mesh, young, poisson, point, radius) for young in (ratio * YOUNG, YOUNG)])
        *added, truly = forces[0] - forces[1]
        share, part = np.abs(np.array(added) / truly - 1), np.abs(np.array(added) - truly) / forces[0, 2]
        met.append((share <= 0.05) | (part <= 0.005))
        off = " | ".join(f"{100 * s:.1f} | {100 * p:.2f}" for s, p in zip(share, part, strict=True))
        print(
            f"| {len(mesh.nodes)} | {poisson:g} | {ratio:.1f} | {radius:.1f} | {forces[0, 2]:.3f} | {truly:.4f} | {off} |",
            flush=True,
        )
    plain, corrected = np.sum(met, axis=0)
    print(f"\nRight: {plain} of {len(met)}, corrected {corrected}.")
