"""A reconstruction in less memory than it needs, by a limit of the system, next to one that has enough.

    python -m benchmarks.beyond_memory [--side 1000] [--deep 400] [--share 3] [--scratch DIR] [--only descent]

Needs root, and control groups of version 1 or 2: the limit holds for private memory and for what the system keeps of files.
Of each optimizer, and of the whole command with its defaults: the time a voxel, the largest amount of memory, and how far
the two volumes are apart. How fast the disk is comes first; with the numbers that an iteration reads and writes there
(docs/large-scans.md) it says what part of the time it explains.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import palpate as pp

OPTIMIZERS = "momentum", "descent", "command"
CODE = """
import sys, time, contextlib
import numpy as np
import palpate as pp

scan, thickness, memory, optimizer, scratch, out = sys.argv[1], float(sys.argv[2]), *sys.argv[3:]
limit = contextlib.nullcontext() if memory == "none" else pp.memory_limit(memory, scratch)
with limit:
    measured = pp.read_scan(scan)
    side = float(measured.shape[2])
    grid = pp.Grid((int(thickness), int(side), int(side)), (1, 1, 1), (-side / 2, -side / 2, 2))
    prior = pp.Prior("quadratic", strength=0.5, edge=0.01)
    options = {"prior": prior, "levels": 1, "start": "uniform", "tolerance": 0, "optimizer": optimizer}
    times = [time.perf_counter()]
    for step in pp.iterates(measured, grid, iterations=4, **options):
        times.append(time.perf_counter())
    with open(out, "wb") as file:
        for part in step.volume.values:
            file.write(part.data)
print(float(np.median(np.diff(times)[1:])), *grid.shape)
"""
COMMAND = """
import sys, time
from palpate.commands import app
from palpate.volumes.io import read_volume

scan, thickness, memory, _, scratch, out = sys.argv[1:]
words = ["reconstruct", scan, "--thickness", thickness, "--spacing", "1", "-o", out + ".zarr", "--iterations", "10"]
more = [] if memory == "none" else ["--memory", memory, "--scratch", scratch]
began = time.perf_counter()
app([*words, *more], standalone_mode=False)
print(time.perf_counter() - began, *read_volume(out + ".zarr").grid.shape)
"""


def write_scan(path: Path, side: int, deep: int) -> None:
    """An ellipsoid in air, 25 views, 1,000 photons."""
    panel = pp.Panel((side, side), (1, 1), (-side / 2, -side / 2, 0))
    views = pp.arc_views(panel, np.linspace(-20, 20, 25), radius=4 * side, pivot=(0, 0, deep / 2))
    body = pp.Ellipsoid((0, 0, deep / 2), (0.3 * side, 0.3 * side, 0.4 * deep))
    pp.write_scan(path, pp.simulate_scan(pp.Phantom([(body, 3 / deep)]), views, 1000, seed=1, subrays=1))


def group() -> tuple[Path, str, str]:
    """A new control group, and the names of its limit and of its largest use."""
    first = Path("/sys/fs/cgroup/memory")
    version_1 = first.is_dir()
    made = (first if version_1 else Path("/sys/fs/cgroup")) / f"palpate-{os.getpid()}"
    made.mkdir()
    names = ("memory.limit_in_bytes", "memory.max_usage_in_bytes") if version_1 else ("memory.max", "memory.peak")
    return made, *names


def run(code: str, words: list[str], limit: int | None) -> tuple[list[float], float]:
    """What a run says, and its largest use of memory, bytes."""
    made, limit_name, peak_name = group()
    try:
        if limit is not None:
            (made / limit_name).write_text(str(limit))

        def join() -> None:
            (made / "cgroup.procs").write_text(str(os.getpid()))

        done = subprocess.run([sys.executable, "-c", code, *words], preexec_fn=join, capture_output=True, text=True)
        if done.returncode:
            raise SystemExit(f"{words}: ended with {done.returncode}: {done.stderr[-800:]}")
        said = [float(word) for word in done.stdout.splitlines()[-1].split()]
        return said, float((made / peak_name).read_text())
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


def difference(a: Path, b: Path, shape: tuple[int, ...], command: bool) -> tuple[float, float]:
    """Of two volumes: |a - b| over |a|, and the largest difference over the largest value; slice by slice."""
    if command:
        one, other = (pp.read_volume(path.with_suffix(".zarr")).values for path in (a, b))
    else:
        one, other = (np.memmap(path, np.float32, "r", shape=shape) for path in (a, b))
    square = apart = most = far = 0.0
    for x, y in zip(one, other, strict=True):
        square += float(np.square(x, dtype=np.float64).sum())
        apart += float(np.square(x - y, dtype=np.float64).sum())
        most, far = max(most, float(x.max())), max(far, float(np.abs(x - y).max()))
    return float(np.sqrt(apart / square)), far / most


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--side", type=int, default=1000)
    parser.add_argument("--deep", type=int, default=400)
    parser.add_argument("--share", type=float, default=3.0)
    parser.add_argument("--scratch", type=Path, default=Path(tempfile.gettempdir()))
    parser.add_argument("--only", choices=OPTIMIZERS)
    given = parser.parse_args()
    written, read = disk_speed(given.scratch)
    print(f"disk: {written / 1e6:.0f} MB/s written, {read / 1e6:.0f} MB/s read")
    with tempfile.TemporaryDirectory(dir=given.scratch) as folder:
        scan, whole, part = (Path(folder) / name for name in ("scan.h5", "whole", "part"))
        write_scan(scan, given.side, given.deep)
        for name in [given.only] if given.only else OPTIMIZERS:
            code = COMMAND if name == "command" else CODE
            words = [str(scan), str(given.deep)]
            (seconds, *shape), most = run(code, [*words, "none", name, str(given.scratch), str(whole)], None)
            limit = int(most / given.share)
            (longer, *_), peak = run(code, [*words, str(limit), name, str(given.scratch), str(part)], limit)
            voxels = np.prod(shape)
            command = code is COMMAND
            print(f"{name}: {seconds / voxels * 1e9:.1f} ns a voxel{'' if command else ' and iteration'},", end=" ")
            print(f"at most {most / 1e9:.2f} GB")
            print(
                f"  within {limit / 1e9:.2f} GB: {longer / voxels * 1e9:.1f} ns ({longer / seconds:.2f} times),",
                end=" ",
            )
            apart, far = difference(whole, part, tuple(int(n) for n in shape), command)
            print(f"at most {peak / 1e9:.2f} GB; volumes {apart:.1e} apart, one voxel at most {far:.1e}", flush=True)


if __name__ == "__main__":
    main()
