"""The web application of `touch`: the page, the scene, and a WebSocket for each page with messages of limited size."""

import asyncio
import contextlib
from collections.abc import AsyncIterator

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from palpate.errors import DataError
from palpate.server.access_control import page_application
from palpate.server.live_session import LiveSession, report_failure
from palpate.server.messages import CloseCode, Compare, Mark, Scalpel, Selection, SelectionKind, decode, frame_bytes
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

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        publisher = asyncio.create_task(publish_frames(live))
        publisher.add_done_callback(report_failure)
        live.hand_over()
        yield
        publisher.cancel()

    routes = [Route("/scene", scene), WebSocketRoute("/socket", socket), *image_routes(live.images)]
    app = page_application("index.html", routes, token, lifespan)
    app.state.live = live
    return app


async def scene(request: Request) -> Response:
    """Nodes at rest and triangles."""
    live: LiveSession = request.app.state.live
    return Response(live.scene, media_type="application/octet-stream")


async def publish_frames(live: LiveSession) -> None:
    """Encodes the frames that the loop publishes and wakes the pages: at the display's rate, sooner after a command."""
    serial, tick = -1, 0  # of the last frame, and of the next one
    while True:
        if not await asyncio.to_thread(live.session.loop.wait_frame, serial, tick, FRAME_TIMEOUT):
            serial, tick = -1, 0  # another session may run by now
            continue
        frame = live.session.frame()
        serial, tick = frame.serial, frame.tick + FRAME_TICKS
        model = live.current[1]
        chosen = model if live.is_replay else live.choice[1]
        if live.exam is None:
            for task in (live.comparison.update(live.session, frame), live.force_errors.update(live.session, frame)):
                if task:
                    task.add_done_callback(report_failure)
        live.watch(frame)
        shown = live.session.drawn(frame)
        live.newest = frame_bytes(frame, shown, model, chosen, live.force_errors, live.exam is not None)
        live.replay_cuts(frame.tick)
        for event in live.pages.values():
            event.set()
        await asyncio.sleep(MIN_FRAME_INTERVAL)


async def socket(page: WebSocket) -> None:
    """One page: sends frames and obeys commands until it disconnects."""
    live: LiveSession = page.app.state.live
    await page.accept()
    if len(live.pages) >= MOST_PAGES:
        await page.close(CloseCode.too_many_pages, f"{MOST_PAGES} pages are open already; close one")
        return
    new_frame = live.connect(page)
    sender = asyncio.create_task(send_frames(page, live, new_frame))
    try:
        await receive_messages(page, live)
    except DataError as problem:
        await page.close(CloseCode.refused, str(problem)[:MAX_REASON])
    except (WebSocketDisconnect, KeyError):  # KeyError: a text message
        with contextlib.suppress(RuntimeError):  # it is closed already
            await page.close(CloseCode.refused, "a text message; expected binary messages only")
    finally:
        sender.cancel()
        live.disconnect(page)


async def send_frames(page: WebSocket, live: LiveSession, new_frame: asyncio.Event) -> None:
    """Sends the newest frame as soon as the page has taken the one before; frames in between are skipped."""
    last_difference = b""
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        while True:
            await new_frame.wait()
            new_frame.clear()
            if live.newest:
                await page.send_bytes(live.newest)
            if page in live.comparison.pages and live.comparison.newest not in (b"", last_difference):
                last_difference = live.comparison.newest
                await page.send_bytes(last_difference)


async def receive_messages(page: WebSocket, live: LiveSession) -> None:
    """Obeys the messages of a page. Raises `DataError` for an invalid one."""
    while True:
        message = decode(await page.receive_bytes())
        if isinstance(message, Selection):
            counts = {SelectionKind.model: len(names_in_sessions()), SelectionKind.organ: len(live.organs)}
            kind = SelectionKind(message.kind)
            if message.index >= counts[kind]:
                raise DataError(f"Selection: {kind.name} {message.index} of {counts[kind]}; reload the page")
            live.select(message)
        elif isinstance(message, Mark):
            live.mark(message)
        elif isinstance(message, Compare):
            live.comparison.request(page, message.on == 1 and live.exam is None)
        elif isinstance(message, Scalpel):
            live.cut(page, message)
        else:
            live.command(page, message)
