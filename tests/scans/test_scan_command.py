"""`palpate scan` at the command line: what works, and that a refusal is one line which touches nothing."""

import hashlib
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

HERE = {**os.environ, "PYTHONPATH": str(Path(pp.__file__).parents[1])}  # the package that is tested, from any folder
SMALL = ["--pixels", "40", "50", "--pitch", "3"]


def palpate(*words, cwd):
    return subprocess.run(
        [sys.executable, "-m", "palpate", *map(str, words)],
        cwd=cwd,
        env=HERE,
        capture_output=True,
        text=True,
        timeout=120,
    )


def state(folder):
    """Names and contents of all files."""
    return {
        str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.rglob("*") if p.is_file()
    }


def test_a_sample_is_imported_into_a_file_that_h5py_reads(tmp_path):
    done = palpate("scan", "import", "breast", "-o", "breast.h5", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "7 views of 170 x 615 pixels, 100.0% measured, incident 42857.1" in done.stdout
    with h5py.File(tmp_path / "breast.h5") as f:
        assert f["counts"].shape == (7, 170, 615)
        assert np.isclose(f["incident"][()], 42857.142857).all()


def test_intensities_are_said_to_be_none_of_photons(tmp_path):
    done = palpate("scan", "import", "head", "-o", "head.h5", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "11 views" in done.stdout
    assert "intensities, not photon counts" in done.stdout


def test_from_template_to_scan(tmp_path):
    assert palpate("scan", "template", "--motion", "free", "-o", "g.yaml", cwd=tmp_path).returncode == 0
    text = (tmp_path / "g.yaml").read_text().replace("[512, 512] ", "[6, 7] ")
    (tmp_path / "g.yaml").write_text(text)
    np.save(tmp_path / "s.npy", np.full((3, 6, 7), 900))
    done = palpate("scan", "import", "s.npy", "--geometry", "g.yaml", "-o", "s.h5", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert pp.read_scan(tmp_path / "s.h5").counts.min() == 900


def test_a_template_on_the_screen_is_the_one_in_the_file(tmp_path):
    screen = palpate("scan", "template", "--motion", "rotating", cwd=tmp_path)
    palpate("scan", "template", "--motion", "rotating", "-o", "g.yaml", cwd=tmp_path)
    assert screen.stdout == (tmp_path / "g.yaml").read_text()


@pytest.mark.parametrize("motion", ["circular", "linear", "hypocycloid", "arc", "rotating"])
def test_every_motion_is_simulated_and_again_with_the_same_seed(tmp_path, motion):
    words = ["scan", "simulate", "--motion", motion, "--views", 3, "--incident", 900, "--seed", 5, *SMALL]
    for name in ("a.h5", "b.h5"):
        done = palpate(*words, "-o", name, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    a, b = (pp.read_scan(tmp_path / n).counts for n in ("a.h5", "b.h5"))
    assert a.shape == (3, 40, 50)
    assert np.array_equal(a, b)
    assert a.min() < 500 < a.max()  # there is an object, and air beside it


def test_the_phantom_itself_is_written_as_truth(tmp_path):
    done = palpate("scan", "simulate", "--no-noise", *SMALL, "-o", "s.h5", "--truth", "t.nii.gz", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    image = nibabel.load(tmp_path / "t.nii.gz")
    assert np.allclose(image.header.get_zooms(), 1)
    assert image.get_fdata().max() == pytest.approx(0.05, rel=1e-3)


def prepare(folder):
    (folder / "file").write_text("kept")
    (folder / "s.h5").write_text("an older result")
    (folder / "g.yaml").write_text(
        "incident: 9\npanel: {shape: [4, 5], pitch: [1, 1], centre: [0, 0, 0]}\n"
        "views: {motion: arc, angles: [-10, 0, 10], radius: 600}\n"
    )
    np.save(folder / "bad.npy", np.full((3, 4, 5), -1.0))
    np.save(folder / "good.npy", np.full((3, 4, 5), 5.0))
    (folder / "far.yaml").write_text((folder / "g.yaml").read_text().replace("600", "60_000"))
    (folder / "none.yaml").write_text((folder / "g.yaml").read_text().replace("incident: 9", "incident: 0"))


IMPORT = ("scan", "import")
REFUSED = {
    "missing stack": ([*IMPORT, "none.tif", "--geometry", "g.yaml", "-o", "s.h5"], ["none.tif", "no such file"]),
    "missing geometry": ([*IMPORT, "good.npy", "--geometry", "no.yaml", "-o", "s.h5"], ["no.yaml", "no such file"]),
    "no geometry": ([*IMPORT, "good.npy", "-o", "s.h5"], ["good.npy", "palpate scan template"]),
    "negative counts": ([*IMPORT, "bad.npy", "--geometry", "g.yaml", "-o", "s.h5"], ["bad.npy", "60", "-1", "offset"]),
    "zero incident": (
        [*IMPORT, "good.npy", "--geometry", "none.yaml", "-o", "s.h5"],
        ["incident", "0 or less", "mask"],
    ),
    "60 m": ([*IMPORT, "good.npy", "--geometry", "far.yaml", "-o", "s.h5"], ["far.yaml", "60", "check the units"]),
    "no folder": ([*IMPORT, "breast", "-o", "none/s.h5"], ["none", "does not exist", "mkdir -p none"]),
    "not writable": ([*IMPORT, "breast", "-o", "/proc/s.h5"], ["/proc", "not writable", "another folder"]),
    "under a file": ([*IMPORT, "breast", "-o", "file/s.h5"], ["file", "does not exist"]),
    "a folder": ([*IMPORT, "breast", "-o", "."], ["is a folder", "name a file"]),
    "free": (["scan", "simulate", "--motion", "free", "-o", "s.h5"], ["'free'", "circular"]),
    "no views": (["scan", "simulate", "--views", 0, "-o", "s.h5"], ["--views", "at least 1", "0"]),
    "no photons": (["scan", "simulate", "--incident", 0, *SMALL, "-o", "s.h5"], ["incident", "0 or less"]),
    "truth folder": (["scan", "simulate", *SMALL, "-o", "s.h5", "--truth", "none/t.nii"], ["none", "does not exist"]),
    "truth format": (["scan", "simulate", *SMALL, "-o", "s.h5", "--truth", "t.png"], ["t.png", ".nii.gz"]),
    "template": (["scan", "template", "-o", "none/g.yaml"], ["none", "does not exist"]),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_in_one_line_and_nothing_is_touched(tmp_path, case):
    words, said = REFUSED[case]
    prepare(tmp_path)
    before = state(tmp_path)
    done = palpate(*words, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("palpate: ")
    assert len(done.stderr.strip().splitlines()) == 1
    for word in said:
        assert word in done.stderr
    assert state(tmp_path) == before


def test_a_killed_run_leaves_the_old_file_whole(tmp_path):
    path = tmp_path / "s.h5"
    palpate("scan", "simulate", "--views", 2, *SMALL, "-o", "s.h5", cwd=tmp_path)
    old = path.read_bytes()
    words = [
        sys.executable,
        "-m",
        "palpate",
        "scan",
        "simulate",
        "--views",
        "8",
        "--pixels",
        "300",
        "300",
        "-o",
        "s.h5",
    ]
    for wait in np.random.default_rng(0).uniform(0.2, 1.6, 4):
        run = subprocess.Popen(words, cwd=tmp_path, env=HERE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(wait)
        os.kill(run.pid, signal.SIGKILL)
        run.wait()
        if path.read_bytes() != old:  # it was done before it was killed: then it is the whole new scan
            assert pp.read_scan(path).shape == (8, 300, 300)
            old = path.read_bytes()
