"""How many rooms with two hands each a machine holds at 1,000 ticks a second, and how soon a room that dies is back.

    python -m benchmarks.rooms [--rooms 1,2,4,8] [--seconds 20] [--kills 20]

Each room is the sample's kidney, model `compliance`, in a process of its own behind the gateway. Two hands press and stroke
it at 60 commands a second and take the whole stream, from a process that shares the machine. Told are the ticks a second of
the slowest room, ticks that were late, and the processors' time of rooms, gateway and hands. A room that is killed again and
again waits longer each time before it is opened, up to ten seconds; the times hold these pauses.
"""

import argparse
import asyncio
import contextlib
import json
import math
import os
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import psutil
from websockets.asyncio.client import connect as connect_async
from websockets.sync.client import connect

import palpate as pp
from palpate.rooms.gateway import GatewayConnection, gateway
from palpate.rooms.invitation import invitation, sign
from palpate.rooms.room_process import RoomProcess
from palpate.rooms.serve import PING, checked_rooms, wait_for
from palpate.server import messages
from palpate.server.loopback_server import loopback_socket, running
from palpate.server.touch_routes import MESSAGE_BYTES
from palpate.studies.deformation.kidney import kidney

EDGE = 4.0  # mm
SECRET = "of this benchmark"
RATE = 60  # commands/s of a hand
PRESS = 3.0  # mm
HEAD = "<BBddIIdff4B"  # of a frame
FRAME = 2
SETTLING = 3.0  # s


@contextlib.contextmanager
def open_rooms(count: int, tissue: Path, folder: Path) -> Iterator[tuple[dict[str, RoomProcess], str]]:
    """So many rooms, and the gateway's address."""
    rooms = [pp.RoomFile(f"room-{k}", (tissue,), model="compliance", record=folder / f"{k}.h5") for k in range(count)]
    processes = checked_rooms(rooms, folder)
    with (
        contextlib.closing(loopback_socket(None)) as listener,
        running(gateway(processes, SECRET), listener, MESSAGE_BYTES, GatewayConnection, ping=PING) as base,
    ):
        wait_for(processes)
        yield processes, base


def socket_address(base: str, room: str, name: str) -> str:
    """Where somebody's socket is."""
    token = sign(invitation(room, "trainee", name, 1.0), SECRET)
    return f"{base.replace('http', 'ws')}socket?token={token}"


async def hand(address: str, base: str, at: Sequence[float], phase: float, seconds: float) -> tuple[Any, Any, int]:
    """Presses and strokes for so long. The first frame after it has settled, the last one, and how many came between."""
    async with connect_async(address, origin=base.rstrip("/"), max_queue=None, max_size=None) as page:  # type: ignore[arg-type]
        first: Any = None
        last: Any = None
        frames, began = 0, time.monotonic()

        async def press() -> None:
            for serial in range(1, int(RATE * (seconds + SETTLING))):
                way = 2 * math.pi * serial / RATE / 2 + phase
                moved = (4 * math.sin(way), 0.0, -PRESS * (0.6 + 0.4 * math.cos(way / 3)))
                await page.send(messages.encode(messages.ToolCommand(0, 1, serial, tuple(at), moved)))
                await asyncio.sleep(max(0.0, began + serial / RATE - time.monotonic()))

        pressing = asyncio.create_task(press())
        while not pressing.done():
            data = await page.recv()
            if data[0] != FRAME:
                continue
            frames += 1
            last = (time.monotonic(), struct.unpack_from(HEAD, data))
            if first is None and last[0] - began > SETTLING:
                first, frames = last, 0
        return first, last, frames


async def hands(base: str, count: int, points: Sequence[Sequence[float]], seconds: float) -> None:
    """Two hands in each room; prints what they saw."""
    told = await asyncio.gather(
        *(
            hand(socket_address(base, f"room-{k}", f"{k}-{j}"), base, points[j], k + 2.0 * j, seconds)
            for k in range(count)
            for j in range(2)
        )
    )
    rows = [
        {
            "ticks": (last[1][2] - first[1][2]) / (last[0] - first[0]),
            "late": last[1][3] - first[1][3],
            "busy": last[1][7],
            "frames": frames / (last[0] - first[0]),
            "held": last[1][9] + last[1][10] + last[1][11] + last[1][12],
        }
        for first, last, frames in told
    ]
    print(json.dumps({"rows": rows, "own": sum(os.times()[:2])}))


def processor_seconds(process: psutil.Process) -> float:
    """Of a process so far."""
    spent = process.cpu_times()
    return float(spent.user + spent.system)


def measure(count: int, tissue: Path, points: list[list[float]], seconds: float) -> str:
    """A row of the table."""
    with tempfile.TemporaryDirectory() as name, open_rooms(count, tissue, Path(name)) as (_, base):
        below = [p for p in psutil.Process().children() if "palpate.rooms.room_server" in p.cmdline()]
        before = sum(map(processor_seconds, below)), processor_seconds(psutil.Process())
        began = time.monotonic()
        words = [sys.executable, "-m", "benchmarks.rooms", "--hands", json.dumps([base, count, points, seconds])]
        told = json.loads(subprocess.run(words, check=True, stdout=subprocess.PIPE).stdout)
        lasted = time.monotonic() - began
        rooms = (sum(map(processor_seconds, below)) - before[0]) / lasted
        own = (processor_seconds(psutil.Process()) - before[1]) / lasted
        memory = max(p.memory_info().rss for p in below) / 1e6
    rows = told["rows"]
    late = sum(row["late"] for row in rows) / sum(row["ticks"] * seconds for row in rows)
    return (
        f"| {count} | {min(row['ticks'] for row in rows):.0f} | {late:.2%} | {min(row['frames'] for row in rows):.0f} | "
        f"{rooms:.2f} | {own:.2f} | {told['own'] / lasted:.2f} | {memory:.0f} |"
    )


def kills(count: int, tissue: Path) -> str:
    """Kills a room that is touched, again and again; how long until a frame comes from it again."""
    times = []
    with tempfile.TemporaryDirectory() as name, open_rooms(1, tissue, Path(name)) as (processes, base):
        room = processes["room-0"]
        for _ in range(count):
            with connect(socket_address(base, "room-0", "a"), origin=base.rstrip("/")) as page:  # type: ignore[arg-type]
                while page.recv(timeout=30)[0] != FRAME:
                    pass
                assert room._process
                room._process.kill()
                began = time.monotonic()
            while True:
                try:
                    with connect(socket_address(base, "room-0", "a"), origin=base.rstrip("/")) as page:  # type: ignore[arg-type]
                        while page.recv(timeout=30)[0] != FRAME:
                            pass
                        break
                except Exception:  # not there yet, or still the one that died
                    time.sleep(0.05)
            times.append(time.monotonic() - began)
            time.sleep(0.5)
    times.sort()
    return f"{count} times killed: a frame again after {times[len(times) // 2]:.1f} s (median), {times[-1]:.1f} s (longest)"


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rooms", default="1,2,4,8")
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--hands", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.hands:
        asyncio.run(hands(*json.loads(given.hands)))
        return
    made = kidney(EDGE)
    top = made.mesh.nodes[made.mesh.nodes[:, 2].argsort()[-40:]]
    points = [top[0].tolist(), top[top[:, 1].argmax()].tolist()]
    with tempfile.TemporaryDirectory() as name:
        tissue = Path(name) / "kidney.vtu"
        pp.write_tissue(tissue, made)
        print(f"{len(made.mesh.nodes)} nodes, {os.cpu_count()} processors\n")
        print("| rooms | ticks/s | late | frames/s | rooms' | gateway's | hands' processors | MB a room |")
        print("| --- | --- | --- | --- | --- | --- | --- | --- |")
        for count in map(int, given.rooms.split(",")):
            print(measure(count, tissue, points, given.seconds), flush=True)
        if given.kills:
            print(f"\n{kills(given.kills, tissue)}")


if __name__ == "__main__":
    main()
