"""Stuffs solids with tetrahedra, and moves their surfaces until the volumes match."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.arrays import Bool, Float64, Int64
from palpate.errors import MeshError
from palpate.meshes.element_quality import smallest_dihedral
from palpate.meshes.stuffing.dihedral_improvement import improve_dihedrals
from palpate.meshes.stuffing.isosurface_stuffing import stuff
from palpate.meshes.stuffing.level_set import Level
from palpate.meshes.stuffing.nested_solids import Solid
from palpate.meshes.stuffing.sizing_field import CELL, Grading
from palpate.meshes.stuffing.thin_features import Lost, measure_losses
from palpate.meshes.tet_mesh import signed_volumes

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


@dataclass(frozen=True, eq=False)
class StuffedMesh:
    """nodes: (N, 3) mm. tets: (M, 4). inside: (bodies, M). lost: what thin places cost the first body."""

    nodes: Float64
    tets: Int64
    inside: Bool
    lost: Lost


def level_of(body: Solid, edge: float, smooth: float | None) -> Level:
    """The surface of a solid, smoothed by `smooth` mm, or as much as its voxels and an edge of `edge` mm ask for."""
    spacing = body.grid.spacing
    width = [max(0.7 * d, 0.3 * edge) for d in spacing] if smooth is None else [smooth] * 3
    level = Level(body.mask, spacing, width)
    level.enclose(body.volume)
    return level


def stuff_to_volume(
    bodies: Sequence[Solid], levels: Sequence[Level], edges: Sequence[float], sizes: Grading | None
) -> StuffedMesh:
    """Stuffs, then moves each level until the mesh has the label's volume; the best of six rounds.

    Raises `MeshError` if a body vanishes or no placing of the lattice keeps the angles.
    """
    wanted = np.array([body.volume for body in bodies])
    aim, before = wanted.copy(), None
    best, off, lost = None, np.inf, Lost()
    for attempt in range(6):
        try:
            nodes, tets, inside = _best(bodies, levels, edges, sizes)
        except MeshError:
            if best is None:
                raise
            break
        if attempt == 0:
            lost = measure_losses(bodies[0], nodes, tets, edges[0])
            wanted[0] -= lost.part * bodies[0].volume
        volume = signed_volumes(nodes, tets)
        made = np.array([volume[flag].sum() for flag in inside])
        if (made == 0).any():
            gone = int(np.argmin(made))
            raise MeshError(empty_body_message(bodies[gone], edges[gone]))
        error = np.abs(made / wanted - 1)
        if error.max() < off:
            best, off = StuffedMesh(nodes, tets, inside, lost), float(error.max())
        if (error < np.clip(1 / inside.sum(axis=1), 0.005, 0.01)).all():  # few tets get no closer than to a tet
            break
        aim, before = _next_aim(aim, made, wanted, before), (aim, made)
        for level, target in zip(levels, aim, strict=True):
            level.enclose(target)
    assert best is not None
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


def empty_body_message(body: Solid, edge: float) -> str:
    """The message for a body of which no tetrahedron is left."""
    thick = body.thickness(edge / 8)
    return (
        f"{body.name!r} ({body.volume:.3g} mm³) falls between elements of {edge:g} mm; "
        f"use an edge of {min(thick / 3, 0.75 * edge):.2g} mm or less"
    )


def _best(
    bodies: Sequence[Solid], levels: Sequence[Level], edges: Sequence[float], sizes: Grading | None
) -> tuple[Float64, Int64, Bool]:
    """The first placing of the lattice that gives no angle below 10 degrees, after lifting where cells change size."""
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
        if len(tets) and sizes is not None:
            nodes = improve_dihedrals(nodes, tets, WORST_DIHEDRAL + 0.1)
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
