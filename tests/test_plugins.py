"""Parts of a user's own, registered by the examples: each does what no built-in does, and runs through the commands."""

import importlib.util
import shutil
import struct
import subprocess
import sys
import threading
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
from support.example_organs import organ
from support.running_server import HERE, ended, interrupted, start, until

import palpate as pp
from palpate import plugins
from palpate.errors import DataError, FileError
from palpate.haptics.discovery import DEVICES, open_device
from palpate.simulation.session_journal import read_journal
from palpate.tissue.models.registry import names_in_sessions
from palpate.volumes.io import DICOM, FORMATS

EXAMPLES = Path(__file__).parents[1] / "examples"


def plugin(name):
    return f"--plugin {EXAMPLES / name}.py"


@pytest.fixture
def example(monkeypatch):
    """Loads an example; what it registers is gone after the test."""
    monkeypatch.setattr(plugins, "_registered", {kind: {} for kind in plugins.BUILT_IN})

    def load(name):
        spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    return load


def test_the_names_of_built_in_parts_are_those_that_there_are():
    assert plugins.BUILT_IN["device"] == tuple(DEVICES)
    assert plugins.BUILT_IN["tissue_model"] == names_in_sessions()
    assert set(plugins.BUILT_IN["reader"]) == {*FORMATS, *DICOM, ".h5"}
    scan = pp.Scan(np.full((1, 3, 3), 9.0), 20.0, pp.Views([(0, 0, 99)], pp.Panel((3, 3), (1, 1), (-1, -1, 0))))
    for name in plugins.BUILT_IN["optimizer"]:
        *_, last = pp.iterates(scan, pp.Grid((1, 3, 3), (1, 1, 1), (-1, -1, 1)), optimizer=name, levels=1, iterations=2)
        assert np.isfinite(last.objective)


@pytest.mark.parametrize("kind", ["optimizer", "tissue_model", "device", "segmenter", "reader"])
def test_a_built_in_name_is_refused(kind):
    with pytest.raises(DataError, match="is built in; choose another name"):
        getattr(pp, f"register_{kind}")(plugins.BUILT_IN[kind][0])


def test_an_own_optimizer_reaches_the_minimum(example):
    own, built_in = (example("own_optimizer").main()[name] for name in ("spectral-gradient", "momentum"))
    assert own == pytest.approx(built_in, rel=1e-4)


LEVEL = """
import h5py, sys
file = h5py.File(sys.argv[1])
print(file.attrs["level"] if "state" in file and file.attrs["iteration"] > 3 else -1)
"""


def test_an_own_optimizer_resumes_to_the_bit_through_the_command(tmp_path):
    panel = pp.Panel((50, 70), (1, 1), (-34.5, -24.5, 0))
    views = pp.arc_views(panel, [-20, -7, 7, 20], radius=500, pivot=(0, 0, 20))
    body = pp.Phantom([(pp.Ellipsoid((0, 0, 15), (20, 14, 9)), 0.02)])
    pp.write_scan(tmp_path / "scan.h5", pp.simulate_scan(body, views, incident=5000, seed=1))
    words = f"{plugin('own_optimizer')} reconstruct scan.h5 --thickness 30 --spacing 1 --levels 2 --iterations 200"
    words += " --tolerance 0 --checkpoint-every 1 --optimizer spectral-gradient -o"
    assert ended(f"{words} whole.nii.gz", tmp_path)[0] == 0
    checkpoint = tmp_path / "parts.nii.gz.checkpoint.h5"

    def on_the_finest_level():
        done = subprocess.run(
            [sys.executable, "-c", LEVEL, str(checkpoint)], capture_output=True, env=HERE, check=False
        )
        return done.stdout.strip() == b"0"

    code, _, said = interrupted(start(f"{words} parts.nii.gz", tmp_path), on_the_finest_level)
    assert code == 130, said
    code, _, said = ended(f"{words} parts.nii.gz --resume", tmp_path)
    assert code == 0, said
    whole, parts = (pp.read_volume(tmp_path / f"{name}.nii.gz").values for name in ("whole", "parts"))
    assert whole.tobytes() == parts.tobytes()


def test_an_unknown_optimizer_is_refused_with_the_names_that_there_are(example, tmp_path):
    example("own_optimizer")
    with pytest.raises(DataError, match="choose from auto, momentum, descent, subsets, spectral-gradient"):
        pp.iterates(None, None, levels=1, optimizer="newton")
    assert "no such Python file" in ended("--plugin missing.py doctor", tmp_path)[2]


def test_an_own_segmenter_finds_what_noise_hides_from_thresholds(example, tmp_path):
    module = example("own_segmenter")
    overlap = module.main()
    assert overlap["total-variation"] > 0.95 > 0.5 > overlap["threshold"]
    volume, ball = module.noisy_ball()
    pp.write_volume(tmp_path / "ball.nii.gz", volume)
    words = f"{plugin('own_segmenter')} segment ball.nii.gz -o labels.nii.gz --method total-variation --largest"
    code, out, said = ended(words, tmp_path)
    assert code == 0, said
    found = pp.read_labels(tmp_path / "labels.nii.gz").values > 0
    assert np.count_nonzero(found) * 1e-3 == pytest.approx(float(out.split(" ml")[0].split()[-1]), abs=0.01)
    assert np.count_nonzero(found) == pytest.approx(np.count_nonzero(ball), rel=0.05)
    with pytest.raises(DataError, match="takes no thresholds"):
        pp.segment(volume, 0.02, method="total-variation")
    with pytest.raises(DataError, match="choose from threshold, total-variation"):
        pp.segment(volume, method="neural")


def mrc(path, values, cell):
    """Writes an MRC file, independently of the example. cell: (x, y, z) of the whole box, in angstroms."""
    nz, ny, nx = values.shape
    header = struct.pack("<10i", nx, ny, nz, 2, 0, 0, 0, nx, ny, nz) + struct.pack("<6f", *cell, 90, 90, 90)
    header += struct.pack("<3i", 1, 2, 3) + struct.pack("<3f", 0, 0, 0) + struct.pack("<2i", 1, 0)
    header = header.ljust(196, b"\0") + struct.pack("<3f", -2e7, 0, 1e7) + b"MAP "
    path.write_bytes(header.ljust(1024, b"\0") + values.astype("<f4").tobytes())


def test_an_own_reader_serves_the_commands(tmp_path):
    """A ball of 5 mm in a file of another kind of microscope: its volume and its place."""
    z, y, x = np.indices((20, 24, 30))
    ball = (0.5 * (x - 14)) ** 2 + (0.5 * (y - 12)) ** 2 + (1.0 * (z - 9)) ** 2 < 25
    mrc(tmp_path / "ball.mrc", 1.0 * ball, (30 * 0.5e7, 24 * 0.5e7, 20 * 1e7))
    code, out, said = ended(f"{plugin('own_reader')} segment ball.mrc -o labels.nii.gz --lower 0.5", tmp_path)
    assert code == 0, said
    assert float(out.split(" ml")[0].split()[-1]) == pytest.approx(4 / 3 * np.pi * 0.125, rel=0.05)
    labels = pp.read_labels(tmp_path / "labels.nii.gz")
    assert labels.grid.points(np.argwhere(labels.values > 0)).mean(axis=0) == pytest.approx((5, 6, 10), abs=1e-3)


def test_an_own_reader_is_asked_for_what_is_wanted(example, tmp_path):
    example("own_reader")
    mrc(tmp_path / "ball.MRC", np.ones((2, 2, 2)), (2e7, 2e7, 2e7))
    assert pp.read_volume(tmp_path / "ball.MRC").unit == "MRC"
    with pytest.raises(FileError, match="returns Volume, expected Scan"):
        pp.read_scan(tmp_path / "ball.MRC")
    with pytest.raises(FileError, match="no such file"):
        pp.read_volume(tmp_path / "none.mrc")
    with pytest.raises(DataError, match="begins with a dot"):
        pp.register_reader("mrc")


def test_a_mass_comes_to_rest_where_the_tissue_carries_its_weight(example):
    """The force of an own device is its weight, and the depth is that of finite elements under this force."""
    module = example("own_device")
    weight, force, frame = module.main()
    assert force == pytest.approx(weight, rel=0.03)
    tissue = module.soft_ball()
    corner = tissue.mesh.nodes[tissue.mesh.surface]
    radius = 2 * np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).mean()
    push = pp.finite_elements(tissue).push(frame.point[0], frame.displacement[0], radius)
    assert frame.displacement[0][2] < -0.5  # mm
    assert push.force[2] == pytest.approx(weight, rel=0.03)


def rests(journal):
    """Whether the device of a session that is being recorded has sunk and then not moved for a second."""
    time.sleep(0.5)
    if not journal.exists():
        return False
    copy = shutil.copy(journal, journal.with_name("copy.h5.journal"))
    if read_journal(copy) is None:  # a busy machine: no digest yet
        return False
    with warnings.catch_warnings(action="ignore", category=UserWarning):  # that it is cut short
        record = pp.read_record(journal.with_name("copy.h5"))
    height = record.points[record.ticks > record.length - 1000, 2]
    return len(height) > 100 and height[0] < record.points[0, 2] - 10 and np.ptp(height) < 0.03


def test_an_own_device_runs_through_the_command(tmp_path):
    tissue = organ(5)
    pp.write_tissue(tmp_path / "tissue.vtu", tissue)
    words = f"{plugin('own_device')} touch tissue.vtu --device falling-mass:0.03 --record session.h5 --model compliance"
    run = start(words, tmp_path)
    assert "http://127.0.0.1:" in run.stdout.readline()
    code, _, said = interrupted(run, lambda: rests(tmp_path / "session.h5.journal"))
    assert code == 0, said
    felt = np.asarray(pp.score(pp.read_record(tmp_path / "session.h5"), tissue).force)
    # The servo shows the tissue's force, and less where a busy machine has made it give energy to the hand: at rest what it
    # shows is the weight.
    assert 0.95 * 0.03 * 9.81 < np.median(felt[-100:]) < 2 * 0.03 * 9.81


def test_the_force_is_zero_after_an_own_device_fails(example):
    module = example("own_device")
    given = []

    class Broken(module.FallingMass):
        def read(self):
            if len(given) > 50:
                raise OSError("unplugged")
            return super().read()

        def write(self, force):
            given.append(force)

    pp.register_device("broken")(Broken)
    device = open_device("broken", organ(5).mesh)
    failures = []
    before, threading.excepthook = threading.excepthook, lambda told: failures.append(told.exc_value)
    try:
        with device:
            until(lambda: failures)
    finally:
        threading.excepthook = before
    assert isinstance(failures[0], OSError)
    assert (given[-1] == 0).all()
    assert device.status().zeroed


def test_an_entry_point_is_found_and_named_by_doctor(tmp_path):
    """As an installed package declares it."""
    (tmp_path / "shrinking.py").write_text("class Shrinking:\n    pass\n")
    info = tmp_path / "shrinking-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: shrinking\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[palpate.optimizers]\nshrinking = shrinking:Shrinking\n")
    code = "from palpate import plugins; print(plugins.part('optimizer', 'shrinking').__name__)"
    here = HERE | {"PYTHONPATH": f"{tmp_path}:{HERE['PYTHONPATH']}"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=here, check=False)
    assert done.stdout.strip() == "Shrinking", done.stderr
    words = [sys.executable, "-m", "palpate", "--plugin", EXAMPLES / "own_segmenter.py", "doctor"]
    done = subprocess.run(words, capture_output=True, text=True, env=here, check=False)
    assert "plugins: optimizer shrinking, segmenter total-variation" in done.stdout
