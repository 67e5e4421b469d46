"""The tissues that the cuts of a session make one after the other, and the models of them."""

from palpate.errors import DataError
from palpate.meshes.cutting.blade import Blade
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.simulation.session_cuts import CutKind
from palpate.tissue.cutting import cut
from palpate.tissue.models.compliance import ComplianceModel
from palpate.tissue.models.tissue_model import TissueModel
from palpate.tissue.tissue import Tissue


def tissues_after(tissues: tuple[Tissue, ...], kind: CutKind, blade: Blade | None) -> tuple[Tissue, ...]:
    """The first tissue and those after each cut, once there is one more change. Raises `DataError`, and what `cut` does."""
    if kind != "cut" and len(tissues) < 2:
        raise DataError(f"{kind}: nothing has been cut in this session; cut first")
    before = tissues if kind == "cut" else tissues[:-1]
    if blade is None:
        return before
    blades = (*blades_of(before[-1])[len(blades_of(tissues[0])) :], blade)
    return (*before, cut(tissues[0], blades, loose="remove"))  # of all of it: a piece may have been taken away


def blades_of(tissue: Tissue) -> tuple[Blade, ...]:
    """Of all its cuts."""
    return tissue.mesh.blades if isinstance(tissue.mesh, CutMesh) else ()


def taken_by_name(tissue: Tissue) -> dict[str, float]:
    """Volumes of the pieces that its cuts have freed and that were taken away, by name of the region, mm³."""
    mesh = tissue.mesh
    volumes = mesh.figures.taken if isinstance(mesh, CutMesh) else {}
    return {(mesh.names or {}).get(region, f"region {region}"): volume for region, volume in volumes.items()}


def model_after(tissue: Tissue, first: TissueModel, present: TissueModel) -> ComplianceModel:
    """The model of the tissue after a change: the session's first one if all cuts are taken back, else a new one.

    While a new one is made, the present one computes no tables, since they would not be used any more.
    """
    if tissue is first.tissue and type(first) is ComplianceModel:
        return first
    assert isinstance(present, ComplianceModel)
    present.native.looks_ahead = False
    try:
        return ComplianceModel(tissue)
    finally:
        present.native.looks_ahead = True
