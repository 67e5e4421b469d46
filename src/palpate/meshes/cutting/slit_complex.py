"""Splits tetrahedra at edges until a blade's surface is a set of their faces."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from palpate.arrays import Bool, Float64, Int64
from palpate.meshes.cutting.blade import Blade
from palpate.meshes.tet_mesh import TetMesh

ON = 1e-9  # of the mesh's extent: what lies so near to a plane lies on it

Face = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class Triangle:
    """A triangle of a blade: its corners (3, 3) mm, unit normal, and the normals of its sides (3, 3), out of it."""

    corners: Float64
    normal: Float64
    outwards: Float64

    @classmethod
    def of(cls, corners: Float64) -> "Triangle":
        """The triangle with these corners (3, 3) mm."""
        along = corners[[1, 2, 0]] - corners
        normal = np.cross(along[0], along[1])
        normal /= np.linalg.norm(normal)
        outwards = np.cross(along, normal)
        return cls(corners, normal, outwards / np.linalg.norm(outwards, axis=1, keepdims=True))

    def heights(self, x: Float64) -> Float64:
        """(...,) mm above the plane, of points (..., 3)."""
        return np.asarray((x - self.corners[0]) @ self.normal)

    def beyond(self, x: Float64, side: int) -> Float64:
        """(...,) mm out of the triangle over its side, of points (..., 3)."""
        return np.asarray((x - self.corners[side]) @ self.outwards[side])

    def meets(self, x: Float64, near: float) -> Bool:
        """(n,) False for tetrahedra (n, 4, 3) mm that surely lie more than `near` mm from the triangle."""
        height = self.heights(x)
        met = (height.min(axis=1) <= near) & (height.max(axis=1) >= -near)
        low, high = self.corners.min(axis=0) - near, self.corners.max(axis=0) + near
        met &= ((x.min(axis=1) <= high) & (x.max(axis=1) >= low)).all(axis=1)
        for side in range(3):
            met &= self.beyond(x, side).min(axis=1) <= near
        return np.asarray(met)


class SlitComplex:
    """Tetrahedra into which those of a mesh are split, and the faces among them that a blade has passed.

    Only edges are split, each together with all tetrahedra around it, so that neighbours always fit. What side of a
    plane a point is on is decided once, when it is made: rounding cannot contradict itself.

    support: of each point, the nodes of the mesh (at most 4) between which it lies, and its weights. parent: of each
    tetrahedron, that of the mesh. cut: the faces, by their sorted points, and the blade's normal there.
    """

    def __init__(self, mesh: TetMesh) -> None:
        self.support: list[dict[int, float]] = [{node: 1.0} for node in range(len(mesh.nodes))]
        self.parent = list(range(len(mesh.tets)))
        self.cut: dict[Face, Float64] = {}
        self._mesh = mesh
        self._places, self._corners = mesh.nodes.copy(), mesh.tets.astype(np.int64)  # with room for more
        self._pieces = [[tet] for tet in range(len(mesh.tets))]
        self._around: list[set[int]] = [set() for _ in mesh.nodes]
        for tet, nodes in enumerate(mesh.tets.tolist()):
            for node in nodes:
                self._around[node].add(tet)
        self._on = ON * float(np.ptp(mesh.nodes, axis=0).max())
        self._active: set[int] = set()

    @property
    def places(self) -> Float64:
        """(points, 3) mm."""
        return self._places[: len(self.support)]

    @property
    def corners(self) -> Int64:
        """(tetrahedra, 4) points, positively oriented."""
        return self._corners[: len(self.parent)]

    def slit(self, blade: Blade) -> None:
        """Cuts along the blade."""
        x = self._mesh.nodes[self._mesh.tets]
        low, high = blade.points.min(axis=0) - self._on, blade.points.max(axis=0) + self._on
        close = np.flatnonzero(((x.min(axis=1) <= high) & (x.max(axis=1) >= low)).all(axis=1))
        x = x[close]
        for corners in blade.points[blade.triangles]:
            triangle = Triangle.of(corners)
            self._slit(triangle, close[triangle.meets(x, self._on)])

    def _slit(self, triangle: Triangle, near: Int64) -> None:
        pieces = np.array([piece for tet in near for piece in self._pieces[tet]], dtype=np.int64)
        met = pieces[triangle.meets(self.places[self.corners[pieces]], self._on)]
        if len(met) == 0:
            return
        self._active = set(met.tolist())
        height = self._split_across(triangle.heights, self.corners[met])
        out = np.zeros(len(height), dtype=bool)
        inside = self._faces_on(height)
        for side in range(3):
            beyond = self._split_across(partial(triangle.beyond, side=side), inside)
            new = len(beyond) - len(height)  # points on edges that no side so far has left out
            height, out = np.pad(height, (0, new)), np.pad(out, (0, new)) | (beyond > 0)
            inside = self._faces_on(height)
            inside = inside[~out[inside].any(axis=1)]
        for a, b, c in inside.tolist():
            if len(self._around[a] & self._around[b] & self._around[c]) == 2:
                self.cut[a, b, c] = triangle.normal
        self._active = set()

    def _split_across(self, distance: Callable[[Float64], Float64], cells: Int64) -> Int64:
        """Splits those edges of cells (n, 3 or 4) that go from one side to the other; -1, 0 or 1 for each point then."""
        far = distance(self.places)
        side = np.where(np.abs(far) <= self._on, 0, np.sign(far)).astype(np.int64)
        pairs = [(i, j) for i in range(cells.shape[1]) for j in range(i)]
        edges = np.sort(np.concatenate([cells[:, pair] for pair in pairs]), axis=1)
        edges = np.unique(edges[side[edges].prod(axis=1) < 0], axis=0)
        part = far[edges[:, 0]] / (far[edges[:, 0]] - far[edges[:, 1]])
        for (a, b), t in zip(edges.tolist(), part.tolist(), strict=True):
            self.split(a, b, t)
        return np.pad(side, (0, len(edges)))

    def _faces_on(self, side: Int64) -> Int64:
        """(f, 3) sorted points of the faces of active tetrahedra that have no point off the plane."""
        corners = self.corners[np.fromiter(self._active, dtype=np.int64)]
        faces = np.concatenate([np.delete(corners, k, axis=1) for k in range(4)])
        return np.unique(np.sort(faces[(side[faces] == 0).all(axis=1)], axis=1), axis=0)

    def split(self, a: int, b: int, t: float) -> int:
        """The number of a new point at (1 − t) a + t b: each tetrahedron of the edge ab becomes two."""
        point = len(self.support)
        if point == len(self._places):
            self._places = np.concatenate([self._places, np.empty_like(self._places)])
        self._places[point] = (1 - t) * self._places[a] + t * self._places[b]
        weight = {node: (1 - t) * w for node, w in self.support[a].items()}
        for node, w in self.support[b].items():
            weight[node] = weight.get(node, 0.0) + t * w
        self.support.append(weight)
        self._around.append(set())
        ring = sorted(self._around[a] & self._around[b])
        link: set[int] = set()
        for k in ring:
            link |= self._halve(k, a, b, point)
        for c in link:
            normal = self.cut.pop(_face(a, b, c), None)
            if normal is not None:
                self.cut[_face(a, point, c)] = self.cut[_face(point, b, c)] = normal
        return point

    def _halve(self, k: int, a: int, b: int, point: int) -> set[int]:
        """Makes two tetrahedra of one at its edge ab; returns its other two corners."""
        other, corners = len(self.parent), self._corners[k].tolist()
        if other == len(self._corners):
            self._corners = np.concatenate([self._corners, np.empty_like(self._corners)])
        self._corners[other] = self._corners[k]
        self._corners[k, corners.index(b)] = self._corners[other, corners.index(a)] = point
        self.parent.append(self.parent[k])
        self._pieces[self.parent[k]].append(other)
        self._around[b].discard(k)
        self._around[point] |= {k, other}
        corners.remove(a)
        for v in corners:
            self._around[v].add(other)
        corners.remove(b)
        if k in self._active:
            self._active.add(other)
        return set(corners)


def _face(a: int, b: int, c: int) -> Face:
    low, middle, high = sorted((a, b, c))
    return low, middle, high
