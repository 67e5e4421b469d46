"""How far the lips of a cut overlap under 100 random presses: python -m benchmarks.lip_presses

The sample's kidney, cut along a way that turns. Half of the presses are of one tool at the rim of the cut or in it, 1 to
4 mm deep and up to some mm along; the other half are of two tools that squeeze the cut from both sides. Overlap is looked
for at every vertex of the lips.
"""

from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

import palpate as pp
from benchmarks.cutting_by_hand import DEPTH, TOLERANCE, front_path, kidney
from palpate.arrays import Float64, Int64
from palpate.errors import PalpateError
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.server.cutting_stroke import simplified

PRESSES, EDGE = 100, 4.0


def opposite(mesh: CutMesh) -> tuple[Int64, Float64]:
    """(p, 2) vertices of both lips at one place, and (p, 3) the unit normal out of the first."""
    skin, normal = mesh.skin, np.zeros_like(mesh.places)
    a, b, c = mesh.places[skin.triangles[skin.lip]].swapaxes(0, 1)
    for corner in skin.triangles[skin.lip].T:
        np.add.at(normal, corner, np.cross(b - a, c - a))
    pair = cKDTree(mesh.places).query_pairs(1e-6, output_type="ndarray")
    out = normal[pair[:, 0]]
    facing = np.einsum("pi,pi->p", out, normal[pair[:, 1]]) < -0.5 * (out**2).sum(axis=1)
    return pair[facing], out[facing] / np.linalg.norm(out[facing], axis=1, keepdims=True)


def overlap(mesh: CutMesh, u: Float64, pair: Int64, out: Float64) -> float:
    """mm, the deepest."""
    moved = mesh.skin.carried(mesh.tets, u)
    return float(np.einsum("pi,pi->p", moved[pair[:, 0]] - moved[pair[:, 1]], out).max())


def main() -> None:
    """Prints the figures and writes them into the documentation."""
    whole = kidney(EDGE)
    way = front_path(whole)
    opened = pp.cut(whole, pp.incision(whole, simplified(way, TOLERANCE * whole.edge), DEPTH))
    mesh = opened.mesh
    assert isinstance(mesh, CutMesh)
    pair, out = opposite(mesh)
    models = [pp.model(opened, "compliance", contact=contact) for contact in (True, False)]
    rng = np.random.default_rng(5)
    found = []
    while len(found) < PRESSES:
        place = mesh.places[pair[rng.integers(len(pair)), 0]] + rng.normal(0, 5, 3)
        at = opened.surface.closest(place)
        inward = -rng.uniform(1, 4) * np.array(opened.surface.normal(at)) + rng.normal(0, 1.5, 3)
        middle, aside = way[rng.integers(8, len(way) - 8)], rng.uniform(5, 9)
        sides = [np.array(whole.surface.closest(middle + (x, 0, 0)).point) for x in (aside, -aside)]
        one = (np.array(at.point), inward, 8.0)
        two = (sides, [(-2.5, rng.normal(0, 1), 0), (2.5, rng.normal(0, 1), 0)], 7.0)
        try:
            answers = [model.push(*(two if len(found) % 2 else one)) for model in models]
        except PalpateError:  # a patch of held nodes, or off the surface
            continue
        found.append([overlap(mesh, answer.displacement, pair, out) for answer in answers])
    closed, through = np.array(found).T
    lines = [
        f"`python -m benchmarks.lip_presses`: {PRESSES} random presses on a cut kidney, edge {EDGE:g} mm",
        "",
        "| overlap of the lips, mm | median | 95 % | largest | at most 0.1 mm |",
        "|---|---|---|---|---|",
        *(
            f"| {name} | {np.median(d):.2f} | {np.quantile(d, 0.95):.2f} | {d.max():.2f} | {(d <= 0.1).sum()} of {PRESSES} |"
            for name, d in (("with contact", closed), ("without", through))
        ),
    ]
    print("\n".join(lines))
    (Path(__file__).parents[1] / "docs" / "figures" / "lip-presses.md").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
