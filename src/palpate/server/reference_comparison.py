"""The distance of a session's frames from linear finite elements, computed in a thread for the pages that request it."""

import asyncio
from collections.abc import Callable, Coroutine
from time import monotonic
from typing import Any

import numpy as np
from starlette.websockets import WebSocket

from palpate.arrays import Int32
from palpate.errors import DataError, MaterialError
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.server.message_kinds import ComparisonState
from palpate.server.messages import DISTANCE_STEPS, Difference, encode, flat
from palpate.simulation.fem_reference import DisplayedTick, FemDifference, fem_difference
from palpate.simulation.pointer import TOOLS
from palpate.simulation.session import Session
from palpate.tissue.models.compliance import ComplianceModel
from palpate.tissue.models.tissue_model import TissueModel
from palpate.tissue.tissue import Tissue

MIN_INTERVAL = 0.1  # s between comparisons
TIME_SHARE = 0.25  # largest fraction of the time spent comparing; the loop needs the processor
PREPARING_DELAY = 0.05  # s until the pages are told that the reference is being prepared
ZERO = 1e-6  # mm: smaller distances are not sent

BuildModel = Callable[[Tissue, str], Coroutine[Any, Any, TissueModel]]


class ReferenceComparison:
    """Used on the event loop's thread only; long computations run in another thread, one at a time.

    build_model: builds a model of a tissue by its name, once. pages: those that requested it. newest: the last message.
    """

    def __init__(self, build_model: BuildModel) -> None:
        self.build_model = build_model
        self.pages: set[WebSocket] = set()
        self.newest = b""
        self.task: asyncio.Task[None] | None = None
        self._due = 0.0  # by the monotonic clock
        self._session: Session | None = None  # of the newest message
        self._without_reference: Tissue | None = None

    def request(self, page: WebSocket, on: bool) -> None:
        """Turns comparisons on or off for a page."""
        (self.pages.add if on else self.pages.discard)(page)
        if not self.pages:
            self.newest = b""

    def update(self, session: Session, frame: Any) -> "asyncio.Task[None] | None":
        """Starts a comparison of a new frame if a page requested it, none runs, and it is due."""
        if session is not self._session:
            self._session, self.newest = session, b""
        if not self.pages or monotonic() < self._due or (self.task and not self.task.done()):
            return None
        self.task = asyncio.create_task(self._compare(session, DisplayedTick.of(frame)))
        return self.task

    async def _compare(self, session: Session, tick: DisplayedTick) -> None:
        cut = isinstance(
            session.mesh, CutMesh
        )  # compliance alone goes on after a cut, and that is the reference itself
        exact, took = None if cut else await self._reference(session.first.tissue, tick), 0.0
        message = difference_bytes(ComparisonState.no_reference, tick)
        if exact:
            began = monotonic()
            message = await asyncio.to_thread(compare, exact, tick, session.settings.radius, session.shown)
            took = monotonic() - began
        self._due = monotonic() + max(MIN_INTERVAL, took * (1 / TIME_SHARE - 1))
        if self.pages and session is self._session:
            self.newest = message

    async def _reference(self, tissue: Tissue, tick: DisplayedTick) -> ComplianceModel | None:
        """Linear finite elements of the same mesh, factored; None if its stiffness matrix cannot be factored."""
        if tissue is self._without_reference:
            return None
        building = asyncio.ensure_future(self.build_model(tissue, "compliance"))
        if not (await asyncio.wait({building}, timeout=PREPARING_DELAY))[0]:
            self.newest = difference_bytes(ComparisonState.preparing, tick)
        try:
            exact = await building
        except (MaterialError, MemoryError):
            self._without_reference = tissue
            return None
        assert isinstance(exact, ComplianceModel)
        if exact.gaps is not None:  # its factors alone know of no contact between organs
            self._without_reference = tissue
            return None
        return exact


def compare(exact: ComplianceModel, tick: DisplayedTick, radius: float, shown: Int32) -> bytes:
    """The message about one tick; arguments as those of `gap`."""
    try:
        found = fem_difference(exact, tick, radius, shown)
    except DataError:
        return difference_bytes(ComparisonState.contacts_overlap, tick)
    return difference_bytes(ComparisonState.compared, tick, found)


def difference_bytes(state: ComparisonState, tick: DisplayedTick, found: FemDifference | None = None) -> bytes:
    """A difference as a message. The step is the largest distance over 65535; without distances there is no array."""
    force = np.zeros((TOOLS, 3))
    if found:
        force[list(tick.tools)] = found.force
    largest = float(found.distance.max(initial=0.0)) if found else 0.0
    empty = found is None or largest < ZERO
    message = Difference(
        state=state,
        tick=float(tick.number),
        force=flat(force.tolist()),
        force_error=found.off if found else 0.0,
        step=0.0 if empty else largest / DISTANCE_STEPS,
        count=0 if found is None or empty else len(found.distance),
    )
    if found is None or empty:
        return encode(message)
    return encode(message, np.rint(found.distance * (DISTANCE_STEPS / largest)).astype("<u2"))
