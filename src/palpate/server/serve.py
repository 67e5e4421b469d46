"""Opens the simulator: a session, a server on loopback, a page."""

import contextlib
import getpass
import logging
import os
import secrets
import signal
import socket
import sys
import threading
import time
import webbrowser
from collections.abc import Iterator
from pathlib import Path

import uvicorn

from palpate.atomic import writable
from palpate.errors import PortError
from palpate.server.app import MESSAGE_BYTES, application, check_page
from palpate.simulation.devices.pointer import Pointer
from palpate.simulation.devices.replay import Replay
from palpate.simulation.record import Record, write_record
from palpate.simulation.session import RATE, Session, agrees, recorded_settings
from palpate.tissue.models import model as build
from palpate.tissue.tissue import Tissue

HOST = "127.0.0.1"
PORT = 8765
TRIES = 20


def loopback_socket(port: int | None) -> socket.socket:
    """A bound socket on loopback: `port`, or the first free one from `PORT` on. Raises `PortError`."""
    if port is not None and not 0 <= port < 65536:
        raise PortError(f"port {port}: expected 1 to 65535, or leave --port out to have one chosen")
    ports = range(PORT, PORT + TRIES) if port is None else [port]
    for number in ports:
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((HOST, number))
            listener.listen(64)
        except OSError as problem:
            listener.close()
            why = problem.strerror
            continue
        return listener
    if port is None:
        raise PortError(f"ports {PORT} to {PORT + TRIES - 1} are all in use; name a free one with --port")
    raise PortError(f"port {port}: {why}; choose another with --port {port + 1}, or leave --port out")


def touch(
    tissue: Tissue,
    model: str = "blocks",
    *,
    radius: float | None = None,
    port: int | None = None,
    open_browser: bool = True,
    record: str | Path | None = None,
    replay: Record | None = None,
    title: str = "organ",
) -> None:
    """Opens the simulator in a browser and stays until Ctrl-C.

    tissue: a `Tissue`. model: "springs" or "blocks". radius: of the contact, mm (default: two edge lengths). port: on
    loopback (default: the first free one from 8765 on). record: a file for the session, written when it ends. replay:
    a recorded session to look at instead of a pointer; model and radius are then the record's.
    Raises `PortError` if the port is taken, `FileError` if `record` cannot be written, before anything starts.
    """
    if record is not None:
        writable(record)
    listener = loopback_socket(port)
    with contextlib.closing(listener):
        check_page()
        session = Session(build(tissue, model), radius=radius) if replay is None else like(replay, tissue)
        # Listened for before anyone can know the address: whoever sees it may press Ctrl-C at once.
        with end_asked() as ended, serving(session, listener, title=title, replay=replay) as address:
            announce(address, session)
            if open_browser and has_display():
                webbrowser.open(address)
            ended.wait()
    print("\npalpate: closed")
    if record is not None:
        write_record(record, session.record())
        print(f"palpate: session recorded in {record}")


def check_ready(port: int | None) -> None:
    """Is there a page to serve and a port for it? Asked before long work. Raises `FileError`, `PortError`."""
    loopback_socket(port).close()
    check_page()


@contextlib.contextmanager
def end_asked() -> Iterator[threading.Event]:
    """An event that Ctrl-C sets, or the system's wish that the process end: either way all is closed and recorded."""
    ended = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield ended
        return
    wishes = (signal.SIGINT, signal.SIGTERM)
    before = {wish: signal.signal(wish, lambda *_: ended.set()) for wish in wishes}
    try:
        yield ended
    finally:
        for wish, handler in before.items():
            signal.signal(wish, handler)


def like(record: Record, tissue: Tissue) -> Session:
    """A fresh session that can replay the record. Raises `DataError` if it was made on another tissue."""
    model = build(tissue, record.model, relaxation=record.settings["relaxation"])
    session = Session(model, **recorded_settings(record))
    agrees(record, session)
    return session


@contextlib.contextmanager
def serving(
    session: Session, listener: socket.socket, *, title: str = "organ", replay: Record | None = None
) -> Iterator[str]:
    """Runs `session` by the clock and its server, in threads, while the block lasts. Gives the address of the page."""
    token = secrets.token_urlsafe(16)
    pointer = Pointer()
    app = application(session, pointer, token, title, replay is not None)
    logging.getLogger("uvicorn.error").setLevel(logging.ERROR)
    config = uvicorn.Config(
        app,
        log_level="error",
        access_log=False,
        ws_max_size=MESSAGE_BYTES,
        ws_per_message_deflate=False,
        timeout_graceful_shutdown=1,
    )
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
    session.start(pointer if replay is None else Replay(replay))
    thread.start()
    try:
        while not server.started and thread.is_alive():
            time.sleep(0.005)
        if not server.started:
            raise PortError(f"port {listener.getsockname()[1]}: the server did not start; choose another with --port")
        yield f"http://{HOST}:{listener.getsockname()[1]}/?token={token}"
    finally:
        server.should_exit = True
        thread.join(5)
        session.stop()


def has_display() -> bool:
    """Is there a screen to open a browser on? Without one, Python might start a text browser in the terminal."""
    return sys.platform in ("darwin", "win32") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def announce(address: str, session: Session) -> None:
    """Says where the page is, how to reach it from another machine, and whether this machine keeps up."""
    port = address.split(":")[2].split("/")[0]
    print(f"palpate: touch it at  {address}")
    print(
        f"         from another machine first:  "
        f"ssh -N -L {port}:{HOST}:{port} {getpass.getuser()}@{socket.gethostname()}"
    )
    if session.sweep_seconds > 1 / RATE:
        print(
            f"         one sweep of this mesh takes {1e3 * session.sweep_seconds:.1f} ms here: the loop cannot keep "
            f"{RATE} ticks a second; a coarser mesh can (palpate mesh --edge)"
        )
    print("         Ctrl-C closes it. Research software, not a medical device.", flush=True)
