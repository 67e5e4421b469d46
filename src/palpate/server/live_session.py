"""A session while it is served: the models and organs that can be selected, and the pages that show it."""

import asyncio
import contextlib
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

from starlette.websockets import WebSocket, WebSocketDisconnect

from palpate.errors import PalpateError
from palpate.server.cutting_stroke import Cutting, first_depth, may_cut
from palpate.server.exam import Exam
from palpate.server.force_errors import ForceErrors
from palpate.server.image_payloads import ImagePayload
from palpate.server.messages import CloseCode, Mark, Scalpel, Selection, SelectionKind, ToolCommand
from palpate.server.reference_comparison import ReferenceComparison
from palpate.server.scene_message import VIEWS, reach, scene_bytes
from palpate.simulation.lesson import TOOLS as TOOL_KINDS
from palpate.simulation.pointer import KINDS, TOOLS, Command, CommandKind, Kind, Pointer, bounded_vector
from palpate.simulation.recording import start_journal
from palpate.simulation.replay import Replay
from palpate.simulation.session import Device, Session
from palpate.tissue.models.registry import model as build
from palpate.tissue.models.registry import name_of, names_in_sessions
from palpate.tissue.models.tissue_model import TissueModel
from palpate.tissue.tissue import Tissue

CHANGE_RETRY = 0.05  # s, while an earlier change of model is under way


@dataclass(eq=False)
class LiveSession:
    """Used on the event loop's thread only. organs: resolutions of one organ by name; the session's is one of them.

    reason: why the session begins with its model. successor: the model that it changes to once that is made. newest: the
    newest frame as a message. pages: the connected pages, each with an event that is set for every new frame. holders: the
    page that commands each tool. finished: earlier sessions, on other resolutions. choice: organ and model that were chosen
    last, by index. models: models that were built or are being built. record: where the first session will be written;
    later ones get numbers. exam: the exam that it is.
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
    pages: dict[WebSocket, asyncio.Event] = field(default_factory=dict)
    holders: dict[int, WebSocket] = field(default_factory=dict)
    finished: list[Session] = field(default_factory=list)
    choice: tuple[int, int] = (0, 0)
    changes: "set[asyncio.Task[None]]" = field(default_factory=set)
    changing: asyncio.Lock = field(default_factory=asyncio.Lock)
    models: dict[tuple[int, str], asyncio.Task[TissueModel]] = field(default_factory=dict)
    record: Path | None = None
    exam: Exam | None = None

    def __post_init__(self) -> None:
        if not self.organs:
            self.organs = {self.title: self.session.first.tissue}
        self.comparison = ReferenceComparison(self.build_model)
        self.cutting = Cutting(self.changing, lambda: self.session, self.describe, self.tell)
        self.force_errors = ForceErrors()
        self.open_journal(self.session, 0)
        self.choice = self.current
        self.describe()

    def describe(self) -> None:
        """Computes what stays constant for a session: the scene, and the longest displacement of a tool, mm."""
        self.reach = reach(self.session)
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
            tools=self.exam.lesson.tools if self.exam else (*TOOL_KINDS, *(("cut",) if self.pages_may_cut else ())),
            views=self.exam.lesson.views if self.exam else VIEWS,
            exam=self.exam is not None,
        )

    @property
    def pages_may_cut(self) -> bool:
        """Whether pages may cut."""
        return not self.is_replay and not self.exam and may_cut(self.session)

    @property
    def is_replay(self) -> bool:
        """Whether a record is replayed, which pages can only watch."""
        return isinstance(self.device, Replay)

    @property
    def current(self) -> tuple[int, int]:
        """Indices of the organ and of the model, or of the model that is being blended in."""
        tissues = list(self.organs.values())
        organ = next(i for i, tissue in enumerate(tissues) if tissue is self.session.first.tissue)
        return organ, names_in_sessions().index(name_of(self.session.model))

    def open_journal(self, session: Session, before: int) -> None:
        """Gives a session that is to be recorded its journal. before: sessions before it. Raises `FileError`."""
        if self.record is not None:
            session.journal = start_journal(record_name(self.record, before), session.description())

    def command(self, page: WebSocket, message: ToolCommand) -> None:
        """Commands a tool, unless another page holds it. A page holds a tool from its first command until it lets go."""
        if self.holders.get(message.tool) not in (None, page) or not isinstance(self.device, Pointer):
            return
        if self.exam and message.kind != CommandKind.away and not self.exam.allows(message.kind):
            return
        if message.kind == CommandKind.away:
            self.release(page, message.tool, message.serial)
            return
        kind = cast(Kind, KINDS[message.kind])
        displacement = bounded_vector("displacement", message.displacement, self.reach)
        self.holders[message.tool] = page
        self.device.send(Command(True, message.point, displacement, kind), message.serial, message.tool)

    def cut(self, page: WebSocket, message: Scalpel) -> None:
        """Obeys the scalpel of a page."""
        if self.pages_may_cut:
            self.keep(self.cutting.obey(page, self.session, message))

    def replay_cuts(self, tick: int) -> None:
        """Begins a cut of the record that is replayed, once its tick has come."""
        if isinstance(self.device, Replay) and self.device.record.cuts:
            self.keep(self.cutting.replay(self.session, self.device.record, tick))

    def watch(self, frame: Any) -> None:
        """Ends an exam whose time is over: all tools let go."""
        if self.exam and isinstance(self.device, Pointer) and self.exam.ends(frame):
            self.holders.clear()
            for tool in range(TOOLS):
                self.device.send(Command(), None, tool)
            self.keep(asyncio.create_task(self.tell("The time is over.")))

    def keep(self, task: "asyncio.Task[None] | None") -> None:
        """Keeps a background task alive until it ends, and prints its error."""
        if task:
            self.changes.add(task)
            task.add_done_callback(self.changes.discard)
            task.add_done_callback(report_failure)

    def release(self, page: WebSocket, tool: int, serial: int | None = None) -> None:
        """Lets go of a tool that this page holds."""
        if self.holders.get(tool) is page and isinstance(self.device, Pointer):
            del self.holders[tool]
            self.device.send(Command(), serial, tool)

    def connect(self, page: WebSocket) -> asyncio.Event:
        """Adds a page; the event is set for each new frame. The first page starts a replay."""
        if self.is_replay and not self.session.loop.running and self.session.loop.frame().tick == 0:
            self.session.start(self.device)
        self.pages[page] = asyncio.Event()
        return self.pages[page]

    def disconnect(self, page: WebSocket) -> None:
        """Removes a page and lets go of its tools."""
        self.pages.pop(page, None)
        self.comparison.request(page, False)
        self.cutting.leave(page)
        for tool in range(TOOLS):
            self.release(page, tool)

    def mark(self, mark: Mark) -> None:
        """Records that a lump was found or a sample taken."""
        if self.is_replay:
            return
        if self.exam and (refusal := self.exam.claim()):
            self.keep(asyncio.create_task(self.tell(refusal)))
            return
        self.session.mark(mark.kind, mark.tool)

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

    async def tell(self, text: str) -> None:
        """Shows a text in every page."""
        for page in list(self.pages):
            with contextlib.suppress(WebSocketDisconnect, RuntimeError):  # it has gone
                await page.send_text(text)

    async def change_organ(self, model: TissueModel) -> None:
        """Changes to a model of another resolution: a new session. All tools let go, and the pages fetch the new scene."""
        after = await asyncio.to_thread(Session, model, tension=self.session.tension)
        self.open_journal(after, len(self.finished) + 1)
        self.holders.clear()
        if isinstance(self.device, Pointer):
            for tool in range(TOOLS):
                self.device.send(Command(), None, tool)
        await asyncio.to_thread(self.session.stop)
        self.finished.append(self.session)
        self.session, self.newest = after, b""
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
