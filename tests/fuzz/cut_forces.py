"""Forces of randomly cut bodies from the factors of the whole ones, against factorisations of the cut ones from scratch.

    python tests/fuzz/cut_forces.py 200 --seed 1

Cuts a cube, the sample's kidney and an organ with a lump: straight, curved, crossing, all the way through, and past nodes
by less than rounding; those that leave a piece without support are drawn again. Pushes each at a random place near the
cut. The stiffness from scratch is assembled by the tests' own code. Ends with 1 if a force or a displacement differs by
more than 1e-5.
"""

import argparse
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))

from support.blades import random_blades
from support.brick_meshes import brick
from support.cut_stiffness import solution
from support.example_organs import ellipsoid

import palpate as pp
from palpate.samples import KIDNEY_LABEL, sample
from palpate.tissue.contact_patches import contacts
from palpate.tissue.cut_compliance import CutCompliance

ALLOWED = 1e-5


def bodies(kidney=True):
    """Tissues to cut, by name, each held at both ends so that halves are held, too."""
    cube, organ = brick((5, 5, 5), warp=0.3), ellipsoid(7)
    made = {"cube": held(cube, 5.0), "organ with a lump": held(organ, {"organ": 5.0, "lump": 50.0})}
    if kidney:
        labels = pp.read_labels(sample("abdomen") / "labels.nii.gz")
        made["kidney"] = held(pp.tetrahedralize(labels, KIDNEY_LABEL, 8.0), 15.0)
    return made


def held(mesh, young):
    """A tissue that is held at both ends of its longest side."""
    x = mesh.nodes[:, np.argmax(np.ptp(mesh.nodes, axis=0))]
    part = (x - x.min()) / np.ptp(x)
    return pp.Tissue(mesh, young, 0.45, (part < 0.12) | (part > 0.88))


def opened(tissue, rng):
    """A kind of cut, and a tissue that has it."""
    while True:
        kind, blades = random_blades(tissue.mesh, rng)
        try:
            cut = pp.cut(tissue, blades)
        except pp.errors.MaterialError:
            continue  # a piece came free
        if (cut.mesh.share < 1).any() and len(cut.mesh.nodes) > len(tissue.mesh.nodes):
            return kind, cut


def push(cut, rng):
    """A contact at a point of the surface within reach of a lip, and its displacement."""
    mesh = cut.mesh
    outer = np.unique(mesh.skin.triangles[~mesh.skin.lip])
    lips = mesh.places[np.unique(mesh.skin.triangles[mesh.skin.lip])]
    near = outer[np.argsort(np.linalg.norm(mesh.places[outer] - lips[rng.integers(len(lips))], axis=1))[:40]]
    return mesh.places[rng.choice(near)], rng.normal(0, 1, 3), 2 * cut.edge


def differences(model, cut, rng):
    """Relative differences of force and displacement, and the unknowns of the update."""
    update = CutCompliance(model, cut)
    while True:
        try:
            point, way, radius = push(cut, rng)
            found = contacts(cut, point, way, radius)
            break
        except pp.errors.MaterialError:
            continue  # held nodes only
    answer = update.push(point, way, radius)
    W = np.kron(found.weights(len(cut.mesh.nodes)), np.eye(3))
    force, u = solution(cut, W, way)
    apart = np.linalg.norm(answer.force + force) / np.linalg.norm(force)
    return apart, np.abs(answer.displacement.ravel() - u).max() / np.abs(u).max(), update.unknowns


def run(count, seed, kidney=True, progress=False):
    """(force, displacement, unknowns) of each cut, by body and kind."""
    found = defaultdict(list)
    models = {name: pp.model(tissue, "compliance") for name, tissue in bodies(kidney).items()}
    for number in range(count):
        rng = np.random.default_rng((seed, number))
        name = list(models)[number % len(models)]
        kind, cut = opened(models[name].tissue, rng)
        found[name, kind].append(differences(models[name], cut, rng))
        if progress:
            print(f"\r{number + 1} of {count} cuts", end="", file=sys.stderr, flush=True)
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", type=int, nargs="?", default=200)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    found = run(given.count, given.seed, progress=sys.stderr.isatty())
    print(f"{'body':18s} {'kind':9s} cuts  unknowns  worst force  worst displacement")
    for (name, kind), rows in sorted(found.items()):
        force, displacement, unknowns = np.array(rows).max(axis=0)
        print(f"{name:18s} {kind:9s} {len(rows):4d}  {unknowns:8.0f}  {force:11.1e}  {displacement:18.1e}")
    worst = max(max(row[:2]) for rows in found.values() for row in rows)
    print(f"{given.count} cuts, seed {given.seed}: worst difference {worst:.1e}")
    return int(not worst < ALLOWED)


if __name__ == "__main__":
    sys.exit(main())
