"""Meshes as files that others open: VTK (.vtu) and Gmsh (.msh), through meshio."""

import contextlib
import io
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import AnyArray, Int64, float64
from palpate.atomic import replacing
from palpate.errors import DataError, FileError, MeshError
from palpate.meshes.gmsh import is_gmsh_1, read_gmsh_1, write_gmsh
from palpate.meshes.mesh import TetMesh, boundary_faces, folds, signed_volumes
from palpate.meshes.surface import pinches

FORMATS = {".vtu": "vtu", ".msh": "gmsh"}  # Gmsh 2.2 ASCII is written, which most programs read
NAME = "region name: "  # of a field in a .vtu file, followed by the region's name; its value is the region's number


def write_mesh(
    path: str | Path,
    mesh: TetMesh,
    node_fields: Mapping[str, ArrayLike] | None = None,
    tet_fields: Mapping[str, ArrayLike] | None = None,
) -> None:
    """Writes nodes (mm), tets, the region of each tet and the regions' names as .vtu or .msh.

    node_fields, tet_fields: name to (N,) or (N, k) and (M,) or (M, k) values to go with them. Raises `FileError`,
    `MeshError`.
    """
    import meshio

    form = mesh_format(path)
    points, cells = _fields("node", node_fields, len(mesh.nodes)), _fields("tet", tet_fields, len(mesh.tets))
    with replacing(path) as temporary:
        if form == "gmsh":
            write_gmsh(temporary, mesh, points, cells)
            return
        data = {name: [values] for name, values in {**cells, "region": mesh.region}.items()}
        meshio.Mesh(mesh.nodes, [("tetra", mesh.tets)], points, data).write(temporary, file_format="vtu")
        _add_names(temporary, mesh.names)


def read_mesh(path: str | Path) -> TetMesh:
    """The tetrahedra of a .vtu or .msh file (Gmsh 1, 2 and 4), their regions and names.

    Inverted tets are turned round and nodes of no tet dropped, with a warning. Raises `FileError` for a file that is
    missing or cannot be read, `DataError` for nodes that are not finite, `MeshError` for one without tetrahedra, with
    flat ones, or with a skin that is not a 2-manifold.
    """
    path = Path(path)
    mesh_format(path)
    stored = _stored(path)
    try:
        return _valid(path, stored)
    except (MeshError, DataError) as problem:
        raise type(problem)(f"{path}: {problem}") from None


def mesh_format(path: str | Path) -> str:
    """The format that the name of a mesh file says. Raises `FileError` for one that is not known."""
    suffix = Path(path).suffix.lower()
    if suffix not in FORMATS:
        raise FileError(f"{path}: cannot tell the format from its name; name it with one of {', '.join(FORMATS)}")
    return FORMATS[suffix]


def _fields(kind: str, fields: Mapping[str, ArrayLike] | None, count: int) -> dict[str, AnyArray]:
    made: dict[str, AnyArray] = {}
    for name, values in (fields or {}).items():
        array = np.array(values)
        if array.ndim not in (1, 2) or len(array) != count or array.dtype.kind not in "fiu":
            raise MeshError(
                f"{kind} field {name!r}: expected {count} rows of numbers, got {array.shape} {array.dtype}; "
                f"give one row a {kind}"
            )
        made[name] = array
    return made


def _add_names(path: Path, names: Mapping[int, str]) -> None:
    """Writes each name into the file as a field of the grid, where VTK's readers look for such things."""
    head = "<UnstructuredGrid>"
    text = path.read_text()
    arrays = "".join(
        f'<DataArray type="Int32" Name={quoteattr(NAME + name)} NumberOfTuples="1" format="ascii">{value}</DataArray>'
        for value, name in names.items()
    )
    if arrays:
        path.write_text(text.replace(head, f"{head}<FieldData>{arrays}</FieldData>", 1))


def _stored(path: Path) -> Any:
    import meshio

    if path.is_dir():
        raise FileError(f"{path}: is a folder; name a file")
    if not path.exists():
        raise FileError(f"{path}: no such file; check the name (looked from {Path.cwd()})")
    said = io.StringIO()
    try:
        # meshio prints what it finds wrong and ends the program; neither is for a library to do.
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            if is_gmsh_1(path):
                nodes, tets, region = read_gmsh_1(path)
                return meshio.Mesh(nodes, [("tetra", tets)], cell_data={"region": [region]})
            stored = meshio.read(path)
        if "not closed" in said.getvalue():
            raise ValueError("it ends too early")
        return stored
    except (SystemExit, Exception) as problem:
        reason = "" if isinstance(problem, SystemExit) or not str(problem) else f" ({problem})"
        raise FileError(
            f"{path}: cannot be read as a {path.suffix} mesh{reason}; it may be truncated or of another kind: "
            f"write it again as .vtu or .msh"
        ) from None


def _valid(path: Path, stored: Any) -> TetMesh:
    blocks = [i for i, block in enumerate(stored.cells) if block.type == "tetra" and len(block.data)]
    if not blocks:
        kinds = ", ".join(sorted({block.type for block in stored.cells})) or "none"
        raise MeshError(f"no tetrahedra with 4 nodes, cells there: {kinds}; mesh the solid, not its surface")
    nodes = float64("nodes", stored.points, (None, 3))
    tets: Int64 = np.concatenate([stored.cells[i].data for i in blocks]).astype(np.int64)
    if tets.min() < 0 or tets.max() >= len(nodes):
        bad = int(np.flatnonzero((tets < 0).any(axis=1) | (tets >= len(nodes)).any(axis=1))[0])
        raise MeshError(
            f"tet {bad} names node {tets[bad].tolist()}, but nodes are 0 to {len(nodes) - 1}; "
            f"the file is damaged: write it again"
        )
    region = _region(stored, blocks)
    volume = signed_volumes(nodes, tets)
    inverted = volume < 0
    if inverted.any():
        tets[inverted] = tets[inverted][:, [0, 2, 1, 3]]
        warnings.warn(f"{path}: {np.count_nonzero(inverted)} of {len(tets)} tets were inverted: turned", stacklevel=4)
    _check_flat(nodes, tets, np.abs(volume))
    used, index = np.unique(tets, return_inverse=True)
    if len(used) < len(nodes):
        warnings.warn(f"{path}: {len(nodes) - len(used)} nodes belong to no tet: dropped", stacklevel=4)
    mesh = TetMesh(nodes[used], index.reshape(tets.shape), region, _names(stored, region))
    _check_skin(mesh)
    _check_folds(mesh)
    return mesh


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


def _check_skin(mesh: TetMesh) -> None:
    edges, nodes = pinches(boundary_faces(mesh.tets))
    if len(edges) or len(nodes):
        where = mesh.nodes[edges[0, 0] if len(edges) else nodes[0]].round(2).tolist()
        raise MeshError(
            f"the surface is not a 2-manifold: {len(edges)} edges and {len(nodes)} nodes where parts touch at an edge "
            f"or corner only (first near {where} mm); remove the tets that hang by a corner, or split the mesh in parts"
        )


def _region(stored: Any, blocks: list[int]) -> Int64:
    for name in ("region", "gmsh:physical", "gmsh:geometrical"):
        if name in stored.cell_data:
            found = np.concatenate([np.asarray(stored.cell_data[name][i]).ravel() for i in blocks])
            return found.astype(np.int64)
    return np.ones(sum(len(stored.cells[i].data) for i in blocks), dtype=np.int64)


def _names(stored: Any, region: Int64) -> dict[int, str]:
    names = {}
    for key, value in stored.field_data.items():
        number = np.asarray(value).ravel()
        if key.startswith(NAME):
            names[int(number[0])] = key.removeprefix(NAME)
        elif len(number) == 2 and number[1] == 3:
            names[int(number[0])] = key
    return {value: name for value, name in names.items() if value in region}
