"""The tissues that the cuts of a session make one after the other, and the models of them."""

from palpate.errors import DataError
from palpate.meshes.cutting.blade import Blade
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
    return before if blade is None else (*before, cut(before[-1], blade))


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
