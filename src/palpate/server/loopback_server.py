"""A web server: its socket, on the loopback interface unless said otherwise, its thread, and its shutdown by Ctrl-C."""

import contextlib
import errno
import getpass
import logging
import os
import queue
import signal
import socket
import sys
import threading
import time
import webbrowser
from collections.abc import Iterator
from pathlib import Path

import uvicorn
from starlette.applications import Starlette

from palpate.errors import PortError
from palpate.server.bounded_connections import BoundedConnection

HOST = "127.0.0.1"
PORT = 8765
PORTS_TRIED = 20


def loopback_socket(port: int | None, host: str = HOST) -> socket.socket:
    """A bound socket on loopback, or on another address of this machine: `port`, or the first free one from `PORT` on.

    Raises `PortError`.
    """
    if port is not None and not 0 <= port < 65536:
        raise PortError(f"port {port}: expected 1 to 65535; without --port a free one is chosen")
    ports = range(PORT, PORT + PORTS_TRIED) if port is None else [port]
    for number in ports:
        # asyncio sets TCP_NODELAY only if the protocol is given; without it a small message may be delayed by 40 ms.
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((host, number))
            listener.listen(64)
        except OSError as problem:
            listener.close()
            if problem.errno in (errno.EADDRNOTAVAIL, None):
                raise PortError(f"host {host}: {problem}; give an address of this machine, or 0.0.0.0") from None
            why = problem.strerror
            continue
        return listener
    if port is None:
        raise PortError(f"ports {PORT} to {PORT + PORTS_TRIED - 1} are all in use; choose a free one with --port")
    raise PortError(
        f"port {port}: {why}; choose another with --port {port + 1 if port < 65535 else PORT}, or omit --port"
    )


@contextlib.contextmanager
def shutdown_requests() -> Iterator["queue.SimpleQueue[int]"]:
    """Takes SIGINT (Ctrl-C) and SIGTERM, so that the session is closed and recorded.

    Not an Event: its lock is held for moments by who waits for it, and a handler that falls there would never return.
    """
    ended: queue.SimpleQueue[int] = queue.SimpleQueue()
    if threading.current_thread() is not threading.main_thread():
        yield ended
        return
    signals = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.signal(number, lambda number, _: ended.put(number)) for number in signals}
    try:
        yield ended
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def not_a_refusal(record: logging.LogRecord) -> bool:
    """False for what uvicorn says about each WebSocket that is refused with a status: it is no fault of the server."""
    return "without completing handshake" not in record.getMessage()


@contextlib.contextmanager
def running(
    app: Starlette,
    listener: socket.socket,
    message_bytes: int = 1024,
    connection: type[BoundedConnection] = BoundedConnection,
    certificate: tuple[Path, Path] | None = None,
    ping: float = 20.0,
) -> Iterator[str]:
    """Runs the server of a `page_application` in a thread during the block. Yields its address.

    certificate: files of the certificate and of its key, for TLS. ping: s between pings of a WebSocket, and until one that
    does not answer is closed.
    """
    logger = logging.getLogger("uvicorn.error")
    logger.setLevel(logging.ERROR)
    logger.addFilter(not_a_refusal)
    config = uvicorn.Config(
        app,
        http=connection,
        log_level="error",
        access_log=False,
        ws_max_size=message_bytes,
        ws_per_message_deflate=False,
        ws_ping_interval=ping,
        ws_ping_timeout=ping,
        timeout_graceful_shutdown=1,
        ssl_certfile=None if certificate is None else str(certificate[0]),
        ssl_keyfile=None if certificate is None else str(certificate[1]),
    )
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
    thread.start()
    try:
        while not server.started and thread.is_alive():
            time.sleep(0.005)
        if not server.started:
            raise PortError(
                f"port {listener.getsockname()[1]}: the server did not start; choose another port with --port"
            )
        yield f"http{'s' if certificate else ''}://{HOST}:{listener.getsockname()[1]}/"
    finally:
        server.should_exit = True
        thread.join(5)


def announce(address: str, what: str, notes: list[str]) -> None:
    """Prints the address of the page and how to reach it from another machine. what: what to do there. notes: more lines."""
    port = address.split(":")[2].split("/")[0]
    print(f"palpate: {what} at  {address}")
    print(
        f"         from another machine first:  "
        f"ssh -N -L {port}:{HOST}:{port} {getpass.getuser()}@{socket.gethostname()}"
    )
    for note in notes:
        print(f"         {note}")
    print("         Ctrl-C closes it. Research software, not a medical device.", flush=True)


def show(address: str, ended: "queue.SimpleQueue[int]", open_browser: bool) -> None:
    """Opens the page in a browser if there is a display, and waits until it shall end."""
    if open_browser and has_display():
        webbrowser.open(address)
    came = False
    while not came:  # looked at now and then: a signal may come to another thread, which does not wake this one
        with contextlib.suppress(queue.Empty):
            came = bool(ended.get(timeout=0.5))


def has_display() -> bool:
    """Whether there is a display. Without one, Python might start a text browser in the terminal."""
    return sys.platform in ("darwin", "win32") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
