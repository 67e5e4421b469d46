"""Random hands for a long time, through the real server, with a client that takes the whole stream; does anything wear?

    python -m benchmarks.soak --minutes 60 --seed 2

Beside the loop, in the same minutes, a thread that does nothing by the same clock: what it is late, the machine is.
"""

import argparse
import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import palpate as pp
from palpate import _core
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import serving
from palpate.studies.deformation.kidney import kidney

MINUTES = 10.0
EDGE = 2.36  # mm: the kidney of the sample in about 20,000 nodes
SETTLING = 10.0  # s before counting begins
STEP = 1e-5  # s, of the loop's tallies
TOLD = 120  # of the looks every 5 s: ten minutes
CHUNK = 5000  # ticks of the empty thread at a time


def lines(minutes: float = MINUTES, model: str = "compliance", seed: int = 1, edge: float = EDGE) -> Iterator[str]:
    """One soak, told as it goes: what was so far, every ten minutes and at the end."""
    tissue = kidney(edge)
    session = pp.Session(pp.model(tissue, model))
    yield f"model {model}, {len(tissue.mesh.nodes)} nodes, {len(session.shown)} shown, seed {seed}, {minutes:g} min"
    with serving(session, loopback_socket(None)) as address:
        told: list[str] = []
        client = subprocess.Popen(
            [
                sys.executable,
                str(Path(__file__).with_name("random_hands.py")),
                address,
                str(60 * minutes + SETTLING),
                str(seed),
            ],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert client.stdout is not None
        threading.Thread(target=lambda: told.extend(client.stdout or []), daemon=True).start()
        time.sleep(SETTLING)
        empty, first, began = Beside(), state(session, told), time.monotonic()
        memory: list[tuple[float, float]] = []
        while client.poll() is None:
            time.sleep(5)
            memory.append((time.monotonic() - began, resident()))
            if len(memory) % TOLD == 0:
                yield from summary(first, state(session, told), empty, memory)
                yield f"client: {told[-1].strip() if told else 'not heard'}"
        last = state(session, told)
        empty.stop()
    yield from summary(first, last, empty, memory)
    record = session.record()
    held = sum(a.nbytes for a in vars(record).values() if isinstance(a, np.ndarray)) / 2**20
    yield f"the record of {len(record.ticks)} commands and {len(record.changes)} changes holds {held:.1f} MB"
    yield f"client (exit {client.returncode}): {told[-1].strip() if told else 'not heard'}"


@dataclass(frozen=True)
class State:
    """Of the loop, since it began: what the client heard, and the loop's own tallies."""

    tick: int
    late: int
    tallies: tuple[np.ndarray, ...]


def state(session: pp.Session, told: list[str]) -> State:
    """Now. Frames are the server's to read, one thread alone; tallies are anyone's."""
    heard = json.loads(told[-1]) if told else {"tick": 0, "late": 0}
    return State(int(heard["tick"]), int(heard["late"]), session.loop.tallies())


def summary(first: State, last: State, empty: "Beside", memory: list[tuple[float, float]]) -> Iterator[str]:
    """From one state to another."""
    seconds, done, heard = memory[-1][0], int((last.tallies[0] - first.tallies[0]).sum()), last.tick - first.tick
    yield f"\nafter {seconds / 60:.1f} min: {done} ticks, {done / seconds:.1f} a second"
    for name, a, b in zip(
        ("a tick's work", "its processor time", "woken late by"), first.tallies, last.tallies, strict=True
    ):
        yield f"{name}: {quantiles(b - a)}"
    yield f"an empty thread woken late by: {quantiles(empty.count)}"
    share, other = (last.late - first.late) / max(1, heard), empty.late / max(1, int(empty.count.sum()))
    yield f"late ticks: {share:.3%}; of the empty thread {other:.3%}; beyond it {share - other:+.3%}"
    yield flatness(memory)


class Beside:
    """Counts how late an empty thread wakes, until it is stopped."""

    def __init__(self) -> None:
        self.count, self.late, self._ended = np.zeros(1001, dtype=np.int64), 0, False
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._ended:
            woken, late = _core.benchmark.timer_jitter(CHUNK)
            self.late += late
            self.count += np.bincount(np.minimum(woken / STEP, 1000).astype(np.int64), minlength=1001)

    def stop(self) -> None:
        """Waits for the last chunk."""
        self._ended = True
        self._thread.join()


def quantiles(count: np.ndarray) -> str:
    """Of a tally, in ms, to its step."""
    share = np.cumsum(count) / max(1, count.sum())
    at: Callable[[float], str] = lambda q: (  # noqa: E731
        f"{1e3 * STEP * (k + 1):.2f}" if (k := int(np.searchsorted(share, q))) < 1000 else "over 10"
    )
    return f"p50 {at(0.5)}, p99 {at(0.99)}, p99.9 {at(0.999)}, p99.99 {at(0.9999)} ms"


def resident() -> float:
    """MB of this process."""
    words = Path("/proc/self/status").read_text().split()
    return int(words[words.index("VmRSS:") + 1]) / 1024


def flatness(memory: list[tuple[float, float]]) -> str:
    """Growth after the first fifth."""
    time_, used = np.array(memory[len(memory) // 5 :]).T
    slope = float(np.polyfit(time_, used, 1)[0]) * 3600 if len(used) > 2 else float("nan")
    return (
        f"memory: {used[0]:.0f} MB at {time_[0]:.0f} s, {used[-1]:.0f} MB at {time_[-1]:.0f} s, "
        f"most {used.max():.0f}; {slope:+.1f} MB an hour"
    )


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.soak", description=__doc__.split("\n")[0])
    parser.add_argument("--minutes", type=float, default=MINUTES)
    parser.add_argument("--model", default="compliance")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--edge", type=float, default=EDGE, help="mm, of the kidney's elements")
    for line in lines(**vars(parser.parse_args())):
        print(line, flush=True)


if __name__ == "__main__":
    main()
