"""Builds of the core by different compilers, in turn: python -m benchmarks.compiler_builds BUILD/_core*.so BUILD/_core*.so.

Processor time on one thread of projection, backprojection and one descent sweep on W1 and W2, and the ratio to the first
build: median over the rounds of the least of three runs.
"""

import importlib.util
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np

ROUNDS = 5


def least(function: Callable[[], object], prepare: Callable[[], object] = lambda: None) -> float:
    """The least processor time of three runs, after one that is not counted."""
    taken = []
    for _ in range(4):
        prepare()
        began = time.process_time()
        function()
        taken.append(time.process_time() - began)
    return min(taken[1:])


def measure(core: str) -> dict[str, float]:
    """Seconds of each kernel, with the core of a file in place of the installed one."""
    import palpate as pp

    spec = importlib.util.spec_from_file_location("palpate._core", core)
    assert spec
    assert spec.loader
    module = sys.modules["palpate._core"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    pp._core = module
    from benchmarks.workloads import WORKLOADS

    out = {}
    for name in ("W1 circular-8", "W2 dbt-15"):
        views, grid = WORKLOADS[name]()
        A = pp.Projector(views, grid)
        random = np.random.default_rng(0)
        x, p, f = (
            random.random(grid.shape, np.float32),
            np.empty(views.shape, np.float32),
            np.empty(grid.shape, np.float32),
        )
        out[f"{name}, projection"] = least(lambda: A(x, out=p))  # noqa: B023
        out[f"{name}, backprojection"] = least(lambda: A.T(p, out=f))  # noqa: B023
        data, law = module.icd.SurrogateImages(A.geometry), pp.Prior("lange", edge=0.01).law
        slope = random.random(views.shape, np.float32) - np.float32(0.5)
        data.set_curvature(random.random(views.shape, np.float32) + np.float32(0.5))

        def prepare() -> None:
            data.set_slope(slope)  # noqa: B023
            f.fill(0.02)  # noqa: B023

        out[f"{name}, descent sweep"] = least(lambda: module.icd.sweep(data, f, *law, 0.1, 1.0), prepare)  # noqa: B023
    return out


def main(cores: list[str]) -> None:
    """Prints a row for each kernel: seconds, and the ratio to the first build."""
    environment = {**os.environ, "PALPATE_THREADS": "1"}
    rounds: list[list[dict[str, float]]] = []
    for _ in range(ROUNDS):
        rounds.append([])
        for core in cores:
            words = [sys.executable, "-m", "benchmarks.compiler_builds", "--one", os.path.abspath(core)]
            run = subprocess.run(words, env=environment, check=True, capture_output=True, text=True)
            rounds[-1].append(json.loads(run.stdout))
    print(*(f"build {i}: {core}" for i, core in enumerate(cores)), sep="\n")
    for kernel in rounds[0][0]:
        cells = [
            f"{statistics.median(each[i][kernel] for each in rounds):.3f} s "
            f"({statistics.median(each[i][kernel] / each[0][kernel] for each in rounds):.2f})"
            for i in range(len(cores))
        ]
        print(f"{kernel:32}", *cells)


if __name__ == "__main__":
    if sys.argv[1] == "--one":
        print(json.dumps(measure(sys.argv[2])))
    else:
        main(sys.argv[1:])
