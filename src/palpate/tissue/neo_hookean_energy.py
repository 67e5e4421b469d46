"""The energy of a tissue at finite strain, on its own elements."""

from palpate import _core
from palpate.tissue.reference.linear_elasticity import lame
from palpate.tissue.smoothed_elements import edge_stiffening, smoothing_cells
from palpate.tissue.tissue import Tissue


def neo_hookean_energy(tissue: Tissue, element: str | None = None) -> "_core.hyperelastic.HyperelasticEnergy":
    """The compressible neo-Hookean energy on an element, "P1" or, for any other, "smoothed"; None: the tissue's own.

    Where the tissue stiffens, the terms with μ are those of Demiray's law (J. Biomech. 5 (1972) 309), of which
    neo-Hookean is the limit: μ/2b (exp(b (tr FᵀF − 3 − 2 ln J)) − 1), b the exponent.
    """
    mesh, (lam, mu) = tissue.mesh, lame(tissue.young, tissue.poisson)
    if (element or tissue.element) == "P1":
        return _core.hyperelastic.NeoHookean(mesh.nodes, mesh.tets, lam, mu, tissue.stiffening)
    cells = smoothing_cells(mesh, lam, mu)
    constants = (mu, cells.edge, cells.node, cells.mu, cells.lam, edge_stiffening(cells, mu, tissue.stiffening))
    return _core.hyperelastic.SmoothedNeoHookean(mesh.nodes, mesh.tets, *constants)
