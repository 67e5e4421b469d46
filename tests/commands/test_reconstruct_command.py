"""`palpate reconstruct`: files in, a file out, whole or not at all, whatever stops it."""

import inspect
import random
import re
import signal
import subprocess
import sys
import time
from typing import get_args

import h5py
import nibabel
import numpy as np
import pytest

import palpate as pp
from palpate.commands.reconstruct import LikelihoodName, PriorName, WindowName, reconstruct_command
from palpate.commands.reconstruct import Method as MethodName
from palpate.reconstruction.baselines.filtered_backprojection import Window
from palpate.reconstruction.models.potential import Named
from palpate.reconstruction.reconstruct import LIKELIHOODS, Method
from palpate.reconstruction.reconstruct import OPTIONS as KEYWORDS
from palpate.scans.analytic_phantoms import Ellipsoid, Phantom

OPTIONS = ["--thickness", "30", "--spacing", "1", "--levels", "2", "--iterations", "25", "--tolerance", "0"]


def command(folder, *options, output="volume.nii.gz"):
    words = [sys.executable, "-m", "palpate", "reconstruct", str(folder / "scan.h5"), "-o", str(folder / output)]
    return [*words, *OPTIONS, *options]


def run(folder, *options, **keywords):
    return subprocess.run(command(folder, *options, **keywords), capture_output=True, text=True, timeout=120)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reconstruct")
    panel = pp.Panel((50, 70), (1, 1), (-34.5, -24.5, 0))
    views = pp.arc_views(panel, [-20, -7, 7, 20], radius=500, pivot=(0, 0, 20))
    body = Phantom([(Ellipsoid((0, 0, 15), (20, 14, 9)), 0.02)])
    pp.write_scan(folder / "scan.h5", pp.simulate_scan(body, views, incident=5000, seed=1))
    return folder


@pytest.fixture(scope="module")
def whole(folder):
    """The uninterrupted run."""
    done = run(folder, output="whole.nii.gz")
    assert done.returncode == 0, done.stderr
    assert "objective" in done.stdout
    return pp.read_volume(folder / "whole.nii.gz")


def test_the_volume_opens_in_an_independent_reader(folder, whole):
    image = nibabel.load(folder / "whole.nii.gz")
    assert image.shape == whole.values.shape[::-1]
    assert image.header.get_zooms()[:2] == pytest.approx((1, 1))
    assert 0.01 < np.asarray(image.dataobj).max() < 0.05
    assert not (folder / "whole.nii.gz.checkpoint.h5").exists()


def test_a_resolution_sets_the_strength_and_says_so(folder, whole):
    done = run(folder, "--resolution", "1.5mm", output="sharp.nii.gz")
    assert done.returncode == 0, done.stderr
    assert re.search(r"prior quadratic, strength [\d.]+ 1/mm: a point becomes 1.5 mm wide", done.stdout)
    again = pp.reconstruct(
        pp.read_scan(folder / "scan.h5"), whole.grid, resolution=1.5, levels=2, iterations=25, tolerance=0
    )
    np.testing.assert_array_equal(pp.read_volume(folder / "sharp.nii.gz").values, again.values)
    for options, said in (
        (["--resolution", "wide"], "0.6mm"),
        (["--resolution", "0.2mm"], "becomes"),
        (["--resolution", "1.5", "--prior", "huber"], "quadratic"),
        (["--resolution", "1.5", "--strength", "3"], "not both"),
    ):
        refused = run(folder, *options, output="refused.nii.gz")
        assert refused.returncode == 2, refused.stderr
        assert said in refused.stderr


def test_a_smooth_object_is_told_and_said(folder, whole):
    done = run(folder, "--smooth", output="smooth.nii.gz")
    assert done.returncode == 0, done.stderr
    assert re.search(r"prior lange, strength [\d.]+ 1/mm, edge [\d.e-]+ 1/mm: for a smooth object", done.stdout)
    options = {"levels": 2, "iterations": 25, "tolerance": 0}
    again = pp.reconstruct(pp.read_scan(folder / "scan.h5"), whole.grid, prior=pp.Prior(smooth=True), **options)
    np.testing.assert_array_equal(pp.read_volume(folder / "smooth.nii.gz").values, again.values)
    for more, said in (
        (["--resolution", "1.5mm"], "not both"),
        (["--strength", "3"], "not both"),
        (["--method", "sart"], "sart"),
    ):
        refused = run(folder, "--smooth", *more, output="refused.nii.gz")
        assert refused.returncode == 2, refused.stderr
        assert said in refused.stderr


def test_other_likelihoods_priors_and_a_hardening_beam_are_taken(folder, whole):
    """And change the volume, but not what is in it; an unhardened polynomial changes nothing."""
    few = ["--iterations", "8"]
    options = ["--prior", "generalized", "--exponent", "1.3", "--neighbours", "18", *few]
    assert run(folder, *options, output="plain.nii.gz").returncode == 0
    plain = pp.read_volume(folder / "plain.nii.gz").values
    for more, least, most in (
        (["--hardening", "1"], 0, 1e-3),
        (["--hardening", "1.1,-0.01"], 0.02, 0.2),
        (["--likelihood", "gaussian", "--electronic", "10", "--gain", "2"], 1e-3, 0.5),
    ):
        done = run(folder, *options, *more, output="other.nii.gz")
        assert done.returncode == 0, done.stderr
        other = pp.read_volume(folder / "other.nii.gz").values
        assert least <= np.linalg.norm(other - plain) / np.linalg.norm(plain) <= most


def test_a_support_by_shadows_or_from_a_file_is_held(folder, whole):
    """Labels written by the library go in; what is 0 in them is 0 in the volume; the region takes its own hull."""
    scan = pp.read_scan(folder / "scan.h5")
    grid = pp.read_volume(folder / "whole.nii.gz").grid
    inside = np.zeros(grid.shape, np.int32)
    inside[1:-1, 4:-4, 4:-4] = 1
    pp.write_labels(folder / "inside.nii.gz", pp.Labels(inside, grid))
    for given, held in (("hull", pp.support_hull(scan, grid).values), (str(folder / "inside.nii.gz"), inside)):
        done = run(folder, "--iterations", "4", "--support", given, output="held.nii.gz")
        assert done.returncode == 0, done.stderr
        values = pp.read_volume(folder / "held.nii.gz").values
        assert (values[held == 0] == 0).all()
        assert values.sum() * grid.voxel_volume == pytest.approx(0.02 * 4 / 3 * np.pi * 20 * 14 * 9, rel=0.1)
    done = run(folder, "--region", "-6,6,-5,5,0,30", "--support", "hull", "--iterations", "4", output="region.nii.gz")
    assert done.returncode == 0, done.stderr
    done = run(folder, "--region", "-6,6,-5,5,0,30", "--support", "inside.nii.gz", output="region.nii.gz")
    assert done.returncode == 2
    assert "--region only none or hull" in done.stderr


def test_scatter_is_estimated_or_read_and_told(folder):
    """Scatter in the mean leaves less of the counts to the primary, so the object is denser; in every method alike."""
    few = ["--iterations", "8", "--levels", "1"]
    assert run(folder, *few, output="bare.nii.gz").returncode == 0
    bare = pp.read_volume(folder / "bare.nii.gz")
    assert bare.notes == {}
    done = run(folder, *few, "--scatter", "estimate", "--kv", "29", "--air-gap", "5", output="less.nii.gz")
    assert done.returncode == 0, done.stderr
    less = pp.read_volume(folder / "less.nii.gz")
    assert (less.notes["scatter"], less.notes["kV"], less.notes["air gap"]) == ("estimate", "29", "5 mm")
    scan = pp.read_scan(folder / "scan.h5")
    np.save(folder / "s.npy", pp.estimate_scatter(scan, pp.scatter_kernels(29), air_gap=5) - scan.background)
    assert run(folder, *few, "--scatter", str(folder / "s.npy"), output="file.nii.gz").returncode == 0
    read = pp.read_volume(folder / "file.nii.gz")
    assert read.notes == {"scatter": "file s.npy"}
    np.testing.assert_allclose(read.values, less.values, atol=1e-4 * less.values.max())
    dense = bare.values > 0.5 * bare.values.max()
    assert less.values[dense].mean() > 1.02 * bare.values[dense].mean()
    done = run(folder, "--scatter", "estimate", "--kv", "90")
    assert done.returncode == 2
    assert "--kv: the table has 22 to 50 kV" in done.stderr


def test_a_blur_is_the_scans_or_given_and_told(folder):
    """The file's blur is taken unless another is given; the volume says which."""
    few = ["--iterations", "20", "--levels", "1", "--strength", "0.1", "--prior", "quadratic"]
    assert run(folder, *few, output="plain.nii.gz").returncode == 0
    plain = pp.read_volume(folder / "plain.nii.gz")
    scan = pp.read_scan(folder / "scan.h5")
    own = folder / "own"
    own.mkdir()
    pp.write_scan(own / "scan.h5", pp.Scan(scan.counts, scan.incident, scan.views, blur=pp.Blur(2.0, 1.0, at=15)))
    told = {}
    for where, words in ((folder, ["--blur", "2,1,15"]), (own, []), (own, ["--blur", "none"])):
        done = run(where, *few, *words, output="out.nii.gz")
        assert done.returncode == 0, done.stderr
        told[where, *words] = pp.read_volume(where / "out.nii.gz")
    given, kept, none = told.values()
    assert given.notes == kept.notes == {"blur": "panel 2 mm, focal spot 1 mm at (0, 0, 15) mm"}
    assert (given.values == kept.values).all()
    assert (none.values == plain.values).all()
    assert none.notes == {}
    assert np.linalg.norm(given.values - plain.values) > 0.02 * np.linalg.norm(plain.values)


def test_a_spectrum_file_hardens_by_one_material_or_two(folder):
    """Where all is soft tissue the bones change nothing; where all is bone it is bone's curve that counts."""
    spectrum = folder / "tube.csv"
    spectrum.write_text("# weight,soft,bone\n3,1.6,2.2\n5,1,1\n2,0.8,0.5\n")
    few = ["--iterations", "8", "--hardening", str(spectrum)]
    first = folder / "soft.nii.gz"
    assert run(folder, *few, output=first.name).returncode == 0
    soft = pp.read_volume(first).values
    for limits, least, most in (("0.5,0.6", 0, 1e-3), ("0,0.0001", 0.02, 0.5)):
        done = run(folder, *few, "--bones", str(first), "--bone-range", limits, output="bones.nii.gz")
        assert done.returncode == 0, done.stderr
        made = pp.read_volume(folder / "bones.nii.gz").values
        assert least <= np.linalg.norm(made - soft) / np.linalg.norm(soft) <= most
    done = run(folder, *few, "--bones", str(first), "--bone-range", "0.1", output="bones.nii.gz")
    assert done.returncode == 2
    assert "--bone-range with two numbers" in done.stderr


def test_killed_at_ten_random_moments_it_resumes_to_the_same_volume(folder, whole):
    """SIGKILL: what has the final name is whole; --resume ends with the bits of the uninterrupted run."""
    output, beside = folder / "killed.nii.gz", folder / "killed.nii.gz.checkpoint.h5"
    moments, killed, resumed = random.Random(7), 0, 0
    for _ in range(10):
        resume = ["--resume"] if beside.exists() else []
        process = subprocess.Popen(
            command(folder, "--checkpoint-every", "1", *resume, output=output.name),
            stderr=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
        )
        if moments.random() < 0.5:  # while it starts, or at some moment after its first checkpoint moves
            time.sleep(moments.uniform(0, 1.5))
        else:
            _until_touched(beside, process)
            time.sleep(moments.uniform(0, 0.05))
        process.send_signal(signal.SIGKILL)
        process.wait()
        killed += 1
        resumed += bool(resume)
        if beside.exists():
            with h5py.File(beside, "r") as file:  # whole: an independent reader opens it
                assert np.isfinite(file["values"][...]).all()
        if output.exists():
            assert (pp.read_volume(output).values == whole.values).all()
    done = run(folder, *(["--resume"] if beside.exists() else []), output=output.name)
    assert done.returncode == 0, done.stderr
    assert (pp.read_volume(output).values == whole.values).all()
    assert killed == 10
    assert resumed > 0


def _until_touched(path, process):
    before = path.stat().st_mtime_ns if path.exists() else None
    for _ in range(1000):
        if process.poll() is not None or (path.exists() and path.stat().st_mtime_ns != before):
            return
        time.sleep(0.01)


def test_ctrl_c_keeps_the_last_iterate_and_says_how_to_go_on(folder, whole):
    output, beside = folder / "stopped.nii.gz", folder / "stopped.nii.gz.checkpoint.h5"
    process = subprocess.Popen(
        command(folder, "--checkpoint-every", "1", output=output.name),
        stderr=subprocess.PIPE,
        text=True,
        stdout=subprocess.DEVNULL,
    )
    _until_touched(beside, process)
    process.send_signal(signal.SIGINT)
    told = process.communicate(timeout=60)[1]
    assert process.returncode == 130
    assert "--resume goes on" in told
    assert str(beside.name) in told.replace("\n", "")
    assert not output.exists()
    assert run(folder, "--resume", output=output.name).returncode == 0
    assert (pp.read_volume(output).values == whole.values).all()


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"scan.h5": "gone.h5"}, ("gone.h5",)),
        ({"30": "-3"}, ("thickness", "-3", "mm")),
        ({"out.nii.gz": "no/out.nii.gz"}, ("does not exist", "mkdir -p")),
        ({"out.nii.gz": "out.txt"}, ("out.txt", ".nii.gz")),
        ({"--tolerance": "--resume --tolerance"}, ("out.nii.gz.checkpoint.h5", "leave out --resume")),
        ({"2": "12"}, ("levels", "take at most")),
        ({"--tolerance": "--neighbours 7 --tolerance"}, ("neighbours", "6, 18 or 26", "7")),
        ({"--tolerance": "--exponent 3 --tolerance"}, ("exponent", "3.0")),
        ({"--tolerance": "--electronic -1 --tolerance"}, ("electronic", "-1")),
        ({"--tolerance": "--gain 0 --tolerance"}, ("gain", "above 0")),
        ({"--tolerance": "--likelihood gaussian --tolerance"}, ("gaussian likelihood", "--electronic")),
        ({"--tolerance": "--hardening 1,x --tolerance"}, ("hardening", "1,x")),
        ({"--tolerance": "--hardening 1,-0.1 --tolerance"}, ("hardening", "falls")),
        ({"--tolerance": "--blur wide --tolerance"}, ("--blur", "wide", "0.2,0.3")),
        ({"--tolerance": "--blur=0.2,-1 --tolerance"}, ("--blur", "focal_spot", "-1")),
        ({"--tolerance": "--blur 400 --tolerance"}, ("--blur", "wider than the panel", "units")),
        ({"--tolerance": "--blur 0.5 --likelihood least-squares --tolerance"}, ("--blur", "WeightedLeastSquares")),
        ({"--tolerance": "--blur 0.5 --samples 3 --likelihood gaussian --tolerance"}, ("--samples", "blur", "poisson")),
        ({"--tolerance": "--bones first.nii.gz --tolerance"}, ("bones", "weight,soft,bone")),
        ({"--tolerance": "--hardening 1 --bones first.nii.gz --tolerance"}, ("first.nii.gz",)),
        ({"--tolerance": "--region=-6,6,-5,5,0,30 --halvings -1 --tolerance"}, ("halvings", "at least 0", "-1")),
    ],
)
def test_what_cannot_be_is_refused_before_work(folder, change, told):
    words = command(folder, output="out.nii.gz")
    for old, new in change.items():
        at = next(i for i in range(len(words) - 1, -1, -1) if words[i].endswith(old))
        words[at : at + 1] = [words[at].removesuffix(old) + part for part in new.split()]
    before = sorted(p.name for p in folder.iterdir())
    done = subprocess.run(words, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    for word in told:
        assert word in done.stderr
    assert "Traceback" not in done.stderr
    assert sorted(p.name for p in folder.iterdir()) == before


def test_the_baselines_and_a_region_are_a_word_away(folder):
    """Each writes a volume of the ball; a region's volume holds its voxels alone, much as the whole has them."""
    for options in (
        ["--method", "fbp", "--window", "ram-lak", "--cutoff", "0.5"],
        ["--method", "sart"],
        ["--method", "tv"],
    ):
        done = run(folder, "--iterations", "3", *options, output="baseline.nii.gz")
        assert done.returncode == 0, done.stderr
        values = pp.read_volume(folder / "baseline.nii.gz").values
        middle = values[:, values.shape[1] // 2 - 4 : values.shape[1] // 2 + 4, values.shape[2] // 2 - 4 :][..., :8]
        assert 0.003 < middle.mean() < 0.02  # 18 of 30 mm of depth hold 0.02
    done = run(folder, "--region", "-6,6,-5,5,0,30", output="region.nii.gz")
    assert done.returncode == 0, done.stderr
    part = pp.read_volume(folder / "region.nii.gz")
    assert part.values.shape[1:] == (10, 12)
    np.testing.assert_allclose(np.ptp(part.grid.bounds, axis=0), [12, 10, 30], atol=1e-3)
    assert 0.008 < part.values.mean() < 0.016
    done = run(folder, "--region", "-6,6,-5,5,0,30", "--halvings", "0", output="finer.nii.gz")
    assert done.returncode == 0, done.stderr
    finer = pp.read_volume(folder / "finer.nii.gz").values
    assert 1e-4 < np.linalg.norm(finer - part.values) / np.linalg.norm(finer) < 0.2
    done = run(folder, "--region", "-6,6,-5,5,0,30", "--blur", "0.8", output="blurred.nii.gz")
    assert done.returncode == 0, done.stderr
    assert "--halvings" not in done.stderr
    poor = [
        run(folder, "--region", "-6,6,-5,5,0,30", "--prior", "quadratic", "--strength", "1e4", "--halvings", h).stderr
        for h in "10"
    ]
    assert ["poor fit" in said for said in poor] == [True, True]
    assert ["try --halvings 0" in said for said in poor] == [True, False]
    blurred = pp.read_volume(folder / "blurred.nii.gz")
    assert blurred.notes["blur"].startswith("panel 0.8 mm")
    assert 1e-3 < np.linalg.norm(blurred.values - part.values) / np.linalg.norm(part.values) < 0.2


def test_the_command_and_the_function_have_the_same_options():
    """Names, defaults and choices."""
    of_function = {name: p.default for name, p in inspect.signature(pp.reconstruct).parameters.items()}
    of_command = {name: p.default for name, p in inspect.signature(reconstruct_command).parameters.items()}
    shared = of_function.keys() & of_command.keys() - {"scan", "prior", "resume"}
    assert shared >= {
        "levels",
        "method",
        "likelihood",
        "start",
        "tolerance",
        "window",
        "cutoff",
        "relaxation",
        "optimizer",
    }
    for name in shared:
        assert of_command[name] == of_function[name], name
    assert set(KEYWORDS) <= of_function.keys()
    for names, choices in ((MethodName, Method), (WindowName, Window), (PriorName, Named)):
        assert {str(name) for name in names} == set(get_args(choices))
    assert {str(name) for name in LikelihoodName} == LIKELIHOODS.keys()
