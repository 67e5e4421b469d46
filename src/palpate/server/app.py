"""The web application of `touch`: the page, the scene, and one socket a page with bounded messages."""

import asyncio
import contextlib
from collections.abc import AsyncIterator

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from palpate.errors import DataError
from palpate.server.guard import guarded, stranger
from palpate.server.messages import Choose, Compare, Mark, decode, frame_bytes
from palpate.server.room import Room, complain
from palpate.server.viewing import image_routes
from palpate.tissue.models import names

FRAMES_PER_SECOND = 60
LEAST_GAP = 0.005  # s between frames while a hand moves
ANSWERED = 0.004  # s after which the loop has obeyed and shows it
MESSAGE_BYTES = 1024  # a tool's message has 32
MOST_PAGES = 8
REFUSED, FULL = 1008, 1013  # WebSocket's codes for a broken policy, and for "try again later"


def application(room: Room, token: str) -> Starlette:
    """The app around a room whose session runs. Raises `FileError` if the page was not bundled."""

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        pump = asyncio.create_task(publish(room))
        pump.add_done_callback(complain)
        yield
        pump.cancel()

    routes = [Route("/scene", scene), WebSocketRoute("/socket", socket), *image_routes(room.images)]
    app = guarded("index.html", routes, token, lifespan)
    app.state.room = room
    return app


async def scene(request: Request) -> Response:
    """Nodes at rest and triangles."""
    if reason := stranger(request):
        return Response(f"refused: {reason}", status_code=403)
    room: Room = request.app.state.room
    return Response(room.scene, media_type="application/octet-stream")


async def publish(room: Room) -> None:
    """Takes new frames from the loop and wakes the pages: at the display's rate, and at once when a hand has moved."""
    while True:
        await asyncio.sleep(LEAST_GAP)
        with contextlib.suppress(asyncio.TimeoutError):
            await asyncio.wait_for(room.moved.wait(), 1 / FRAMES_PER_SECOND - LEAST_GAP)
            await asyncio.sleep(ANSWERED)
        room.moved.clear()
        if room.session.loop.fresh():
            frame = room.session.frame()
            room.newest = frame_bytes(frame, room.model)
            if comparison := room.comparing.look(room.session, frame):
                comparison.add_done_callback(complain)
            for event in room.pages.values():
                event.set()


async def socket(page: WebSocket) -> None:
    """One page: frames out, commands in. A page that goes lets go."""
    room: Room = page.app.state.room
    if stranger(page):
        await page.close(REFUSED)
        return
    await page.accept()
    if len(room.pages) >= MOST_PAGES:
        await page.close(FULL, f"{MOST_PAGES} pages are open already; close one")
        return
    fresh = room.enter(page)
    sender = asyncio.create_task(send_newest(page, room, fresh))
    try:
        await listen(page, room)
    except DataError as problem:
        await page.close(REFUSED, str(problem)[:120])
    except (WebSocketDisconnect, KeyError):  # KeyError: text where bytes are spoken
        with contextlib.suppress(RuntimeError):  # it has gone already
            await page.close(REFUSED, "only binary messages")
    finally:
        sender.cancel()
        room.leave(page)


async def send_newest(page: WebSocket, room: Room, fresh: asyncio.Event) -> None:
    """A page that is slow to take a frame gets the newest next; those between are left out."""
    told = b""
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        while True:
            await fresh.wait()
            fresh.clear()
            if room.newest:
                await page.send_bytes(room.newest)
            if page in room.comparing.pages and room.comparing.newest not in (b"", told):
                told = room.comparing.newest
                await page.send_bytes(told)


async def listen(page: WebSocket, room: Room) -> None:
    """Obeys what a page says. Raises `DataError` for what cannot be."""
    while True:
        said = decode(await page.receive_bytes())
        if isinstance(said, Choose):
            if said.what > 1 or said.index >= (len(names()), len(room.organs))[said.what]:
                raise DataError(f"Choose: {said.what}, {said.index}: there is no such choice; reload the page")
            room.choose(said)
        elif isinstance(said, Mark):
            room.note(said)
        elif isinstance(said, Compare):
            room.comparing.ask(page, said.on == 1)
        else:
            room.obey(page, said)
