"""Runs the simulator: a session, a server on the loopback interface, a page."""

import contextlib
import socket
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

from palpate.errors import DataError, PalpateError
from palpate.server.access_control import check_page
from palpate.server.access_token import access_token
from palpate.server.image_payloads import ImagePayload
from palpate.server.live_session import LiveSession, record_name
from palpate.server.loopback_server import announce, loopback_socket, running, show, shutdown_requests
from palpate.server.touch_routes import MESSAGE_BYTES, application
from palpate.simulation.pointer import Pointer
from palpate.simulation.recorded_session import session_like
from palpate.simulation.recording import Record, write_record
from palpate.simulation.replay import Replay
from palpate.simulation.session import RATE, Session
from palpate.tissue.tissue import Tissue


def replayed(
    replays: Mapping[str, Record],
    organs: Mapping[str, Tissue],
    tension: float,
    images: Sequence[ImagePayload],
    room: str = "",
) -> LiveSession:
    """A session that replays the first of the records, with the second one beside it.

    Each is shown on the tissue that it was recorded with. room: in which several people watch it, or empty. Raises
    `DataError` if there is no such tissue.
    """
    beside = None
    for title, record in reversed(list(replays.items())):
        name, session = recorded_on(record, organs, tension)
        organ = {name: session.first.tissue}
        beside = LiveSession(session, Replay(record), title, organ, images, beside=beside, room=room)
    assert beside is not None
    return beside


def recorded_on(record: Record, organs: Mapping[str, Tissue], tension: float) -> tuple[str, Session]:
    """The name of the tissue of a record, and a session that can replay it. Raises `DataError`."""
    refused = DataError("tissue: none given; name the one that the session was recorded with")
    for name, tissue in organs.items():
        try:
            return name, session_like(record, tissue, tension)
        except DataError as problem:
            refused = problem
    raise refused


def serve_until_closed(
    live: LiveSession,
    listener: socket.socket,
    device: AbstractContextManager[object],
    lines: Sequence[str],
    open_browser: bool,
) -> None:
    """Serves until Ctrl-C, then writes the records. lines: what is printed below the address."""
    # Signals are handled before the address is printed: the user may press Ctrl-C as soon as it is.
    with shutdown_requests() as ended, running_session(live, listener) as address, device:
        announce(address, "touch it", list(lines))
        show(address, ended, open_browser)
    print("\npalpate: closed")
    if live.record is not None:
        write_records(live.record, [*live.finished, live.session])


def write_records(path: Path, sessions: Sequence[Session]) -> None:
    """Writes the records of successive sessions to `path`, then -2, -3, ..., and removes their journals."""
    for before, session in enumerate(sessions):
        name, journal = record_name(path, before), session.journal
        try:
            write_record(name, session.record())
        except PalpateError as problem:
            if journal is None:
                raise
            raise type(problem)(
                f"{problem}; {journal.path} holds what there was room for: read {name} as ever"
            ) from None
        if journal is not None:
            journal.remove()
        print(f"palpate: session recorded in {name}")


def check_ready(port: int | None) -> None:
    """Checks the port and the page before a long computation. Raises `FileError`, `PortError`."""
    loopback_socket(port).close()
    check_page()


def serving(
    session: Session, listener: socket.socket, *, title: str = "organ", replay: Record | None = None
) -> AbstractContextManager[str]:
    """Runs `session` by the clock and its server, in threads, during the block. Yields the address of the page."""
    return running_session(LiveSession(session, Pointer() if replay is None else Replay(replay), title), listener)


@contextlib.contextmanager
def running_session(live: LiveSession, listener: socket.socket, token: str = "") -> Iterator[str]:
    """Runs a live session and its server during the block. Yields the address of the page. token: else this user's."""
    token = token or access_token()
    app = application(live, token)
    if not live.is_replay:
        live.session.start(live.device)  # a replay starts with the first page
    try:
        with running(app, listener, MESSAGE_BYTES) as address:
            yield f"{address}?token={token}"
    finally:
        live.session.stop()


def speed_warning(session: Session) -> list[str]:
    """A warning if this machine is too slow for the mesh, otherwise nothing."""
    if session.sweep_seconds <= 1 / RATE:
        return []
    return [
        f"one sweep of this mesh takes {1e3 * session.sweep_seconds:.1f} ms here: the loop cannot keep "
        f"{RATE} ticks a second; a coarser mesh can (palpate mesh --edge)"
    ]
