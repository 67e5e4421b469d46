"""The force of a wall against that of the continuum, by the edge and the layers: python -m benchmarks.hollow_wall

A bent tube with a wall of 3 mm, held at both ends, pressed outwards from inside at random places. The continuum's force
is that of Taylor-Hood elements on the same polyhedron, bisected under the contact (`benchmarks.continuum_truth`).
"""

from pathlib import Path

import numpy as np

import palpate as pp
from benchmarks.continuum_truth import compliance

LUMEN, BEND, WALL = 6.0, 22.0, 3.0  # mm
RADIUS, DEPTH = 4.0, 0.5  # mm, of the contact
PLACES = 4
CASES = ((1.0, 1), (1.0, 2), (0.5, 2), (0.5, 3))  # edge over the thickness, layers
POISSON = (0.3, 0.45)


def labels() -> tuple[pp.Labels, np.ndarray]:
    """A quarter of a torus' lumen, and the torus' centre."""
    side, across = round(BEND + LUMEN + 6), round(2 * LUMEN + 14)
    grid = pp.Grid((side, side, across), (1.0, 1.0, 1.0))
    center = np.array([grid.bounds.mean(axis=0)[0], *grid.bounds[0][1:]])
    x = grid.points(np.stack(np.indices(grid.shape), axis=-1).reshape(-1, 3)) - center
    inside = np.hypot(np.hypot(x[:, 1], x[:, 2]) - BEND, x[:, 0]) < LUMEN
    return pp.Labels(inside.reshape(grid.shape).astype(np.uint8), grid, {1: "lumen"}), center


def places(center: np.ndarray) -> np.ndarray:
    """Random points of the lumen's wall, away from the ends."""
    rng = np.random.default_rng(3)
    along, around = rng.uniform(0.25, 0.75, PLACES) * np.pi / 2, rng.uniform(0, 2 * np.pi, PLACES)
    out = BEND + LUMEN * np.cos(around)
    return center + np.stack([LUMEN * np.sin(around), out * np.cos(along), out * np.sin(along)], axis=1)


def main() -> None:
    """Prints the figures and writes them into the documentation."""
    lumen, center = labels()
    lines = [
        f"`python -m benchmarks.hollow_wall`: a bent tube, lumen of {LUMEN:g} mm radius, wall of {WALL:g} mm, a contact of "
        f"{RADIUS:g} mm, {PLACES} places",
        "",
        "| edge / thickness | layers | nodes | ν | force too high by, mean | worst |",
        "|---|---|---|---|---|---|",
    ]
    for share, layers in CASES:
        mesh = pp.hollow_mesh(lumen, 1, WALL, share * WALL, layers=layers)
        assert mesh.centerline is not None
        ends = [np.abs((mesh.nodes - one[:3]) @ one[3:]) < 1e-6 for one in mesh.centerline.openings]
        for poisson in POISSON:
            tissue = pp.Tissue(mesh, young=100, poisson=poisson, fixed=np.any(ends, axis=0))
            model = pp.model(tissue, "compliance")
            off = []
            for place in places(center):
                hit = tissue.surface.closest(place)
                moved = -DEPTH * tissue.surface.normal(hit)
                force = model.push(np.array(hit.point), moved, RADIUS, tolerance=1e-6).force
                true = np.linalg.solve(compliance(tissue, place, RADIUS, levels=2), moved)
                off.append(np.linalg.norm(force) / np.linalg.norm(true) - 1)
            lines.append(
                f"| {share:g} | {layers} | {len(mesh.nodes):,} | {poisson:g} "
                f"| {np.mean(off):.1%} | {np.max(np.abs(off)):.1%} |"
            )
            print(lines[-1], flush=True)
    file = Path(__file__).parents[1] / "docs" / "figures" / "hollow-wall.md"
    file.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
