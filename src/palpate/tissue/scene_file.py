"""A scene: several organs that touch, described in a YAML file."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from palpate.bounded_read import read_text
from palpate.errors import DataError, PalpateError
from palpate.meshes.mesh_labels import LabelMesh
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tetrahedralize import tetrahedralize
from palpate.scans.bounded_yaml import yaml_in
from palpate.tissue.attachment import Attachment
from palpate.tissue.boundary_conditions import resting_on
from palpate.tissue.io import read_tissue
from palpate.tissue.joined_tissues import join_tissues
from palpate.tissue.named_tissues import named_materials, poisson_of, spread_of, young_of
from palpate.tissue.tissue import MOST_FRICTION, Tissue
from palpate.tissue.tissue_table import TISSUES
from palpate.volumes.io import read_labels
from palpate.volumes.label_names import with_names
from palpate.volumes.volume import Labels

KIND, VERSION = "palpate scene", 1
BONES = {"vertebra", "vertebrae", "rib", "ribs", "sacrum", "hip", "femur", "humerus", "scapula", "clavicula", "sternum"}
SIDES = {"left", "right", "upper", "middle", "lower", "lobe", "small"}  # of what is one tissue
KEYS = ("labels", "organs", "bones", "attachments", "surface_friction")
SPRING_KEYS = ("first", "second", "stiffness", "radius")
ORGAN_KEYS = ("young", "tissue", "poisson", "edge", "towards", "depth", "keep")
EDGE, TOWARDS, DEPTH = 6.0, (0.0, 1.0, 0.0), 0.2  # mm; of a patient who lies on the back; of the organ's extent


def read_scene(path: str | Path) -> Tissue:
    """Read several organs that touch each other, as one tissue.

    The file lists tissues, or organs of a label map, which are meshed:

    .. code-block:: yaml

        palpate scene: 1
        labels: labels.nii.gz
        organs:
          liver: {tissue: liver, edge: 9}
          stomach: {young: 5, edge: 5, towards: [0, 1, 0], depth: 0.3}
          extra.vtu:
        bones: [vertebrae_L1]
        attachments:
          - {first: [10, -240, 330], second: [20, -235, 335], stiffness: 0.2}
        surface_friction: 0.1

    Of an organ of the label map: `young` in kPa or a named `tissue`, `poisson` (0.45), the `edge` of its elements (6 mm), the
    way `towards` what holds it ([0, 1, 0], the back) and the `depth` of what is held there, as a part of its extent (0.2);
    `keep` as for `tetrahedralize`. An attachment has the arguments of `Attachment`. `surface_friction` is Coulomb's
    coefficient between all surfaces that meet. Files are relative to the scene's.

    Parameters
    ----------
    path : str or Path
        A YAML file.

    Returns
    -------
    Tissue
        What `join_tissues` makes of them.

    Raises
    ------
    FileError
        If a file is missing or cannot be read.
    DataError
        If a key is unknown or missing, or a value is not what it may be.
    MeshError, MaterialError
        As `tetrahedralize`, `Tissue` and `join_tissues` do.

    Examples
    --------
    >>> pp.write_tissue("one.vtu", tissue)
    >>> moved = pp.TetMesh(mesh.nodes + (90, 0, 0), mesh.tets, mesh.region, mesh.names)
    >>> pp.write_tissue("two.vtu", tissue.replace(mesh=moved))
    >>> _ = Path("scene.yaml").write_text("palpate scene: 1\\norgans: [one.vtu, two.vtu]")
    >>> len(pp.read_scene("scene.yaml").mesh.nodes) == 2 * len(mesh.nodes)
    True
    """
    path = Path(path)
    content = yaml_in(path, read_text(path), "write one as pp.read_scene says")
    try:
        organs, bones = _checked(content)
        labels = _labels(path.parent / content["labels"]) if content.get("labels") else None
        tissues = [_tissue(path.parent, labels, name, given or {}) for name, given in organs.items()]
        rigid = [_bone(labels, name, given or {}) for name, given in bones.items()]
        attachments = [_attachment(one) for one in content.get("attachments") or []]
        rubs = "surface_friction" in content
        friction = _number("scene", content, "surface_friction", 0.0, MOST_FRICTION) if rubs else None
        return join_tissues(tissues, rigid, attachments, friction)
    except PalpateError as problem:
        raise type(problem)(f"{path}: {problem}") from None


def scene_text(labels: str, made: Sequence[LabelMesh]) -> str:
    """A scene's file to begin with, of the organs that `mesh_labels` made. labels: the label map's file, seen from it.

    An organ that is called as a tissue of the table, but for its side, gets it; of others the reader gives the stiffness.
    Bones are rigid.
    """
    organs, unknown, bones = [], [], []
    for one in made:
        name, words, edge = _quoted(one.name), _words(one.name), f"edge: {one.edge:.2g}"
        if one.file is None:
            continue
        if words & BONES:
            bones.append(f"  {name}: {{{edge}}}")
        elif len(words) == 1 and words <= TISSUES.keys():
            organs.append(f"  {name}: {{tissue: {words.pop()}, {edge}}}")
        else:
            unknown.append(f"  # {name}: {{young: , {edge}}}")
    said = (
        ["# Say the stiffness in kPa (young: 5), or a named tissue, and take the # away:", *unknown] if unknown else []
    )
    lines = [
        f"{KIND}: {VERSION}",
        f"labels: {_quoted(labels)}",
        "organs:",
        *organs,
        *said,
        "bones:" * bool(bones),
        *bones,
    ]
    return "\n".join(line for line in lines if line) + "\n"


def _words(name: str) -> set[str]:
    """Those of an organ's name, but for its side."""
    return set(name.lower().replace("-", "_").split("_")) - SIDES


def _quoted(text: str) -> str:
    """As YAML has it in one line."""
    return yaml.safe_dump(text, allow_unicode=True, width=np.inf).splitlines()[0]


def _checked(content: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """Organs and bones by name, each with what is said of it. Raises `DataError`."""
    if not isinstance(content, dict) or content.get(KIND) != VERSION:
        raise DataError(f"expected `{KIND}: {VERSION}` in it; write it as pp.read_scene says")
    if unknown := sorted(set(map(str, content)) - {KIND, *KEYS}):
        raise DataError(f"{unknown[0]}: no such key; there are {', '.join(KEYS)}")
    if not isinstance(content.get("attachments") or [], list):
        raise DataError("attachments: expected a list")
    if not isinstance(content.get("labels", ""), str):
        raise DataError("labels: expected the name of a file")
    found = []
    for kind in ("organs", "bones"):
        given = content.get(kind) or {}
        if isinstance(given, list) and all(isinstance(name, str) for name in given):
            given = dict.fromkeys(given)
        if not isinstance(given, dict):
            raise DataError(f"{kind}: expected names, or names with what is said of each")
        found.append({str(name): said for name, said in given.items()})
        for name, said in found[-1].items():
            if not isinstance(said, dict | None):
                raise DataError(f"{name}: expected {{young: 5, edge: 6}} or the like, got {str(said)[:40]!r}")
            if unknown := sorted(set(map(str, said or {})) - set(ORGAN_KEYS)):
                raise DataError(f"{name}: {unknown[0]}: no such key; there are {', '.join(ORGAN_KEYS)}")
    return found[0], found[1]


def _labels(path: Path) -> Labels:
    return with_names(read_labels(path), path)


def _attachment(given: Any) -> Attachment:
    if not isinstance(given, dict) or not {"first", "second", "stiffness"} <= set(given) <= set(SPRING_KEYS):
        raise DataError(f"attachments: {str(given)[:60]}: expected first, second, stiffness, and radius if you like")
    try:
        return Attachment(**given)
    except (TypeError, ValueError):
        raise DataError(f"attachments: {str(given)[:60]}: expected numbers, and places [x, y, z]") from None


def _tissue(folder: Path, labels: Labels | None, name: str, given: dict[str, Any]) -> Tissue:
    if name.endswith(".vtu"):
        if given:
            raise DataError(f"{name}: is a tissue, of which nothing else can be said; leave out {next(iter(given))}")
        return read_tissue(folder / name)
    if ("young" in given) == ("tissue" in given):
        raise DataError(f"{name}: give its stiffness: young: 5 (kPa), or a named tissue: liver")
    mesh = _meshed(labels, name, given)
    materials = named_materials(mesh, given.get("tissue"))
    young = _number(name, given, "young", 0.0, 1e6) if "young" in given else None
    poisson = _number(name, given, "poisson", 0.45, 0.4999) if "poisson" in given else None
    towards = np.asarray(given.get("towards", TOWARDS), dtype=object)
    if towards.shape != (3,) or not all(isinstance(x, int | float) for x in towards):
        raise DataError(f"{name}: towards: expected [x, y, z], such as [0, 1, 0]")
    way = towards.astype(float)
    extent = float(np.ptp(mesh.nodes @ way) / max(np.linalg.norm(way), 1e-12))
    fixed = resting_on(mesh, way, _number(name, given, "depth", DEPTH, 1.0) * extent)
    E, nu = young_of(mesh, young, materials), poisson_of(mesh, poisson, materials)
    return Tissue(mesh, E, nu, fixed, materials=materials, young_spread=spread_of(mesh, E, materials))


def _bone(labels: Labels | None, name: str, given: dict[str, Any]) -> TetMesh:
    if unknown := sorted(set(given) - {"edge", "keep"}):
        raise DataError(f"{name}: {unknown[0]}: a bone is rigid and held; it has edge and keep alone")
    return _meshed(labels, name, given)


def _meshed(labels: Labels | None, name: str, given: dict[str, Any]) -> TetMesh:
    if labels is None:
        raise DataError(f"{name}: no tissue's file (.vtu), and no label map is named; give labels: labels.nii.gz")
    edge = _number(name, given, "edge", EDGE, 1e3)
    return tetrahedralize(labels, name, edge, keep=given.get("keep", "largest"), closed_at_border=True)


def _number(name: str, given: dict[str, Any], key: str, otherwise: float, most: float = np.inf) -> float:
    value = given.get(key, otherwise)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= most:
        raise DataError(f"{name}: {key}: {str(value)[:40]!r}; expected a number from 0 to {most:g}")
    return float(value)
