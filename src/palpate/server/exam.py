"""An exam: what a trainee may do in it, how often, and how long."""

import json
from dataclasses import dataclass
from typing import Any

from palpate.simulation.lesson import Lesson
from palpate.simulation.lesson_case import lesson_case
from palpate.simulation.pointer import CommandKind, ContactState
from palpate.simulation.session import RATE
from palpate.tissue.io import read_tissue
from palpate.tissue.tissue import Tissue


@dataclass
class Exam:
    """A case of a lesson that is being taken. Used on the event loop's thread only.

    channel: how the force comes to the trainee. claims: made so far. first: tick of the first touch. over: whether it has
    ended.
    """

    lesson: Lesson
    seed: int
    channel: str = "screen"
    claims: int = 0
    first: int = -1
    over: bool = False

    @property
    def tools(self) -> tuple[str, ...]:
        """What the trainee's hand can take."""
        return self.lesson.tools

    @property
    def views(self) -> tuple[str, ...]:
        """What the page may show."""
        return self.lesson.views

    def case(self) -> Tissue:
        """The organ with the lumps of the case. Raises as `read_tissue` and `lesson_case`."""
        return lesson_case(self.lesson, read_tissue(self.lesson.organ), self.seed)

    @property
    def description(self) -> str:
        """What a record says of it: JSON without a name or a date."""
        lesson = self.lesson
        told = {"title": lesson.title, "digest": lesson.digest, "seed": self.seed, "channel": self.channel}
        return json.dumps({**told, "tools": lesson.tools, "views": lesson.views, "time": lesson.time})

    def allows(self, kind: int) -> bool:
        """Whether a tool may be commanded so. Pages tell press, pull and grasp apart: all of them hold."""
        if self.over:
            return False
        return "needle" in self.lesson.tools if kind == CommandKind.needle else self.lesson.tools != ("needle",)

    def claim(self) -> str:
        """Counts a claim; why it is not taken, or empty."""
        if self.over:
            return "The time is over."
        if self.claims >= self.lesson.claims:
            return f"All {self.lesson.claims} claims have been made."
        self.claims += 1
        return ""

    def ends(self, frame: Any) -> bool:
        """Whether the time has just run out at a frame."""
        if self.first < 0 and ContactState.closed in list(frame.contact):
            self.first = int(frame.tick)
        late = self.lesson.time > 0 and self.first >= 0 and frame.tick - self.first > RATE * self.lesson.time
        if self.over or not late:
            return False
        self.over = True
        return True
