"""Model `multigrid` at work: a patch that slides at 100 mm/s at 1 kHz with one iteration a tick, and cold pushes.

One thread. Times are CPU time; errors are against a direct solution of the same elements, in the norm of the energy and
by the root mean square of the displacement.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

import palpate as pp
from benchmarks.cube_case import PUSH, TOP, cube
from benchmarks.interleaved_timing import header, row
from benchmarks.settling_time import least
from palpate import _core
from palpate.arrays import Float64
from palpate.samples import sample
from palpate.tissue.contact_patches import patch
from palpate.tissue.models.tissue_model import TissueModel
from palpate.tissue.reference.linear_elasticity import FiniteElements
from palpate.volumes.label_names import with_names

SPEED = 0.1  # mm a tick
TICKS, LANDED = 200, 10  # ticks; how many make up for a tool that comes 5 mm deep at once
JUDGED = (LANDED, 15, 20, 35, 50, 75, 100, 125, 150, 175, 199)
ORGAN_EDGE = 2.36  # mm: the left kidney of the sample in about 20,000 nodes


@dataclass(frozen=True)
class Case:
    """path: (TICKS, 3) mm on the surface. push: (3,) mm."""

    name: str
    tissue: pp.Tissue
    path: Float64
    push: Float64

    @property
    def radius(self) -> float:
        return 2 * self.tissue.edge


def lines() -> Iterator[str]:
    threads = _core.base.threads()
    _core.base.set_threads(1)
    try:
        yield "One thread, CPU time. A patch of two mean edges, 5 mm deep, slides at 100 mm/s; a tick is one iteration."
        yield from _warm()
        yield "\nFrom rest: iterations to 0.1 %, and CPU time to 1 %, root mean square; in brackets in the energy's norm.\n"
        yield from _cold()
    finally:
        _core.base.set_threads(threads)


def _warm() -> Iterator[str]:
    near, far = bandwidth(1 << 22), bandwidth(1 << 26)
    yield f"Memory, one thread: {near / 1e9:.0f} GB/s over 16 MB, {far / 1e9:.0f} GB/s over 256 MB.\n"
    yield header(
        "", "nodes", "tick, ms: least", "median", "p99", f"error from the {LANDED}th tick on, at worst: energy", "rms",
        "force", "moved a tick, MB", "GB/s", "least time by memory, ms: 16 MB", "256 MB",
    )  # fmt: skip
    for case in cases():
        model = pp.model(case.tissue, "multigrid")
        taken, energy, rms, force = slid(case, model)
        moved = model.iteration.moved
        steady = float(np.median(taken[LANDED:]))
        yield row(
            case.name, case.tissue.mesh.nodes.shape[0], 1e3 * float(taken[LANDED:].min()), 1e3 * steady,
            1e3 * float(np.percentile(taken[LANDED:], 99)), *(f"{100 * e:.2g} %" for e in (energy, rms, force)),
            moved / 1e6, moved / 1e9 / float(taken[LANDED:].min()), 1e3 * moved / near, 1e3 * moved / far,
        )  # fmt: skip


def cases() -> Iterator[Case]:
    """A cube of 27³ nodes at two Poisson's ratios, and a kidney."""
    for poisson in (0.3, 0.45):
        tissue = pp.Tissue(cube_mesh := cube(27).tissue.mesh, 10.0, poisson, cube_mesh.nodes[:, 2] == 0)
        path = TOP + np.array([[-10 + SPEED * k, 0.0, 0.0] for k in range(TICKS)])
        yield Case(f"cube, 27³, ν = {poisson:g}", tissue, path, PUSH)
    yield kidney(0.45)


def kidney(poisson: float) -> Case:
    """Lies on the side away from where it is pressed."""
    file = sample("abdomen") / "labels.nii.gz"
    mesh = pp.tetrahedralize(with_names(pp.read_labels(file), file), "kidney_left", ORGAN_EDGE)
    tissue = pp.Tissue(mesh, 5.0, poisson, pp.resting_on(mesh, (0, -1, 0)))
    top = mesh.nodes[np.argmax(mesh.nodes[:, 1])]
    wanted = top + np.array([[0, 0, SPEED * (k - TICKS / 2)] for k in range(TICKS)])
    path = np.array([tissue.surface.closest(at).point for at in wanted])
    return Case(f"kidney, ν = {poisson:g}", tissue, path, np.array([0.0, -5.0, 0.0]))


def slid(case: Case, model: TissueModel) -> tuple[Float64, float, float, float]:
    """CPU s of each tick, and the worst errors of the judged ones: energy, displacement, force."""
    truth = FiniteElements(case.tissue)
    patches = [patch(case.tissue, at, case.radius) for at in case.path]
    taken, worst = np.empty(TICKS), np.zeros(3)
    state = model.start()
    for k, spot in enumerate(patches):
        began = time.process_time()
        force = model.iteration.relax(state, spot, case.push, 1)
        taken[k] = time.process_time() - began
        if k in JUDGED:
            exact = truth.push(case.path[k], case.push, case.radius)
            off = [
                energy(truth, state.u - exact.displacement) / energy(truth, exact.displacement),
                np.linalg.norm(state.u - exact.displacement) / np.linalg.norm(exact.displacement),
                np.linalg.norm(force - exact.force) / np.linalg.norm(exact.force),
            ]
            worst = np.maximum(worst, off)
    return taken, *(float(w) for w in worst)


def energy(truth: FiniteElements, field: Float64) -> float:
    """The root of uᵀKu."""
    u = np.zeros(truth.K.shape[0])
    u[truth.nodal] = field
    return float(np.sqrt(u @ (truth.K @ u)))


def bandwidth(floats: int) -> float:
    """Bytes a second of one thread: the better of reading an array of that size and of copying its one half on the other."""
    a = np.ones(floats, np.float32)
    half = floats // 2
    ways = (lambda _: np.maximum.reduce(a), lambda _: np.copyto(a[:half], a[half:]))
    return a.nbytes / min(least(way, lambda: None) for way in ways)


def _cold() -> Iterator[str]:
    yield header("cube", "ν", "iterations to 0.1 %", "iterations to 1 %", "to 1 %, ms")
    for n in (11, 21, 27):
        for poisson in (0.3, 0.4, 0.45):
            yield _from_rest(n, poisson)


def _from_rest(n: int, poisson: float) -> str:
    base = cube(n)
    tissue = pp.Tissue(base.tissue.mesh, 10.0, poisson, base.tissue.held)
    truth, spot = FiniteElements(tissue), patch(tissue, TOP, base.radius)
    exact = truth.push(TOP, PUSH, base.radius).displacement
    model = pp.model(tissue, "multigrid")
    rms, whole = [], []
    for count in range(1, 11):
        state = model.start()
        model.iteration.relax(state, spot, PUSH, count)
        rms.append(base.off(state.u, exact))
        whole.append(energy(truth, state.u - exact) / energy(truth, exact))
    one, tenth = (_count(rms, share) for share in (1e-2, 1e-3))
    seconds = least(lambda state: model.iteration.relax(state, spot, PUSH, one), model.start)
    return row(f"{n}³", poisson, f"{tenth} ({_count(whole, 1e-3)})", f"{one} ({_count(whole, 1e-2)})", 1e3 * seconds)


def _count(errors: list[float], share: float) -> int:
    return 1 + next(k for k, error in enumerate(errors) if error <= share)
