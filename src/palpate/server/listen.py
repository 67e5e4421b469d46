"""Serving to this machine alone: a socket on loopback, a server in a thread, and the end when Ctrl-C asks for it."""

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

import uvicorn
from starlette.applications import Starlette

from palpate.errors import PortError

HOST = "127.0.0.1"
PORT = 8765
TRIES = 20


def loopback_socket(port: int | None) -> socket.socket:
    """A bound socket on loopback: `port`, or the first free one from `PORT` on. Raises `PortError`."""
    if port is not None and not 0 <= port < 65536:
        raise PortError(f"port {port}: expected 1 to 65535, or leave --port out to have one chosen")
    ports = range(PORT, PORT + TRIES) if port is None else [port]
    for number in ports:
        # With the protocol named, asyncio sends small messages at once (TCP_NODELAY); else each may wait 40 ms.
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
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


def new_token() -> str:
    """What only those know who saw the printed address."""
    return secrets.token_urlsafe(16)


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


@contextlib.contextmanager
def running(app: Starlette, listener: socket.socket, message_bytes: int = 1024) -> Iterator[str]:
    """Runs the server of a guarded `app` in a thread while the block lasts. Gives the address of the page."""
    logging.getLogger("uvicorn.error").setLevel(logging.ERROR)
    config = uvicorn.Config(
        app,
        log_level="error",
        access_log=False,
        ws_max_size=message_bytes,
        ws_per_message_deflate=False,
        timeout_graceful_shutdown=1,
    )
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
    thread.start()
    try:
        while not server.started and thread.is_alive():
            time.sleep(0.005)
        if not server.started:
            raise PortError(f"port {listener.getsockname()[1]}: the server did not start; choose another with --port")
        yield f"http://{HOST}:{listener.getsockname()[1]}/?token={app.state.token}"
    finally:
        server.should_exit = True
        thread.join(5)


def announce(address: str, what: str, notes: list[str]) -> None:
    """Says where the page is and how to reach it from another machine. what: to do there. notes: lines between."""
    port = address.split(":")[2].split("/")[0]
    print(f"palpate: {what} at  {address}")
    print(
        f"         from another machine first:  "
        f"ssh -N -L {port}:{HOST}:{port} {getpass.getuser()}@{socket.gethostname()}"
    )
    for note in notes:
        print(f"         {note}")
    print("         Ctrl-C closes it. Research software, not a medical device.", flush=True)


def show(address: str, ended: threading.Event, open_browser: bool) -> None:
    """Opens the page if there is a screen, and stays until the end is asked for."""
    if open_browser and has_display():
        webbrowser.open(address)
    ended.wait()


def has_display() -> bool:
    """Is there a screen to open a browser on? Without one, Python might start a text browser in the terminal."""
    return sys.platform in ("darwin", "win32") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
