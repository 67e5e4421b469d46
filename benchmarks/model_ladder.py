"""Our own models on the cube: CPU time to a share of their own equilibrium, cold and warm, and their way from truth."""

import time
from dataclasses import dataclass

import numpy as np

import palpate as pp
from benchmarks.cube_case import PUSH, TOP, Cube
from benchmarks.settling_time import least
from palpate import _core
from palpate.arrays import Float64
from palpate.tissue.contact_patches import patch
from palpate.tissue.models.registry import names
from palpate.tissue.models.tissue_model import TissueModel

NAMES = tuple(name for name in names() if name != "compliance")  # all that come step by step
SLIDE = 0.1  # mm: a tick at 100 mm/s
MOST = 4096


@dataclass(frozen=True)
class Rung:
    """One of our models.

    setup: CPU s. one, tenth: (steps, CPU s) to 1 and 0.1 % of the equilibrium from rest. tick: CPU s of one warm step
    after the patch has slid, and its error. push: CPU s of a whole `push` from rest until its own error says 1 %, Python
    included. end: (N, 3) mm, the equilibrium.
    """

    name: str
    setup: float
    one: tuple[int, float]
    tenth: tuple[int, float]
    tick: tuple[float, float]
    push: float
    end: Float64


def rung(name: str, cube: Cube, **options: object) -> Rung:
    """Measures one model; a step is what its `advance` counts."""
    began = time.process_time()
    if name == "neo-hookean":
        options["interval"] = 0  # its steps are what is timed, not ticks beside a thread that takes them
    model = pp.model(cube.tissue, name, **options)
    setup = time.process_time() - began
    here = patch(cube.tissue, TOP, cube.radius)
    end = equilibrium(model, here)
    counts = [_steps(model, here, end, cube, share) for share in (1e-2, 1e-3)]
    times = [least(lambda state, k=k: model.native.relax(state, here, PUSH, k), model.start) for k in counts]
    model.push(TOP, PUSH, cube.radius, tolerance=0.01)  # proves its eigenvalue once
    push = least(lambda _: model.push(TOP, PUSH, cube.radius, tolerance=0.01), lambda: None, 5)
    one, tenth = zip(counts, times, strict=True)
    return Rung(name, setup, one, tenth, _tick(model, here, end, cube), push, end)


def equilibrium(model: TissueModel, spot: "_core.tissue.ContactPatch") -> Float64:
    """(N, 3) mm: steps until twice as many change nothing."""
    state, k = model.start(), 8
    before = np.zeros_like(state.u)
    while k <= MOST:
        model.native.relax(state, spot, PUSH, k)
        if np.linalg.norm(state.u - before) < 1e-8 * np.linalg.norm(state.u):
            break
        before, k = state.u.copy(), 2 * k
    return np.array(state.u)


def _steps(model: TissueModel, spot: "_core.tissue.ContactPatch", end: Float64, cube: Cube, share: float) -> int:
    """The least number of steps at once, from rest, that come that near: by doubling, then halving."""

    def arrives(k: int) -> bool:
        state = model.start()
        model.native.relax(state, spot, PUSH, k)
        return cube.off(state.u, end) <= share

    high = 1
    while not arrives(high) and high < MOST:
        high *= 2
    low = high // 2
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if arrives(middle) else (middle, high)
    return high


def _tick(model: TissueModel, here: "_core.tissue.ContactPatch", end: Float64, cube: Cube) -> tuple[float, float]:
    """One step after the patch has slid from where the tissue was in balance."""
    there = patch(cube.tissue, TOP + [SLIDE, 0, 0], cube.radius)
    state = model.start()
    model.native.relax(state, here, PUSH, 1)

    def balanced() -> "_core.tissue.ModelState":
        model.native.relax(state, here, PUSH, 1)
        state.u[:] = end
        return state

    seconds = least(lambda s: model.native.relax(s, there, PUSH, 1), balanced)
    after = state.u.copy()
    return seconds, cube.off(after, equilibrium(model, there))
