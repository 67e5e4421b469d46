"""The web application of `touch`: the page, the scene, and a WebSocket for each page with messages of limited size."""

import asyncio
import contextlib
from collections.abc import AsyncIterator

from starlette.applications import Starlette
from starlette.requests import HTTPConnection, Request
from starlette.responses import Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from palpate.errors import DataError, PalpateError
from palpate.server.access_control import by_token, page_application
from palpate.server.frame_message import frame_bytes, pieces_bytes
from palpate.server.live_session import LiveSession, report_failure
from palpate.server.message_checks import decode
from palpate.server.message_kinds import CloseCode, Role, SelectionKind
from palpate.server.messages import (
    Choice,
    Compare,
    Detail,
    Guided,
    Lead,
    Mark,
    Play,
    Scalpel,
    Seen,
    Selection,
    notes_bytes,
)
from palpate.server.people import MOST_PEOPLE
from palpate.server.playback import Playback
from palpate.server.solid_message import predicted_solid
from palpate.server.view import image_routes
from palpate.tissue.models.registry import names_in_sessions

FRAME_TICKS = 16  # between frames: the rate of a display, 60 Hz
MIN_FRAME_INTERVAL = 0.008  # s, while commands arrive
FRAME_TIMEOUT = 0.1  # s, after which a stopped session is looked at again
MESSAGE_BYTES = 1024  # largest message from a page; a command has 32
MOST_PAGES = 8
MAX_REASON = 120  # characters; the WebSocket protocol allows 123 bytes


def application(live: LiveSession, token: str) -> Starlette:
    """The web application of a running session. Raises `FileError` if the page was not bundled."""
    lives = [live] if live.beside is None else [live, live.beside]
    playback = Playback(lives) if live.is_replay else None

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        work = [publish_frames(live)] if playback is None else [playback.run(), playback.measure()]
        tasks = [asyncio.create_task(each) for each in work]
        for task in tasks:
            task.add_done_callback(report_failure)
        live.hand_over()
        yield
        for task in tasks:
            task.cancel()

    routes = [
        Route("/scene", scene),
        Route("/solid", solid),
        WebSocketRoute("/socket", socket),
        *image_routes(live.images),
    ]
    app = page_application("index.html", routes, by_token(token), lifespan)
    app.state.lives, app.state.playback = lives, playback
    return app


def shown_by(request: HTTPConnection) -> LiveSession:
    """The session that a page asks for: the first one, or the replay beside it."""
    lives: list[LiveSession] = request.app.state.lives
    return lives[-1] if request.query_params.get("beside") else lives[0]


async def scene(request: Request) -> Response:
    """Nodes at rest and triangles."""
    live = shown_by(request)
    return Response(live.scene, media_type="application/octet-stream")


async def solid(request: Request) -> Response:
    """The organ for the engine of a page that answers its own hand; status 409 and the reason if it cannot.

    Not in an exam: the solid tells what is inside.
    """
    live = shown_by(request)
    if live.exam is not None:
        return Response("prediction: not in an exam", 409, media_type="text/plain")
    try:
        data = await asyncio.to_thread(predicted_solid, live.session)
    except PalpateError as problem:
        return Response(str(problem), 409, media_type="text/plain")
    return Response(data, media_type="application/octet-stream")


async def publish_frames(live: LiveSession) -> None:
    """Encodes the frames that the loop publishes and wakes the pages: at the display's rate, sooner after a command."""
    serial, tick = -1, 0  # of the last frame, and of the next one
    while True:
        if not await asyncio.to_thread(live.session.loop.wait_frame, serial, tick, FRAME_TIMEOUT):
            serial, tick = -1, 0  # another session may run by now
            continue
        frame = live.session.frame()
        serial, tick = frame.serial, frame.tick + FRAME_TICKS
        if live.exam is None:
            live.estimate(frame)
        live.watch(frame)
        shown = live.session.drawn(frame)
        live.publish(
            frame_bytes(
                frame, shown, live.current[1], live.choice[1], live.force_errors, live.exam is not None, live.offset
            ),
            pieces_bytes(frame),
        )
        await asyncio.sleep(MIN_FRAME_INTERVAL)


async def socket(page: WebSocket) -> None:
    """One page: sends frames and obeys commands until it disconnects."""
    live = shown_by(page)
    playback: Playback | None = page.app.state.playback if live is page.app.state.lives[0] else None
    await page.accept()
    most = MOST_PEOPLE if live.room else MOST_PAGES
    if len(live.pages) >= most:
        await page.close(CloseCode.too_many_pages, f"{most} pages are open already; close one")
        return
    # The token that let this request in is the gateway's in a room: it says who comes.
    new_frame = live.connect(page, page.query_params.get("name", ""), role_of(page.query_params.get("role", "")))
    if live.notes and not live.exam:
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):
            await page.send_bytes(notes_bytes(live.notes))
    if playback:
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):
            for greeting in playback.greetings():
                await page.send_bytes(greeting)
        playback.wake()
    sender = asyncio.create_task(send_frames(page, live, new_frame))
    await live.report(page)
    try:
        await receive_messages(page, live, playback)
    except DataError as problem:
        await page.close(CloseCode.refused, str(problem)[:MAX_REASON])
    except (WebSocketDisconnect, KeyError):  # KeyError: a text message
        with contextlib.suppress(RuntimeError):  # it is closed already
            await page.close(CloseCode.refused, "a text message; expected binary messages only")
    finally:
        sender.cancel()
        live.disconnect(page)


def role_of(name: str) -> Role:
    """The role of that name; the least one if there is none."""
    return Role[name] if name in Role.__members__ else Role.viewer


async def send_frames(page: WebSocket, live: LiveSession, new_frame: asyncio.Event) -> None:
    """Sends the newest frame as soon as the connection has taken the one before, and the page is not too far behind.

    Frames in between are skipped.
    """
    last_difference, flow = b"", live.flows[page]
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        while True:
            await new_frame.wait()
            await flow.ready()
            new_frame.clear()
            messages = live.messages(page)
            if messages:
                flow.send()
            for message in messages:
                await page.send_bytes(message)
            if page in live.comparison.pages and live.comparison.newest not in (b"", last_difference):
                last_difference = live.comparison.newest
                await page.send_bytes(last_difference)


async def receive_messages(page: WebSocket, live: LiveSession, playback: Playback | None) -> None:
    """Obeys the messages of a page. Raises `DataError` for an invalid one."""
    while True:
        message = decode(await page.receive_bytes())
        if live.people and (refusal := live.people.refusal(page, message)):
            await live.tell(refusal, page)
        elif isinstance(message, Selection):
            counts = {SelectionKind.model: len(names_in_sessions()), SelectionKind.organ: len(live.organs)}
            kind = SelectionKind(message.kind)
            if message.index >= counts[kind]:
                raise DataError(f"Selection: {kind.name} {message.index} of {counts[kind]}; reload the page")
            live.select(message)
        elif isinstance(message, Mark):
            live.mark(page, message)
        elif isinstance(message, Compare):
            live.comparison.request(page, message.on == 1 and live.exam is None)
        elif isinstance(message, Scalpel):
            live.cut(page, message)
        elif isinstance(message, Choice):
            live.choose(message)
        elif isinstance(message, Lead):
            live.lead(page, message)
        elif isinstance(message, Guided):
            live.hear_guidance(page, message)
        elif isinstance(message, Seen):
            live.flows[page].taken(message.count)
        elif isinstance(message, Detail):
            if live.people:
                live.people.detail(page, message)
        elif isinstance(message, tuple):
            live.note(*message)
        elif isinstance(message, Play):
            if playback:
                playback.obey(message)
        else:
            live.command(page, message)
