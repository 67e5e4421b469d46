"""A wrong geometry is named, a right one raises no alarm; the whole study is `python -m benchmarks.wrong_geometry`."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from support.wrong_scans import KINDS, disturbed, mistaken, setting

import palpate as pp
from palpate.reconstruction.coarse_fit import unexplained
from palpate.scans.consistency import centre_of_mass, whole_views
from palpate.scans.grid_placement import check_grid
from palpate.scans.plausibility import noise_slope

EXAMPLES = {  # seed, motion and object of each kind: every motion and every object comes up
    "mirrored angles": (1, "rotating", "slab"),
    "reversed order": (2, "hypocycloid", "breast"),
    "radians": (3, "arc", "head"),
    "centimetres": (4, "linear", "trunk"),
    "pixel pitch": (5, "circular", "breast"),
    "source distance": (6, "rotating", "slab"),
    "one view shifted": (7, "moving panel", "trunk"),
    "all views shifted": (8, "arc", "slab"),
    "rows and columns swapped": (9, "circular", "trunk"),
    "row axis flipped": (10, "hypocycloid", "head"),
    "panel transposed": (11, "moving panel", "breast"),
    "incident": (12, "linear", "breast"),
    "line integrals": (13, "arc", "slab"),
    "inverted": (14, "rotating", "head"),
    "grid origin": (15, "linear", "breast"),
}


RIGHT = [("arc", "trunk"), ("rotating", "head"), ("circular", "slab"), ("linear", "breast")]


@pytest.mark.parametrize("kind", KINDS)
def test_the_cause_of_a_mistake_is_the_first_or_the_second_finding(kind):
    found = setting(*EXAMPLES[kind])
    case = mistaken(found, kind, 1, np.random.default_rng(0))
    causes = [finding.cause for finding in pp.check_scan(case.scan, case.grid) if finding.alarm]
    assert set(causes[:2]) & set(KINDS[kind]), causes


@pytest.mark.parametrize("how", ["noise", "scatter", "gain drift"])
@pytest.mark.parametrize(("motion", "thing"), RIGHT)
def test_a_right_scan_raises_no_alarm(motion, thing, how):
    found = setting(20, motion, thing)
    case = disturbed(found, how, np.random.default_rng(0))
    assert not [finding for finding in pp.check_scan(case.scan, case.grid) if finding.alarm]


@pytest.mark.parametrize("name", ["breast", "head"])
def test_the_samples_raise_no_alarm(name):
    assert not [finding for finding in pp.check_scan(pp.import_scan(name)) if finding.alarm]


def balls_above(panel, sources):
    """Exact views of two balls, without noise."""
    solid = pp.Phantom([(pp.Ellipsoid((-20, 8, 30), 22), 0.02), (pp.Ellipsoid((25, -14, 60), 15), 0.03)])
    return pp.simulate_scan(solid, pp.Views(sources, panel), 1e6, seed=None, subrays=1)


def test_centres_of_mass_come_from_one_point_for_sources_in_a_plane():
    """The moment condition of order 1 is exact there: what is left is the sum over pixels for the integral."""
    panel = pp.Panel((120, 140), (1.6, 1.6), (-111.2, -95.2, 0))
    t = np.linspace(0, 2 * np.pi, 9)[:-1]
    sources = np.stack([250 * np.cos(t), 150 * np.sin(t) + 40 * np.cos(2 * t), 0 * t + 700], axis=1)
    scan = balls_above(panel, sources)
    l = pp.line_integrals(scan).astype(float)
    whole = whole_views(scan, l)
    assert whole.all()
    assert np.abs(centre_of_mass(scan, l, whole).offsets).max() < 0.05
    moved = [panel] * 8
    moved[3] = pp.Panel(panel.shape, panel.pitch, panel.points((3, -4))[0])
    shifted = pp.Scan(scan.counts, scan.incident, pp.Views(sources, moved))
    found = centre_of_mass(shifted, l, whole).offsets
    assert np.allclose(found[3], (3, -4), atol=0.1)
    assert np.abs(np.delete(found, 3, axis=0)).max() < 0.1


def test_a_grid_with_x_and_z_exchanged_is_named():
    panel = pp.Panel((40, 48), (2, 2), (-47, -39, 0))
    views = pp.arc_views(panel, [-20, -10, 0, 10, 20], radius=500, pivot=(0, 0, 24))
    right = pp.Grid((8, 20, 24), (5, 3, 3), origin=(-34.5, -28.5, 6.5))
    assert check_grid(views, right) == []
    wrong = pp.Grid(right.shape, right.spacing, origin=right.origin[::-1])
    assert check_grid(views, wrong)[0].cause == "grid origin order"
    scan = pp.Scan(np.full(views.shape, 900.0), 1000, views)
    with pytest.warns(UserWarning, match=r"origin is \(x, y, z\)"):
        pp.reconstruct(scan, wrong, levels=1, iterations=1)


def test_a_grid_wider_than_views_that_show_the_whole_object_is_named():
    """Three quarters of the grid are seen: enough where the object goes on beyond the panel, too little where it ends."""
    panel = pp.Panel((40, 48), (2, 2), (-47, -39, 0))
    views = pp.arc_views(panel, [-20, -10, 0, 10, 20], radius=500, pivot=(0, 0, 24))
    wide = pp.Grid((8, 20, 24), (5, 5, 5), origin=(-57.5, -47.5, 6.5))
    object_ = np.zeros(panel.shape)
    object_[15:25, 18:30] = 1.0
    named = [found.cause for found in check_grid(views, wide, dict.fromkeys(range(len(views)), object_))]
    assert named == ["pixel pitch"]
    assert check_grid(views, wide) == []


def test_a_centred_grid_lies_around_its_point():
    grid = pp.Grid.centred((4, 5, 6), (3, 2, 1), x=10, z=-20)
    assert np.allclose(grid.bounds.mean(axis=0), (10, 0, -20))
    assert grid.shape == (4, 5, 6)
    assert "z -26 to -14" in repr(grid)
    with pytest.raises(TypeError):
        pp.Grid.centred((4, 5, 6), (3, 2, 1), (10, 0, -20))


def small_scan(photons=20_000):
    panel = pp.Panel((40, 48), (2, 2), (-47, -39, 0))
    views = pp.arc_views(panel, [-20, -12, -4, 4, 12, 20], radius=500, pivot=(0, 0, 24))
    solid = pp.Phantom([(pp.Ellipsoid((0, 0, 24), (34, 26, 16)), 0.02), (pp.Ellipsoid((8, -6, 30), 8), 0.02)])
    scan = pp.simulate_scan(solid, views, photons, seed=1)
    return scan, pp.Grid((16, 26, 32), (2.5, 2.5, 2.5), origin=(-38.75, -31.25, 5))


def test_the_deviance_of_the_truth_is_that_of_noise():
    """Of n Poisson counts it is chi-square: 1 a pixel, with standard deviation sqrt(2 / n)."""
    scan, grid = small_scan()
    truth = pp.Volume(np.full(grid.shape, 0.02), grid)
    mean = 5000 * np.exp(-pp.Projector(scan.views, grid)(truth.values))
    counts = np.random.default_rng(0).poisson(mean)
    left = pp.residuals(pp.Scan(counts, 5000, scan.views), truth)
    assert np.abs(left.deviance - 1).max() < 5 * np.sqrt(2 / counts[0].size)
    assert np.allclose(left.expected, mean, rtol=1e-5)
    assert pp.check_residuals(left) == []


def test_a_reconstruction_from_a_right_scan_raises_no_alarm():
    scan, grid = small_scan()
    assert pp.check_residuals(pp.residuals(scan, pp.reconstruct(scan, grid, levels=1, iterations=40))) == []


def test_a_view_that_was_shifted_stands_out_after_reconstruction():
    scan, grid = small_scan()
    panels = list(scan.views.panels)
    panels[2] = pp.Panel(panels[2].shape, panels[2].pitch, panels[2].points((0, 5))[0])
    shifted = pp.Scan(scan.counts, scan.incident, pp.Views(scan.views.source, panels))
    left = pp.residuals(shifted, pp.reconstruct(shifted, grid, levels=1, iterations=40))
    assert left.deviance.argmax() == 2
    assert pp.check_residuals(left)


def test_the_picture_shows_the_views_and_after_a_reconstruction_what_is_left_of_them():
    """In standard deviations of the noise, the worst view among them: there the truth leaves noise, and a shift far more."""
    scan, grid = small_scan()
    truth = pp.Volume(np.full(grid.shape, 0.02), grid)
    mean = 5000 * np.exp(-pp.Projector(scan.views, grid)(truth.values))
    counts = np.random.default_rng(0).poisson(mean)
    counts[2] = np.roll(counts[2], 6, axis=1)
    seen = pp.Scan(counts, 5000, scan.views)

    def pictures(left):
        figure = pp.plot_check(seen, [], grid, left)
        frames = [axes for axes in figure.findobj(Axes) if axes.get_title().startswith("view ")]
        return {int(axes.get_title().split()[1].rstrip(":")): np.asarray(axes.images[0].get_array()) for axes in frames}

    for k, image in pictures(None).items():
        np.testing.assert_allclose(image, np.log(5000 / counts[k]), rtol=1e-5, atol=1e-6)
    left = pictures(pp.residuals(seen, truth))
    assert 2 in left
    for k, image in left.items():
        assert (image.std() > 2) if k == 2 else (abs(image.std() - 1) < 5 / np.sqrt(2 * image.size))


def test_noise_alone_leaves_nothing_unexplained():
    """The expected noise is subtracted: at any dose the share is that of the model, here none."""
    rng = np.random.default_rng(0)
    truth = np.broadcast_to(np.linspace(0, 2, 50), (3, 40, 50))
    for sigma in (0.01, 0.1):
        noisy = (truth + sigma * rng.standard_normal(truth.shape)).astype(np.float32)
        variance = np.full(truth.shape, sigma**2, np.float32)
        assert unexplained(noisy, truth, variance, np.ones(truth.shape, np.float32)).max() < 0.05


def run(*words, cwd):
    here = {**os.environ, "PYTHONPATH": str(Path(pp.__file__).parents[1])}  # the package that is tested
    words = [sys.executable, "-m", "palpate", *map(str, words)]
    return subprocess.run(words, cwd=cwd, env=here, capture_output=True, text=True, timeout=120)


def test_the_commands_warn_of_views_in_the_reverse_order(tmp_path):
    scan, _ = small_scan()
    pp.write_scan(tmp_path / "right.h5", scan)
    pp.write_scan(tmp_path / "wrong.h5", pp.Scan(scan.counts[::-1], scan.incident, scan.views))
    depth = ["--thickness", 45, "--spacing", 3, "--iterations", 4]
    right = run("reconstruct", "right.h5", "-o", "v.nii.gz", *depth, cwd=tmp_path)
    assert right.returncode == 0
    assert "warning" not in right.stderr
    wrong = run("reconstruct", "wrong.h5", "-o", "w.nii.gz", *depth, cwd=tmp_path)
    before, after = (line for line in wrong.stderr.splitlines() if line.startswith("warning: ") and "axis" not in line)
    assert wrong.returncode == 0
    assert before.startswith("warning: view order: the views run the other way")
    assert "unexplained" in after
    silent = run("reconstruct", "wrong.h5", "-o", "w.nii.gz", *depth, "--no-check", cwd=tmp_path)
    assert silent.returncode == 0
    assert "warning" not in silent.stderr


def test_scan_check_ranks_its_findings_and_draws_them(tmp_path):
    scan, _ = small_scan()
    pp.write_scan(tmp_path / "right.h5", scan)
    pp.write_scan(tmp_path / "wrong.h5", pp.Scan(scan.counts, 200, scan.views))
    right = run("scan", "check", "right.h5", "--thickness", 45, "-o", "right.svg", cwd=tmp_path)
    assert right.returncode == 0, right.stderr
    assert "agree" in right.stdout
    assert "no mistake found" in (tmp_path / "right.svg").read_text()
    wrong = run("scan", "check", "wrong.h5", "-o", "wrong.png", cwd=tmp_path)
    assert wrong.returncode == 3
    assert wrong.stdout.startswith("1. incident: ")
    assert (tmp_path / "wrong.png").read_bytes()[:4] == b"\x89PNG"


def test_import_warns_of_counts_above_the_open_beam(tmp_path):
    scan, _ = small_scan()
    np.save(tmp_path / "views.npy", scan.counts)
    (tmp_path / "g.yaml").write_text(
        "incident: 200\npanel: {shape: [40, 48], pitch: [2, 2], centre: [0, 0, 0]}\n"
        "views: {motion: arc, angles: [-20, -12, -4, 4, 12, 20], radius: 500, pivot: [0, 0, 24]}\n"
    )
    done = run("scan", "import", "views.npy", "--geometry", "g.yaml", "-o", "s.h5", cwd=tmp_path)
    assert done.returncode == 0
    assert "warning: incident: " in done.stderr
    quiet = run("scan", "import", "views.npy", "--geometry", "g.yaml", "-o", "s.h5", "--no-check", cwd=tmp_path)
    assert "warning" not in quiet.stderr


def test_noise_grows_with_photons_and_falls_with_inverted_counts():
    """Variance = mean: the slope of their logarithms is 1; that of I - y against y is negative."""
    rng = np.random.default_rng(0)
    mean = np.broadcast_to(np.linspace(2000, 8000, 120), (4, 100, 120))
    counts = rng.poisson(mean).astype(float)
    panel = pp.Panel((100, 120), (1, 1), (-60, -50, 0))
    views = pp.arc_views(panel, [-10, -5, 5, 10], radius=600)
    assert abs(noise_slope(pp.Scan(counts, 10_000, views)) - 1) < 0.1
    assert noise_slope(pp.Scan(10_000 - counts, 10_000, views)) < -0.5
    assert noise_slope(pp.Scan(mean, 10_000, views)) is None
