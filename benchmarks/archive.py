"""An archive of scans on workers: how much two do in the time of one, what kills cost, and the memory of the client.

    python -m benchmarks.archive [--scans 200] [--kills 20] [--tiny 1000] [--seed 1]
    python -m benchmarks.archive --slurm 20

Scans are small and differ by their noise. Every run has one thread. Outputs of two workers, and those that come about
with kills between, are compared with those of one worker, bit for bit. The second command needs a Slurm of one node: it
drains the node and cancels its jobs midway, and lets it go on after ten seconds.
"""

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil

import palpate as pp

SIDE, TINY_SIDE = 64, 16  # pixels
PITCH = 2.0  # mm
OPTIONS = ("--thickness", "30", "--spacing", "1.6", "--iterations", "30", "--tolerance", "0", "--no-check")
TINY_OPTIONS = ("--thickness", "20", "--iterations", "1", "--no-check")
KILLED_SCANS = 6  # in each trial with a kill
VICTIMS = ("command", "worker", "scheduler", "client")


def make_scans(folder: Path, count: int, side: int) -> Path:
    """A folder with so many scans of a ball."""
    folder.mkdir()
    half = (side - 1) * PITCH / 2
    panel = pp.Panel(shape=(side, side), pitch=(PITCH, PITCH), origin=(-half, -half, 0))
    views = pp.arc_views(panel, np.linspace(-15, 15, 7), radius=600, pivot=(0, 0, 15))
    grid = pp.covering_grid(views, 30, PITCH)
    centres = grid.points(np.stack(np.indices(grid.shape), axis=-1))
    away = np.linalg.norm(centres - centres.mean(axis=(0, 1, 2)), axis=-1)
    lines = pp.Projector(views, grid)(np.where(away < side * PITCH / 5, 0.02, 0).astype(np.float32))
    for seed in range(count):
        counts = np.random.default_rng(seed).poisson(2e4 * np.exp(-lines))
        pp.write_scan(folder / f"scan-{seed:04d}.h5", pp.Scan(counts, 2e4, views))
    return folder


def words(study: Path, volumes: Path, options: tuple[str, ...], on: object) -> list[str]:
    """The command line."""
    start = [sys.executable, "-m", "palpate", "reconstruct", str(study), "-o", str(volumes)]
    return [*start, *options, "--on", str(on)]


def bits(folder: Path) -> dict[str, bytes]:
    """Every volume of a folder, by name."""
    return {path.name: path.read_bytes() for path in folder.glob("*.nii.gz")}


def timed(command: list[str]) -> float:
    """Seconds that a command takes."""
    began = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.perf_counter() - began


def chains(study: Path, folder: Path, count: int, at_once: int) -> float:
    """Seconds that so many scans take one after the other in shells, so many shells at once: without any scheduler."""
    scans = sorted(study.glob("*.h5"))[:count]
    command = (
        f'"{sys.executable}" -m palpate reconstruct "$scan" -o "$0/$(basename "$scan").nii.gz" {" ".join(OPTIONS)}'
    )
    line = f"for scan; do {command}; done"
    folder.mkdir()
    began = time.perf_counter()
    shells = [
        subprocess.Popen(
            ["sh", "-c", line, str(folder), *map(str, scans[k::at_once])],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for k in range(at_once)
    ]
    for shell in shells:
        shell.wait()
    return time.perf_counter() - began


def throughput(folder: Path, count: int) -> None:
    """Prints what two workers do in the time of one, and what two shells without a scheduler do."""
    study = make_scans(folder / "study", count, SIDE)
    seconds = {on: timed(words(study, folder / f"volumes-{on}", OPTIONS, on)) for on in (1, 2)}
    same = bits(folder / "volumes-1") == bits(folder / "volumes-2")
    again = timed(words(study, folder / "volumes-2", OPTIONS, 2))
    gain = seconds[1] / seconds[2]
    print(
        f"{count} scans of 7 x {SIDE} x {SIDE}: one worker {seconds[1]:.0f} s, two {seconds[2]:.0f} s: {gain:.2f} times, "
        f"{gain / 2:.0%} of twice; "
    )
    print(f"   {'the same bits' if same else 'OTHER BITS'}; the same command again {again:.1f} s")
    few = max(count // 4, 2)
    alone, beside = (chains(study, folder / f"chains-{n}", few, n) for n in (1, 2))
    print(
        f"   without a scheduler, {few} scans: one shell {alone:.0f} s, two {beside:.0f} s: {alone / beside:.2f} times; "
        f"the workers do {gain / (alone / beside):.0%} of that"
    )


class Cluster:
    """A scheduler and two workers of Dask, each a process."""

    def __init__(self, folder: Path) -> None:
        self.file = folder / "scheduler.json"
        environment = {**os.environ, "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "3s", "PALPATE_THREADS": "1"}

        def start(*line: str) -> subprocess.Popen[bytes]:
            silent = subprocess.DEVNULL
            line = (sys.executable, "-m", "dask", *line, "--scheduler-file", str(self.file), "--no-dashboard")
            return subprocess.Popen(line, stdout=silent, stderr=silent, env=environment)

        self.scheduler = start("scheduler", "--port", "0")
        while not self.file.exists():
            time.sleep(0.05)
        self.workers = [start("worker", "--nthreads", "1") for _ in range(2)]

    def end(self) -> None:
        """Ends all of it."""
        for process in (*self.workers, self.scheduler):
            process.kill() if process.poll() is not None else process.send_signal(signal.SIGTERM)
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self.file.unlink(missing_ok=True)


def commands(cluster: Cluster) -> list[psutil.Process]:
    """The processes of commands."""
    below = [p for w in cluster.workers if w.poll() is None for p in psutil.Process(w.pid).children(recursive=True)]
    found = []
    for process in below:
        try:
            if "palpate.cluster.command_process" in process.cmdline():
                found.append(process)
        except psutil.NoSuchProcess:
            pass
    return found


def kills(folder: Path, count: int, seed: int) -> None:
    """Kills workers, commands, the scheduler and the client at random moments, and goes on with the same command."""
    rng = random.Random(seed)
    study = make_scans(folder / "killed", KILLED_SCANS, SIDE)
    serial = folder / "killed-serial"
    whole = timed(words(study, serial, OPTIONS, 1))
    wrong = lost = twice = 0
    for trial in range(count):
        volumes = folder / f"killed-{trial}"
        victim, cluster = VICTIMS[trial % len(VICTIMS)], Cluster(folder)
        client = subprocess.Popen(
            words(study, volumes, OPTIONS, cluster.file), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        time.sleep(rng.uniform(1.0, 0.8 * whole))
        if victim == "command":
            for process in commands(cluster)[:1]:
                process.kill()
        elif victim == "worker":
            nanny = psutil.Process(rng.choice(cluster.workers).pid)
            for process in nanny.children()[:1]:
                process.kill()
        else:
            (cluster.scheduler if victim == "scheduler" else client).kill()
        code = client.wait(300)
        before = {path.name: path.stat().st_mtime_ns for path in volumes.glob("*.nii.gz")}
        if victim == "scheduler":
            cluster.end()
            cluster = Cluster(folder)
        subprocess.run(
            words(study, volumes, OPTIONS, cluster.file),
            check=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        cluster.end()
        after = {path.name: path.stat().st_mtime_ns for path in volumes.glob("*.nii.gz")}
        made_again = sum(after[name] != at for name, at in before.items())
        same = bits(volumes) == bits(serial)
        wrong, lost, twice = wrong + (not same), lost + (len(after) < KILLED_SCANS), twice + made_again
        print(
            f"  {victim} killed: client ended with {code}, {len(before)} of {KILLED_SCANS} there; then all, "
            f"{'same' if same else 'OTHER'} bits"
        )
    print(f"{count} kills: {wrong} with other bits, {lost} with a volume lost, {twice} volumes made twice")


def client_memory(folder: Path, count: int) -> None:
    """Prints the peak memory of a client with so many runs."""
    study = make_scans(folder / "tiny", 1, TINY_SIDE)
    first = study / "scan-0000.h5"
    for seed in range(1, count):
        shutil.copy(first, study / f"scan-{seed:04d}.h5")
    cluster = Cluster(folder)
    began = time.perf_counter()
    client = subprocess.Popen(
        words(study, folder / "tiny-volumes", TINY_OPTIONS, cluster.file),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    _, status, usage = os.wait4(client.pid, 0)
    seconds = time.perf_counter() - began
    cluster.end()
    made = len(bits(folder / "tiny-volumes"))
    print(
        f"{count} tiny scans: {made} made in {seconds:.0f} s, status {status}; "
        f"the client's peak {usage.ru_maxrss / 1024:.0f} MB"
    )


def drained(folder: Path, count: int) -> None:
    """Drains the node of a real Slurm midway."""
    study, volumes, serial = (
        make_scans(folder / "slurm", count, SIDE),
        folder / "slurm-volumes",
        folder / "slurm-serial",
    )
    timed(words(study, serial, OPTIONS, 1))
    node = subprocess.run(["sinfo", "-hN", "-o", "%N"], check=True, capture_output=True, text=True).stdout.split()[0]
    client = subprocess.Popen(words(study, volumes, OPTIONS, "slurm:2"), stderr=subprocess.PIPE, text=True)
    while len(list(volumes.glob("*.nii.gz"))) < count // 4:
        time.sleep(0.1)
    for line in (
        f"scontrol update nodename={node} state=drain reason=benchmark",
        "scancel -n dask-worker",
        "sleep 10",
        f"scontrol update nodename={node} state=resume",
    ):
        subprocess.run(line.split(), check=True)
    said = client.communicate()[1]
    print(said, end="")
    same = bits(volumes) == bits(serial)
    print(
        f"{count} scans on Slurm, drained midway: ended with {client.returncode}, {'the same' if same else 'OTHER'} bits"
    )


def main() -> None:
    """Measures all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scans", type=int, default=200)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--tiny", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--slurm", type=int, default=0)
    given = parser.parse_args()
    os.environ["PALPATE_THREADS"] = "1"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if given.slurm:
            drained(folder, given.slurm)
            return
        if given.scans:
            throughput(folder, given.scans)
        if given.kills:
            kills(folder, given.kills, given.seed)
        if given.tiny:
            client_memory(folder, given.tiny)


if __name__ == "__main__":
    main()
