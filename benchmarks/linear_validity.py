"""Whether linear elasticity says where it is not valid: python -m benchmarks.linear_validity [--cases 200 --seed 1].

Pushes, pulls and strokes across at random places of the sample's kidney and of an ellipsoid with a lump, of 3 to 35 % of the
organ. The page warns where the estimate of the linearisation is beyond 10 % or not to be had, or where an element is turned
over. The truth is the same elements at finite strain, solved to 1e-4.
"""

import argparse

import numpy as np

import palpate as pp
from benchmarks.any_push import organs, volume_ratios
from palpate.errors import DataError
from palpate.tissue.spring_fitting import surface_normals

LIMIT = 0.1
KINDS = ("push", "pull", "across")


def case(
    tissue: pp.Tissue, models: dict[str, object], rng: np.random.Generator
) -> tuple[str, float, float, float, bool]:
    """Kind, depth in mm, the true and the estimated error of the linear force, and whether the page warns."""
    corners = tissue.mesh.nodes[tissue.mesh.surface]
    radius = rng.uniform(1.5, 3) * tissue.edge
    held = tissue.mesh.nodes[tissue.fixed]
    while True:
        point = rng.dirichlet([1, 1, 1]) @ corners[rng.integers(len(corners))]
        if np.linalg.norm(held - point, axis=1).min() > 2 * radius:
            break
    inwards = -surface_normals(tissue, point[None])[0]
    across = np.cross(inwards, rng.standard_normal(3))
    kind = KINDS[rng.integers(3)]
    axis = {"push": inwards, "pull": -inwards, "across": across / np.linalg.norm(across)}[kind]
    way = rng.uniform(0.03, 0.35) * float(np.ptp(tissue.mesh.nodes @ axis)) * axis
    linear = models["compliance"].push(point, way, radius)
    told = linear.estimate.linearisation
    try:
        force = models["neo-hookean"].push(point, way, radius, tolerance=1e-4).force
        apart = linear.force - force
        true = float(np.copysign(np.linalg.norm(apart) / np.linalg.norm(force), -(apart @ way)))
    except DataError:
        true = np.inf  # an instability, or elements that no solution keeps
    warns = not abs(told) <= LIMIT or volume_ratios(tissue.mesh, linear.displacement)[0] < 0
    return kind, float(np.linalg.norm(way)), true, told, warns


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.linear_validity", description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--edge", type=float, default=6.0, help="mm, of the kidney's mesh")
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    both = [(t, {name: pp.model(t, name) for name in ("compliance", "neo-hookean")}) for _, t in organs(options.edge)]
    rows = []
    for number in range(options.cases):
        rows.append(case(*both[number % 2], rng))
        print("{} {:.1f} mm: off by {:.1%}, told {:.1%}{}".format(*rows[-1][:4], ", warns" * rows[-1][4]), flush=True)
    off = np.array([abs(true) > LIMIT for _, _, true, _, _ in rows])
    warns = np.array([row[4] for row in rows])
    near = np.array([abs(true - told) for _, _, true, told, _ in rows if np.isfinite(true) and np.isfinite(told)])
    print(f"`python -m benchmarks.linear_validity --cases {options.cases} --seed {options.seed}`:\n")
    print(f"- off by more than {LIMIT:.0%}: {off.sum()} of {len(rows)}, warned of {warns[off].sum()}")
    print(f"- off by less: {(~off).sum()}, warned of {warns[~off].sum()}")
    print(f"- the estimate is off by {np.median(near):.2%} in the median, {np.quantile(near, 0.95):.2%} at 95 %")
