"""Who is in a room, and what each of them may do."""

import json
from dataclasses import asdict

from starlette.websockets import WebSocket

from palpate.server.frame_message import hand_frame, hands_bytes, serial_in, without_displacements
from palpate.server.hand_guidance import HandGuidance, Party
from palpate.server.held_tools import HeldTools
from palpate.server.json_messages import Person
from palpate.server.message_checks import FromPage
from palpate.server.message_kinds import CutStep, GuidanceState, LeadStep, Role
from palpate.server.messages import (
    Choice,
    Compare,
    Detail,
    Guided,
    Lead,
    Mark,
    Note,
    People,
    Play,
    Scalpel,
    Seen,
    Selection,
    ToolCommand,
    encode,
)
from palpate.simulation.pointer import TOOLS

MOST_PEOPLE = 32  # in a room
LONGEST_NAME = 40  # characters
LEAST_ROLE: dict[type, Role] = {  # who may send a message
    ToolCommand: Role.trainee,
    Mark: Role.trainee,
    Scalpel: Role.trainee,
    Note: Role.trainee,
    Compare: Role.teacher,
    Detail: Role.viewer,
    Seen: Role.viewer,
    Selection: Role.teacher,
    Choice: Role.teacher,
    Play: Role.teacher,
    Lead: Role.teacher,
    Guided: Role.trainee,
}


class Room:
    """Used on the event loop's thread only.

    tools: who holds each; None where a record is replayed, whose tools are nobody's. frozen: those of all but teachers stay
    as they are. predicting: pages that compute displacements. guidance: None without tools.
    """

    def __init__(self, tools: HeldTools | None) -> None:
        self.tools = tools
        self.people: dict[WebSocket, Person] = {}
        self.frozen = False
        self.predicting: set[WebSocket] = set()
        self.guidance = None if tools is None else HandGuidance(tools)
        self._came = 0

    def enter(self, page: WebSocket, name: str, role: Role) -> None:
        """Lets a page in."""
        self._came += 1
        self.people[page] = Person(self._came, shown_name(name) or f"{role.name} {self._came}", int(role))

    def leave(self, page: WebSocket) -> None:
        """A page has gone, and its tools were let go. Without a teacher, nothing stays frozen."""
        self.people.pop(page, None)
        self.predicting.discard(page)
        if self.guidance:
            self.guidance.leave(page)
        if not any(person.role == Role.teacher for person in self.people.values()):
            self._freeze(False)

    def lead(self, page: WebSocket, lead: Lead) -> None:
        """Stops all hands but the teachers', lets them go on, or takes somebody's tools."""
        if self.tools is None:
            return
        theirs = self._page_of(lead.person)
        if lead.step in (LeadStep.freeze, LeadStep.resume):
            self._freeze(lead.step == LeadStep.freeze)
        elif theirs is not None and theirs is not page:
            if lead.step == LeadStep.take_over:
                self.tools.take_over(theirs, page)
            else:
                self.tools.release(theirs)
            if self.guidance:
                self.guidance.end(theirs)

    def _page_of(self, number: int) -> WebSocket | None:
        return next((page for page, person in self.people.items() if person.number == number), None)

    def guide(self, page: WebSocket, lead: Lead) -> str:
        """A teacher wants to guide a hand, or to end it. Returns why not, or empty."""
        if self.guidance is None:
            return ""
        if lead.step == LeadStep.end_guidance:
            self.guidance.end()
            return ""
        theirs = self._page_of(lead.person)
        if theirs is None or theirs is page:
            return "There is no such hand to guide."
        if self.people[theirs].role == Role.viewer:
            return f"{self.people[theirs].name} watches, and has no hand to guide."
        if self.frozen:
            return "All hands are stopped. Let them go on, then guide."
        guiding = self.guidance.teacher
        if guiding and guiding.page in self.people and guiding.page is not page:
            return f"{self.people[guiding.page].name} guides a hand already."
        self.guidance.ask(Party(page, self.people[page].number), Party(theirs, lead.person))
        return ""

    def _freeze(self, frozen: bool) -> None:
        self.frozen = frozen
        if frozen and self.guidance:
            self.guidance.end()
        if not frozen and self.tools:
            self.tools.resume()

    def detail(self, page: WebSocket, detail: Detail) -> None:
        """A page wants whole frames, or frames without displacements."""
        (self.predicting.discard if detail.whole else self.predicting.add)(page)

    def stops(self, page: WebSocket) -> bool:
        """Whether the tools of a page stay where they are."""
        return self.frozen and not self.leads(page)

    def leads(self, page: WebSocket) -> bool:
        """Whether it is a teacher's page."""
        return page in self.people and self.people[page].role == Role.teacher

    def refusal(self, page: WebSocket, message: FromPage) -> str:
        """Why a page may not send this, or empty."""
        kind = Note if isinstance(message, tuple) else type(message)
        least = LEAST_ROLE[kind]
        if isinstance(message, Scalpel) and message.step == CutStep.undo:
            least = Role.teacher  # it may be another one's cut
        person = self.people.get(page)
        if person is None or person.role < least:
            return f"Only a {least.name} can do this here."
        if isinstance(message, Scalpel) and self.stops(page):
            return "The teacher has stopped all hands."
        return ""

    def told(self, page: WebSocket) -> bytes:
        """Who is there, as a message to one of them."""
        people = json.dumps([asdict(person) for person in self.people.values()]).encode()
        return encode(People(self.people[page].number, int(self.frozen))) + people

    def messages(self, page: WebSocket, frame: bytes) -> list[bytes]:
        """A frame as a page gets it: its own tools, after those of the others."""
        if self.tools is None:
            return [frame]
        own: list[int | None] = [None] * TOOLS
        others = []
        for tool, (holder, number) in self.tools.holders.items():
            if holder is page:
                own[number] = tool
            elif holder in self.people:
                others.append((tool, self.people[holder].number, number))
        mine = hand_frame(frame, own, self.tools.obeyed(page, serial_in(frame)))
        told = [self.guidance.told()] if self.guidance and self.guidance.state != GuidanceState.none else []
        return [*told, hands_bytes(frame, others), without_displacements(mine) if page in self.predicting else mine]


def shown_name(name: str) -> str:
    """A name in one line, without what no one can see."""
    return " ".join("".join(c for c in name if c.isprintable()).split())[:LONGEST_NAME]
