"""The doubt study: its bodies against closed forms, statistics against definitions, verdicts against its records."""

import csv
import html
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binomtest
from support.running_server import ended

import palpate as pp
from palpate.errors import DataError
from palpate.studies.doubt.bodies import random_body
from palpate.studies.doubt.config import COVER, COVERAGE, DEPTHS, DIAMETERS, QUICK, WIDTH
from palpate.studies.doubt.judgement import JUDGED, Judgement, binomial_interval, brier_score, spiegelhalter
from palpate.studies.doubt.run import true_forces
from palpate.tissue.lump_uncertainty import WEBER_TOLD


@pytest.fixture(scope="module")
def body():
    return random_body(1003, QUICK)


def test_a_body_has_the_lump_that_is_said(body):
    volume = body.shares.sum() * body.breast.grid.voxel_volume
    assert volume == pytest.approx(4 / 3 * np.pi * np.prod(body.radii), rel=0.03)
    assert DIAMETERS[0] <= body.diameter <= DIAMETERS[1]
    top = body.breast.grid.bounds[1][2]
    assert body.radii[2] + COVER <= top - body.centre[2] <= DEPTHS
    inside = body.breast.tissue > 0.99
    full = (body.shares == 1) & inside
    assert np.ptp(body.values[full]) == pytest.approx(0, abs=1e-6)  # no texture shows through
    again = random_body(1003, QUICK)
    np.testing.assert_array_equal(again.scan.counts, body.scan.counts)
    assert not np.array_equal(random_body(1004, QUICK).scan.counts, body.scan.counts)


def test_the_scan_counts_what_passes(body):
    """In air the incident photons, with their Poisson noise; behind the breast the line integrals of the views' distances."""
    counts, incident = body.scan.counts, QUICK.incident
    air = counts[:, -1]
    assert air.mean() == pytest.approx(incident, rel=0.01)
    assert air.std() == pytest.approx(np.sqrt(incident), rel=0.3)
    deepest = -np.log(counts.min() / incident)
    mu = body.values[body.values > 0]
    assert mu.min() * QUICK.kind.thick * 0.8 < deepest < mu.max() * QUICK.kind.thick * 1.3


def test_the_true_force_knows_the_stiffness(body):
    """Homogeneous of degree one in both moduli."""
    point = np.array([*body.centre[:2], body.breast.grid.bounds[1][2]])
    plain, with_lump = true_forces(body, point, QUICK)
    assert 0 < plain < with_lump
    stiffer = replace(body, young=(body.young[0] * 2, body.young[1] * 2))
    twice = true_forces(stiffer, point, QUICK)
    np.testing.assert_allclose(twice, (2 * plain, 2 * with_lump), rtol=1e-6)


def test_statistics_are_by_their_definitions():
    rng = np.random.default_rng(1)
    told = rng.uniform(0, 1, 4000)
    felt = rng.uniform(0, 1, 4000) < told
    assert brier_score(told, felt) == pytest.approx(1 / 6, abs=0.01)  # ∫ p (1 − p) dp
    z = [spiegelhalter(told, rng.uniform(0, 1, 4000) < told) for _ in range(300)]
    assert np.mean(z) == pytest.approx(0, abs=0.25)
    assert np.std(z) == pytest.approx(1, abs=0.2)
    assert abs(spiegelhalter(told**2, felt)) > 5  # told too low
    for count, of in ((0, 9), (4, 9), (9, 9), (173, 200)):
        exact = binomtest(count, of).proportion_ci(0.95, "exact")
        np.testing.assert_allclose(binomial_interval(count, of), (exact.low, exact.high), rtol=1e-9, atol=1e-12)


def records(count, seed, bias=1.0):
    """Of samples that scatter as their truths do about them."""
    rng = np.random.default_rng(seed)
    made = []
    for _ in range(count):
        record = {}
        for name in (*JUDGED, "share"):
            truth = np.exp(rng.normal(-2, 0.6))
            middle = truth * np.exp(0.1 * rng.standard_normal())
            record[f"true|{name}"] = np.array(truth)
            record[f"samples|{name}"] = bias * middle * np.exp(0.1 * rng.standard_normal(19))
        record["samples|contrast"] = rng.standard_normal(19)
        made.append(record)
    return made


TAUGHT = records(200, 1)


def test_what_judges_never_teaches():
    taught = Judgement(records(60, 1), records(40, 2)).corrections
    other = Judgement(records(60, 1), records(40, 3, bias=2.0)).corrections
    for name in (*JUDGED, "share"):
        assert taught[name].offset == other[name].offset
        np.testing.assert_array_equal(taught[name].residuals, other[name].residuals)


def test_good_samples_meet_every_target_and_biased_ones_miss():
    judgement = Judgement(TAUGHT, records(200, 2))
    assert all(claim.met for claim in judgement.claims)
    assert len(judgement.claims) == 2 * len(JUDGED) + 2
    raw = Judgement(records(200, 1, bias=2.0), records(200, 2, bias=2.0))
    assert all(row["raw held"] < 0.3 < COVERAGE[0] <= row["corrected held"] for row in raw.rows)
    wrong = Judgement(TAUGHT, records(200, 2, bias=1.5))  # other bodies than those that taught
    assert not any(claim.met for claim in wrong.claims if "held" in claim.what or "size of" in claim.what)
    rows = judgement.reliability(0.1, corrected=True)
    assert sum(row["breasts"] for row in rows) == 200
    assert np.mean([row["low"] <= row["told"] <= row["high"] for row in rows]) >= 0.6


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("doubt")
    code, out, err = ended("study doubt --quick -o study --docs docs", folder)
    assert code == 0, err
    assert str(folder / "study" / "report.html") in out
    assert (folder / "docs" / "doubt.md").read_text().count("](images/doubt/") == 4
    return folder / "study"


def table(study, name):
    with (study / "tables" / f"{name}.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_the_tables_are_those_of_the_records(study):
    """Raw coverage and widths, and what is felt, again from the files of the breasts that judge."""
    made = [dict(np.load(study / "runs" / f"breast-{k}.npz")) for k in range(QUICK.train + QUICK.judge)]
    judge = made[QUICK.train :]
    for row in table(study, "intervals"):
        name = row["quantity"]
        samples = np.sort([r[f"samples|{name}"] for r in judge], axis=1)
        assert samples.shape[1] == 19
        truth = np.array([float(r[f"true|{name}"]) for r in judge])
        held = (samples[:, 0] <= truth) & (truth <= samples[:, -1])
        assert float(row["raw held"]) == pytest.approx(held.mean())
        assert float(row["raw width"]) == pytest.approx(np.median(samples[:, -1] - samples[:, 0]), rel=1e-6)
    share = np.array([float(r["true|share"]) for r in judge])
    for row, weber in zip(table(study, "felt"), WEBER_TOLD, strict=True):
        told = np.array([np.mean(r["samples|share"] > weber) for r in judge])
        assert float(row["raw"]) == pytest.approx(np.mean((told - (share > weber)) ** 2))
    claims = table(study, "claims")
    for claim in claims:
        if claim["what"].endswith("held"):
            assert (claim["met"] == "True") == (COVERAGE[0] <= float(claim["value"]) <= COVERAGE[1])
        elif "width" in claim["what"]:
            assert (claim["met"] == "True") == (float(claim["value"]) <= WIDTH)
    text = html.unescape(re.sub("<[^>]+>", " ", (study / "report.html").read_text()))
    met = sum(claim["met"] == "True" for claim in claims)
    assert f"{met} of {len(claims)} targets are met" in text


@pytest.mark.slow
@pytest.mark.parametrize("on", [None, 2], ids=["here", "on workers"])
def test_a_resumed_study_reads_what_is_there_and_makes_the_rest_to_the_bit(study, on):
    before = {path: path.read_bytes() for path in sorted((study / "runs").iterdir())}
    report = (study / "tables" / "intervals.csv").read_text()
    lost = [study / "runs" / "breast-1.npz", study / "runs" / "breast-3.npz"]
    arrays = [dict(np.load(path)) for path in lost]
    for path in lost:
        path.unlink()
    pp.doubt_study(study, quick=True, resume=True, on=on)
    assert (study / "tables" / "intervals.csv").read_text() == report
    assert all(path.read_bytes() == before[path] for path in before if path not in lost)
    for path, expected in zip(lost, arrays, strict=True):
        made = dict(np.load(path))
        assert made.keys() == expected.keys()
        assert all(np.array_equal(made[name], expected[name], equal_nan=True) for name in made)


def test_bad_numbers_of_seeds_are_refused_before_work(tmp_path):
    for seeds in (0, 1, 50_000):
        with pytest.raises(DataError, match="seeds: expected"):
            pp.doubt_study(tmp_path / "s", seeds=seeds)
    assert not (tmp_path / "s").exists()
