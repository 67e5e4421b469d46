"""Model `compliance`: what its factor, its tables, its ticks and a slide at 100 mm/s cost; SuperLU's factor beside it."""

import time
from collections.abc import Callable, Iterator

import numpy as np
from scipy.sparse.linalg import splu

import palpate as pp
from benchmarks import compliance_prefetch
from benchmarks.compliance_prefetch import PUSH
from benchmarks.cube_case import brick
from benchmarks.interleaved_timing import header, row
from palpate import _core
from palpate.arrays import Float64
from palpate.tissue.contact_patches import patch
from palpate.tissue.models.compliance import ComplianceModel

SPEED = 0.1  # mm a tick, 100 mm/s
READ = 210 * 36  # bytes, the blocks of the pairs of twenty nodes
AGAIN = 9  # slides from cold tables, for the median of what their slowest ticks took


def lines() -> Iterator[str]:
    yield "CPU seconds of one thread, least of several; what a slide costs is wall time of a loop at 1 kHz."
    for n in (11, 21, 27):
        yield from _measured(n)
    yield from _broad()


def cube(n: int) -> pp.Tissue:
    """A 50 mm cube of n³ nodes on a regular lattice, held below; six tetrahedra a cell."""
    line = np.linspace(0, 50, n)
    x = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(n**3).reshape(n, n, n)
    corner = [
        number[a : n - 1 + a, b : n - 1 + b, c : n - 1 + c].ravel() for a in (0, 1) for b in (0, 1) for c in (0, 1)
    ]
    around = [(0, 1, 3, 7), (0, 1, 7, 5), (0, 5, 7, 4), (0, 3, 2, 7), (0, 6, 4, 7), (0, 2, 6, 7)]
    tets = np.concatenate([np.stack([corner[k] for k in tet], axis=1) for tet in around])
    edges = x[tets[:, 1:]] - x[tets[:, :1]]
    odd = np.linalg.det(edges) < 0
    tets[odd] = tets[odd][:, [0, 1, 3, 2]]
    return pp.Tissue(pp.TetMesh(x, tets), 5.0, 0.45, x[:, 2] == 0)


def least(work: Callable[[], object], repeats: int = 3) -> float:
    """CPU seconds."""
    taken = []
    for _ in range(repeats):
        began = time.process_time()
        work()
        taken.append(time.process_time() - began)
    return min(taken)


def _measured(n: int) -> Iterator[str]:
    threads = _core.base.threads()
    _core.base.set_threads(1)
    tissue = cube(n)
    model = ComplianceModel(tissue)
    yield f"\n{n}³ nodes, {len(model.vertices)} on the surface\n"
    yield header("what", "ours", "SuperLU, its own order" if n < 25 else "")
    yield from _factors(model, n < 25)
    yield from _tables(model)
    _core.base.set_threads(threads)
    yield from _slide(model)
    yield from compliance_prefetch.lines(model)


def _factors(model: ComplianceModel, peer: bool) -> Iterator[str]:
    K, native = model._stiffness, model.factors.native
    load = np.random.default_rng(0).standard_normal((K.shape[0], 64))
    make = type(model.factors)
    theirs = splu(K.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}) if peer else None
    yield row("numbers in L, millions", native.entries / 1e6, theirs.L.nnz / 1e6 if theirs else "")
    slow = (
        least(lambda: splu(K.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}), 1) if peer else ""
    )
    yield row("factor, s", least(lambda: make(K, model.places), 2), slow)
    one = 1e3 * least(lambda: theirs.solve(load[:, 0])) if theirs else ""
    yield row("one right-hand side, ms", 1e3 * least(lambda: model.factors.solve(load[:, 0])), one)
    yield row("each of 64, ms", 1e3 * least(lambda: model.factors.solve(load)) / 64, "")


def _tables(model: ComplianceModel) -> Iterator[str]:
    x, edge = model.tissue.mesh.nodes[model.vertices], model.tissue.edge
    top = model.tissue.mesh.nodes[:, 2].max()
    near = np.argsort(np.linalg.norm(x - [25.0, 25.0, top], axis=1)).astype(np.int32)
    state = model.start()
    fresh = iter([model.start() for _ in range(3)])  # a state keeps what it made
    blocks = least(lambda: next(fresh).make_near(near[:8].copy(), 4.5 * edge))
    yield row("blocks of 8 nodes, ms", 1e3 * blocks, "")
    columns = least(lambda: state.make_columns(near[:8].copy())) / 8
    yield row("columns, ms a node", 1e3 * columns, "")
    yield row("all columns, s and MB", f"{columns * len(x):.3g}, {36 * len(x) ** 2 / 2**20:.0f}", "")
    under = patch(model.tissue, np.array([25.0, 25.0, top]), 2 * edge)
    model.native.relax(state, under, PUSH, 1)
    ticks = [_wall(lambda: model.native.relax(state, under, PUSH, 1)) for _ in range(2000)]
    yield row(f"tick, {len(under.nodes)} nodes, median µs", 1e6 * float(np.median(ticks)), "")
    yield row(
        "field by a direct solve, ms",
        1e3 * least(lambda: model.native.displayed_displacement(state, model.vertices)),
        "",
    )
    yield row("field from columns, median µs", _from_columns(model, state, under), "")


def _broad() -> Iterator[str]:
    """A slab, held at one end: ten thousand nodes on its surface, and few within."""
    mesh = brick((69, 69, 2), size=(100.0, 100.0, 3.0))
    model = ComplianceModel(pp.Tissue(mesh, 5.0, 0.45, mesh.nodes[:, 0] == 0))
    yield f"\nA slab of {len(mesh.nodes)} nodes, {len(model.vertices)} on the surface\n"
    yield header("what", "ours")
    state = model.start()
    under = patch(model.tissue, np.array([50.0, 50.0, 3.0]), 2 * model.tissue.edge)
    model.native.relax(state, under, PUSH, 1)
    yield row(
        "field by a direct solve, ms", 1e3 * least(lambda: model.native.displayed_displacement(state, model.vertices))
    )
    yield row(f"field from columns of {len(under.nodes)} nodes, median µs", _from_columns(model, state, under))


def _from_columns(
    model: ComplianceModel, state: "_core.tissue.ModelState", under: "_core.tissue.ContactPatch"
) -> float:
    """µs of wall time, median."""
    number = {node: k for k, node in enumerate(model.vertices.tolist())}
    state.make_columns(np.array([number[node] for node in under.nodes.tolist()], dtype=np.int32))
    shows = [_wall(lambda: model.native.displayed_displacement(state, model.vertices)) for _ in range(100)]
    return 1e6 * float(np.median(shows))


def by_hand(points: Float64) -> Float64:
    """The same way as the loop goes it when a pointer says 60 times a second where it is."""
    out, at = np.empty_like(points), points[0]
    for tick in range(len(points)):
        at = at + 0.08 * (points[16 * (tick // 16)] - at)
        out[tick] = at
    return out


def _slide(model: ComplianceModel) -> Iterator[str]:
    """From a cold first touch, which rests until the force is exact, along the top at 100 mm/s; then back, warm.

    "unforeseen": no look ahead between ticks. "the machine": what adding up the same bytes takes from tick to tick, as many
    as a tick of such a patch reads and for about as long, by turns with the slides.
    """
    tissue, radius = model.tissue, 2 * model.tissue.edge
    rest = np.repeat([[10.0, 23.0, 50.0]], 1000, axis=0)
    way = np.array([[10.0 + SPEED * k, 23.0, 50.0] for k in range(300)])
    path, state = np.concatenate([rest, way]), model.start()
    back = path[::-1].copy()
    yield from _cold(model, path)
    slides = ("cold", path, True), ("again", back, True), ("by hand", by_hand(back), True), ("unforeseen", back, False)
    for name, points, foreseen in slides:
        found, answered, force, cold, ahead = _core.benchmark.time_stroke(
            model.native, state, tissue.surface, radius, points, PUSH, 20, 1, foreseen
        )
        size = np.linalg.norm(force, axis=1)
        moved = slice(1001, None) if name == "cold" else slice(21, 299)
        step = 100 * float((np.linalg.norm(np.diff(force, axis=0), axis=1)[moved] / size[:-1][moved].clip(1e-12)).max())
        yield row(f"{name}: cold ticks of {len(cold)}", int(cold.sum()), "")
        yield row(f"{name}: tick p50, p99, µs", _shares(answered), "")
        yield row(f"{name}: the same while it slides", _shares(answered[moved]), "")
        yield row(f"{name}: finding the patch p50, p99, µs", _shares(found), "")
        yield row(f"{name}: looking ahead once it was answered p50, p99, µs", _shares(ahead[moved]), "")
        yield row(f"{name}: greatest step of the force while sliding, %", step, "")
        yield row(
            "the machine at that time: p50, p99, µs", _shares(_core.benchmark.memory_read_jitter(len(points), READ)), ""
        )


def _cold(model: ComplianceModel, path: Float64) -> Iterator[str]:
    """Each of `AGAIN` slides finds no table, and the machine's own unevenness is measured after it."""
    radius, slowest, machine = 2 * model.tissue.edge, [], []
    for _ in range(AGAIN):
        answered = _core.benchmark.time_stroke(
            model.native, model.start(), model.tissue.surface, radius, path, PUSH, 20, 1, True
        )[1]
        slowest.append(1e6 * np.percentile(answered[1001:], 99))
        machine.append(1e6 * np.percentile(_core.benchmark.memory_read_jitter(len(path), READ), 99))
    spread = f"{np.median(slowest):.1f} ({min(slowest):.1f} to {max(slowest):.1f})"
    yield row(f"p99 of a tick's force in {AGAIN} cold slides, median and range, µs", spread, "")
    yield row("the machine beside them, median, µs", f"{np.median(machine):.1f}", "")


def _shares(seconds: np.ndarray) -> str:
    return ", ".join(f"{1e6 * v:.3g}" for v in np.percentile(seconds, [50, 99]))


def _wall(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began
