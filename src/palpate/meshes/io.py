"""Reads and writes meshes through meshio: VTK (.vtu, and .vtk to read) and Gmsh (.msh); writes their surfaces."""

import contextlib
import io
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from palpate.arrays import AnyArray, ArrayLike
from palpate.atomic_write import replacing
from palpate.bounded_read import existing_file
from palpate.errors import DataError, FileError, MeshError
from palpate.meshes.centerline_io import centerline_fields
from palpate.meshes.cutting.cut_mesh import refuse_cut
from palpate.meshes.gmsh_io import is_gmsh_1, read_gmsh_1, write_gmsh
from palpate.meshes.import_repair import NAME, repair_mesh
from palpate.meshes.line_file import LineFile
from palpate.meshes.surface_formats import WRITERS
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.vtu_guard import check_vtu

SOLIDS = {".vtu": "vtu", ".msh": "gmsh"}  # Gmsh 2.2 ASCII is written, which most programs read
FORMATS = {**SOLIDS, **{suffix: suffix[1:] for suffix in WRITERS}}
READ = (*SOLIDS, ".vtk")


def write_mesh(
    path: str | Path,
    mesh: TetMesh,
    node_fields: Mapping[str, ArrayLike] | None = None,
    tet_fields: Mapping[str, ArrayLike] | None = None,
) -> None:
    """Write nodes, tetrahedra, regions and names as .vtu or .msh; or the surface alone as .stl, .ply, .obj or .glb.

    A surface is written region by region: that of the whole mesh, then those of the regions inside, each with its name.
    `read_surfaces` makes the same regions of it. STL, PLY and OBJ are in mm and patient space (LPS); glTF is in metres,
    its y towards the patient's head.

    Parameters
    ----------
    path : str or Path
        The file.
    mesh : TetMesh
        The mesh.
    node_fields : mapping of str to array_like, optional
        Values (N,) or (N, k) on nodes.
    tet_fields : mapping of str to array_like, optional
        Values (M,) or (M, k) on tetrahedra.

    Raises
    ------
    FileError
        If the file cannot be written.
    MeshError
        If a field has the wrong length, or the format holds no fields.

    Examples
    --------
    >>> pp.write_mesh("organ.vtu", mesh, node_fields={"height": mesh.nodes[:, 2]})
    """
    import meshio

    form = mesh_format(path)
    if "share" not in (tet_fields or {}):
        refuse_cut(mesh, str(path), "write the tissue, as .vtu: pp.write_tissue")
    points, cells = _fields("node", node_fields, len(mesh.nodes)), _fields("tet", tet_fields, len(mesh.tets))
    suffix = Path(path).suffix.lower()
    if suffix in WRITERS and (points or cells):
        raise MeshError(
            f"{path}: fields {', '.join([*points, *cells])}: a surface holds none; name it .vtu, or leave them out"
        )
    with replacing(path) as temporary:
        if suffix in WRITERS:
            WRITERS[suffix](temporary, mesh)
            return
        if form == "gmsh":
            write_gmsh(temporary, mesh, points, cells)
            return
        data = {name: [values] for name, values in {**cells, "region": mesh.region}.items()}
        meshio.Mesh(mesh.nodes, [("tetra", mesh.tets)], points, data).write(temporary, file_format="vtu")
        _add_names(temporary, mesh)


def read_mesh(path: str | Path) -> TetMesh:
    """Read tetrahedra from a .vtu, .vtk or .msh file (Gmsh 1, 2 and 4). Coordinates are mm.

    Defects that can be repaired are repaired, with a warning: inverted tetrahedra, duplicate and unused nodes, elements with
    10 nodes, and cells of surfaces and lines. A warning tells of several parts, and of coordinates that look
    like metres.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    TetMesh
        The mesh with its regions and names.

    Raises
    ------
    FileError
        If the file is missing or cannot be read.
    DataError
        If a node is not finite.
    MeshError
        If there are no tetrahedra, other solid cells, flat or folded tetrahedra, or a surface that is not a 2-manifold.

    Examples
    --------
    >>> pp.write_mesh("organ.vtu", mesh)
    >>> len(pp.read_mesh("organ.vtu").nodes) == len(mesh.nodes)
    True
    """
    path = Path(path)
    if path.suffix.lower() not in READ:
        raise FileError(f"{path}: cannot tell the format from its name; name it with one of {', '.join(READ)}")
    return repaired(path, read_stored(path))


def is_cut(stored: Any) -> bool:
    """Whether what `read_stored` gave is the mesh of a cut tissue."""
    return "share" in stored.cell_data and "skin tet" in stored.field_data


def repaired(path: Path, stored: Any, organs: bool = False) -> TetMesh:
    """The mesh in what `read_stored` gave, with a warning for each repair. Raises `MeshError` and `DataError`.

    organs: as for `repair_mesh`.
    """
    if is_cut(stored):
        raise MeshError(
            f"{path}: is a tissue that has been cut, and no mesh to begin with; take the tissue before the cut"
        )
    try:
        mesh, notes = repair_mesh(stored, organs)
    except (MeshError, DataError) as problem:
        raise type(problem)(f"{path}: {problem}") from None
    for note in notes:
        warnings.warn(f"{path}: {note}", stacklevel=3)
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


def _add_names(path: Path, mesh: TetMesh) -> None:
    """Writes names and centre line into the file as fields of the grid, where VTK's readers look for such things."""
    head = "<UnstructuredGrid>"
    text = path.read_text()
    fields = {NAME + name: ("Int32", str(value)) for value, name in mesh.names.items()}
    arrays = "".join(
        f'<DataArray type="{kind}" Name={quoteattr(name)} NumberOfTuples="{numbers.count(" ") + 1}" format="ascii">'
        f"{numbers}</DataArray>"
        for name, (kind, numbers) in (fields | centerline_fields(mesh.centerline)).items()
    )
    if arrays:
        path.write_text(text.replace(head, f"{head}<FieldData>{arrays}</FieldData>", 1))


def read_stored(path: Path) -> Any:
    """What meshio reads of the file, whatever it is. Raises `FileError`."""
    import meshio

    existing_file(path)
    said = io.StringIO()
    try:
        # meshio prints what it finds wrong and ends the program; neither is for a library to do.
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            if is_gmsh_1(path):
                nodes, tets, region = read_gmsh_1(path)
                return meshio.Mesh(nodes, [("tetra", tets)], cell_data={"region": [region]})
            if path.suffix.lower() == ".vtu":
                check_vtu(path)
                stored = meshio.read(path)
            else:
                form = meshio.gmsh.main if path.suffix.lower() == ".msh" else meshio.vtk._main
                with LineFile(path) as file:
                    stored = form.read_buffer(file)
        if "not closed" in said.getvalue():
            raise ValueError("it ends too early")
        return stored
    except (SystemExit, Exception) as problem:
        reason = "" if isinstance(problem, SystemExit) or not str(problem) else f" ({problem})"
        raise FileError(
            f"{path}: cannot be read as a {path.suffix} mesh{reason}; it may be truncated or of another kind: "
            f"write it again as .vtu or .msh"
        ) from None
