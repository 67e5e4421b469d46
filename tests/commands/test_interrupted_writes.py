"""Runs that are killed: what bears a final name is whole, the rest is tidied, and the next run goes on."""

import contextlib
import os
import signal
import subprocess
import sys
import time

import h5py
import nibabel
import numpy as np
import pytest
from support.running_server import ended, interrupted, start, until

import palpate as pp
from palpate import atomic_write

MOMENTS = np.random.default_rng(2).uniform(1.3, 3.6, 4)  # s after the start; the first second is Python's own
# Two levels of 20 iterations, each kept. Random moments of this command are in test_reconstruct_command.
RECONSTRUCT = (
    "reconstruct scan.h5 -o volume.nii.gz --thickness 30 --spacing 1.4 --levels 2 --iterations 20 --tolerance 0 "
    "--checkpoint-every 1"
)


def finish(words, folder):
    code, out, err = ended(words, folder)
    assert code == 0, out + err
    assert abandoned(folder) == [], "a run that ends well tidies up after those that were killed"


def kill(words, folder, after):
    """Starts a run and kills it after so many seconds, or as soon as a function of the folder is true."""
    run = start(words, folder)
    if callable(after):
        until(lambda: after(folder) or run.poll() is not None)
    else:
        time.sleep(after)
    run.kill()  # SIGKILL
    run.communicate()
    return run.returncode


def abandoned(folder):
    return [p.name for p in folder.iterdir() if ".part-" in p.name]


def half_written(folder):
    """Is a file being written there just now?"""
    with contextlib.suppress(FileNotFoundError):  # it may be done between two looks
        return any((folder / name).stat().st_size for name in abandoned(folder))
    return False


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
        elif name == "demo.txt":
            assert path.read_text() == f"kidney, palpate {pp.__version__}\n"
        elif name.endswith(".html"):
            assert path.read_text().rstrip().endswith("</html>")
        else:
            pytest.fail(f"{name} is no file of this run")
    return names


@pytest.fixture(scope="module")
def scanned(tmp_path_factory):
    """A folder with a scan, and the bytes of the volume that an uninterrupted run makes of it."""
    folder = tmp_path_factory.mktemp("scan")
    views = pp.circular_views(pp.Panel((64, 64), (1.8, 1.8), (-56.7, -56.7, 0)), radius=150, height=600, count=6)
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


def test_reconstruct_killed_in_the_middle_of_a_write_leaves_the_older_file(scanned, folder):
    kill(RECONSTRUCT, folder, lambda f: checkpoint_of(f) and half_written(f))
    read_whole(folder)
    finish(resumed(folder), folder)
    assert (folder / "volume.nii.gz").read_bytes() == scanned[1]


def test_a_checkpoint_of_another_run_is_refused_by_what_differs(scanned, folder):
    kill(RECONSTRUCT, folder, checkpoint_of)
    before = checkpoint_of(folder).read_bytes()
    code, _, said = ended(RECONSTRUCT.replace("--spacing 1.4", "--spacing 1.6") + " --resume", folder)
    assert code == 2
    for part in (checkpoint_of(folder).name, "grid was", "1.4", "now", "1.6", "leave out --resume"):
        assert part in said, said
    assert checkpoint_of(folder).read_bytes() == before


DEMO = "demo kidney --no-browser -o demo"
MADE = ["ct.nii.gz", "demo.txt", "kidney.vtu", "labels.nii.gz", "report.html", "tissue.vtu"]


def test_demo_killed_at_random_moments_and_in_a_write_goes_on_to_the_end(tmp_path):
    demo = tmp_path / "demo"
    kill(f"{DEMO} --resume", tmp_path, lambda f: (demo / "demo.txt").exists() and half_written(demo))
    assert abandoned(demo) != []
    assert read_whole(demo) == ["demo.txt"]
    for moment in MOMENTS:
        kill(f"{DEMO} --resume", tmp_path, moment)
        assert set(read_whole(demo)) <= set(MADE)
    code, out, err = ended(f"{DEMO} --resume", tmp_path)
    assert code == 0, err
    assert read_whole(demo) == MADE
    assert abandoned(demo) == []
    assert str(demo / "report.html") in out
    tissue = pp.read_tissue(demo / "tissue.vtu")
    assert np.array_equal(tissue.mesh.nodes, pp.read_mesh(demo / "kidney.vtu").nodes)


def test_interrupted_demo_says_how_to_go_on(tmp_path):
    run = start(DEMO, tmp_path)
    code, _, said = interrupted(run, (tmp_path / "demo" / "ct.nii.gz").exists)
    assert code == 130
    assert "palpate demo kidney --resume -o demo --no-browser" in said
    assert abandoned(tmp_path / "demo") == []
    read_whole(tmp_path / "demo")


def test_an_interrupt_waits_until_the_file_is_whole(tmp_path):
    with pytest.raises(KeyboardInterrupt), atomic_write.replacing(tmp_path / "outer") as outer:  # noqa: PT012
        with atomic_write.replacing(outer) as temporary:
            signal.raise_signal(signal.SIGINT)
            temporary.write_text("whole")
        assert outer.read_text() == "whole"
    assert [p.name for p in tmp_path.iterdir()] == ["outer"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_second_interrupt_does_not_wait(tmp_path):
    (tmp_path / "old").write_text("old")
    with pytest.raises(KeyboardInterrupt), atomic_write.replacing(tmp_path / "old") as temporary:  # noqa: PT012
        temporary.write_text("half")
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
    assert (tmp_path / "old").read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["old"]


def test_only_what_dead_processes_left_of_the_same_file_is_removed(tmp_path):
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    target = tmp_path / "v.nii.gz"

    def left(process, name="v.nii.gz", host=None):
        path = tmp_path / f".{name}.part-{host or atomic_write._host()}-{process}-01234567.nii.gz"
        path.write_text("half")
        return path

    inner = (
        tmp_path
        / f"..v.nii.gz.part-{atomic_write._host()}-{dead.pid}-0.nii.gz.part-{atomic_write._host()}-{dead.pid}-1.nii.gz"
    )
    inner.write_text("half")
    gone = [left(dead.pid), inner]
    kept = [left(os.getpid()), left(dead.pid, name="w.nii.gz"), left(dead.pid, host="00000000")]
    with atomic_write.replacing(target) as temporary:
        assert temporary.name.endswith(".nii.gz")
        temporary.write_text("whole")
    assert target.read_text() == "whole"
    assert not any(p.exists() for p in gone)
    assert all(p.exists() for p in kept)
    assert sorted(tmp_path.iterdir()) == sorted([target, *kept])
