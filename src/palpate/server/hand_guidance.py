"""A teacher guides a hand in a room: who guides whom, from when on and until when, and what each end tells the other one.

The room makes no force of it. Each page makes that of its own hand, by `web/src/tools/guidance-coupling.ts`, from where the
other's tool was last commanded to be, and keeps its own account of energy.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from starlette.websockets import WebSocket

from palpate.arrays import Float64
from palpate.server.held_tools import HeldTools
from palpate.server.message_kinds import GuidanceState
from palpate.server.messages import GUIDANCE_LIMIT, Guidance, Guided, encode
from palpate.simulation.pointer import Vector
from palpate.simulation.session_events import FREED, GUIDED

UNSEEN = 1.0  # N mm that an end may give beyond what its hand's way says, which is not seen between two commands
NOWHERE: Vector = (0.0, 0.0, 0.0)


@dataclass(eq=False)
class Party:
    """One of the two hands. number: the person's. tool: by its page's own number, once it holds.

    at: mm, where the tool was commanded to be last; way: mm that it has come so far. given, force: as its page says.
    """

    page: WebSocket | None = None
    number: int = 0
    tool: int | None = None
    at: Float64 | None = None
    way: float = 0.0
    given: float = 0.0
    force: Vector = NOWHERE

    def move(self, at: Float64) -> None:
        """Its tool is commanded to be there."""
        if self.at is not None:
            self.way += float(np.linalg.norm(at - self.at))
        self.at = at

    @property
    def place(self) -> Vector:
        """Where its tool is, mm."""
        x, y, z = NOWHERE if self.at is None else self.at.tolist()
        return x, y, z


class HandGuidance:
    """At most one at a time in a room. Used on the event loop's thread only.

    number: counts guidances. teacher, trainee: the two hands while there is one; it begins once both hold a tool. guided:
    the session's tool that is guided now.
    """

    def __init__(self, tools: HeldTools) -> None:
        self.tools = tools
        self.state = GuidanceState.none
        self.number = 0
        self.teacher: Party | None = None
        self.trainee: Party | None = None
        self.guided: int | None = None
        self._told = (self.state, self.number)
        self._last: dict[tuple[WebSocket, int], Float64] = {}  # where each tool was commanded to be

    def ask(self, teacher: Party, trainee: Party) -> None:
        """A teacher wants to guide a hand."""
        self.number += 1
        self.teacher, self.trainee = teacher, trainee
        self.state = GuidanceState.waiting

    def end(self, page: WebSocket | None = None) -> None:
        """Nobody guides a hand any more. page: only if it has one of the two."""
        if page is None or self.of(page):
            self.teacher = self.trainee = None
            self.state = GuidanceState.none

    @property
    def parties(self) -> tuple[Party, ...]:
        """The teacher's hand, then the trainee's; none if nobody guides."""
        return (self.teacher, self.trainee) if self.teacher and self.trainee else ()

    def of(self, page: WebSocket) -> Party | None:
        """The hand of a page, if it is one of the two."""
        return next((party for party in self.parties if party.page is page), None)

    def command(self, page: WebSocket, tool: int, at: Float64) -> None:
        """A tool of a page is commanded to be somewhere, mm."""
        self._last[page, tool] = at
        party = self.of(page)
        if party and party.tool == tool:
            party.move(at)

    def hear(self, page: WebSocket, told: Guided) -> None:
        """What a page says of its end. No end can have given more than its hand has put in and the other one has given."""
        party = self.of(page)
        if party is None or told.number != self.number or self.state != GuidanceState.on:
            return
        other = self.parties[0] if party is self.trainee else self.parties[1]
        most = UNSEEN + other.given + GUIDANCE_LIMIT * party.way
        party.given = max(party.given, min(told.given, most))
        party.force = told.force

    def look(self, mark: Callable[[int, int], None]) -> bool:
        """Begins once both hold a tool, and ends when one of the two has let go. Returns whether pages must be told.

        mark: is told of a beginning or an end, and of which of the session's tools.
        """
        if self.state == GuidanceState.waiting:
            self._begin()
        elif any(self._tool_of(party) is None for party in self.parties):
            self.end()
        now = self._tool_of(self.trainee) if self.trainee and self.state == GuidanceState.on else None
        if now != self.guided:
            if self.guided is not None:
                mark(FREED, self.guided)
            if now is not None:
                mark(GUIDED, now)
            self.guided = now
        told, self._told = self._told, (self.state, self.number)
        return told != self._told

    def _begin(self) -> None:
        """Couples the first tool that each holds, if each holds one."""
        for party in self.parties:
            mine = (number for page, number in self.tools.holders.values() if page is party.page)
            party.tool = min((number for number in mine if (party.page, number) in self._last), default=None)
        if all(party.tool is not None for party in self.parties):
            for party in self.parties:
                party.move(self._last[party.page, party.tool])  # type: ignore[index]
            self.state = GuidanceState.on

    def _tool_of(self, party: Party) -> int | None:
        """The session's tool in one of the two hands, if it is held."""
        return None if party.tool is None or party.page is None else self.tools.tool(party.page, party.tool)

    def leave(self, page: WebSocket) -> None:
        """A page has gone."""
        self._last = {hand: at for hand, at in self._last.items() if hand[0] is not page}
        self.end(page)

    def told(self) -> bytes:
        """As a message."""
        one, other = self.parties or (Party(), Party())
        return encode(
            Guidance(
                state=int(self.state),
                number=self.number,
                teacher=one.number,
                trainee=other.number,
                teacher_tool=one.tool or 0,
                trainee_tool=other.tool or 0,
                teacher_at=one.place,
                trainee_at=other.place,
                teacher_given=one.given,
                trainee_given=other.given,
                teacher_force=one.force,
                trainee_force=other.force,
            )
        )
