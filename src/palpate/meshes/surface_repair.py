"""Closed surfaces of triangles from other programs: read, repaired where that is safe, refused with a reason elsewhere."""

from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from palpate.arrays import Float64, Int64, float64
from palpate.errors import DataError, MeshError
from palpate.meshes.surface_files import read_surface_file
from palpate.meshes.surface_parts import joined_parts, solid_names
from palpate.meshes.tet_mesh import check_extent, row_keys
from palpate.meshes.triangle_surface import connected_groups

SAME = 1e-6  # of the surface's size: points closer than this are one; a float32 holds 1e-7
MOST = 1000  # solids: each takes a pass over all voxels

Surface = tuple[Float64, Int64, list[str]]


def read_solids(path: Path, hole: float) -> dict[str, Surface]:
    """The solids of a file by name, each of points (N, 3) mm, triangles (F, 3), and notes on repairs.

    Parts are the solids of a text STL, the regions of a PLY, the objects and groups of an OBJ, the primitives of glTF's
    nodes. Each is a solid, but parts that meet at open edges are pieces of one. Holes up to `hole` mm across are
    closed. Each edge has an even number of triangles; which side of them is outside is not asked. Raises `FileError`,
    `DataError`, and `MeshError` for a surface that is open.
    """
    points, triangles, part, parts = read_surface_file(path)
    try:
        points = float64("points", points, (None, 3))
        check_extent(points)
        if len(triangles) == 0:
            raise MeshError("no triangles; save the surface as triangles")
        if triangles.min() < 0 or triangles.max() >= len(points):
            raise MeshError(f"a triangle names a point that is none of the {len(points)}; write the surface again")
        notes: list[str] = []
        points, triangles, part = _merged(points, triangles, part, notes)
        members = joined_parts(triangles, part)
        if len(members) > MOST:
            raise MeshError(f"{len(members)} closed surfaces, expected {MOST} at most; join those that are one organ")
        names = [path.stem] if len(members) == 1 else solid_names(list(members.values()), parts, path.stem)
        order = np.argsort(part, kind="stable")
        first = np.searchsorted(part[order], np.arange(len(parts) + 1))
        made: dict[str, Surface] = {}
        for name, numbers in zip(names, members.values(), strict=True):
            own = triangles[np.concatenate([order[first[n] : first[n + 1]] for n in numbers])]
            used, index = np.unique(own, return_inverse=True)
            said = name if len(names) > 1 else ""  # a file of one solid says enough by its own name
            made[name] = _closed(points[used], index.reshape(own.shape).astype(np.int64), hole, said)
        made[names[0]][2][:0] = notes
        return made
    except (DataError, MeshError) as problem:
        raise type(problem)(f"{path}: {problem}") from None


def _merged(points: Float64, triangles: Int64, part: Int64, notes: list[str]) -> tuple[Float64, Int64, Int64]:
    """Points at one place become one; triangles with two corners there, and those twice in a part, are dropped."""
    used, index = np.unique(triangles, return_inverse=True)
    points, triangles = points[used], index.reshape(triangles.shape).astype(np.int64)
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    pairs = cKDTree(points).query_pairs(SAME * size, output_type="ndarray")
    if len(pairs):
        _, group = connected_groups(len(points), pairs.astype(np.int64))
        _, first = np.unique(group, return_index=True)
        triangles, points = group[triangles], points[first]
    corners = np.sort(triangles, axis=1)
    flat = (corners[:, 1:] == corners[:, :-1]).any(axis=1)
    triangles, part, corners = triangles[~flat], part[~flat], corners[~flat]
    if flat.any():
        notes.append(f"{np.count_nonzero(flat)} triangles without area: dropped")
    _, first = np.unique(row_keys(np.column_stack([corners, part])), return_index=True)
    if len(first) < len(triangles):
        notes.append(f"{len(triangles) - len(first)} triangles that are there twice: dropped")
    if len(first) == 0:
        raise MeshError("all triangles are without area; check the units and the export")
    kept = np.sort(first)
    return points, triangles[kept], part[kept]


def _closed(points: Float64, triangles: Int64, hole: float, name: str) -> Surface:
    """The surface with fans over the holes that are small. name: of one of several, for messages."""
    named = f"{name}: " if name else ""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    kinds, count = np.unique(edges, axis=0, return_counts=True)
    rim = kinds[count % 2 == 1]
    if len(rim) == 0:
        return points, triangles, []
    fans, widest = [], 0.0
    _, part = connected_groups(len(points), rim)
    for number in np.unique(part[rim[:, 0]]):
        loop = rim[part[rim[:, 0]] == number]
        corners = np.unique(loop)
        width = float(np.ptp(points[corners], axis=0).max())
        where = points[corners].mean(axis=0).round(1).tolist()
        if width > hole:
            raise MeshError(
                f"{named}not closed: a hole {width:.3g} mm across near {where} mm, {len(loop)} of {len(rim)} open edges; "
                f"holes up to {hole:.3g} mm are closed: close it in the program that made it"
            )
        anchor = corners[0]
        fans += [[anchor, a, b] for a, b in loop if anchor not in (a, b)]
        widest = max(widest, width)
    note = f"{named}{len(np.unique(part[rim[:, 0]]))} holes, the widest {widest:.3g} mm across: closed"
    return points, np.concatenate([triangles, np.array(fans, np.int64).reshape(-1, 3)]), [note]
