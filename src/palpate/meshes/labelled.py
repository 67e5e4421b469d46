"""Tetrahedra from labels."""

import warnings
from collections.abc import Mapping, Sequence

import numpy as np

from palpate.arrays import Float64, Int64
from palpate.errors import DataError, MeshError
from palpate.meshes.filling import Filled, filled, level_of
from palpate.meshes.grading import Grading, check_edge, check_interior, edges_at, grading
from palpate.meshes.levels import Level
from palpate.meshes.mesh import TetMesh, signed_volumes
from palpate.meshes.regions import divided, own_volumes, touching
from palpate.meshes.solids import Solid, solids
from palpate.meshes.tetwild import check_tetwild, wild
from palpate.meshes.thin import Lost, foretold, missed, smooth_surface
from palpate.volumes.volume import Labels

THIN_HALVINGS = (1, 2, 2)  # of the edge, where the organ is thin, round by round


def tetrahedralize(
    labels: Labels,
    label: int | str,
    edge: float = 4.0,
    *,
    inclusions: Sequence[int | str] = (),
    fine: Mapping[int | str, float] | None = None,
    interior: float | None = None,
    keep: str = "largest",
    fill_holes: bool = True,
    closed_at_border: bool = False,
    smooth: float | None = None,
    most_lost: float = 0.05,
    finer_where_thin: bool = True,
    mesher: str = "stuffing",
) -> TetMesh:
    """Tetrahedra of about `edge` mm that fill a label; its inclusions become regions of the same mesh.

    label: the organ, by value or name. inclusions: labels in it (a lump, a vessel); they may meet and reach its skin,
    and the boundary of each follows element faces. The mesh's `region` holds label values, nodes are in mm in the frame
    of `labels.grid.points` (LPS). Each region has the volume of its label. fine: mm, a shorter edge for some
    inclusions, from which the elements grow to `edge` (sizes are powers of two times each other, so both can be a fifth
    off). interior: mm, a longer edge deep inside the organ, to which they grow. keep: "largest" or "all" of the parts of
    the organ. fill_holes: closes voids inside the organ. closed_at_border: closes an organ that the edge of the volume
    cuts with a flat wall. smooth: mm, how far the staircase of the voxels is smoothed (default: 0.7 voxels, or 0.3 edges
    if that is more). most_lost: part of the volume that may be lost where the organ is thinner than the elements.
    finer_where_thin: halves elements, up to twice, where they would miss the surface by almost half an edge. mesher:
    "stuffing", or "tetwild" (needs pytetwild; minutes instead of seconds).

    Raises `DataError` if the label is absent, empty, or cut by the border; `MeshError` if the edge is too long or too
    short for it, if thin parts would be lost, or if an inclusion falls between elements. What is dropped or
    filled is said by a warning. Source: Labelle & Shewchuk, ACM Trans. Graphics 26(3), 57, 2007.
    """
    if not (np.isfinite(edge) and edge > 0):
        raise MeshError(f"edge: expected a positive length in mm, got {edge!r}")
    if smooth is not None and not (np.isfinite(smooth) and smooth >= 0):
        raise DataError(f"smooth: expected a length in mm, 0 or more, got {smooth!r}")
    if mesher not in ("stuffing", "tetwild"):
        raise DataError(f"mesher: expected 'stuffing' or 'tetwild', got {mesher!r}")
    check_interior(edge, interior)
    if mesher == "tetwild":
        check_tetwild()
        if fine or interior:
            raise DataError(
                "fine, interior: mesher 'tetwild' makes elements of one size; leave them out, or use 'stuffing'"
            )
    bodies = solids(labels, label, inclusions, keep=keep, fill_holes=fill_holes, closed_at_border=closed_at_border)
    edges = edges_at(bodies, edge, {labels.value_of(key): length for key, length in (fine or {}).items()})
    check_edge(bodies[0], edge)
    if mesher == "tetwild":
        made = wild(bodies[0], edge)
        nodes, tets, owned, lost = _divided(bodies, made, edges, smooth)
    else:
        _check_thin(bodies[0], edge / 2 ** max(THIN_HALVINGS) if finer_where_thin else edge, most_lost)
        sizes = grading(bodies, edges, interior)
        nodes, tets, owned, lost = _meshed(bodies, edges, sizes, smooth, finer_where_thin)
    _say_lost(bodies[0], edge, lost, most_lost)
    region = np.array([body.value for body in bodies])[owned]
    _say_volumes(bodies, lost, nodes, tets, owned)
    used, index = np.unique(tets, return_inverse=True)
    steps = (nodes[used] / np.array(labels.grid.spacing[::-1]))[:, ::-1] + bodies[0].corner
    names = {body.value: body.name for body in bodies}
    return TetMesh(labels.grid.points(steps), index.reshape(tets.shape), region, names)


def _meshed(
    bodies: Sequence[Solid], edges: Sequence[float], sizes: Grading | None, smooth: float | None, finer: bool
) -> tuple[Float64, Int64, Int64, Lost]:
    """Nodes, tets, the body of each tet, and what is lost: cut along all surfaces where they allow it, else divided."""
    here = bodies[:1] if touching(bodies, edges) else bodies
    try:
        made = _refined(here, edges[: len(here)], sizes, smooth, finer)
    except MeshError:
        if len(here) == 1:
            raise
        here = bodies[:1]
        made = _refined(here, edges[:1], sizes, smooth, finer)
    if len(here) == len(bodies):
        owned = np.zeros(len(made.tets), dtype=np.int64)
        for number, flag in enumerate(made.inside):
            owned[flag] = number
        return made.nodes, made.tets, owned, made.lost
    return _divided(bodies, made, edges, smooth)


def _divided(
    bodies: Sequence[Solid], made: Filled, edges: Sequence[float], smooth: float | None
) -> tuple[Float64, Int64, Int64, Lost]:
    if len(bodies) == 1:
        return made.nodes, made.tets, np.zeros(len(made.tets), dtype=np.int64), made.lost
    skin = level_of(bodies[0], edges[0], smooth)
    nodes, owned = divided(bodies, skin, made.nodes, made.tets, edges)
    return nodes, made.tets, owned, made.lost


def _refined(
    bodies: Sequence[Solid], edges: Sequence[float], sizes: Grading | None, smooth: float | None, finer: bool
) -> Filled:
    """Filled with elements that are halved, up to twice, where the surface would be missed by 0.4 edges or more."""

    def levels() -> list[Level]:
        return [level_of(body, here, smooth) for body, here in zip(bodies, edges, strict=True)]

    made = filled(bodies, levels(), edges, sizes)
    if not finer:
        return made
    surface = smooth_surface(bodies[0], edges[0])
    for halvings in THIN_HALVINGS:
        places = missed(surface, made.nodes, made.tets, edges[0])
        if len(places) == 0:
            break
        sizes = (sizes or Grading.even(len(bodies))).finer(places, halvings)
        try:
            made = filled(bodies, levels(), edges, sizes)
        except MeshError:  # no placing keeps the angles: the coarser one stands, and what it loses is said
            break
    return made


def _check_thin(body: Solid, edge: float, most: float) -> None:
    """Before any work: refuses what is sure to lose more than it may."""
    lost = foretold(body, edge)
    if lost.part > most:
        raise MeshError(_too_thin(body, edge, lost, most))


def _too_thin(body: Solid, edge: float, lost: Lost, most: float) -> str:
    return (
        f"{lost.part:.1%} of {body.name!r} is thinner than elements of {edge:g} mm and would be lost ({lost}; most_lost "
        f"is {most:.1%}); use an edge of {min(lost.thickness / 2, 0.75 * edge):.2g} mm or less, or open the label first"
    )


def _say_lost(body: Solid, edge: float, lost: Lost, most: float) -> None:
    if lost.part > most:
        raise MeshError(_too_thin(body, edge, lost, most))
    if lost.part > 0.002:
        warnings.warn(f"{body.name!r} is in parts thinner than elements of {edge:g} mm: lost, {lost}", stacklevel=3)


def _say_volumes(bodies: Sequence[Solid], lost: Lost, nodes: Float64, tets: Int64, owned: Int64) -> None:
    """Warns where a region is more than 3 % off its label."""
    made = np.bincount(owned, weights=signed_volumes(nodes, tets), minlength=len(bodies))
    wanted = own_volumes(bodies)
    wanted[0] -= lost.part * bodies[0].volume
    off = np.abs(made / wanted - 1)
    worst = int(np.argmax(off))
    if off[worst] > 0.03:
        warnings.warn(
            f"the mesh's volume of {bodies[worst].name!r} is {off[worst]:.1%} off the label's; a shorter edge is closer",
            stacklevel=3,
        )
