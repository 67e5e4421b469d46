"""Random messages to a real `palpate touch`: what is no message is refused by its code, and nothing else happens.

    python tests/fuzz/server_messages.py 100000 --seed 1

It sends so many messages, good and bad, over sockets that it opens anew after each refusal, and ends with 1 if the server
took one that is none, refused a good one, crashed, grew, or its loop or its other pages suffered. Judged by the layout
that `messages.py` documents, written here a second time.
"""

import argparse
import contextlib
import math
import os
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path

import numpy as np
from support.example_organs import organ
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

import palpate as pp

LENGTHS = {
    1: 32,
    3: 4,
    4: 4,
    5: 4,
    7: 32,
    8: 8,
    12: 12,
    15: 8,
    18: 4,
    19: 8,
    21: 28,
}  # of a tool, a selection, a mark, a wish to compare, a scalpel, a choice in an experiment, a player, a lead, detail, frames
# and one end of a guidance
NOTE = 10
FRAME = 2
LARGEST, POLICY, TOO_BIG = 1024, 1008, 1009
HOSTILE = [math.nan, math.inf, -math.inf, 1e38, -1e38, 1e-40, 0.0, 1e6, -1e5]
MODELS, ORGANS, REACH_SHARE = 5, 1, 0.5


def good(data, reach):
    """Is this a message? Kind, exact length, numbers in range, finite, and no displacement longer than `reach`."""
    if isinstance(data, bytes) and data[:1] == bytes([NOTE]):
        return good_note(data)
    if not isinstance(data, bytes) or not data or LENGTHS.get(data[0]) != len(data):
        return False
    if data[0] == 3:
        return data[1] < 2 and data[2] < (MODELS, ORGANS)[data[1]]
    if data[0] == 4:
        return data[1] < 2 and data[2] < 4
    if data[0] in (5, 18):
        return data[1] < 2
    if data[0] == 7:
        depth, *place = struct.unpack_from("<4f", data, 2)
        return data[1] < 4 and all(map(math.isfinite, (depth, *place))) and (depth > 0 or data[1] == 3)
    if data[0] == 8:
        return data[1] < 3 and data[2] in (1, 2)
    if data[0] == 15:
        return data[1] < 7
    if data[0] == 21:
        given, *force = struct.unpack_from("<d3f", data, 5)
        return math.isfinite(given) and given >= 0 and math.hypot(*force) <= 1.001
    if data[0] == 19:
        return True
    if data[0] == 12:
        (value,) = struct.unpack_from("<d", data, 2)
        low, high = {2: (0.25, 4), 3: (0, 1e15)}.get(data[1], (-math.inf, math.inf))
        return data[1] < 4 and math.isfinite(value) and low <= value <= high
    tool, kind = data[1], data[2]
    numbers = struct.unpack_from("<6f", data, 7)
    if tool > 3 or kind not in (0, 1, 2, 3, 5) or not all(map(math.isfinite, numbers)):
        return False
    return kind == 0 or math.dist(numbers[3:], (0, 0, 0)) <= reach


def good_note(data):
    """A step, an index, a finite place, then up to 800 bytes of UTF-8."""
    if not 16 < len(data) <= 816 or data[1] > 1 or not all(map(math.isfinite, struct.unpack_from("<3f", data, 3))):
        return False
    try:
        data[16:].decode()
    except UnicodeDecodeError:
        return False
    return True


def one(rng, nodes, reach):
    """A message: mostly good ones, then all ways of being bad."""
    at = nodes[rng.integers(len(nodes))]
    way = rng.normal(0, 3, 3)
    tool = struct.pack("<BBBI6fx", 1, rng.integers(4), rng.integers(4), rng.integers(2**32), *at, *way)
    draw = rng.random()
    if draw < 0.7:
        return tool
    if draw < 0.74:
        return struct.pack("<BBBx", 4, rng.integers(2), rng.integers(4))
    if draw < 0.742:
        return struct.pack("<BBBx", 3, 0, rng.integers(3))
    if draw < 0.744:
        return struct.pack("<BBxx", 5, rng.integers(2))
    if draw < 0.75:
        depth = float(rng.choice([5.0, 15.0, 1e38, -1.0, math.nan], p=[0.6, 0.3, 0.02, 0.04, 0.04]))
        where = at if rng.random() < 0.95 else rng.choice(HOSTILE, 3)
        return struct.pack("<BB4fxx", 7, rng.integers(5), depth, *where)
    if draw < 0.752:
        text = rng.choice(["hard", "\x00\x1b[31m", "é" * 200, "", "\u202e", "a" * 300]).encode()
        return struct.pack("<BBB3fx", NOTE, rng.integers(3), rng.integers(4), *at) + text
    if draw < 0.754:
        return struct.pack("<BBdxx", 12, rng.integers(5), rng.choice([0.25, 3.0, 1e4, -1.0, math.nan]))
    if draw < 0.7545:
        force = rng.choice([0.0, 0.1, 3.0, math.nan, math.inf], 3, p=[0.4, 0.5, 0.04, 0.03, 0.03])
        return struct.pack("<BId3fxxx", 21, rng.integers(3), rng.choice([0.0, 2.5, -1.0, math.inf]), *force)
    if draw < 0.755:
        return struct.pack("<BBIxx", 15, rng.integers(9), rng.integers(4))
    if draw < 0.756:
        return struct.pack("<BBBIx", 8, rng.integers(4), rng.integers(4), rng.integers(9))
    if draw < 0.80:
        return rng.bytes(int(2 ** rng.uniform(0, 10)) - 1)
    if draw < 0.85:
        kind = int(rng.choice(list(LENGTHS)))
        return bytes([kind]) + rng.bytes(LENGTHS[kind] - 1)
    if draw < 0.90:
        numbers = [*at, *way]
        numbers[rng.integers(6)] = HOSTILE[rng.integers(len(HOSTILE))]
        return tool[:7] + struct.pack("<6fx", *numbers)
    if draw < 0.94:
        mutant = bytearray(tool)
        mutant[rng.integers(len(mutant))] ^= 1 << int(rng.integers(8))
        return bytes(mutant)
    if draw < 0.97:
        cut = int(rng.integers(60))
        return (tool + rng.bytes(30))[:cut]
    if draw < 0.985:
        return "".join(map(chr, rng.integers(32, 0x2000, rng.integers(0, 200))))
    return rng.bytes(int(rng.integers(LARGEST + 1, 5000)))


@contextlib.contextmanager
def served(folder):
    """`palpate touch` in a process, and the address of its page."""
    tissue = folder / "tissue.vtu"
    pp.write_tissue(tissue, organ(5))
    words = [sys.executable, "-m", "palpate", "touch", str(tissue), "--no-browser", "--radius", "14"]
    there = {**os.environ, "PYTHONPATH": str(Path(pp.__file__).parents[1])}
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=there)
    try:
        line = process.stdout.readline()
        assert "http://127.0.0.1:" in line, line + process.stdout.read()
        yield process, line.split()[-1]
    finally:
        process.kill()
        process.wait()


def opened(address):
    """A page's socket."""
    base, token = address.split("/?")
    return connect(f"{base.replace('http', 'ws')}/socket?{token}", origin=base, max_queue=4)


def resident(process):
    """MB."""
    words = Path(f"/proc/{process.pid}/status").read_text().split()
    return int(words[words.index("VmRSS:") + 1]) / 1024


def next_frame(page):
    """The next frame that there is to read."""
    while (data := page.recv(timeout=20))[0] != FRAME:
        pass  # a difference, for a page that wished to compare, or notes
    return data


def tick(page):
    """Of the next frame that there is to read."""
    return struct.unpack_from("<d", next_frame(page), 2)[0]


class Onlooker(threading.Thread):
    """A page that reads all along while others misbehave. tick: of its newest frame. closed: by whom it should not be."""

    def __init__(self, page):
        super().__init__(daemon=True)
        self.page, self.tick, self.closed = page, tick(page), None
        self.start()

    def run(self):
        try:
            while True:
                self.tick = tick(self.page)
        except (ConnectionClosed, TimeoutError) as end:
            self.closed = end


def closed(page):
    """The code by which the server closes, once all frames before are read; None if it does not."""
    end = time.monotonic() + 20
    with contextlib.suppress(ConnectionClosed):
        while time.monotonic() < end:
            page.recv(timeout=20)
        return None
    return page.close_code


def run(count, seed):
    """How many messages came to what, MB after half of them and at the end, and what was wrong."""
    rng, told, wrong = np.random.default_rng(seed), Counter(), []
    mesh = organ(5).mesh
    reach, nodes = REACH_SHARE * float(np.linalg.norm(np.ptp(mesh.nodes, axis=0))), mesh.nodes[mesh.surface_nodes]
    with tempfile.TemporaryDirectory() as folder, served(Path(folder)) as (process, address):
        with opened(address) as other:
            onlooker, early, n = Onlooker(other), 0.0, 0
            first = onlooker.tick
            while n < count:
                with opened(address) as page:
                    while n < count:
                        data = one(rng, nodes, reach)
                        page.send(data)
                        n += 1
                        if n == count // 2:
                            early = resident(process)
                        if not good(data, reach):
                            code = closed(page)
                            told[f"refused with {code}"] += 1
                            if code != (TOO_BIG if isinstance(data, bytes) and len(data) > LARGEST else POLICY):
                                wrong.append(f"message {n - 1}: closed with {code}: {data!r}")
                            break
                        told["taken"] += 1
                    else:
                        tick(page)  # what was good has left the last socket open
            last = onlooker.tick
            time.sleep(1)
            if onlooker.closed or not onlooker.tick > last > first:
                wrong.append(f"the loop stands at tick {last}, or another page was closed: {onlooker.closed}")
        late = resident(process)
        with opened(address) as page:
            page.send(struct.pack("<BBBI6fx", 1, 0, 1, 9, 0, 0, 25, 0, 0, -3))
            if not any(felt(page) > 0.05 for _ in range(400)):
                wrong.append("a press is not felt any more")
        process.send_signal(signal.SIGINT)
        out = process.communicate(timeout=30)[0]
        if process.returncode or "Traceback" in out:
            wrong.append(f"ended with {process.returncode}: {out}")
    return told, (early, late), wrong


def felt(page):
    """N, of the first tool."""
    return float(np.linalg.norm(struct.unpack_from("<3f", next_frame(page), FORCE)))


FORCE = 1 + 1 + 8 + 8 + 4 + 4 + 8 + 4 + 4 + 4 + 48 + 48


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    told, (early, late), wrong = run(given.count, given.seed)
    for name, times in sorted(told.items()):
        print(f"{times:7d}  {name}")
    print(f"memory: {early:.0f} MB after half of them, {late:.0f} MB at the end")
    for line in wrong[:20]:
        print(line)
    print(f"{given.count} messages, seed {given.seed}: {len(wrong)} wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
