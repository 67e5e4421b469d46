"""Held-out photons: independent of those that are kept, and a judge of strengths."""

import numpy as np
import pytest

import palpate as pp
from palpate.reconstruction.held_out import split_photons

PANEL = pp.Panel((40, 54), (1.4, 1.4), (-37.1, -27.3, 0))
VIEWS = pp.circular_views(PANEL, radius=180, height=500, count=9)
GRID = pp.Grid.centred((12, 24, 30), (2.8, 1.8, 1.8), z=24)
BODY = pp.Phantom([(pp.Ellipsoid((0, 0, 24), (22, 17, 13)), 0.02), (pp.Ellipsoid((-6, -3, 24), 4), 0.01)])


def test_both_parts_are_poisson_and_tell_nothing_of_each_other():
    """A pixel's mean is known; variance over mean is 1 in each part, and the parts do not correlate (5 standard errors)."""
    mean = np.full(VIEWS.shape, 40.0)
    scan = pp.Scan(np.random.default_rng(3).poisson(mean), 50, VIEWS)
    kept, held = split_photons(scan, 0.3, seed=1)
    np.testing.assert_array_equal(kept.counts + held.counts, scan.counts)
    assert kept.incident.flat[0] == pytest.approx(35)
    for part, expected in ((kept, 28), (held, 12)):
        assert part.counts.mean() == pytest.approx(expected, rel=5 / np.sqrt(expected * mean.size))
        assert part.counts.var() / part.counts.mean() == pytest.approx(1, abs=5 * np.sqrt(2 / mean.size))
    correlation = np.corrcoef(kept.counts.ravel(), held.counts.ravel())[0, 1]
    assert abs(correlation) < 5 / np.sqrt(mean.size)


def test_the_strength_that_predicts_best_is_near_the_one_of_least_error():
    """Of a sweep over six decades, at the dose of the photons that are kept; no volume predicts their noise."""
    scan = pp.simulate_scan(BODY, VIEWS, incident=2000, seed=5)
    truth, strengths = BODY.volume(GRID).values, 10.0 ** np.arange(-3, 4)
    options = {"levels": 2, "iterations": 40}
    priors = [pp.Prior("quadratic", strength) for strength in strengths]
    deviances = [pp.held_out_deviance(scan, GRID, prior=prior, **options) for prior in priors]
    kept, _ = split_photons(scan, 0.5, 0)
    errors = [np.linalg.norm(pp.reconstruct(kept, GRID, prior=prior, **options).values - truth) for prior in priors]
    best = int(np.argmin(deviances))
    assert 0 < best < len(strengths) - 1
    assert abs(best - int(np.argmin(errors))) <= 1
    assert 1 < deviances[best] < 0.1 * deviances[-1]


def test_what_is_no_photon_cannot_be_held_out():
    scan = pp.simulate_scan(BODY, VIEWS, incident=200, seed=5)
    with pytest.raises(pp.errors.DataError, match="whole numbers"):
        pp.held_out_deviance(pp.Scan(scan.counts + 0.5, 200, VIEWS), GRID)
    for share in (0, 1, -0.2):
        with pytest.raises(pp.errors.DataError, match="between 0 and 1"):
            pp.held_out_deviance(scan, GRID, share=share)
