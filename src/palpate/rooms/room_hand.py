"""The hand of a haptic device in a room: what it tells the room, and what the room tells the loop at its site.

The loop computes the organ and the force here, at once; no force comes from the room. The hand's own contact, which the loop
has found, goes to the room as that of a page's tool does. The tools of others go where the room has them, without steps.
As web/src/engine/predicted-session.ts does it in a page; the device's passivity observer is the energy account.
"""

from typing import Any

import numpy as np

from palpate.arrays import Float32
from palpate.server.message_kinds import CutStep, Role
from palpate.server.messages import Frame, Scalpel, ToolCommand
from palpate.simulation.pointer import TOOLS, CommandKind, ContactState, Vector
from palpate.simulation.session import RATE, Session

UNHEARD = 3000  # ticks after which a hold that no frame has obeyed is given up: all tools are in other hands
LEAST_SILENCE, MOST_SILENCE = 0.1, 1.5  # s
STILL = 2e-3  # mm: a hand that rests trembles by less, and need not be told
NOBODY = (0.0,) * 9
AWAY = (0.0, 0.0, 0.0)


class RoomHand:
    """Used by one thread.

    core: the `RoomDevice` of the session's loop. depth: mm of its blade; 0: it has none. patience: s without news, after
    which the loop withdraws the force. refused: why the hand may not touch, or empty.
    """

    def __init__(self, session: Session, core: Any) -> None:
        self.session, self.core = session, core
        self.depth = 0.0
        self.patience = MOST_SILENCE
        self.stopped = False
        self.serial = 0
        self.there = False  # what is told to the loop is the room's
        self._holds = False  # the room was told so
        self._since, self._began, self._confirmed = 0, 0, False
        self._told = np.zeros(6)
        self._cut_to: Vector | None = None  # where the room was told that its blade is
        self._begun = 0
        self._came = 0  # hands, that have got a number
        self._tools: list[tuple[tuple[int, int], int] | None] = [None] * TOOLS  # whose, and its number, from 1 on
        self._places: list[Any] = [NOBODY] * TOOLS  # nine numbers each
        self._full = False
        self._here = session.frame()

    def renew(self, session: Session, core: Any) -> None:
        """Another organ, and its loop."""
        self.session, self.core = session, core

    def hear(self, frame: Frame, hands: Float32) -> None:
        """What the room says of a tick: the frame of this hand, and rows of `Hands`."""
        self.there = True
        self._here = self.session.frame()
        self._compare(frame)
        self._follow(hands[hands[:, 1] == ContactState.closed.value])
        self._tell()

    def lose(self) -> None:
        """The room is lost: the force goes at once."""
        self.there = self._holds = False
        self._cut_to = None
        self._begun += 1
        self._tools, self._places = [None] * TOOLS, [NOBODY] * TOOLS
        self._tell()

    def people(self, frozen: bool, role: Role) -> None:
        """Who is in the room has changed, or hands were stopped or may go on."""
        self.stopped = frozen and role != Role.teacher
        if self.there:
            self._tell()

    def command(self) -> ToolCommand | None:
        """What the room is to be told of this hand, if anything has changed."""
        if not self.there:
            return None
        here = self._here = self.session.frame()
        touches = here.contact[0] == ContactState.closed.value
        if self.stopped or not (touches or self._holds):
            return None
        where = np.concatenate([here.point[0], here.displacement[0]])
        if touches and self._holds and np.abs(where - self._told).max() < STILL:
            return None
        self._told = where
        self.serial += 1
        if touches and not self._holds:
            self._since, self._began, self._confirmed = self.serial, here.tick, False
        self._holds = touches
        if not touches:
            return ToolCommand(0, CommandKind.away.value, self.serial, AWAY, AWAY)
        return ToolCommand(0, CommandKind.hold.value, self.serial, _vector(where[:3]), _vector(where[3:]))

    def scalpel(self) -> Scalpel | None:
        """What the room is to be told of this hand's blade, if anything has changed: the room cuts along its way."""
        if not self.there:
            return None
        here, last = self.session.frame(), self._cut_to
        point = _vector(here.point[0])
        if self.stopped or here.contact[0] != ContactState.cutting.value:
            self._cut_to = None
            return None if last is None else Scalpel(CutStep.end, self.depth, last)
        if last is not None and np.abs(np.subtract(point, last)).max() < STILL:
            return None
        self._cut_to = point
        return Scalpel(CutStep.begin if last is None else CutStep.move, self.depth, point)

    def _compare(self, frame: Frame) -> None:
        """This hand's tool, against the room's."""
        contact = frame.contact[0]
        closed = contact == ContactState.closed.value
        if self.stopped:
            if closed and self._tools[0] is None:
                self._tools[0] = ((0, 0), self._number())
            if closed:
                tissue = _vector(self._here.displacement[0])
                self._places[0] = (*frame.point[:3], *frame.displacement[:3], *tissue)
            else:
                self._tools[0] = None
            return
        self._tools[0] = None
        if not self._holds:
            return
        self._confirmed = self._confirmed or frame.serial >= self._since
        taken = self._confirmed and contact == ContactState.idle.value
        if taken or (not self._confirmed and self._here.tick - self._began > UNHEARD):
            self._begun += 1  # the teacher has taken it or let it go, or there was none

    def _follow(self, hands: Float32) -> None:
        """Gives each tool of others one of the loop's. Where others have all of a room's, this hand has none."""
        keys = {(int(row[0]), int(row[12])): row for row in hands}
        tools = self._tools
        for slot in range(1, TOOLS):
            if (tool := tools[slot]) is not None and tool[0] not in keys:
                tools[slot] = None
        known = {tool[0] for tool in tools if tool is not None}
        for key in keys:
            free = next((slot for slot in range(1, TOOLS) if tools[slot] is None), None)
            if key in known or free is None:
                continue
            tools[free] = key, self._number()
            self._places[free] = (*AWAY, *AWAY, *self._tissue_at(keys[key][2:5]))
        self._full = len(keys) >= TOOLS
        for slot in range(1, TOOLS):
            if (tool := tools[slot]) is not None:
                self._places[slot] = (*map(float, keys[tool[0]][2:8]), *self._places[slot][6:])

    def _tissue_at(self, point: Float32) -> Vector:
        """Displacement of the tissue at the node of the surface that is nearest to a place at rest, mm."""
        places, moved = self.session.displayed.places, self.session.drawn(self._here)
        if len(places) != len(moved):  # a cut is on its way
            return AWAY
        return _vector(moved[np.argmin(((places - point) ** 2).sum(axis=1))])

    def _number(self) -> int:
        self._came += 1
        return self._came

    def _tell(self) -> None:
        patience = int(RATE * self.patience) if self.there else 0
        numbers = [0 if tool is None else tool[1] for tool in self._tools]
        stopped = self.stopped or self._full
        self.core.tell(numbers, self._places, self._begun, patience, not self.there, stopped)


class WayLength:
    """How long the way to the room and back takes: mean and deviation as of TCP's round trip (RFC 6298)."""

    def __init__(self) -> None:
        self.mean, self.deviation = MOST_SILENCE, 0.0
        self._first = True

    def took(self, seconds: float) -> None:
        """A message took so long there and back."""
        if self._first:
            self.mean, self.deviation, self._first = seconds, seconds / 2, False
            return
        self.deviation += (abs(seconds - self.mean) - self.deviation) / 4
        self.mean += (seconds - self.mean) / 8

    @property
    def patience(self) -> float:
        """s without a frame, after which the room is silent: three times the way, as long as it usually takes at most."""
        return min(MOST_SILENCE, 3 * (self.mean + 4 * self.deviation) + LEAST_SILENCE)


def _vector(values: Any) -> Vector:
    x, y, z = map(float, values)
    return x, y, z
