"""How far the contact force of linear elasticity is from finite strain."""

from threading import Lock

import numpy as np

from palpate import _core
from palpate.arrays import Float64
from palpate.tissue.contact_patches import Contacts
from palpate.tissue.neo_hookean_energy import neo_hookean_energy
from palpate.tissue.sparse_factor import Factors
from palpate.tissue.tissue import Tissue

MOST_CONTACTS: int = _core.simulation.MAX_TOOLS
UNKNOWN = float("nan")


class LinearisationError:
    """Compares linear contact forces with those of finite strain: the same elements, moduli and stiffening.

    The latter are solved for, with the linear factors as preconditioner, until their error is some 1 %. The first-order
    estimate u·g(u)/u·Ku − 1, g the neo-Hookean forces of the linear displacement u, would need no solution; at ν = 0.45
    it is far too large, since u then changes volumes that finite strain keeps.
    """

    def __init__(self, tissue: Tissue, factors: Factors, element: str | None = None) -> None:
        moving = np.flatnonzero(~tissue.held).astype(np.int32)
        self.energy = neo_hookean_energy(tissue, element)
        self._lock = Lock()  # the solver has a state
        self._solver = _core.hyperelastic.EquilibriumSolver(
            _core.hyperelastic.HyperelasticModel(self.energy, factors.native, moving)
        )

    def __call__(self, found: Contacts, force: Float64) -> float:
        """Return the relative error of the force.

        Parameters
        ----------
        found : Contacts
            The contacts, glued, at most `MOST_CONTACTS`.
        force : ndarray, (m, 3)
            Linear force of the tools on the tissue, N.

        Returns
        -------
        float
            |force − F|/|F| with F at finite strain, negative if the force does less work than F; NaN where no solution was
            found, since elements would be flat.
        """
        with self._lock:
            solved = self._solver.solve(found.patches, found.displacement)
        if solved is None:
            return UNKNOWN
        _, realised, finite, _ = solved
        work = -float((finite * realised).sum())
        if np.abs(realised - found.displacement).max() > 1e-6 or not work > 0:
            return UNKNOWN
        apart = np.linalg.norm(force + finite) / np.linalg.norm(finite)  # `finite` is on the tools
        return float(np.copysign(apart, float((force * found.displacement).sum()) - work))

    def least_volume(self, u: Float64) -> float:
        """The least volume of an element over its volume at rest, negative if one is turned over. u: (N, 3) mm."""
        return float(self.energy.least_volume(np.ascontiguousarray(u)))
