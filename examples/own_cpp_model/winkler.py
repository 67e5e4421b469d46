"""A tissue model of your own in C++: Winkler's elastic foundation.

Build it first, then put the folder of the built module on the path of Python:

    cmake -S examples/own_cpp_model -B build/own && cmake --build build/own
    PYTHONPATH=build/own python examples/own_cpp_model/winkler.py
"""

import time
from itertools import permutations, product

import numpy as np
import winkler_core

import palpate as pp
from palpate.tissue.models.tissue_model import TissueModel


class Winkler(TissueModel):
    """Springs under the surface, of `modulus` N/mm each mm². A contact displaces only the nodes under it."""

    def __init__(self, tissue: pp.Tissue, modulus: float = 0.01) -> None:
        compliance = np.zeros(len(tissue.mesh.nodes))
        surface = tissue.surface
        compliance[surface.nodes] = 1 / (modulus * surface.areas)
        compliance[tissue.held] = 0
        super().__init__(tissue, winkler_core.Winkler(compliance), {"modulus": modulus})

    def solve(self, found, state, tolerance, most_sweeps):
        """One tick is the exact solution."""
        force, _ = self.native.relax_all(state, found.patches, len(found.patches), found.displacement, 1)
        return force, 0.0, 1


def block(n: int = 40, edge: float = 1.5) -> pp.Tissue:
    """A flat block of n x n x 2 cubes with `edge` mm, its bottom fixed."""
    index = np.arange(3 * (n + 1) ** 2).reshape(n + 1, n + 1, 3)
    corner = {c: index[c[0] : n + c[0], c[1] : n + c[1], c[2] : 2 + c[2]].ravel() for c in product((0, 1), repeat=3)}
    tets = []
    for order in permutations(range(3)):  # Kuhn's six tetrahedra of a cube, from corner to opposite corner
        axes = np.eye(3, dtype=int)[list(order)]
        one = np.stack([corner[tuple(c)] for c in np.vstack([np.zeros(3, int), axes.cumsum(axis=0)])], axis=1)
        tets.append(one if np.linalg.det(axes) > 0 else one[:, [0, 2, 1, 3]])
    nodes = edge * np.stack(np.unravel_index(np.arange(index.size), index.shape), axis=1).astype(float)
    return pp.Tissue(pp.TetMesh(nodes, np.concatenate(tets)), 5.0, 0.45, nodes[:, 2] == 0)


def main() -> tuple[float, float]:
    """Press a finger 2 mm into a block: the force of the 1 kHz loop in N, and that of the continuum."""
    modulus, radius, depth = 0.01, 12.0, 2.0
    tissue = block()
    session = pp.Session(Winkler(tissue, modulus), radius=radius)
    top = tuple(tissue.mesh.nodes.max(axis=0) * (0.5, 0.5, 1))
    forces = session.step([pp.Command(True, top, (0, 0, -depth))] * 200)
    exact = 5 * np.pi / 9 * modulus * radius**2 * depth  # of the contact's weights (1 - r²/R²)²
    print(f"{forces[-1, 2]:.4f} N by the loop, {exact:.4f} N exact")
    pointer = pp.Pointer()
    with session:
        session.start(pointer)
        pointer.send(pp.Command(True, top, (0, 0, -depth)))
        time.sleep(1)
    frame = session.frame()
    print(f"{frame.tick} ticks, {frame.late} late, {1e6 * frame.busy:.0f} µs of work each")
    return float(forces[-1, 2]), exact


if __name__ == "__main__":
    main()
