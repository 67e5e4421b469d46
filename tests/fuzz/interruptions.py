"""Commands that are stopped at random moments, and commands on a full disk: nothing is lost, nothing is half there.

    python tests/fuzz/interruptions.py --interrupts 500 --kills 200 --full-disks 100 --seed 1

Every long command is run on small inputs in a folder of its own and gets Ctrl-C or SIGKILL at a moment drawn from the time
that it takes. Ctrl-C must end it with exit code 130 (a session: 0, and its record), in one line, without a traceback, within
--seconds. Whatever bears a final name must be whole. What can go on with --resume is stopped again and again until it
ends; then its files must be those of the uninterrupted run, to the byte. A session's record must reach to the last second
that the page saw, and replay to the bit. A full disk is a limit of the size of files, or a small file system in memory where
one may be mounted: one line that names a file, and no crash. The run ends with 1 if one of this did not hold.
"""

import argparse
import contextlib
import os
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
import traceback
import warnings
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))

from support.running_server import HERE, until

# Says when the command's own code begins: what comes before is the start of Python.
BEGIN = "import sys, palpate.__main__ as m; print('begun', flush=True); m.main()"
RECONSTRUCT = (
    "reconstruct {inputs}/scan.h5 -o volume.nii.gz --thickness 30 --spacing 1.4 --levels 2 --iterations 20 --tolerance 0 "
    "--checkpoint-every 3"
)
COMMANDS = {  # the words, and whether --resume goes on
    "reconstruct": (RECONSTRUCT, True),
    "segment": ("segment {inputs}/ct.nii.gz -o labels.nii.gz --lower 100 --largest --smooth 2 --opening 4", False),
    "mesh": ("mesh {inputs}/labels.nii.gz --label kidney_left --edge 9 -o kidney.vtu", False),
    "fit": ("fit {inputs}/kidney.vtu --young 15 --rest-on 0,1,0 --depth 12 -o tissue.vtu", False),
    "touch": ("touch {inputs}/tissue.vtu --record session.h5 --no-browser", False),
    "score": ("score {inputs}/session.h5 {inputs}/tissue.vtu -o score.html", False),
    "demo": ("demo kidney --no-browser -o demo", True),
    "study": ("study deformation --quick -o study", True),
}
TOUCHED = 5.0  # s that a session takes


def words_of(name, inputs, resume=False):
    return COMMANDS[name][0].format(inputs=inputs).split() + (["--resume"] if resume else [])


class Run:
    """A command in a process of its own, from the moment on that its own code begins."""

    def __init__(self, words, folder, limit=None):
        def limited():
            import resource

            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

        self.process = subprocess.Popen(
            [sys.executable, "-c", BEGIN, *words], cwd=folder, env=HERE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            text=True, preexec_fn=None if limit is None else limited,
        )  # fmt: skip
        self.process.stdout.readline()
        self.began = time.monotonic()
        self.lines = []
        self.readers = [
            threading.Thread(target=self._read, args=(pipe,)) for pipe in (self.process.stdout, self.process.stderr)
        ]
        for reader in self.readers:
            reader.start()

    def _read(self, pipe):
        for line in pipe:
            self.lines.append(line)

    @property
    def said(self):
        return "".join(self.lines)

    def end(self, seconds=300):
        """Waits for the end; gives the exit code and the time since the beginning."""
        try:
            code = self.process.wait(timeout=seconds)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise AssertionError(f"did not end within {seconds} s: {self.said[-500:]}") from None
        for reader in self.readers:
            reader.join()
        return code, time.monotonic() - self.began


class Page(threading.Thread):
    """Touches a session that is served, until it ends. `tick`: the last one seen."""

    def __init__(self, run):
        super().__init__(daemon=True)
        self.run_, self.tick = run, 0

    def run(self):
        from websockets.sync.client import connect

        from palpate.server import messages

        while not any("127.0.0.1:" in line for line in list(self.run_.lines)):
            if self.run_.process.poll() is not None:
                return
            time.sleep(0.005)
        base, token = next(line for line in self.run_.lines if "127.0.0.1:" in line).split()[-1].split("/?")
        with (
            contextlib.suppress(Exception),
            connect(f"{base.replace('http', 'ws')}/socket?{token}", origin=base) as page,
        ):
            top = tuple(map(float, self.top))
            for k in range(10_000):
                depth = 0.2 * (k % 15)
                page.send(messages.encode(messages.ToolCommand(0, 1, k, top, tuple(-depth * n for n in self.normal))))
                frame = struct.unpack_from(messages.code(messages.Frame), page.recv(timeout=5))
                self.tick = max(self.tick, int(frame[2]))


# --- what must hold --------------------------------------------------------------------------------------------------


def check_whole(folder):
    """Reads every file that bears a final name with a reader that is not palpate's, where there is one."""
    import json

    import h5py
    import nibabel
    from PIL import Image

    for path in sorted(folder.rglob("*")):
        if not path.is_file() or ".part-" in str(path.relative_to(folder)) or path.suffix == ".journal":
            continue
        name = path.name
        try:
            if name.endswith((".nii.gz", ".nii")):
                assert np.isfinite(np.asarray(nibabel.load(path).dataobj)).all()
            elif name.endswith(".h5"):
                with h5py.File(path) as file:
                    file.visititems(lambda key, item: item[()] if isinstance(item, h5py.Dataset) else None)
            elif name.endswith((".vtu", ".svg", ".html", ".xml")):
                assert path.read_text().rstrip().endswith(">")
            elif name.endswith(".json"):
                json.loads(path.read_text())
            elif name.endswith(".npz"):
                with np.load(path) as file:
                    assert all(file[key] is not None for key in file)
            elif name.endswith((".png", ".jpg")):
                Image.open(path).load()
            else:
                assert path.suffix in (".txt", ".csv", ".md", ".css", ".js"), "of no known kind"
                assert path.read_bytes().endswith(b"\n")
        except Exception as problem:
            raise AssertionError(f"{path.relative_to(folder)} is not whole: {problem!r}") from None


def check_record(path, tissue, tick):
    """The record of a session that was cut short reaches to the last second that the page saw, and replays to the bit."""
    import palpate as pp

    if not (path.exists() or path.with_name(path.name + ".journal").exists()):
        assert tick < 1000, f"no record, and the page saw tick {tick}"
        return
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            record = pp.read_record(path)
        except pp.errors.FileError:
            assert tick < 1000, f"nothing to read, and the page saw tick {tick}"
            return
    assert record.length > tick - 1000, f"{record.length} ticks, and the page saw {tick}"
    session = pp.Session(
        pp.model(tissue, record.model), radius=record.settings["radius"], sweeps=int(record.settings["sweeps"])
    )
    assert session.replay(record) is None, "does not replay to the bit"


def files_of(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and ".part-" not in str(path)
    }


class Trials:
    """All trials of one run. Folders of commands that go on are kept from trial to trial until they have ended."""

    def __init__(self, folder, names, seconds):
        self.folder, self.seconds, self.names = Path(folder), seconds, names
        self.inputs = self.folder / "inputs"
        self.inputs.mkdir()
        self.told, self.failures, self.slowest, self.numbers = Counter(), [], 0.0, 0
        self.lock = threading.Lock()
        self.chains = {name: [] for name in names}
        prepare(self.inputs, names)
        import palpate as pp

        self.tissue = pp.read_tissue(self.inputs / "tissue.vtu")
        mesh = self.tissue.mesh
        top = mesh.surface[len(mesh.surface) // 2]
        corners = mesh.nodes[top]
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        Page.top, Page.normal = corners.mean(axis=0), normal / np.linalg.norm(normal)
        self.usual, self.took, self.largest = {}, {}, {}
        for name in names:
            self._uninterrupted(name)

    def new_folder(self):
        with self.lock:
            self.numbers += 1
            folder = self.folder / f"trial-{self.numbers}"
        folder.mkdir()
        return folder

    def _uninterrupted(self, name):
        """What a command writes and how long it takes. Files that differ between two runs (times) are not compared."""
        if name == "touch":
            self.took[name], self.usual[name], self.largest[name] = TOUCHED, {}, 40_000
            return
        both = []
        for _ in range(2):
            folder = self.new_folder()
            run = Run(words_of(name, self.inputs), folder)
            code, self.took[name] = run.end()
            assert code == 0, f"{name}: {run.said}"
            both.append(files_of(folder))
            shutil.rmtree(folder)
        self.usual[name] = {file: data for file, data in both[0].items() if both[1].get(file) == data}
        assert self.usual[name] or name == "score", f"{name}: no file is the same in two runs"
        self.largest[name] = max(len(data) for data in both[0].values())

    def trial(self, kind, name, seed):
        rng = np.random.default_rng(seed)
        try:
            self.told[f"{name}: {kind}: {getattr(self, kind)(name, rng)}"] += 1
        except Exception as problem:
            where = "" if isinstance(problem, AssertionError) else traceback.format_exc()[-1500:]
            self.told[f"{name}: {kind}: FAILED"] += 1
            self.failures.append(f"{name}, {kind}, seed {seed}: {problem}{where}")

    def stopped(self, name, rng, number):
        """Starts a command, or goes on with one, and sends a signal. Gives what came of it."""
        resumes = COMMANDS[name][1]
        with self.lock:
            folder = self.chains[name].pop() if resumes and self.chains[name] else None
        again = folder is not None and any(folder.iterdir())
        if name == "reconstruct":
            again = folder is not None and (folder / "volume.nii.gz.checkpoint.h5").exists()
        folder = folder or self.new_folder()
        run = Run(words_of(name, self.inputs, again), folder)
        page = Page(run) if name == "touch" else None
        if page:
            page.start()
        time.sleep(max(0.0, rng.uniform(0, 1.05 * self.took[name]) + run.began - time.monotonic()))
        ended = run.process.poll() is not None
        sent = time.monotonic()
        if not ended:
            run.process.send_signal(number)
        code, _ = run.end(60)
        late = time.monotonic() - sent
        if page:
            page.join(10)
        assert "Traceback" not in run.said, run.said[-1500:]
        check_whole(folder)
        tick = page.tick if page else 0
        return run, folder, code, ended, late, tick

    def finished(self, name, folder):
        """A command that has ended well left what the uninterrupted one leaves."""
        found = files_of(folder)
        for file, data in self.usual[name].items():
            assert found.get(file) == data, f"{file} is not that of the uninterrupted run"
        left = [str(path) for path in folder.rglob("*.part-*")]
        assert left == [], f"left behind: {left}"
        shutil.rmtree(folder)
        return "went on to the same end" if COMMANDS[name][1] else "ended before"

    def interrupt(self, name, rng):
        run, folder, code, ended, late, tick = self.stopped(name, rng, signal.SIGINT)
        if code == 0 and name == "touch":
            assert (folder / "session.h5").exists(), run.said
            assert not (folder / "session.h5.journal").exists()
            check_record(folder / "session.h5", self.tissue, tick + 990)
            shutil.rmtree(folder)
            return "recorded"
        if code == 0:
            assert ended or late < 1, f"Ctrl-C was lost: exit code 0 after {late:.1f} s: {run.said[-300:]}"
            return self.finished(name, folder)
        if code == -signal.SIGINT:  # while Python itself ends, when all is done; a shell calls that 130 too
            return self.finished(name, folder)
        assert code == 130, f"exit code {code}: {run.said[-1500:]}"
        assert "palpate: stopped" in run.said, run.said[-500:]
        assert "Exception ignored" not in run.said, run.said[-1500:]
        self.slowest = max(self.slowest, late)
        assert late < self.seconds, f"took {late:.2f} s to end"
        left = [
            path.name for path in folder.rglob("*.part-*") if f"-{run.process.pid}-" in path.name
        ]  # not of a killed one
        assert left == [], f"left behind: {left}"
        return self.go_on(name, folder, rng)

    def kill(self, name, rng):
        _, folder, code, _, _, tick = self.stopped(name, rng, signal.SIGKILL)
        if code == 0:
            return self.finished(name, folder)
        if name == "touch":
            check_record(folder / "session.h5", self.tissue, tick)
            shutil.rmtree(folder)
            return "readable"
        return self.go_on(name, folder, rng)

    def go_on(self, name, folder, rng):
        """Keeps the folder for the next trial of a command that goes on; what another run left is refused now and then."""
        if not COMMANDS[name][1]:
            for file, data in files_of(folder).items():
                assert self.usual[name].get(file, data) == data, f"{file} is not that of the uninterrupted run"
            shutil.rmtree(folder)
            return "stopped"
        checkpoint = folder / "volume.nii.gz.checkpoint.h5"
        if checkpoint.exists() and rng.random() < 0.2:
            before = checkpoint.read_bytes()
            run = Run([*" ".join(words_of(name, self.inputs, True)).replace("1.4", "1.6").split()], folder)
            code, _ = run.end()
            assert code == 2, f"another run's checkpoint was taken: {run.said}"
            assert "belongs to another run" in run.said, run.said
            assert checkpoint.read_bytes() == before
        with self.lock:
            self.chains[name].append(folder)
        return "stopped"

    def full_disk(self, name, rng):
        folder, page = self.new_folder(), None
        room = int(rng.uniform(0, 1.1 * self.largest[name]))
        memory = rng.random() < 0.5 and mounted(folder, 4096 * (1 + room // 4096))
        run = Run(words_of(name, self.inputs), folder, None if memory else room)
        if name == "touch":
            page = Page(run)
            page.start()
            until(lambda: page.tick > 1500 or run.process.poll() is not None)
            run.process.send_signal(signal.SIGINT)
        try:
            code, _ = run.end()
            if page:
                page.join(10)
            assert code in (0, 1, 2), f"exit code {code}: {run.said[-1500:]}"
            assert "Traceback" not in run.said, run.said[-1500:]
            check_whole(folder)
            if code:
                assert "No space left" in run.said or "File too large" in run.said, run.said[-500:]
                assert "palpate: " in run.said
                if page and (folder / "session.h5.journal").exists():
                    check_record(folder / "session.h5", self.tissue, 0)
        finally:
            if memory:
                subprocess.run(["umount", "-l", folder], check=False)
        shutil.rmtree(folder, ignore_errors=True)
        return f"{'in memory' if memory else 'a limit'}: {'room enough' if code == 0 else 'refused'}"

    def together(self, name, rng):
        """Two processes write one output; it is one of the two."""
        folder = self.new_folder()
        words = [words_of(name, self.inputs), words_of(name, self.inputs)]
        words[1] = [word.replace("20", "17") if word == "20" else word for word in words[1]]
        ends = []
        for one in words:
            run = Run(one, folder)
            assert run.end()[0] == 0, run.said
            ends.append((folder / "volume.nii.gz").read_bytes())
        runs = [Run(words[0], folder)]
        time.sleep(rng.uniform(0, 0.3))
        runs.append(Run(words[1], folder))
        for run in runs:
            code, _ = run.end()
            assert code == 0, run.said
        assert (folder / "volume.nii.gz").read_bytes() in ends
        assert [p.name for p in folder.iterdir()] == ["volume.nii.gz"]
        shutil.rmtree(folder)
        return "one of the two"


def mounted(folder, size):
    """Whether a file system of this size in memory could be mounted there."""
    done = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", folder], capture_output=True, check=False
    )
    return done.returncode == 0


def prepare(inputs, names):
    """Makes small inputs of all commands."""
    from support.example_organs import organ

    import palpate as pp

    views = pp.circular_views(pp.Panel((64, 64), (1.8, 1.8), (-56.7, -56.7, 0)), radius=150, height=600, count=6)
    pp.write_scan(inputs / "scan.h5", pp.simulate_scan(pp.slab_phantom(), views, 5000, seed=4))
    tissue = organ(6)
    pp.write_tissue(inputs / "tissue.vtu", tissue)
    pp.write_mesh(inputs / "kidney.vtu", tissue.mesh)
    session = pp.Session(pp.model(tissue, "blocks"), radius=12.0, sweeps=4)
    session.step([pp.Command(True, (0, 0, 25), (0, 0, -0.002 * (k % 800))) for k in range(1500)])
    pp.write_record(inputs / "session.h5", session.record())
    if {"segment", "mesh"} & set(names):
        run = Run(["demo", "kidney", "--no-browser", "-o", "demo"], inputs)
        assert run.end()[0] == 0, run.said
        for name in ("ct.nii.gz", "labels.nii.gz"):
            shutil.copy(inputs / "demo" / name, inputs / name)


def run(counts, seed, names=tuple(COMMANDS), seconds=2.0, workers=2):
    """What came of how many trials, the failures, and the longest time that a Ctrl-C took, s. counts: trials by kind."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a runner in the background may have it ignored
    with tempfile.TemporaryDirectory() as folder:
        trials = Trials(folder, list(names), seconds)
        todo = [(kind, names[k % len(names)], k) for kind, count in counts.items() for k in range(count)]
        todo = [("together", "reconstruct", k) if kind == "together" else (kind, name, k) for kind, name, k in todo]
        np.random.default_rng(seed).shuffle(todo)
        with ThreadPoolExecutor(workers) as pool:
            for kind, name, k in todo:
                kinds = ("interrupt", "kill", "full_disk", "together")
                pool.submit(trials.trial, str(kind), str(name), [seed, kinds.index(kind), int(k)])
        return trials.told, trials.failures, trials.slowest


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--interrupts", type=int, default=500)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--full-disks", type=int, default=100)
    parser.add_argument("--together", type=int, default=5)
    parser.add_argument("--commands", default=",".join(COMMANDS), help="of " + ", ".join(COMMANDS))
    parser.add_argument("--seconds", type=float, default=2.0, help="that a command may take to end after Ctrl-C")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--report", type=Path, help="file for what is printed, such as docs/figures/interruptions.txt")
    given = parser.parse_args()
    began = time.monotonic()
    counts = {
        "interrupt": given.interrupts, "kill": given.kills, "full_disk": given.full_disks, "together": given.together,
    }  # fmt: skip
    told, failures, slowest = run(counts, given.seed, tuple(given.commands.split(",")), given.seconds, given.workers)
    minutes = (time.monotonic() - began) / 60
    lines = [
        *(f"{times:6d}  {name}" for name, times in sorted(told.items())),
        *failures,
        f"{given.interrupts} Ctrl-C, {given.kills} SIGKILL, {given.full_disks} full disks, seed {given.seed}: "
        f"{len(failures)} failures in {minutes:.0f} minutes; the slowest end after Ctrl-C took {slowest:.2f} s",
    ]
    print("\n".join(lines))
    if given.report:
        given.report.write_text("\n".join(lines) + "\n")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
