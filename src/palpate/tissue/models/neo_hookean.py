"""Model `neo-hookean`: hyperelasticity at finite strain, on smoothed or P1 tetrahedra."""

from typing import Any

import numpy as np

from palpate import _core
from palpate.arrays import Float64
from palpate.errors import DataError, MaterialError
from palpate.meshes.cutting.cut_mesh import refuse_cut
from palpate.tissue.contact_patches import Contacts
from palpate.tissue.models.compliance import ComplianceModel
from palpate.tissue.models.tissue_model import TissueModel, too_many_contacts
from palpate.tissue.neo_hookean_energy import neo_hookean_energy
from palpate.tissue.reference.linear_elasticity import nodal_shear
from palpate.tissue.tissue import Tissue

_BATCH = 20  # steps between checks of a tool that does not reach its target
_GIVEN_UP = 400
MOST_INTERVAL = 10_000  # ticks


class NeoHookeanModel(TissueModel):
    """Compressible neo-Hookean tissue, W = μ/2 (tr FᵀF − 3) − μ ln J + λ/2 (ln J)², on the tissue's `element`.

    Where the tissue has a stiffening b, the terms with μ are those of Demiray's law, μ/2b (exp(b (tr FᵀF − 3 − 2 ln J)) − 1).

    On smoothed elements the terms with μ take the mean F about each edge, and that with λ the volume about each node; a
    tetrahedron below 30 % of its volume resists by an energy of its own.

    For small pushes it is linear elasticity with the tissue's E and ν. The energy's minimum under the contacts is found
    by limited-memory BFGS steps from the factored stiffness at rest; no step turns an element inside out, and a push
    that no mesh could follow ends where the elements are flat (`push` then raises `DataError`).

    By the clock a thread of its own solves, as often as it can, and each tick of 1 ms takes the linear force of
    `compliance` and what the newest solution adds to it near its displacement. interval: the ticks that a solution takes
    in lockstep (`Session.step`), so that it is there with the delay of a thread; 0: no thread, the ticks themselves
    descend, as in version 0.1, and a larger mesh then keeps no rate.

    self_contact: the surface does not go through itself where it folds: what comes closer than 0.2 mm to another part is
    pushed back without friction (`cpp/hyperelastic/self_contact.h`). What hangs together within 3 edges is no other part.
    Solutions take up to twice as long, and where a tool slides in a deep dent a part may catch on another: not by default.

    An answer's `error` is an estimate, no bound: the residual in the energy norm that the descent has learnt of the
    tangent, over u in the norm of the tangent itself.
    """

    native: "_core.multirate.MultirateModel | _core.hyperelastic.HyperelasticModel"

    def __init__(self, tissue: Tissue, interval: int = 20, self_contact: bool = False) -> None:
        refuse_cut(tissue.mesh, "neo-hookean")
        interval = int(interval)
        if not 0 <= interval <= MOST_INTERVAL:
            raise DataError(f"interval: {interval} ticks; give 0 (descend in the ticks) to {MOST_INTERVAL}, such as 20")
        if (tissue.poisson >= 0.5).any():
            raise MaterialError(
                f"poisson: 0.5 at tet {int(np.argmax(tissue.poisson))}; this energy is for compressible tissue: give "
                f"0.45, or up to 0.49"
            )
        self.linear = ComplianceModel(tissue)
        elements = neo_hookean_energy(tissue)
        if self_contact:
            shear = nodal_shear(tissue.mesh, tissue.young, tissue.poisson)
            elements = _core.hyperelastic.SelfContact(elements, tissue.surface, shear)
        moving = np.flatnonzero(~tissue.held).astype(np.int32)
        self.equilibrium = _core.hyperelastic.HyperelasticModel(elements, self.linear.factors.native, moving)
        native: Any = self.equilibrium
        if interval:
            native = _core.multirate.MultirateModel(self.linear.native, self.equilibrium, interval, 0.5 * tissue.edge)
        super().__init__(
            tissue, native, {"interval": float(interval)} | ({"self_contact": 1.0} if self_contact else {})
        )

    def start(self) -> "_core.tissue.ModelState":
        """A state at rest, to hand to `push(warm=)`."""
        return self.equilibrium.make_state()

    def solve(
        self, found: Contacts, state: "_core.tissue.ModelState", tolerance: float, most_sweeps: int
    ) -> tuple[Float64, float, int]:
        """Steps of descent until the estimated error is below `tolerance`."""
        done, aim, before = 0, tolerance, np.inf
        most = min(most_sweeps, _GIVEN_UP)
        while True:
            batch = min(_BATCH, most - done)
            solved = self.equilibrium.solve(state, found.patches, found.displacement, batch, aim)
            if solved is None:
                raise too_many_contacts(found)
            force, steps = solved
            done += steps
            residual, size, gap = self.equilibrium.balance(state)
            error = float(np.sqrt(max(residual, 0.0) / size)) if size > 0 else 0.0
            if gap == 0 and (error <= tolerance or done >= most):
                return force, error, done
            if gap > 0 and (done >= most or (steps == 0 and gap >= before)):
                raise self._too_deep(gap, found)
            if gap == 0 and steps == 0:
                if aim < 1e-3 * tolerance:  # only rounding errors remain
                    return force, error, done
                aim *= 0.5
            before = gap

    def _too_deep(self, gap: float, found: Contacts) -> DataError:
        deep = float(np.linalg.norm(found.displacement, axis=1).max())
        return DataError(
            f"displacements: a tool that should go {deep:.3g} mm is stuck {gap:.3g} mm before, where elements of edge "
            f"{self.tissue.edge:.3g} mm are nearly flat; give a smaller push, a larger radius or a finer mesh"
        )
