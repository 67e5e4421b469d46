"""The tissue models by name."""

from typing import Any

from palpate import plugins
from palpate.errors import MaterialError
from palpate.tissue.models.block_gauss_seidel import BlockModel
from palpate.tissue.models.compliance import ComplianceModel
from palpate.tissue.models.mass_spring import SpringModel
from palpate.tissue.models.multigrid import MultigridModel
from palpate.tissue.models.neo_hookean import NeoHookeanModel
from palpate.tissue.models.p1_compliance import P1ComplianceModel
from palpate.tissue.models.tissue_model import TissueModel
from palpate.tissue.tissue import Tissue

_MODELS: dict[str, type[TissueModel]] = {
    "springs": SpringModel,
    "blocks": BlockModel,
    "multigrid": MultigridModel,
    "compliance": ComplianceModel,
    "neo-hookean": NeoHookeanModel,
}
STAND_IN = "compliance-P1"  # for compliance, until that is made
_IN_SESSIONS = _MODELS | {STAND_IN: P1ComplianceModel}


def model(tissue: Tissue, name: str = "blocks", **options: Any) -> TissueModel:
    """Return a real-time model of a tissue.

    Its `push(points, displacements, radii)` answers with forces in N and displacements in mm.

    Parameters
    ----------
    tissue : Tissue
        The solid.
    name : str, optional
        "springs": home and edge springs. "blocks": block relaxation of finite elements. "multigrid": conjugate gradients
        with a multigrid preconditioner. "compliance": a factorization and Green's functions; "compliance-P1": the same on
        P1 elements, made sooner and too stiff. "neo-hookean": finite strain, with the tissue's stiffening if it has one.
    **options
        Keywords of the model's class, such as `law` (a `SpringLaw`) for springs or `memory` (MB) for compliance.

    Returns
    -------
    TissueModel
        The model. It is immutable and thread-safe.

    Raises
    ------
    MaterialError
        If there is no model of this name.

    References
    ----------
    See the theory of simulation in the documentation.

    Examples
    --------
    >>> answer = pp.model(tissue, "multigrid").push(top, (0, 0, -2), radii=10)
    >>> answer.error < 1e-3
    True
    """
    if name not in plugins.names("tissue_model"):
        raise MaterialError(f"model: {name!r} is not built; choose one of {', '.join(plugins.names('tissue_model'))}")
    kind: type[TissueModel] = plugins.part("tissue_model", name) or _IN_SESSIONS[name]
    return kind(tissue, **options)


def names() -> tuple[str, ...]:
    """Of all models that `model` makes of the tissue's own elements."""
    return tuple(_MODELS)


def names_in_sessions() -> tuple[str, ...]:
    """Of all models that a session may have."""
    return tuple(_IN_SESSIONS)


def name_of(model: TissueModel) -> str:
    """The name by which `model` makes models of this kind."""
    own = {name: plugins.part("tissue_model", name) for name in plugins.names("tissue_model")}
    return next(name for name, kind in (own | _IN_SESSIONS).items() if type(model) is kind)
