"""What is open in the simulator: a session that runs, what may be chosen instead, and the pages that look on."""

import asyncio
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import cast

from starlette.websockets import WebSocket

from palpate.errors import PalpateError
from palpate.server.comparing import Comparing
from palpate.server.images import Shown
from palpate.server.messages import Choose, Mark, Tool
from palpate.server.scene import reach, scene_bytes
from palpate.simulation.devices.pointer import KINDS, TOOLS, Command, Kind, Pointer, within
from palpate.simulation.devices.replay import Replay
from palpate.simulation.session import Device, Session
from palpate.tissue.base import TissueModel
from palpate.tissue.models import model as build
from palpate.tissue.models import name_of, names
from palpate.tissue.tissue import Tissue

ANOTHER_SCENE = 4001  # WebSocket's code that tells a page to fetch the scene again, at once


@dataclass(eq=False)
class Room:
    """Lives on the event loop's thread. organs: resolutions of one organ by name; the session's is one of them."""

    session: Session
    device: Device
    title: str = "organ"
    organs: Mapping[str, Tissue] = field(default_factory=dict)
    images: Sequence[Shown] = ()
    task: str = ""
    newest: bytes = b""
    moved: asyncio.Event = field(default_factory=asyncio.Event)  # a hand, since the last frame
    pages: dict[WebSocket, asyncio.Event] = field(default_factory=dict)
    holders: dict[int, WebSocket] = field(default_factory=dict)  # of each tool
    past: list[Session] = field(default_factory=list)  # on other resolutions, ended
    choosing: "asyncio.Task[None] | None" = None
    built: dict[tuple[int, str], asyncio.Task[TissueModel]] = field(default_factory=dict)  # also those under way

    def __post_init__(self) -> None:
        if not self.organs:
            self.organs = {self.title: self.session.first.tissue}
        self.comparing = Comparing(self.make)
        self.scene = self.describe()

    def describe(self) -> bytes:
        """The scene as it is now."""
        tissues = list(self.organs.values())
        return scene_bytes(
            self.session,
            self.title,
            self.replayed,
            models=names(),
            organs=tuple(self.organs),
            organ=next(i for i, tissue in enumerate(tissues) if tissue is self.session.first.tissue),
            task=self.task,
            images=bool(self.images),
        )

    @property
    def replayed(self) -> bool:
        """Is this the replay of a record, to be looked at only?"""
        return isinstance(self.device, Replay)

    @property
    def model(self) -> int:
        """Index of the model in force, or coming into force."""
        return names().index(name_of(self.session.model))

    def obey(self, page: WebSocket, tool: Tool) -> None:
        """The first page to take a tool keeps it until it lets go; the others look on."""
        self.moved.set()
        if self.holders.get(tool.tool) not in (None, page) or not isinstance(self.device, Pointer):
            return
        if tool.kind == 0:
            self.let_go(page, tool.tool, tool.serial)
            return
        kind = cast(Kind, KINDS[tool.kind])
        moved = within("displacement", tool.displacement, reach(self.session))
        self.holders[tool.tool] = page
        self.device.send(Command(True, tool.point, moved, kind), tool.serial, tool.tool)

    def let_go(self, page: WebSocket, tool: int, serial: int | None = None) -> None:
        """Releases a tool that this page holds."""
        if self.holders.get(tool) is page and isinstance(self.device, Pointer):
            del self.holders[tool]
            self.device.send(Command(), serial, tool)

    def enter(self, page: WebSocket) -> asyncio.Event:
        """A page that looks on; the event is set when there is a new frame for it. The first one starts a replay."""
        if self.replayed and not self.session.loop.running and self.session.loop.frame().tick == 0:
            self.session.start(self.device)
        self.pages[page] = asyncio.Event()
        return self.pages[page]

    def leave(self, page: WebSocket) -> None:
        """A page that goes lets go of all it holds."""
        self.pages.pop(page, None)
        self.comparing.ask(page, False)
        for tool in range(TOOLS):
            self.let_go(page, tool)

    def note(self, mark: Mark) -> None:
        """What a hand claims."""
        if not self.replayed:
            self.session.mark(mark.what, mark.tool)

    def choose(self, choice: Choose) -> None:
        """Begins a change of model or of organ; one that is under way is not disturbed."""
        if self.replayed or (self.choosing and not self.choosing.done()):
            return
        change = self.take_model if choice.what == 0 else self.take_organ
        self.choosing = asyncio.create_task(change(choice.index))
        self.choosing.add_done_callback(complain)

    async def take_model(self, index: int) -> None:
        """Another model from the list: built beside the loop, then blended in."""
        model = await self.make(self.session.first.tissue, names()[index])
        while not await asyncio.to_thread(self.session.change, model):
            await asyncio.sleep(0.05)  # the one before is still coming in

    async def take_organ(self, index: int) -> None:
        """Another resolution: a session of its own; all tools let go, and the pages fetch the new scene."""
        tissue = list(self.organs.values())[index]
        if tissue is self.session.first.tissue:
            return
        model = await self.make(tissue, name_of(self.session.model))
        after = await asyncio.to_thread(Session, model)
        self.holders.clear()
        if isinstance(self.device, Pointer):
            for tool in range(TOOLS):
                self.device.send(Command(), None, tool)
        await asyncio.to_thread(self.session.stop)
        self.past.append(self.session)
        self.session = after
        self.newest, self.scene = b"", self.describe()
        after.start(self.device)
        for page in list(self.pages):
            await page.close(ANOTHER_SCENE, "another scene")

    async def make(self, tissue: Tissue, name: str) -> TissueModel:
        """A model, built once though several ask for it at once; one that failed is tried anew."""
        key = id(tissue), name
        made = self.built.get(key)
        if made is None or (made.done() and (made.cancelled() or made.exception())):
            made = self.built[key] = asyncio.create_task(asyncio.to_thread(build, tissue, name))
        return await asyncio.shield(made)  # who asked may go; others wait for it


def complain(task: "asyncio.Task[None]") -> None:
    """A task that dies would leave the pages without what they wait for, and nobody told."""
    if task.cancelled() or not (problem := task.exception()):
        return
    if isinstance(problem, PalpateError):
        print(f"palpate: {problem}", flush=True)
    else:
        logging.getLogger("palpate").error("the server failed at something", exc_info=problem)
