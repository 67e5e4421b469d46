"""A reconstruction in less memory than it needs, by a limit of the system, next to one that has enough.

    python -m benchmarks.beyond_memory [--side 700] [--share 3] [--optimizer momentum] [--scratch DIR]

Needs root, and control groups of version 1 or 2: the limit holds for private memory and for what the system keeps of files.
Tells times a voxel and iteration, the largest amount of memory that each run had, whether the bits are the same, and how
fast the disk is, from which follows what part of the time it explains.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

CODE = """
import sys, time
import numpy as np
import palpate as pp

side, deep, memory, optimizer, scratch, out = int(sys.argv[1]), int(sys.argv[2]), *sys.argv[3:]
panel = pp.Panel((side, side), (1, 1), (-side / 2, -side / 2, 0))
views = pp.arc_views(panel, np.linspace(-20, 20, 25), radius=4000, pivot=(0, 0, deep / 2))
grid = pp.Grid((deep, side, side), (1, 1, 1), (-side / 2, -side / 2, 2))
ITERATIONS = 4

def run():
    rng = np.random.default_rng(1)
    counts = np.empty(views.shape, np.float32)
    for view in counts:
        view[:] = rng.poisson(500, view.shape)
    scan = pp.Scan(counts, 1000, views)
    prior = pp.Prior("quadratic", strength=0.5, edge=0.01)
    times = [time.perf_counter()]
    options = {"prior": prior, "levels": 1, "start": "uniform", "tolerance": 0, "optimizer": optimizer}
    for step in pp.iterates(scan, grid, iterations=ITERATIONS, **options):
        times.append(time.perf_counter())
        total = float(step.volume.values.sum(dtype=np.float64))
        objective = step.objective
    return times, total, objective

if memory == "none":
    times, total, objective = run()
else:
    with pp.memory_limit(memory, scratch):
        times, total, objective = run()
steps = np.diff(times)[1:]
print(float(np.median(steps)) / grid.size * 1e9, total, repr(objective), times[-1] - times[0])
"""


def group() -> tuple[Path, str, str]:
    """A new control group, and the names of its limit and of its largest use."""
    first = Path("/sys/fs/cgroup/memory")
    version_1 = first.is_dir()
    made = (first if version_1 else Path("/sys/fs/cgroup")) / f"palpate-{os.getpid()}"
    made.mkdir()
    names = ("memory.limit_in_bytes", "memory.max_usage_in_bytes") if version_1 else ("memory.max", "memory.peak")
    return made, *names


def run(words: list[str], limit: int | None) -> tuple[list[float], float]:
    """What a run says, and its largest use of memory, bytes."""
    made, limit_name, peak_name = group()
    try:
        if limit is not None:
            (made / limit_name).write_text(str(limit))

        def join() -> None:
            (made / "cgroup.procs").write_text(str(os.getpid()))

        done = subprocess.run([sys.executable, "-c", CODE, *words], preexec_fn=join, capture_output=True, text=True)
        if done.returncode:
            raise SystemExit(f"{words}: ended with {done.returncode}: {done.stderr[-400:]}")
        return [float(word) for word in done.stdout.split()], float((made / peak_name).read_text())
    finally:
        time.sleep(0.5)
        made.rmdir()


def disk_speed(folder: Path) -> tuple[float, float]:
    """Bytes/s written and read, past the system's cache."""
    with tempfile.NamedTemporaryFile(dir=folder) as file:
        speeds = []
        for line in (
            ["if=/dev/zero", f"of={file.name}", "oflag=direct"],
            [f"if={file.name}", "of=/dev/null", "iflag=direct"],
        ):
            began = time.perf_counter()
            subprocess.run(["dd", *line, "bs=4M", "count=256"], check=True, capture_output=True)
            speeds.append(256 * 4 * 2**20 / (time.perf_counter() - began))
    return speeds[0], speeds[1]


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--side", type=int, default=700)
    parser.add_argument("--deep", type=int, default=240)
    parser.add_argument("--share", type=float, default=3.0)
    parser.add_argument("--optimizer", default="momentum")
    parser.add_argument("--scratch", type=Path, default=Path(tempfile.gettempdir()))
    given = parser.parse_args()
    words = [str(given.side), str(given.deep)]
    written, read = disk_speed(given.scratch)
    whole, most = run([*words, "none", given.optimizer, str(given.scratch), "-"], None)
    limit = int(most / given.share)
    within, peak = run([*words, str(limit), given.optimizer, str(given.scratch), "-"], limit)
    print(f"disk: {written / 1e6:.0f} MB/s written, {read / 1e6:.0f} MB/s read")
    print(f"enough memory: {whole[0]:.1f} ns a voxel and iteration, at most {most / 1e9:.2f} GB, all {whole[3]:.0f} s")
    print(f"a limit of {limit / 1e9:.2f} GB: {within[0]:.1f} ns ({within[0] / whole[0]:.2f} times),", end=" ")
    print(f"at most {peak / 1e9:.2f} GB, all {within[3]:.0f} s")
    print("the same sum of voxels and objective" if whole[1:3] == within[1:3] else "OTHER VALUES")


if __name__ == "__main__":
    main()
