"""Four random hands at a page's end of the socket: what they feel must be numbers, and what they let go of must be loose.

Run by soak.py: hands.py ADDRESS SECONDS SEED. Prints a JSON line every few seconds, exits with 1 at the first wrong.
"""

import json
import struct
import sys
import time
from dataclasses import fields
from typing import get_args, get_type_hints

import httpx
import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from palpate.server import messages

RATE = 60.0  # commands a second
TELLS = 4.0  # s between lines
ROUND, LOOSE = 27.0, 3.0  # s: all hands play, then all let go
AWAY, HOLD, NEEDLE, FREE = range(4)
LAYOUT = messages.code(messages.Frame)
UNKNOWN = ("mesh_error", "linearisation", "stiffness_spread", "least_volume")  # NaN where there is no estimate


class Hand:
    """One tool that takes the surface somewhere, wanders, and lets go, by chance."""

    def __init__(self, tool: int, rng: np.random.Generator, nodes: np.ndarray, reach: float) -> None:
        self.tool, self.rng, self.nodes, self.reach = tool, rng, nodes, min(reach, 12.0)
        self.kind, self.until = AWAY, 0.0

    def wants(self, now: float) -> messages.ToolCommand:
        """The next command."""
        if now > self.until:
            self.kind = int(self.rng.choice([AWAY, HOLD, HOLD, NEEDLE, FREE]))
            self.until = now + self.rng.uniform(0.3, 6)
            self.point = self.nodes[self.rng.integers(len(self.nodes))].astype(float)
            self.way = np.zeros(3)
            self.drift = self.rng.normal(0, 0.4, 3)
        self.drift = 0.97 * self.drift + self.rng.normal(0, 0.08, 3)
        if self.kind == HOLD:
            self.point = self.point + 0.3 * self.rng.normal(0, 1, 3)
            self.way = self.way + self.drift
        elif self.kind in (NEEDLE, FREE):
            inwards = self.nodes.mean(axis=0) - self.point
            self.way = self.way + 0.4 * self.drift + 0.15 * inwards / max(1.0, np.linalg.norm(inwards))
        size = float(np.linalg.norm(self.way))
        way = self.way * min(1.0, self.reach / max(size, 1e-9))
        point = self.point + way if self.kind == FREE else self.point
        give = np.zeros(3) if self.kind == FREE else way
        return messages.ToolCommand(self.tool, self.kind, self.serial(now), tuple(point.tolist()), tuple(give.tolist()))

    @staticmethod
    def serial(now: float) -> int:
        """Milliseconds, to see how old the command is that a frame obeys."""
        return int(1000 * now) + 1


def main() -> int:
    address, seconds, seed = sys.argv[1], float(sys.argv[2]), int(sys.argv[3])
    nodes, reach, models, model = scene(address)
    hands = [Hand(tool, np.random.default_rng([seed, tool]), nodes, reach) for tool in range(4)]
    base, token = address.split("/?")
    seen, serial, delays, gaps, wrong = 0, -1.0, [], [], ""
    began = last = told = time.monotonic()
    sent = rounds = 0.0
    with connect(f"{base.replace('http', 'ws')}/socket?{token}", origin=base, max_size=None) as page:
        while not wrong and (now := time.monotonic() - began) < seconds:
            loose = now % (ROUND + LOOSE) > ROUND
            if now - sent >= 1 / RATE:
                sent = now
                for hand in hands:
                    letting = messages.ToolCommand(hand.tool, AWAY, hand.serial(now), (0.0,) * 3, (0.0,) * 3)
                    page.send(messages.encode(letting if loose else hand.wants(now)))
            if now // (ROUND + LOOSE) > rounds:  # once a round, another model: the same one, fresh
                rounds = now // (ROUND + LOOSE)
                page.send(messages.encode(messages.Selection(0, models.index(model))))
            try:
                data = page.recv(timeout=5)
            except (TimeoutError, ConnectionClosed) as problem:
                wrong = f"no frame: {problem!r}"
                break
            seen += 1
            gaps.append(time.monotonic() - last)
            last = time.monotonic()
            frame = decoded(data)
            if frame["serial"][0] != serial:  # the first that obeys this command
                serial = frame["serial"][0]
                delays.append(1e3 * (last - began) + 1 - serial)
            wrong = judged(data, frame, now % (ROUND + LOOSE) - ROUND)
            if time.monotonic() - told > TELLS or wrong:
                told = time.monotonic()
                print(json.dumps(state(now, seen, delays, gaps, wrong) | heard(frame)), flush=True)
    print(json.dumps(state(time.monotonic() - began, seen, delays, gaps, wrong) | heard(frame)), flush=True)
    return 1 if wrong else 0


def decoded(data: bytes) -> dict[str, tuple[float, ...]]:
    """A frame's fields by name."""
    values, at, out = struct.unpack_from(LAYOUT, data)[1:], 0, {}
    hints = get_type_hints(messages.Frame, include_extras=True)
    for field in fields(messages.Frame):
        count = int(get_args(hints[field.name])[1][:-1] or 1)
        out[field.name] = values[at : at + count]
        at += count
    return out


def heard(frame: dict[str, tuple[float, ...]]) -> dict[str, float]:
    """Of the loop."""
    return {name: frame[name][0] for name in ("tick", "late", "faults", "energy")}


def judged(data: bytes, frame: dict[str, tuple[float, ...]], loose: float) -> str:
    """What is wrong with a frame; `loose`: seconds since all were to let go."""
    for name, values in frame.items():
        if name not in UNKNOWN and not np.isfinite(values).all():
            return f"{name} is no number: {values}"
    if len(data) != struct.calcsize(LAYOUT) + 6 * frame["count"][0]:
        return "a frame of another length"
    if frame["faults"][0]:
        return f"{frame['faults'][0]} faults"
    if loose > 0.75 * LOOSE and any(frame["contact"]):
        return f"a stuck tool: contacts {frame['contact']}"
    return ""


def scene(address: str) -> tuple[np.ndarray, float, list[str], str]:
    """(n, 3) mm of the surface's nodes, the reach, the models and the one in force."""
    data = httpx.get(address.replace("/?", "/scene?"), timeout=60).content
    size = struct.unpack_from("<I", data)[0]
    header = json.loads(data[4 : 4 + size])
    nodes = np.frombuffer(data, "<f4", 3 * header["nodes"], 4 + size).reshape(-1, 3)
    skin = np.frombuffer(data, "<u4", 3 * header["parts"][0]["count"], 4 + size + nodes.nbytes)
    return nodes[np.unique(skin)], header["reach"], header["models"], header["model"]


def state(seconds: float, seen: int, delays: list[float], gaps: list[float], wrong: str) -> dict[str, object]:
    """What the client has to say."""
    at = lambda values, q: round(float(np.quantile(values, q)), 1) if values else None  # noqa: E731
    return {
        "seconds": round(seconds),
        "frames_per_s": round(seen / max(seconds, 1e-9), 1),
        "command_to_frame_ms": [at(delays, q) for q in (0.5, 0.99)],
        "frame_gap_ms": [at([1e3 * g for g in gaps], q) for q in (0.5, 0.99)],
        "wrong": wrong,
    }


if __name__ == "__main__":
    sys.exit(main())
