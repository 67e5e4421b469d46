"""A forced-choice experiment that is being taken: which trial, which interval, what was touched and answered."""

import asyncio
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate.errors import PalpateError
from palpate.server.message_kinds import ChoiceKind, Feedback, TrialState
from palpate.server.messages import Choice, TrialStatus
from palpate.simulation.answer_file import Answers, append_trial
from palpate.simulation.forced_choice import Trial
from palpate.simulation.interval_tissue import Stimulus
from palpate.simulation.pointer import CommandKind, ContactState
from palpate.simulation.session import Session
from palpate.tissue.models.registry import model as build
from palpate.tissue.models.tissue_model import TissueModel

TOOLS = ("press", "pull")
VIEWS = ("plain",)
Intervals = tuple[Session, Session]


@dataclass(eq=False)
class ForcedChoiceRun:
    """Used on the event loop's thread only. It is an `Exam` to the page: nothing is sent that tells what is inside.

    answers: so far. path: their file. base: the model of the organ as it is. intervals: the sessions of intervals 1 and 2 of
    this trial. level: of this trial. shown: the interval that can be touched. contact, force: whether each interval was
    touched, and the largest force, N. swap, tell, report: given by the live session: shows another session, a text, the
    state. finished: called when the last answer was given.
    """

    answers: Answers
    path: Path
    base: TissueModel
    stimulus: Stimulus
    finished: Callable[[], object] = lambda: None
    level: float = 0.0
    shown: int = 1
    state: int = TrialState.preparing
    told: int = Feedback.none
    contact: list[bool] = field(default_factory=lambda: [False, False])
    force: list[float] = field(default_factory=lambda: [0.0, 0.0])
    began: float = 0.0

    def __post_init__(self) -> None:
        level = self.answers.next_level
        assert level is not None
        self.level = level
        self.intervals = self._intervals(level)
        self.busy = asyncio.Lock()
        self.branches: asyncio.Task[dict[bool, tuple[float | None, Intervals]]] | None = None

    @property
    def tools(self) -> tuple[str, ...]:
        """What a hand can take."""
        return TOOLS

    @property
    def views(self) -> tuple[str, ...]:
        """What the page may show."""
        return VIEWS

    @property
    def described(self) -> dict[str, Any]:
        """What the scene says of it."""
        one, experiment = self.stimulus, self.answers.experiment
        return {"question": experiment.asked, "channel": experiment.channel, "place": one.place, "normal": one.normal}

    @property
    def number(self) -> int:
        """Of this trial, from 1 on."""
        return len(self.answers.trials) + 1

    @property
    def status(self) -> TrialStatus:
        """What pages are told."""
        touched = sum(1 << k for k in range(2) if self.contact[k])
        last = self.answers.experiment.trials
        return TrialStatus(self.state, min(self.number, last), last, self.shown, touched, self.told)

    def allows(self, kind: int) -> bool:
        """Whether a tool may be commanded so."""
        return self.state == TrialState.asking and kind != CommandKind.needle

    def claim(self) -> str:
        """A mark is no answer."""
        return "Answer by 1 or 2."

    def watch(self, frame: Any, session: Session) -> bool:
        """Notes what is touched; whether that is news."""
        k = self.shown - 1
        if self.state != TrialState.asking or session is not self.intervals[k]:
            return False
        tools = [tool for tool, state in enumerate(frame.contact) if state == ContactState.closed]
        if not tools:
            return False
        forces = np.linalg.norm(np.reshape(frame.force, (-1, 3))[tools], axis=1)
        self.force[k] = max(self.force[k], float(forces.max()))
        news, self.contact[k] = not self.contact[k], True
        return news

    def begin(self) -> None:
        """Begins the trial that is ready, and prepares both trials that may come after it."""
        self.contact, self.force = [False, False], [0.0, 0.0]
        self.state, self.began = TrialState.asking, time.monotonic()
        self.branches = asyncio.create_task(asyncio.to_thread(self._branches))

    def _branches(self) -> dict[bool, tuple[float | None, Intervals]]:
        """What comes after a right answer and after a wrong one.

        Both are always made, from nothing, and an answer waits for both. So the wait tells neither the level nor whether the
        answer was right.
        """
        made = {}
        for right in (True, False):
            named = self._order if right else 3 - self._order
            level = self._answered(named, 0.0).next_level
            made[right] = level, self._intervals(level or self.level, 1)
        return made

    @property
    def _order(self) -> int:
        return self.answers.experiment.orders[self.number - 1]

    def _intervals(self, level: float, ahead: int = 0) -> Intervals:
        """Sessions of both intervals, in the order of this trial or of the next one. Neither has run."""
        orders, trial = self.answers.experiment.orders, self.number - 1 + ahead
        more = build(self.stimulus.tissue(self.base.tissue, level), "compliance")
        first = trial < len(orders) and orders[trial] == 1
        one, two = (more, self.base) if first else (self.base, more)
        return Session(one, regions=False), Session(two, regions=False)

    def _answered(self, named: int, seconds: float) -> Answers:
        """The answers with one to this trial."""
        experiment = self.answers.experiment
        force = (round(self.force[0], 2), round(self.force[1], 2))
        trial = Trial(
            self.number, experiment.question, self.level, self._order, named, seconds, experiment.channel, force
        )
        return replace(self.answers, trials=(*self.answers.trials, trial))

    async def choose(
        self,
        choice: Choice,
        swap: Callable[[Session], Awaitable[None]],
        tell: Callable[[str], Awaitable[None]],
        report: Callable[[], Awaitable[None]],
    ) -> None:
        """Carries out what a page chose. What is not possible now, or meant another trial, is left undone."""
        async with self.busy:
            if choice.trial != self.number:
                return
            if choice.kind == ChoiceKind.go_on and self.state == TrialState.pause:
                self.begin()
            elif choice.kind == ChoiceKind.show and self.state == TrialState.asking:
                if choice.interval != self.shown:
                    self.shown = choice.interval
                    await swap(self.intervals[self.shown - 1])
            elif choice.kind == ChoiceKind.answer and self.state == TrialState.asking:
                if not all(self.contact):
                    await tell("Touch both intervals first.")
                    return
                await self._take(choice.interval, swap, tell, report)
            await report()

    async def _take(
        self,
        named: int,
        swap: Callable[[Session], Awaitable[None]],
        tell: Callable[[str], Awaitable[None]],
        report: Callable[[], Awaitable[None]],
    ) -> None:
        answers = self._answered(named, round(time.monotonic() - self.began, 2))
        trial, experiment = answers.trials[-1], answers.experiment
        try:
            await asyncio.to_thread(append_trial, self.path, trial)
        except PalpateError as problem:
            await tell(str(problem))
            return
        self.told = Feedback.none
        if experiment.feedback:
            self.told = Feedback.right if trial.right else Feedback.wrong
        self.state = TrialState.preparing
        await report()
        assert self.branches is not None
        level, intervals = (await self.branches)[trial.right]
        self.answers, self.shown, self.contact = answers, 1, [False, False]
        if level is None:
            self.state = TrialState.ended
            self.finished()
            return
        self.level, self.intervals = level, intervals
        await swap(intervals[0])
        if experiment.pause and len(answers.trials) % experiment.pause == 0:
            self.state = TrialState.pause
        else:
            self.begin()
