"""Times of several works, taken in turn, so that what else the machine does falls on all of them alike."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Time:
    """Medians in seconds: wall, and CPU of all threads."""

    wall: float
    cpu: float


def medians(works: dict[str, Callable[[], object]], repeats: int = 5, warm: bool = True) -> dict[str, Time]:
    """Median times of each work; `warm` runs each once before."""
    taken: dict[str, list[tuple[float, float]]] = {name: [] for name in works}
    if warm:
        for work in works.values():
            work()
    for _ in range(repeats):
        for name, work in works.items():
            wall, cpu = time.perf_counter(), time.process_time()
            work()
            taken[name].append((time.perf_counter() - wall, time.process_time() - cpu))
    return {name: Time(*np.median(times, axis=0).tolist()) for name, times in taken.items()}


def row(*cells: object) -> str:
    """One line of a table."""
    return "| " + " | ".join(f"{c:.3g}" if isinstance(c, float) else str(c) for c in cells) + " |"


def header(*cells: str) -> str:
    """The first two lines of a table."""
    return row(*cells) + "\n" + "|" + " --- |" * len(cells)
