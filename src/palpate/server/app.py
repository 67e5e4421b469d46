"""The web application of `touch`: the page, the scene, and one socket a page with bounded messages."""

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator
from dataclasses import dataclass, field

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from palpate.errors import DataError
from palpate.server.guard import guarded, stranger
from palpate.server.messages import Tool, decode_tool, frame_bytes
from palpate.server.scene import reach, scene_bytes
from palpate.simulation.devices.pointer import Command, Pointer, within
from palpate.simulation.session import Session

FRAMES_PER_SECOND = 60
MESSAGE_BYTES = 1024  # a tool's message has 32
REFUSED = 1008  # WebSocket's code for a broken policy


@dataclass(eq=False)
class Room:
    """One session and the pages that look at it. All of it lives on the event loop's thread."""

    session: Session
    pointer: Pointer
    scene: bytes
    newest: bytes = b""
    pages: set[asyncio.Event] = field(default_factory=set)
    holder: WebSocket | None = None


def application(
    session: Session, pointer: Pointer, token: str, title: str = "organ", replay: bool = False
) -> Starlette:
    """The app around a running session. Raises `FileError` if the page was not bundled."""
    room = Room(session, pointer, scene_bytes(session, title, replay))

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        pump = asyncio.create_task(publish(room))
        pump.add_done_callback(complain)
        yield
        pump.cancel()

    routes = [Route("/scene", scene), WebSocketRoute("/socket", socket)]
    app = guarded("index.html", routes, token, lifespan)
    app.state.room = room
    return app


def complain(task: "asyncio.Task[None]") -> None:
    """A task that dies would leave the pages without frames and nobody told."""
    if not task.cancelled() and (problem := task.exception()):
        logging.getLogger("palpate").error("the server cannot publish frames", exc_info=problem)


async def scene(request: Request) -> Response:
    """Nodes at rest and triangles."""
    if reason := stranger(request):
        return Response(f"refused: {reason}", status_code=403)
    room: Room = request.app.state.room
    return Response(room.scene, media_type="application/octet-stream")


async def publish(room: Room) -> None:
    """Takes each new frame from the loop and wakes the pages."""
    while True:
        await asyncio.sleep(1 / FRAMES_PER_SECOND)
        if room.session.loop.fresh():
            room.newest = frame_bytes(room.session.frame())
            for event in room.pages:
                event.set()


async def socket(page: WebSocket) -> None:
    """One page: frames out, tools in. A page that goes lets go."""
    room: Room = page.app.state.room
    if stranger(page):
        await page.close(REFUSED)
        return
    await page.accept()
    fresh = asyncio.Event()
    room.pages.add(fresh)
    sender = asyncio.create_task(send_newest(page, room, fresh))
    try:
        await obey(page, room)
    except DataError as problem:
        await page.close(REFUSED, str(problem)[:120])
    except (WebSocketDisconnect, KeyError):  # KeyError: text where bytes are spoken
        with contextlib.suppress(RuntimeError):  # it has gone already
            await page.close(REFUSED, "only binary tool messages")
    finally:
        sender.cancel()
        room.pages.discard(fresh)
        let_go(page, room)


async def send_newest(page: WebSocket, room: Room, fresh: asyncio.Event) -> None:
    """A page that is slow to take a frame gets the newest next; those between are left out."""
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        while True:
            await fresh.wait()
            fresh.clear()
            await page.send_bytes(room.newest)


async def obey(page: WebSocket, room: Room) -> None:
    """The first page to take hold keeps it until it lets go; the others look on."""
    most = reach(room.session)
    while True:
        tool = decode_tool(await page.receive_bytes())
        if room.holder not in (None, page):
            continue
        if not tool.held:
            let_go(page, room, tool)
            continue
        command = Command(True, tool.point, within("displacement", tool.displacement, most))
        room.holder = page
        room.pointer.send(command, tool.serial)


def let_go(page: WebSocket, room: Room, tool: Tool | None = None) -> None:
    """Releases what this page holds."""
    if room.holder is page:
        room.holder = None
        room.pointer.send(Command(), tool.serial if tool else None)
