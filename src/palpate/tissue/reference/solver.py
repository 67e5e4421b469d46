"""Chooses the reference solver, at small and at finite strain, by the element."""

from palpate.errors import MaterialError
from palpate.meshes.cutting.cut_mesh import refuse_cut
from palpate.tissue.reference.finite_strain import FiniteStrain
from palpate.tissue.reference.linear_elasticity import FiniteElements
from palpate.tissue.reference.smoothed_finite_strain import SmoothedFiniteStrain
from palpate.tissue.reference.taylor_hood import MixedElements
from palpate.tissue.tissue import ELEMENTS, Tissue


def finite_elements(tissue: Tissue, element: str | None = None) -> FiniteElements:
    """Return a linear finite-element solver for a tissue, by direct solves.

    Parameters
    ----------
    tissue : Tissue
        The solid.
    element : {"smoothed", "P1", "P2", "mixed"}, optional
        "mixed" (Taylor-Hood) is for nearly or fully incompressible tissue. The default is the tissue's own.

    Returns
    -------
    FiniteElements
        Its `push` answers as a model's does.

    Raises
    ------
    MaterialError
        If the element is unknown, or ν = 0.5 with an element other than "mixed"; or if the tissue has attachments.

    Examples
    --------
    >>> answer = pp.finite_elements(tissue).push(top, (0, 0, -2), radii=10)
    >>> bool(answer.force[2] > 0)
    True
    """
    chosen = tissue.element if element is None else element
    if chosen not in ELEMENTS:
        raise MaterialError(f"element: {chosen!r} is not built; choose one of {', '.join(ELEMENTS)}")
    _refuse_attachments(tissue)
    return MixedElements(tissue) if chosen == "mixed" else FiniteElements(tissue, chosen)


def _refuse_attachments(tissue: Tissue) -> None:
    if tissue.attachments:
        raise MaterialError("attachments: only the model `compliance` takes a tissue that has some; leave them out")


def finite_strain(tissue: Tissue, element: str | None = None) -> FiniteStrain:
    """Return a solver for a compressible neo-Hookean tissue at finite strain, by Newton's method.

    Parameters
    ----------
    tissue : Tissue
        The solid. Where it has a stiffening, the law is Demiray's.
    element : {"smoothed", "P1", "P2"}, optional
        The default is the tissue's own.

    Returns
    -------
    FiniteStrain
        Its `push` answers as a model's does.

    Raises
    ------
    MaterialError
        If the element is another, or ν = 0.5.

    References
    ----------
    Bonet & Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, 2008. Demiray, J. Biomech. 5 (1972) 309.

    Examples
    --------
    >>> answer = pp.finite_strain(tissue).push(top, (0, 0, -4), radii=10)
    >>> bool(answer.force[2] > 0)
    True
    """
    refuse_cut(tissue.mesh, "finite strain")
    _refuse_attachments(tissue)
    chosen = tissue.element if element is None else element
    return SmoothedFiniteStrain(tissue) if chosen == "smoothed" else FiniteStrain(tissue, chosen)
