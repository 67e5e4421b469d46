"""Random calls of every entry of palpate._core: each returns or raises; none crashes, hangs or takes all memory.

    python tests/fuzz/core_calls.py 10000 --seed 1

The stubs say which entries there are and what they take. A call starts from arguments that are right or nearly so; then
some of them are damaged: other shapes and types, empty, NaN, infinite and huge values, numbers out of range, objects of
another mesh. Calls are made in worker processes, many in each, since what a bad one leaves behind may crash a later one. The
run ends with 1 if a call crashed, took more than 30 s, or let out an error that is none of Python's own. The process of a
call is made again with --first at its batch, the same seed and count.
"""

import argparse
import ast
import os
import select
import subprocess
import sys
import warnings
from collections import Counter
from pathlib import Path

import numpy as np

SECONDS = 30
BATCH = 250  # calls in a process
MEMORY = 8 * 1024**3
STRIDE = 104_729  # prime: through all entries, in no order
INTEGERS = [-(2**63), -(2**31), -7, -1, 0, 1, 2, 3, 5, 17, 255, 256, 2**31 - 1, 2**40, 2**63 - 1, 2**70]
NUMBERS = [np.nan, np.inf, -np.inf, 0.0, -0.0, -1.0, 1e-300, 1e-9, 0.5, 1.0, 2.0, 7.3, 1e9, 1e300]
WORDS = ["", "uniform", "linear", "x", "#0", "#-1", "#99999999999999", "é" * 100, "[" * 9999, '{"a": [1, {"b": "c"}]}']
TYPES = [np.float32, np.float64, np.int32, np.int64, np.uint8, bool, complex, object]
RAISED = (ValueError, TypeError, IndexError, MemoryError, OverflowError, RuntimeError, AttributeError, OSError)
# These load a maker's library or look for one on the network, and these take the time that is asked of them.
SKIPPED = {"haptics.Driver.open", "haptics.Driver.start", "haptics.Driver.stop", "haptics.Driver.limits"}
SKIPPED |= {"benchmark.timer_jitter", "benchmark.memory_read_jitter"}
GRID, PANEL = (3, 8, 9), (10, 12)  # of the scans
# Numbers that are right, by the name of the argument, where 1 is not.
USUAL = {
    "radius": 9.0, "sweeps": 2, "iterations": 2, "steps": 2, "rate": 1000, "ticks": 3, "bytes": 1000, "rows": PANEL[0],
    "columns": PANEL[1], "neighbours": 26, "exponent": 1.3, "edge": 0.01, "cell": 8.0, "relaxation": 1.2, "budget": 1 << 20,
    "noise": 0, "kind": 1, "tool": 0, "view": 0, "seconds": 0.01, "delay": 0, "port": 1, "n": 2, "tolerance": 1e-2,
}  # fmt: skip
VOLUMES = {"f", "previous", "u", "data", "values"}  # arguments with one number a voxel; others have one a pixel


def entries():
    """Name and (argument, annotation) of each entry of the core, from its stubs."""
    import palpate

    found = []
    for path in sorted((Path(palpate.__file__).parent / "_core").glob("[!_]*.pyi")):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.FunctionDef):
                found.append((f"{path.stem}.{node.name}", taken(node)))
            elif isinstance(node, ast.ClassDef):
                for each in node.body:
                    if isinstance(each, ast.FunctionDef):
                        setter = any(isinstance(d, ast.Attribute) for d in each.decorator_list)
                        name = f"{path.stem}.{node.name}.{each.name}{'=' if setter else ''}"
                        found.append((name, taken(each)[1:]))
    return [(name, arguments) for name, arguments in found if name not in SKIPPED]


def weighted():
    """Each entry, more often the more it takes."""
    return [each for each in entries() for _ in range(1 + 2 * len(each[1]))]


def taken(node):
    every = node.args.posonlyargs + node.args.args
    return [(each.arg, ast.unparse(each.annotation) if each.annotation else "") for each in every]


class World:
    """Objects of every type, of two meshes and two scans, and right arguments made of them."""

    def __init__(self):
        sys.path.insert(0, str(Path(__file__).parents[1]))
        from support.example_organs import organ

        import palpate as pp
        from palpate import _core
        from palpate.tissue.models.registry import names

        self.there, self.partner, self.mesh_of = {}, {}, {}
        grid = pp.Grid(GRID, (2, 1, 1), (-4, -3.5, 20))
        panel = pp.Panel(PANEL, (1, 1), (-5.5, -4.5, 0))
        flat = pp.arc_views(panel, [-9, 0, 9], radius=500, pivot=(0, 0, 24))
        c, s = np.cos(0.1), np.sin(0.1)
        oblique = pp.Panel(PANEL, (1, 1), (-6, -5, 0), (0, c, s), (c, -s * s, c * s))
        for views in (flat, pp.Views(flat.source, [oblique] * 3)):
            geometry = pp.Projector(views, grid).geometry
            self.keep(geometry, _core.icd.SurrogateImages(geometry))
        table = np.ones((2, 2 * _core.statistics.TABLE_STEPS * _core.statistics.TABLE_OCTAVES + 1), np.float32)
        self.table = table
        self.keep(*(_core.statistics.PriorKernel(k, 1.3, n, table) for k in range(6) for n in (6, 26)))
        device = _core.simulation.Pointer()
        self.keep(device)
        self.tissues = [organ(5), organ(6)]
        for mesh, tissue in enumerate(self.tissues):
            surface, settings = tissue.surface, _core.simulation.SimulationSettings()
            settings.radius, settings.sweeps = 9.0, 2
            points = [surface.closest(np.array(at, float)) for at in ((0, 0, 25), (40, 0, 0), (5, 3, 25))]
            patches = [patch for patch in (surface.patch(point, 9.0) for point in points) if not isinstance(patch, str)]
            self.keep(surface, settings, *points, *patches, mesh=mesh)
            shown = np.unique(tissue.mesh.surface).astype(np.int32)
            beside = ("multigrid", {"interval": 4})
            for name, options in (*((one, {}) for one in names()), beside):
                whole = pp.model(tissue, name, **options)
                model = whole.native
                loop = _core.simulation.RealtimeLoop(model, surface, shown, settings)
                loop.step(device, 1)
                state = model.make_state()
                self.partner[id(model)] = state
                self.keep(model, state, loop, loop.frame(), mesh=mesh)
                if name == "neo-hookean":
                    inner, three = whole.equilibrium, np.zeros(3)
                    state = inner.make_state()
                    self.partner[id(inner)] = state
                    solver = _core.hyperelastic.EquilibriumSolver(inner)
                    self.keep(inner, state, inner.elements, solver, mesh=mesh)
                    self.keep(_core.hyperelastic.LocalForce(1.0, three, three, np.eye(3)))
            self.keep(_core.linalg.SparseCholesky(*line_matrix(len(tissue.mesh.nodes))), mesh=mesh)
        factor = _core.cutting.JumpFactor(40)
        factor.append(4 * np.eye(9), 1.0, 0.0)
        self.keep(factor)
        servo = _core.haptics.Servo(_core.haptics.ServoSettings())
        self.keep(servo, _core.haptics.ServoSettings(), servo.status(), servo.pose(), _core.haptics.ServoDevice(servo))
        self.keep(
            _core.haptics.VirtualWall(servo, 1.0, (0, 0, 0), (0, 0, 1)), _core.haptics.haply("127.0.0.1", 1, 1000)
        )

    def keep(self, *things, mesh=None):
        for thing in things:
            self.mesh_of[id(thing)] = mesh
            for kind in type(thing).__mro__[:-1]:
                self.there.setdefault(kind.__name__, []).append(thing)

    def pick(self, kind, mesh, rng):
        some = self.there.get(kind, [])
        same = [thing for thing in some if self.mesh_of[id(thing)] in (None, mesh)]
        return rng.choice(np.array([*(same or some), None], object)[:-1]) if some else None

    def arguments(self, name, wanted, rng):
        """self, if there is one, and right arguments."""
        mesh = int(rng.integers(2))
        self.tissue, module, *rest = self.tissues[mesh], *name.split(".")
        owner = None
        if len(rest) == 2 and rest[1] != "__init__":
            owner = self.pick(rest[0], mesh, rng)
            mesh = self.mesh_of.get(id(owner), mesh) or 0
            self.tissue = self.tissues[mesh]
        self.model, self.contacts = owner, 1
        values = []
        for argument, annotation in wanted:
            values.append(self.right(module, rest, argument, annotation, mesh, rng))
        return owner, values

    def right(self, module, rest, argument, annotation, mesh, rng):
        tissue = self.tissue
        nodes, tets = len(tissue.mesh.nodes), len(tissue.mesh.tets)
        if argument in ("table",):
            return self.table
        if argument == "state":
            return self.partner.get(id(self.model)) or self.pick("ModelState", mesh, rng)
        if "ContactPatch" in annotation and ("list" in annotation or "Sequence" in annotation):
            self.contacts = int(rng.integers(0, 4))
            return [self.pick("ContactPatch", mesh, rng) for _ in range(self.contacts)]
        if argument == "solve":
            return lambda *given: None
        if annotation in ("int", "float", "bool", "str"):
            usual = USUAL.get(argument, 1)
            return {"int": int, "float": float, "bool": bool, "str": lambda _: rng.choice(WORDS[:4])}[annotation](usual)
        if "NDArray" in annotation or annotation == "object":
            return self.array(module, rest, argument, annotation, nodes, tets, rng)
        if "Sequence" in annotation or "tuple" in annotation:
            if "str" in annotation:
                return ["a", "#1"]
            count = (
                2 if argument == "w" else 9 if argument in ("stiffness", "rotation") or "rotation" in rest[-1] else 3
            )
            return [float(v) for v in rng.normal(size=count)]
        kind = annotation.split(" | ")[0].split(".")[-1]
        if kind in ("TissueModel",):
            self.model = self.pick(kind, mesh, rng)
            return self.model
        return self.pick(kind, mesh, rng)

    def array(self, module, rest, argument, annotation, nodes, tets, rng):
        tissue = self.tissue
        kind = next((t for t in TYPES if f"numpy.{np.dtype(t).name}]" in annotation), np.float64)
        rank = annotation.count("None") if "shape=(" in annotation else 2
        start, column, block, places = line_matrix(nodes)
        special = {
            "start": start, "block": block, "places": places, "tets": tissue.mesh.tets.astype(np.int32),
            "triangles": tissue.mesh.surface.astype(np.int32), "position": tissue.mesh.nodes, "shape": np.array(GRID, float),
            "spacing": np.array([2.0, 1, 1]), "grid_origin": np.array([-4.0, -3.5, 20]),
            "source": np.array([[0, 0, 400.0]] * 3),
            "origin": np.array([[-5.5, -4.5, 0]] * 3), "row_axis": np.array([[0, 1.0, 0]] * 3),
            "column_axis": np.array([[1.0, 0, 0]] * 3), "pitch": np.ones((3, 2)), "first": np.array([0, 1, 2]),
            "taps": np.full((3, 2, 3), 0.2, np.float32),
            "attenuation": np.full(2, 0.02), "ranges": np.array([[0, 9, 0, 11]] * 2), "solid": rng.normal(size=(2, 12)),
            "rays": np.array([[0, 0, 400.0], [-5, -4, 0], [0, 1, 0], [1, 0, 0]]), "out": np.zeros(PANEL),
            "held": (np.arange(nodes) % 5 == 0).astype(np.uint8), "points": np.array([[0, 0, 25.0]] * 3),
            "point": np.array([0, 0, 25.0]), "moving": np.arange(nodes, dtype=np.int32),
        }  # fmt: skip
        if module == "relaxation" and argument in ("shape", "load"):
            return rng.normal(size=(3 * nodes, 12))
        if module == "relaxation" and argument == "stiffness":
            return np.ones(len(column))
        if argument == "column":
            return column
        if module == "phantom" and argument == "kind":
            return np.array([0, 1])
        if argument == "nodes" and rank == 2:
            return tissue.mesh.nodes.copy()
        if argument == "displacement":
            one = rest[-1] in ("relax", "time_stroke")
            return (
                list(rng.normal(size=3))
                if rest[-1] == "time_stroke"
                else rng.normal(size=3 if one else (self.contacts, 3))
            )
        if module == "volume" and argument != "values" and argument != "out":
            return rng.integers(0, 3, 4).astype(kind)
        if module == "volume" and argument == "out":
            return np.zeros((4, 4, 4), np.float32)
        if (
            argument in ("points", "displacements", "kinds", "tools", "ticks", "switches", "lacking")
            and rest[0] == "Replay"
        ):
            return rng.integers(0, 3, (4, 3) if rank == 2 else 4).astype(kind)
        if argument in special and special[argument].dtype == kind:
            return special[argument].copy()
        if argument == "support":
            return rng.integers(0, 2, GRID).astype(kind)
        if argument == "load":
            return rng.normal(size=(9, 2))
        if argument in ("nodes", "wanted", "vertices", "shown", "free"):
            count = nodes if argument == "free" else 3
            return rng.permutation(nodes)[:count].astype(kind)
        if argument in ("lam", "mu", "lambda_"):
            return np.ones(tets)
        if rank == 3 and kind == np.float32:
            if rest[-1] == "data_curvatures":
                return rng.random((3, *PANEL), np.float32)
            return rng.random(GRID if argument in VOLUMES and module != "relaxation" else (3, *PANEL), np.float32)
        if rank == 2 and argument in ("u", "v"):
            return rng.normal(size=(nodes, 3)) * 0.01
        if rank == 2 and argument == "x":
            return rng.normal(size=(3 * nodes, 2))
        size = {0: (3,), 1: (int(rng.integers(4)),), 2: (int(rng.integers(4)), 3), 3: (2, 3, 4)}[rank]
        values = rng.integers(0, 4, size) if np.dtype(kind).kind in "iu" else rng.normal(size=size)
        return values.astype(kind)


def line_matrix(nodes):
    """Positive definite 3x3 blocks along a line: start, column, block, places."""
    start, column, block = [0], [], []
    for i in range(nodes):
        near = range(max(0, i - 1), min(nodes, i + 2))
        column += near
        block += [np.eye(3) * (4.0 if i == j else -1.0) for j in near]
        start.append(len(column))
    places = np.zeros((nodes, 3))
    places[:, 0] = np.arange(nodes)
    return np.array(start, np.int32), np.array(column, np.int32), np.array(block), places


def damaged(value, world, rng):
    """Something else in its place."""
    if rng.random() < 0.05:
        others = [None, 3, -1.5, "x", [], np.zeros(0), *(kinds[0] for kinds in world.there.values())]
        return others[rng.integers(len(others))]
    if isinstance(value, np.ndarray):
        return damaged_array(value, rng)
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return INTEGERS[rng.integers(len(INTEGERS))]
    if isinstance(value, float):
        return NUMBERS[rng.integers(len(NUMBERS))]
    if isinstance(value, str):
        return WORDS[rng.integers(len(WORDS))]
    if isinstance(value, list):
        if not value or rng.random() < 0.3:
            return value * int(rng.integers(0, 9))
        value = list(value)
        at = rng.integers(len(value))
        value[at] = damaged(value[at], world, rng)
        return value
    kind = type(value).__name__
    return world.pick(kind if rng.random() < 0.5 else type(value).__mro__[-2].__name__, int(rng.integers(2)), rng)


def damaged_array(value, rng):
    value = value.copy()
    way = rng.integers(9)
    if way == 0 and value.ndim:  # fewer or more along an axis
        axis, count = rng.integers(value.ndim), rng.integers(4)
        return np.ascontiguousarray(np.resize(value, [count if k == axis else n for k, n in enumerate(value.shape)]))
    if way == 1:
        return np.ascontiguousarray(value.T)
    if way == 2:
        return value.astype(TYPES[rng.integers(len(TYPES))])
    if way == 3:
        return value[..., ::2]
    if way == 4:
        return np.resize(value, rng.integers(0, 5, rng.integers(0, 5))).astype(value.dtype)
    if way == 5:
        value.flags.writeable = False
        return value
    if value.dtype.kind == "b" or value.size == 0:
        return value
    whole = np.iinfo(value.dtype) if value.dtype.kind in "iu" else None
    some = [whole.min, whole.max, 0, 1, len(value), len(value) - 1, 7, 3] if whole else NUMBERS
    count = 1 if rng.random() < 0.6 else value.size
    with np.errstate(over="ignore"):
        for at in rng.integers(value.size, size=count):
            value.flat[at] = np.clip(some[rng.integers(len(some))], whole.min, whole.max) if whole else rng.choice(some)
    return value


def call(world, name, wanted, rng):
    """Makes one call and says what came of it."""
    from palpate import _core

    owner, values = world.arguments(name, wanted, rng)
    for at in rng.permutation(len(values))[: int(rng.choice([0, 1, 1, 1, 2, 3]))]:
        values[at] = damaged(values[at], world, rng)
    module, *rest = name.split(".")
    here = getattr(_core, module)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            if len(rest) == 1:
                found = getattr(here, rest[0])(*values)
            elif rest[1] == "__init__":
                found = getattr(here, rest[0])(*values)
                world.keep(found) if rng.random() < 0.2 else None
            elif rest[1].endswith("="):
                setattr(owner, rest[1][:-1], *values)
            else:
                found = getattr(owner, rest[1])
                found = found(*values) if callable(found) else found
            if rest[-1] == "start":
                owner.stop()
            if rest[-1] == "u":
                found.flat[rng.integers(found.size)] = NUMBERS[rng.integers(len(NUMBERS))]
        except RAISED:
            return "raised"
        except BaseException as problem:
            return f"{type(problem).__name__}: {str(problem)[:200]}"
    return "returned"


def work(first, count, seed):
    """A batch of calls; the number of each before it is made, and what came of it after."""
    if "asan" not in os.environ.get("LD_PRELOAD", ""):  # whose shadow takes terabytes of addresses
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    every, world = weighted(), World()
    for n in range(first, first + count):
        name, wanted = every[n * STRIDE % len(every)]
        print(n, name, flush=True)
        print(call(world, name, wanted, np.random.default_rng([seed, n])), flush=True)


def run(count, seed, first=0):
    """How often each entry did what, and the failures: number, entry, outcome."""
    told, failures = Counter(), []
    n = first
    while n < first + count:
        batch = min(BATCH - n % BATCH, first + count - n)
        command = [sys.executable, "-X", "faulthandler", __file__, str(batch), "--worker", "--first", str(n)]
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PALPATE_THREADS": "2"}
        pipe = subprocess.PIPE
        child = subprocess.Popen([*command, "--seed", str(seed)], stdout=pipe, stderr=pipe, text=True, env=environment)
        reached = n
        while True:
            waits = select.select([child.stdout], [], [], SECONDS if reached > n else 4 * SECONDS)[0]
            line = child.stdout.readline() if waits else ""
            if not line:
                break
            number, name = line.split()
            waits = select.select([child.stdout], [], [], SECONDS)[0]
            outcome = child.stdout.readline().strip() if waits else ""
            if not outcome:
                child.kill() if not waits else None
                said = child.communicate()[1]
                outcome = "hang" if not waits else f"crash (exit {child.returncode}) {said[-3000:]}"
            told[f"{name}: {outcome if outcome in ('raised', 'returned') else 'FAILED'}"] += 1
            if outcome not in ("raised", "returned"):
                print(f"call {number} of {name}: {outcome[:100]}", file=sys.stderr, flush=True)
                failures.append((int(number), name, outcome))
            reached = int(number) + 1
            if child.returncode is not None:
                break
        child.kill()
        said = child.communicate()[1]
        if reached == n:
            failures.append((n, "start of the worker", said[-3000:]))
            reached = n + batch
        n = reached
    return told, failures


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.worker:
        work(given.first, given.count, given.seed)
        return 0
    told, failures = run(given.count, given.seed, given.first)
    for name, times in sorted(told.items()):
        print(f"{times:6d}  {name}")
    for n, name, outcome in failures:
        print(f"call {n} of {name}: {outcome}")
    print(f"{given.count} calls of {len(entries())} entries, seed {given.seed}: {len(failures)} failures")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
