"""Reads and writes a tissue as one .vtu file, which ParaView and meshio open."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from shlex import quote
from typing import Any

import numpy as np

from palpate.atomic_write import replacing
from palpate.bounded_read import parse_json
from palpate.errors import DataError, FileError, MaterialError
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.meshes.io import is_cut, read_stored, repaired, write_mesh
from palpate.tissue.attachment import Attachment
from palpate.tissue.cut_io import grid_fields, plain_blades, plain_figures, stored_cut_mesh, tet_fields, text_of
from palpate.tissue.relaxation import Relaxation
from palpate.tissue.spring_fit_report import FitReport
from palpate.tissue.tissue import SpringLaw, Tissue
from palpate.tissue.vibration import Inertia

_TEXT = "palpate"  # field of bytes: JSON in UTF-8


def write_tissue(path: str | Path, tissue: Tissue) -> None:
    """Write a tissue to a .vtu file, completely or not at all.

    Tetrahedra carry region, young (kPa), poisson and, if the tissue has them, stiffening and young_spread (kPa). Nodes
    carry fixed and, after a fit, the error of the springs in mm. Tetrahedra of a cut tissue carry share, side, body and
    parent, its nodes origin and real.

    Parameters
    ----------
    path : str or Path
        The file.
    tissue : Tissue
        The tissue.

    Raises
    ------
    FileError
        If the file cannot be written.

    Examples
    --------
    >>> pp.write_tissue("tissue.vtu", tissue)
    """
    if Path(path).suffix.lower() != ".vtu":
        raise FileError(f"{path}: tissue is written as .vtu; name it so")
    nodal: dict[str, Any] = {"fixed": tissue.held.astype(np.uint8)}
    if tissue.report is not None:
        nodal["error"] = tissue.report.error_map
    text = {
        "format": 1,
        "element": tissue.element,
        "springs": None if tissue.springs is None else asdict(tissue.springs),
        "report": None if tissue.report is None else tissue.report.plain(),
        "materials": {str(region): name for region, name in tissue.materials.items()},
        "relaxation": _plain_relaxation(tissue.relaxation),
        "inertia": None if tissue.inertia is None else asdict(tissue.inertia),
        "attachments": [asdict(one) for one in tissue.attachments],
    }
    if tissue.surface_friction > 0:
        text["surface_friction"] = tissue.surface_friction
    constants = {"young": tissue.young, "poisson": tissue.poisson}
    if tissue.stiffening.any():
        constants["stiffening"] = tissue.stiffening
    if tissue.young_spread.any():
        constants["young_spread"] = tissue.young_spread
    whole: dict[str, Any] = {}
    if isinstance(tissue.mesh, CutMesh):
        text["blades"], text["cuts"] = plain_blades(tissue.mesh), plain_figures(tissue.mesh)
        nodal["origin"], nodal["real"] = tissue.mesh.origin, tissue.mesh.real.astype(np.int32)
        constants |= tet_fields(tissue.mesh)
        whole = {name: text_of(values) for name, values in grid_fields(tissue.mesh).items()}
    whole[_TEXT] = "UInt8", " ".join(str(byte) for byte in json.dumps(text).encode())
    with replacing(path) as temporary:
        write_mesh(temporary, tissue.mesh, nodal, constants)
        _add_fields(temporary, whole)


def read_tissue(path: str | Path) -> Tissue:
    """Read a tissue that `write_tissue` wrote.

    Parameters
    ----------
    path : str or Path
        A .vtu file.

    Returns
    -------
    Tissue
        The tissue, with its springs and report.

    Raises
    ------
    FileError
        If the file is missing or is another kind of file.
    MeshError, MaterialError
        If its contents are not valid.

    Examples
    --------
    >>> pp.write_tissue("tissue.vtu", tissue)
    >>> pp.read_tissue("tissue.vtu").element
    'smoothed'
    """
    path = Path(path)
    if path.suffix.lower() != ".vtu":
        raise FileError(
            f"{path}: tissue is kept as .vtu; make it so: palpate fit {quote(str(path))} --young 5 -o tissue.vtu"
        )
    stored = read_stored(path)
    mesh = None if is_cut(stored) else repaired(path, stored, organs=True)
    fields = {name: values[0] for name, values in stored.cell_data.items()}
    missing = [n for n in ("young", "poisson") if n not in fields] + ["fixed"] * ("fixed" not in stored.point_data)
    if missing or _TEXT not in stored.field_data:
        raise FileError(
            f"{path}: is a mesh without {', '.join([*missing, 'springs'])}; make tissue of it: "
            f"palpate fit {quote(str(path))} --young 5 --poisson 0.45 --rest-on 0,0,-1 -o tissue.vtu"
        )
    try:
        text = parse_json(bytes(np.asarray(stored.field_data[_TEXT], dtype=np.uint8)))
        mesh = mesh or stored_cut_mesh(stored, text["blades"], text["cuts"])
        springs = None if text["springs"] is None else SpringLaw(**text["springs"])
        report = None if text["report"] is None else FitReport.from_plain(text["report"], stored.point_data["error"])
        held = np.asarray(stored.point_data["fixed"]).astype(bool)
        materials = {int(region): str(name) for region, name in text.get("materials", {}).items()}
        relaxation = _relaxation_of(text.get("relaxation"))
        inertia = Inertia(**text["inertia"]) if text.get("inertia") else None
        constants = (fields["young"], fields["poisson"], held)
        return Tissue(
            mesh,
            *constants,
            element=text.get("element", "P1"),
            springs=springs,
            report=report,
            materials=materials,
            relaxation=relaxation,
            inertia=inertia,
            stiffening=fields.get("stiffening", 0.0),
            attachments=[Attachment(**one) for one in text.get("attachments", [])],
            surface_friction=float(text.get("surface_friction", 0.0)),
            young_spread=fields.get("young_spread", 0.0),
        )
    except (MaterialError, DataError) as problem:
        raise type(problem)(f"{path}: {problem}") from None
    except (KeyError, TypeError, ValueError, AttributeError) as problem:
        raise FileError(f"{path}: its field {_TEXT!r} is damaged ({problem!r}); fit the mesh again") from None


def _plain_relaxation(relaxation: Relaxation | dict[int, Relaxation] | None) -> dict[str, Any] | None:
    """Of one relaxation its numbers, else those of each region by its number."""
    if isinstance(relaxation, dict):
        return {"regions": {str(region): asdict(one) for region, one in relaxation.items()}}
    return None if relaxation is None else asdict(relaxation)


def _relaxation_of(plain: dict[str, Any] | None) -> Relaxation | dict[int, Relaxation] | None:
    if not plain:
        return None
    if "regions" in plain:
        return {int(region): Relaxation(**one) for region, one in plain["regions"].items()}
    return Relaxation(**plain)


def _add_fields(path: Path, fields: Mapping[str, tuple[str, str]]) -> None:
    """Puts arrays, of a type and numbers, where VTK keeps what belongs to the whole grid; meshio reads such fields but
    writes none."""
    array = "".join(
        f'<DataArray type="{kind}" Name="{name}" NumberOfTuples="{values.count(" ") + 1}" format="ascii">{values}</DataArray>'
        for name, (kind, values) in fields.items()
    )
    whole = path.read_text()
    if "<FieldData>" in whole:
        whole = whole.replace("<FieldData>", f"<FieldData>{array}", 1)
    else:
        whole = whole.replace("<UnstructuredGrid>", f"<UnstructuredGrid><FieldData>{array}</FieldData>", 1)
    path.write_text(whole)
