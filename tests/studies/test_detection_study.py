"""The detection study: its data against closed forms, its observers against theory, its verdicts against its tables."""

import csv
import html
import re

import numpy as np
import pytest
from scipy.stats import norm
from support.running_server import ended

import palpate as pp
from palpate.errors import DataError
from palpate.scans.scatter.cross_sections import attenuation
from palpate.studies.detection.acquisition import DENSE, expose, lines, noise, path_lengths
from palpate.studies.detection.breast import random_breast, random_field
from palpate.studies.detection.config import MASS, QUICK, RESAMPLES, SLACK, TARGETS
from palpate.studies.detection.judgement import Judgement
from palpate.studies.detection.methods import JUDGED, OURS
from palpate.studies.detection.observers import (
    Observer,
    Seen,
    detectability,
    found_share,
    hotelling_scores,
    image_channels,
    laguerre_gauss,
    roc_areas,
)
from palpate.studies.detection.run import random_case
from palpate.studies.detection.signals import BESIDE, Signals, added_lengths

KIND = QUICK.kinds[0]


@pytest.fixture(scope="module")
def case():
    return random_case(KIND, 7, QUICK)


def test_the_texture_has_the_power_law_that_is_asked():
    grid = pp.Grid((64, 64, 64), (0.5, 0.5, 0.5))
    field = random_field(grid, 3.0, 1e6, np.random.default_rng(3))
    power = np.abs(np.fft.fftn(field)) ** 2
    f = np.sqrt(sum(np.meshgrid(*[np.fft.fftfreq(64, 0.5) ** 2] * 3, indexing="ij")))
    rings = [(f > a) & (f < 1.3 * a) for a in (0.1, 0.2, 0.4)]
    slope = np.polyfit(np.log([f[r].mean() for r in rings]), np.log([power[r].mean() for r in rings]), 1)[0]
    assert slope == pytest.approx(-3, abs=0.2)


def test_a_breast_has_the_gland_that_its_kind_asks_and_skin_around(case):
    breast, *_ = case
    inner = breast.depth > 2.0
    bare = random_breast(KIND, QUICK.fine, np.random.default_rng(1))
    assert KIND.glandular < bare.gland[inner].mean() < KIND.glandular + 0.15  # and ligaments
    assert (breast.gland[(breast.depth < 1.0) & (breast.tissue > 0)] == 1).all()
    assert (breast.tissue[breast.depth < -1] == 0).all()


def test_signals_lie_inside_and_apart_and_free_places_are_many(case):
    breast, signals, free = case
    assert {*signals.size} == {MASS, "0.3 mm", "0.4 mm"}
    far = np.linalg.norm(signals.centre[:, None, :2] - signals.centre[None, :, :2], axis=2)
    mass = np.array(signals.size) == MASS
    assert far[np.ix_(mass, ~mass)].min() > BESIDE
    assert len(free) > 50
    for point in (*signals.centre, *free):
        x, y, z = np.round((point - breast.grid.origin) / breast.grid.spacing[0]).astype(int)
        assert breast.depth[z, y, x] > 4


def test_added_lengths_are_the_volumes_of_what_was_added(case):
    """∫ length over the panel = volume x magnification² under a nearly upright beam, one ball each."""
    views = pp.arc_views(QUICK.views(KIND).panels[0], [0.0], radius=650)
    r = np.linspace(0, 1, 4001)
    profile = 4 * np.pi * np.trapezoid(r**2 * (1 - r**2) ** 1.5, r)
    for name, diameter, volume in (("0.4 mm", 0.4, np.pi * 0.4**3 / 6), (MASS, 5.0, 2.5**3 * profile)):
        signals = Signals(np.array([[1.3, 9.1, 20.0]]), [name], np.array([diameter]))
        masses, calcified = added_lengths(signals, views, (1, *views.panels[0].shape))
        found = (masses if name == MASS else calcified).sum() * np.prod(views.panels[0].pitch) * (630 / 650) ** 2
        assert found == pytest.approx(volume, rel=0.02)


def test_the_panel_counts_the_energy_that_comes_through(case):
    """A ray of known lengths, by the definition; its variance is that of quanta which count by their energy."""
    breast, *_ = case
    views = QUICK.views(KIND)
    fat, gland = path_lengths(breast, views)
    nothing = np.zeros_like(fat)
    exposure = expose((fat, gland), nothing, views, None)
    v, row, column = np.unravel_index(np.argmax(fat + gland), fat.shape)
    keV, photons = lines()
    through = photons * np.exp(
        -attenuation("adipose", keV) * fat[v, row, column] - attenuation("glandular", keV) * gland[v, row, column]
    )
    mean = photons @ keV / photons.sum()
    assert exposure.signal[v, row, column] == pytest.approx(through @ keV / (photons @ keV), rel=1e-4)
    assert exposure.variance[v, row, column] == pytest.approx(through @ keV**2 / (photons.sum() * mean**2), rel=1e-4)
    assert exposure.signal[v].max() == pytest.approx(1, abs=1e-5)  # air beside the breast
    draws = np.random.default_rng(0).standard_normal((200, *fat.shape), np.float32)[:, v, row, column]
    one = [
        1000 * exposure.signal[v, row, column] + np.sqrt(1000 * exposure.variance[v, row, column]) * d for d in draws
    ]
    assert np.std(one) == pytest.approx(np.sqrt(1000 * exposure.variance[v, row, column]), rel=0.15)


def test_a_calcification_lowers_what_its_shadow_counts_and_nothing_else(case):
    breast, signals, _ = case
    views = QUICK.views(KIND)
    lengths = path_lengths(breast, views)
    some = Signals(signals.centre[-1:], signals.size[-1:], signals.diameter[-1:])
    without, with_it = (expose(lengths, np.zeros_like(lengths[0]), views, s).signal for s in (None, some))
    changed = with_it < without * (1 - 1e-6)
    assert 0 < changed.sum() < 16 * len(views)
    calcified = added_lengths(some, views, without.shape)[1]
    assert (calcified[changed] > 0).all()
    keV, _ = lines()
    steep = attenuation("calcium oxalate", keV)
    drop = -np.log(with_it[changed] / without[changed]) / (DENSE * calcified[changed])
    assert steep.min() < drop.min() < drop.max() < steep.max()


def test_with_and_without_signals_the_noise_is_one(case):
    breast, signals, _ = case
    views = QUICK.views(KIND)
    lengths = path_lengths(breast, views)
    normal = np.random.default_rng(0).standard_normal(lengths[0].shape, np.float32)
    far = np.ones(lengths[0].shape, bool)
    masses, calcified = added_lengths(signals, views, far.shape)
    far &= (masses == 0) & (calcified == 0)
    scans = [noise(expose(lengths, np.zeros_like(normal), views, s), 5000, KIND.thick, normal) for s in (None, signals)]
    np.testing.assert_array_equal(scans[0].counts[far], scans[1].counts[far])
    assert scans[0].background.mean() > 20  # scatter is estimated even where there is none


def test_laguerre_gauss_channels_are_orthonormal():
    observer = Observer(3.0, 4, (1.0,))
    x = np.arange(-12, 12, 0.05)
    u = laguerre_gauss(x[:, None] ** 2 + x**2, observer).reshape(4, -1)
    np.testing.assert_allclose(u @ u.T * 0.05**2, np.eye(4), atol=1e-6)


def test_channels_move_with_the_place():
    """A blob between voxels gives what the same blob on a voxel gives: places are not rounded."""
    grid = pp.Grid((21, 61, 61), (0.5, 0.2, 0.2), (-6, -6, -5))
    z, y, x = np.meshgrid(grid.axis("z"), grid.axis("y"), grid.axis("x"), indexing="ij")
    observer = Observer(3.0, 3, (1.0, 2.0))
    seen = []
    for place in ((0.0, 0.0, 0.0), (0.07, -0.05, 0.2)):
        blob = np.exp(-((x - place[0]) ** 2 + (y - place[1]) ** 2 + (z - place[2]) ** 2) / 2)
        seen.append(image_channels(blob, grid, np.array([place]), observer)[0])
    np.testing.assert_allclose(seen[0], seen[1], rtol=0.01, atol=0.01 * np.abs(seen[0]).max())


@pytest.fixture(scope="module")
def gaussian():
    """Channels of known covariance and signal: the best observer's d' is √(ΔᵀK⁻¹Δ)."""
    rng = np.random.default_rng(5)
    root = rng.standard_normal((4, 4)) + 2 * np.eye(4)
    gain = np.array([0.5, -0.3, 1.0, 0.2])
    breasts = []
    for _ in range(20):
        absent = rng.standard_normal((60, 4)) @ root.T
        breasts.append(Seen(absent + gain, absent, rng.standard_normal((800, 4)) @ root.T))
    return breasts, float(np.sqrt(gain @ np.linalg.solve(root @ root.T, gain)))


def d_a(scores):
    """By every pair of a signal and a free place, of all breasts."""
    present, free = (np.concatenate([getattr(s, name) for s in scores]) for name in ("present", "free"))
    return detectability(float(np.mean(present[:, None] > free)), present.size * free.size)


def test_the_observer_is_the_best_linear_one(gaussian):
    breasts, best = gaussian
    scores = hotelling_scores(breasts, 5)
    assert d_a(scores) == pytest.approx(best, rel=0.08)
    assert found_share(scores, 1e-2) == pytest.approx(norm.sf(norm.isf(1e-2) - best), abs=0.03)


def test_the_observer_never_learns_on_the_breast_that_it_rates(gaussian):
    breasts, _ = gaussian
    before = hotelling_scores(breasts, 5)[3]
    wild = Seen(*(9 * a + 1 for a in (breasts[3].present, breasts[3].absent, breasts[3].free)))
    after = hotelling_scores([*breasts[:3], wild, *breasts[4:]], 5)[3]
    shift = after.free - 9 * before.free  # the same weights rate it: a change of scale and origin, no other
    np.testing.assert_allclose(shift, shift[0], atol=1e-6 * np.abs(after.free).max())


def test_noise_has_no_signal():
    rng = np.random.default_rng(2)
    breasts = [Seen(*(rng.standard_normal((n, 5)) for n in (40, 40, 500))) for _ in range(10)]
    assert abs(d_a(hotelling_scores(breasts, 5))) < 0.25


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("detection")
    code, out, err = ended("study detection --quick -o study --docs docs", folder)
    assert code == 0, err
    assert str(folder / "study" / "report.html") in out
    return folder / "study"


def table(study, name):
    with (study / "tables" / f"{name}.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_every_target_is_judged_by_the_tables(study):
    """Values, best rivals and verdicts of the report, again from the table of measures."""
    measures, claims = table(study, "measures"), table(study, "claims")
    assert len(claims) == len(TARGETS) * len(QUICK.doses)
    for claim in claims:
        reached = {
            row["method"]: float(row[claim["measure"]])
            for row in measures
            if row["dose"] == claim["dose"] and row[claim["measure"]]
        }
        rivals = {name: value for name, value in reached.items() if name not in OURS and name != "projections"}
        assert len(rivals) >= 11
        own, best = reached[JUDGED], max(rivals.values())
        assert rivals[claim["rival"]] == best
        expected = own - best if claim["measure"].endswith(" found") else own / best
        assert float(claim["value"]) == pytest.approx(expected, rel=1e-9, abs=1e-12)
        assert float(claim["low"]) <= float(claim["high"])
        assert (claim["met"] == "True") == (float(claim["low"]) > float(claim["least"]) - SLACK)
    text = html.unescape(re.sub("<[^>]+>", " ", (study / "report.html").read_text()))
    met = sum(claim["met"] == "True" for claim in claims)
    assert f"{met} of {len(claims)} targets are met" in text


@pytest.mark.slow
def test_every_picture_says_its_command(study):
    text = (study / "report.html").read_text()
    captions = re.findall("<figcaption>(.*?)</figcaption>", text)
    assert len(captions) == text.count("data:image/png;base64") == 2
    assert all(caption.endswith("Made by: palpate study detection --quick") for caption in captions)


@pytest.mark.slow
@pytest.mark.parametrize("on", [None, 2], ids=["here", "on workers"])
def test_a_resumed_study_reads_what_is_there(study, on):
    before = {path: path.read_bytes() for path in sorted((study / "runs").iterdir())}
    report = (study / "tables" / "measures.csv").read_text()
    lost = study / "runs" / f"{KIND.name}-1.npz"
    arrays = dict(np.load(lost))
    lost.unlink()
    pp.detection_study(study, quick=True, resume=True, on=on)
    made = dict(np.load(lost))
    assert made.keys() == arrays.keys()
    assert all(np.array_equal(made[name], arrays[name], equal_nan=True) for name in made)
    assert (study / "tables" / "measures.csv").read_text() == report
    kept = [path for path in before if path.name != f"{KIND.name}-1.npz"]
    assert all(path.read_bytes() == before[path] for path in kept)


def test_an_interval_holds_the_value_of_a_known_ratio():
    """Two methods whose noise differs by a factor: the interval of the ratio holds it and is no wider than it should be."""
    rng = np.random.default_rng(11)
    records = {}
    for seed in range(12):
        record = {}
        for method, factor in ((JUDGED, 1.0), ("rival", 2.0)):
            for size, observer in ((MASS, MASS), ("0.3 mm", "calcification"), ("0.4 mm", "calcification")):
                for what, n, gain in (
                    (f"{size}|present", 20, 1.0),
                    (f"{size}|absent", 20, 0),
                    (f"{observer}|free", 400, 0),
                ):
                    record[f"2500|{method}|{what}"] = gain + factor * rng.standard_normal((n, 2))
            record[f"2500|{method}|rmse"] = np.array(1.0)
        records["kind", seed] = record
    judgement = Judgement(records, QUICK)
    own, other = (judgement._scores(2500, name, MASS) for name in (JUDGED, "rival"))
    at = judgement.resamples
    assert len(at) == RESAMPLES
    ratios = [d_a([own[k] for k in a]) / d_a([other[k] for k in a]) for a in at[:200]]
    low, high = np.quantile(ratios, [0.025, 0.975])
    assert low < 2 < high < 3.5
    measure = judgement.measures(2500, JUDGED)["mass d_A"]
    assert [measure(a) for a in at[:5]] == pytest.approx([d_a([own[k] for k in a]) for a in at[:5]], rel=1e-9)
    areas = roc_areas(own)
    assert areas.shape == (12, 12)
    assert ((areas >= 0) & (areas <= 1)).all()


def test_bad_numbers_of_seeds_are_refused_before_work(tmp_path):
    for seeds in (0, 1, 5000):
        with pytest.raises(DataError, match="seeds: expected"):
            pp.detection_study(tmp_path / "s", seeds=seeds)
    assert not (tmp_path / "s").exists()
