"""The estimated errors of the force, of mesh, linear strain and stiffness, computed in a thread beside the loop."""

import asyncio
from dataclasses import dataclass
from time import monotonic
from typing import Any

from palpate.errors import DataError
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.simulation.fem_reference import (
    DisplayedTick,
    force_spread,
    linear_solution,
    linearisation_error,
    mesh_error,
)
from palpate.simulation.pointer import ContactState
from palpate.simulation.session import Session
from palpate.tissue.models.compliance import ComplianceModel

UNKNOWN = float("nan")
MIN_INTERVAL = 0.15  # s between estimates
TIME_SHARE = 0.2  # largest fraction of the time spent on those of either kind; the loop needs the processor
ROOM_SHARE = 0.015  # of a room, since other rooms need it too


@dataclass
class ForceErrors:
    """Used on the event loop's thread only. The last estimates; NaN where there is none.

    time_share: largest fraction of the time spent on those of either kind. mesh, linearisation: relative to the force,
    positive if it is too large. stiffness: standard deviation of the force that the spread of the stiffness makes,
    relative to it. least_volume: of an element over its volume at rest, negative if one is turned over. The model
    `compliance` alone has them: it answers by factors that are there already.
    """

    time_share: float = TIME_SHARE
    mesh: float = UNKNOWN
    linearisation: float = UNKNOWN
    stiffness: float = UNKNOWN
    least_volume: float = UNKNOWN
    task: asyncio.Task[None] | None = None
    _due: float = 0.0  # by the monotonic clock
    _mesh_due: float = 0.0
    _model: object = None  # of the newest estimates

    def update(self, session: Session, frame: Any) -> "asyncio.Task[None] | None":
        """Starts an estimate for a new frame if a tool holds, none runs, and it is due."""
        model = session.model
        if model is not self._model or ContactState.closed not in list(frame.contact):
            self._model, self.mesh = model, UNKNOWN
            self.linearisation = self.least_volume = self.stiffness = UNKNOWN
        if (
            not isinstance(model, ComplianceModel)
            or isinstance(model.tissue.mesh, CutMesh)
            or model.gaps is not None
            or monotonic() < self._due
            or (self.task and not self.task.done())
        ):
            return None
        tick = DisplayedTick.of(frame)
        if not tick.tools:
            return None
        self.task = asyncio.create_task(self._estimate(model, tick, session.settings.radius))
        return self.task

    async def _estimate(self, model: ComplianceModel, tick: DisplayedTick, radius: float) -> None:
        began = monotonic()
        try:
            solution = await asyncio.to_thread(linear_solution, model, tick, radius)
            linearisation, least = await asyncio.to_thread(linearisation_error, model, solution)
            stiffness = await asyncio.to_thread(force_spread, model, solution)
        except DataError:  # contacts that no force can tell apart
            return
        finally:
            self._due = self._next(began)
        if model is self._model:
            self.linearisation, self.least_volume, self.stiffness = linearisation, least, stiffness
        if monotonic() < self._mesh_due:
            return
        began = monotonic()
        mesh = await asyncio.to_thread(mesh_error, model, solution)
        self._mesh_due = self._next(began)
        if model is self._model:
            self.mesh = mesh

    def _next(self, began: float) -> float:
        """When the next estimate is due after one that began then and has just ended."""
        return monotonic() + max(MIN_INTERVAL, (monotonic() - began) * (1 / self.time_share - 1))
