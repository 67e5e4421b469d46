"""This version and another by turns: python -m benchmarks.against_version OTHER_PYTHON [--rounds 9] [--only W1].

OTHER_PYTHON is the interpreter of an environment with another version of palpate, from 0.1 on. One process of each
version lives through the whole run. They take turns, first one, then the other, so that what else the machine does falls
on both alike. Processor seconds on one thread; a ratio above 1 says that this version is slower.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
Work = Callable[[], object]


def works() -> dict[str, Callable[[], Work]]:
    """What is measured, by name: a function that prepares it and returns the function to time."""
    sys.path[:0] = [str(ROOT), str(ROOT / "tests")]
    import digest
    import numpy as np

    import palpate as pp
    from benchmarks.workloads import WORKLOADS, smooth

    made: dict[str, Callable[[], Work]] = {}

    def projector(name: str, back: bool) -> Work:
        views, grid = WORKLOADS[name]()
        A, random = pp.Projector(views, grid), np.random.default_rng(0)
        x, p = random.random(grid.shape, np.float32), random.random(views.shape, np.float32)
        return (lambda: A.T(p, out=x)) if back else (lambda: A(x, out=p))

    def reconstruction(name: str, options: dict[str, object]) -> Work:
        views, grid = WORKLOADS[name]()
        mean = 2e4 * np.exp(-pp.Projector(views, grid)(smooth(grid)))
        counts = np.random.default_rng(1).poisson(mean).astype(np.float32)
        scan = pp.Scan(counts, 2e4, views)
        return lambda: pp.reconstruct(scan, grid, **options)

    def ticks(model: str) -> Work:
        session, rows = digest.session_of(digest.kidney(), model), [row[0] for row in digest.commands(digest.kidney())]
        return lambda: session.step(rows)

    for name in WORKLOADS:
        made[f"{name}, projection"] = lambda name=name: projector(name, back=False)
        made[f"{name}, backprojection"] = lambda name=name: projector(name, back=True)
    sweeps = {"levels": 1, "iterations": 2, "tolerance": 0}
    for name in ("W1 circular-8", "W2 dbt-15"):
        for way in ("descent", "momentum", "subsets"):
            options = {**sweeps, **digest.optimiser(way)}
            made[f"{name}, two iterations of {way}"] = lambda n=name, o=options: reconstruction(n, o)
    made["W1 circular-8, default reconstruction"] = lambda: reconstruction("W1 circular-8", {})
    made["kidney, mesh"] = lambda: lambda: pp.tetrahedralize(digest.kidney_labels(), "kidney", 6.0, inclusions=["lump"])
    made["kidney, fit"] = lambda: lambda: pp.fit(digest.kidney_mesh(), 6.0, 0.45, digest.kidney().fixed)
    for model in digest.MODELS:
        made[f"kidney, build {model}"] = lambda model=model: lambda: pp.model(digest.kidney(), model)
        made[f"kidney, 600 ticks of {model}"] = lambda model=model: ticks(model)
    return made


def serve() -> None:
    """Time what standard input names, a line each, until it ends: the least of the runs that fit into 0.3 s."""
    known = works()
    print(json.dumps(list(known)), flush=True)
    name, work = "", lambda: None
    for line in sys.stdin:
        if line.strip() != name:
            name = line.strip()
            work = known[name]()
            work()
        taken: list[float] = []
        while sum(taken) < 0.3:
            began = time.process_time()
            work()
            taken.append(time.process_time() - began)
        print(json.dumps(min(taken)), flush=True)


def start(python: str, path: str | None) -> subprocess.Popen[str]:
    """A process of one version, and the names of what it can do read from it."""
    environment = {**os.environ, "PALPATE_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    environment.pop("PYTHONPATH", None)
    if path:
        environment["PYTHONPATH"] = path
    command = [python, str(Path(__file__).resolve()), "--serve"]
    return subprocess.Popen(
        command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT
    )


def ask(process: subprocess.Popen[str], name: str) -> float:
    """Seconds of one run of a work."""
    assert process.stdin
    assert process.stdout
    print(name, file=process.stdin, flush=True)
    return float(json.loads(process.stdout.readline()))


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.against_version", description=__doc__)
    parser.add_argument("other", help="the interpreter of the environment that has the other version")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--only", default="", help="only works with this in their names")
    options = parser.parse_args()
    this, other = start(sys.executable, os.environ.get("PYTHONPATH")), start(options.other, None)
    assert this.stdout
    assert other.stdout
    names = [n for n in json.loads(this.stdout.readline()) if options.only in n]
    other.stdout.readline()
    print("| work | this, CPU s | other, CPU s | ratio (least to most) |\n| --- | --- | --- | --- |")
    for name in names:
        taken = []
        for turn in range(options.rounds):
            order = (this, other) if turn % 2 else (other, this)
            seconds = {process: ask(process, name) for process in order}
            taken.append((seconds[this], seconds[other]))
        mine, theirs = (statistics.median(column) for column in zip(*taken, strict=True))
        ratios = sorted(a / b for a, b in taken)
        ratio = statistics.median(ratios)
        print(f"| {name} | {mine:.4f} | {theirs:.4f} | {ratio:.3f} ({ratios[0]:.2f} to {ratios[-1]:.2f}) |", flush=True)


if __name__ == "__main__":
    serve() if sys.argv[1:] == ["--serve"] else main()
