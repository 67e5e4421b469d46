"""Beam hardening: spectra from the physics of water, counts from analytic solids energy by energy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import palpate as pp
from palpate.errors import DataError
from palpate.reconstruction.models.beam_hardening import Hardened, Polynomial, Spectrum, Tabulated, precorrected
from palpate.reconstruction.models.likelihood import Gaussian, Transmission, WeightedLeastSquares
from palpate.scans.analytic_phantoms import Box, Phantom
from palpate.scans.simulate import transmission

ENERGIES = np.arange(20.0, 80.0, 4.0)  # keV
REFERENCE = 50.0


def klein_nishina(energy):
    """Total cross-section of a free electron, barn (Klein & Nishina 1929)."""
    a = energy / 510.999
    first = (1 + a) / a**2 * (2 * (1 + a) / (1 + 2 * a) - np.log(1 + 2 * a) / a)
    return 2 * np.pi * 0.0794079 * (first + np.log(1 + 2 * a) / (2 * a) - (1 + 3 * a) / (1 + 2 * a) ** 2)


def water(energy):
    """1/mm: 3.343e23 electrons a cm³, and the photoelectric effect as E⁻³."""
    return 0.03343 * klein_nishina(energy) + 0.0024 * (60 / energy) ** 3


def tube():
    """Kramers' spectrum at 80 kV behind some aluminium, by energy: what an integrating panel weighs."""
    return ENERGIES * (80 / ENERGIES - 1) * np.exp(-((30 / ENERGIES) ** 3))


SPECTRUM = Spectrum(tube(), water(ENERGIES) / water(REFERENCE))
CURVES = [SPECTRUM, Polynomial((1.1, -0.012)), Polynomial((1.0,))]


def test_the_water_is_water():
    """Tables give 0.0376, 0.0227 and 0.0184 1/mm at 30, 50 and 80 keV (NIST); coherent scatter is left out."""
    np.testing.assert_allclose(water(np.array([30.0, 50.0, 80.0])), [0.0376, 0.0227, 0.0184], rtol=0.05)


def test_a_spectrum_shows_what_its_energies_show_together():
    w = tube() / tube().sum()
    for thickness in (0.0, 10.0, 80.0, 200.0):
        expected = -np.log(sum(a * np.exp(-m * thickness) for a, m in zip(w, water(ENERGIES), strict=True)))
        assert SPECTRUM(np.array([thickness * water(REFERENCE)]))[0].item() == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("curve", CURVES, ids=lambda c: type(c).__name__)
def test_curves_and_their_tables_agree_with_their_differences(curve):
    l = np.linspace(0.0125, 11.9, 300)  # the first is in the middle of a step of the table
    table, step = Tabulated(curve), 1e-4
    for g in (curve, table):
        _, slope, bend = g(l)
        up, down = g(l + step), g(l - step)
        np.testing.assert_allclose(slope, (up[0] - down[0]) / (2 * step), rtol=1e-6)
        np.testing.assert_allclose(bend, (up[1] - down[1]) / (2 * step), atol=5e-3 * np.abs(bend).max() + 1e-9)
    np.testing.assert_allclose(table(l)[0], curve(l)[0], atol=1e-5)
    beyond = np.array([-0.1, 0, 1e-3, 3, 12, 20])
    np.testing.assert_allclose(table.inverse(table(beyond)[0]), beyond, atol=1e-9)


def pixel(value):
    return np.full((1, 1, 1), value, np.float32)


def bases(y, b, r):
    yield Transmission(pixel(y), pixel(b), pixel(r))
    yield Gaussian(pixel(y), pixel(b), pixel(r))
    yield WeightedLeastSquares(pixel(abs(np.log(b / (y + 1)))), pixel(y + 1))


@settings(max_examples=50, deadline=None)
@given(
    st.floats(0, 3e5),
    st.floats(1, 3e5),
    st.floats(1, 1e3),
    st.floats(0, 11),
    st.integers(0, 2),
    st.sampled_from(CURVES),
)
def test_surrogates_of_what_hardens_lie_above(y, b, r, l, which, curve):
    """For all l >= 0. Values are sums in float64, of g in float32."""
    model = Hardened(list(bases(y, b, r))[which], curve)
    t = np.concatenate([[0], np.geomspace(1e-3, 20, 40)]).astype(np.float32)
    l = float(np.float32(l))
    here, slope = model.value(pixel(l)), model.slope(pixel(l)).item()
    for kind in ("optimal", "maximum"):
        curvature = model.curvature(pixel(l), kind).item()
        for x in t:
            parabola = here + slope * (x - l) + curvature / 2 * (x - l) ** 2
            rounding = 1e-6 * (abs(slope * (x - l)) + curvature * (x - l) ** 2 + here) + 3e-7 * abs(slope) * (1 + l)
            assert parabola >= model.value(pixel(x)) - rounding - 3e-7 * abs(model.slope(pixel(x)).item()) * (1 + x)


def test_slope_by_differences():
    for curve in CURVES:
        for base in bases(900.0, 2e4, 30.0):
            model = Hardened(base, curve)
            for l in (0.5, 2.0, 5.0):
                low, high = np.float32(l - 0.01), np.float32(l + 0.01)
                fine = (model.value(pixel(high)) - model.value(pixel(low))) / (float(high) - float(low))
                assert model.slope(pixel(l)).item() == pytest.approx(fine, rel=2e-3, abs=0.2)


def test_precomputed_curvature_is_that_of_the_minimum():
    for base in bases(900.0, 2e4, 30.0):
        model = Hardened(base, SPECTRUM)
        at = model.line_integrals.item()
        low, high = (model.slope(pixel(at + s * 1e-2)).item() for s in (-1, 1))
        assert model.curvature(pixel(1.0), "precomputed").item() == pytest.approx((high - low) / 2e-2, rel=0.02)


# A cylinder along y, of whole voxels, so that no edge is blurred and no prior is needed: half-height, width at each step
STEPS = [Box((0, 0, 50), (60, 36, 16))]
STEPS += [Box((0, 0, 50 + side * z), (width, 36, 8)) for z, width in ((12, 40), (20, 20)) for side in (-1, 1)]
GRID = pp.Grid((6, 4, 6), (8, 9, 10), (-25, -13.5, 30))
INCIDENT = 1e5


def views():
    return pp.arc_views(
        pp.Panel((24, 100), (3, 3), (-148.5, -34.5, 0)), np.linspace(-50, 50, 21), radius=500, pivot=(0, 0, 50)
    )


@pytest.fixture(scope="module")
def shown():
    """Expected counts behind the cylinder: of the reference energy alone, and of the tube."""
    v = views()

    def at(energy):
        body = Phantom([(step, water(energy)) for step in STEPS])
        return np.stack([transmission(body, s, p, 3) for s, p in zip(v.source, v.panels, strict=True)])

    w = tube() / tube().sum()
    return INCIDENT * at(REFERENCE), INCIDENT * sum(a * at(e) for a, e in zip(w, ENERGIES, strict=True))


def found(mean, seed, likelihood=Transmission.of, corrected=False):
    """Attenuation of the cylinder, 1/mm: in the middle, and at the rim, where rays are short."""
    scan = pp.Scan(np.random.default_rng(seed).poisson(mean), INCIDENT, views())
    scan = precorrected(scan, SPECTRUM) if corrected else scan
    f = pp.reconstruct(scan, GRID, method="ml", likelihood=likelihood, levels=1, iterations=100, tolerance=0).values
    return np.array([f[1:-1, :, 2:4].mean(), f[2:4, :, [0, -1]].mean()], np.float64)


def test_cupping_goes_with_the_right_curve(shown):
    """Against the same cylinder in monochromatic light at the reference energy. The bound is four standard deviations of
    noise alone, and half of the 1 % by which a pixel's area over the steps' edges puts the monochromatic one itself off."""
    mono, poly = shown
    flat = np.array([found(mono, seed) for seed in range(3)])
    expected, bound = flat.mean(axis=0), 4 * flat.std(axis=0, ddof=1) + 0.005 * water(REFERENCE)
    np.testing.assert_allclose(expected, water(REFERENCE), rtol=0.012)
    for made in (
        found(poly, 11, lambda scan: Hardened(Transmission.of(scan), SPECTRUM)),
        found(poly, 12, lambda scan: Hardened(WeightedLeastSquares.of(scan), SPECTRUM)),
        found(poly, 13, corrected=True),
    ):
        assert (abs(made - expected) < bound).all()
        assert abs(np.diff(made) - np.diff(expected)) < bound.max()
    assert np.diff(found(poly, 11)) - np.diff(expected) > 5 * bound.max()


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: Spectrum([1, -1], [1, 1]), ("spectrum", "one weight (0 or more)")),
        (lambda: Spectrum([1, 1], [1, 0]), ("spectrum", "above 0")),
        (lambda: Hardened(next(bases(9, 9, 1)), Polynomial((1.0, -0.1))), ("the curve falls from l = 5",)),
        (lambda: Hardened(next(bases(9, 9, 1)), Polynomial((1.0, 0.1))), ("bends up at l = 0",)),
        (lambda: Hardened(next(bases(9, 9, 1)), lambda l: (l + 1, 1 + 0 * l, 0 * l)), ("g(0) = 0", "g(0) is 1")),
    ],
)
def test_curves_that_cannot_be_are_refused(make, told):
    with pytest.raises(DataError) as refusal:
        make()
    for words in told:
        assert words in str(refusal.value)
