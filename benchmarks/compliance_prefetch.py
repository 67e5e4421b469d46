"""How fast a hand may go until the tables of `compliance`, which a thread makes ahead of it, come late."""

from collections.abc import Iterator

import numpy as np

from benchmarks.interleaved_timing import row
from palpate import _core
from palpate.arrays import Float64
from palpate.tissue.models.compliance import ComplianceModel

SPEEDS = (50, 100, 200, 400, 800)  # mm/s
REST = 100  # ticks that a hand stays where it landed once the tables there are made
TIMES = 3  # slides at each speed, every one over tissue that has no tables
PUSH = np.array([0.3, 0.0, -2.0])


def spiral(edge: float, step: float) -> Float64:
    """Points on the cube's top, `step` mm apart, on a spiral from its middle whose turns are two edges apart."""
    turns = np.linspace(0, 60, 60_001)
    x = (edge / np.pi * turns)[:, None] * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    way = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(x, axis=0), axis=1))])
    at = np.arange(0, way[np.argmin(np.abs(x).max(axis=1) < 20)], step)
    return np.stack(
        [25 + np.interp(at, way, x[:, 0]), 25 + np.interp(at, way, x[:, 1]), np.full(len(at), 50.0)], axis=1
    )


def lines(model: ComplianceModel) -> Iterator[str]:
    edge = model.tissue.edge
    landed, exact = _landing(model)
    yield row("first touch to tables, to 0.1 % of the force, ms", f"{landed}, {exact}", "")
    late: list[int] = []
    for speed in SPEEDS:
        way = spiral(edge, speed / 1000)
        path = np.concatenate([np.repeat(way[:1], landed + REST, axis=0), way])
        cold, steps = zip(*(_slide(model, path, landed + REST) for _ in range(TIMES)), strict=True)
        late.append(max(cold))
        name = (
            f"{speed} mm/s over new tissue: late ticks of {len(way)} in {TIMES} slides; greatest step of the force, %"
        )
        yield row(name, f"{', '.join(map(str, cold))}; {max(steps):.2g}", "")
    kept = SPEEDS[: next((k for k, ticks in enumerate(late) if ticks), len(late))]
    yield row("tables keep ahead up to, mm/s", kept[-1] if kept else f"less than {SPEEDS[0]}", "")


def _landing(model: ComplianceModel) -> tuple[int, int]:
    """Ticks from the first touch until the tables are there, and until the force is within 0.1 % of what it becomes."""
    rest = np.repeat(spiral(model.tissue.edge, 1.0)[:1], 600, axis=0)
    _, _, force, cold, _ = _core.benchmark.time_stroke(
        model.native, model.start(), model.tissue.surface, 2 * model.tissue.edge, rest, PUSH, 1, 1, True
    )
    off = np.linalg.norm(force - force[-1], axis=1) > 1e-3 * np.linalg.norm(force[-1])
    return int(np.flatnonzero(cold)[-1]) + 1, int(np.flatnonzero(off)[-1]) + 1


def _slide(model: ComplianceModel, path: Float64, first: int) -> tuple[int, float]:
    """Ticks without tables from tick `first` on, and the greatest change of the force from one of them to the next, %."""
    _, _, force, cold, _ = _core.benchmark.time_stroke(
        model.native, model.start(), model.tissue.surface, 2 * model.tissue.edge, path, PUSH, 1, 1, True
    )
    size = np.linalg.norm(force[first:], axis=1)
    return int(cold[first:].sum()), 100 * float(
        (np.linalg.norm(np.diff(force[first:], axis=0), axis=1) / size[:-1]).max()
    )
