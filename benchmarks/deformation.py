"""Deformation of a cube next to its peers on one core: `python -m benchmarks deformation` (some minutes).

Every figure is CPU time of one thread, the fastest of several. What a step is differs, so what counts is the time to 1 % of a
program's own equilibrium, and how far that is from finite elements of its own material with the same contact.
"""

import os
import resource
import sys
import time
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
from scipy.sparse.linalg import splu

import palpate as pp
from benchmarks.cube_case import PUSH, TOP, Cube, cube
from benchmarks.interleaved_timing import header, row
from benchmarks.model_ladder import NAMES, SLIDE, Rung, rung
from benchmarks.peer_process import settled
from benchmarks.settling_time import Settled, least
from palpate import _core
from palpate.tissue.contact_patches import patch
from palpate.tissue.reference.linear_elasticity import FiniteElements
from palpate.tissue.reference.solver import finite_strain
from palpate.tissue.sparse_factor import Factors

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from support import calculix

PEERS = ("xpbd", "vertex_block", "flex")
BUDGET = {  # CPU s of each run
    11: {"xpbd": 2.5, "vertex_block": 8.0, "flex": 2.0},
    21: {"xpbd": 15.0, "vertex_block": 30.0, "flex": 15.0},
}
LIMIT = {11: 60, 21: 150}  # CPU s of a peer's process, all its runs and their set-up
ELSEWHERE = (  # measured elsewhere, on such a machine; ms of a step, ms to 1 %, at 11³ and 21³
    ("SOFA, fast corotational, static", "22 / 389", "54 / 783"),
    ("SOFA, corotational, implicit Euler, 25 CG", "5.5 / 42", "1314 / 10556"),
    ("SOFA, home + edge springs, CG", "20 / 213", "64 / 429"),
    ("Vega, corotational, static", "19 / 392", "37 / 767"),
)


def lines(sizes: tuple[int, ...] = (11, 21)) -> Iterator[str]:
    """All tables of each mesh, then the targets; on one core while it runs."""
    allowed, threads = os.sched_getaffinity(0), _core.base.threads()
    os.environ["OMP_NUM_THREADS"] = "1"  # read when peers are first imported
    _core.base.set_threads(1)
    os.sched_setaffinity(0, sorted(allowed)[:1])
    try:
        yield from _tables(sizes)
    finally:
        _core.base.set_threads(threads)
        os.sched_setaffinity(0, allowed)


def _tables(sizes: tuple[int, ...]) -> Iterator[str]:
    yield "One core, CPU time of one thread, the fastest of several. The 50 mm cube, E = 10 kPa, ν = 0.3, held at its bottom;"
    yield "the patch of radius two mean edges in the middle of the top goes 5 mm in. Peers are given the patch's nodes where"
    yield "linear elements move them, ours its weighted mean alone. 1 %: of the nodes' displacement, root mean square, from"
    yield "what it is when nothing moves any more; a `push` stops by its own error instead, whole in Python. *From truth*:"
    yield "that end from P1 elements of the same mesh, contact and material."
    measured: dict[int, dict[str, Rung]] = {}
    cubes = {}
    for n in sizes:
        here = cubes[n] = cube(n)
        yield f"\n### {n}³ nodes, radius {here.radius:.1f} mm on {len(here.touched)} nodes\n"
        best: dict[str, Settled] = {}
        yield header("peer", "settings", "setup, s", "a step, ms", "steps", "to 1 %, ms", "its material", "from truth")
        for name in PEERS:
            yield from _peer(import_module(f"benchmarks.{name}"), here, best)
        yield ""
        measured[n] = {}
        yield from _ours(here, measured[n])
        yield ""
        yield from _ratios(measured[n], best)
        yield ""
        yield from _direct(here)
    yield ""
    yield from _targets(cubes, measured)
    yield "\nMeasured elsewhere, on such a machine, 5 mm, ν = 0.3, another contact; not in this run:\n"
    yield header("peer", "a step, ms, 11³ / 21³", "to 1 %, ms")
    for name, step, whole in ELSEWHERE:
        yield row(name, step, whole)


def _peer(peer: ModuleType, here: Cube, best: dict[str, Settled]) -> Iterator[str]:
    """A row for each choice of its settings; best: keeps the one that is soonest there."""
    if not peer.there():
        yield row(peer.MISSING, *["–"] * 7)
        return
    truth = here.truth if peer.LAW is None else here.settled(peer.LAW)
    name, limit = peer.__name__.split(".")[-1], LIMIT[here.n]
    for got in settled(peer.__name__, here.n, BUDGET[here.n][name], truth if peer.EXACT else None, limit):
        if isinstance(got, str):
            yield row(peer.NAME, "the rest", *["–"] * 3, got, *["–"] * 2)
            return
        seconds = got.seconds
        whole = f"over {1e3 * got.spent:.0f}" if seconds is None else f"{1e3 * seconds:.0f}"
        off = "no truth" if truth is None else f"{100 * here.off(got.end, truth):.1f} %"
        if peer.EXACT:
            off = "stopped at 1 %" if seconds else "did not arrive"
        yield row(peer.NAME, got.settings, got.setup, 1e3 * got.step, got.steps or "–", whole, peer.MATERIAL, off)
        if peer.NAME not in best or (seconds or np.inf) < (best[peer.NAME].seconds or np.inf):
            best[peer.NAME] = got


def _ours(here: Cube, kept: dict[str, Rung]) -> Iterator[str]:
    yield header(
        "ours", "setup, s", "steps to 1 %", "to 1 %, ms", "steps to 0.1 %", "to 0.1 %, ms",
        f"a warm step after {SLIDE:g} mm, ms", "its error", "`push` to 1 %, ms", "from linear truth",
    )  # fmt: skip
    for name in NAMES:
        r = kept[name] = rung(name, here)
        yield row(
            f"`{name}`", r.setup, r.one[0], 1e3 * r.one[1], r.tenth[0], 1e3 * r.tenth[1], 1e3 * r.tick[0],
            f"{100 * r.tick[1]:.2f} %", 1e3 * r.push, f"{100 * here.off(r.end, here.truth):.1f} %",
        )  # fmt: skip
    if "neo-hookean" in kept:
        exact = finite_strain(here.tissue).push(TOP, PUSH, here.radius).displacement
        off = 100 * here.off(kept["neo-hookean"].end, exact)
        yield f"\n`neo-hookean` is {off:.4f} % from P1 elements of its own material, solved by Newton's method."


def _ratios(ours: dict[str, Rung], best: dict[str, Settled]) -> Iterator[str]:
    if not best:
        return
    yield "Each peer's time to 1 % over ours, its best settings; *over*: it was stopped before.\n"
    yield header("", *best)
    for name, r in ours.items():
        yield row(
            f"`{name}`",
            *(f"{'' if got.seconds else 'over '}{(got.seconds or got.spent) / r.one[1]:.0f}" for got in best.values()),
        )


def _direct(here: Cube) -> Iterator[str]:
    """Factored once, then the three columns that a patch's force and field need; and a program that does it all anew."""
    elements = FiniteElements(here.tissue)
    free = elements.free
    K, W = elements.K[free][:, free], elements.loads(here.contact)[free]
    yield header("direct solve", "precomputation, s", "a push at a new place, ms", "from linear truth")

    def fields(solved: np.ndarray) -> str:
        u = np.zeros(elements.K.shape[0])
        u[free] = solved @ np.linalg.solve(W.T @ solved, PUSH)
        return f"{100 * here.off(u[elements.nodal], here.truth):.4f} %"

    began = time.process_time()
    theirs = splu(K.tocsc())
    took = time.process_time() - began
    yield row("SciPy `splu` (SuperLU)", took, 1e3 * least(theirs.solve, lambda: W), fields(theirs.solve(W)))
    began = time.process_time()
    mine = Factors(K, here.tissue.mesh.nodes[~here.tissue.held])
    took = time.process_time() - began
    yield row("our `Factors`", took, 1e3 * least(mine.solve, lambda: W), fields(mine.solve(W)))
    if not calculix.there():
        yield row(calculix.MISSING, *["–"] * 3)
        return
    began = _children()
    theirs = calculix.calculix(here.tissue, "P1", TOP, PUSH, here.radius, False)
    off = f"{100 * here.off(theirs.displacement, here.truth):.4f} %"
    yield row("CalculiX, the whole run", "none", 1e3 * (_children() - began), off)


def _children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _targets(cubes: dict[int, Cube], measured: dict[int, dict[str, Rung]]) -> Iterator[str]:
    yield header("target, one core", "asked", "measured")
    asked = {11: (2.0, 0.35), 21: (10.0, 2.5)}
    for n, here in cubes.items():
        if n not in asked:
            continue
        if "multigrid" in measured[n]:
            yield _verdict(f"`multigrid`, cold, 1 % at {n}³", asked[n][0], 1e3 * measured[n]["multigrid"].one[1], "ms")
        springs = rung("springs", here, law=pp.SpringLaw("uniform", 0.1))
        yield _verdict(f"`springs`, RSC 0.1, cold, 0.1 % at {n}³", asked[n][1], 1e3 * springs.tenth[1], "ms")
        if "neo-hookean" in measured[n] and n == 11:
            yield _verdict(
                f"`neo-hookean`, 5 mm, cold, 1 % at {n}³", 15.0, 1e3 * measured[n]["neo-hookean"].one[1], "ms"
            )
            yield _deep(here)
        yield _verdict(f"`compliance`, a tick at {n}³, tables made", 10.0, 1e6 * _tick(here), "µs")


def _verdict(what: str, asked: float, got: float, unit: str) -> str:
    return row(what, f"≤ {asked:g} {unit}", f"{got:.3g} {unit}, {'met' if got <= asked else '**not met**'}")


def _deep(here: Cube) -> str:
    """15 mm from rest, to an estimated 1 %; no element turned inside out."""
    model = pp.model(here.tissue, "neo-hookean")
    push = 3 * PUSH
    seconds = least(lambda _: model.push(TOP, push, here.radius, tolerance=0.01), lambda: None, 5)
    u = model.push(TOP, push, here.radius, tolerance=0.01).displacement
    x, tets = here.tissue.mesh.nodes + u, here.tissue.mesh.tets
    flattest = (np.linalg.det(x[tets[:, 1:]] - x[tets[:, :1]]) / 6 / here.tissue.mesh.volumes).min()
    met = "met" if 1 / seconds >= 30 and flattest > 0 else "**not met**"
    return row("`neo-hookean`, 15 mm at 11³, cold, 1 %", "≥ 30 solves/s, none inverted",
               f"{1 / seconds:.0f}/s, smallest volume {flattest:.2f} of its own, {met}")  # fmt: skip


def _tick(here: Cube) -> float:
    """CPU s of a tick of the loop's model where its tables are made."""
    model = pp.model(here.tissue, "compliance")
    state, spots = model.start(), [patch(here.tissue, TOP + [x, 0, 0], here.radius) for x in np.arange(0, 1, SLIDE)]

    def slide(_: None) -> None:
        for spot in spots:
            model.native.relax(state, spot, PUSH, 1)

    slide(None)  # makes the tables
    return least(slide, lambda: None) / len(spots)
