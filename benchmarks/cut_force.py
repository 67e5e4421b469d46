"""How far the force of a cut body is from the continuum's: smoothed and P1 elements, cut by virtual nodes.

    python -m benchmarks.cut_force

The 50 mm cube, held below, cut in the plane x = 25 mm from above to the middle, which passes through the elements of all
meshes. Patches of 10 mm radius are pushed down, and aside, away from the cut. The truth: Taylor and Hood's elements on a
mesh whose nodes in that plane are there twice, bisected under the contact (benchmarks/continuum_truth.py) until the
force changes by less than half a per cent. The same bodies without the cut stand beside.
"""

import argparse

import numpy as np

import palpate as pp
from benchmarks.continuum_force import converged, cube

PLACES = ((14.0, 25.0, 50.0), (13.0, 20.0, 50.0), (37.0, 30.0, 50.0))  # no patch reaches the cut
RADIUS, YOUNG, POISSON, DEPTH = 10.0, 5.0, 0.45, 25.0
CELLS = (5, 7, 9, 11)
FINE = (8, 12, 16, 20)
BLADE = pp.Blade.swept([(25, -5, 60), (25, 55, 60)], (0, 0, -1), 10 + DEPTH)
GAP = 1e-6  # mm: who bisects the mesh takes no two nodes at one place


def held(mesh: pp.TetMesh, element: str) -> pp.Tissue:
    """Tissue that lies on its support."""
    return pp.Tissue(mesh, YOUNG, POISSON, mesh.nodes[:, 2] == 0, element=element)


def conforming(cells: int) -> pp.TetMesh:
    """The cube with the nodes of the cut there twice; cells: even, so that it has nodes at the tip."""
    mesh = cube(cells)
    split = np.flatnonzero((mesh.nodes[:, 0] == 25) & (mesh.nodes[:, 2] > 50 - DEPTH))
    number = np.arange(len(mesh.nodes))
    number[split] = len(mesh.nodes) + np.arange(len(split))
    beyond = mesh.nodes[mesh.tets].mean(axis=1)[:, :1] > 25
    tets = np.where(beyond, number[mesh.tets], mesh.tets)
    return pp.TetMesh(np.concatenate([mesh.nodes, mesh.nodes[split] + (GAP, 0, 0)]), tets)


def stiffness(solver: object, point: np.ndarray) -> np.ndarray:
    """N/mm down and aside."""
    ways = (np.array([0, 0, -1.0]), np.array([-1.0, 0, 0]))
    return np.array([-solver.push(point, way, RADIUS).force @ way for way in ways])  # type: ignore[attr-defined]


def gap(cells: int, element: str) -> float:
    """mm³ between the lips under a tension of 1 kPa."""
    opened = pp.cut(held(cube(cells), element), BLADE)
    skin, mesh = opened.mesh.skin, opened.mesh
    moved = skin.carried(mesh.tets, pp.gape(opened, 1.0))
    lips = skin.triangles[skin.lip]
    a, b, c = mesh.places[lips].swapaxes(0, 1)
    return float(-(np.cross(b - a, c - a) / 2 * moved[lips].mean(axis=1)).sum())


def gaping(cells: list[int]) -> None:
    """Prints a table: how far the cut gapes, next to meshes with nodes in the plane of the cut and at its tip."""
    fine = [gap(n, "smoothed") for n in FINE]
    found, edges = (", ".join(texts) for texts in ([f"{v:.0f}" for v in fine], [f"{50 / n:.1f}" for n in FINE]))
    print(f"\nGap under a tension of 1 kPa, on meshes with the cut between their elements: {found} mm³ at {edges} mm.")
    print("Through elements, % of the last:\n")
    print("| edge, mm | smoothed | P1 |\n|---|---|---|")
    for n in cells:
        off = (100 * (gap(n, element) / fine[-1] - 1) for element in ("smoothed", "P1"))
        print(f"| {50 / n:.1f} | {' | '.join(f'{x:.1f}' for x in off)} |", flush=True)


def main() -> None:
    """Prints a table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.cut_force", description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="*", default=list(CELLS), help="of the meshes that are judged, odd")
    parser.add_argument("--truth", type=int, default=8, help="cells of the mesh for the truth, even")
    options = parser.parse_args()
    true = {}
    for name, mesh in (("cut", conforming(options.truth)), ("whole", cube(options.truth))):
        tissue = held(mesh, "P1")
        true[name] = np.array(
            [np.diag(np.linalg.inv(converged([tissue], np.array(p), RADIUS, first=3)[0]))[[2, 0]] for p in PLACES]
        )
    print("`python -m benchmarks.cut_force`: error of the force, % (mean and worst of the places)\n")
    print("| edge, mm | element | cut, down | cut, aside | whole, down | whole, aside |")
    print("|---|---|---|---|---|---|")
    for cells in options.cells:
        for element in ("smoothed", "P1"):
            whole = held(cube(cells), element)
            row = []
            for name, tissue in (("cut", pp.cut(whole, BLADE)), ("whole", whole)):
                solver = pp.finite_elements(tissue)
                felt = np.array([stiffness(solver, np.array(point)) for point in PLACES])
                off = 100 * (felt / true[name] - 1)
                row += [f"{off[:, k].mean():.1f} ({off[np.abs(off[:, k]).argmax(), k]:.1f})" for k in range(2)]
            print(f"| {50 / cells:.1f} | {element} | {' | '.join(row)} |", flush=True)
    ratio = true["cut"] / true["whole"]
    print(f"\nThe cut takes away {100 * (1 - ratio.max()):.0f} to {100 * (1 - ratio.min()):.0f} % of the true force.")
    gaping(options.cells)


if __name__ == "__main__":
    main()
