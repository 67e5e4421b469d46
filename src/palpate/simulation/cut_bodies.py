"""The bodies that the cuts of a session make one after the other, and the models of them."""

from dataclasses import dataclass

from palpate.meshes.cutting.blade import Blade
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.simulation.loose_pieces import LoosePiece
from palpate.tissue.cutting import cut_apart
from palpate.tissue.cutting_work import CuttingWork
from palpate.tissue.models.compliance import ComplianceModel
from palpate.tissue.models.tissue_model import TissueModel
from palpate.tissue.tissue import Tissue


@dataclass(frozen=True, eq=False)
class CutBody:
    """What a session has after some cuts. pieces: loose ones beside the tissue. work: of its last cut, once it is known."""

    tissue: Tissue
    pieces: tuple[LoosePiece, ...] = ()
    work: CuttingWork | None = None


def cut_once_more(first: Tissue, before: Tissue, blade: Blade) -> tuple[Tissue, tuple[CutMesh, ...]]:
    """A session's first tissue with the cuts of a later one and one more, and the pieces that have come free.

    Raises what `cut` does.
    """
    return cut_apart(first, (*blades_of(before)[len(blades_of(first)) :], blade))


def blades_of(tissue: Tissue) -> tuple[Blade, ...]:
    """Of all its cuts."""
    return tissue.mesh.blades if isinstance(tissue.mesh, CutMesh) else ()


def taken_by_name(tissue: Tissue) -> dict[str, float]:
    """Volumes of the pieces that its cuts have freed, by name of the region, mm³."""
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
