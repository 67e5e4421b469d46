"""Repairs imported meshes where that is safe, and refuses the rest with a reason."""

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from palpate.arrays import Float64, Int32, Int64, float64
from palpate.errors import MeshError
from palpate.meshes.centerline_io import stored_centerline
from palpate.meshes.tet_mesh import TetMesh, boundary_faces, check_extent, folds, signed_volumes
from palpate.meshes.triangle_surface import non_manifold_parts

NAME = "region name: "  # of a field in a .vtu file, followed by the region's name; its value is the region's number
REGIONS = ("region", "gmsh:physical", "gmsh:geometrical", "medit:ref", "CellEntityIds")  # names that programs give
SAME = 1e-6  # of the median edge: nodes closer than this are one
FLAT = ("vertex", "line", "triangle", "quad", "polygon")  # how meshio's names of cells without volume begin


def repair_mesh(stored: Any, organs: bool = False) -> tuple[TetMesh, list[str]]:
    """The mesh in what meshio read, and notes on the repairs. Raises `MeshError` and `DataError`.

    organs: parts that touch are organs beside each other, and stay apart.
    """
    notes: list[str] = []
    blocks, tets = _tets(stored, notes)
    nodes = float64("nodes", stored.points, (None, 3))
    check_extent(nodes)
    if tets.min() < 0 or tets.max() >= len(nodes):
        bad = int(np.flatnonzero((tets < 0).any(axis=1) | (tets >= len(nodes)).any(axis=1))[0])
        raise MeshError(
            f"tet {bad} names node {tets[bad].tolist()}, but nodes are 0 to {len(nodes) - 1}; "
            f"the file is damaged: write it again"
        )
    region = _region(stored, blocks)
    if not organs:
        tets, region = _merged(nodes, tets, region, notes)
    volume = signed_volumes(nodes, tets)
    inverted = volume < 0
    if inverted.any():
        tets[inverted] = tets[inverted][:, [0, 2, 1, 3]]
        notes.append(f"{np.count_nonzero(inverted)} of {len(tets)} tets were inverted: turned")
    _check_flat(nodes, tets, np.abs(volume))
    used, index = np.unique(tets, return_inverse=True)
    mesh = TetMesh(
        nodes[used], index.reshape(tets.shape), region, region_names(stored, region), stored_centerline(stored)
    )
    _check_surface(mesh)
    _check_folds(mesh)
    _notes(mesh, notes, organs)
    return mesh, notes


def _tets(stored: Any, notes: list[str]) -> tuple[list[int], Int64]:
    """Which blocks of cells are tets, and their corners (M, 4); other solids are refused."""
    count: dict[str, int] = {}
    for block in stored.cells:
        count[block.type] = count.get(block.type, 0) + len(block.data)
    solid = {kind: n for kind, n in count.items() if n and not kind.startswith(FLAT)}
    kinds = ", ".join(f"{n} {kind}" for kind, n in sorted(count.items()) if n) or "none"
    if not any(kind in ("tetra", "tetra10") for kind in solid):
        raise MeshError(f"no tetrahedra with 4 or 10 nodes, cells there: {kinds}; mesh the solid, not its surface")
    if other := sorted(set(solid) - {"tetra", "tetra10"}):
        raise MeshError(
            f"cells other than tetrahedra fill part of the solid ({', '.join(f'{solid[k]} {k}' for k in other)}); "
            f"split them into tetrahedra of 4 nodes, or mesh it again"
        )
    if ignored := ", ".join(f"{n} {kind}" for kind, n in sorted(count.items()) if n and kind not in solid):
        notes.append(f"cells that are no solid: {ignored}: ignored")
    blocks = [i for i, block in enumerate(stored.cells) if block.type in solid and len(block.data)]
    if quadratic := solid.get("tetra10"):
        notes.append(f"{quadratic} tets have 10 nodes: their 4 corners are kept, so that curved sides become straight")
    tets = np.concatenate([np.asarray(stored.cells[i].data)[:, :4] for i in blocks]).astype(np.int64)
    corners = set(np.unique(tets).tolist())
    middles = [np.asarray(stored.cells[i].data)[:, 4:] for i in blocks if stored.cells[i].type == "tetra10"]
    spare = len(stored.points) - len(corners.union(*(np.unique(m).tolist() for m in middles)))
    if spare > 0:
        notes.append(f"{spare} nodes belong to no tet: dropped")
    return blocks, tets


def _merged(nodes: Float64, tets: Int64, region: Int64, notes: list[str]) -> tuple[Int64, Int64]:
    """Merges nodes at one position, and drops tets that have two corners there."""
    x = nodes[tets]
    edge = float(np.median(np.linalg.norm(x[:, 1:] - x[:, :1], axis=2)))
    used = np.unique(tets)
    pairs = cKDTree(nodes[used]).query_pairs(SAME * edge, output_type="ndarray")
    if len(pairs):
        from palpate.meshes.triangle_surface import connected_groups

        _, group = connected_groups(len(used), pairs.astype(np.int64))
        _, first = np.unique(group, return_index=True)
        into = np.arange(len(nodes))
        into[used] = used[first[group]]
        tets = into[tets]
        notes.append(f"{len(used) - len(first)} nodes lie where another does: merged")
    ordered = np.sort(tets, axis=1)
    collapsed = (ordered[:, 1:] == ordered[:, :-1]).any(axis=1)
    if collapsed.all():
        raise MeshError(f"all {len(tets)} tets have two corners in one place; mesh the solid again")
    if collapsed.any():
        notes.append(f"{np.count_nonzero(collapsed)} tets have two corners in one place: dropped")
    return tets[~collapsed], region[~collapsed]


def _notes(mesh: TetMesh, notes: list[str], organs: bool) -> None:
    """Notes on what is valid but may not be intended."""
    count, part = mesh.parts
    if count > 1 and not organs:
        volume = np.sort(np.bincount(part, weights=mesh.volumes))[::-1]
        sizes = ", ".join(f"{v / volume.sum():.1%}" for v in volume[:4]) + ", ..." * (count > 4)
        notes.append(f"{count} parts that no face joins ({sizes} of the volume); each moves by itself")
    size = float(np.ptp(mesh.nodes, axis=0).max())
    if size < 1:
        notes.append(f"it is {size:.3g} mm across: coordinates are read as mm; multiply by 1000 if they are metres")


def _check_flat(nodes: Any, tets: Int64, volume: Any) -> None:
    longest = np.max(
        [np.linalg.norm(nodes[tets[:, i]] - nodes[tets[:, j]], axis=1) for i in range(4) for j in range(i)], 0
    )
    flat = volume <= 1e-9 * longest**3
    if flat.any():
        bad = int(np.argmax(flat))
        raise MeshError(
            f"{np.count_nonzero(flat)} flat tets (first: tet {bad}, nodes {tets[bad].tolist()}, volume "
            f"{volume[bad]:.3g} mm³, longest edge {longest[bad]:.3g} mm); remove them or mesh again"
        )


def _check_folds(mesh: TetMesh) -> None:
    """Two tets lie on opposite sides of the face that they share, or the mesh is folded over and fills space twice."""
    pairs = folds(mesh.tets)
    if len(pairs):
        a, b = (int(t) for t in pairs[0])
        where = mesh.nodes[mesh.tets[a]].mean(axis=0).round(2).tolist()
        raise MeshError(
            f"inverted: {len(pairs)} pairs of tets overlap (first: tets {a} and {b}, both on one side of the face "
            f"that they share, near {where} mm); the mesh is folded there: mesh it again, or move that node back"
        )


def _check_surface(mesh: TetMesh) -> None:
    edges, nodes = non_manifold_parts(boundary_faces(mesh.tets))
    if len(edges) or len(nodes):
        where = mesh.nodes[edges[0, 0] if len(edges) else nodes[0]].round(2).tolist()
        raise MeshError(
            f"the surface is not a 2-manifold: {len(edges)} edges and {len(nodes)} nodes where parts touch at an edge "
            f"or corner only (first near {where} mm); remove the tets that hang by a corner, or split the mesh in parts"
        )


def _region(stored: Any, blocks: list[int]) -> Int64:
    for name in REGIONS:
        if name in stored.cell_data:
            found = np.concatenate([np.asarray(stored.cell_data[name][i]).ravel() for i in blocks])
            return found.astype(np.int64)
    return np.ones(sum(len(stored.cells[i].data) for i in blocks), dtype=np.int64)


def region_names(stored: Any, region: Int64 | Int32) -> dict[int, str]:
    """Names of the regions that are there, from the fields of what meshio read."""
    names = {}
    for key, value in stored.field_data.items():
        number = np.asarray(value).ravel()
        if key.startswith(NAME):
            names[int(number[0])] = key.removeprefix(NAME)
        elif len(number) == 2 and number[1] == 3:
            names[int(number[0])] = key
    return {value: name for value, name in names.items() if value in region}
