"""CalculiX (Debian: calculix-ccx), an independent finite-element code, on a tissue of ours: the same mesh, material and
contact, its own elements, assembly, solver and files.

The contact Wᵀu = d is a linear equation between the patch's nodes and a reference node that carries the displacement;
the force is the supports' reaction. `.dat` files have seven digits, so agreement ends near 1e-6.
"""

import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import palpate as pp
from palpate.arrays import Float64, Int64
from palpate.tissue.contact_patches import Answer, contacts
from palpate.tissue.reference.finite_strain import Law
from palpate.tissue.reference.linear_elasticity import FiniteElements, lame
from palpate.tissue.tissue import KPA
from support.brick_meshes import brick

MISSING = "CalculiX is missing; install it: apt-get install calculix-ccx"


@dataclass(frozen=True)
class Solved:
    """displacement: (nodes, 3) mm, mid-edge nodes after the mesh's. force: (3,) N of the tissue on the tool."""

    displacement: Float64
    force: Float64


def there() -> bool:
    """Is CalculiX installed?"""
    return shutil.which("ccx") is not None


def calculix(tissue: pp.Tissue, element: str, point: Float64, push: Float64, radius: float, finite: bool) -> Solved:
    """CalculiX's answer to one push. element: "P1" (C3D4) or "P2" (C3D10).

    finite: neo-Hookean at finite strain, W = μ/2 (J^(−2/3) tr FᵀF − 3) + κ/2 (J − 1)², else linear elasticity.
    """
    if not there():
        raise FileNotFoundError(MISSING)
    fe = FiniteElements(tissue, element)
    places, cells, weights, held = discrete(fe, point, radius)
    with tempfile.TemporaryDirectory() as folder:
        deck(Path(folder) / "push.inp", tissue, places, cells, weights, held, push, finite)
        run = subprocess.run(["ccx", "push"], cwd=folder, capture_output=True, text=True, timeout=600)
        printed = Path(folder) / "push.dat"
        if run.returncode or not printed.exists() or "*ERROR" in run.stdout:
            raise RuntimeError(f"CalculiX failed: {run.stdout[-500:]}")
        blocks = tables(printed.read_text())
    u, reaction = blocks["displacements"], blocks["forces"]
    return Solved(u[np.argsort(u[:, 0])][: len(places), 1:], reaction[:, 1:].sum(axis=0))


def discrete(fe: FiniteElements, point: Float64, radius: float) -> tuple[Float64, Int64, Float64, Int64]:
    """Nodes (n, 3), cells (M, 4 or 10), contact weights (n,) and the held nodes, in CalculiX's order of nodes."""
    mesh = fe.space.mesh
    load = fe.loads(contacts(fe.tissue, point, np.zeros(3), radius))[:, 2]
    dofs = fe.space.nodal_dofs[2]
    places, cells = fe.tissue.mesh.nodes, fe.tissue.mesh.tets.astype(np.int64)
    if fe.element == "P2":  # edges 01 12 02 03 13 23: as CalculiX counts them
        dofs = np.concatenate([dofs, fe.space.edge_dofs[2]])
        places = np.concatenate([places, mesh.p[:, mesh.edges].mean(axis=1).T])
        cells = np.concatenate([cells, len(fe.tissue.mesh.nodes) + mesh.t2e.T], axis=1)
    return places, cells, load[dofs], np.flatnonzero(~np.isin(dofs, fe.free))


def deck(
    path: Path,
    tissue: pp.Tissue,
    places: Float64,
    cells: Int64,
    weights: Float64,
    held: Int64,
    push: Float64,
    finite: bool,
) -> None:
    """Writes CalculiX's input; numbers count from 1, have at most 20 characters, and the reference node is the last."""
    materials, kind = np.unique(np.stack([tissue.young, tissue.poisson], axis=1), axis=0, return_inverse=True)
    reference, touched = len(places) + 1, np.flatnonzero(np.abs(weights) > 1e-14)
    touched = touched[np.argsort(-np.abs(weights[touched]))]  # the first one named is eliminated
    with path.open("w") as out:
        out.write("*NODE, NSET=ALL\n")
        for k, x in enumerate([*places, np.zeros(3)], 1):
            out.write(f"{k}, {x[0]:.12e}, {x[1]:.12e}, {x[2]:.12e}\n")
        for m, (young, poisson) in enumerate(materials):
            out.write(f"*ELEMENT, TYPE=C3D{cells.shape[1]}, ELSET=E{m}\n")
            for t in np.flatnonzero(kind.ravel() == m):
                out.write(f"{t + 1}, " + ", ".join(str(n + 1) for n in cells[t]) + "\n")
            lam, mu = (float(c) for c in lame(young, poisson))
            law = f"*HYPERELASTIC, NEO HOOKE\n{mu / 2:.12e}, {2 / (lam + 2 * mu / 3):.12e}" if finite else (
                f"*ELASTIC\n{young * KPA:.12e}, {poisson:.12e}"
            )  # fmt: skip
            out.write(f"*MATERIAL, NAME=M{m}\n{law}\n*SOLID SECTION, ELSET=E{m}, MATERIAL=M{m}\n")
        out.write("*NSET, NSET=HELD\n" + "".join(f"{n + 1},\n" for n in held))
        out.write("*BOUNDARY\nHELD, 1, 3\n*EQUATION\n")
        for axis in (1, 2, 3):
            terms = [f"{n + 1}, {axis}, {weights[n]:.12e}" for n in touched] + [f"{reference}, {axis}, -1.0"]
            out.write(f"{len(terms)}\n" + "".join(f"{term}\n" for term in terms))
        out.write("*STEP, NLGEOM, INC=1000\n*STATIC\n0.2, 1.\n" if finite else "*STEP\n*STATIC\n")
        out.write("*BOUNDARY\n" + "".join(f"{reference}, {k + 1}, {k + 1}, {push[k]:.12e}\n" for k in range(3)))
        out.write("*NODE PRINT, NSET=ALL\nU\n*NODE PRINT, NSET=HELD\nRF\n*END STEP\n")


def tables(text: str) -> dict[str, Float64]:
    """The last table of each quantity in a .dat file: (rows, 4), number of the node and three components."""
    found: dict[str, Float64] = {}
    lines, rows, name = text.splitlines(), [], ""
    for line in [*lines, "end of"]:
        words = line.split()
        if len(words) == 4 and words[0].isdigit():
            rows.append([float(w) for w in words])
        elif words:
            if rows:
                found[name] = np.array(rows)
            name, rows = words[0], []
    return found


def _stress(F: Float64, lam: Float64, mu: Float64) -> Float64:
    G, J = np.linalg.inv(F).swapaxes(-1, -2), np.linalg.det(F)[..., None, None]
    m, k = mu[..., None, None], (lam + 2 * mu / 3)[..., None, None]
    first = (F**2).sum(axis=(-2, -1), keepdims=True)
    return np.asarray(m * J ** (-2 / 3) * (F - first / 3 * G) + k * (J - 1) * J * G)


def _tangent(F: Float64, lam: Float64, mu: Float64) -> Float64:
    G, one = np.linalg.inv(F).swapaxes(-1, -2), np.eye(3)
    J, first = (x[..., None, None, None, None] for x in (np.linalg.det(F), (F**2).sum(axis=(-2, -1))))
    m, k = (c[..., None, None, None, None] for c in (mu * np.linalg.det(F) ** (-2 / 3), lam + 2 * mu / 3))
    GG, turned = np.einsum("...ij,...kl->...ijkl", G, G), np.einsum("...il,...kj->...ijkl", G, G)
    FG = np.einsum("...ij,...kl->...ijkl", F, G)
    straight = np.einsum("ik,jl->ijkl", one, one) - 2 / 3 * (FG + np.einsum("...ijkl->...klij", FG))
    shape = m * (straight + 2 / 9 * first * GG + first / 3 * turned)
    return np.asarray(shape + k * ((2 * J - 1) * J * GG - (J - 1) * J * turned))


SPLIT = Law(_stress, _tangent)
"""CalculiX's neo-Hookean energy, in place of ours, for our own solver: so the two solve the same equations."""


FOUR_POINTS = {"P1": 1, "P2": 2}  # degree of CalculiX's quadrature: one point, and four


def apart(theirs: Solved, ours: Answer) -> tuple[float, float]:
    """Greatest difference of displacement at the mesh's nodes over the greatest displacement, and that of the force."""
    gap = np.abs(theirs.displacement[: len(ours.displacement)] - ours.displacement).max()
    off = np.linalg.norm(theirs.force - ours.force) / np.linalg.norm(ours.force)
    return float(gap / np.abs(ours.displacement).max()), float(off)


def cube(nodes: int) -> pp.Tissue:
    """The 50 mm cube, held below, a tenth of its tets stiffer and less compressible."""
    mesh = brick((nodes - 1,) * 3, region=lambda x: 1 + (np.linalg.norm(x - [25, 25, 30], axis=1) < 14))
    return pp.Tissue(mesh, {1: 5.0, 2: 20.0}, {1: 0.3, 2: 0.45}, mesh.nodes[:, 2] == 0)
