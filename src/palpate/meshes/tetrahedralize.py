"""Tetrahedral meshes from labels."""

import warnings
from collections.abc import Mapping, Sequence

import numpy as np

from palpate.arrays import ArrayLike, Float64, Int64
from palpate.errors import DataError, MeshError
from palpate.meshes.ftetwild import check_tetwild, ftetwild
from palpate.meshes.stuffing.level_set import Level
from palpate.meshes.stuffing.nested_solids import Solid, solids
from palpate.meshes.stuffing.organ_parts import Keep
from palpate.meshes.stuffing.region_interfaces import divide_regions, own_volumes, touching
from palpate.meshes.stuffing.sizing_field import (
    Grading,
    check_edge,
    check_interior,
    checked_places,
    edges_at,
    grading,
)
from palpate.meshes.stuffing.thin_features import Lost, missed_places, predict_losses, smooth_surface
from palpate.meshes.stuffing.volume_matching import StuffedMesh, level_of, stuff_to_volume
from palpate.meshes.tet_mesh import TetMesh, signed_volumes
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
    finer_at: Mapping[float, ArrayLike] | None = None,
    keep: Keep = "largest",
    fill_holes: bool = True,
    closed_at_border: bool = False,
    smooth: float | None = None,
    most_lost: float = 0.05,
    finer_where_thin: bool = True,
    mesher: str = "stuffing",
) -> TetMesh:
    """Fill a label with tetrahedra; inclusions become regions of the same mesh.

    The boundary of each region follows element faces. Each region has the volume of its label. A warning tells what is
    dropped or filled.

    Parameters
    ----------
    labels : Labels
        The labels. The mesh is in their patient space (LPS), mm.
    label : int or str
        The organ, by number or name.
    edge : float, optional
        Length of an element edge, mm.
    inclusions : sequence of int or str, optional
        Labels in the organ, such as a lump or a vessel. They may meet, and reach the surface.
    fine : mapping, optional
        A shorter edge for some inclusions, mm. Sizes are powers of two times each other, so both may be a fifth off.
    interior : float, optional
        A longer edge deep inside the organ, mm.
    finer_at : mapping, optional
        Shorter edges, mm, each with the points (P, 3), mm, near which elements are so small. An edge is kept between points
        that lie no further apart than it.
    keep : str, int or array_like (3,), optional
        Which part of the organ remains, where several do not touch: "largest", which is the one that holds the inclusions,
        if there are some; "all"; the one furthest to the "left", "right", "posterior", "anterior", "superior" or
        "inferior"; a rank by size, from 1 on; or a point (x, y, z) in it, mm.
    fill_holes : bool, optional
        Close voids inside the organ.
    closed_at_border : bool, optional
        Close an organ that the edge of the volume cuts by a flat wall.
    smooth : float, optional
        How far the voxel staircase is smoothed, mm. The default is 0.7 voxels, or 0.3 edges if that is more.
    most_lost : float, optional
        Share of the volume that may be lost where the organ is thinner than the elements.
    finer_where_thin : bool, optional
        Halve elements, up to twice, where they would miss the surface by almost half an edge.
    mesher : {"stuffing", "tetwild"}, optional
        "tetwild" needs pytetwild and takes minutes.

    Returns
    -------
    TetMesh
        The mesh; its `region` holds label numbers.

    Raises
    ------
    DataError
        If the label is absent, empty or cut by the border.
    MeshError
        If the edge is too long or too short, thin parts would be lost, or an inclusion falls between elements.

    References
    ----------
    Labelle & Shewchuk, ACM Trans. Graphics 26(3):57, 2007.

    Examples
    --------
    >>> coarse = pp.tetrahedralize(labels, "organ", edge=14)
    >>> coarse.names
    {1: 'organ'}
    """
    if not (np.isfinite(edge) and edge > 0):
        raise MeshError(f"edge: expected a positive length in mm, got {edge!r}")
    if smooth is not None and not (np.isfinite(smooth) and smooth >= 0):
        raise DataError(f"smooth: expected a length in mm, 0 or more, got {smooth!r}")
    if mesher not in ("stuffing", "tetwild"):
        raise DataError(f"mesher: expected 'stuffing' or 'tetwild', got {mesher!r}")
    check_interior(edge, interior)
    places = checked_places(edge, finer_at or {})
    if mesher == "tetwild":
        check_tetwild()
        if fine or interior or finer_at:
            raise DataError(
                "fine, interior, finer_at: mesher 'tetwild' makes elements of one size; leave them out, or use 'stuffing'"
            )
    bodies = solids(labels, label, inclusions, keep=keep, fill_holes=fill_holes, closed_at_border=closed_at_border)
    edges = edges_at(bodies, edge, {labels.value_of(key): length for key, length in (fine or {}).items()})
    check_edge(bodies[0], edge)
    if mesher == "tetwild":
        made = ftetwild(bodies[0], edge)
        nodes, tets, owned, lost = _divided(bodies, made, edges, smooth)
    else:
        _check_thin(bodies[0], edge / 2 ** max(THIN_HALVINGS) if finer_where_thin else edge, most_lost)
        first, spacing = bodies[0].corner, np.array(labels.grid.spacing)
        near = {h: ((labels.grid.indices(x) - first) * spacing)[:, ::-1] for h, x in places.items() if len(x)}
        sizes = grading(bodies, edges, interior, near)
        nodes, tets, owned, lost = _meshed(bodies, edges, sizes, smooth, finer_where_thin)
    _warn_of_losses(bodies[0], edge, lost, most_lost)
    region = np.array([body.value for body in bodies])[owned]
    _warn_of_volumes(bodies, lost, nodes, tets, owned)
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
    bodies: Sequence[Solid], made: StuffedMesh, edges: Sequence[float], smooth: float | None
) -> tuple[Float64, Int64, Int64, Lost]:
    if len(bodies) == 1:
        return made.nodes, made.tets, np.zeros(len(made.tets), dtype=np.int64), made.lost
    skin = level_of(bodies[0], edges[0], smooth)
    nodes, owned = divide_regions(bodies, skin, made.nodes, made.tets, edges)
    return nodes, made.tets, owned, made.lost


def _refined(
    bodies: Sequence[Solid], edges: Sequence[float], sizes: Grading | None, smooth: float | None, finer: bool
) -> StuffedMesh:
    """StuffedMesh with elements that are halved, up to twice, where the surface would be missed by 0.4 edges or more."""

    def levels() -> list[Level]:
        return [level_of(body, here, smooth) for body, here in zip(bodies, edges, strict=True)]

    made = stuff_to_volume(bodies, levels(), edges, sizes)
    if not finer:
        return made
    surface = smooth_surface(bodies[0], edges[0])
    for halvings in THIN_HALVINGS:
        places = missed_places(surface, made.nodes, made.tets, edges[0])
        if len(places) == 0:
            break
        sizes = (sizes or Grading.even(len(bodies))).finer(places, halvings)
        try:
            made = stuff_to_volume(bodies, levels(), edges, sizes)
        except MeshError:  # no placing keeps the angles: the coarser one stands, and what it loses is said
            break
    return made


def _check_thin(body: Solid, edge: float, most: float) -> None:
    """Raises `MeshError` before any work if thin places would lose too much volume."""
    lost = predict_losses(body, edge)
    if lost.part > most:
        raise MeshError(_too_thin(body, edge, lost, most))


def _too_thin(body: Solid, edge: float, lost: Lost, most: float) -> str:
    return (
        f"{lost.part:.1%} of {body.name!r} is thinner than elements of {edge:g} mm and would be lost ({lost}; most_lost "
        f"is {most:.1%}); use an edge of {min(lost.thickness / 2, 0.75 * edge):.2g} mm or less, or open the label first"
    )


def _warn_of_losses(body: Solid, edge: float, lost: Lost, most: float) -> None:
    if lost.part > most:
        raise MeshError(_too_thin(body, edge, lost, most))
    if lost.part > 0.002:
        warnings.warn(f"{body.name!r} is in parts thinner than elements of {edge:g} mm: lost, {lost}", stacklevel=3)


def _warn_of_volumes(bodies: Sequence[Solid], lost: Lost, nodes: Float64, tets: Int64, owned: Int64) -> None:
    """Warns of regions whose volume differs by more than 3 % from that of their label."""
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
