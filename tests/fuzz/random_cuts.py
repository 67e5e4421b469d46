"""Random cuts, none of which may lose volume, leave a gap in the surface or miss the blade.

    python tests/fuzz/random_cuts.py 10000 --seed 1

Cuts a cube, a warped brick and an organ with a lump at random: straight, curved, crossing, all the way through, along a way
with kinks of less than rounding, and past nodes by less than rounding. Ends with 1 if a cut was not made, or one of its
figures is wrong. All of them are judged by what the blade and the mesh before say, not by the code that cuts.
"""

import argparse
import sys
from collections import Counter
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))
from support.blades import THROUGH, area_within, distance, random_blades
from support.brick_meshes import brick
from support.example_organs import ellipsoid

import palpate as pp
from palpate.meshes.cutting.cut_mesh import cut_mesh

NEAR, CRUMB = 1e-6, 0.01  # mm; mm² of a corner so small that it is no piece
LEAST_SHARE, VOLUME, FAR, AREA = 1e-6, 1e-9, 0.1, 0.01  # no unit, no unit, mm, no unit


def bodies():
    """Meshes to cut, by name."""
    return {"cube": brick((5, 5, 5)), "warped": brick((4, 5, 3), warp=0.35), "organ": ellipsoid(7)}


def faults(mesh, blades, cut):
    """What is wrong with a cut mesh; nothing, if all is well."""
    wrong = []
    whole = mesh.volumes.sum()
    if not np.isclose(cut.volumes.sum(), whole, rtol=VOLUME):
        wrong.append(f"volume {cut.volumes.sum():.9g} of {whole:.9g} mm³")
    if not np.allclose(np.bincount(cut.parent, cut.share), 1, rtol=VOLUME):
        wrong.append("shares of a tetrahedron do not sum to 1")
    if cut.share.min() < LEAST_SHARE:
        wrong.append(f"share {cut.share.min():.3g}")
    corners = cut.places[cut.skin.triangles]
    wrong += gaps(cut.skin.triangles)
    inside = np.linalg.det(corners).sum() / 6
    if not np.isclose(inside, whole, rtol=VOLUME):
        wrong.append(f"the surface encloses {inside:.9g} of {whole:.9g} mm³")
    return wrong + off_the_blade(mesh, blades, corners[cut.skin.lip])


def gaps(triangles):
    """Edges of a surface that are not there once in either direction."""
    edges = np.concatenate([triangles[:, [k, (k + 1) % 3]] for k in range(3)])
    there, count = np.unique(edges, axis=0, return_counts=True)
    back = np.unique(edges[:, ::-1], axis=0)
    wrong = [f"{np.count_nonzero(count > 1)} edges of the surface have more than two triangles"] * bool(
        (count > 1).any()
    )
    return wrong + ["the surface has a gap"] * (not np.array_equal(there, back))


def off_the_blade(mesh, blades, lips):
    """What is wrong with the triangles (L, 3, 3) mm of the lips."""
    area = np.linalg.norm(np.cross(lips[:, 1] - lips[:, 0], lips[:, 2] - lips[:, 0]), axis=1).sum() / 4
    swept = [sum(area_within(moved(blade, by), mesh) for blade in blades) for by in (0.0, NEAR, -NEAR)]
    wrong = []
    if not (1 - AREA) * min(swept) - CRUMB < area < (1 + AREA) * max(swept) + CRUMB:
        wrong.append(f"each lip has {area:.6g} mm², and the blade swept {swept[0]:.6g} mm²")
    if len(lips):
        points = np.unique(lips.reshape(-1, 3), axis=0)
        far = np.min([distance(points, blade) for blade in blades], axis=0).max()
        if far > FAR:
            wrong.append(f"a lip lies {far:.3g} mm off the blade")
    return wrong


def moved(blade, by):
    """A blade that has gone `by` mm along its first normal: one that lies in the organ's surface may be in or out."""
    a, b, c = blade.points[blade.triangles[0]]
    normal = np.cross(b - a, c - a)
    return pp.Blade(blade.points + by * normal / np.linalg.norm(normal), blade.triangles)


def run(count, seed, progress=0):
    """How often each kind came, how many cuts met the body, and what was wrong. progress: cuts between two words of it."""
    told, wrong, met, meshes = Counter(), [], 0, bodies()
    for number in range(count):
        rng = np.random.default_rng((seed, number))
        name = list(meshes)[number % len(meshes)]
        kind, blades = random_blades(meshes[name], rng)
        told[kind] += 1
        try:
            cut = cut_mesh(meshes[name], blades)
        except Exception as problem:
            wrong.append(f"{number} {name} {kind}: {type(problem).__name__}: {problem}")
            continue
        met += bool(cut.skin.lip.any())
        wrong += [f"{number} {name} {kind}: {fault}" for fault in faults(meshes[name], blades, cut)]
        if kind in THROUGH and cut.skin.lip.any() and cut.body.max() == 0:  # all three bodies are convex
            wrong.append(f"{number} {name} {kind}: the two sides hang together")
        if progress and number % progress == progress - 1:
            end = "\r" if sys.stderr.isatty() else "\n"
            print(f"{number + 1} of {count} cuts, {len(wrong)} wrong", end=end, file=sys.stderr, flush=True)
    return told, met, wrong


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", type=int, nargs="?", default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    told, met, wrong = run(given.count, given.seed, progress=100 if sys.stderr.isatty() else 1000)
    for name, times in sorted(told.items()):
        print(f"{times:7d}  {name}")
    for line in wrong[:20]:
        print(line)
    print(f"{given.count} cuts, seed {given.seed}, of which {met} met the body: {len(wrong)} wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
