"""Tetrahedra of the sample's kidneys and of twenty-two shapes that are hard to mesh: time, angles, volume, surface.

Nothing here is measured by the package's own figures. The reference is the surface of the smoothed label by marching
cubes on a grid twice as fine, at equal volume; beside it, the function that drew the label (corners sharper than voxels
are rounded against it). Distances are between points strewn over both surfaces, a twentieth of an edge apart or less, in
units of the edge asked for.
"""

import sys
import time
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree
from skimage.measure import marching_cubes

import palpate as pp
from benchmarks.interleaved_timing import header, row
from palpate.errors import PalpateError
from palpate.samples import sample
from palpate.volumes.label_names import with_names

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.difficult_labels import SHAPES, Shape  # the tests', so that both mean the same

FACES = ((1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1))
CLOSE = 0.05  # of an edge, between the points strewn over a surface
PAD = 6  # voxels
KIDNEYS = {"low": 6.0, "medium": 4.0, "high": 3.0}  # mm


def lines(wanted: tuple[str, ...] = ()) -> Iterator[str]:
    """One row a mesh whose name has a `wanted` word; the last column says whether it keeps the promise."""
    yield header(
        "shape", "edge mm", "tets", "nodes", "CPU s", "s / 20k", "dihedral °", "volume", "regions", "their surfaces, edges",
        "surface, edges", "against the function: volume, surface", "skin", "verdict",
    )  # fmt: skip
    kept = 0
    names = ("kidney_left", "kidney_right")
    kidneys = [(f"{name} {size}", name, edge) for name in names for size, edge in KIDNEYS.items()]
    cases = [(title, _kidney(name, edge)) for title, name, edge in kidneys]
    cases += [(name, make()) for name, make in SHAPES.items()]
    cases = [case for case in cases if not wanted or any(word in case[0] for word in wanted)]
    for name, shape in cases:
        figures = measured(shape)
        kept += figures[-1] == "kept"
        yield row(name, shape.edge, *figures)
    yield f"\n{kept} of {len(cases)} kept: worst dihedral ≥ 10°, volumes within 2 %, surface within half an edge, ≤ 3 s."


def _kidney(name: str, edge: float) -> Shape:
    path = sample("abdomen") / "labels.nii.gz"
    labels = with_names(pp.read_labels(path), path)
    return Shape(labels, edge, None, {"label": name})


def measured(shape: Shape) -> list[object]:
    """The cells of a row after name and edge."""
    options = dict(shape.options)
    label = options.pop("label", 1)
    times = []
    try:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            for _ in range(2):
                began = time.process_time()
                mesh = pp.tetrahedralize(shape.labels, label, shape.edge, **options)
                times.append(time.process_time() - began)
    except PalpateError as problem:
        return [*[""] * 11, f"FAILED: {problem}"]
    seconds = min(times)
    value = shape.labels.value_of(label)
    whole = meshed(shape, value, mesh)
    edge = shape.edge
    angle = dihedral(mesh)
    volume = volumes(mesh).sum() / (np.count_nonzero(whole) * shape.labels.grid.voxel_volume) - 1
    regions = region_errors(shape, mesh, whole)
    outer = skin(mesh.tets)
    away = hausdorff(mesh.nodes, outer, *smoothed(shape, whole), CLOSE * edge) / edge
    against = ""
    if shape.exact is not None:
        reference, exact = drawn(shape, whole)
        far = hausdorff(mesh.nodes, outer, *reference, CLOSE * edge) / edge
        against = f"{volumes(mesh).sum() / exact - 1:+.2%}, {far:.2f}"
    pace = seconds * 20_000 / len(mesh.tets)
    between = max([away, *region_surfaces(shape, mesh, whole, edge)])
    wrong = [
        text
        for text, bad in (
            ("angle", angle < 10),
            ("volume", max(map(abs, [volume, *regions])) > 0.02),
            ("surface", between > 0.5),
            ("slow", min(seconds, pace) > 3),
            ("skin", not manifold(mesh.tets)),
        )
        if bad
    ]
    warned = f" ({'; '.join(sorted({str(w.message) for w in said}))})" if said else ""
    told = ", ".join(f"{error:+.2%}" for error in regions)
    form = "2-manifold" if manifold(mesh.tets) else "not manifold"
    verdict = "kept" if not wrong else "not: " + ", ".join(wrong) + warned
    return [
        len(mesh.tets), len(mesh.nodes), f"{seconds:.2f}", f"{pace:.2f}", f"{angle:.1f}", f"{volume:+.2%}", told,
        f"{between:.2f}" if regions else "", f"{away:.2f}", against, form, verdict,
    ]  # fmt: skip


def meshed(shape: Shape, value: int, mesh: pp.TetMesh) -> np.ndarray:
    """(z, y, x) the voxels that the mesh is to fill: the organ with its regions, its voids and parts as asked for."""
    mask = np.isin(shape.labels.values, [value, *shape.options.get("inclusions", [])])
    if shape.options.get("keep") != "all":
        part, _ = ndimage.label(mask)
        mask = part == 1 + np.argmax(np.bincount(part.ravel())[1:])
    if shape.options.get("fill_holes", True):
        mask = ndimage.binary_fill_holes(mask)
    return mask


def region_errors(shape: Shape, mesh: pp.TetMesh, whole: np.ndarray) -> list[float]:
    """Part by which each region's volume is off that of its label."""
    values = [int(v) for v in np.unique(mesh.region)]
    if not shape.options.get("inclusions"):
        return []
    each = shape.labels.grid.voxel_volume
    return [
        volumes(mesh)[mesh.region == v].sum() / (((shape.labels.values == v) & whole).sum() * each) - 1 for v in values
    ]


def region_surfaces(shape: Shape, mesh: pp.TetMesh, whole: np.ndarray, edge: float) -> list[float]:
    """Edges between the skin of each region and its label's, smoothed less: corners where regions meet are real."""
    if not shape.options.get("inclusions"):
        return []
    away = []
    for value in np.unique(mesh.region):
        label = smoothed(shape, (shape.labels.values == value) & whole, 0.35)
        away.append(hausdorff(mesh.nodes, skin(mesh.tets[mesh.region == value]), *label, CLOSE * edge) / edge)
    return away


def smoothed(shape: Shape, whole: np.ndarray, voxels: float = 0.7) -> tuple[np.ndarray, np.ndarray]:
    """Vertices mm and triangles of the label's surface, its staircase smoothed by so many voxels at equal volume."""
    fine = np.pad(whole, PAD).repeat(2, 0).repeat(2, 1).repeat(2, 2).astype(np.float32)
    field = ndimage.gaussian_filter(fine, 2 * voxels)
    level = np.partition(field.ravel(), -8 * np.count_nonzero(whole))[-8 * np.count_nonzero(whole)]
    vertices, triangles, _, _ = marching_cubes(field, level)
    return shape.labels.grid.points((vertices + 0.5) / 2 - 0.5 - PAD), triangles


def drawn(shape: Shape, whole: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], float]:
    """The same of the function that drew the label, and the volume in it."""
    grid = shape.labels.grid
    size = 2 * (np.array(whole.shape) + 2 * PAD)
    points = grid.points((np.argwhere(np.ones(size)) + 0.5) / 2 - 0.5 - PAD)
    field = np.asarray(shape.exact(points), np.float32).reshape(size)
    vertices, triangles, _, _ = marching_cubes(field, 0.0)
    volume = np.prod(grid.spacing) / 8 * np.count_nonzero(field > 0)
    return (grid.points((vertices + 0.5) / 2 - 0.5 - PAD), triangles), float(volume)


def hausdorff(a: np.ndarray, of_a: np.ndarray, b: np.ndarray, of_b: np.ndarray, close: float) -> float:
    """Largest distance from any point of either surface to the other."""
    one, two = strewn(a, of_a, close), strewn(b, of_b, close)
    return max(cKDTree(one).query(two)[0].max(), cKDTree(two).query(one)[0].max())


def strewn(points: np.ndarray, triangles: np.ndarray, close: float) -> np.ndarray:
    """Points on a surface, about `close` apart, and its corners."""
    x = points[triangles]
    area = np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1) / 2
    rng = np.random.default_rng(0)
    many = rng.poisson(area / close**2)
    here = x[np.repeat(np.arange(len(x)), many)]
    u, v = rng.random((2, len(here)))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    inside = here[:, 0] + u[:, None] * (here[:, 1] - here[:, 0]) + v[:, None] * (here[:, 2] - here[:, 0])
    return np.concatenate([points[np.unique(triangles)], inside])


def volumes(mesh: pp.TetMesh) -> np.ndarray:
    x = mesh.nodes[mesh.tets]
    return np.linalg.det(x[:, 1:] - x[:, :1]) / 6


def dihedral(mesh: pp.TetMesh) -> float:
    """Degrees; inverted tets count as none."""
    x = mesh.nodes[mesh.tets]
    normal = [np.cross(x[:, j] - x[:, i], x[:, k] - x[:, i]) for i, j, k in FACES]
    normal = [n / np.linalg.norm(n, axis=1)[:, None] for n in normal]
    cosine = np.max([-(normal[i] * normal[j]).sum(axis=1) for i in range(4) for j in range(i)], axis=0)
    return float(np.degrees(np.arccos(np.clip(cosine.max(), -1, 1)))) if volumes(mesh).min() > 0 else 0.0


def skin(tets: np.ndarray) -> np.ndarray:
    faces = np.concatenate([tets[:, f] for f in FACES])
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    return faces[first[count == 1]]


def manifold(tets: np.ndarray) -> bool:
    """Whether no face has three tets, each edge of the skin two triangles, and each of its nodes one fan of them."""
    faces = np.sort(np.concatenate([tets[:, f] for f in FACES]), axis=1)
    if np.unique(faces, axis=0, return_counts=True)[1].max() > 2:
        return False
    outer = skin(tets)
    edges = np.sort(outer[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    if (np.unique(edges, axis=0, return_counts=True)[1] != 2).any():
        return False
    follow = {}
    for a, b, c in outer.tolist():
        for u, v, w in ((a, b, c), (b, c, a), (c, a, b)):
            follow.setdefault(u, {})[v] = w
    for steps in follow.values():
        start = at = next(iter(steps))
        walked = 0
        while walked < len(steps):
            at, walked = steps.get(at), walked + 1
            if at == start or at is None:
                break
        if walked != len(steps) or at != start:
            return False
    return True


if __name__ == "__main__":
    for line in lines(tuple(sys.argv[1:])):
        print(line, flush=True)
