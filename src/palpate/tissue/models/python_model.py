"""Tissue models that a user writes in Python; the real-time loop asks for their answer at display rate."""

import weakref
from abc import abstractmethod

import numpy as np

from palpate import _core
from palpate.arrays import ArrayLike, Float64
from palpate.tissue.contact_patches import Contacts
from palpate.tissue.models.tissue_model import TissueModel
from palpate.tissue.tissue import Tissue

RATE = 60.0  # answers a second


class PythonModel(TissueModel):
    """Base class of a tissue model of a user's own. A class that derives from it writes `equilibrium`.

    By the clock the loop of 1000 ticks a second takes the force from the newest answer's force and stiffness, and what is
    shown from its displacement; a contact is first felt when its first answer is there. In lockstep (`Session.step`)
    each tick waits for an answer of its own. The `error` of an answer is NaN, for nobody certifies it.
    """

    def __init__(self, tissue: Tissue) -> None:
        self_of = weakref.ref(self)  # the native model must not keep this object alive

        def solve(patches: "list[_core.tissue.ContactPatch]", displacement: Float64) -> tuple[Float64, ...]:
            model = self_of()
            assert model is not None
            return model._answer(Contacts(patches, displacement, False))

        super().__init__(tissue, _core.tissue.PythonModel(len(tissue.mesh.nodes), RATE, solve))

    @abstractmethod
    def equilibrium(self, W: Float64, displacement: Float64) -> tuple[ArrayLike, ArrayLike, ArrayLike]:
        """The equilibrium under m contacts. One thread at a time calls it.

        W: (N, m) weights of the contacts' nodes; each column sums to 1. displacement: (m, 3) mm, what Wᵀu has to be.
        Returns u (N, 3) mm; the force (m, 3) N of the tissue on the tools, so that force · displacement <= 0; and the
        stiffness (3m, 3m) N/mm, minus the derivative of the force by the displacement.
        """

    def solve(
        self, found: Contacts, state: "_core.tissue.ModelState", tolerance: float, most_sweeps: int
    ) -> tuple[Float64, float, int]:
        """One equilibrium."""
        state.u[:], force, _ = self._answer(found)
        return force, float("nan"), 1

    def _answer(self, found: Contacts) -> tuple[Float64, ...]:
        answer = self.equilibrium(found.weights(len(self.tissue.mesh.nodes)), found.displacement)
        return tuple(np.ascontiguousarray(part, np.float64) for part in answer)
