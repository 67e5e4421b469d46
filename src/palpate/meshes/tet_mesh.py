"""The tetrahedral mesh."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from palpate.arrays import ArrayLike, Float64, Int32, Int64, as_numpy, float64
from palpate.errors import MeshError
from palpate.meshes.triangle_surface import connected_groups
from palpate.volumes.centerline import Centerline

FAR = 1e9  # mm; products of three such lengths are still numbers
FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])  # of a tet, normals outwards


@dataclass(frozen=True, eq=False, init=False)
class TetMesh:
    """A mesh of tetrahedra with labelled regions.

    Parameters
    ----------
    nodes : array_like, (N, 3)
        Positions (x, y, z), mm.
    tets : array_like, (M, 4)
        Node indices of each tetrahedron, positively oriented.
    region : array_like, (M,), optional
        Label of each tetrahedron.
    names : dict of int to str, optional
        Name of each region.
    centerline : Centerline, optional
        Of the lumen inside, if the mesh is the wall of a hollow organ.

    Raises
    ------
    MeshError
        If an index is out of range, a tetrahedron is inverted, flat or there twice, or a node is unused.

    Examples
    --------
    >>> one = pp.TetMesh([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [(0, 1, 2, 3)])
    >>> len(one.surface), one.volumes.round(4)
    (4, array([0.1667]))
    """

    nodes: Float64
    tets: Int32
    region: Int32
    names: dict[int, str]
    centerline: Centerline | None

    def __init__(
        self,
        nodes: ArrayLike,
        tets: ArrayLike,
        region: ArrayLike | None = None,
        names: dict[int, str] | None = None,
        centerline: Centerline | None = None,
    ) -> None:
        x = float64("nodes", nodes, (None, 3)).copy()
        check_extent(x)
        t = np.array(as_numpy("tets", tets))
        if t.ndim != 2 or t.shape[1] != 4 or len(t) == 0 or t.dtype.kind not in "iu":
            raise MeshError(f"tets: expected whole numbers of shape (M, 4) with M > 0, got {t.shape} {t.dtype}")
        if t.min() < 0 or t.max() >= len(x):
            bad = int(np.flatnonzero((t < 0).any(axis=1) | (t >= len(x)).any(axis=1))[0])
            raise MeshError(f"tet {bad} names node {t[bad].tolist()}, but nodes are 0 to {len(x) - 1}")
        volume = signed_volumes(x, t)
        if (volume <= 0).any():
            bad = int(np.flatnonzero(volume <= 0)[0])
            raise MeshError(
                f"{np.count_nonzero(volume <= 0)} tets inverted or flat (first: tet {bad}, nodes {t[bad].tolist()}, "
                f"volume {volume[bad]:g} mm³); swap two nodes of an inverted tet, remove flat ones"
            )
        used = np.zeros(len(x), dtype=bool)
        used[t] = True
        if not used.all():
            raise MeshError(f"{np.count_nonzero(~used)} nodes belong to no tet (first: {int(np.argmin(used))})")
        labels = (
            np.ones(len(t), dtype=np.int32) if region is None else np.array(as_numpy("region", region), dtype=np.int32)
        )
        if labels.shape != (len(t),):
            raise MeshError(f"region: expected one label a tet, shape ({len(t)},), got {labels.shape}")
        _check_twice(t)
        for name, value in (("nodes", x), ("tets", t.astype(np.int32)), ("region", labels)):
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        object.__setattr__(self, "names", dict(names or {}))
        object.__setattr__(self, "centerline", centerline)

    @cached_property
    def surface(self) -> Int32:
        """Boundary triangles (F, 3), oriented so that normals point outwards."""
        return boundary_faces(self.tets)

    @cached_property
    def shared_faces(self) -> tuple[Int64, Int64]:
        """(f, 2) tetrahedra that share a face, and (f, 3) that face, sorted."""
        return shared_faces(self.tets.astype(np.int64))

    @cached_property
    def parts(self) -> tuple[int, Int64]:
        """Number of parts that hang together through faces, and the part of each tetrahedron, (M,)."""
        return connected_groups(len(self.tets), self.shared_faces[0])

    @cached_property
    def surface_nodes(self) -> Int32:
        """Sorted indices of the nodes on the surface."""
        return np.unique(self.surface).astype(np.int32)

    @property
    def boundary(self) -> tuple[Float64, Int32]:
        """Vertices (S, 3), mm, and triangles (F, 3) of the surface, also of a mesh that has been cut."""
        return self.nodes, self.surface

    @property
    def filled(self) -> Float64 | float:
        """Part of each tetrahedron's volume that is there, (M,): 1.0, all of it, but in a mesh that has been cut."""
        return 1.0

    @cached_property
    def volumes(self) -> Float64:
        """Volume of each tetrahedron, (M,), mm³."""
        return signed_volumes(self.nodes, self.tets)

    def _repr_html_(self) -> str:
        from palpate.meshes.mesh_card import mesh_card  # only a notebook asks

        return mesh_card(self, region_faces(self))


def check_extent(nodes: Float64) -> None:
    """Raises `MeshError` for nodes so far away that their volumes are no numbers."""
    far = float(np.abs(nodes).max(initial=0))
    if far > FAR:
        raise MeshError(f"nodes lie up to {far:.3g} mm from the origin, expected {FAR:g} at most; check the units")


def _check_twice(tets: Int64) -> None:
    """Raises `MeshError` if two tets have the same corners."""
    key = row_keys(np.sort(tets, axis=1))
    order = np.argsort(key, kind="stable")
    again = np.flatnonzero(key[order][1:] == key[order][:-1])
    if len(again):
        a, b = sorted(order[again[0] : again[0] + 2].tolist())
        raise MeshError(
            f"{len(again)} tets are there twice (first: tets {a} and {b}, nodes {tets[a].tolist()}); remove them"
        )


def signed_volumes(nodes: Float64, tets: ArrayLike) -> Float64:
    """(M,) mm³, positive where the fourth node lies on the side from which the first three run anticlockwise."""
    a, b, c, d = (nodes[np.asarray(tets)[:, i]] for i in range(4))
    volumes: Float64 = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6
    return volumes


def row_keys(rows: Int32 | Int64) -> Int64:
    """(P,) one number for each row (P, k) of numbers from 0 on: equal rows, equal numbers, in the rows' order."""
    base = int(rows.max(initial=0)) + 1
    if float(base) ** rows.shape[1] >= 2.0**63:
        order = np.unique(rows, axis=0, return_inverse=True)[1]
        return np.asarray(order, dtype=np.int64).ravel()
    key = rows[:, 0].astype(np.int64)
    for column in rows.T[1:]:
        key = key * base + column
    return key


def shared_faces(tets: Int64) -> tuple[Int64, Int64]:
    """(f, 2) of the tetrahedra (M, 4) that share a face, and (f, 3) that face, sorted."""
    faces = np.sort(np.concatenate([np.delete(tets, k, axis=1) for k in range(4)]), axis=1)
    owner = np.tile(np.arange(len(tets)), 4)
    key = row_keys(faces)
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(key[order][1:] == key[order][:-1])
    return np.stack([owner[order[same]], owner[order[same + 1]]], axis=1), faces[order[same]]


def folds(tets: ArrayLike) -> Int64:
    """(P, 2) pairs of positively oriented tets that lie on the same side of a face they share: they overlap."""
    t = np.asarray(tets)
    faces = t[:, FACES].reshape(-1, 3)
    owner = np.repeat(np.arange(len(t)), 4)
    low = np.argmin(faces, axis=1)  # the winding: whether the face rises from its lowest node on
    turned = np.take_along_axis(faces, (low[:, None] + [[0, 1, 2]]) % 3, axis=1)
    rises = turned[:, 1] < turned[:, 2]
    key = row_keys(np.sort(faces, axis=1))
    order = np.argsort(key, kind="stable")
    same = (key[order][1:] == key[order][:-1]) & (rises[order][1:] == rises[order][:-1])
    return np.stack([owner[order][:-1][same], owner[order][1:][same]], axis=1).astype(np.int64)


def boundary_faces(tets: Int32) -> Int32:
    """(F, 3) faces that belong to exactly one tet, normals outwards; a face of three tets or more is a `MeshError`."""
    faces = np.concatenate([tets[:, face] for face in FACES])
    key = np.sort(faces, axis=1)
    _, first, count = np.unique(row_keys(key), return_index=True, return_counts=True)
    if (count > 2).any():
        bad = key[first[np.argmax(count)]]
        raise MeshError(
            f"face {bad.tolist()} is shared by {count.max()} tets, at most 2 can meet there; remove overlapping tets"
        )
    return np.ascontiguousarray(faces[np.sort(first[count == 1])])


def region_faces(mesh: TetMesh) -> dict[int, Int32]:
    """Triangles around each region inside another, by label: all regions but the largest."""
    others = regions_by_size(mesh)[1:]
    return {label: boundary_faces(np.ascontiguousarray(mesh.tets[mesh.region == label])) for label in others}


def regions_by_size(mesh: TetMesh) -> list[int]:
    """Labels of the regions: that of the most tetrahedra, then the others in order."""
    labels, count = np.unique(mesh.region, return_counts=True)
    largest = int(labels[np.argmax(count)])
    return [largest, *(label for label in labels.tolist() if label != largest)]
