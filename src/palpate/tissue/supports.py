"""Supports chosen on the organ: the nodes that rest on a table, lie beyond a plane, or near a point."""

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import Float64, Int32, float64
from palpate.errors import MaterialError
from palpate.meshes.mesh import TetMesh


def resting_on(mesh: TetMesh, direction: ArrayLike, depth: float | None = None) -> Int32:
    """Indices of the surface nodes that lie on a table in `direction`, such as (0, 0, -1) for a table below.

    They face the table and are at most `depth` mm nearer than the outermost node; None: 10 % of the mesh's extent that
    way, since a soft organ settles until it lies broadly (held by its tip alone it would tilt at a touch).
    Raises `MaterialError` when fewer than three nodes, or nodes on one line, lie there.
    """
    way = _unit("direction", direction, "the way to the table")
    if depth is not None and not (np.isfinite(depth) and depth >= 0):
        raise MaterialError(f"depth: {depth} mm; give a finite depth of 0 or more")
    height, surface = mesh.nodes @ way, mesh.surface_nodes
    reach = 0.1 * float(np.ptp(height)) if depth is None else depth
    corners = mesh.nodes[mesh.surface]
    facing = np.zeros(len(mesh.nodes))
    for k in range(3):  # area-weighted, as the contact's normals
        np.add.at(
            facing, mesh.surface[:, k], np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ way
        )
    low = height[surface] >= height.max() - reach - 1e-9 * float(np.ptp(height))
    on_table = surface[low & (facing[surface] > 1e-9 * np.abs(facing).max())]
    if rigid_rank(mesh.nodes[on_table]) < 6:
        raise MaterialError(
            f"only {len(on_table)} nodes, or nodes on one line, lie within {reach:g} mm of the table in direction "
            f"{way.tolist()}; give a larger depth, such as depth={max(2 * reach, 1.0):g}"
        )
    nodes: Int32 = on_table.astype(np.int32)
    return nodes


def held_near(mesh: TetMesh, point: ArrayLike, radius: float) -> Int32:
    """Indices of the surface nodes within `radius` mm of `point` (3,) mm: a clamp, a finger, a ligament.

    One such patch holds the organ alone, or join several: `np.union1d(held_near(...), held_near(...))`.
    Raises `MaterialError` when fewer than three nodes, or nodes on one line, lie there.
    """
    centre = float64("point", point, (3,))
    if not (np.isfinite(radius) and radius > 0):
        raise MaterialError(f"radius: {radius} mm; give a finite radius above 0")
    surface = mesh.surface_nodes
    apart = np.linalg.norm(mesh.nodes[surface] - centre, axis=1)
    near: Int32 = surface[apart <= radius].astype(np.int32)
    if rigid_rank(mesh.nodes[near]) < 6:
        third = float(np.sort(apart)[2])
        raise MaterialError(
            f"only {len(near)} nodes, or nodes on one line, lie within {radius:g} mm of {centre.tolist()}; the nearest "
            f"surface node is {apart.min():.3g} mm away: give a radius above {max(third, radius):.3g}, or another point"
        )
    return near


def held_beyond(mesh: TetMesh, point: ArrayLike, normal: ArrayLike) -> Int32:
    """Indices of all nodes, inner ones too, on or beyond the plane through `point` (3,) mm, on the side of `normal`.

    So (0, 0, -1) holds all that is lower than the point, as if cast in plaster up to there.
    Raises `MaterialError` when fewer than three nodes, or nodes on one line, lie there, or no node is left to move.
    """
    way = _unit("normal", normal, "the way to the side that is held")
    height = (mesh.nodes - float64("point", point, (3,))) @ way
    beyond: Int32 = np.flatnonzero(height >= -1e-9 * float(np.ptp(height))).astype(np.int32)
    found = f"{len(beyond)} of {len(mesh.nodes)} nodes lie beyond the plane; from it the mesh reaches"
    if rigid_rank(mesh.nodes[beyond]) < 6 or len(beyond) == len(mesh.nodes):
        raise MaterialError(
            f"{found} {height.min():.3g} to {height.max():.3g} mm along the normal: move the point so that three or "
            f"more nodes that are not on one line are held, and some are not"
        )
    return beyond


def rigid_rank(points: Float64) -> int:
    """How many of the six rigid motions move at least one of `points` (n, 3)."""
    if len(points) == 0:
        return 0
    x = points - points.mean(axis=0)
    x = x / max(float(np.abs(x).max()), 1e-300)
    moves = np.zeros((len(x), 3, 6))
    moves[:, :, :3] = np.eye(3)
    for k in range(3):
        moves[:, :, 3 + k] = np.cross(np.eye(3)[k], x)
    return int(np.linalg.matrix_rank(moves.reshape(-1, 6), tol=1e-6 * np.sqrt(len(x))))


def _unit(name: str, direction: ArrayLike, what: str) -> Float64:
    way = float64(name, direction, (3,))
    length = float(np.linalg.norm(way))
    if length == 0:
        raise MaterialError(f"{name}: (0, 0, 0) points nowhere; give {what}, such as (0, 0, -1)")
    return np.asarray(way / length)
