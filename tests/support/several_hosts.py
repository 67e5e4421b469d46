"""Several hosts that serve the same rooms: each is `palpate serve` in a process group and a folder of its own."""

import asyncio
import contextlib
import json
import os
import shutil
import signal
import struct
import subprocess
import sys
import threading
import time

import httpx
import numpy as np
import psutil
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.sync.client import connect

from palpate.server import messages
from palpate.server.message_kinds import CutStep
from support.registries import free_port

TOP = (0.0, 0.0, 25.0)
NOT_THERE = (ConnectionClosed, InvalidHandshake, OSError, TimeoutError, httpx.HTTPError)
PAUSE = 0.3  # s between tries to come back, as a page makes them
FRAME = 2


class ServingHost:
    """One of them. It is lost as a whole: its processes, its rooms and its disk. tokens: by role, of its last room."""

    def __init__(self, folder, organ, registry, *rooms):
        folder.mkdir()
        shutil.copy(organ, folder / "kidney.vtu")
        what = "kidney.vtu"
        if rooms:
            what = "rooms.yaml"
            lines = [f"  {room}: {{organs: [kidney.vtu], record: {room}.h5}}" for room in rooms]
            (folder / what).write_text("\n".join(["palpate rooms: 1", "rooms:", *lines]))
        self.folder, self.port = folder, free_port()
        self.base = f"http://127.0.0.1:{self.port}/"
        command = (sys.executable, "-m", "palpate", "serve", what, "--no-browser", "--port", str(self.port))
        self.process = subprocess.Popen(
            [*command, "--registry", registry],
            cwd=folder,
            env={**os.environ, "XDG_STATE_HOME": str(folder / "state"), "PYTHONUNBUFFERED": "1"},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.said, self.tokens = [], {}
        for line in self.process.stdout:
            self.said.append(line)
            if "?token=" in line:
                role, address = line.split()
                self.tokens[role] = address.split("token=")[1]
            if "Ctrl-C" in line:
                return
        raise AssertionError("".join(self.said))

    def rooms(self):
        """The processes of its rooms."""
        with contextlib.suppress(psutil.NoSuchProcess):
            children = psutil.Process(self.process.pid).children()
            return [one.pid for one in children if one.status() != psutil.STATUS_ZOMBIE]
        return []

    def lose(self):
        """As when its power fails, but that its connections are closed."""
        for number in (*self.rooms(), self.process.pid):
            os.kill(number, signal.SIGKILL)
        self.process.wait()
        self.process.stdout.close()
        shutil.rmtree(self.folder)

    def silence(self):
        """As when its cable is pulled: nothing is answered, and no connection is closed."""
        for number in (*self.rooms(), self.process.pid):
            os.kill(number, signal.SIGSTOP)

    def resume(self):
        """After `silence`."""
        for number in (*self.rooms(), self.process.pid):
            os.kill(number, signal.SIGCONT)

    def end(self):
        """Ends it as Ctrl-C does."""
        if self.process.poll() is None:
            self.resume()
            self.process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.said += self.process.communicate(timeout=60)[0].splitlines(keepends=True)
        if self.process.poll() is None:
            self.lose()


@contextlib.contextmanager
def balancer(ports):
    """Address of a server in front of all hosts, as an ingress is: it connects to the first of the ports that answers."""
    loop = asyncio.new_event_loop()

    async def pump(reader, writer):
        with contextlib.suppress(OSError):
            while data := await reader.read(1 << 16):
                writer.write(data)
                await writer.drain()
        writer.close()

    async def passed(reader, writer):
        for port in ports:
            with contextlib.suppress(OSError):
                there, back = await asyncio.open_connection("127.0.0.1", port)
                await asyncio.gather(pump(reader, back), pump(there, writer))
                return
        writer.close()

    async def ended():
        server.close()
        others = asyncio.all_tasks() - {asyncio.current_task()}
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)

    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()
    server = asyncio.run_coroutine_threadsafe(asyncio.start_server(passed, "127.0.0.1", 0), loop).result()
    try:
        yield f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}/"
    finally:
        asyncio.run_coroutine_threadsafe(ended(), loop).result()
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()


def page_of(host, token):
    """A page's socket to a host."""
    return connect(
        f"{host.base.replace('http', 'ws')}socket?token={token}",
        origin=host.base.rstrip("/"),
        max_queue=None,
        close_timeout=1,
    )


def scene_of(host, token):
    """The head of the scene that a host gives."""
    answer = httpx.get(f"{host.base}scene", params={"token": token}, timeout=30)
    answer.raise_for_status()
    (length,) = struct.unpack_from("<I", answer.content)
    return json.loads(answer.content[4 : 4 + length])


def back(host, token, seconds=60.0):
    """The scene and the notes that a page gets, once it gets a frame too, and the time that this took, s."""
    began = time.monotonic()
    while True:
        with contextlib.suppress(*NOT_THERE):
            scene = scene_of(host, token)
            with page_of(host, token) as page:
                notes = []
                while (data := page.recv(timeout=2))[0] != FRAME:
                    notes = json.loads(data[8:]) if data[0] == 11 else notes
                return scene, [one["text"] for one in notes], time.monotonic() - began
        assert time.monotonic() - began < seconds, "the room does not come back"
        time.sleep(PAUSE)


def cut_over_the_top(page, y=0.0):
    """The strokes of a scalpel over an `organ` of the tests."""
    way = [(float(a), y, float(25 * np.sqrt(1 - (a / 40) ** 2 - (y / 30) ** 2))) for a in np.linspace(-12, 12, 12)]
    for i, point in enumerate(way):
        step = CutStep.begin if i == 0 else CutStep.end if i == len(way) - 1 else CutStep.move
        page.send(messages.encode(messages.Scalpel(step, 12.0, point)))
