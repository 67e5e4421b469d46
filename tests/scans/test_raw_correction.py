"""Raw read-outs to counts: what was planted is removed, the counts stay Poisson, and every wrong flat is refused by name."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from support.raw_detector import heel_of, planted, raw_case

import palpate as pp
from palpate.errors import DataError
from palpate.scans.bad_pixels import CHANGED, DEAD, GIVEN, HOT, LINE, NOISY
from palpate.scans.beam_profile import fit_beam_profile
from palpate.scans.intensity_correction import line_integrals

SHAPE = (96, 120)
LEVEL = pp.Panel(SHAPE, (2, 2), (-119, -95, 0))


@pytest.fixture(scope="module")
def case():
    return raw_case(3, SHAPE)


def corrected(case, **options):
    return pp.correct_scan(
        options.pop("raw", case.raw),
        case.views,
        options.pop("dark", case.dark),
        options.pop("flat", case.flat),
        **{"lag": case.detector.lag, "dose": case.dose, **options},
    )


# --- what was planted is removed -------------------------------------------------------------------------------------


def test_without_noise_the_line_integrals_are_those_of_a_perfect_panel():
    case = raw_case(4, SHAPE, noise=False)
    done = corrected(case, gain=2.0)
    error = (line_integrals(done.scan) - line_integrals(case.clean))[done.scan.mask]
    assert np.abs(error).max() < 1e-5
    assert np.array_equal(done.kinds > 0, case.detector.dead)


def test_with_noise_the_line_integrals_are_those_of_the_same_photons(case):
    done = corrected(case)
    error = (line_integrals(done.scan) - line_integrals(case.clean))[done.scan.mask]
    # All that differs is the noise of the flat, and of the read-out where little is left of the beam.
    photons = case.incident[0] / case.dose[0]
    read = (case.detector.noise / case.detector.gain / case.expected) ** 2
    expected = np.sqrt(np.mean((1 / (len(case.flat) * photons) + read)[done.scan.mask]))
    assert np.sqrt(np.mean(error**2)) == pytest.approx(expected, rel=0.1)
    assert expected < 0.005


def test_corrected_counts_are_poisson_counts(case):
    done = corrected(case)
    scan, mask = done.scan, done.scan.mask
    mean = scan.incident * case.expected / case.incident
    variance = np.mean((scan.counts - scan.background - mean)[mask] ** 2)
    flat = np.mean((mean**2 / (len(case.flat) * case.incident[0] / case.dose[0]))[mask])  # what the flat's noise adds
    assert variance == pytest.approx(np.mean((mean + scan.background)[mask]) + flat, rel=0.02)


def test_the_gain_comes_from_the_noise_of_the_flats(case):
    done = corrected(case)
    good = done.kinds == 0
    ratio = done.gain[good] / case.detector.gain[good]
    assert np.mean(ratio) == pytest.approx(1, abs=0.01)
    assert np.std(ratio) < 0.015  # the panel's own pattern is ±20 %
    assert done.electronic == pytest.approx(case.detector.noise, rel=0.1)


def test_a_known_gain_is_taken_as_it_is(case):
    given = np.where(case.detector.dead, 1.0, case.detector.gain)
    done = corrected(case, gain=given)
    good = done.kinds == 0
    assert np.allclose(done.gain[good], given[good])
    clean = case.clean.counts[:, good]
    assert np.corrcoef(done.scan.counts[:, good].ravel(), clean.ravel())[0, 1] > 0.9999


def test_a_flat_for_each_view_serves_a_tube_that_moves():
    rng = np.random.default_rng(5)
    case = raw_case(5, SHAPE, lag=0.0, heel=0.0, lines=0, dead=0.0)
    views = pp.arc_views(LEVEL, np.linspace(-20, 20, 5), radius=600, pivot=(0, 0, 40))
    fluence = _fluence(views)
    beam = 20_000 * fluence / fluence.max()
    flats, raw = (case.detector.read(rng.poisson(b)) for b in (beam, 0.5 * beam))
    done = pp.correct_scan(raw, views, case.dark, flats, flat_by_view=True, gain=2.0)
    assert np.median(line_integrals(done.scan)[done.scan.mask]) == pytest.approx(np.log(2), abs=1e-3)
    assert np.allclose(done.scan.incident.mean(axis=(1, 2)) / beam.mean(axis=(1, 2)), 1, atol=0.02)


def test_one_flat_follows_a_tube_that_moves_by_the_inverse_square_law():
    case = raw_case(6, SHAPE, lag=0.0, heel=0.0, lines=0, dead=0.0, noise=False)
    views = pp.arc_views(LEVEL, np.linspace(-20, 20, 5), radius=600, pivot=(0, 0, 40))
    beam = 1e10 * _fluence(views)
    for gain, tolerance in (
        (np.full(SHAPE, 2.0), 1e-4),
        (case.detector.gain, 0.03),
    ):  # a pattern blurs the fit of the beam
        panel = replace(case.detector, gain=gain)
        raw, flat = panel.read(0.5 * beam), panel.read(beam[2:3])
        done = pp.correct_scan(raw, views, case.dark, flat, gain=2.0)
        assert np.allclose(line_integrals(done.scan), np.log(2), atol=tolerance)
    assert np.ptp(_fluence(views), axis=0).max() / _fluence(views).max() > 0.2  # there was something to follow
    assert any("view 2" in note for note in done.notes)


def test_the_heel_effect_moves_with_a_tube_that_aims_at_the_panels_middle():
    case = raw_case(6, SHAPE, lag=0.0, heel=0.0, lines=0, dead=0.0, noise=False)
    views = pp.arc_views(LEVEL, np.linspace(-25, 25, 5), radius=300, pivot=(0, 0, 0))
    rows, columns = np.indices(SHAPE)
    heel = np.empty(views.shape)
    for k, source in enumerate(views.source):  # the tube swings in x-z, so its rows' axis stays along y
        ray = LEVEL.points(np.stack([rows.ravel(), columns.ravel()], 1)) - source
        slope = ray[:, 1] / (ray @ (-source / np.linalg.norm(source)))
        heel[k] = (1 + 0.5 * slope).reshape(SHAPE)
    beam = 1e10 * _fluence(views) * heel
    panel = replace(case.detector, gain=np.full(SHAPE, 2.0))
    done = pp.correct_scan(panel.read(0.5 * beam), views, case.dark, panel.read(beam[2:3]), gain=2.0)
    error = np.abs(line_integrals(done.scan) - np.log(2))
    inside = np.abs(heel - 1) < 0.9 * np.abs(heel[2] - 1).max()  # angles that the flat shows
    assert error[inside].max() < 1e-3
    assert np.abs(heel - heel[2]).max() > 0.03


def test_flats_of_the_views_in_the_reverse_order_are_refused():
    rng = np.random.default_rng(14)
    case = raw_case(14, SHAPE, lag=0.0, heel=0.0, lines=0, dead=0.0)
    views = pp.arc_views(LEVEL, np.linspace(-20, 20, 5), radius=600, pivot=(0, 0, 40))
    beam = 2e4 * _fluence(views) / _fluence(views).max()
    thick = np.where(disc(48, 60, 30), 1.0, 0.0)
    flats, raw = (case.detector.read(rng.poisson(b)) for b in (beam, beam * np.exp(-thick)))
    pp.correct_scan(raw, views, case.dark, flats, flat_by_view=True, gain=2.0)
    with pytest.raises(DataError, match=r"flat: air in the views changes .* across the columns"):
        pp.correct_scan(raw, views, case.dark, flats[::-1], flat_by_view=True, gain=2.0)


def _fluence(views):
    """cos / r² of each pixel and view, pixel by pixel."""
    found = np.empty(views.shape)
    rows, columns = np.indices(views.shape[1:])
    for k, (source, panel) in enumerate(zip(views.source, views.panels, strict=True)):
        ray = panel.points(np.stack([rows.ravel(), columns.ravel()], 1)) - source
        r = np.linalg.norm(ray, axis=1)
        found[k] = (np.abs(ray @ panel.normal) / r / r**2).reshape(views.shape[1:])
    return found


def test_the_smooth_beam_is_found_under_the_pattern_of_the_panel():
    rng = np.random.default_rng(7)
    case = raw_case(7, SHAPE)
    panel, source = case.views.panels[0], case.views.source[0]
    beam = 1e9 * _fluence(case.views[:1])[0] * heel_of(SHAPE, 0.1)
    flat = beam * rng.uniform(0.8, 1.2, SHAPE)
    flat[:3], flat[50, 60:80] = 0, 0
    found = fit_beam_profile(flat, flat > 0, source, panel).on(source, panel)
    assert np.std(found / beam) < 0.01
    assert np.mean(found / beam) == pytest.approx(1, abs=0.01)


def test_air_in_the_views_tells_their_doses(case):
    done = corrected(case, dose="air")
    assert np.allclose(done.dose, case.dose, rtol=3e-3)
    assert np.ptp(case.dose) > 0.1


def test_an_offset_of_a_view_is_subtracted(case):
    offset = np.linspace(-100, 200, len(case.views))
    plain, shifted = corrected(case), corrected(case, raw=case.raw + offset[:, None, None], offset=offset)
    assert np.allclose(plain.scan.counts, shifted.scan.counts, atol=0.05)


def test_darks_one_a_view_take_out_a_drift(case):
    drift = np.linspace(0, 300, len(case.views))[:, None, None]
    done = corrected(case, raw=case.raw + drift, dark=case.dark.mean(axis=0) + drift, dark_by_view=True, electronic=4.0)
    beams = case.flat + drift.mean()
    done = corrected(
        case, raw=case.raw + drift, dark=case.dark.mean(axis=0) + drift, flat=beams, dark_by_view=True, electronic=4.0
    )
    assert np.allclose(done.scan.counts[done.scan.mask], corrected(case).scan.counts[done.scan.mask], rtol=0.01, atol=5)


def test_saturated_values_of_views_are_masked(case):
    top = np.quantile(case.raw, 0.97)
    done = corrected(case, raw=np.minimum(case.raw, top))
    good = done.kinds == 0
    assert not done.scan.mask[:, good][(case.raw >= top)[:, good]].any()
    assert done.saturated == np.count_nonzero((case.raw >= top)[:, good])


# --- bad pixels ------------------------------------------------------------------------------------------------------


def test_each_kind_of_bad_pixel_is_found():
    rng = np.random.default_rng(8)
    shape = (60, 80)
    dark = 300 + 5 * rng.standard_normal((8, *shape))
    flat = dark + rng.uniform(1600, 2400, shape) + 10 * rng.standard_normal((8, *shape))
    flat[:, 5, 6] = dark[:, 5, 6]
    dark[:, 9, 9] += 400
    flat[:, 9, 9] += 400
    dark[:, 20, 20] += 200 * rng.standard_normal(8)
    flat[:, :, 33] = dark[:, :, 33]
    given = np.zeros(shape, bool)
    given[1, 1] = True
    kinds = pp.find_bad_pixels(dark, flat, given)
    assert (kinds[5, 6], kinds[9, 9], kinds[20, 20], kinds[1, 1]) == (DEAD, HOT, NOISY, GIVEN)
    assert (kinds[:, 33] == LINE).all()
    assert np.count_nonzero(kinds) == 4 + shape[0]


def test_a_pixel_and_a_line_that_died_after_the_flat_are_found_in_the_views(case):
    raw = case.raw.copy()
    alive = np.argwhere(~case.detector.dead)[777]
    row = int(np.flatnonzero(case.detector.dead.mean(axis=1) < 0.1)[30])
    raw[:, alive[0], alive[1]] = 301
    raw[:, row] *= 0.6
    done = corrected(case, raw=raw)
    assert done.kinds[tuple(alive)] == CHANGED
    assert (done.kinds[row] > 0).all()
    assert np.count_nonzero(done.kinds == CHANGED) <= 1 + SHAPE[1]


# --- lag -------------------------------------------------------------------------------------------------------------


def test_lag_is_removed_exactly_for_any_sum_of_exponentials():
    rng = np.random.default_rng(9)
    lag = pp.Lag(((0.02, 0.4), (0.01, 0.95)))
    x = rng.uniform(0, 1000, (12, 3, 4))
    h = lag.response(12)
    y = np.stack([sum(h[j] * x[k - j] for j in range(k + 1)) for k in range(12)])
    assert np.allclose(pp.deconvolve_lag(y, lag), x, rtol=1e-5)
    assert lag.response(2000).sum() == pytest.approx(1)


def test_first_order_lag_is_the_recursive_filter():
    x = np.array([5.0, 0, 7, 7])
    y = [0.97 * x[0]]
    for k in (1, 2, 3):
        y.append(0.97 * x[k] + 0.03 * y[-1])
    assert np.allclose(pp.deconvolve_lag(np.reshape(y, (4, 1, 1)), pp.Lag.first_order(0.03)).ravel(), x, atol=1e-5)


@pytest.mark.parametrize("terms", [((0.03, 0.03),), ((0.05, 0.6),), ((0.04, 0.3), (0.01, 0.9))])
def test_lag_is_measured_from_afterglow(terms):
    lag = pp.Lag(terms)
    h = lag.response(500)
    left = np.array([h[k:].sum() for k in range(1, 9)])  # a long exposure, then nothing
    frames = 100 + 2000 * left[:, None, None] * np.ones((8, 10, 12))
    found = pp.lag_from_afterglow(frames, np.full((10, 12), 2100.0), np.full((10, 12), 100.0))
    assert np.allclose(found.response(8), h[:8], atol=2e-5)


def test_no_afterglow_is_no_lag():
    rng = np.random.default_rng(10)
    frames = 100 + rng.standard_normal((3, 20, 20))
    assert pp.lag_from_afterglow(frames, np.full((20, 20), 2100.0), 100).terms == ()


def test_lag_that_is_left_in_shows():
    case = raw_case(12, SHAPE, noise=False)
    largest = [
        np.abs((line_integrals(d.scan) - line_integrals(case.clean))[d.scan.mask]).max()
        for d in (corrected(case, gain=2.0, lag=0.0), corrected(case, gain=2.0))
    ]
    assert largest[0] > 0.02
    assert largest[1] < 1e-5


# --- gain ------------------------------------------------------------------------------------------------------------


def test_photon_transfer_is_right_whatever_the_read_out_noise():
    rng = np.random.default_rng(11)
    N = rng.poisson(5000, (30, 64, 64))
    flats = 200 + 3.0 * N + 150 * rng.standard_normal(N.shape)
    assert pp.photon_transfer_gain(flats, 200, electronic=150) == pytest.approx(3.0, rel=0.02)
    assert pp.photon_transfer_gain(flats, 200) > 3.5


# --- refusals --------------------------------------------------------------------------------------------------------


def net(case, factor):
    """The flat with its signal multiplied."""
    dark = case.dark.mean(axis=0)
    return dark + factor * (case.flat - dark)


def disc(row, column, radius):
    r, c = np.indices(SHAPE)
    return (r - row) ** 2 + (c - column) ** 2 < radius**2


def holed(frames, value):
    broken = np.array(frames, float)
    broken[1, 7, 9] = value
    return broken


WRONG = {
    "flat of other binning": lambda c: ({"flat": c.flat[:, ::2, ::2]}, "flat: frames of .* binning"),
    "dark transposed": lambda c: ({"dark": c.dark.transpose(0, 2, 1)}, "dark: .* transpose"),
    "flat that is the dark": lambda c: ({"flat": c.dark}, "flat: it is the dark"),
    "flat without beam": lambda c: ({"flat": c.dark[::-1] + 0.5}, "flat: no brighter than the dark"),
    "exchanged": lambda c: ({"flat": c.dark, "dark": c.flat}, "dark: brighter than the flat .* exchanged"),
    "dark above views": lambda c: (
        {"raw": np.minimum(c.raw, 290), "dark": c.dark},
        "dark: brighter than the views",
    ),
    "saturated": lambda c: ({"flat": np.minimum(c.flat, 41_000)}, "flat: saturated: .* frame .* row .* less exposure"),
    "a marker": lambda c: (
        {"flat": net(c, np.where(disc(40, 70, 8), 0.02, 1))},
        "flat: .* side by side .* row .* object",
    ),
    "a plate": lambda c: ({"flat": net(c, np.where(disc(30, 30, 14), 0.7, 1))}, "flat: .*object"),
    "a view": lambda c: ({"flat": c.raw[4], "gain": 2.0}, "flat: .*object"),
    "views as repeats": lambda c: ({"flat": c.raw}, "flat: frame .* no repeats"),
    "one frame of half exposure": lambda c: (
        {"flat": net(c, np.where(np.arange(len(c.flat)) == 2, 0.5, 1)[:, None, None])},
        "flat: frame 2 .* exposure",
    ),
    "heel on the other side": lambda c: (
        {"flat": net(c, heel_of(SHAPE, 0.1)[::-1] / heel_of(SHAPE, 0.1))},
        "flat: air in the views changes .* across the rows .* heel",
    ),
    "turned": lambda c: ({"flat": c.flat[:, ::-1, ::-1], "dark": c.dark[:, ::-1, ::-1]}, "flat: .* turned by 180"),
    "upside down": lambda c: ({"flat": c.flat[:, ::-1], "dark": c.dark[:, ::-1]}, "flat: .* upside down"),
    "mirrored": lambda c: ({"flat": c.flat[:, :, ::-1], "dark": c.dark[:, :, ::-1]}, "flat: .* mirrored"),
    "another panel": lambda c: (
        {"flat": (o := raw_case(77, SHAPE)).flat, "dark": o.dark},
        "flat: its pixel pattern is not in the views",
    ),
    "views that were flat-fielded": lambda c: (
        {"raw": 300 + 4e4 * np.maximum(c.raw - c.dark.mean(0), 0) / np.maximum(c.flat.mean(0) - c.dark.mean(0), 100)},
        "flat: .* not in the views .* flat-fielded already",
    ),
    "underexposed": lambda c: ({"flat": net(c, 0.4)}, "flat: the views are up to .* dose"),
    "NaN in the flat": lambda c: (
        {"flat": holed(c.flat, np.nan)},
        "flat: 1 values are not finite .*frame 1, row 7, column 9",
    ),
    "negative flat": lambda c: ({"flat": holed(c.flat, -3)}, "flat: 1 values are negative .*row 7, column 9"),
    "NaN in the dark": lambda c: ({"dark": holed(c.dark, np.nan)}, "dark: 1 values are not finite"),
    "negative views": lambda c: ({"raw": holed(c.raw, -3)}, "raw: 1 values are negative"),
    "other views": lambda c: ({"raw": c.raw[:4]}, "raw: expected"),
    "words": lambda c: ({"flat": np.full(SHAPE, "a")}, "flat: expected real numbers"),
    "no gain": lambda c: ({"flat": c.flat.mean(axis=0)}, "gain: one flat tells no noise"),
    "frames that are copies": lambda c: ({"flat": np.repeat(c.flat[:1], 4, axis=0)}, "gain: the flats do not vary"),
    "gain of 0": lambda c: ({"gain": 0.0}, "gain: expected .* above 0"),
    "gain of another panel": lambda c: ({"gain": np.ones((3, 4))}, "gain: expected a number or"),
    "dose of 0": lambda c: ({"dose": np.where(np.arange(9) == 3, 0, 1)}, "dose: view 3"),
    "doses of other views": lambda c: ({"dose": [1, 2]}, "dose: expected .* 9"),
    "dose by a word": lambda c: ({"dose": "sky"}, "dose: expected numbers or 'air'"),
    "lag in percent": lambda c: ({"lag": 3.0}, "lag: .* 3 % of lag is 0.03"),
    "flats for views": lambda c: ({"flat_by_view": True, "gain": 2.0}, "flat: 20 frames, but one for each of 9 views"),
    "a view that is not there": lambda c: ({"flat_view": 9}, "flat_view: 9 is not there"),
    "bad pixels as numbers": lambda c: ({"bad_pixels": np.zeros(SHAPE)}, "bad_pixels: expected bool"),
    "noise below 0": lambda c: ({"electronic": -1.0}, "electronic: "),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_input_is_refused_by_name(case, name):
    options, words = WRONG[name](case)
    with pytest.raises(DataError, match=words):
        corrected(case, **options)


def test_a_collimator_in_the_flat_is_accepted_once_it_is_masked(case):
    hidden = np.zeros(SHAPE, bool)
    hidden[:10] = True
    flat = net(case, np.where(hidden, 0.01, 1))
    with pytest.raises(DataError, match="collimator"):
        corrected(case, flat=flat)
    done = corrected(case, flat=flat, bad_pixels=hidden)
    assert not done.scan.mask[:, :10].any()


@pytest.mark.parametrize("seed", range(120, 124))
def test_right_scans_are_not_refused(seed):
    rng = np.random.default_rng(seed)
    case = raw_case(seed, SHAPE, frames=int(rng.integers(2, 12)), photons=float(rng.choice([300, 3000, 30_000])))
    corrected(case)
    flat_panel = replace(case.detector, gain=np.full(SHAPE, 2.0))  # no pattern of its own: nothing to compare
    beam = case.incident[0] / case.dose[0]
    wedge = case.incident * np.exp(-np.linspace(0.5, 2, SHAPE[1]))  # no air at all, and a slope
    frames = flat_panel.read(rng.poisson(np.broadcast_to(beam, (6, *SHAPE))), rng)
    pp.correct_scan(flat_panel.read(rng.poisson(wedge), rng), case.views, case.dark, frames, lag=0.03, dose=case.dose)


# --- the planted panel itself ----------------------------------------------------------------------------------------


def test_the_planted_panel_is_as_it_says():
    panel = planted((200, 240), 1)
    assert np.quantile(panel.gain / 2, [0, 1]) == pytest.approx([0.8, 1.2], abs=1e-3)
    share = 1 - (1 - 0.01) * (1 - panel.dead.all(axis=1).mean()) * (1 - panel.dead.all(axis=0).mean())
    assert panel.dead.mean() == pytest.approx(share, abs=0.002)
    assert panel.dead.all(axis=1).sum() + panel.dead.all(axis=0).sum() == 5
    frames = panel.read(np.stack([np.full((200, 240), 1000.0), np.zeros((200, 240))]))
    signal = (frames - panel.dark)[:, ~panel.dead]
    assert np.allclose(signal[1] / signal[0], 0.03)
    assert stats.kstest(panel.gain.ravel(), "uniform", (1.6, 0.8)).pvalue > 0.01
