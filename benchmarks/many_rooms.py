"""How many rooms with two hands one machine holds, and whether rooms last.

    python -m benchmarks.many_rooms [--rooms 4,8,12,16,20] [--seconds 15] [--edge 6]
    python -m benchmarks.many_rooms --minutes 60 --rooms 8

Rooms are served as `palpate serve` does, each with the sample's kidney. In each, two hands hold the organ and draw circles,
with 60 commands a second each; they are websockets of one other process, which draws nothing. The first command tells the
ticks that each room's loop does in a second, the share that comes late, how many frames a hand gets, and
the time from a command to the frame that obeys it. In the second one hands come, hold, let go, leave and come back at random;
some leave without a word while they hold. It tells the memory of every room's process over time, and whether any tool is
held at the end.
"""

import argparse
import asyncio
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import psutil
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed

import palpate as pp
from benchmarks.cutting_by_hand import kidney
from palpate.server import messages
from palpate.server.frame_message import PLACES
from palpate.simulation.pointer import CommandKind

FRAME = messages.BINARY.index(messages.Frame) + 1
COMMANDS = 60  # a second
DEPTH, CIRCLE = 2.0, 4.0  # mm
SETTLING = 3.0  # s
SEEN_INTERVAL = 0.1  # s, as a page says what has come
LEAVING = 12.0  # s in which the room must have noticed who vanished
AWAY = messages.ToolCommand(0, CommandKind.away, 0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def names(count):
    """Of so many rooms."""
    return [f"room-{number:02d}" for number in range(1, count + 1)]


@contextmanager
def served(tissue, count, folder):
    """So many rooms: the address, the trainee's tokens by room, and the server's process."""
    folder.mkdir()
    pp.write_tissue(folder / "kidney.vtu", tissue)
    lines = [f"  {name}: {{organs: [kidney.vtu], model: compliance}}" for name in names(count)]
    (folder / "rooms.yaml").write_text("\n".join(["palpate rooms: 1", "rooms:", *lines]))
    process = subprocess.Popen(
        [sys.executable, "-m", "palpate", "serve", "rooms.yaml", "--no-browser"],
        cwd=folder,
        env={**os.environ, "XDG_STATE_HOME": str(folder), "PYTHONUNBUFFERED": "1", "OPENBLAS_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        tokens, room, address, said = {}, "", "", []
        for line in process.stdout:
            said.append(line)
            if "room " in line and "invitations" in line:
                room = line.split("room ")[1].split(",")[0]
            if "?token=" in line and line.split()[0] == "trainee":
                address, tokens[room] = line.split()[1].split("?token=")
            if "Ctrl-C" in line:
                break
        else:
            raise SystemExit("".join(said))
        yield address, tokens, process
    finally:
        process.send_signal(signal.SIGINT)
        with suppress(subprocess.TimeoutExpired):
            process.communicate(timeout=60)
        process.kill()


def field(frame, name, code):
    """Numbers of a frame's field."""
    at, size = PLACES[name]
    return np.frombuffer(frame, code, size // np.dtype(code).itemsize, at)


class Hand:
    """One hand in a room. place: where it holds, mm, and inward: unit vector there."""

    def __init__(self, address, token, place, inward, phase):
        self.url = f"{address.replace('http', 'ws', 1)}socket?token={token}"
        self.origin = address.rstrip("/")
        self.place, self.inward, self.phase = place, inward, phase
        self.across = np.cross(inward, [0.31, 0.52, 0.8])
        self.across /= np.linalg.norm(self.across)
        self.serial, self.sent, self.delays, self.frames, self.newest = 0, {}, [], 0, b""
        self.socket = None
        self.taken, self.told = 0, 0.0  # frames on this connection, and when the room was told
        self.lost = False  # the connection, while it drew

    async def enter(self):
        """Comes in."""
        self.socket = await connect(self.url, origin=self.origin, max_size=None, compression=None)
        self.taken = 0
        self.reading = asyncio.create_task(self._read())

    async def _read(self):
        with suppress(ConnectionClosed):
            async for data in self.socket:
                if isinstance(data, bytes) and data[0] == FRAME:
                    self.frames, self.newest, self.taken = self.frames + 1, data, self.taken + 1
                    obeyed = int(field(data, "serial", "<u4")[0])
                    for serial in [one for one in self.sent if one <= obeyed]:
                        self.delays.append(time.monotonic() - self.sent.pop(serial))

    async def move(self):
        """Sends one command of its circle."""
        self.serial += 1
        turn = 2 * np.pi * (0.5 * time.monotonic() + self.phase)
        other = np.cross(self.inward, self.across)
        at = self.place + CIRCLE * (np.cos(turn) * self.across + np.sin(turn) * other)
        way = DEPTH * self.inward
        self.sent[self.serial] = time.monotonic()
        if time.monotonic() > self.told + SEEN_INTERVAL:
            self.told = time.monotonic()
            await self.socket.send(messages.encode(messages.Seen(self.taken)))
        command = messages.ToolCommand(0, CommandKind.hold, self.serial, tuple(at.tolist()), tuple(way.tolist()))
        await self.socket.send(messages.encode(command))

    async def draw(self, seconds):
        """Draws its circle."""
        end = time.monotonic() + seconds
        try:
            while time.monotonic() < end:
                await self.move()
                await asyncio.sleep(1 / COMMANDS)
        except ConnectionClosed:
            self.lost = True

    async def let_go(self):
        """Lets go."""
        await self.socket.send(messages.encode(AWAY))

    async def leave(self, without_a_word=False):
        """Leaves; without a word, its connection is cut while it holds."""
        if without_a_word:
            self.socket.transport.abort()
        else:
            await self.socket.close()
        await self.reading
        self.sent.clear()


def hands_of(tissue, address, tokens):
    """Two for each room, on two sides of the organ."""
    middle = tissue.mesh.nodes.mean(axis=0)
    places = []
    for way in ((1.0, -1.0, 0.2), (-1.0, -1.0, -0.2)):
        at = tissue.surface.closest(middle + 200 * np.array(way))
        places.append((np.array(at.point), -np.array(tissue.surface.normal(at))))
    return [
        [Hand(address, token, *place, number / 2 + room / 7) for number, place in enumerate(places)]
        for room, token in enumerate(tokens.values())
    ]


async def measured(rooms, seconds):
    """Of each room: ticks a second, share of ticks that were late; of all hands: frames a second, delays s; hands lost."""
    hands = [hand for room in rooms for hand in room]
    for hand in hands:
        await hand.enter()
    drawing = [asyncio.create_task(hand.draw(SETTLING + seconds)) for hand in hands]
    await asyncio.sleep(SETTLING)
    while not all(room[0].newest or room[0].lost for room in rooms):
        await asyncio.sleep(0.1)
    before = [room[0].newest for room in rooms]
    for hand in hands:
        hand.frames, hand.delays = 0, []
    await asyncio.sleep(seconds - 0.5)
    rows = []
    for room, frame in zip(rooms, before, strict=True):
        now = room[0].newest
        if not frame:
            continue
        ticks = field(now, "tick", "<f8")[0] - field(frame, "tick", "<f8")[0]
        passed = field(now, "seconds", "<f8")[0] - field(frame, "seconds", "<f8")[0]
        late = field(now, "late", "<f8")[0] - field(frame, "late", "<f8")[0]
        rows.append((ticks / max(passed, 1e-9), late / max(ticks, 1)))
    frames = [hand.frames / (seconds - 0.5) for hand in hands]
    delays = [delay for hand in hands for delay in hand.delays]
    await asyncio.gather(*drawing)
    for hand in hands:
        await hand.leave()
    return np.array(rows), np.array(frames), np.array(delays), sum(hand.lost for hand in hands)


def many(counts, seconds, edge):
    """Prints a row for each number of rooms."""
    tissue = kidney(edge)
    print(f"{len(tissue.mesh.nodes):,} nodes, {psutil.cpu_count()} processors; two hands a room")
    print(
        "| rooms | ticks a second, least | late, worst | frames a second and hand | answer, ms | 99 % | cores | lost |"
    )
    print("|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        for count in counts:
            with served(tissue, count, Path(name) / str(count)) as (address, tokens, process):
                everybody = [psutil.Process(process.pid), *psutil.Process(process.pid).children(recursive=True)]
                before, began = sum(sum(one.cpu_times()[:2]) for one in everybody), time.monotonic()
                rows, frames, delays, lost = asyncio.run(measured(hands_of(tissue, address, tokens), seconds))
                used = (sum(sum(one.cpu_times()[:2]) for one in everybody) - before) / (time.monotonic() - began)
            ms = 1e3 * np.quantile(delays, (0.5, 0.99))
            print(
                f"| {count} | {rows[:, 0].min():.0f} | {100 * rows[:, 1].max():.2g} % | "
                f"{frames.min():.0f} to {frames.max():.0f} | {ms[0]:.0f} | {ms[1]:.0f} | {used:.1f} | {lost} |",
                flush=True,
            )


async def come_and_go(hand, seed, end):
    """Enters, holds, lets go and leaves at random until a time."""
    chance = random.Random(seed)
    visits = late = 0
    while time.monotonic() < end:
        try:
            await hand.enter()
        except TimeoutError:  # a page would try again, too
            late += 1
            continue
        visits += 1
        for _ in range(chance.randint(1, 6)):
            await hand.draw(min(chance.uniform(0.5, 15), max(end - time.monotonic(), 0.1)))
            if chance.random() < 0.7:
                await hand.let_go()
                await asyncio.sleep(chance.uniform(0, 3))
        await hand.leave(without_a_word=chance.random() < 0.4)
        await asyncio.sleep(chance.uniform(0, 3))
    return visits, late


async def lasting(rooms, processes, minutes):
    """Prints the memory of the rooms now and then, and what is held once all have left."""
    began = time.monotonic()
    end = began + 60 * minutes
    hands = [hand for room in rooms for hand in room]
    tasks = [asyncio.create_task(come_and_go(hand, seed, end)) for seed, hand in enumerate(hands)]
    sizes = []
    while time.monotonic() < end:
        await asyncio.sleep(min(60.0, max(end - time.monotonic(), 0.1)))
        sizes.append([one.memory_info().rss / 2**20 for one in processes])
        if len(sizes) in (1, 2, 5) or len(sizes) % 10 == 0:
            each = " ".join(f"{size:.0f}" for size in sizes[-1])
            print(
                f"after {(time.monotonic() - began) / 60:.0f} min, MB of the gateway and each room: {each}", flush=True
            )
    visits, late = np.sum(await asyncio.gather(*tasks), axis=0)
    await asyncio.sleep(LEAVING)
    held = 0
    for room in rooms:
        await room[0].enter()
        await asyncio.sleep(1)
        held += int(sum(field(room[0].newest, "contact", "u1")))
        held += int(abs(field(room[0].newest, "force", "<f4")).sum() > 0)
        await room[0].leave()
    half = sizes[len(sizes) // 2] if len(sizes) > 1 else sizes[0]
    growth = [f"{last - then:+.1f}" for then, last in zip(half, sizes[-1], strict=True)]
    print(f"{visits} visits of {len(hands)} hands; {late} times one was not let in within ten seconds")
    print(f"in the second half of the time {' '.join(growth)} MB")
    print(f"tools still held: {held}")
    return held


def last(count, minutes, edge):
    """Runs rooms for so long."""
    tissue = kidney(edge)
    with (
        tempfile.TemporaryDirectory() as name,
        served(tissue, count, Path(name) / "rooms") as (address, tokens, process),
    ):
        processes = [psutil.Process(process.pid), *psutil.Process(process.pid).children()]
        held = asyncio.run(lasting(hands_of(tissue, address, tokens), processes, minutes))
        dead = [one.pid for one in processes if not one.is_running()]
        print(f"rooms that died: {len(dead)}")
    sys.exit(bool(held or dead))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rooms", default="4,8,12,16,20")
    parser.add_argument("--seconds", type=float, default=15.0)
    parser.add_argument("--minutes", type=float, default=0.0)
    parser.add_argument("--edge", type=float, default=6.0, help="of the kidney's mesh, mm")
    given = parser.parse_args()
    counts = [int(count) for count in given.rooms.split(",")]
    if given.minutes:
        last(counts[0], given.minutes, given.edge)
    else:
        many(counts, given.seconds, given.edge)


if __name__ == "__main__":
    main()
