"""Rooms in processes of their own: started, started again with what they held when they die, and ended."""

import asyncio
import contextlib
import json
import os
import secrets
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from palpate.errors import DataError
from palpate.rooms.rooms_file import RoomFile
from palpate.server.live_session import record_name

FIRST_PAUSE, LAST_PAUSE = 0.2, 10.0  # s before a room that died is started again
STEADY = 30.0  # s after which a room is taken for well again
CLOSING = 20.0  # s for a record to be written
LINE = 1 << 26  # bytes, of the longest line that a room writes: its state
HEAPS = {"MALLOC_ARENA_MAX": "2"}  # glibc's: a heap for each thread would keep what its estimates of errors once needed


@dataclass(eq=False)
class RoomProcess:
    """A room, and its process if it is this host's. Used on the event loop's thread only.

    record: where its session goes. token: of the gateway. port: of the room on loopback, or 0 while it is not there. state:
    the cuts and notes that it had last, or None at first. news: set when the state has changed. elsewhere: address of the
    host that has the room, if it is another. people: pages that are in it, if it is here. closed: how often it was closed
    here: each time it is open it has a record of its own. problem: why it cannot be opened.
    """

    room: RoomFile
    record: Path
    token: str = field(default_factory=lambda: secrets.token_urlsafe(16))
    port: int = 0
    state: dict[str, Any] | None = None
    news: asyncio.Event = field(default_factory=asyncio.Event)
    elsewhere: str = ""
    people: int = 0
    deaths: int = 0
    closed: int = 0
    problem: str = ""
    _process: asyncio.subprocess.Process | None = None
    _changed: asyncio.Event = field(default_factory=asyncio.Event)

    async def open(self) -> None:
        """Starts it. Raises `DataError` with what is wrong."""
        self._process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "palpate.rooms.room_server"),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            limit=LINE,
            start_new_session=True,  # Ctrl-C is for the gateway, which ends the rooms
            env={**HEAPS, **os.environ},
        )
        told = {
            "name": self.room.name,
            "organs": [str(path.resolve()) for path in self.room.organs],
            "title": self.room.title,
            "model": self.room.model,
            "radius": self.room.radius,
            "tension": self.room.tension,
            "toughness": self.room.toughness,
            "replay": [str(path.resolve()) for path in self.room.replay],
            "lesson": None if self.room.lesson is None else str(self.room.lesson.resolve()),
            "seed": self.room.seed,
            "record": str(record_name(self.record, self.closed).resolve()),
            "token": self.token,
            "state": self.state,
        }
        assert self._process.stdin
        assert self._process.stdout
        with contextlib.suppress(ConnectionError):  # it has died: the next line says so
            self._process.stdin.write(json.dumps(told).encode() + b"\n")
            await self._process.stdin.drain()
        line = await self._process.stdout.readline()
        ended = {"problem": f"its process ended with {await self._process.wait()}"} if not line else {}
        answer: dict[str, Any] = ended or json.loads(line)
        if "problem" in answer:
            self.problem = f"room {self.room.name}: {answer['problem']}"
            raise DataError(self.problem)
        self.port, self.elsewhere, self.problem = answer["port"], "", ""
        self._changed.set()

    async def keep(self) -> None:
        """Starts it again whenever it dies, until this is cancelled."""
        loop, pause = asyncio.get_running_loop(), FIRST_PAUSE
        while True:
            assert self._process
            began = loop.time()
            await self._listen()
            self.port = 0
            self._changed.clear()
            code = await self._process.wait()
            assert self._process.stdin
            self._process.stdin.close()
            self.deaths += 1
            pause = FIRST_PAUSE if loop.time() - began > STEADY else min(2 * pause, LAST_PAUSE)
            print(f"palpate: room {self.room.name} ended with {code}; it is opened again", flush=True)
            await asyncio.sleep(pause)
            with contextlib.suppress(DataError):
                await self.open()

    async def _listen(self) -> None:
        """Takes its state whenever it tells it, until it ends."""
        assert self._process
        assert self._process.stdout
        while line := await self._process.stdout.readline():
            with contextlib.suppress(ValueError, KeyError):  # cut off as it died
                self.state = json.loads(line)["state"]
                self.news.set()

    def move(self, address: str) -> None:
        """Another host has it."""
        self.elsewhere = address
        self._changed.set()

    @property
    def place(self) -> str:
        """Address of the server that has it, or nothing."""
        return f"http://127.0.0.1:{self.port}" if self.port else self.elsewhere

    async def there(self, seconds: float) -> bool:
        """Whether it is anywhere within that time."""
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._changed.wait(), seconds)
        return self.place != ""

    async def close(self) -> None:
        """Ends it: it tells its state and writes its record."""
        process, self.port = self._process, 0
        self._changed.clear()
        if process is None:
            return
        assert process.stdin
        process.stdin.close()
        try:
            await asyncio.wait_for(asyncio.gather(self._listen(), process.wait()), CLOSING)
            self.closed += 1
        except TimeoutError:
            process.kill()
            await process.wait()
        with contextlib.suppress(ConnectionError):
            await process.stdin.wait_closed()
