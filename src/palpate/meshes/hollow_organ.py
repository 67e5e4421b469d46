"""Walls of hollow organs: layers of tetrahedra around a lumen."""

import warnings
from typing import Any

import numpy as np
from scipy import ndimage, sparse

from palpate.arrays import Bool, Float64, Int32, Int64
from palpate.errors import DataError, MeshError
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
from palpate.meshes.tetrahedralize import tetrahedralize
from palpate.meshes.triangle_surface import connected_groups
from palpate.volumes.centerline import centerline
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Labels

LAYERS = 2
BEYOND = 3.0  # edges: by so much an open lumen is continued, to be cut off again
NEAR_RIM = 0.3  # of an edge: vertices so near to the plane of an opening go into it
SHORT = 0.3  # of an edge: vertices of a rim that are so near to each other are one
ROUNDS = 30  # of thinning where the wall would fold, and of turning normals
UPRIGHT, AIM = 0.3, 0.5  # cosine between a vertex's normal and its triangles' at least, and what is tried for
THINNER = 0.8
SLIVER = 0.1  # twice a triangle's area over the square of its longest side, at least
SLOPE = 0.5  # of the thickness along the wall, where it is thinner
FOLDED = 0.1  # of the volume that an element has where the wall is flat
WARN_BELOW, WARN_SHARE = 0.8, 0.02  # of the thickness; of the nodes


def hollow_mesh(
    labels: Labels, label: int | str, wall: float, edge: float | None = None, *, layers: int = LAYERS
) -> TetMesh:
    """Mesh the wall of a hollow organ from the label of its lumen, such as an airway, a colon or a vessel.

    The lumen's surface is triangulated, and moved outwards along its normals layer by layer. Where a side of the volume
    cuts the lumen, the wall is open. Where walls would go through each other or fold, they are thinner; a warning says so.

    Parameters
    ----------
    labels : Labels
        The labels. Of several parts of the label the largest counts.
    label : int or str
        The lumen, by number or name.
    wall : float
        Thickness of the wall, mm.
    edge : float, optional
        Length of an element edge along the wall, mm. The default is the thickness.
    layers : int, optional
        Elements across the wall.

    Returns
    -------
    TetMesh
        The wall, with the `centerline` of its lumen.

    Raises
    ------
    DataError
        If the label is absent, or the thickness or the number of layers is not positive.
    MeshError
        If the lumen is too narrow for the edge, or the wall cannot be laid around it.

    Examples
    --------
    >>> wall = pp.hollow_mesh(labels, "lump", wall=3, edge=5)
    >>> wall.names
    {1: 'lump wall'}
    """
    if not (np.isfinite(wall) and wall > 0):
        raise DataError(f"wall: expected a positive thickness in mm, got {wall!r}")
    if layers < 1:
        raise DataError(f"layers: expected 1 or more, got {layers!r}")
    value = labels.value_of(label)
    line = centerline(labels, value)
    edge = wall if edge is None else edge
    filled = tetrahedralize(_longer(labels, value, line.openings, edge), value, edge, closed_at_border=True)
    places, triangles = _compact(filled.nodes, filled.surface.astype(np.int64))
    places, triangles, rim = _open(places, triangles, line.openings, edge)
    places, out = _normals(places, triangles, rim)
    thickness = _room(labels, value, places, out, wall)
    tets = _prisms(triangles, len(places), layers)
    for _ in range(ROUNDS):
        nodes = np.concatenate([places + (k / layers) * thickness[:, None] * out for k in range(layers + 1)])
        volumes = signed_volumes(nodes, tets)
        folded = volumes < FOLDED * _flat_volumes(places, triangles, thickness, layers)
        if not folded.any():
            break
        thickness[np.unique(tets[folded] % len(places))] *= THINNER
        _slope(thickness, places, triangles)
    else:
        raise MeshError(f"wall: {wall:g} mm around {label!r} folds; take a thinner wall or a longer edge")
    thin = np.count_nonzero(thickness < WARN_BELOW * wall)
    if thin > WARN_SHARE * len(thickness):
        warnings.warn(
            f"the wall of {label!r} is thinner than {WARN_BELOW:.0%} of {wall:g} mm at {thin / len(thickness):.0%} of "
            f"its places, where it would fold or meet itself; down to {thickness.min():.2g} mm",
            stacklevel=2,
        )
    name = f"{labels.names.get(value, 'lumen')} wall"
    return TetMesh(nodes, tets, np.ones(len(tets), dtype=np.int32), {1: name}, line)


def _longer(labels: Labels, value: int, openings: Float64, edge: float) -> Labels:
    """The lumen, continued by some edges through its openings, so that their rims are not rounded."""
    out = openings[:, 3:] @ labels.grid.direction  # along x, y and z of the grid
    pads = []
    for axis, spacing in enumerate(labels.grid.spacing):
        more = int(np.ceil(BEYOND * edge / spacing))
        along = out[:, 2 - axis]
        pads.append((more * int((along < -0.5).any()), more * int((along > 0.5).any())))
    inside = np.pad((labels.values == value).astype(np.int32) * value, pads, mode="edge")
    first = labels.grid.points(-np.array([low for low, _ in pads], dtype=np.float64)).ravel()
    return Labels(inside, Grid(inside.shape, labels.grid.spacing, first, labels.grid.direction), labels.names)


def _open(places: Float64, triangles: Int64, openings: Float64, edge: float) -> tuple[Float64, Int64, Float64]:
    """Vertices and triangles up to the planes of openings, and the normal (S, 3) of the opening at each vertex of a rim."""
    rim = np.zeros_like(places)
    for opening in openings:
        point, out = opening[:3], opening[3:]
        beyond = (places - point) @ out
        kept = beyond[triangles].mean(axis=1) < 0
        at = np.intersect1d(triangles[kept], np.union1d(triangles[~kept], np.flatnonzero(beyond > -NEAR_RIM * edge)))
        places[at] -= beyond[at, None] * out
        rim[at] = out
        flat = np.isin(triangles, at).all(axis=1)
        triangles = triangles[kept & ~flat]
        ends = _sides(triangles)
        ends = ends[np.isin(ends, at).all(axis=1)]
        short = np.linalg.norm(places[ends[:, 0]] - places[ends[:, 1]], axis=1) < SHORT * edge
        _, group = connected_groups(len(places), ends[short])
        triangles = np.unique(group, return_index=True)[1][group][triangles]
        kept = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
        triangles = triangles[kept]
    if not len(triangles):
        raise MeshError("wall: nothing of the lumen is left between its openings; take a shorter edge")
    places, triangles, rim = _compact(places, triangles, rim)
    edges = np.sort(_sides(triangles), axis=1)
    pairs, count = np.unique(edges, axis=0, return_counts=True)
    on_plane = (rim[pairs[:, 0]] * rim[pairs[:, 1]]).sum(axis=1) > 0.5
    if (count > 2).any() or (count[~on_plane] < 2).any():
        raise MeshError("wall: an opening of the lumen is ragged; take a shorter edge")
    return places, triangles, rim


def _sides(triangles: Int64) -> Int64:
    """(3F, 2) vertices of each side of each triangle."""
    return triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)


def _compact(places: Float64, triangles: Int64, *more: Float64) -> Any:
    """Only the vertices that triangles use."""
    used, triangles = np.unique(triangles, return_inverse=True)
    return (places[used], triangles.reshape(-1, 3), *(values[used] for values in more))


def _normals(places: Float64, triangles: Int64, rim: Float64) -> tuple[Float64, Float64]:
    """Vertices (S, 3), and unit vectors (S, 3) out of the lumen that are on the outer side of all triangles around each.

    The vectors are means over neighbours; at a rim they are in the plane of its opening. Vertices at a spike or in a crease
    that leaves no such direction, and those of slivers, move towards their neighbours, and these towards theirs.
    """
    places, beside = places.copy(), _neighbours(triangles, len(places))
    for _ in range(ROUNDS):
        corners = places[triangles]
        area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        faces = area / np.maximum(np.linalg.norm(area, axis=1, keepdims=True), 1e-12)
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        sliver = np.linalg.norm(area, axis=1) < SLIVER * (sides**2).max(axis=1)
        out = np.zeros_like(places)
        for k in range(3):
            np.add.at(out, triangles[:, k], area)
        out = _unit(out, rim)
        out = _unit(out + beside @ out, rim)
        for _ in range(ROUNDS):
            upright = np.einsum("ijk,ik->ij", out[triangles], faces)
            if (upright > UPRIGHT).all() and not sliver.any():
                return places, out
            low = np.maximum(AIM - upright, 0)
            for k in range(3):
                np.add.at(out, triangles[:, k], low[:, k, None] * faces)
            out = _unit(out, rim)
        bad = np.zeros(len(places), dtype=bool)
        bad[triangles[upright <= UPRIGHT]] = True
        bad[triangles[sliver]] = True
        bad |= beside @ bad > 0
        move = 0.5 * (beside @ places - places)
        move -= (move * rim).sum(axis=1, keepdims=True) * rim
        places[bad] += move[bad]
    raise MeshError(
        "wall: the lumen's surface has spikes that no wall can be laid around; open the label, or take a longer edge"
    )


def _neighbours(triangles: Int64, count: int) -> sparse.csr_array:
    """(S, S) means over the neighbours of each vertex."""
    ends = _sides(triangles)
    directed = sparse.coo_array((np.ones(len(ends)), ends.T), (count, count))
    beside = ((directed + directed.T) > 0).astype(np.float64)
    return sparse.csr_array(sparse.diags_array(1 / np.maximum(beside.sum(axis=1), 1)) @ beside)


def _unit(vectors: Float64, rim: Float64) -> Float64:
    """Unit vectors; at a rim without their part along its normal."""
    flat = vectors - (vectors * rim).sum(axis=1, keepdims=True) * rim
    return np.asarray(flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-12))


def _room(labels: Labels, value: int, places: Float64, out: Float64, wall: float) -> Float64:
    """Thickness (S,) mm: less where another part of the lumen is nearer than two walls, half of what is between."""
    distance = ndimage.distance_transform_edt(labels.values != value, sampling=labels.grid.spacing)
    steps = np.linspace(0, 2 * wall, 9)[1:]
    free = np.full(len(places), wall)
    coarse = float(max(labels.grid.spacing))
    for step in steps:  # where the way out comes nearer to the lumen again, something is on the other side
        at = labels.grid.indices(places + step * out)
        there = ndimage.map_coordinates(distance, at.T, order=1, mode="nearest")
        free = np.where(there < step - coarse - 0.25 * wall, np.minimum(free, 0.5 * step), free)
    return free


def _slope(thickness: Float64, places: Float64, triangles: Int64) -> None:
    """Makes the wall thinner towards where it is thin: no step from one vertex to the next."""
    ends = _sides(triangles)
    ends = np.concatenate([ends, ends[:, ::-1]])
    rise = SLOPE * np.linalg.norm(places[ends[:, 0]] - places[ends[:, 1]], axis=1)
    for _ in range(3):
        np.minimum.at(thickness, ends[:, 1], thickness[ends[:, 0]] + rise)


def _flat_volumes(places: Float64, triangles: Int64, thickness: Float64, layers: int) -> Float64:
    """Of each tetrahedron (M,) the volume that it would have if the wall were flat there, mm³."""
    corners = places[triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    outwards = thickness[np.sort(triangles, axis=1)][:, ::-1]  # each of a prism's three goes outwards at one corner
    return np.tile((area[:, None] * outwards / (3 * layers)).T.ravel(), layers)


def _prisms(triangles: Int64, count: int, layers: int) -> Int32:
    """Tetrahedra (M, 4) of prisms over triangles whose corners turn about the normal outwards.

    Vertex i of layer k is i + k count.

    A prism's sides are divided from the lower number inside to the higher outside, so that neighbours agree.
    """
    order = np.sort(triangles, axis=1)
    even: Bool = (
        (triangles[:, 0] < triangles[:, 1]).astype(int)
        + (triangles[:, 1] < triangles[:, 2])
        + (triangles[:, 2] < triangles[:, 0])
    ) == 2
    a, b, c = order.T
    made = []
    for k in range(layers):
        below, above = k * count, (k + 1) * count
        three = [
            (a + below, b + below, c + below, c + above),
            (a + below, b + below, c + above, b + above),
            (a + below, b + above, c + above, a + above),
        ]
        for one in three:
            tet = np.stack(one, axis=1)
            tet[~even] = tet[~even][:, [0, 2, 1, 3]]
            made.append(tet)
    return np.concatenate(made).astype(np.int32)
