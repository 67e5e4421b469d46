"""Runs that are killed: what bears a final name is whole, the rest is tidied, and the next run goes on."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import nibabel
import numpy as np
import pytest

import palpate as pp
from palpate import atomic

HERE = {**os.environ, "PYTHONPATH": str(Path(pp.__file__).parents[1])}
MOMENTS = np.random.default_rng(2).uniform(0.3, 2.6, 10)  # s after the start; the first second is Python's own
# Two levels of 40 iterations, each kept: some three seconds of work.
RECONSTRUCT = (
    "reconstruct scan.h5 -o volume.nii.gz --thickness 30 --spacing 0.7 --levels 2 --iterations 40 --tolerance 0 "
    "--checkpoint-every 1"
)


def start(words, folder):
    return subprocess.Popen(
        [sys.executable, "-m", "palpate", *words.split()],
        cwd=folder,
        env=HERE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(words, folder):
    run = start(words, folder)
    out, err = run.communicate(timeout=180)
    assert run.returncode == 0, out + err
    assert abandoned(folder) == [], "a run that ends well tidies up after those that were killed"


def kill(words, folder, after):
    """Starts a run and kills it after so many seconds, or as soon as a function of the folder is true."""
    run = start(words, folder)
    if callable(after):
        until(lambda: after(folder) or run.poll() is not None)
    else:
        time.sleep(after)
    os.kill(run.pid, signal.SIGKILL)
    run.communicate()
    return run.returncode


def until(true, seconds=60):
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.001)


def abandoned(folder):
    return [p.name for p in folder.iterdir() if ".part-" in p.name]


def read_whole(folder):
    """Reads every file that bears a final name with a reader that is not ours, to its end; gives their names."""
    names = sorted(p.name for p in folder.iterdir() if ".part-" not in p.name)
    for name in names:
        path = folder / name
        if name.endswith(".nii.gz"):
            assert np.isfinite(np.asarray(nibabel.load(path).dataobj)).all()
        elif name.endswith(".h5"):
            with h5py.File(path) as file:
                file.visititems(lambda key, item: item[()] if isinstance(item, h5py.Dataset) else None)
        elif name.endswith(".vtu"):
            assert path.read_text().rstrip().endswith("</VTKFile>")
            assert pp.read_mesh(path).volumes.min() > 0
        elif name.endswith(".html"):
            assert path.read_text().rstrip().endswith("</html>")
        else:
            pytest.fail(f"{name} is no file of this run")
    return names


@pytest.fixture(scope="module")
def scanned(tmp_path_factory):
    """A folder with a scan, and the bytes of the volume that an uninterrupted run makes of it."""
    folder = tmp_path_factory.mktemp("scan")
    views = pp.circular_views(pp.Panel((96, 96), (1.2, 1.2), (-57, -57, 0)), 6, radius=150, height=600)
    pp.write_scan(folder / "scan.h5", pp.simulate_scan(pp.slab_phantom(), views, 5000, seed=4))
    finish(RECONSTRUCT, folder)
    volume = (folder / "volume.nii.gz").read_bytes()
    (folder / "volume.nii.gz").unlink()
    assert [p.name for p in folder.iterdir()] == ["scan.h5"]  # nor a checkpoint is left
    return folder / "scan.h5", volume


@pytest.fixture
def folder(scanned, tmp_path):
    (tmp_path / "scan.h5").write_bytes(scanned[0].read_bytes())
    return tmp_path


def checkpoint_of(folder):
    return next((p for p in folder.glob("*checkpoint*") if ".part-" not in p.name), None)


def resumed(folder):
    """The command, going on if there is something to go on from."""
    return RECONSTRUCT + (" --resume" if checkpoint_of(folder) else "")


def test_reconstruct_killed_at_random_moments_goes_on_to_the_same_bits(scanned, folder):
    went_on = 0
    for moment in MOMENTS[:6]:
        went_on += checkpoint_of(folder) is not None
        kill(resumed(folder), folder, moment)
        if "volume.nii.gz" in read_whole(folder):  # it was done before it was killed: begin again
            assert (folder / "volume.nii.gz").read_bytes() == scanned[1]
            (folder / "volume.nii.gz").unlink()
    finish(resumed(folder), folder)
    assert (folder / "volume.nii.gz").read_bytes() == scanned[1]
    assert went_on > 0, "no kill fell between two iterations"


def test_reconstruct_killed_in_the_middle_of_a_write_leaves_the_older_file(scanned, folder):
    kill(RECONSTRUCT, folder, lambda f: checkpoint_of(f) and abandoned(f))
    read_whole(folder)
    finish(resumed(folder), folder)
    assert (folder / "volume.nii.gz").read_bytes() == scanned[1]


def test_interrupted_reconstruct_keeps_its_iterate_and_says_how_to_go_on(scanned, folder):
    run = start(RECONSTRUCT, folder)
    until(lambda: checkpoint_of(folder))
    run.send_signal(signal.SIGINT)
    _, said = run.communicate(timeout=60)
    assert run.returncode == 130, said
    assert "--resume" in said
    assert checkpoint_of(folder).name in said
    assert "Traceback" not in said
    assert abandoned(folder) == []
    assert read_whole(folder) == sorted(["scan.h5", checkpoint_of(folder).name])
    finish(resumed(folder), folder)
    assert (folder / "volume.nii.gz").read_bytes() == scanned[1]
    assert checkpoint_of(folder) is None


def test_a_checkpoint_of_another_run_is_refused_by_what_differs(scanned, folder):
    kill(RECONSTRUCT, folder, checkpoint_of)
    before = checkpoint_of(folder).read_bytes()
    run = start(RECONSTRUCT.replace("--spacing 0.7", "--spacing 0.8") + " --resume", folder)
    _, said = run.communicate(timeout=60)
    assert run.returncode == 2
    for part in (checkpoint_of(folder).name, "grid was", "0.7", "now", "0.8", "leave out --resume"):
        assert part in said, said
    assert checkpoint_of(folder).read_bytes() == before


DEMO = "demo kidney --no-browser -o demo"
MADE = ["ct.nii.gz", "kidney.vtu", "labels.nii.gz", "report.html", "tissue.vtu"]


def test_demo_killed_at_random_moments_and_in_a_write_goes_on_to_the_end(tmp_path):
    demo = tmp_path / "demo"
    moments = [lambda f: demo.exists() and abandoned(demo), *(1 + MOMENTS[6:])]
    for moment in moments:
        kill(f"{DEMO} --resume", tmp_path, moment)
        assert set(read_whole(demo)) <= set(MADE)
    run = start(f"{DEMO} --resume", tmp_path)
    out, err = run.communicate(timeout=180)
    assert run.returncode == 0, err
    assert read_whole(demo) == MADE
    assert abandoned(demo) == []
    assert str(demo / "report.html") in out
    tissue = pp.read_tissue(demo / "tissue.vtu")
    assert np.array_equal(tissue.mesh.nodes, pp.read_mesh(demo / "kidney.vtu").nodes)


def test_interrupted_demo_says_how_to_go_on(tmp_path):
    run = start(DEMO, tmp_path)
    until(lambda: (tmp_path / "demo" / "ct.nii.gz").exists())
    run.send_signal(signal.SIGINT)
    _, said = run.communicate(timeout=60)
    assert run.returncode == 130
    assert "palpate demo kidney --resume -o demo --no-browser" in said
    assert "Traceback" not in said
    assert abandoned(tmp_path / "demo") == []
    read_whole(tmp_path / "demo")


def test_only_what_dead_processes_left_of_the_same_file_is_removed(tmp_path):
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    target = tmp_path / "v.nii.gz"

    def left(process, name="v.nii.gz", host=None):
        path = tmp_path / f".{name}.part-{host or atomic._host()}-{process}-01234567.nii.gz"
        path.write_text("half")
        return path

    inner = tmp_path / f"..v.nii.gz.part-{atomic._host()}-{dead.pid}-0.nii.gz.part-{atomic._host()}-{dead.pid}-1.nii.gz"
    inner.write_text("half")
    gone = [left(dead.pid), inner]
    kept = [left(os.getpid()), left(dead.pid, name="w.nii.gz"), left(dead.pid, host="00000000")]
    with atomic.replacing(target) as temporary:
        assert temporary.name.endswith(".nii.gz")
        temporary.write_text("whole")
    assert target.read_text() == "whole"
    assert not any(p.exists() for p in gone)
    assert all(p.exists() for p in kept)
    assert sorted(tmp_path.iterdir()) == sorted([target, *kept])
