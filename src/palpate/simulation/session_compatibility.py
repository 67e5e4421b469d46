"""What a record says of its session, and whether another fits: tissue by a hash, model by name, settings one by one."""

import hashlib
from typing import Any

import numpy as np
import scipy.linalg  # noqa: F401 (loads SciPy's BLAS, which is to be named)
from threadpoolctl import threadpool_info

from palpate import _core
from palpate.errors import DataError, FileError
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.simulation.recording import Record
from palpate.tissue.models.registry import name_of
from palpate.tissue.models.tissue_model import TissueModel
from palpate.tissue.relaxation import Relaxation
from palpate.tissue.tissue import SpringLaw, Tissue

_OF_BLADES = ("blade_friction", "give")  # unknown to records without a blade's force, as is _TOUGHNESS
_TOUGHNESS = "toughness of region "  # and its label: J/m²
_SETTINGS = (
    "sweeps", "radius", "limit", "ramp", "approach", "reach", "friction", "puncture", "cutting", "shaft_friction",
    "nodal_weights", *_OF_BLADES,
)  # fmt: skip


def description_of(model: TissueModel, settings: Any) -> dict[str, Any]:
    """What a record says of a session that began with this model and (the core's) settings."""
    return {
        "model": name_of(model),
        "tissue": fingerprint(model),
        "settings": settings_of(model, settings),
        "instructions": arithmetic(),
    }


def settings_of(model: TissueModel, settings: Any) -> dict[str, float]:
    """What a tick does besides the model's equations, by name. settings: the core's."""
    numbers = {name: float(getattr(settings, name)) for name in _SETTINGS}
    tough = {f"{_TOUGHNESS}{label}": value for label, value in settings.resistance.toughness.items()}
    return {**numbers, **tough, **model.settings}


def arithmetic() -> str:
    """Whose rounding a session has: the instruction set of the core and, of each BLAS, for which processors it is."""
    blas = {each["architecture"] for each in threadpool_info() if each["user_api"] == "blas" and "architecture" in each}
    return ", ".join([_core.base.instruction_set(), *sorted(blas)])


def check_record(record: Record, model: TissueModel, settings: Any) -> None:
    """Raises `DataError` if `record` was not made with this tissue, model and (the core's) settings."""
    if record.tissue != fingerprint(model):
        raise DataError(
            f"record: made on tissue {record.tissue}, not {fingerprint(model)}; open the tissue it was recorded with"
            f"{' (version 0.1 had P1 elements alone)' if has_nodal_weights(record) else ''}"
        )
    if record.model != name_of(model):
        raise DataError(
            f"record: made with model {record.model!r}, not {name_of(model)!r}; make the session of that model"
        )
    for name, value in settings_of(model, settings).items():
        if name == "nodal_weights" or (name == "interval" and value == 0 and has_nodal_weights(record)):
            continue  # a replay takes those of its record; version 0.1 knew no other
        if (name in _OF_BLADES or name.startswith(_TOUGHNESS)) and "give" not in record.settings:
            continue
        if record.settings.get(name) != value:
            raise DataError(f"record: made with {name} = {record.settings.get(name)}, not {value:g}; use the record's")


def has_nodal_weights(record: Record) -> bool:
    """Whether the record was made with the contact weights of version 0.1, whose files do not name the weights."""
    return bool(record.settings.get("nodal_weights", 1.0))


def fingerprint(model: TissueModel) -> str:
    """A hash of what the model was made of: mesh, elastic constants, held nodes, element, spring law."""
    return _hash(model.tissue, getattr(model, "law", None))


def tissue_hash(tissue: Tissue) -> str:
    """A hash of mesh, elastic constants, held nodes, element, and what is set for time and large strain."""
    return _hash(tissue, None)


def same_tissue(model: TissueModel, first: TissueModel) -> bool:
    """Whether `model` has the tissue and the spring law of `first`, so that a session may change to it."""
    law, usual = getattr(model, "law", None), getattr(first, "law", None) or first.tissue.springs or SpringLaw()
    return law in (None, usual) and _hash(model.tissue, None) == _hash(first.tissue, None)


def _hash(tissue: Tissue, law: SpringLaw | None) -> str:
    mesh, hash_ = tissue.mesh, hashlib.sha256()
    parts = [mesh.nodes, mesh.tets, mesh.region, tissue.young, tissue.poisson, tissue.fixed]
    if isinstance(mesh, CutMesh):
        parts += [mesh.share, mesh.skin.triangles, mesh.skin.tet, mesh.skin.weight]
    for part in parts:
        array = np.ascontiguousarray(part)
        hash_.update(f"{array.dtype}{array.shape}".encode() + array.tobytes())
    hash_.update(repr(law).encode())
    if tissue.element != "P1":  # the only one of version 0.1
        hash_.update(tissue.element.encode())
    if tissue.relaxation is not None:
        hash_.update(_relaxation_text(tissue.relaxation).encode())
    if tissue.inertia is not None:
        hash_.update(repr(tissue.inertia).encode())
    if tissue.stiffening.any():  # version 0.1 had none
        hash_.update(b"stiffening" + tissue.stiffening.tobytes())
    if tissue.attachments:
        hash_.update(repr(tissue.attachments).encode())
    if tissue.surface_friction > 0:
        hash_.update(f"surface friction {tissue.surface_friction!r}".encode())
    return hash_.hexdigest()[:32]


def _relaxation_text(relaxation: Relaxation | dict[int, Relaxation]) -> str:
    """Of one relaxation of shear and bulk alike, what the first version hashed."""
    if isinstance(relaxation, dict):
        return "; ".join(f"{region}: {_relaxation_text(one)}" for region, one in sorted(relaxation.items()))
    text = f"Relaxation(shares={relaxation.shares!r}, times={relaxation.times!r})"
    return text if relaxation.bulk else f"{text}, shear alone"


def recorded_settings(record: Record) -> dict[str, Any]:
    """Keywords that make a `Session` like the recorded one."""
    try:
        numbers: dict[str, Any] = {name: record.settings[name] for name in ("radius", "limit", "friction")}
        tough = {
            int(name[len(_TOUGHNESS) :]): value
            for name, value in record.settings.items()
            if name.startswith(_TOUGHNESS)
        }
        blade = {"toughness": tough, "blade_friction": record.settings.get("blade_friction", 0.0)}
        return {**numbers, **blade, "sweeps": int(record.settings["sweeps"])}
    except KeyError as missing:
        raise FileError(f"record: it does not say {missing}; record the session again") from None


def model_settings(record: Record) -> dict[str, Any]:
    """Keywords that make the recorded model from its tissue."""
    of_model = {
        name: value
        for name, value in record.settings.items()
        if name not in _SETTINGS and not name.startswith(_TOUGHNESS)
    }
    return of_model | _of_0_1(record, record.model)


def settings_after_change(record: Record, name: str) -> dict[str, Any]:
    """Keywords that make a model to which the recorded session changed."""
    return _of_0_1(record, name)


def _of_0_1(record: Record, name: str) -> dict[str, Any]:
    """The models of version 0.1 solved in the ticks."""
    return {"interval": 0} if name in ("neo-hookean", "multigrid") and has_nodal_weights(record) else {}
