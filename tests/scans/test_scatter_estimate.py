"""The estimate of scatter: against kernels summed by hand, and what must hold of it for any scan."""

import numpy as np
import pytest

import palpate as pp
from palpate.errors import DataError, FileError
from palpate.scans.scatter.cross_sections import attenuation
from palpate.scans.scatter.kernels import REACH, tube_spectrum
from palpate.scans.scatter.monte_carlo import Part, scatter_image
from palpate.scans.scatter.scan_scatter import add_scatter

KERNELS = pp.scatter_kernels(kv=29)
INCIDENT, PITCH = 5000.0, 1.0


def views(rows=120, columns=150, tilt=0.0, pitch=PITCH) -> pp.Views:
    panel = pp.Panel((rows, columns), (pitch, pitch), (-(columns - 1) * pitch / 2, 0, 0))
    t = np.radians(tilt)
    return pp.Views([(650 * np.sin(t), rows * pitch / 2, 650 * np.cos(t))], panel)


def slab_scan(thickness: float, extra: float = 0.0) -> pp.Scan:
    """Behind a slab that fills the beam far beyond the panel: its primary, and `extra` times it of scatter."""
    primary = INCIDENT * np.interp(thickness, KERNELS.thickness, KERNELS.transmission)
    return pp.Scan(np.full(views().shape, primary * (1 + extra)), INCIDENT, views())


def ratio_of_slab(k: int, gap: float) -> float:
    """Scatter over primary of a slab of the table that fills the beam, by summing its rings out to `REACH`."""
    g = int(np.flatnonzero(KERNELS.gap == gap)[0])
    sums = np.concatenate([[0], np.cumsum(KERNELS.scatter[k, g])])
    return float(np.interp(REACH, KERNELS.radius, sums) / KERNELS.transmission[k])


def test_the_open_beam_scatters_nothing_and_slabs_more_the_thicker_they_are():
    assert KERNELS.transmission[0] == 1
    assert (KERNELS.scatter[0] == 0).all()
    ratios = [ratio_of_slab(k, 20.0) for k in range(1, len(KERNELS.thickness) - 2)]
    assert (np.diff(ratios) > 0).all()
    assert 0.4 < ratio_of_slab(list(KERNELS.thickness).index(50), 20.0) < 0.7


def test_transmission_is_that_of_the_spectrum():
    lines, photons = tube_spectrum(29, "W/Rh")
    k = list(KERNELS.thickness).index(40)
    signal = photons * lines
    expected = (signal * np.exp(-40 * attenuation("breast", lines))).sum() / signal.sum()
    assert KERNELS.transmission[k] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("thickness", [20.0, 60.0])
def test_the_scatter_of_a_slab_is_found_again(thickness):
    """Counts hold as much scatter as the kernels say: five rounds end within 1 % of it, and nearer to it than one."""
    ratio = ratio_of_slab(list(KERNELS.thickness).index(thickness), 20.0)
    scan = slab_scan(thickness, ratio)
    truth = scan.counts.mean() * ratio / (1 + ratio)
    found = pp.estimate_scatter(scan, KERNELS, air_gap=20.0)
    np.testing.assert_allclose(found, truth, rtol=0.01)
    once = pp.estimate_scatter(scan, KERNELS, air_gap=20.0, rounds=1)
    assert abs(once.mean() - truth) > 3 * abs(found.mean() - truth)


@pytest.mark.parametrize("thickness", [30.0, np.full((1, 120, 150), 30.0)])
def test_known_thickness_gives_the_ratio_of_that_slab(thickness):
    """Tissue that lets through as much as 10 mm of the table's, and scatters as 30 mm: no more can be known of it."""
    ratio = ratio_of_slab(list(KERNELS.thickness).index(30), 20.0)
    found = pp.estimate_scatter(slab_scan(10.0, ratio), KERNELS, 20.0, thickness=thickness)
    np.testing.assert_allclose(found, slab_scan(10.0).counts * ratio, rtol=0.01)


def test_estimates_are_proportional_to_the_beam():
    rng = np.random.default_rng(1)
    counts = rng.uniform(500, 5000, views().shape)
    one = pp.estimate_scatter(pp.Scan(counts, INCIDENT, views()), KERNELS)
    seven = pp.estimate_scatter(pp.Scan(7 * counts, 7 * INCIDENT, views()), KERNELS)
    assert one.min() >= 0 < one.max()
    np.testing.assert_allclose(seven, 7 * one, rtol=1e-4)


def test_air_alone_has_no_scatter_and_background_stays():
    scan = pp.Scan(np.full(views().shape, INCIDENT + 30), INCIDENT, views(), background=30)
    np.testing.assert_allclose(pp.estimate_scatter(scan, KERNELS), 30, atol=1e-3)


def test_unmeasured_pixels_change_nothing():
    scan = slab_scan(40.0, 0.4)
    mask = np.ones(scan.shape, bool)
    mask[0, 30:60, 20:50] = False
    damaged = np.where(mask, scan.counts, np.nan)
    found = pp.estimate_scatter(pp.Scan(damaged, INCIDENT, views(), mask=mask), KERNELS)
    np.testing.assert_allclose(found, pp.estimate_scatter(scan, KERNELS), rtol=1e-4)


def test_a_body_that_ends_with_the_panel_scatters_half_as_much_at_its_edge():
    scan = slab_scan(40.0)
    whole = pp.estimate_scatter(scan, KERNELS)[0]
    ends = pp.estimate_scatter(scan, KERNELS, beyond=0)[0]
    assert ends[0, 75] == pytest.approx(whole[0, 75] / 2, rel=0.15)
    assert ends[60, 75] == pytest.approx(whole[60, 75], rel=0.15)


@pytest.mark.parametrize("pitch", [0.5, 3.0])
def test_pixels_of_other_sizes_see_the_same_scatter(pitch):
    n = (round(120 / pitch), round(150 / pitch))
    there = views(*n, pitch=pitch)
    scan = pp.Scan(np.full(there.shape, slab_scan(40.0).counts[0, 0, 0]), INCIDENT, there)
    found = pp.estimate_scatter(scan, KERNELS)[0]
    expected = pp.estimate_scatter(slab_scan(40.0), KERNELS)[0]
    assert found[n[0] // 2, n[1] // 2] == pytest.approx(expected[60, 75], rel=0.03)


@pytest.mark.parametrize("tilt", [0, 20])
def test_the_scatter_of_a_monte_carlo_is_found_within_a_fifth(tilt):
    """An ellipsoid between the table's voltages and thicknesses, mean over its shadow; benchmarks/scatter.py does more."""
    keV, lines = tube_spectrum(29, "W/Rh")
    pitch, photons, gap = 4.0, 2_000_000, 15.0
    body = Part("breast", (-70, -90, gap), (70, 90, gap + 45), (0, 0, gap + 22.5), (70, 90, 22.5))
    source = np.array([650 * np.sin(np.radians(tilt)), 0, 650 * np.cos(np.radians(tilt))])
    corner, shape = (-100.0, 0.0), (26, 48)
    field = (corner[0], -60.0, corner[0] + shape[1] * pitch, shape[0] * pitch)
    found = scatter_image([body], source, field, shape, pitch, corner, keV, lines, photons, 90 + tilt)
    panel = pp.Panel(shape, (pitch, pitch), (corner[0] + pitch / 2, pitch / 2, 0))
    incident = photons * (lines @ keV) / lines.sum() * pitch**2 / ((field[2] - field[0]) * (field[3] - field[1]))
    scan = pp.Scan((found.primary + found.scatter)[None], incident, pp.Views(source[None], panel))
    estimate = pp.estimate_scatter(scan, KERNELS, gap)[0]
    shadow = found.primary < 0.9 * incident
    assert estimate[shadow].sum() == pytest.approx(found.scatter[shadow].sum(), rel=0.1)
    bands = np.array_split(np.flatnonzero(shadow.any(axis=0)), 4)  # across the body, where a tilt shows
    for band in bands:
        part = estimate[:, band][shadow[:, band]].sum() / found.scatter[:, band][shadow[:, band]].sum()
        assert part == pytest.approx(1, abs=0.2)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (dict(air_gap=-1), "air_gap"),
        (dict(air_gap=float("nan")), "air_gap"),
        (dict(beyond=-5), "beyond"),
        (dict(rounds=0), "rounds"),
        (dict(thickness=np.zeros((1, 2, 3))), "thickness"),
        (dict(thickness=0), "thickness"),
        (dict(thickness=float("nan")), "thickness"),
    ],
)
def test_wrong_arguments_are_refused(wrong, message):
    with pytest.raises(DataError, match=message):
        pp.estimate_scatter(slab_scan(20.0), KERNELS, **wrong)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (dict(kv=80), "22 to 50"),
        (dict(kv=30, beam="W/Cu"), "no 'W/Cu'"),
        (dict(kv=30, antiscatter_grid="fine"), "no 'fine'"),
    ],
)
def test_beams_that_the_table_lacks_are_refused(wrong, message):
    with pytest.raises(DataError, match=message):
        pp.scatter_kernels(**wrong)


def test_scatter_comes_from_a_file_and_notes_say_so(tmp_path):
    scan = slab_scan(20.0)
    np.save(tmp_path / "s.npy", np.full(scan.shape, 12.0))
    found = add_scatter(scan, str(tmp_path / "s.npy"), None, "W/Rh", 15, "none")
    np.testing.assert_allclose(found.background, 12)
    assert found.notes == {"scatter": "file s.npy"}
    pp.write_scan(tmp_path / "scan.h5", found)
    assert pp.read_scan(tmp_path / "scan.h5").notes == found.notes
    assert found[:1].notes == found.notes


def test_scatter_is_not_added_twice():
    once = add_scatter(slab_scan(20.0), "estimate", 30, "W/Rh", 15, "none")
    with pytest.raises(DataError, match="already"):
        add_scatter(once, "estimate", 30, "W/Rh", 15, "none")


def test_scatter_that_cannot_be_is_refused(tmp_path):
    scan = slab_scan(20.0)
    with pytest.raises(DataError, match="voltage"):
        add_scatter(scan, "estimate", None, "W/Rh", 15, "none")
    with pytest.raises(FileError, match="npy"):
        add_scatter(scan, "s.txt", None, "W/Rh", 15, "none")
    np.save(tmp_path / "s.npy", np.full((2, 2), 1.0))
    with pytest.raises(DataError, match="shape"):
        add_scatter(scan, str(tmp_path / "s.npy"), None, "W/Rh", 15, "none")
    (tmp_path / "s.npy").write_bytes(b"no array")
    with pytest.raises(FileError, match="NumPy"):
        add_scatter(scan, str(tmp_path / "s.npy"), None, "W/Rh", 15, "none")
