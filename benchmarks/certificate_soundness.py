"""Is the certified error ever less than the true one? Random meshes, contacts and materials, blocks and multigrid.

    python -m benchmarks.certificate_soundness --cases 1000 --seed 0

The truth shares nothing with the models but the mesh and the patches' weights: stiffness from the strain matrices of
P1 and smoothed tetrahedra in numpy, and the saddle point of K and W factored by SuperLU.
"""

import argparse
import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bmat, coo_array, csc_array, diags_array
from scipy.sparse.linalg import splu

import palpate as pp
from palpate.errors import DataError

Array = NDArray[np.float64]
NAMES = ("blocks", "multigrid")


@dataclass(frozen=True)
class Case:
    """A tissue, m contacts on it, and how well they are to be answered."""

    tissue: pp.Tissue
    points: Array
    displacements: Array
    radii: Array
    tolerance: float
    kind: str


@dataclass(frozen=True)
class Outcome:
    """Of one model on one case: the bound it gave and the true error, both relative to the true energy norm."""

    name: str
    kind: str
    bound: float
    true: float
    iterations: int

    @property
    def violated(self) -> bool:
        """The truth's own rounding is given 1e-9."""
        return self.true > self.bound * (1 + 1e-9) + 1e-9


def brick(rng: np.random.Generator) -> pp.TetMesh:
    """A box of 2 to 8 cells a side, six tets a cell, its nodes shaken by up to 0.15 cells."""
    cells = rng.integers(2, 9, 3)
    size = cells * rng.uniform(2, 8) * rng.uniform(0.6, 1.6, 3)
    counts = cells + 1
    x = np.stack(np.meshgrid(*[np.arange(n) for n in counts], indexing="ij"), axis=-1).reshape(-1, 3).astype(float)
    x += rng.uniform(0, 0.15) * rng.uniform(-1, 1, x.shape)
    corner = np.stack(np.meshgrid(*[np.arange(n) for n in cells], indexing="ij"), axis=-1).reshape(-1, 3)
    tets = []
    for path in itertools.permutations(range(3)):
        walk = [np.zeros(3, int)]
        for axis in path:
            walk.append(walk[-1] + np.eye(3, dtype=int)[axis])
        index = [np.ravel_multi_index((corner + s).T, counts) for s in walk]
        odd = np.linalg.det(np.eye(3)[list(path)]) < 0
        tets.append(np.stack([index[k] for k in ((0, 2, 1, 3) if odd else (0, 1, 2, 3))], axis=1))
    tet = np.concatenate(tets)
    nodes = x / cells * size
    centre = nodes[tet].mean(axis=1) / size
    region = 1 + (np.linalg.norm(centre - rng.uniform(0.2, 0.8, 3), axis=1) < rng.uniform(0.1, 0.4))
    return pp.TetMesh(nodes, tet, region=region)


def organ(rng: np.random.Generator) -> pp.TetMesh:
    """A stuffed ellipsoid, random axes, with a lump where there is room."""
    n = 40
    axes = rng.uniform(9, 17, 3)
    z, y, x = np.meshgrid(*[np.arange(n) - n / 2] * 3, indexing="ij")
    inside = (x / axes[0]) ** 2 + (y / axes[1]) ** 2 + (z / axes[2]) ** 2 < 1
    lump = (x - 2) ** 2 + y**2 + (z - 1) ** 2 < 3.5**2
    labels = pp.Labels(inside.astype(np.int32) + (inside & lump), pp.Grid((n, n, n), (1, 1, 1), (0, 0, 0)))
    return pp.tetrahedralize(labels, 1, rng.uniform(3.5, 5), inclusions=[2])


def material(rng: np.random.Generator, mesh: pp.TetMesh) -> tuple[Array, Array]:
    """kPa and Poisson's ratio of each tet: two regions up to 30 apart, ν up to 0.49, some with noise from tet to tet."""
    lump = mesh.region != mesh.region.min()
    young = np.where(lump, 10.0 ** rng.uniform(-0.5, 1.5), 1.0) * rng.uniform(1, 20)
    if rng.random() < 0.3:
        young = young * 10 ** rng.uniform(-0.5, 0.5, len(young))
    poisson = np.where(lump, rng.uniform(0, 0.49), rng.choice([0.3, 0.45, 0.49, rng.uniform(0, 0.49)]))
    return young, poisson


def cases(count: int, seed: int) -> Iterator[Case]:
    """The same ones for the same seed."""
    made = 0
    for number in itertools.count():
        rng = np.random.default_rng([seed, number])
        stuffed = number % 20 == 19
        try:
            mesh = organ(rng) if stuffed else brick(rng)
            way = rng.standard_normal(3) if stuffed else np.eye(3)[rng.integers(3)] * rng.choice([-1, 1])
            fixed, element = pp.resting_on(mesh, way, depth=None), ("smoothed", "P1")[number % 2]
            tissue = pp.Tissue(mesh, *material(rng, mesh), fixed, element=element)
            m = int(rng.choice([1, 1, 2, 3]))
            free = mesh.surface_nodes[~tissue.held[mesh.surface_nodes]]
            points = mesh.nodes[rng.choice(free, m, replace=False)]
            radii = tissue.edge * rng.uniform(0.8, 3, m)
            moves = rng.standard_normal((m, 3)) * tissue.edge
            case = Case(tissue, points, moves, radii, 10 ** rng.uniform(-6, -1), "stuffed" if stuffed else "brick")
            exact(case)
        except ValueError:  # a lump that vanishes, held points, contacts that overlap: not a case
            continue
        yield case
        made += 1
        if made == count:
            return


def shares(tissue: pp.Tissue, corners: int) -> csc_array:
    """(cells, M) mm³ that each tet gives to the cells of its edges (2 corners), its nodes (1) or itself (4), by region."""
    number: dict[tuple[int, ...], int] = {}
    rows, columns, parts = [], [], []
    for t, (tet, region) in enumerate(zip(tissue.mesh.tets.tolist(), tissue.mesh.region.tolist(), strict=True)):
        sides = list(itertools.combinations(sorted(tet), corners))
        for side in sides:
            rows.append(number.setdefault((region, *side), len(number)))
            columns.append(t)
            parts.append(float(tissue.mesh.volumes[t]) / len(sides))
    return csc_array(coo_array((parts, (rows, columns)), shape=(len(number), len(tissue.mesh.tets))))


def stiffness(tissue: pp.Tissue) -> csc_array:
    """K = Σ V B̄ᵀD B̄ by mean strain matrices of the element's cells, unknown 3i+k, N/mm; of P1 each tet is a cell."""
    mesh = tissue.mesh
    inverse = np.linalg.inv(mesh.nodes[mesh.tets[:, 1:]] - mesh.nodes[mesh.tets[:, :1]]).transpose(0, 2, 1)
    slope = np.concatenate([-inverse.sum(axis=1, keepdims=True), inverse], axis=1)
    B = np.zeros((6, len(mesh.tets), 12))
    for a in range(4):
        g = slope[:, a]
        for k in range(3):
            B[k, :, 3 * a + k] = g[:, k]
            i, j = (k + 1) % 3, (k + 2) % 3
            B[3 + k, :, 3 * a + i], B[3 + k, :, 3 * a + j] = g[:, j], g[:, i]
    at = (3 * mesh.tets[:, :, None] + np.arange(3)).reshape(-1, 12)
    shape, row = (len(mesh.tets), 3 * len(mesh.nodes)), np.repeat(np.arange(len(mesh.tets)), 12)
    strain = [csc_array(coo_array((b.ravel(), (row, at.ravel())), shape=shape)) for b in B]
    E, nu = tissue.young * 1e-3, tissue.poisson
    lam, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
    shear, bulk = (shares(tissue, n) for n in ((2, 1) if tissue.element == "smoothed" else (4, 4)))
    volume, K = shear.sum(axis=1), csc_array((shape[1], shape[1]))
    for k in range(6):
        mean = diags_array(1 / volume) @ shear @ strain[k]
        K = K + mean.T @ diags_array((2 if k < 3 else 1) * (shear @ mu)) @ mean
    volume = bulk.sum(axis=1)
    mean = diags_array(1 / volume) @ bulk @ (strain[0] + strain[1] + strain[2])
    return csc_array(K + mean.T @ diags_array(volume**2 / (bulk @ (1 / lam))) @ mean)


def exact(case: Case) -> tuple[Array, csc_array]:
    """u* (N, 3) of K u = W f, Wᵀu = d by a sparse factorisation of the saddle point, refined once; and K."""
    from palpate.tissue.contact_patches import contacts

    tissue = case.tissue
    K = stiffness(tissue)
    found = contacts(tissue, case.points, case.displacements, case.radii)
    free = np.flatnonzero(np.repeat(~tissue.held, 3))
    W = np.kron(found.weights(len(tissue.mesh.nodes)), np.eye(3))[free]
    scale = float(K.diagonal().mean())  # keeps the two kinds of rows alike
    saddle = csc_array(bmat([[K[free][:, free], scale * W], [scale * W.T, None]]))
    right = np.concatenate([np.zeros(len(free)), scale * found.displacement.ravel()])
    factors = splu(saddle)
    x = factors.solve(right)
    for _ in range(2):
        x += factors.solve(right - saddle @ x)
    u = np.zeros(K.shape[0])
    u[free] = x[: len(free)]
    return u.reshape(-1, 3), K


def outcomes(case: Case) -> list[Outcome]:
    """Each model's bound beside the truth."""
    u, K = exact(case)
    scale = float(np.sqrt(u.ravel() @ (K @ u.ravel())))
    found = []
    for name in NAMES:
        model = pp.model(case.tissue, name)
        answer = model.push(case.points, case.displacements, case.radii, tolerance=case.tolerance, most_sweeps=3000)
        e = (answer.displacement - u).ravel()
        found.append(Outcome(name, case.kind, answer.error, float(np.sqrt(e @ (K @ e))) / scale, answer.sweeps))
    return found


def main() -> None:
    """Prints violations, and the median, 99th percentile and maximum of bound over truth."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    seen: list[Outcome] = []
    for number, case in enumerate(cases(options.cases, options.seed), 1):
        try:
            seen += outcomes(case)
        except DataError as refusal:  # told, and no answer: not a wrong one
            print(f"case {number} ({case.kind}) refused: {refusal}")
            continue
        for one in seen[-len(NAMES) :]:
            if one.violated:
                print(f"case {number} ({one.kind}), {one.name}: true {one.true:.3e} above bound {one.bound:.3e}")
        if number % 100 == 0 or number == options.cases:
            print(f"{number} cases", flush=True)
            for name in NAMES:
                mine = [one for one in seen if one.name == name]
                ratio = np.array([one.bound / max(one.true, 1e-300) for one in mine if one.true > 1e-9])
                print(
                    f"  {name}: {sum(one.violated for one in mine)} violations; bound/true median {np.median(ratio):.3f}"
                    f", p99 {np.quantile(ratio, 0.99):.3f}, greatest {ratio.max():.3f}, least {ratio.min():.5f}; "
                    f"iterations median {np.median([one.iterations for one in mine]):.0f}, "
                    f"most {max(one.iterations for one in mine)}"
                )


if __name__ == "__main__":
    main()
