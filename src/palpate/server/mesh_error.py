"""The estimated error of the force that the mesh makes, computed in a thread beside the loop."""

import asyncio
import contextlib
from time import monotonic
from typing import Any

from palpate.errors import DataError
from palpate.simulation.fem_reference import DisplayedTick, mesh_error
from palpate.simulation.pointer import ContactState
from palpate.simulation.session import Session
from palpate.tissue.models.compliance import ComplianceModel

UNKNOWN = float("nan")
MIN_INTERVAL = 0.3  # s between estimates
TIME_SHARE = 0.2  # largest fraction of the time spent on them; the loop needs the processor


class MeshErrorEstimate:
    """Used on the event loop's thread only. newest: the last estimate, relative to the force; NaN where there is none.

    The model `compliance` alone has one: it answers by factors that are there already.
    """

    def __init__(self) -> None:
        self.newest = UNKNOWN
        self.task: asyncio.Task[None] | None = None
        self._due = 0.0  # by the monotonic clock
        self._model: object = None  # of the newest estimate

    def update(self, session: Session, frame: Any) -> "asyncio.Task[None] | None":
        """Starts an estimate for a new frame if a tool holds, none runs, and it is due."""
        model = session.model
        if model is not self._model or ContactState.closed not in list(frame.contact):
            self._model, self.newest = model, UNKNOWN
        if not isinstance(model, ComplianceModel) or monotonic() < self._due or (self.task and not self.task.done()):
            return None
        tick = DisplayedTick.of(frame)
        if not tick.tools:
            return None
        self.task = asyncio.create_task(self._estimate(model, tick, session.settings.radius))
        return self.task

    async def _estimate(self, model: ComplianceModel, tick: DisplayedTick, radius: float) -> None:
        began, found = monotonic(), UNKNOWN
        with contextlib.suppress(DataError):  # contacts that no force can tell apart
            found = await asyncio.to_thread(mesh_error, model, tick, radius)
        self._due = monotonic() + max(MIN_INTERVAL, (monotonic() - began) * (1 / TIME_SHARE - 1))
        if model is self._model:
            self.newest = found
