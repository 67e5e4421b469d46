"""Real Redis and NATS servers (Debian: redis-server, nats-server), each on a port and in a folder of its own."""

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import time

import pytest

PROGRAMS = {"redis": "redis-server", "nats": "nats-server"}


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


class Server:
    """A registry's server. It can be killed, and started again with what it has on its disk."""

    def __init__(self, kind, folder):
        if shutil.which(PROGRAMS[kind]) is None:
            missing = f"{PROGRAMS[kind]} is missing; install it: apt-get install {PROGRAMS[kind]}"
            (pytest.fail if os.environ.get("PALPATE_REQUIRE_REGISTRIES") == "1" else pytest.skip)(missing)
        self.port = free_port()
        self.address = f"{kind}://127.0.0.1:{self.port}"
        self.command = {
            "redis": [
                "redis-server",
                "--port",
                str(self.port),
                "--dir",
                str(folder),
                "--bind",
                "127.0.0.1",
                "--save",
                "",
            ],
            "nats": ["nats-server", "-js", "-sd", str(folder), "-a", "127.0.0.1", "-p", str(self.port)],
        }[kind]
        self.start()

    def start(self):
        self.process = subprocess.Popen(self.command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        end = time.monotonic() + 20
        while True:
            with contextlib.suppress(OSError):
                socket.create_connection(("127.0.0.1", self.port), 0.2).close()
                return
            assert time.monotonic() < end, f"{self.command[0]} does not start"
            time.sleep(0.02)

    def kill(self):
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()


@contextlib.contextmanager
def registry_server(kind, folder):
    server = Server(kind, folder)
    try:
        yield server
    finally:
        server.kill()
