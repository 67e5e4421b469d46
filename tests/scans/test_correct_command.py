"""`palpate scan correct`: files in, a scan and a picture out; what is refused is one line, and nothing is touched."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
import tifffile
from PIL import Image
from support.dicom_files import RADIOGRAPH, view
from support.raw_detector import raw_case
from typer.testing import CliRunner

import palpate as pp
from palpate.commands import app
from palpate.errors import DataError, FileError, PalpateError
from palpate.scans.geometry_file import read_geometry
from palpate.scans.raw_frames import parse_lag, read_by_view, read_frames, read_mask, read_raw

SHAPE = (96, 120)
GEOMETRY = """
incident: estimate
panel: {shape: [96, 120], pitch: [2, 2], centre: [0, 0, -100]}
blur: {panel: 2.5, at: 20}
views: {motion: rotating, angles: {first: -20, last: 20, count: 9}, source: [0, 0, 900], pivot: [0, 0, 0]}
"""
HERE = {**os.environ, "PYTHONPATH": str(Path(pp.__file__).parents[1])}
WORDS = ["scan", "correct", "raw", "-o", "scan.h5", "--geometry", "g.yaml", "--dark", "dark.tif", "--flat", "flat.tif"]


@pytest.fixture(scope="module")
def case():
    return raw_case(13, SHAPE)


@pytest.fixture
def folder(case, tmp_path, monkeypatch):
    """The files of a raw scan, and an older result."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "raw").mkdir()
    for k, frame in enumerate(case.raw):
        tifffile.imwrite(tmp_path / "raw" / f"view_{k + 5}.tif", digital(frame))
    for name in ("dark", "flat"):
        tifffile.imwrite(tmp_path / f"{name}.tif", digital(getattr(case, name)))
    (tmp_path / "dose.csv").write_text(
        "view,mGy\n" + "".join(f"{k},{2.5 * d:.6f}\n" for k, d in enumerate(case.dose)) + "flat,2.5\n"
    )
    (tmp_path / "g.yaml").write_text(GEOMETRY)
    (tmp_path / "scan.h5").write_text("an older result")
    return tmp_path


def digital(frames):
    return np.round(frames).astype(np.uint16)


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def error_of(scan, case):
    return float(np.sqrt(np.mean((pp.line_integrals(scan) - pp.line_integrals(case.clean))[scan.mask] ** 2)))


def test_from_files_to_a_scan_and_a_picture(folder, case):
    done = run(*WORDS, "--lag", 0.03, "--dose", "dose.csv", "--plot", "correct.png")
    assert done.exit_code == 0, done.output
    scan = pp.read_scan("scan.h5")
    assert error_of(scan, case) < 0.005
    assert scan.blur == pp.Blur(panel=2.5, at=20)
    assert np.array_equal(~scan.mask.all(axis=0), case.detector.dead)
    assert f"bad pixels: {case.detector.dead.sum()} of {case.detector.dead.size}" in done.output
    assert "3 rows, 2 columns" in done.output
    with h5py.File("scan.h5") as file:
        assert file["incident"].shape == scan.shape
    picture = np.asarray(Image.open("correct.png"))
    assert picture.shape[1] > 800
    assert picture.std() > 10


def test_the_lag_is_measured_from_a_file_of_afterglow(folder, case):
    beam = np.broadcast_to(case.incident[0] / case.dose[0], (10, *SHAPE))
    left = case.detector.read(np.concatenate([beam, 0 * beam[:3]]))[10:]
    tifffile.imwrite("glow.tif", digital(left), photometric="minisblack")
    done = run(*WORDS, "--lag", "glow.tif", "--dose", "dose.csv")
    assert done.exit_code == 0, done.output
    assert error_of(pp.read_scan("scan.h5"), case) < 0.005


def test_known_bad_pixels_are_an_image_or_a_list(folder):
    marked = np.zeros(SHAPE, np.uint8)
    marked[40, 50] = 255
    tifffile.imwrite("bad.tif", marked)
    Path("bad.txt").write_text("# row column\n40 50\n")
    g = read_geometry("g.yaml")
    for name in ("bad.tif", "bad.txt"):
        assert np.argwhere(read_mask(Path(name), g, SHAPE)).tolist() == [[40, 50]]
    assert run(*WORDS, "--bad-pixels", "bad.tif").exit_code == 0
    assert not pp.read_scan("scan.h5").mask[:, 40, 50].any()


def test_dark_and_flat_are_stored_as_the_views_may_be(folder, case):
    frames = digital(case.flat)[:3]
    np.save("flat.npy", frames)
    frames.tofile("flat.raw")
    (folder / "flats").mkdir()
    for k, frame in enumerate(frames):
        np.save(folder / "flats" / f"f{k + 9}.npy", frame)
    for name in ("flat.npy", "flat.raw", "flats"):
        (folder / "r.yaml").write_text(GEOMETRY + "stack: {dtype: uint16, shape: [9, 96, 120], files: 'view_*'}\n")
        assert np.array_equal(read_frames("flat", Path(name), read_geometry("r.yaml")), frames), name


def test_dicom_frames_of_a_panel(tmp_path):
    rng = np.random.default_rng(1)
    pixels = rng.integers(100, 4000, (3, 8, 10)).astype(np.uint16)
    for k, (image, angle) in enumerate(zip(pixels, (-10, 0, 10), strict=True)):
        view(tmp_path / f"v{k}.dcm", image, InstanceNumber=k + 1, PositionerPrimaryAngle=angle)
    values, measured, views, g = read_raw(tmp_path)
    assert np.array_equal(values, pixels)
    assert measured.all()
    assert (len(views), g) == (3, None)
    assert np.array_equal(read_frames("flat", tmp_path, None), pixels)
    (tmp_path / "log").mkdir()
    view(tmp_path / "log" / "a.dcm", pixels[0], RADIOGRAPH, PixelIntensityRelationship="LOG", RescaleSlope=0.001)
    with (
        pytest.warns(UserWarning, match="natural logarithms"),
        pytest.raises(DataError, match="LOG, from which no dark"),
    ):
        read_frames("flat", tmp_path / "log", None)
    np.save(tmp_path / "flat.npy", pixels)
    with pytest.raises(FileError, match=r"flat: .* --geometry"):
        read_frames("flat", tmp_path / "flat.npy", None)


def test_lag_is_a_share_or_pairs():
    assert parse_lag("0.03") == pp.Lag.first_order(0.03)
    assert parse_lag("0.02:0.4, 0.01:0.9") == pp.Lag(((0.02, 0.4), (0.01, 0.9)))
    assert parse_lag("glow.tif") is None


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("view,mGy\n0,1\n1,1\nflat,1\n", "no number for view 2"),
        ("0,1\n1,1\n2,1\n", "no line 'flat,number'"),
        ("0,1\n1,1\n2,1\nflat,0\n", "no line 'flat,number' above 0"),
        ("0,1\n1,1\n2,1\n3,1\nflat,1\n", "a view 3"),
        ("0,1\n1,1\n1,1\nflat,1\n", "line 3: a second number for view 1"),
        ("0,1\n1,one\n2,1\nflat,1\n", "line 2: expected 'view,number'"),
    ],
)
def test_a_table_of_doses_that_is_wrong_says_where(tmp_path, table, words):
    (tmp_path / "d.csv").write_text(table)
    with pytest.raises(DataError, match=words):
        read_by_view("dose", tmp_path / "d.csv", 3, flat=True)


def test_doses_are_relative_to_the_flat(tmp_path):
    (tmp_path / "d.csv").write_text("# a note\nview, reading\n2, 3\nflat, 2\n0, 1\n1, 2\n")
    assert read_by_view("dose", tmp_path / "d.csv", 3, flat=True).tolist() == [0.5, 1, 1.5]


def without(*names):
    words = list(WORDS)
    for name in names:
        at = words.index(name)
        del words[at : at + 2]
    return words


REFUSED = {
    "no flat": (without("--flat"), ["--flat", "missing", "scan import"]),
    "no dark": (without("--dark"), ["--dark", "missing", "--dark 0"]),
    "no such flat": ([*without("--flat"), "--flat", "none.tif"], ["flat: none.tif", "no such file"]),
    "swapped": ([*without("--flat", "--dark"), "--flat", "dark.tif", "--dark", "flat.tif"], ["--dark", "exchanged"]),
    "flat is dark": ([*without("--flat"), "--flat", "dark.tif"], ["--flat", "it is the dark"]),
    "flat is a view": ([*without("--flat"), "--flat", "raw/view_9.tif", "--gain", 2], ["--flat", "object"]),
    "no gain": ([*without("--flat"), "--flat", "one.tif"], ["--gain", "one flat tells no noise"]),
    "dose": ([*WORDS, "--dose", "bad.csv"], ["--dose", "bad.csv", "no number for view 1"]),
    "lag": ([*WORDS, "--lag", "3"], ["--lag", "0.03"]),
    "afterglow that is lit": ([*WORDS, "--lag", "flat.tif"], ["afterglow", "beam was on"]),
    "line integrals": ([*without("--geometry"), "--geometry", "l.yaml"], ["l.yaml", "line integrals", "scan import"]),
    "plot": ([*WORDS, "--plot", "none/p.png"], ["none", "does not exist"]),
    "plot of another kind": ([*WORDS, "--plot", "p.txt"], ["--plot", "p.txt", ".png"]),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused_by_name_and_nothing_is_touched(folder, case, name):
    words, said = REFUSED[name]
    tifffile.imwrite("one.tif", digital(case.flat[0]))
    Path("bad.csv").write_text("0,1\nflat,1\n")
    Path("l.yaml").write_text(GEOMETRY + "values: line integrals\n")
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    done = run(*words)
    assert isinstance(done.exception, PalpateError), done.output
    for word in said:
        assert word in str(done.exception)
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_a_killed_run_leaves_the_old_file_or_the_new_one_whole(folder, case):
    command = [sys.executable, "-m", "palpate", *WORDS, "--lag", "0.03", "--dose", "dose.csv"]
    for wait in np.random.default_rng(3).uniform(1.0, 4.0, 3):
        process = subprocess.Popen(command, env=HERE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(wait)
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        if Path("scan.h5").read_bytes() != b"an older result":
            assert error_of(pp.read_scan("scan.h5"), case) < 0.005


def test_line_integrals_come_in_as_counts(tmp_path):
    rng = np.random.default_rng(2)
    p = rng.uniform(-0.05, 4, (3, 6, 7)).astype(np.float32)
    np.save(tmp_path / "p.npy", p)
    text = "panel: {shape: [6, 7], pitch: [1, 1], centre: [0, 0, 0]}\nviews: {motion: arc, angles: [-9, 0, 9], radius: 600}\n"
    (tmp_path / "g.yaml").write_text(f"values: line integrals\nincident: 5000\nbackground: 3\n{text}")
    scan = pp.import_scan(tmp_path / "p.npy", tmp_path / "g.yaml")
    assert np.allclose(pp.line_integrals(scan), p, atol=1e-4)
    (tmp_path / "e.yaml").write_text(f"values: line integrals\nincident: estimate\n{text}")
    with pytest.raises(DataError, match="incident: line integrals do not tell it"):
        pp.import_scan(tmp_path / "p.npy", tmp_path / "e.yaml")
    np.save(tmp_path / "c.npy", 100 * p)
    with pytest.raises(DataError, match=r"values: line integrals must be .* at most 25"):
        pp.import_scan(tmp_path / "c.npy", tmp_path / "g.yaml")
