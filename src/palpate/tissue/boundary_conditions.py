"""Fixed nodes: those that rest on a table, lie near a point, or beyond a plane."""

import numpy as np

from palpate.arrays import ArrayLike, Float64, Int32, float64
from palpate.errors import MaterialError
from palpate.meshes.tet_mesh import TetMesh

ON_PLANE = 1e-3  # mm


def resting_on(mesh: TetMesh, direction: ArrayLike, depth: float | None = None) -> Int32:
    """Return the surface nodes that lie on a table.

    Parameters
    ----------
    mesh : TetMesh
        The solid.
    direction : array_like, (3,)
        Towards the table, such as (0, 0, -1) for a table below.
    depth : float, optional
        How much nearer than the outermost node they may lie, mm. The default is 10 % of the mesh's extent, since a soft organ
        settles.

    Returns
    -------
    ndarray of int
        Node indices.

    Raises
    ------
    MaterialError
        If fewer than three nodes, or nodes on one line, lie there.

    Examples
    --------
    >>> len(pp.resting_on(mesh, (0, 0, -1))) > 3
    True
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


def fixed_near(mesh: TetMesh, point: ArrayLike, radius: float) -> Int32:
    """Return the surface nodes near a point, such as a clamp or a ligament.

    Join several patches by `np.union1d`.

    Parameters
    ----------
    mesh : TetMesh
        The solid.
    point : array_like, (3,)
        Point (x, y, z), mm.
    radius : float
        Largest distance, mm.

    Returns
    -------
    ndarray of int
        Node indices.

    Raises
    ------
    MaterialError
        If fewer than three nodes, or nodes on one line, lie there.

    Examples
    --------
    >>> len(pp.fixed_near(mesh, top, radius=15)) > 3
    True
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


def fixed_beyond(mesh: TetMesh, point: ArrayLike, normal: ArrayLike) -> Int32:
    """Return all nodes on or beyond a plane, inner nodes included.

    Parameters
    ----------
    mesh : TetMesh
        The solid.
    point : array_like, (3,)
        A point (x, y, z) of the plane, mm.
    normal : array_like, (3,)
        The side. (0, 0, -1) holds all that is lower than the point.

    Returns
    -------
    ndarray of int
        Node indices.

    Raises
    ------
    MaterialError
        If fewer than three nodes, or nodes on one line, lie there, or no node is left to move.

    Examples
    --------
    >>> low = pp.fixed_beyond(mesh, point=(0, 0, 15), normal=(0, 0, -1))
    >>> bool((mesh.nodes[low, 2] <= 15).all())
    True
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


def fixed_at_openings(mesh: TetMesh) -> Int32:
    """Return the nodes where the side of the volume cuts the wall of a hollow organ.

    Parameters
    ----------
    mesh : TetMesh
        The wall, as `hollow_mesh` makes it.

    Returns
    -------
    ndarray of int
        Node indices; none if the mesh is not hollow, or its lumen is closed.

    Examples
    --------
    >>> len(pp.fixed_at_openings(mesh))
    0
    """
    held = np.zeros(len(mesh.nodes), dtype=bool)
    for opening in () if mesh.centerline is None else mesh.centerline.openings:
        held |= np.abs((mesh.nodes - opening[:3]) @ opening[3:]) < ON_PLANE
    return np.flatnonzero(held).astype(np.int32)


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
