"""The way into the rooms: checks invitations, and passes what a page asks for to the process of its room."""

import asyncio
import contextlib
import http.client
from collections.abc import AsyncIterator, Mapping
from urllib.parse import urlencode

from starlette.applications import Starlette
from starlette.requests import HTTPConnection, Request
from starlette.responses import Response, StreamingResponse
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake

from palpate.errors import DataError
from palpate.rooms.invitation import Invitation, read_invitation
from palpate.rooms.room_process import RoomProcess
from palpate.server.access_control import LOOPBACK, Admission, page_application
from palpate.server.bounded_connections import BoundedConnection
from palpate.server.live_session import report_failure
from palpate.server.messages import CloseCode
from palpate.standalone.organ_page import engine_module

PATIENCE = 20.0  # s that a page waits for a room that is being opened again
CHUNK = 1 << 20  # bytes
MOST_CONNECTIONS = 2048
HEADERS = ("content-type", "content-length")
LOST = (ConnectionClosed, InvalidHandshake, OSError, TimeoutError)


class GatewayConnection(BoundedConnection):
    """Connections to all rooms together."""

    @staticmethod
    def most() -> int:
        """How many there may be."""
        return MOST_CONNECTIONS


def gateway(rooms: Mapping[str, RoomProcess], secret: str, hosts: frozenset[str] = LOOPBACK) -> Starlette:
    """The web application in front of rooms by name, which it keeps open. hosts: names that it goes by."""

    def refused(token: str) -> str:
        try:
            invited = read_invitation(token, secret)
        except DataError as problem:
            return str(problem)
        return "" if invited.room in rooms else f"there is no room {invited.room} here; ask the teacher"

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        tasks = [asyncio.create_task(_opened(room)) for room in rooms.values()]
        for task in tasks:
            task.add_done_callback(report_failure)
        yield
        for task in tasks:
            task.cancel()
        await asyncio.gather(*(room.close() for room in rooms.values()))

    paths = ("/scene", "/solid", "/album", "/values/{image:int}/{stack:int}")
    routes = [
        *(Route(path, pass_request) for path in paths),
        Route("/engine", engine),
        WebSocketRoute("/socket", pass_socket),
    ]
    app = page_application("index.html", routes, Admission(refused, hosts | LOOPBACK), lifespan)
    app.state.rooms, app.state.secret = rooms, secret
    return app


async def _opened(room: RoomProcess) -> None:
    """Keeps a room open. One that cannot be opened at first stays closed, and its `problem` says why."""
    with contextlib.suppress(DataError):
        await room.open()
        await room.keep()


def invited_by(connection: HTTPConnection) -> tuple[Invitation, RoomProcess]:
    """The invitation of a request that was let in, and its room."""
    one = read_invitation(connection.query_params["token"], connection.app.state.secret)
    return one, connection.app.state.rooms[one.room]


async def engine(request: Request) -> Response:
    """The engine with which a page predicts what its room will answer."""
    return Response(engine_module(), media_type="application/wasm")


async def pass_request(request: Request) -> Response:
    """Gets from the room what a page asks for."""
    _, room = invited_by(request)
    if not await room.there(PATIENCE):
        return Response(f"the room {room.room.name} is not there; try again", 503)
    connection = http.client.HTTPConnection("127.0.0.1", room.port, timeout=PATIENCE)

    def ask() -> http.client.HTTPResponse:
        connection.request("GET", f"{request.url.path}?{urlencode({'token': room.token})}")
        return connection.getresponse()

    async def parts() -> AsyncIterator[bytes]:
        with contextlib.closing(connection):
            while part := await asyncio.to_thread(answer.read, CHUNK):
                yield part

    try:
        answer = await asyncio.to_thread(ask)
    except (OSError, http.client.HTTPException):
        connection.close()
        return Response(f"the room {room.room.name} has just closed; try again", 503)
    headers = {name: answer.headers[name] for name in HEADERS if name in answer.headers}
    return StreamingResponse(parts(), answer.status, headers)


async def pass_socket(page: WebSocket) -> None:
    """Passes messages between a page and its room until either closes."""
    one, room = invited_by(page)
    await page.accept()
    if not await room.there(PATIENCE):
        await page.close(CloseCode.room_lost, "the room is not there")
        return
    query = urlencode({"token": room.token, "name": one.name, "role": one.role.name})
    try:
        async with connect(
            f"ws://127.0.0.1:{room.port}/socket?{query}", compression=None, max_size=None, max_queue=2, proxy=None
        ) as inner:
            ways = [asyncio.create_task(to_page(inner, page)), asyncio.create_task(to_room(page, inner))]
            await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
            for way in ways:
                way.cancel()
            await asyncio.gather(*ways, return_exceptions=True)
        code, reason = inner.close_code or CloseCode.room_lost, inner.close_reason or ""
    except LOST:
        code, reason = CloseCode.room_lost, "the room was lost"
    if code in (1005, 1006):  # no code, which cannot be sent
        code = CloseCode.room_lost
    with contextlib.suppress(RuntimeError, WebSocketDisconnect):  # the page has gone
        await page.close(code, reason)


async def to_page(inner: ClientConnection, page: WebSocket) -> None:
    """What the room says, to the page. The next message is read once the page's connection has taken this one."""
    with contextlib.suppress(WebSocketDisconnect, RuntimeError, *LOST):
        async for message in inner:
            await (page.send_text(message) if isinstance(message, str) else page.send_bytes(message))


async def to_room(page: WebSocket, inner: ClientConnection) -> None:
    """What the page says, to the room."""
    with contextlib.suppress(WebSocketDisconnect, RuntimeError, *LOST):
        while True:
            message = await page.receive()
            if message["type"] == "websocket.disconnect":
                return
            await inner.send(message["bytes"] if message.get("bytes") is not None else message.get("text") or "")
