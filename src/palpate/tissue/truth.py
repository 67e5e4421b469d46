"""The elastic truth by the element one asks for."""

from palpate.errors import MaterialError
from palpate.tissue.elasticity import FiniteElements
from palpate.tissue.mixed import MixedElements
from palpate.tissue.tissue import ELEMENTS, Tissue


def finite_elements(tissue: Tissue, element: str | None = None) -> FiniteElements:
    """The elastic truth of a tissue: `finite_elements(tissue).push(...)` answers like a model, by direct solves.

    element: "P1", "P2", "mixed" (nearly or quite incompressible); None: the tissue's own. Raises `MaterialError` for
    elements that are not built, and for ν = 0.5 with any but "mixed".
    """
    chosen = tissue.element if element is None else element
    if chosen not in ELEMENTS:
        raise MaterialError(f"element: {chosen!r} is not built; choose one of {', '.join(ELEMENTS)}")
    return MixedElements(tissue) if chosen == "mixed" else FiniteElements(tissue, chosen)
