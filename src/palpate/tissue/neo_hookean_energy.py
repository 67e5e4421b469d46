"""The energy of a tissue at finite strain, on its own elements."""

from palpate import _core
from palpate.tissue.reference.linear_elasticity import lame
from palpate.tissue.smoothed_elements import smoothing_cells
from palpate.tissue.tissue import Tissue


def neo_hookean_energy(tissue: Tissue) -> "_core.hyperelastic.HyperelasticEnergy":
    """The compressible neo-Hookean energy of the tissue's elements, "P1" or, for any other, "smoothed"."""
    mesh, (lam, mu) = tissue.mesh, lame(tissue.young, tissue.poisson)
    if tissue.element == "P1":
        return _core.hyperelastic.NeoHookean(mesh.nodes, mesh.tets, lam, mu)
    cells = smoothing_cells(mesh, lam, mu)
    return _core.hyperelastic.SmoothedNeoHookean(mesh.nodes, mesh.tets, mu, cells.edge, cells.node, cells.mu, cells.lam)
