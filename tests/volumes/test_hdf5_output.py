"""HDF5 files on a full disk: every writer ends in an error that names the file, and none crashes or leaves half a file."""

import json
import subprocess
import sys

import pytest
from support.running_server import HERE

pytest.importorskip("resource")

# Each in a process of its own, since the HDF5 library crashed. The limit of a file's size is a full disk that needs no root.
CHILD = """
import json, resource, signal, sys
from pathlib import Path
import numpy as np
import palpate as pp
from palpate.reconstruction.checkpoint import write_checkpoint
from palpate.reconstruction.iterate import Step

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
kind, part = sys.argv[1], float(sys.argv[2])
rng = np.random.default_rng(0)
if kind == "scan":
    panel = pp.Panel((60, 80), (1, 1), (-40, -30, 0))
    scan = pp.Scan(rng.integers(1, 999, (9, 60, 80)), 5000, pp.arc_views(panel, np.linspace(-20, 20, 9), radius=600))
    write = lambda path: pp.write_scan(path, scan)
elif kind == "record":
    n = 4000
    record = pp.Record(np.arange(n), np.zeros(n, np.uint8), np.ones(n, np.uint8), rng.random((n, 3)), rng.random((n, 3)), n,
        np.arange(0, n, 100), rng.integers(0, 2**63, n // 100, np.uint64), np.empty(0, np.int64), np.empty(0, np.uint8),
        "blocks", "x", {"radius": 1.0}, "generic")
    write = lambda path: pp.write_record(path, record)
else:
    grid = pp.Grid((20, 60, 64), (1, 1, 1))
    volume = pp.Volume(rng.random(grid.shape, np.float32), grid)
    step = Step(volume, 1.0, 0, 3, 0.1, False, volume.values, (1.0,), {f"s{k}": volume.values[k] for k in range(20)})
    write = lambda path: write_checkpoint(path, step, {})
target = Path("out.h5")
write(target)
whole = target.read_bytes()
resource.setrlimit(resource.RLIMIT_FSIZE, (int(part * len(whole)), resource.RLIM_INFINITY))
try:
    write(target)
    said = "written"
except pp.errors.FileError as problem:
    said = str(problem)
print(json.dumps([said, target.read_bytes() == whole, [p.name for p in Path(".").iterdir()]]))
"""


@pytest.mark.parametrize("part", [0.001, 0.3, 0.8, 0.99])
@pytest.mark.parametrize("kind", ["scan", "record", "checkpoint"])
def test_a_full_disk_is_an_error_and_leaves_the_older_file(kind, part, tmp_path):
    run = subprocess.run(
        [sys.executable, "-c", CHILD, kind, str(part)], cwd=tmp_path, env=HERE, capture_output=True, text=True
    )
    assert run.returncode == 0, f"ended by {run.returncode}: {run.stderr[-300:]}"
    said, unchanged, left = json.loads(run.stdout)
    assert said.startswith("out.h5: could not be written (File too large)"), said
    assert unchanged
    assert left == ["out.h5"]
    assert "Exception ignored" not in run.stderr
