"""Isosurface stuffing: tetrahedra between surfaces that are given by their sign.

Source: F. Labelle, J. R. Shewchuk, "Isosurface stuffing", ACM Transactions on Graphics 26(3), 57, 2007.
"""

from collections.abc import Sequence

import numpy as np

from palpate.arrays import Bool, Float64, Int64
from palpate.errors import MeshError
from palpate.meshes.stuffing.bcc_lattice import Field, lattice, snap
from palpate.meshes.stuffing.cut_stencils import split
from palpate.meshes.stuffing.manifold_repair import remove_pinches
from palpate.meshes.stuffing.sizing_field import Grading
from palpate.meshes.tet_mesh import signed_volumes


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
    keep = remove_pinches(tets, volume)
    tets, volume, inside = tets[keep], volume[keep], inside[:, keep]
    for flag in inside[1:]:
        here = np.flatnonzero(flag)
        flag[here[~remove_pinches(tets[here], volume[here])]] = False
    return nodes, tets, inside
