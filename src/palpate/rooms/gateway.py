"""The way into the rooms: checks invitations, and passes what a page asks for to the process of its room."""

import asyncio
import contextlib
import http.client
from collections.abc import AsyncIterator, Coroutine, Mapping
from typing import Any, TypeVar
from urllib.parse import urlencode, urlsplit

from starlette.applications import Starlette
from starlette.requests import HTTPConnection, Request
from starlette.responses import Response, StreamingResponse
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake

from palpate.errors import DataError
from palpate.rooms.invitation import Invitation, read_invitation
from palpate.rooms.room_claim import Host, Share, count_hosts, hold, keep_open
from palpate.rooms.room_process import RoomProcess
from palpate.server.access_control import LOOPBACK, Admission, page_application
from palpate.server.bounded_connections import BoundedConnection
from palpate.server.live_session import report_failure
from palpate.server.message_kinds import CloseCode
from palpate.standalone.organ_page import engine_module

Answer = TypeVar("Answer")
PATIENCE = 20.0  # s that a page waits for a room that is being opened again
FAREWELL = 1.0  # s that a host which is lost may take to answer it
TRIES = 3  # to reach a room
LOOK = 0.2  # s between looks whether a room has moved to another host
BESIDE = "beside"  # in a request for the second of two replays
PASSED = "passed"  # in a request of another host: it is answered here or nowhere
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


def gateway(
    rooms: Mapping[str, RoomProcess], secret: str, hosts: frozenset[str] = LOOPBACK, host: Host | None = None
) -> Starlette:
    """The web application in front of rooms by name, which it keeps open. hosts: names that it goes by.

    host: this one, if there are others with the same rooms: it keeps those open that it can claim.
    """

    def refused(token: str) -> str:
        try:
            invited = read_invitation(token, secret)
        except DataError as problem:
            return str(problem)
        return "" if invited.room in rooms else f"there is no room {invited.room} here; ask the teacher"

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        if host is None:
            tasks = [asyncio.create_task(keep_open(room)) for room in rooms.values()]
        else:
            share = Share(len(rooms))
            tasks = [asyncio.create_task(hold(room, host, share)) for room in rooms.values()]
            tasks.append(asyncio.create_task(count_hosts(host, share)))
        for task in tasks:
            task.add_done_callback(report_failure)
        yield
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        if host is not None:
            await host.registry.close()

    paths = ("/scene", "/solid", "/album", "/values/{image:int}/{stack:int}")
    routes = [
        *(Route(path, pass_request) for path in paths),
        Route("/engine", engine),
        WebSocketRoute("/socket", pass_socket),
    ]
    app = page_application("index.html", routes, Admission(refused, hosts | LOOPBACK), lifespan)
    app.state.rooms, app.state.secret = rooms, secret
    return app


def invited_by(connection: HTTPConnection) -> tuple[Invitation, RoomProcess]:
    """The invitation of a request that was let in, and its room."""
    one = read_invitation(connection.query_params["token"], connection.app.state.secret)
    return one, connection.app.state.rooms[one.room]


async def engine(request: Request) -> Response:
    """The engine with which a page predicts what its room will answer."""
    return Response(engine_module(), media_type="application/wasm")


def way_to(room: RoomProcess, connection: HTTPConnection, asked: dict[str, str]) -> tuple[str, str]:
    """Address of the server that has the room, and what to ask it with: on this host what was asked, else the invitation."""
    beside = {BESIDE: "1"} if connection.query_params.get(BESIDE) else {}
    if room.port:
        return room.place, urlencode({"token": room.token, **asked, **beside})
    return room.place, urlencode({"token": connection.query_params["token"], PASSED: "1", **beside})


async def reachable(room: RoomProcess, connection: HTTPConnection) -> bool:
    """Whether the room is here, or on another host and nobody has passed that on already."""
    return await room.there(PATIENCE) and (room.port != 0 or PASSED not in connection.query_params)


async def pass_request(request: Request) -> Response:
    """Gets from the room what a page asks for."""
    _, room = invited_by(request)
    if not await reachable(room, request):
        return Response(f"the room {room.room.name} is not there; try again", 503)
    place, query = way_to(room, request, {})
    parts = urlsplit(place)
    kind = http.client.HTTPSConnection if parts.scheme == "https" else http.client.HTTPConnection
    connection = kind(parts.netloc, timeout=PATIENCE)

    def ask() -> http.client.HTTPResponse:
        connection.request("GET", f"{request.url.path}?{query}")
        return connection.getresponse()

    async def content() -> AsyncIterator[bytes]:
        with contextlib.closing(connection):
            while part := await asyncio.to_thread(answer.read, CHUNK):
                yield part

    try:
        answer = await unless_moved(room, place, asyncio.to_thread(ask))
    except (OSError, http.client.HTTPException):
        connection.close()
        return Response(f"the room {room.room.name} has just closed; try again", 503)
    headers = {name: answer.headers[name] for name in HEADERS if name in answer.headers}
    return StreamingResponse(content(), answer.status, headers)


async def pass_socket(page: WebSocket) -> None:
    """Passes messages between a page and its room until either closes, or the room has moved."""
    one, room = invited_by(page)
    await page.accept()
    for _ in range(TRIES):  # a room that has just died may look as if it were there
        if not await reachable(room, page):
            break
        place, query = way_to(room, page, {"name": one.name, "role": one.role.name})
        address = f"{place.replace('http', 'ws', 1)}/socket?{query}"
        way = connect(address, compression=None, max_size=None, max_queue=2, close_timeout=FAREWELL, proxy=None)
        try:
            inner = await unless_moved(room, place, opened(way))
        except LOST:
            await asyncio.sleep(LOOK)
            continue
        here = int(room.port != 0)
        room.people += here
        try:
            await passed(page, inner, room, place)
        finally:
            room.people -= here
        return
    with contextlib.suppress(RuntimeError, WebSocketDisconnect):  # the page has gone
        await page.close(CloseCode.room_lost, "the room is not there")


async def passed(page: WebSocket, inner: ClientConnection, room: RoomProcess, place: str) -> None:
    """Passes messages until an end closes, or the room has moved from its place; then closes both ends."""
    ends = [asyncio.create_task(end) for end in (to_page(inner, page), to_room(page, inner), moved(room, place))]
    await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
    for end in ends:
        end.cancel()
    await asyncio.gather(*ends, return_exceptions=True)
    code, reason = inner.close_code, inner.close_reason or ""
    if code in (None, 1005, 1006):  # none that can be sent
        code, reason = CloseCode.room_lost, "the room was lost"
    with contextlib.suppress(RuntimeError, WebSocketDisconnect):  # the page has gone
        await page.close(code, reason)
    await inner.close()


async def opened(way: connect) -> ClientConnection:
    """A connection once it is open."""
    return await way


async def unless_moved(room: RoomProcess, place: str, answer: Coroutine[Any, Any, Answer]) -> Answer:
    """An answer of the room at a place. Raises `ConnectionError` if it moves away before: a lost host never answers."""
    asked, left = asyncio.create_task(answer), asyncio.create_task(moved(room, place))
    await asyncio.wait((asked, left), return_when=asyncio.FIRST_COMPLETED)
    left.cancel()
    if asked.done():
        return asked.result()
    asked.cancel()
    raise ConnectionError("the room has moved")


async def moved(room: RoomProcess, place: str) -> None:
    """Ends once the room is elsewhere."""
    while room.place == place:
        await asyncio.sleep(LOOK)


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
