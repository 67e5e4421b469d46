"""Pushes, pulls and strokes across of 30 % of an organ at finite strain: python -m benchmarks.any_push [--places 5].

Each goes from rest at 50 mm/s along the surface's normal, against it, or across it, over 30 % of the organ's extent that
way, and is held until it has settled. The settled force and volume are compared with Newton's method on the same elements
and law (`pp.finite_strain`, other code, to rounding), and the least volume ratio of an element on the way is told.
"""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import palpate as pp
from palpate.errors import DataError
from palpate.studies.deformation.kidney import kidney as sample_kidney
from palpate.tissue.spring_fitting import scattered_points, surface_normals

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from support.example_organs import ellipsoid

SPEED, RATE, SHARE, HELD = 50.0, 1000, 0.3, 600  # mm/s, ticks a second, of the extent, ticks
LOOKS = 20  # ticks between two looks at the elements


def organs(edge: float) -> Iterator[tuple[str, pp.Tissue]]:
    """The sample's left kidney, and an ellipsoid with a stiff lump, held like a breast on its back."""
    p1 = sample_kidney(edge)
    yield "kidney", pp.Tissue(p1.mesh, p1.young, p1.poisson, p1.fixed)
    mesh = ellipsoid(13)
    yield "lump", pp.Tissue(mesh, {"organ": 3.0, "lump": 15.0}, 0.45, pp.resting_on(mesh, (0, 0, -1), depth=8.0))


def volume_ratios(mesh: pp.TetMesh, u: np.ndarray) -> tuple[float, float]:
    """The least of an element, and that of the whole."""
    before, after = (np.linalg.det(x[:, 1:] - x[:, :1]) for x in (mesh.nodes[mesh.tets], (mesh.nodes + u)[mesh.tets]))
    return float((after / before).min()), float(after.sum() / before.sum())


def settled(model: object, tissue: pp.Tissue, point: np.ndarray, way: np.ndarray, radius: float) -> tuple:
    """Force (3,) N on the tool when it has settled, its displacement, all nodes', and the least volume ratio on the way."""
    session = pp.Session(model, radius=radius)
    steps = int(np.linalg.norm(way) / SPEED * RATE)
    ticks = [*np.linspace(0, 1, steps), *np.ones(HELD)]
    least = np.inf
    for first in range(0, len(ticks), LOOKS):
        session.step([pp.Command(True, tuple(point), tuple(t * way)) for t in ticks[first : first + LOOKS]])
        least = min(least, volume_ratios(tissue.mesh, session.displacement)[0])
    frame = session.frame()
    return np.array(frame.model_force[0]), np.array(frame.displacement[0]), session.displacement, least


def lines(edge: float, places: int) -> Iterator[str]:
    """One row a stroke."""
    yield "| organ, nodes | stroke | mm | force, N | least J | volume | force off | Newton's least J | its volume |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for name, tissue in organs(edge):
        model, radius = pp.model(tissue, "neo-hookean"), 2 * tissue.edge
        truth = pp.finite_strain(tissue)
        for point in scattered_points(tissue, places):
            inwards = -surface_normals(tissue, point[None])[0]
            across = np.cross(inwards, np.eye(3)[np.argmin(np.abs(inwards))])
            across /= np.linalg.norm(across)
            for kind, axis in (("push", inwards), ("pull", -inwards), ("across", across)):
                way = SHARE * float(np.ptp(tissue.mesh.nodes @ axis)) * axis
                force, d, u, least = settled(model, tissue, point, way, radius)
                row = f"| {name}, {len(u)} | {kind} | {np.linalg.norm(way):.1f} | {np.linalg.norm(force):.3f} "
                row += f"| {least:.3f} | {volume_ratios(tissue.mesh, u)[1]:.4f} "
                try:
                    exact = truth.push(point, d, radius)
                except DataError as problem:
                    yield f"{row}| none: {str(problem).split(': ')[1].split(',')[0]} | | |"
                    continue
                off = np.linalg.norm(force - exact.force) / np.linalg.norm(exact.force)
                its = volume_ratios(tissue.mesh, exact.displacement)
                yield f"{row}| {100 * off:.2f} % | {its[0]:.3f} | {its[1]:.4f} |"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.any_push", description=__doc__.splitlines()[0])
    parser.add_argument("--edge", type=float, default=6.0, help="mm, of the kidney's mesh")
    parser.add_argument("--places", type=int, default=5, help="on each organ")
    options = parser.parse_args()
    for line in lines(options.edge, options.places):
        print(line, flush=True)
