"""How far what the loop shows is from finite elements: computed beside it, for the pages that ask."""

import asyncio
from collections.abc import Callable, Coroutine
from time import monotonic
from typing import Any

import numpy as np
from starlette.websockets import WebSocket

from palpate.arrays import Int32
from palpate.errors import DataError, MaterialError
from palpate.server.messages import Difference, encode, flat
from palpate.simulation.devices.pointer import TOOLS
from palpate.simulation.reference import Gap, Tick, gap
from palpate.simulation.session import Session
from palpate.tissue.base import TissueModel
from palpate.tissue.compliance import ComplianceModel
from palpate.tissue.tissue import Tissue

LEAST_WAIT = 0.1  # s from one comparison to the next
SHARE = 0.25  # of the time at most that comparing takes: the loop needs the machine
PATIENCE = 0.05  # s without a reference, before the pages are told that it is being made
STEPS = 65535  # of the 16-bit distances
NOTHING = 1e-6  # mm: a distance below is none
PREPARED, COMPARED, NO_REFERENCE, TOO_CLOSE = range(4)  # `Difference.state`

Make = Callable[[Tissue, str], Coroutine[Any, Any, TissueModel]]


class Comparing:
    """Lives on the event loop's thread; what takes long runs in another, one comparison at a time.

    make: gives a tissue's model by its name, built once. pages: those that ask. newest: the last message for them.
    """

    def __init__(self, make: Make) -> None:
        self.make = make
        self.pages: set[WebSocket] = set()
        self.newest = b""
        self.task: asyncio.Task[None] | None = None
        self._due = 0.0  # of the monotonic clock
        self._session: Session | None = None  # that the newest message is of
        self._hopeless: Tissue | None = None  # has no reference

    def ask(self, page: WebSocket, on: bool) -> None:
        """A page asks for comparisons, or for no more. With nobody asking none begins."""
        (self.pages.add if on else self.pages.discard)(page)
        if not self.pages:
            self.newest = b""

    def look(self, session: Session, frame: Any) -> "asyncio.Task[None] | None":
        """A new frame of the session: a comparison begins if one is asked for, none runs, and it is time."""
        if session is not self._session:
            self._session, self.newest = session, b""
        if not self.pages or monotonic() < self._due or (self.task and not self.task.done()):
            return None
        self.task = asyncio.create_task(self._compare(session, Tick.of(frame)))
        return self.task

    async def _compare(self, session: Session, tick: Tick) -> None:
        exact, took = await self._reference(session.first.tissue, tick), 0.0
        message = difference_bytes(NO_REFERENCE, tick)
        if exact:
            began = monotonic()
            message = await asyncio.to_thread(compared, exact, tick, session.settings.radius, session.shown)
            took = monotonic() - began
        self._due = monotonic() + max(LEAST_WAIT, took * (1 / SHARE - 1))
        if self.pages and session is self._session:
            self.newest = message

    async def _reference(self, tissue: Tissue, tick: Tick) -> ComplianceModel | None:
        """Linear finite elements of the same mesh, factored; the pages are told while that takes its time."""
        if tissue is self._hopeless:
            return None
        making = asyncio.ensure_future(self.make(tissue, "compliance"))
        if not (await asyncio.wait({making}, timeout=PATIENCE))[0]:
            self.newest = difference_bytes(PREPARED, tick)
        try:
            exact = await making
        except (MaterialError, MemoryError):
            self._hopeless = tissue
            return None
        assert isinstance(exact, ComplianceModel)
        return exact


def compared(exact: ComplianceModel, tick: Tick, radius: float, shown: Int32) -> bytes:
    """The message about one tick; arguments as those of `gap`."""
    try:
        found = gap(exact, tick, radius, shown)
    except DataError:
        return difference_bytes(TOO_CLOSE, tick)
    return difference_bytes(COMPARED, tick, found)


def difference_bytes(state: int, tick: Tick, found: Gap | None = None) -> bytes:
    """A difference as a message; its step follows the biggest distance. Without one there is no array."""
    force = np.zeros((TOOLS, 3))
    if found:
        force[list(tick.tools)] = found.force
    most = float(found.distance.max(initial=0.0)) if found else 0.0
    none = found is None or most < NOTHING
    message = Difference(
        state=state,
        tick=float(tick.number),
        force=flat(force.tolist()),
        off=found.off if found else 0.0,
        step=0.0 if none else most / STEPS,
        count=0 if found is None or none else len(found.distance),
    )
    if found is None or none:
        return encode(message)
    return encode(message, np.rint(found.distance * (STEPS / most)).astype("<u2"))
