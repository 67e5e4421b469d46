"""A session while it is served: the models and organs that can be selected, and the pages that show it."""

import asyncio
import contextlib
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from starlette.websockets import WebSocket, WebSocketDisconnect

from palpate.errors import DataError, PalpateError
from palpate.haptics.haptic_device import Haptic
from palpate.server.cutting_stroke import Cutting, first_depth, may_cut
from palpate.server.exam import Exam
from palpate.server.force_errors import ROOM_SHARE, TIME_SHARE, ForceErrors
from palpate.server.forced_choice_run import ForcedChoiceRun
from palpate.server.frame_flow import FrameFlow
from palpate.server.frame_message import frame_bytes, pieces_bytes
from palpate.server.held_tools import HeldTools
from palpate.server.image_payloads import ImagePayload
from palpate.server.message_kinds import CloseCode, LeadStep, NoteStep, Role, SelectionKind
from palpate.server.messages import (
    Choice,
    Guided,
    Lead,
    Mark,
    Note,
    Scalpel,
    Selection,
    ToolCommand,
    encode,
    notes_bytes,
)
from palpate.server.people import Room
from palpate.server.reference_comparison import ReferenceComparison
from palpate.server.scene_message import VIEWS, reach, scene_bytes
from palpate.simulation.lesson import TOOLS as TOOL_KINDS
from palpate.simulation.pointer import KINDS, Command, CommandKind, Kind, Pointer, bounded_vector
from palpate.simulation.record_player import RecordPlayer
from palpate.simulation.recording import start_journal
from palpate.simulation.replay import Replay
from palpate.simulation.session import RATE, Device, Session
from palpate.simulation.session_notes import SessionNote
from palpate.tissue.models.registry import model as build
from palpate.tissue.models.registry import name_of, names_in_sessions
from palpate.tissue.models.tissue_model import TissueModel
from palpate.tissue.tissue import Tissue

CHANGE_RETRY = 0.05  # s, while an earlier change of model is under way


@dataclass(eq=False)
class LiveSession:
    """Used on the event loop's thread only. organs: resolutions of one organ by name; the session's is one of them.

    reason: why the session begins with its model. successor: the model that it changes to once that is made. newest: the
    newest frame as a message, and pieces: where the pieces are that cuts have freed. pages: the connected pages, each with
    an event that is set for every new frame. flows: how far behind each is. finished: earlier sessions, on other
    resolutions. choice: organ and model that were chosen last, by index. models: models that were built or are being built.
    record: where the first session will be written; later ones get numbers. exam: the exam or the experiment that it is.
    offset: ticks that earlier sessions of an experiment have shown. beside: a second replay that is shown beside this one.
    room: the name of the room in which several people share it, or empty.
    """

    session: Session
    device: Device
    title: str = "organ"
    organs: Mapping[str, Tissue] = field(default_factory=dict)
    images: Sequence[ImagePayload] = ()
    task: str = ""
    reason: str = ""
    successor: str = ""
    newest: bytes = b""
    pieces: bytes = b""
    pages: dict[WebSocket, asyncio.Event] = field(default_factory=dict)
    flows: dict[WebSocket, FrameFlow] = field(default_factory=dict)
    finished: list[Session] = field(default_factory=list)
    choice: tuple[int, int] = (0, 0)
    changes: "set[asyncio.Task[None]]" = field(default_factory=set)
    changing: asyncio.Lock = field(default_factory=asyncio.Lock)
    models: dict[tuple[int, str], asyncio.Task[TissueModel]] = field(default_factory=dict)
    record: Path | None = None
    exam: Exam | ForcedChoiceRun | None = None
    offset: int = 0
    beside: "LiveSession | None" = None
    room: str = ""

    def __post_init__(self) -> None:
        if not self.organs:
            self.organs = {self.title: self.session.first.tissue}
        replayed = isinstance(self.device, Replay)
        self.player = RecordPlayer(self.session, cast(Replay, self.device).record) if replayed else None
        self.tools = HeldTools(self.device, bool(self.room)) if isinstance(self.device, Pointer) else None
        self.people = Room(self.tools) if self.room else None
        self.comparison = ReferenceComparison(self.build_model)
        self.cutting = Cutting(self.changing, lambda: self.session, self.describe, self.tell, self.tools)
        self.force_errors = ForceErrors(ROOM_SHARE if self.room else TIME_SHARE)
        self.open_journal(self.session, 0)
        self.choice = self.current
        self.describe()

    def describe(self) -> None:
        """Computes what stays constant for a session: the scene, and the longest displacement of a tool, mm."""
        self.reach = reach(self.session)
        self.described = self.session.bodies
        if isinstance(self.device, Haptic):
            self.device.core.edge = first_depth(self.session) if self.pages_may_cut else 0.0
        self.scene = scene_bytes(
            self.session,
            self.title,
            self.is_replay,
            models=() if self.exam else names_in_sessions(),
            organs=tuple(self.organs),
            organ=self.current[0],
            task=self.task,
            reason=self.reason,
            images=bool(self.images),
            depth=first_depth(self.session),
            tools=self.exam.tools if self.exam else (*TOOL_KINDS, *(("cut",) if self.pages_may_cut else ())),
            views=self.exam.views if self.exam else VIEWS,
            exam=self.exam is not None,
            **({} if self.experiment is None else self.experiment.described),
            recorded=self.record is not None,
            room=self.room,
        )

    @property
    def experiment(self) -> ForcedChoiceRun | None:
        """The forced-choice experiment that it is."""
        return self.exam if isinstance(self.exam, ForcedChoiceRun) else None

    @property
    def pages_may_cut(self) -> bool:
        """Whether pages may cut."""
        return not self.is_replay and not self.exam and may_cut(self.session)

    @property
    def is_replay(self) -> bool:
        """Whether a record is replayed, which pages can only watch."""
        return self.player is not None

    @property
    def current(self) -> tuple[int, int]:
        """Indices of the organ and of the model, or of the model that is being blended in."""
        tissues = list(self.organs.values())
        # That of an interval of an experiment is none of them.
        organ = next((i for i, tissue in enumerate(tissues) if tissue is self.session.first.tissue), 0)
        return organ, names_in_sessions().index(name_of(self.session.model))

    def open_journal(self, session: Session, before: int) -> None:
        """Gives a session that is to be recorded its journal. before: sessions before it. Raises `FileError`."""
        if self.record is not None:
            session.journal = start_journal(record_name(self.record, before), session.description())

    def command(self, page: WebSocket, message: ToolCommand) -> None:
        """Commands a tool, unless another page holds it."""
        if self.tools is None:
            return
        if self.exam and message.kind != CommandKind.away and not self.exam.allows(message.kind):
            return
        command = Command()
        if message.kind != CommandKind.away:
            kind = cast(Kind, KINDS[message.kind])
            displacement = bounded_vector("displacement", message.displacement, self.reach)
            command = Command(True, message.point, displacement, kind)
        stopped = self.people is not None and self.people.stops(page)
        if not self.tools.command(page, message.tool, command, message.serial, stopped) and self.people:
            self.keep(asyncio.create_task(self.tell("All tools are in other hands.", page)))
        if self.people and self.people.guidance:
            if command.held:
                self.people.guidance.command(page, message.tool, np.add(command.point, command.displacement))
            self.follow_guidance()

    def lead(self, page: WebSocket, lead: Lead) -> None:
        """Does what a teacher asks for in a room."""
        if self.people is None:
            return
        if lead.step == LeadStep.reset:
            self.let_go()
            self.keep(asyncio.create_task(self.cutting.undo_all(self.session)))
        elif lead.step in (LeadStep.guide, LeadStep.end_guidance):
            if refusal := self.people.guide(page, lead):
                self.keep(asyncio.create_task(self.tell(refusal, page)))
        else:
            self.people.lead(page, lead)
            self.tell_people()
        self.follow_guidance()

    def hear_guidance(self, page: WebSocket, told: Guided) -> None:
        """What one end says of a guidance."""
        if self.people and self.people.guidance:
            self.people.guidance.hear(page, told)

    def follow_guidance(self) -> None:
        """Marks the record and tells all pages when a teacher begins to guide a hand, or ends."""
        guidance = self.people.guidance if self.people else None
        if guidance and guidance.look(self.mark_tool):
            self.keep(asyncio.create_task(self.tell(guidance.told())))

    def mark_tool(self, what: int, tool: int) -> None:
        """Marks on the record that a tool is guided, or is not any more."""
        self.session.events.marks.append((int(self.session.frame().tick), what, tool))

    def tell_people(self) -> None:
        """Tells every page who is in the room."""
        if self.people:
            for page in self.pages:
                self.keep(asyncio.create_task(self.tell(self.people.told(page), page)))

    def messages(self, page: WebSocket) -> list[bytes]:
        """The newest frame as a page gets it."""
        if not self.newest:
            return []
        pieces = [self.pieces] if self.pieces else []
        return [*pieces, *(self.people.messages(page, self.newest) if self.people else [self.newest])]

    def cut(self, page: WebSocket, message: Scalpel) -> None:
        """Obeys the scalpel of a page."""
        if self.pages_may_cut:
            self.keep(self.cutting.obey(page, self.session, message))

    def publish_replay(self) -> None:
        """Publishes the state that the player is at: after going back or a cut the scene is another one."""
        if self.player is None:
            return
        session = self.player.session
        if session is not self.session or session.bodies != self.described:
            self.session = session
            self.describe()
        frame = session.frame()
        shown, model = session.drawn(frame), self.current[1]
        self.estimate(frame)
        message = frame_bytes(frame, shown, model, model, self.force_errors, seconds=frame.tick / RATE)
        self.publish(message, pieces_bytes(frame))

    def estimate(self, frame: Any) -> None:
        """Begins to estimate the errors of a frame, if it is time to."""
        for task in (self.comparison.update(self.session, frame), self.force_errors.update(self.session, frame)):
            if task:
                task.add_done_callback(report_failure)

    def publish(self, frame: bytes, pieces: bytes) -> None:
        """Hands the newest frame to all pages."""
        self.newest, self.pieces = frame, pieces
        for event in self.pages.values():
            event.set()

    def watch(self, frame: Any) -> None:
        """Ends an exam whose time is over: all tools let go. Cuts behind a device. Tells what is lifted out.

        Notes what an experiment's hand does.
        """
        if isinstance(self.exam, Exam) and isinstance(self.device, Pointer) and self.exam.ends(frame):
            self.let_go()
            self.keep(asyncio.create_task(self.tell("The time is over.")))
        if not self.tools and self.pages_may_cut:
            self.keep(self.cutting.follow(self.session, frame))
        self.keep(self.cutting.watch_pieces(self.session, frame))
        if self.experiment and self.experiment.watch(frame, self.session):
            self.keep(asyncio.create_task(self.report()))

    def let_go(self) -> None:
        """All tools of all pages let go."""
        if self.tools:
            self.tools.let_go()
        if self.people and self.people.guidance:
            self.people.guidance.end()
            self.follow_guidance()

    def choose(self, choice: Choice) -> None:
        """Begins to carry out what the person of an experiment chose."""
        if self.experiment:
            self.keep(asyncio.create_task(self.experiment.choose(choice, self.swap, self.tell, self.report)))

    async def report(self, only: WebSocket | None = None) -> None:
        """Tells pages, or one, where the experiment is."""
        if self.experiment:
            await self.tell(encode(self.experiment.status), only)

    async def swap(self, after: Session) -> None:
        """Goes on with another session of the same surface: all tools let go, ticks count on, pages stay."""
        self.let_go()
        await asyncio.to_thread(self.session.stop)
        self.offset += int(self.session.frame().tick - after.frame().tick)
        self.session = after
        await asyncio.to_thread(after.start, self.device)

    def keep(self, task: "asyncio.Task[None] | None") -> None:
        """Keeps a background task alive until it ends, and prints its error."""
        if task:
            self.changes.add(task)
            task.add_done_callback(self.changes.discard)
            task.add_done_callback(report_failure)

    def connect(self, page: WebSocket, name: str = "", role: Role = Role.teacher) -> asyncio.Event:
        """Adds a page; the event is set for each new frame. The first page starts the first trial of an experiment."""
        if self.experiment and self.experiment.branches is None:
            self.experiment.begin()
        self.pages[page], self.flows[page] = asyncio.Event(), FrameFlow()
        if self.newest:
            self.pages[page].set()  # a replay that is paused publishes no other frame
        if self.people:
            self.people.enter(page, name, role)
            self.tell_people()
        return self.pages[page]

    def disconnect(self, page: WebSocket) -> None:
        """Removes a page and lets go of its tools."""
        self.pages.pop(page, None)
        self.flows.pop(page, None)
        self.comparison.request(page, False)
        self.cutting.leave(page)
        if self.tools:
            self.tools.leave(page)
        if self.people:
            self.people.leave(page)
            self.tell_people()
            self.follow_guidance()

    def mark(self, page: WebSocket, mark: Mark) -> None:
        """Records that a lump was found or a sample taken."""
        if self.is_replay:
            return
        tool = mark.tool
        if self.people and self.tools:
            held = self.tools.tool(page, mark.tool)
            if held is None:
                return
            tool = held
        if self.exam and (refusal := self.exam.claim()):
            self.keep(asyncio.create_task(self.tell(refusal)))
            return
        self.session.mark(mark.kind, tool)

    @property
    def notes(self) -> tuple[SessionNote, ...]:
        """The notes of the session, or of the record that is replayed."""
        return self.player.record.notes if self.player else self.session.events.notes

    def note(self, note: Note, text: str) -> None:
        """Keeps a note of a page, or removes one, and tells all pages. A replay and an exam take none."""
        if self.is_replay or self.exam:
            return
        if note.step == NoteStep.add:
            try:
                self.session.note(text, note.point)
            except DataError as problem:
                self.keep(asyncio.create_task(self.tell(str(problem))))
        elif note.index < len(self.notes) and self.notes[note.index].text == text:
            self.session.remove_note(note.index)
        self.keep(asyncio.create_task(self.tell(notes_bytes(self.notes))))

    def select(self, selection: Selection) -> None:
        """Notes a choice of model or organ, and begins to carry it out. The last choice wins."""
        if self.is_replay or self.exam:
            return
        organ, model = self.choice
        self.choice = (organ, selection.index) if selection.kind == SelectionKind.model else (selection.index, model)
        self.keep(asyncio.create_task(self.carry_out(self.choice)))

    def hand_over(self) -> None:
        """Begins to make the session's successor, if it has one."""
        if self.successor:
            self.select(Selection(SelectionKind.model, names_in_sessions().index(self.successor)))

    async def carry_out(self, choice: tuple[int, int]) -> None:
        """Changes to an organ and a model, one choice after the other; does nothing once there is a later choice."""
        async with self.changing:
            if self.choice is not choice:
                return
            try:
                tissue = list(self.organs.values())[choice[0]]
                if tissue is self.session.first.tissue:
                    tissue = self.session.tissue  # with its cuts
                model = await self.build_model(tissue, names_in_sessions()[choice[1]])
                while self.choice is choice and choice != self.current:
                    if tissue is not self.session.tissue:
                        await self.change_organ(model)
                    elif not await asyncio.to_thread(self.session.change, model):
                        await asyncio.sleep(CHANGE_RETRY)
            except BaseException as problem:
                if self.choice is choice:
                    self.choice = self.current
                if isinstance(problem, PalpateError):
                    await self.tell(f"{names_in_sessions()[choice[1]]} was not made: {problem}")
                raise

    async def tell(self, what: str | bytes, only: WebSocket | None = None) -> None:
        """Sends every page, or one, a message, or a text that it shows."""
        for page in list(self.pages) if only is None else [only]:
            with contextlib.suppress(WebSocketDisconnect, RuntimeError):  # it has gone
                await (page.send_text(what) if isinstance(what, str) else page.send_bytes(what))

    async def change_organ(self, model: TissueModel) -> None:
        """Changes to a model of another resolution: a new session. All tools let go, and the pages fetch the new scene."""
        before = self.session
        after = await asyncio.to_thread(
            Session,
            model,
            tension=before.tension,
            toughness=before.toughness,
            blade_friction=before.blade_friction,
        )
        self.open_journal(after, len(self.finished) + 1)
        after.events.notes = tuple(replace(note, tick=0) for note in self.session.events.notes)
        self.let_go()
        await asyncio.to_thread(self.session.stop)
        self.finished.append(self.session)
        self.session, self.newest, self.pieces = after, b"", b""
        self.describe()
        after.start(self.device)
        for page in list(self.pages):
            await page.close(CloseCode.scene_changed, "another scene")

    async def build_model(self, tissue: Tissue, name: str) -> TissueModel:
        """A model of a tissue, built once even for several requests at the same time; again if that failed."""
        if all(tissue is not organ for organ in self.organs.values()):
            return await asyncio.to_thread(build, tissue, name)  # with cuts: the next one makes it useless
        key = id(tissue), name
        built = self.models.get(key)
        if built is None or (built.done() and (built.cancelled() or built.exception())):
            built = self.models[key] = asyncio.create_task(asyncio.to_thread(build, tissue, name))
        return await asyncio.shield(built)  # other requests may wait for it when this one is cancelled


def record_name(path: Path, before: int) -> Path:
    """The file of a session, by the number of sessions before it."""
    return path if before == 0 else path.with_stem(f"{path.stem}-{before + 1}")


def report_failure(task: "asyncio.Task[None]") -> None:
    """Prints the error of a background task; asyncio would drop it."""
    if task.cancelled() or not (problem := task.exception()):
        return
    if isinstance(problem, PalpateError):
        print(f"palpate: {problem}", flush=True)
    else:
        logging.getLogger("palpate").error("a background task of the server failed", exc_info=problem)
