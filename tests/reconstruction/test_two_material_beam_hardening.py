"""Hardening by soft tissue and bone: counts from analytic solids energy by energy, spectra from the physics of both."""

import numpy as np
import pytest
from reconstruction.test_beam_hardening import ENERGIES, REFERENCE, klein_nishina, tube, water

import palpate as pp
from palpate.errors import DataError, FileError
from palpate.reconstruction.models.beam_hardening import Hardened, Spectrum, Tabulated, precorrected
from palpate.reconstruction.models.likelihood import Transmission
from palpate.reconstruction.models.two_material_beam_hardening import (
    TwoMaterials,
    read_spectrum,
    two_material_beam_hardening,
)
from palpate.scans.analytic_phantoms import Box, Phantom
from palpate.scans.simulate import transmission


def cortical(energy):
    """1/mm: 1.78 times water's electrons, and the photoelectric effect of its calcium as E⁻³."""
    return 1.78 * 0.03343 * klein_nishina(energy) + 0.0279 * (60 / energy) ** 3


SOFT, BONE = water(ENERGIES) / water(REFERENCE), cortical(ENERGIES) / cortical(REFERENCE)
MATERIALS = TwoMaterials(tube(), SOFT, BONE, water(REFERENCE), cortical(REFERENCE))


def test_the_bone_is_bone():
    """Tables give 0.256, 0.0814 and 0.0428 1/mm at 30, 50 and 80 keV (NIST, cortical bone, 1.92 g/cm³)."""
    np.testing.assert_allclose(cortical(np.array([30.0, 50.0, 80.0])), [0.256, 0.0814, 0.0428], rtol=0.06)


def test_a_ray_through_both_shows_what_its_energies_show_together():
    """Also between tabulated shares, where the curve is interpolated."""
    w = tube() / tube().sum()
    for soft, bone in ((0.0, 0.0), (100.0, 0.0), (0.0, 20.0), (80.0, 7.0), (31.0, 13.0)):
        expected = -np.log(np.sum(w * np.exp(-water(ENERGIES) * soft - cortical(ENERGIES) * bone)))
        parts = np.array([soft * water(REFERENCE), bone * cortical(REFERENCE)])
        l = parts.sum()
        curve = MATERIALS.behind(parts[1] / l if l else 0.0)
        assert curve(l)[0].item() == pytest.approx(expected, abs=1e-4)
        assert curve.inverse(expected).item() == pytest.approx(l, abs=2e-4)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.304, 1.0])
def test_each_rays_curve_is_one_function_that_bends_down(share):
    l, step = np.linspace(0.0125, 11.9, 300), 1e-4
    curve = MATERIALS.behind(share)
    _, slope, bend = curve(l)
    up, down = curve(l + step), curve(l - step)
    np.testing.assert_allclose(slope, (up[0] - down[0]) / (2 * step), rtol=1e-6)
    np.testing.assert_allclose(bend, (up[1] - down[1]) / (2 * step), atol=5e-3 * np.abs(bend).max())
    assert (slope <= curve.steepest).all()
    assert (-bend <= curve.sharpest).all()
    assert (bend < 0).all()
    ends = np.array([-0.1, 0, 1e-3, 3, 12, 20])
    np.testing.assert_allclose(curve.inverse(curve(ends)[0]), ends, atol=1e-7)


def test_no_bone_is_the_curve_of_soft_tissue():
    l = np.linspace(0, 13, 50)
    for made, expected in zip(MATERIALS.behind(0.0 * l)(l), Tabulated(Spectrum(tube(), SOFT))(l), strict=True):
        np.testing.assert_allclose(made, expected, rtol=1e-9, atol=1e-9)


def test_blurred_bone_keeps_its_line_integrals():
    """A mixture by volume: half bone, half tissue has half of bone's attenuation as bone; noise below tissue none."""
    tissue, full = MATERIALS.tissue, MATERIALS.full
    values = np.array([0, 0.5 * tissue, tissue, (tissue + full) / 2, full, 1.2 * full], np.float32)
    np.testing.assert_allclose(MATERIALS.boned(values), [0, 0, 0, full / 2, full, 1.2 * full], rtol=1e-6)


# A block of water of whole voxels with four bars of bone, and water between them
BARS = [Box((x, 0, z), (20, 36, 16)) for z in (34, 66) for x in (-20, 20)]
GRID = pp.Grid((8, 3, 8), (8, 12, 10), (-35, -12, 22))
MIDDLE = (slice(None), 1)  # the row whose rays no end of the block crosses: a pixel over an end is no single ray
BETWEEN = ([2, 2, 3, 3, 4, 4, 5, 5], 1, [3, 4, 3, 4, 3, 4, 3, 4])
INCIDENT = 1e5
BINS = slice(1, None, 3)
OPTIONS = {"method": "ml", "levels": 1, "iterations": 80, "tolerance": 0}


@pytest.fixture(scope="module")
def shown():
    """Expected counts, without noise, behind the block: of the reference energy alone, and of a tube in five bins."""
    panel = pp.Panel((24, 156), (3, 3), (-232.5, -34.5, 0))
    v = pp.arc_views(panel, np.linspace(-60, 60, 21), radius=500, pivot=(0, 0, 50))

    def at(energy):
        more = cortical(energy) - water(energy)
        body = Phantom([(Box((0, 0, 50), (80, 36, 64)), water(energy)), *((bar, more) for bar in BARS)])
        return np.stack([transmission(body, s, p, 2) for s, p in zip(v.source, v.panels, strict=True)])

    w = tube()[BINS] / tube()[BINS].sum()
    poly = sum(a * at(e) for a, e in zip(w, ENERGIES[BINS], strict=True))
    return pp.Scan(INCIDENT * at(REFERENCE), INCIDENT, v), pp.Scan(INCIDENT * poly, INCIDENT, v)


def test_the_dark_band_between_bones_goes(shown):
    """Errors against the same block in light of the reference energy, over water's: a quarter of what the curve of soft
    tissue alone leaves, a tenth between the bars. A voxel is bone from 1.2 times water on: few views leave some percent.
    """
    mono, poly = shown
    w, soft, bone = tube()[BINS], SOFT[BINS], BONE[BINS]
    expected = pp.reconstruct(mono, GRID, **OPTIONS).values
    water_alone = Spectrum(w, soft)
    single = pp.reconstruct(poly, GRID, likelihood=lambda s: Hardened(Transmission.of(s), water_alone), **OPTIONS)
    materials = TwoMaterials(w, soft, bone, 1.2 * water(REFERENCE), cortical(REFERENCE))
    both = two_material_beam_hardening(poly, GRID, materials, **OPTIONS)
    off = [(v.values - expected) / water(REFERENCE) for v in (single, both)]
    dark, left = (float(d[BETWEEN].mean()) for d in off)
    assert dark < -0.1
    assert abs(left) < abs(dark) / 10
    errors = [float(np.sqrt(np.mean(np.square(d[MIDDLE])))) for d in off]
    print(dark, left, errors)
    assert errors[1] < errors[0] / 4


def test_counts_corrected_by_rays_are_those_of_one_energy(shown):
    """Joseph & Spital's way, with each ray's true share of bone: where a pixel sees one path, the counts are exact."""
    mono, poly = shown
    w = tube()[BINS]
    bars = Phantom([(bar, cortical(REFERENCE)) for bar in BARS])
    body = Phantom(
        [
            (Box((0, 0, 50), (80, 36, 64)), water(REFERENCE)),
            *((bar, cortical(REFERENCE) - water(REFERENCE)) for bar in BARS),
        ]
    )
    v = mono.views
    l_bone, l = (
        -np.log(np.stack([transmission(b, s, p, 2) for s, p in zip(v.source, v.panels, strict=True)]))
        for b in (bars, body)
    )
    share = np.clip(np.where(l > 1e-6, l_bone / np.maximum(l, 1e-6), 0), 0, 1)
    curve = TwoMaterials(w, SOFT[BINS], BONE[BINS], MATERIALS.tissue, MATERIALS.full).behind(share)
    made = precorrected(poly, curve).counts
    off, before = (np.abs(np.log(counts / mono.counts))[:, 10:14] for counts in (made, poly.counts))
    assert np.median(off[l[:, 10:14] > 0.3]) < 2e-4
    assert np.median(before[l[:, 10:14] > 0.3]) > 0.05


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: TwoMaterials(tube(), SOFT, BONE, 0.08, 0.02), "soft tissue below that of bone"),
        (lambda: TwoMaterials(tube(), SOFT, -BONE, 0.02, 0.08), "ratio (above 0)"),
        (lambda: MATERIALS.behind(np.array([0.5, 1.5])), "share of bone: expected 0 to 1, found 0.5 to 1.5"),
        (lambda: two_material_beam_hardening(None, GRID, MATERIALS, rounds=0), "rounds: expected a whole number"),
    ],
)
def test_materials_that_cannot_be_are_refused(make, told):
    with pytest.raises(DataError) as refusal:
        make()
    assert told in str(refusal.value)


def test_spectra_are_read_and_bad_files_refused(tmp_path):
    file = tmp_path / "tube.csv"
    np.savetxt(file, np.stack([tube(), SOFT, BONE], axis=1), delimiter=",", header="weight,soft,bone")
    np.testing.assert_allclose(read_spectrum(file), np.stack([tube(), SOFT, BONE], axis=1))
    for text, told in (
        ("1,2,3,4\n", "got 4 columns"),
        ("1,x\n", "no spectrum could be read"),
        ("# nothing\n", "no spectrum could be read"),
    ):
        file.write_text(text)
        with pytest.raises(FileError, match=told):
            read_spectrum(file)
    with pytest.raises(FileError, match="no spectrum could be read"):
        read_spectrum(tmp_path / "missing.csv")
