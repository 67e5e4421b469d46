"""Peak memory of a projection and a backprojection above their two arrays: a child process, because a peak stays.

`python -m benchmarks.peak_memory "W2 dbt-15"` prints it in MB, 2**20 bytes.
"""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np

import palpate as pp
from benchmarks.workloads import WORKLOADS


def above_arrays(name: str) -> float:
    """MB beyond volume and projections, the projector's own tables and threads included."""
    run = subprocess.run(
        [sys.executable, "-m", "benchmarks.peak_memory", name], capture_output=True, text=True, check=True
    )
    return float(run.stdout)


def _status(key: str) -> float:
    return int(re.search(rf"{key}:\s+(\d+) kB", Path("/proc/self/status").read_text())[1]) / 1024


def _measure(name: str) -> float:
    views, grid = WORKLOADS[name]()
    pp.Projector  # noqa: B018 (its code is loaded at first use)
    x, p = np.full(grid.shape, 0.5, np.float32), np.full(views.shape, 0.5, np.float32)
    Path("/proc/self/clear_refs").write_text("5")  # the peak so far is forgotten
    before = _status("VmRSS")
    A = pp.Projector(views, grid)
    A(x, out=p)
    A.T(p, out=x)
    return _status("VmHWM") - before


if __name__ == "__main__":
    print(_measure(sys.argv[1]))
