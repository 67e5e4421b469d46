"""Meshes as files that others open: VTK (.vtu, and .vtk to read) and Gmsh (.msh), through meshio."""

import contextlib
import io
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import AnyArray
from palpate.atomic import replacing
from palpate.errors import DataError, FileError, MeshError
from palpate.meshes.gmsh import is_gmsh_1, read_gmsh_1, write_gmsh
from palpate.meshes.mending import NAME, mended
from palpate.meshes.mesh import TetMesh

FORMATS = {".vtu": "vtu", ".msh": "gmsh"}  # Gmsh 2.2 ASCII is written, which most programs read
READ = (*FORMATS, ".vtk")


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
    """The tetrahedra of a .vtu, .vtk or .msh file (Gmsh 1, 2 and 4), their regions and names; coordinates are mm.

    What can be mended is, with a warning that says how much: inverted tets are turned round, nodes in one place merged,
    tets that then have no volume and nodes of no tet dropped, tets with 10 nodes reduced to their corners, cells of
    surfaces and lines ignored. Several parts, and coordinates that look like metres, are told. Raises `FileError` for a
    file that is missing or cannot be read, `DataError` for nodes that are not finite, `MeshError` for one without
    tetrahedra, with other solid cells, with flat or folded tets, or with a skin that is not a 2-manifold.
    """
    path = Path(path)
    if path.suffix.lower() not in READ:
        raise FileError(f"{path}: cannot tell the format from its name; name it with one of {', '.join(READ)}")
    stored = _stored(path)
    try:
        mesh, notes = mended(stored)
    except (MeshError, DataError) as problem:
        raise type(problem)(f"{path}: {problem}") from None
    for note in notes:
        warnings.warn(f"{path}: {note}", stacklevel=2)
    return mesh


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
