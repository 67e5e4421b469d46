"""The fit of a psychometric function: against SciPy's optimizer, draws from the prior, and its goodness of fit."""

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import minimize

import palpate as pp
from palpate.simulation.psychometrics import weibull, weibull_gradient

SPAN, SLOPES, LAPSES = (0.02, 2.0), (0.5, 8.0), (0.0, 0.06)


def negative_log_likelihood(parameters, level, right, count):
    """Written apart from the package's: threshold and slope as logarithms."""
    a, b, lapse = parameters
    p = 0.5 + (0.5 - lapse) * (1 - np.exp(-((level / np.exp(a)) ** np.exp(b))))
    return -np.sum(right * np.log(p) + (count - right) * np.log(1 - p))


def test_the_likeliest_function_is_scipys():
    rng, level = np.random.default_rng(8), np.geomspace(0.05, 1.0, 7)
    for person in (pp.PsychometricFunction(0.2, 1.5, 0.03), pp.PsychometricFunction(0.3, 3.5, 0.04)):
        count = np.full(len(level), 400)
        right = rng.binomial(count, person.probability(level))
        box = [(np.log(0.05 / 3), np.log(3)), (np.log(0.5), np.log(8)), (1e-6, 0.06)]
        start = [np.log(0.25), np.log(2), 0.03]
        best = minimize(
            negative_log_likelihood,
            start,
            (level, right, count),
            method="Nelder-Mead",
            bounds=box,
            options={"xatol": 1e-7, "fatol": 1e-9, "maxiter": 2000},
        )
        answers = np.concatenate([np.arange(n) < k for k, n in zip(right, count, strict=True)])
        found = pp.fit_psychometric(np.repeat(level, count), answers, draws=0)
        lacking = 2 * (best.fun - negative_log_likelihood_of_shares(right, count))
        assert found.deviance == pytest.approx(lacking, abs=1e-4)
        assert found.likeliest.threshold == pytest.approx(np.exp(best.x[0]), rel=1e-3)
        assert found.likeliest.slope == pytest.approx(np.exp(best.x[1]), rel=3e-3)
        assert found.likeliest.lapse == pytest.approx(best.x[2], abs=3e-4)


def test_the_gradient_is_that_of_differences():
    log_level, at = np.log(np.geomspace(1e-3, 1e4, 9)), np.array([-1.2, 0.4, 0.03])

    def chance(x):
        return weibull(log_level, x[0], np.exp(x[1]), x[2], 0.5)

    found = weibull_gradient(log_level, at[0], np.exp(at[1]), at[2], 0.5)
    for axis, by in enumerate(np.eye(3) * 1e-5):
        np.testing.assert_allclose(found[axis], (chance(at + by) - chance(at - by)) / 2e-5, atol=1e-8)


def negative_log_likelihood_of_shares(right, count):
    share = right / count
    return -np.sum(right * np.log(share) + (count - right) * np.log(np.where(share < 1, 1 - share, 1)))


def test_the_posterior_is_that_of_draws_from_the_prior():
    rng, level = np.random.default_rng(9), np.array([0.05, 0.1, 0.2, 0.4, 0.8])
    count, right = np.full(5, 16), np.array([8, 10, 12, 15, 16])
    draws = 400_000
    a = rng.uniform(*np.log(SPAN), draws)
    b = rng.uniform(*np.log(SLOPES), draws)
    lapse = rng.uniform(*LAPSES, draws)
    weights = np.ones(draws)
    for x, n, k in zip(level, count, right, strict=True):
        p = 0.5 + (0.5 - lapse) * stats.weibull_min.cdf(x, np.exp(b), scale=np.exp(a))
        weights *= p**k * (1 - p) ** (n - k)
    weights /= weights.sum()
    order = np.argsort(a)
    low, high = np.exp(np.interp([0.025, 0.975], np.cumsum(weights[order]), a[order]))
    answers = np.concatenate([np.arange(n) < k for k, n in zip(right, count, strict=True)])
    found = pp.fit_psychometric(np.repeat(level, count), answers, threshold=SPAN, draws=0)
    np.testing.assert_allclose(found.interval, (low, high), rtol=0.02)
    assert found.function.threshold == pytest.approx(np.exp(weights @ a), rel=0.01)
    assert found.function.slope == pytest.approx(np.exp(weights @ b), rel=0.02)
    assert found.function.lapse == pytest.approx(weights @ lapse, abs=0.001)


def test_a_million_answers_are_resolved():
    person, level = pp.PsychometricFunction(0.2, 1.5, 0.03), np.geomspace(0.05, 1.0, 8)
    answers = np.concatenate([np.arange(125_000) < round(125_000 * p) for p in person.probability(level)])
    found = pp.fit_psychometric(np.repeat(level, 125_000), answers, draws=50)
    assert found.function.threshold == pytest.approx(0.2, rel=1e-3)
    assert found.function.slope == pytest.approx(1.5, rel=2e-3)
    assert found.function.lapse == pytest.approx(0.03, abs=2e-4)
    assert 1 < found.interval[1] / found.interval[0] < 1.02
    assert found.deviance < 0.1


def test_goodness_of_fit_refuses_a_true_function_as_seldom_as_it_says():
    rng, levels = np.random.default_rng(10), np.repeat(np.geomspace(0.05, 0.8, 6), 40)
    person = pp.PsychometricFunction(0.2, 1.5, 0.02)
    p = [
        pp.fit_psychometric(levels, rng.random(len(levels)) < person.probability(levels), draws=99, seed=k).p
        for k in range(200)
    ]
    assert 0.02 <= np.mean(np.array(p) <= 0.05) <= 0.09
    assert 0.4 <= np.mean(p) <= 0.6


def test_goodness_of_fit_sees_what_is_no_weibull_function():
    levels = np.repeat(np.geomspace(0.05, 0.8, 6), 60)
    share = np.repeat([0.5, 0.55, 0.95, 0.6, 0.95, 0.97], 60)
    found = pp.fit_psychometric(levels, np.random.default_rng(11).random(len(levels)) < share)
    assert found.p < 0.01
    assert "does not fit the answers" in found.text


def test_answers_that_do_not_bound_the_threshold_are_said_not_to():
    easy = pp.fit_psychometric([0.5] * 20, [True] * 20)
    assert not easy.bounded
    assert "do not bound" in easy.text
    assert easy.interval[1] < 0.5 * 3
    levels = np.repeat([0.05, 0.1, 0.2, 0.4, 0.8], 60)
    known = pp.fit_psychometric(
        levels, np.random.default_rng(12).random(300) < pp.PsychometricFunction(0.2, 2).probability(levels)
    )
    assert known.bounded
    assert known.text.startswith("threshold 0.")
    assert "bound" not in known.text
