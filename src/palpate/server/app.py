"""The web application: the page, the scene, and one socket a page. Loopback, a token, an origin, bounded messages."""

import asyncio
import contextlib
import logging
import secrets
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.middleware.base import BaseHTTPMiddleware, RequestResponseEndpoint
from starlette.requests import HTTPConnection, Request
from starlette.responses import HTMLResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from palpate.errors import DataError, FileError
from palpate.server.messages import Tool, decode_tool, frame_bytes
from palpate.server.scene import reach, scene_bytes
from palpate.simulation.devices.pointer import Command, Pointer, within
from palpate.simulation.session import Session

STATIC = Path(__file__).parent / "static"
FRAMES_PER_SECOND = 60
MESSAGE_BYTES = 1024  # a tool's message has 32
LOOPBACK = {"localhost", "127.0.0.1", "::1"}
POLICY = (
    "default-src 'none'; script-src 'self'; worker-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
REFUSED = 1008  # WebSocket's code for a broken policy


@dataclass(eq=False)
class Room:
    """One session and the pages that look at it. All of it lives on the event loop's thread."""

    session: Session
    pointer: Pointer
    token: str
    scene: bytes
    newest: bytes = b""
    pages: set[asyncio.Event] = field(default_factory=set)
    holder: WebSocket | None = None


def check_page() -> None:
    """Raises `FileError` if the page was not bundled."""
    if not (STATIC / "index.html").is_file():
        raise FileError(f"{STATIC}: the page is not bundled here; install the wheel, or: python web/build.py {STATIC}")


def application(
    session: Session, pointer: Pointer, token: str, title: str = "organ", replay: bool = False
) -> Starlette:
    """The app around a running session. Raises `FileError` if the page was not bundled."""
    check_page()
    room = Room(session, pointer, token, scene_bytes(session, title, replay))

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        pump = asyncio.create_task(publish(room))
        pump.add_done_callback(complain)
        yield
        pump.cancel()

    app = Starlette(
        routes=[
            Route("/", page),
            Route("/scene", scene),
            WebSocketRoute("/socket", socket),
            Mount("/static", StaticFiles(directory=STATIC)),
        ],
        middleware=[Middleware(BaseHTTPMiddleware, dispatch=headers)],
        lifespan=lifespan,
    )
    app.state.room = room
    return app


def complain(task: "asyncio.Task[None]") -> None:
    """A task that dies would leave the pages without frames and nobody told."""
    if not task.cancelled() and (problem := task.exception()):
        logging.getLogger("palpate").error("the server cannot publish frames", exc_info=problem)


async def headers(request: Request, answer: RequestResponseEndpoint) -> Response:
    """Nothing from elsewhere runs in the page, and its address (the token) leaves with no request."""
    response = await answer(request)
    response.headers["Content-Security-Policy"] = POLICY
    response.headers["Referrer-Policy"] = "no-referrer"
    response.headers["X-Content-Type-Options"] = "nosniff"
    response.headers["Cache-Control"] = "no-store"
    return response


def stranger(connection: HTTPConnection) -> str | None:
    """Why a request is refused, or None. A browser sends Host and Origin itself: a foreign page cannot choose them."""
    room: Room = connection.app.state.room
    host = connection.headers.get("host", "")
    if urlsplit(f"//{host}").hostname not in LOOPBACK:
        return f"host {host!r} is not this machine's loopback"
    origin = connection.headers.get("origin")
    if origin is not None and urlsplit(origin).netloc != host:
        return f"origin {origin!r} is not this server"
    if not secrets.compare_digest(connection.query_params.get("token", "").encode(), room.token.encode()):
        return "the token is wrong; open the address that palpate printed when it started"
    return None


async def page(request: Request) -> Response:
    """The page, for who has the token."""
    if reason := stranger(request):
        return HTMLResponse(f"<!doctype html><title>palpate</title><p>Refused: {reason}</p>", status_code=403)
    return HTMLResponse((STATIC / "index.html").read_bytes())


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
