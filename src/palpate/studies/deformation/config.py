"""What is pushed, where and how far: the full study, and a small one for tests."""

import itertools
from dataclasses import dataclass

import numpy as np

from palpate.arrays import Float64
from palpate.meshes.tet_mesh import TetMesh
from palpate.tissue.tissue import Tissue

SIDE = 50.0  # mm, of the cube
YOUNG = 5.0  # kPa; displacements do not depend on it, forces are proportional to it
DEPTH = 5.0  # mm, the push that linear models are computed for; others follow in proportion
DEPTHS = (5.0, 10.0, 15.0)  # mm: 10, 20, 30 % of the cube
RATIOS = (0.10, 0.20, 0.30, 0.40, 0.49)
MARKS = (-0.10, -0.14, -0.18)  # the dissertation's RSC0
TOP = (25.0, 25.0, SIDE)
CONTACTS = ("triangle", "patch")
READ_CONTACTS = ("node", *CONTACTS)
SUPPORTS = ("bottom", "sides", "all but top")


@dataclass(frozen=True)
class Setting:
    """quick: the small one. main: nodes along a side of the cube on which the laws are judged; fine: of the finer
    one. sizes: of the cubes whose convergence is watched. ladder: of those on which all models are timed. radius:
    mm of the smooth patch. steps: of RSC0 in a sweep; rest_steps: for springs with rest length. ripple: nodes a side of
    the cube on which contacts slide, its points, and radii in edges of its lattice. kidneys: mm, edge lengths. repeats:
    of a timing. contacts: of the ladder's judgement. ticks: of a session's path; steps_of_path: of one in equilibrium.
    asked: accuracies for which a model is sought.
    """

    quick: bool
    main: int
    fine: int
    sizes: tuple[int, ...]
    ladder: tuple[int, ...]
    ratios: tuple[float, ...]
    radius: float
    steps: int
    rest_steps: int
    ripple: int
    points: int
    radii: tuple[float, ...]
    kidneys: tuple[tuple[str, float], ...]
    repeats: int
    contacts: int
    ticks: int
    steps_of_path: int
    asked: int


FULL = Setting(
    False, 11, 21, (5, 11, 21, 41), (11, 21), RATIOS, 10.0, 25, 13, 21, 57, (1.5, 2.0, 2.5, 3.0),
    (("low", 8.0), ("medium", 5.0), ("high", 3.5)), 3, 8, 600, 60, 3,
)  # fmt: skip
QUICK = Setting(
    True, 6, 7, (4, 6), (6,), (0.10, 0.30, 0.49), 20.0, 11, 4, 8, 20, (2.0, 3.0), (("low", 12.0),), 1, 2, 200, 24, 1
)


def cube(nodes: int, irregular: bool = False, side: float = SIDE) -> TetMesh:
    """The cube of `nodes`³ nodes, six tetrahedra a cell; irregular: nodes moved by up to a fifth of a cell, faces flat."""
    n = nodes - 1
    index = np.stack(np.meshgrid(*[np.arange(nodes)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    x = index.astype(np.float64)
    if irregular:
        shift = np.random.default_rng(7).uniform(-0.2, 0.2, x.shape)
        x += np.where((index > 0) & (index < n), shift, 0.0)
    corner = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    tets = []
    for way in itertools.permutations(range(3)):  # Kuhn's six paths from a cell's low corner to its high one
        walk = np.cumsum([np.zeros(3, np.int64), *np.eye(3, dtype=np.int64)[list(way)]], axis=0)
        tet = np.stack([(corner + step) @ (nodes**2, nodes, 1) for step in walk], axis=1)
        tets.append(tet[:, [0, 2, 1, 3]] if np.linalg.det(np.eye(3)[list(way)]) < 0 else tet)
    return TetMesh(x * (side / n), np.concatenate(tets))


def tissue(nodes: int, poisson: float, irregular: bool = False, support: str = "bottom") -> Tissue:
    """The cube, held at its bottom, at its four sides (their upper rims too), or at both."""
    mesh = cube(nodes, irregular)
    bottom, sides = mesh.nodes[:, 2] == 0, ((mesh.nodes[:, :2] == 0) | (mesh.nodes[:, :2] == SIDE)).any(axis=1)
    held = {"bottom": bottom, "sides": sides, "all but top": bottom | sides}[support]
    return Tissue(mesh, YOUNG, poisson, held, element="P1")


def contact(solid: Tissue, name: str, radius: float) -> tuple[Float64, float]:
    """Point (3,) mm and radius mm: "patch" about the centre of the top, the "triangle" there, by its middle, or "node"."""
    if name == "patch":
        return np.array(TOP), radius
    mesh = solid.mesh
    if name == "node":
        return np.asarray(mesh.nodes[np.argmin(np.linalg.norm(mesh.nodes - TOP, axis=1))]), 0.0
    top = mesh.surface[(mesh.nodes[mesh.surface, 2] == SIDE).all(axis=1)]
    middles = mesh.nodes[top].mean(axis=1)
    return np.asarray(middles[np.argmin(np.linalg.norm(middles - TOP, axis=1))]), 0.0


def way(nodes: Float64, point: Float64) -> Float64:
    """(N,) mm from each node to the contact, at rest."""
    return np.asarray(np.linalg.norm(nodes - point, axis=1))
