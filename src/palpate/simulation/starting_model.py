"""Selects the model that a session begins with: the most exact one that keeps the rate, by a short trial on this machine."""

import time
from dataclasses import dataclass

import numpy as np

from palpate.arrays import Float64
from palpate.errors import DataError, MaterialError
from palpate.simulation.pointer import Command
from palpate.simulation.scripted_device import ScriptedDevice
from palpate.simulation.session import RATE, Session
from palpate.tissue.body_gaps import may_meet
from palpate.tissue.error_bound import MOST_NODES
from palpate.tissue.models.registry import STAND_IN, model
from palpate.tissue.models.tissue_model import TissueModel
from palpate.tissue.spring_fitting import scattered_points, surface_normals
from palpate.tissue.tissue import Tissue

CANDIDATES = {  # the most exact first; neo-hookean is for large strain, and has to be asked for
    "compliance": "linear finite elements, solved directly",
    "multigrid": "linear finite elements, solved by an iteration a tick",
    "blocks": "linear finite elements, relaxed by sweeps",
    "springs": "springs, an approximation of linear finite elements",
}
QUICK = 4000  # nodes that may move: to factor smoothed elements of more takes over a second
TRIAL = 0.3  # s
GLANCE = 0.1  # s, after which a model whose ticks take a fraction of their time needs no longer trial
FRACTION = 0.25
HAND = 16  # ticks between two commands
SPEED = 0.05  # mm a tick
STEP = 1e-5  # s, of the loop's tallies
SHARE = 0.99  # of the ticks must end in time


@dataclass(frozen=True)
class StartingModel:
    """The model, why it was selected, and the name of the one that follows once it is made; "" if none does."""

    model: TissueModel
    reason: str
    successor: str = ""


def starting_model(tissue: Tissue, radius: float | None = None) -> StartingModel:
    """The first of `CANDIDATES` that keeps the rate on this machine, else the quickest of them.

    A model with a factorisation is left out beyond `MOST_NODES` nodes, since to make it takes too long. radius: mm, of the
    contact. Beyond `QUICK` nodes `compliance` follows once it is made: until then, and in the trial, P1 elements stand in,
    whose ticks take as long. Raises `MaterialError` if no model can be made.
    """
    moving = int(np.count_nonzero(~tissue.held))
    slow: list[tuple[float, str, TissueModel]] = []
    notes: list[str] = []
    for name, meaning in CANDIDATES.items():
        if name == "compliance" and moving > MOST_NODES:
            notes.append(f"{name} takes too long to make for more than {MOST_NODES} nodes")
            continue
        waits = name == "compliance" and tissue.element == "smoothed" and moving > QUICK
        try:
            one = model(tissue, STAND_IN if waits else name)
        except (MaterialError, DataError) as problem:
            notes.append(f"{name}: {problem}")
            continue
        if tissue.time_dependent and not one.time_dependent:
            notes.append(f"{name} does not follow the tissue's relaxation or inertia")
            continue
        if not one.attaches and may_meet(tissue):
            notes.append(f"{name} lets organs, and lips of cuts, go through each other")
        ms = 1e3 * tick_seconds(one, radius)
        if ms <= 1e3 / RATE:
            first = f"{name} ({meaning}): {SHARE:.0%} of its ticks take at most {ms:.2g} ms here, in time for {RATE} a second"
            if waits:
                notes.append(f"until it is made, {STAND_IN} stands in, whose forces are too large")
            return StartingModel(one, "; ".join([first, *notes]), name if waits else "")
        slow.append((ms, name, one))
        notes.append(f"{name} needs {'over 10' if np.isinf(ms) else f'{ms:.2g}'} ms")
    if not slow:
        raise MaterialError(f"no model can be made of this tissue: {'; '.join(notes)}")
    _, name, one = min(slow, key=lambda each: each[0])
    first = f"{name} ({CANDIDATES[name]}), the quickest: none keeps {RATE} ticks a second here, a coarser mesh can"
    return StartingModel(one, "; ".join([f"{first} (palpate mesh --edge)", *notes]))


def tick_seconds(one: TissueModel, radius: float | None = None) -> float:
    """Seconds in which `SHARE` of the ticks end while a finger strokes by the clock; infinite beyond 10 ms."""
    session = Session(one, radius=radius)
    ticks = list(range(0, int(TRIAL * RATE), HAND))
    device = ScriptedDevice(ticks, stroke(one.tissue, session.settings.radius, ticks))
    with session:
        session.start(device)
        time.sleep(GLANCE)
        seconds = _slowest(session)
        if seconds > FRACTION / RATE:
            time.sleep(TRIAL - GLANCE)
            seconds = _slowest(session)
    return seconds


def _slowest(session: Session) -> float:
    """Seconds in which `SHARE` of the ticks so far have ended."""
    counts = session.loop.tallies()[0]
    last = int(np.searchsorted(np.cumsum(counts), SHARE * counts.sum()))
    return STEP * (last + 1) if last < len(counts) - 1 else np.inf


def stroke(tissue: Tissue, radius: float, ticks: list[int]) -> list[Command]:
    """Commands at these ticks of a finger that presses by half an edge and strokes over two radii, to and fro."""
    start = scattered_points(tissue, 1)
    normal = surface_normals(tissue, start)[0]
    along = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    press = -tissue.edge / 2 * normal
    moved = [abs((SPEED * t + radius) % (4 * radius) - 2 * radius) - radius for t in ticks]
    return [Command(True, _on_surface(tissue, start[0] + s * along), tuple(press.tolist())) for s in moved]


def _on_surface(tissue: Tissue, point: Float64) -> tuple[float, float, float]:
    x, y, z = tissue.surface.closest(np.ascontiguousarray(point)).point
    return float(x), float(y), float(z)
