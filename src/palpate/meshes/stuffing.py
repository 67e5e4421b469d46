"""Tetrahedra from labels by isosurface stuffing, with inclusions whose boundary follows element faces."""

import warnings
from collections.abc import Mapping, Sequence

import numpy as np

from palpate.arrays import Bool, Float64, Int64
from palpate.errors import DataError, MeshError
from palpate.meshes.grading import CELL, Grading, check_edge, edges_at, grading
from palpate.meshes.lattice import Field, lattice, snap
from palpate.meshes.levels import Level, inner_distance
from palpate.meshes.manifold import unpinched
from palpate.meshes.mesh import TetMesh, signed_volumes
from palpate.meshes.shape import smallest_dihedral
from palpate.meshes.solids import Solid, solids
from palpate.meshes.stencils import split
from palpate.volumes.volume import Labels

WORST_DIHEDRAL = 10.0  # degrees
SHIFTS = ((0.5, 0.5, 0.5), (0.25, 0.1, 0.4), (0.1, 0.35, 0.2), (0.4, 0.2, 0.05))  # of the lattice, in cells
# A surface that passes where cells change size keeps 10 degrees in most placings only: more of them.
MORE_SHIFTS = (
    (0.7, 0.6, 0.15),
    (0.85, 0.3, 0.65),
    (0.05, 0.75, 0.8),
    (0.6, 0.9, 0.35),
    (0.3, 0.45, 0.95),
    (0.95, 0, 0),
)


def tetrahedralize(
    labels: Labels,
    label: int | str,
    edge: float = 4.0,
    *,
    inclusions: Sequence[int | str] = (),
    fine: Mapping[int | str, float] | None = None,
    keep: str = "largest",
    fill_holes: bool = True,
    closed_at_border: bool = False,
    smooth: float | None = None,
    most_lost: float = 0.05,
) -> TetMesh:
    """Tetrahedra of about `edge` mm that fill a label; its inclusions become regions of the same mesh.

    label: the organ, by value or name. inclusions: labels inside it (a lump); the boundary of each follows element
    faces. The mesh's `region` holds label values, nodes are in mm in the frame of `labels.grid.points` (LPS). Each
    region has the volume of its label. fine: mm, a shorter edge for some inclusions, from which the elements grow to
    `edge` (sizes are powers of two times each other, so both can be a fifth off). keep: "largest" or "all" of the parts
    of the organ. fill_holes: closes voids inside the organ. closed_at_border: closes an organ that the edge of the
    volume cuts with a flat wall. smooth: mm, how far the staircase of the voxels is smoothed (default: 0.7 voxels, or
    0.3 edges if that is more). most_lost: part of the volume that may be lost where the organ is thinner than the
    elements.

    Raises `DataError` if the label is absent, empty, or cut by the border; `MeshError` if the edge is too long or too
    short for it, if thin parts would be lost, or if an inclusion comes too close to the surface. What is dropped or
    filled is said by a warning. Source: Labelle & Shewchuk, ACM Trans. Graphics 26(3), 57, 2007.
    """
    if not (np.isfinite(edge) and edge > 0):
        raise MeshError(f"edge: expected a positive length in mm, got {edge!r}")
    if smooth is not None and not (np.isfinite(smooth) and smooth >= 0):
        raise DataError(f"smooth: expected a length in mm, 0 or more, got {smooth!r}")
    bodies = solids(labels, label, inclusions, keep=keep, fill_holes=fill_holes, closed_at_border=closed_at_border)
    edges = edges_at(bodies, edge, {labels.value_of(key): length for key, length in (fine or {}).items()})
    check_edge(bodies[0], edge)
    sizes = grading(bodies, edges)
    levels = [_level(body, here, smooth) for body, here in zip(bodies, edges, strict=True)]
    nodes, tets, inside = _fill(bodies, levels, edges, sizes, most_lost)
    region = np.full(len(tets), bodies[0].value)
    for body, flag in zip(bodies[1:], inside[1:], strict=True):
        region[flag] = body.value
    used, index = np.unique(tets, return_inverse=True)
    steps = (nodes[used] / np.array(labels.grid.spacing[::-1]))[:, ::-1] + bodies[0].corner
    names = {body.value: body.name for body in bodies}
    return TetMesh(labels.grid.points(steps), index.reshape(tets.shape), region, names)


def _level(body: Solid, edge: float, smooth: float | None) -> Level:
    spacing = body.grid.spacing
    width = [max(0.7 * d, 0.3 * edge) for d in spacing] if smooth is None else [smooth] * 3
    level = Level(body.mask, spacing, width)
    level.enclose(body.volume)
    return level


def _fill(
    bodies: Sequence[Solid],
    levels: Sequence[Level],
    edges: Sequence[float],
    sizes: Grading | None,
    most_lost: float,
) -> tuple[Float64, Int64, Bool]:
    """Stuffs, then moves each level until flat facets in round surfaces cost no volume; the best of six rounds."""
    wanted = np.array([body.volume for body in bodies])
    aim, before = wanted.copy(), None
    best, off = None, np.inf
    for attempt in range(6):
        try:
            nodes, tets, inside = _best(bodies, levels, edges, sizes)
        except MeshError:
            if best is None:
                raise
            break
        if attempt == 0:
            wanted[0] -= _lost(bodies[0], nodes, tets, edges[0], most_lost)
        volume = signed_volumes(nodes, tets)
        made = np.array([volume[flag].sum() for flag in inside])
        if (made == 0).any():
            gone = int(np.argmin(made))
            raise MeshError(_vanished(bodies[gone], edges[gone]))
        error = np.abs(made / wanted - 1)
        if error.max() < off:
            best, off = (nodes, tets, inside), float(error.max())
        if (error < np.clip(1 / inside.sum(axis=1), 0.005, 0.01)).all():  # few tets get no closer than to a tet
            break
        aim, before = _next_aim(aim, made, wanted, before), (aim, made)
        for level, target in zip(levels, aim, strict=True):
            level.enclose(target)
    assert best is not None
    if off > 0.03:
        warnings.warn(f"the mesh's volume is {off:.1%} off the label's; a shorter edge is closer", stacklevel=3)
    return best


def _next_aim(aim: Float64, made: Float64, wanted: Float64, before: tuple[Float64, Float64] | None) -> Float64:
    """The volume to enclose in the next round: Newton's step in logarithms, the slope from the last two rounds."""
    slope = np.ones_like(aim)
    if before is not None:
        step = np.log(aim / before[0])
        there = np.abs(step) > 1e-6
        slope[there] = np.clip(np.log(made / before[1])[there] / step[there], 0.7, 3)
    answer: Float64 = aim * (wanted / made) ** (1 / slope)
    return answer


def _vanished(body: Solid, edge: float) -> str:
    thick = body.thickness(edge / 8)
    return (
        f"{body.name!r} ({body.volume:.3g} mm³) falls between elements of {edge:g} mm; "
        f"use an edge of {min(thick / 3, 0.75 * edge):.2g} mm or less"
    )


def _best(
    bodies: Sequence[Solid], levels: Sequence[Level], edges: Sequence[float], sizes: Grading | None
) -> tuple[Float64, Int64, Bool]:
    """The first placing of the lattice that gives no angle below 10 degrees."""
    size = np.array(bodies[0].mask.shape[::-1]) * np.array(bodies[0].grid.spacing[::-1])
    cell = CELL * edges[0] * (1.0 if sizes is None else sizes.scale)
    worst, refusal = -1.0, None
    for shift in SHIFTS if sizes is None else SHIFTS + MORE_SHIFTS:
        origin = -(np.array(shift) + 2.5) * cell
        try:
            nodes, tets, inside = stuff(levels, origin, size + 6 * cell, cell, sizes)
        except MeshError as problem:
            refusal = problem
            continue
        worst = max(worst, float(smallest_dihedral(nodes, tets).min(initial=180)))
        if worst >= WORST_DIHEDRAL:
            return nodes, tets, inside
    raise MeshError(_too_close(bodies, edges, worst)) from refusal


def _too_close(bodies: Sequence[Solid], edges: Sequence[float], worst: float) -> str:
    if len(bodies) == 1:
        return (
            f"{bodies[0].name!r}: worst dihedral angle {worst:.1f}°, at least {WORST_DIHEDRAL:g}° are wanted; "
            f"smooth the label more, or change the edge of {edges[0]:g} mm"
        )
    gap, inner, outer, edge = min(
        (body.depth(other), body.name, other.name, here) for body, other, here in _nested(bodies, edges)
    )
    if gap < 1.5 * max(bodies[0].grid.spacing):
        way = "erode it, or add a layer of the tissue around it to the labels"
    else:
        way = f"use an edge of {min(gap / 2, 0.75 * edge):.2g} mm or less"
    return (
        f"{inner!r} comes within {gap:.3g} mm of the surface of {outer!r}, too close for an edge of {edge:g} mm; {way}"
    )


def _nested(bodies: Sequence[Solid], edges: Sequence[float]) -> list[tuple[Solid, Solid, float]]:
    return [(body, other, edges[i]) for i, body in enumerate(bodies) for other in bodies[:i]]


def _lost(body: Solid, nodes: Float64, tets: Int64, edge: float, most: float) -> float:
    """mm³ of the label that lie further from any tetrahedron than half an edge and half a voxel; refuses too much."""
    from scipy.spatial import cKDTree

    if len(tets) == 0:
        return 0.0
    mask, spacing = body.coarse(edge / 8)
    inside = np.concatenate([nodes[np.unique(tets)], nodes[tets].mean(axis=1)])
    index = np.argwhere(mask)
    reach = 0.5 * edge + 0.5 * float(np.linalg.norm(spacing))
    far = np.isinf(cKDTree(inside).query(index[:, ::-1] * spacing[::-1], distance_upper_bound=reach)[0])
    part = float(far.mean())
    if part > most:
        thin = 2 * float(inner_distance(mask, spacing)[tuple(index[far].T)].max())
        raise MeshError(
            f"{part:.1%} of {body.name!r} is thinner than elements of {edge:g} mm and would be lost (most_lost is "
            f"{most:.1%}); use an edge of {min(thin / 2, 0.75 * edge):.2g} mm or less, or open the label first"
        )
    if part > 0.002:
        warnings.warn(f"{part:.1%} of {body.name!r} is thinner than elements of {edge:g} mm: lost", stacklevel=4)
    return part * body.volume


def stuff(
    fields: Sequence[Field], origin: Float64, size: Float64, cell: float, sizes: Grading | None = None
) -> tuple[Float64, Int64, Bool]:
    """Tetrahedra inside the first field, (N, 3) mm and (M, 4), and (fields, M) whether each is inside each field.

    fields: positive inside, each inside the one that encloses it. The lattice of cubes of `cell` mm begins at `origin`
    (3,) and covers `size` (3,) mm; `sizes` halves them where it wants. Raises `MeshError` where two surfaces pass
    through one tetrahedron.
    """
    cells = np.ceil(size / cell).astype(int)
    grid = lattice(cells) if sizes is None else sizes.lattice(origin, cells, cell)
    points = origin + grid.place * (cell / 2 if sizes is None else cell / 2 ** (1 + sizes.depth))
    tets = grid.tets[(fields[0](points) > 0)[grid.tets].any(axis=1)]
    if len(tets) == 0:
        return points, tets, np.zeros((len(fields), 0), dtype=bool)
    snapped = snap(grid.place, points, tets, fields)
    key = snapped.cuts[:, 0] * np.int64(len(points)) + snapped.cuts[:, 1]
    order = np.argsort(key, kind="stable")
    signs = snapped.sign[:, tets]  # (fields, M, 4)
    crossed: Bool = np.asarray((signs > 0).any(axis=2) & (signs < 0).any(axis=2))
    if (crossed.sum(axis=0) > 1).any():
        raise MeshError("two surfaces pass through one tetrahedron")
    nodes = np.concatenate([snapped.points, snapped.cut_points[order]])
    whole: Bool = np.asarray(crossed.sum(axis=0) == 0)
    made, inside = [tets[whole]], [_side(fields, nodes, tets[whole], signs[:, whole])]
    inside[0][0] &= (signs[0][whole] > 0).any(axis=1)  # all four on the skin: can be flat, and is not missed
    for s in range(len(fields)):
        here = np.flatnonzero(crossed[s])
        pieces = split(grid.place, nodes, tets[here], signs[s, here], snapped.cuts[order], len(points))
        nodes = pieces.points
        flags = _side(fields, nodes, tets[here][pieces.parent], signs[:, here[pieces.parent]])
        flags[s] = pieces.side > 0
        made.append(pieces.tets)
        inside.append(flags)
    return _solid(nodes, np.concatenate(made), np.concatenate(inside, axis=1))


def _side(fields: Sequence[Field], nodes: Float64, tets: Int64, signs: Int64) -> Bool:
    """(fields, M) inside or outside by any node that is off the surface, else by the middle of the tet."""
    flags: Bool = np.asarray(np.any(signs > 0, axis=2))
    for s, field in enumerate(fields):
        flat = np.flatnonzero((signs[s] == 0).all(axis=1))
        if len(flat):
            flags[s, flat] = field(nodes[tets[flat]].mean(axis=1)) > 0
    return flags


def _solid(nodes: Float64, tets: Int64, inside: Bool) -> tuple[Float64, Int64, Bool]:
    """Keeps what is inside the first field, positively oriented, its skin and those of its inclusions manifold."""
    tets, inside = tets[inside[0]], inside[:, inside[0]]
    flip = signed_volumes(nodes, tets) < 0
    tets[flip] = tets[flip][:, [0, 2, 1, 3]]
    volume = signed_volumes(nodes, tets)
    keep = unpinched(tets, volume)
    tets, volume, inside = tets[keep], volume[keep], inside[:, keep]
    for flag in inside[1:]:
        here = np.flatnonzero(flag)
        flag[here[~unpinched(tets[here], volume[here])]] = False
    return nodes, tets, inside
