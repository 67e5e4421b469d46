"""Tissue as one .vtu file that ParaView and meshio open: fields on tets and nodes, and the rest as a text field."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from palpate.atomic import replacing
from palpate.errors import FileError
from palpate.meshes.files import read_mesh, write_mesh
from palpate.tissue.report import FitReport
from palpate.tissue.tissue import SpringLaw, Tissue

_TEXT = "palpate"  # field of bytes: JSON in UTF-8


def write_tissue(path: str | Path, tissue: Tissue) -> None:
    """Writes `tissue` to a .vtu file, whole or not at all.

    On tets: region, young (kPa), poisson. On nodes: fixed (1: held still), and error (mm, springs against finite
    elements) after a fit. Everything else is JSON in the field "palpate". Raises `FileError`.
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
    }
    with replacing(path) as temporary:
        write_mesh(temporary, tissue.mesh, nodal, {"young": tissue.young, "poisson": tissue.poisson})
        _add_text(temporary, json.dumps(text))


def read_tissue(path: str | Path) -> Tissue:
    """The tissue in a .vtu file that `write_tissue` wrote. Raises `FileError`, and `Tissue`'s own errors."""
    import meshio

    path = Path(path)
    if path.suffix.lower() != ".vtu":
        raise FileError(f"{path}: tissue is kept as .vtu; make it so: palpate fit {path} -o tissue.vtu")
    mesh = read_mesh(path)
    stored = meshio.read(path)
    fields = {name: values[0] for name, values in stored.cell_data.items()}
    missing = [n for n in ("young", "poisson") if n not in fields] + ["fixed"] * ("fixed" not in stored.point_data)
    if missing or _TEXT not in stored.field_data:
        raise FileError(
            f"{path}: is a mesh without {', '.join([*missing, 'springs'])}; make tissue of it: "
            f"palpate fit {path} --young 5 --poisson 0.45 --rest-on 0,0,-1 -o tissue.vtu"
        )
    try:
        text = json.loads(bytes(np.asarray(stored.field_data[_TEXT], dtype=np.uint8)).decode())
        springs = None if text["springs"] is None else SpringLaw(**text["springs"])
        report = None if text["report"] is None else FitReport.from_plain(text["report"], stored.point_data["error"])
        element = text["element"]
    except (KeyError, TypeError, UnicodeDecodeError, json.JSONDecodeError) as problem:
        raise FileError(f"{path}: its field {_TEXT!r} is damaged ({problem!r}); fit the mesh again") from None
    held = np.asarray(stored.point_data["fixed"]).astype(bool)
    return Tissue(mesh, fields["young"], fields["poisson"], held, element=element, springs=springs, report=report)


def _add_text(path: Path, text: str) -> None:
    """Puts a byte array where VTK keeps what belongs to the whole grid; meshio reads such fields but writes none."""
    data = text.encode()
    values = " ".join(str(b) for b in data)
    array = f'<DataArray type="UInt8" Name="{_TEXT}" NumberOfTuples="{len(data)}" format="ascii">{values}</DataArray>'
    whole = path.read_text()
    if "<FieldData>" in whole:
        whole = whole.replace("<FieldData>", f"<FieldData>{array}", 1)
    else:
        whole = whole.replace("<UnstructuredGrid>", f"<UnstructuredGrid><FieldData>{array}</FieldData>", 1)
    path.write_text(whole)
