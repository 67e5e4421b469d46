"""The work of a cut in a session, with the elastic energy that the tissue loses by it while tools hold still."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate import _core
from palpate.arrays import Float64
from palpate.simulation.pointer import TOOLS
from palpate.tissue.contact_patches import contacts
from palpate.tissue.cutting_work import CuttingWork, cutting_work, together
from palpate.tissue.models.compliance import ComplianceModel
from palpate.tissue.models.tissue_model import TissueModel

TAKEN_AWAY = 0.1  # mm from a contact to the surface after a cut, from which on its place is gone, as in simulation.cpp


@dataclass(frozen=True, eq=False)
class HeldPoints:
    """Points of the tissue that tools hold, (t, 3) mm, how far they are displaced, (t, 3) mm, and the contact's radius."""

    points: Float64
    displacements: Float64
    radius: float

    def energy(self, model: TissueModel) -> float:
        """Elastic energy, mJ, of a body that is held so where it is there: half of the forces times the displacements."""
        surface = model.tissue.surface
        there = np.array([surface.closest(point).distance <= TAKEN_AWAY for point in self.points], dtype=bool)
        if not there.any():
            return 0.0
        assert isinstance(model, ComplianceModel)
        ways = self.displacements[there]
        found = contacts(model.tissue, self.points[there], ways, np.full(len(ways), self.radius))
        return float((model.held_forces(found) * ways).sum() / 2)


def held_points(frame: Any, radius: float) -> HeldPoints:
    """Those of a frame of the loop."""
    closed = _core.simulation.ContactState.closed
    held = [tool for tool in range(TOOLS) if frame.contact[tool] == closed and np.any(frame.displacement[tool])]
    return HeldPoints(np.array(frame.point)[held], np.array(frame.displacement)[held], radius)


def work_of_cut(
    before: TissueModel,
    after: TissueModel,
    held: HeldPoints,
    toughness: float | Mapping[int | str, float] | None,
    friction: float,
    extended: CuttingWork | None = None,
) -> CuttingWork:
    """The work of the cut between two models. toughness, friction: of the blade, as `cutting_work` takes them. extended: of
    the cut that it makes longer.
    """
    released = held.energy(before) - held.energy(after)
    work = cutting_work(before.tissue, after.tissue, toughness, friction, released)
    return work if extended is None else together(extended, work)
