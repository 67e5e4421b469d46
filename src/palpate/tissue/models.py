"""The ladder of models behind one interface."""

from typing import Any

from palpate.errors import MaterialError
from palpate.tissue.base import TissueModel
from palpate.tissue.blocks import BlockModel
from palpate.tissue.compliance import ComplianceModel
from palpate.tissue.hyperelastic import NeoHookeanModel
from palpate.tissue.multigrid import MultigridModel
from palpate.tissue.springs import SpringModel
from palpate.tissue.tissue import Tissue

_MODELS: dict[str, type[TissueModel]] = {
    "springs": SpringModel,
    "blocks": BlockModel,
    "multigrid": MultigridModel,
    "compliance": ComplianceModel,
    "neo-hookean": NeoHookeanModel,
}


def model(tissue: Tissue, name: str = "blocks", **options: Any) -> TissueModel:
    """A real-time model of a tissue: a rung of the ladder by its name.

    "springs": home and edge springs. "blocks": ring sweeps on finite elements. "multigrid": conjugate gradients
    on the same, preconditioned by multigrid. "compliance": the same factored once, forces from tables. "neo-hookean":
    finite strain.

    options: keywords of the model's class, such as relaxation, or law (a `SpringLaw`) for springs. It answers pushes
    with `.push(points, displacements, radii)`; `.native` is the C++ model that the loop runs. Raises `MaterialError`
    for a name that is not built.
    """
    if name not in _MODELS:
        raise MaterialError(f"model: {name!r} is not built; choose one of {', '.join(_MODELS)}")
    return _MODELS[name](tissue, **options)


def names() -> tuple[str, ...]:
    """Of all models that `model` makes."""
    return tuple(_MODELS)


def name_of(model: TissueModel) -> str:
    """The name by which `model` makes models of this kind."""
    return next(name for name, kind in _MODELS.items() if type(model) is kind)
