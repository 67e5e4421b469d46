"""CPU time to a share of one's own equilibrium: what is moved step by step, ours and the peers', judged alike."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.arrays import Float64


@dataclass(frozen=True)
class Run:
    """A peer with one choice of its settings, at rest but for the contact.

    setup: CPU s. step: moves it on. place: () -> (N, 3) mm, displacement now. rest: what stands for a user's own stop
    and costs nothing here (velocities set to zero, nodes put back), after each step.
    """

    settings: str
    setup: float
    step: Callable[[], object]
    place: Callable[[], Float64]
    rest: Callable[[], object] = lambda: None


@dataclass(frozen=True)
class Settled:
    """Where a run came to.

    settings, setup: the run's. step: CPU s of the fastest step. steps: to 1 % of the equilibrium, for good; None: not
    within `spent` CPU s. end: (N, 3) mm.
    """

    settings: str
    setup: float
    step: float
    steps: int | None
    end: Float64
    spent: float

    @property
    def seconds(self) -> float | None:
        """CPU s to 1 %: its steps, each as fast as the fastest."""
        return None if self.steps is None else self.steps * self.step


def settle(run: Run, budget: float, goal: Float64 | None = None) -> Settled:
    """Runs for `budget` CPU s of its own; the equilibrium is where it then is, if the last half moved it by under 0.5 %.

    goal: its equilibrium (N, 3) mm if that is known; the run ends when within 1 % of it.
    """
    seen: list[Float64] = []
    fastest, spent = np.inf, 0.0
    while spent < budget:
        began = time.process_time()
        run.step()
        took = time.process_time() - began
        fastest, spent = min(fastest, took), spent + took
        run.rest()
        seen.append(run.place().astype(np.float32))
        if not np.isfinite(seen[-1]).all() or (goal is not None and _apart(seen[-1], goal) <= 0.01):
            break
    end = seen[-1].astype(np.float64)
    return Settled(run.settings, run.setup, fastest, _steps(seen, goal), end, spent)


def _steps(seen: list[Float64], goal: Float64 | None) -> int | None:
    if not np.isfinite(seen[-1]).all():
        return None
    apart = np.array([_apart(u, seen[-1] if goal is None else goal) for u in seen])
    if not (apart[-1] <= 0.01 and (goal is not None or apart[len(seen) // 2] < 0.005)):
        return None
    outside = np.flatnonzero(~(apart <= 0.01))
    return int(outside[-1]) + 2 if len(outside) else 1


def _apart(u: Float64, other: Float64) -> float:
    return float(np.linalg.norm(u - other) / np.linalg.norm(other))


def least(work: Callable[[Any], object], fresh: Callable[[], Any], repeats: int = 12) -> float:
    """CPU s of the fastest of several; fresh: makes what each is given, and is not counted."""
    best = np.inf
    for _ in range(repeats):
        given = fresh()
        began = time.process_time()
        work(given)
        best = min(best, time.process_time() - began)
    return float(best)
