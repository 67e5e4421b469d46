"""Blades at random, and how much of a blade lies in a mesh."""

import numpy as np

import palpate as pp

THROUGH = ("through", "nearly flat")
KINDS = ("straight", "curved", "crossing", *THROUGH, "grazing")


def area_within(blade, mesh):
    """mm² of a blade's triangles within the tetrahedra of a mesh, clipped by the four half-spaces of each."""
    x = mesh.nodes[mesh.tets]
    a, b, c = (x[:, [(k + j) % 4 for k in range(4)]] for j in (1, 2, 3))
    normal = np.cross(b - a, c - a)  # (M, 4, 3) of the face that each corner does not have, then turned inwards
    normal *= np.sign(((x - a) * normal).sum(axis=2))[:, :, None]
    offset = (normal * a).sum(axis=2)
    total = 0.0
    for corners in blade.points[blade.triangles]:
        near = ((x.min(axis=1) <= corners.max(axis=0)) & (x.max(axis=1) >= corners.min(axis=0))).all(axis=1)
        near &= ((normal @ corners.T - offset[:, :, None]).max(axis=2) > 0).all(axis=1)
        for normals, offsets in zip(normal[near], offset[near], strict=True):
            total += _area(_clipped(corners, normals, offsets))
    return total


def _clipped(polygon, normals, offsets):
    for normal, offset in zip(normals, offsets, strict=True):
        if len(polygon) < 3:
            return []
        height = (np.array(polygon) @ normal - offset).tolist()
        kept = []
        for i, (p, h) in enumerate(zip(polygon, height, strict=True)):
            q, g = polygon[i - 1], height[i - 1]
            if (g > 0) != (h > 0):
                kept.append(q + g / (g - h) * (p - q))
            if h > 0:
                kept.append(p)
        polygon = kept
    return polygon


def _area(polygon):
    if len(polygon) < 3:
        return 0.0
    spokes = np.array(polygon[1:]) - polygon[0]
    return float(np.linalg.norm(np.cross(spokes[:-1], spokes[1:]).sum(axis=0)) / 2)


def distance(points, blade):
    """(n,) mm from points to a blade's triangles, by projection onto each triangle, its edges and its corners."""
    best = np.full(len(points), np.inf)
    for a, b, c in blade.points[blade.triangles]:
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal)
        inside = np.ones(len(points), dtype=bool)
        for p, q in ((a, b), (b, c), (c, a)):
            inside &= (points - p) @ np.cross(normal, q - p) >= 0
            t = np.clip((points - p) @ (q - p) / ((q - p) @ (q - p)), 0, 1)
            best = np.minimum(best, np.linalg.norm(points - p - t[:, None] * (q - p), axis=1))
        best = np.where(inside, np.minimum(best, np.abs((points - a) @ normal)), best)
    return best


def random_blades(mesh, rng):
    """(kind, blades) straight, curved, crossing, through; nearly flat, which is through, of parts that lie in one plane but
    for very little; or grazing, which passes three nodes by very little."""
    low, high = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
    size = float(np.linalg.norm(high - low))
    kind = str(rng.choice(KINDS))
    if kind == "grazing":
        return kind, [_grazing(mesh, rng, size)]
    blades = [_sweep(rng, low, high, size, kind) for _ in range(2 if kind == "crossing" else 1)]
    return kind, blades


def _sweep(rng, low, high, size, kind):
    at = rng.uniform(low, high)
    way, along = np.linalg.qr(rng.standard_normal((3, 2)))[0].T
    if kind in THROUGH:
        places = np.sort(rng.uniform(-0.5, 0.5, 0 if kind == "through" else int(rng.integers(3, 12))))
        path = at + size * np.outer([-1, *places, 1], along)
        path += 10.0 ** rng.uniform(-12, -1) * np.outer(rng.standard_normal(len(path)), np.cross(way, along))
        return pp.Blade.swept(path - size * way, way, 2 * size)
    length, depth = rng.uniform(0.1, 0.7, 2) * size
    line = np.linspace(-0.5, 0.5, 2 if kind != "curved" else int(rng.integers(3, 16)))
    path = at + np.outer(length * line, along)
    if kind == "curved":
        path += np.outer(rng.uniform(-1, 1) * length * (line**2 - 0.25), np.cross(way, along))
    return pp.Blade.swept(path - rng.uniform(0, 1) * depth * way, way, depth)


def _grazing(mesh, rng, size):
    a, b, c = mesh.nodes[rng.choice(mesh.tets[rng.integers(len(mesh.tets))], 3, replace=False)]
    along, way = b - a, c - a
    aside = np.cross(along, way)
    at = a + aside / np.linalg.norm(aside) * 10.0 ** rng.uniform(-12, -1)
    along, way = along / np.linalg.norm(along), way / np.linalg.norm(way)
    lengths = rng.uniform(0.05, 0.6, 2) * size
    path = at + np.outer(rng.uniform(0, 1) * lengths[0] + np.array([-1, 0]) * lengths[0], along)
    return pp.Blade.swept(path - rng.uniform(0, 1) * lengths[1] * way, way, lengths[1])
