import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import palpate as pp
from palpate.errors import DataError
from palpate.reconstruction.models.likelihood import Gaussian, Transmission, WeightedLeastSquares
from palpate.reconstruction.optimizers.problem import value_and_slope

counts = st.one_of(st.just(0.0), st.floats(0.1, 3e5))
incidents = st.floats(1, 3e5)
backgrounds = st.one_of(st.just(0.0), st.floats(0.01, 1e4))
line_integrals = st.one_of(st.just(0.0), st.floats(1e-6, 1e-2), st.floats(1e-2, 12))


readouts = st.floats(1, 1e4)  # background and variance of the read-out, photons²


def one_pixel(y, b, r, kind=Transmission):
    return kind(*(np.full((1, 1, 1), a, np.float32) for a in (y, b, r)))


def pixel(value):
    return np.full((1, 1, 1), value, np.float32)


def h(y, b, r, l):
    """-log Poisson likelihood in float64, from the numbers as float32 holds them."""
    y, b, r = (np.float64(np.float32(a)) for a in (y, b, r))
    m = b * np.exp(-np.float64(l)) + r
    return m - (y * np.log(m) if y > 0 else 0)


def normal(y, b, r, l):
    """-log of the normal density of variance m at y, without the constant; float64."""
    y, b, r = (np.float64(np.float32(a)) for a in (y, b, r))
    m = b * np.exp(-np.float64(l)) + r
    return (y - m) ** 2 / (2 * m) + np.log(m) / 2


@given(counts, incidents, readouts, line_integrals)
def test_gaussian_value_and_slope(y, b, r, l):
    model, l = one_pixel(y, b, r, Gaussian), float(np.float32(l))
    gained, expected = model.value(pixel(l)) - model.value(pixel(1.0)), normal(y, b, r, l) - normal(y, b, r, 1.0)
    largest = max(abs(normal(y, b, r, l)), abs(normal(y, b, r, 1.0)))
    assert gained == pytest.approx(expected, rel=1e-6, abs=1e-9 * (largest + 1))
    step = 1e-4
    fine = (normal(y, b, r, l + step) - normal(y, b, r, max(l - step, 0))) / (step + min(step, l))
    bend = (y + b) * (1 + y / r)  # l = 0: the difference is one-sided
    assert model.slope(pixel(l)).item() == pytest.approx(fine, rel=1e-4, abs=(1e-6 if l > step else step) * bend)


@settings(max_examples=300)
@given(counts, incidents, readouts, line_integrals, st.sampled_from(["optimal", "maximum"]))
def test_gaussian_surrogates_lie_above(y, b, r, l, kind):
    model, l = one_pixel(y, b, r, Gaussian), float(np.float32(l))
    slope, curvature = model.slope(pixel(l)).item(), model.curvature(pixel(l), kind).item()
    t = np.concatenate([[0], np.geomspace(1e-5, 25, 400)])
    parabola = normal(y, b, r, l) + slope * (t - l) + curvature / 2 * (t - l) ** 2
    truth = normal(y, b, r, t)
    rounding = 1e-13 * np.abs(truth).max() + 1.2e-7 * (abs(slope) * abs(t - l) + curvature * (t - l) ** 2)
    assert (parabola >= truth - rounding).all()
    assert model.curvature(pixel(l), "optimal").item() <= model.curvature(pixel(l), "maximum").item() * (1 + 1e-6)


@given(st.floats(10, 3e5), incidents, readouts)
def test_gaussian_precomputed_curvature_is_that_where_the_mean_is_the_count(y, b, r):
    """By differences of the slope, in float64, at m = y."""
    y, b, r = (float(np.float32(a)) for a in (y, b, r))
    made = one_pixel(y, b, r, Gaussian).curvature(pixel(1.0), "precomputed").item()
    if y <= r:
        assert made == 0
        return

    def slope(l):  # of h, m = (y − r) e^-l + r: l from where the mean is the count
        p = (y - r) * np.exp(-l)
        m = p + r
        return -p / 2 * (1 - (y / m) ** 2 + 1 / m)

    assert made == pytest.approx((slope(1e-5) - slope(-1e-5)) / 2e-5, rel=1e-4, abs=1e-4)


def test_a_gaussian_without_noise_in_the_dark_is_refused():
    with pytest.raises(DataError, match=r"gaussian likelihood: 1 measured pixels have neither.*electronic"):
        one_pixel(5, 10, 0, Gaussian)


def panel_of(n=300):
    return pp.Views([(0, 0, 500)], pp.Panel((n, n), (1, 1), (0, 0, 0)))


@pytest.mark.parametrize("sigma", [0.5, 3.0, 12.0])
@pytest.mark.parametrize("kind", [Transmission, Gaussian])
def test_one_line_integral_from_many_noisy_pixels_is_unbiased(kind, sigma):
    """The minimiser of Σh over 90 000 pixels of one line integral: within four standard errors of it, and as narrow as
    Fisher's bound says. Half the deviance is half a pixel each."""
    l, b, r, gain, n = 3.0, 400.0, 2.0, 2.5, 300  # about 20 photons behind the object
    mean = b * np.exp(-l)
    rng = np.random.default_rng(5)
    shown = gain * rng.poisson(mean + r, (1, n, n)) + rng.normal(0, sigma * gain, (1, n, n))
    scan = pp.integrating_scan(shown, gain * b, panel_of(n), gain * r, gain=gain, electronic=sigma * gain)
    model = kind.of(scan)
    at = np.linspace(l - 0.02, l + 0.02, 9)
    slopes = [model.slope(np.full((1, 1, 1), x, np.float32)).sum(dtype=np.float64) for x in at]
    estimate = np.interp(0, slopes, at)
    error = 1 / np.sqrt(n * n * mean**2 / (mean + r + sigma**2))
    assert abs(estimate - l) < 4 * error
    assert error < 1e-3 * l
    assert 2 * model.value(np.full((1, 1, 1), l, np.float32)) == pytest.approx(n * n, rel=0.05)


def test_weights_from_the_counts_draw_the_estimate_down():
    """Why the variance follows the mean: at 20 photons, least squares are off by what the other two are not."""
    l, b, n = 3.0, 400.0, 300
    rng = np.random.default_rng(6)
    scan = pp.integrating_scan(
        rng.poisson(b * np.exp(-l), (1, n, n)) + rng.normal(0, 3, (1, n, n)), b, panel_of(n), electronic=3
    )
    model = WeightedLeastSquares.of(scan)
    estimate = (model.weights * model.line_integrals).sum(dtype=np.float64) / model.weights.sum(dtype=np.float64)
    assert estimate < l - 0.02


def test_an_integrating_scan_adds_up_over_pixels():
    """Four pixels make one of four times the variance: mean and variance of the counts stay equal."""
    from palpate.reconstruction.multiresolution import coarser_scan

    rng = np.random.default_rng(7)
    shown = 2.0 * rng.poisson(50, (1, 300, 300)) + rng.normal(0, 12, (1, 300, 300))
    scan = pp.integrating_scan(shown, 200, panel_of(), gain=2.0, electronic=12)
    for part in (scan, coarser_scan(scan)):
        mean = part.incident.mean() / 2 + part.background.mean()
        assert part.counts.mean() == pytest.approx(mean, rel=0.01)
        assert part.counts.var() == pytest.approx(mean, rel=0.03)


def test_values_below_the_offset_are_taken():
    shown = np.full((1, 300, 300), -1.0)
    shown[0, 0, 0] = 40
    scan = pp.integrating_scan(shown, 100, panel_of(), electronic=3)
    assert scan.counts[0, 0, 1] == pytest.approx(8)
    assert pp.integrating_scan(shown, 100, panel_of(), electronic=0.5).counts[0, 0, 1] == 0


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"gain": 0.0}, ("gain", "units a photon", "0")),
        ({"electronic": -2.0}, ("electronic", "0 or more", "-2")),
        ({"gain": np.ones((2, 2))}, ("gain", "(2, 2)")),
        ({"values": np.ones((1, 2, 2))}, ("values", "(1, 2, 2)")),
        ({"values": np.full((1, 300, 300), np.nan)}, ("counts", "not finite")),
    ],
)
def test_what_no_panel_shows_is_refused(options, told):
    arguments = {"values": np.ones((1, 300, 300)), "incident": 100, "views": panel_of()} | options
    with pytest.raises(DataError) as refusal:
        pp.integrating_scan(**arguments)
    for words in told:
        assert words in str(refusal.value)


@given(counts, incidents, backgrounds, line_integrals)
def test_value_is_minus_log_poisson_up_to_a_constant(y, b, r, l):
    model = one_pixel(y, b, r)
    l = float(np.float32(l))
    gained = model.value(pixel(l)) - model.value(pixel(1.0))
    expected = h(y, b, r, l) - h(y, b, r, 1.0)
    assert gained == pytest.approx(expected, rel=1e-6, abs=1e-9 * (y * 10 + b + r + 1))


@given(counts, incidents, backgrounds, st.floats(0.01, 12))
def test_slope_against_finite_differences(y, b, r, l):
    l, step = float(np.float32(l)), 1e-4
    fine = (h(y, b, r, l + step) - h(y, b, r, l - step)) / (2 * step)
    assert one_pixel(y, b, r).slope(pixel(l)).item() == pytest.approx(fine, rel=1e-4, abs=1e-6 * (y + b + 1))


@settings(max_examples=300)
@given(counts, incidents, backgrounds, line_integrals, st.sampled_from(["optimal", "maximum"]))
def test_monotone_surrogates_lie_above_the_likelihood(y, b, r, l, kind):
    model, l = one_pixel(y, b, r), float(np.float32(l))
    slope, curvature = model.slope(pixel(l)).item(), model.curvature(pixel(l), kind).item()
    t = np.concatenate([[0], np.geomspace(1e-5, 15, 400)])
    parabola = h(y, b, r, l) + slope * (t - l) + curvature / 2 * (t - l) ** 2
    truth = np.array([h(y, b, r, x) for x in t])
    # slope and curvature are stored with 24 bits, h itself has 53
    rounding = 1e-13 * np.abs(truth).max() + 1.2e-7 * (abs(slope) * abs(t - l) + curvature * (t - l) ** 2) + 1e-12 * y
    assert (parabola >= truth - rounding).all()


@given(counts, incidents, backgrounds, st.floats(0.05, 12))
def test_optimal_curvature_is_the_smallest(y, b, r, l):
    """Its parabola touches h at l = 0 as well, unless even a straight line stays above."""
    model, l = one_pixel(y, b, r), float(np.float32(l))
    optimal = model.curvature(pixel(l), "optimal").item()
    assert optimal <= model.curvature(pixel(l), "maximum").item() * (1 + 1e-6) + 1e-6 * b * 1e-3
    if optimal > 1e-3 * b:
        parabola = h(y, b, r, l) - model.slope(pixel(l)).item() * l + optimal / 2 * l**2
        assert parabola == pytest.approx(h(y, b, r, 0), abs=1e-6 * (b + r + 10 * y) * (1 + l))


@pytest.mark.parametrize("l", [1e-6, 1e-5, 1e-4, 1e-3, 1e-2])
def test_optimal_curvature_keeps_its_digits_for_thin_objects(l):
    """Without care float32 doubles it at l = 1e-3, b = 2e5. Here against h''(0) − l h'''(0)/3·2 + …, r = 0: h'' = b e^-l."""
    optimal = one_pixel(1.5e5, 2e5, 0).curvature(pixel(l), "optimal").item()
    assert optimal == pytest.approx(2e5, rel=l + 1e-6)


@given(st.floats(10, 3e5), incidents, st.floats(0, 5))
def test_precomputed_curvature_is_that_of_the_minimum(y, b, r):
    signal = np.float64(np.float32(y)) - np.float64(np.float32(r))
    expected = signal**2 / np.float32(y)
    assert one_pixel(y, b, r).curvature(pixel(1.0), "precomputed").item() == pytest.approx(expected, rel=1e-5)
    assert one_pixel(1, b, 2).curvature(pixel(1.0), "precomputed").item() == 0


def small_scan(mask):
    rng = np.random.default_rng(1)
    views = pp.Views([(0, 0, 500)], pp.Panel((4, 5), (1, 1), (0, 0, 0)))
    return pp.Scan(rng.poisson(300, (1, 4, 5)), 1000, views, 5, mask)


@pytest.mark.parametrize("garbage", [np.nan, np.inf, -1e30, 7.0])
@pytest.mark.parametrize("kind", [Transmission, Gaussian, WeightedLeastSquares])
def test_masked_pixels_carry_no_weight(kind, garbage):
    """Whatever lies there, the answers are those of a scan with nothing there, to the last bit."""
    mask = np.ones((1, 4, 5), bool)
    mask[0, 1, 2] = False
    clean = small_scan(mask)
    counts, incident, background = (
        np.where(mask, a, garbage) for a in (clean.counts, clean.incident, clean.background)
    )
    dirty = pp.Scan(counts, incident, clean.views, background, mask)
    model, reference, l = kind.of(dirty), kind.of(clean), np.ones((1, 4, 5), np.float32)
    other = l.copy()
    other[0, 1, 2] = 7
    assert model.value(l) == model.value(other) == reference.value(l) > 0
    assert model.slope(l)[0, 1, 2] == 0
    assert (model.slope(l) == reference.slope(l)).all()
    assert (model.line_integrals == reference.line_integrals).all()
    for curvature in ("precomputed", "optimal", "maximum"):
        assert model.curvature(l, curvature)[0, 1, 2] == 0
        assert (model.curvature(l, curvature) == reference.curvature(l, curvature)).all()
    assert not model.measured[0, 1, 2]
    assert np.count_nonzero(model.measured) == 19


def test_value_is_zero_where_the_mean_is_the_count():
    scan = small_scan(None)
    model = Transmission.of(scan)
    at_best = np.log(scan.incident / (scan.counts - scan.background)).astype(np.float32)
    assert model.value(at_best) == pytest.approx(0, abs=1e-6)
    assert model.value(at_best + np.float32(0.1)) > 1
    np.testing.assert_allclose(model.line_integrals, at_best, rtol=1e-6)


def test_least_squares_weights_are_inverse_variances_of_the_line_integral():
    rng = np.random.default_rng(3)
    b, m, r, sigma = 2000.0, 400.0, 30.0, 8.0
    views = pp.Views([(0, 0, 500)], pp.Panel((300, 300), (1, 1), (0, 0, 0)))
    noisy = rng.poisson(m + r, (1, 300, 300)) + rng.normal(0, sigma, (1, 300, 300))
    model = WeightedLeastSquares.of(pp.Scan(noisy, b, views, r), electronic=sigma)
    assert 1 / model.line_integrals.var() == pytest.approx(np.median(model.weights), rel=0.03)
    slope = (model.value(model.line_integrals + np.float32(0.1))) / (0.1**2 / 2)
    assert slope == pytest.approx(model.weights.sum(dtype=np.float64), rel=1e-4)


def test_weights_of_nothing_are_refused():
    with pytest.raises(DataError, match="weights: expected none below 0"):
        WeightedLeastSquares(np.ones((1, 2, 2)), np.zeros((1, 2, 2)))


def test_objective_has_the_same_bits_for_one_and_two_threads():
    from palpate import _core

    rng = np.random.default_rng(2)
    shape = (3, 50, 70)
    model = Transmission(*(rng.uniform(100, 1000, shape).astype(np.float32) for _ in range(3)))
    l = rng.uniform(0, 3, shape).astype(np.float32)
    values = []
    for n in (1, 2, 3):
        _core.base.set_threads(n)
        values.append(model.value(l))
    _core.base.set_threads(0)
    assert values[0] == values[1] == values[2] != 0


@pytest.mark.parametrize("kind", [Transmission, Gaussian])
def test_value_and_slope_in_one_pass_are_the_same(kind):
    rng = np.random.default_rng(4)
    y, b, r = (rng.uniform(low, high, (2, 61, 83)).astype(np.float32) for low, high in ((0, 90), (1, 200), (1, 20)))
    y[rng.random(y.shape) < 0.1] = 0
    b[rng.random(y.shape) < 0.1] = 0  # not measured: what lies there must not matter
    y[(b == 0) & (rng.random(y.shape) < 0.5)] = np.nan
    model, l = kind(y, b, r), rng.uniform(0, 8, y.shape).astype(np.float32)
    slope = np.full(y.shape, np.nan, np.float32)
    assert value_and_slope(model, l, slope) == pytest.approx(model.value(l), rel=1e-12)
    np.testing.assert_allclose(slope, model.slope(l), rtol=1e-6, atol=1e-6)
    fitted = WeightedLeastSquares(l, np.where(b > 0, r, 0))
    assert value_and_slope(fitted, l + 1, slope) == fitted.value(l + 1)
    assert (slope == fitted.slope(l + 1)).all()


@pytest.mark.parametrize("net", [0.0, -3.0, 0.2, 0.5, 2.0, 40.0])
def test_a_pixel_without_a_net_count_is_taken_to_have_half_a_photon(net):
    shown = float(one_pixel(10 + net, 1000.0, 10.0).line_integrals[0, 0, 0])
    assert shown == pytest.approx(np.log(1000 / max(net, 0.5)), rel=1e-5)
