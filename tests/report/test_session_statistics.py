"""Statistics of sessions: against SciPy, published tables, and what intervals promise."""

import numpy as np
import pytest
from scipy import stats

from palpate.errors import DataError
from palpate.report.session_statistics import (
    composite,
    group_difference,
    learning_slope,
    mean_interval,
    reliability,
)

# Shrout & Fleiss, Psychol. Bull. 86 (1979) 420, table 2: four judges rate six targets.
RATINGS = [[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]]


def test_the_published_intraclass_correlation():
    """ICC(2,1) is printed as .29; McGraw and Wong's interval of these ratings is (.019, .761)."""
    icc, (low, high) = reliability(RATINGS)
    assert icc == pytest.approx(0.29, abs=5e-3)
    assert low == pytest.approx(0.019, abs=2e-3)
    assert high == pytest.approx(0.761, abs=2e-3)


def test_agreement_that_is_perfect_and_none():
    assert reliability([[1.0, 1.0], [2.0, 2.0], [5.0, 5.0]])[0] == pytest.approx(1)
    rng = np.random.default_rng(1)
    icc, (low, high) = reliability(rng.standard_normal((400, 2)))
    assert abs(icc) < 0.1
    assert low < 0 < high


def test_reliability_interval_holds_the_truth():
    """Persons and attempts of known variance: ICC = 4 / (4 + 0.5 + 1.5)."""
    rng, held, runs = np.random.default_rng(2), 0, 400
    for _ in range(runs):
        x = (
            2 * rng.standard_normal((12, 1))
            + np.sqrt(0.5) * rng.standard_normal(8)
            + np.sqrt(1.5) * rng.standard_normal((12, 8))
        )
        low, high = reliability(x)[1]
        held += low <= 4 / 6 <= high
    assert 0.92 <= held / runs <= 0.98


def test_the_difference_is_scipys_t_and_its_interval_holds_the_truth():
    rng, held, runs = np.random.default_rng(3), 0, 400
    for _ in range(runs):
        a, b = rng.standard_normal(9) + 0.8, rng.standard_normal(6)
        found = group_difference(a, b)
        low, high = found.interval
        held += low <= 0.8 * (1 - 3 / (4 * 13 - 1)) <= high
    assert 0.92 <= held / runs <= 0.98
    t = stats.ttest_ind(a, b).statistic
    assert found.g == pytest.approx(t * np.sqrt(1 / 9 + 1 / 6) * (1 - 3 / (4 * 13 - 1)))
    assert found.p == stats.mannwhitneyu(a, b).pvalue
    assert found.better == pytest.approx(np.mean(a[:, None] > b))


def test_the_interval_excludes_zero_where_the_t_test_does():
    """Both are of the same t distribution, so they must agree at 5 %."""
    rng = np.random.default_rng(4)
    told = []
    for _ in range(60):
        a, b = rng.standard_normal(7) + 1.1, rng.standard_normal(8)
        low, high = group_difference(a, b).interval
        told.append((low > 0 or high < 0, stats.ttest_ind(a, b).pvalue < 0.05))
    assert all(mine == theirs for mine, theirs in told)
    assert len({mine for mine, _ in told}) == 2


def test_learning_is_a_change_a_doubling():
    attempts = np.tile(np.arange(1, 9), 5)
    slope, (low, high) = learning_slope(attempts, 30 - 4 * np.log2(attempts))
    assert (slope, low, high) == pytest.approx((-4, -4, -4))
    noisy = 30 - 4 * np.log2(attempts) + np.random.default_rng(5).standard_normal(40)
    slope, (low, high) = learning_slope(attempts, noisy)
    assert low < -4 < high


def test_a_composite_of_an_expert_is_near_zero_and_a_novice_is_worse():
    rng = np.random.default_rng(6)
    experts = rng.standard_normal((20, 3)) * [1, 5, 0.1] + [10, 50, 1]
    value, (low, high) = composite(experts.mean(axis=0), experts)
    assert value == pytest.approx(0)
    assert low < 0 < high
    spread = experts.std(axis=0, ddof=1)
    assert composite(experts.mean(axis=0) + 2 * spread, experts)[0] == pytest.approx(-2)
    alike = np.column_stack([experts, np.ones(20)])  # a measure in which experts are alike says nothing
    assert composite([*(experts.mean(axis=0) + 2 * spread), 7.0], alike)[0] == pytest.approx(-2)


def test_the_mean_is_scipys():
    x = np.random.default_rng(7).standard_normal(12)
    mean, half = mean_interval(x)
    low, high = stats.t.interval(0.95, 11, x.mean(), stats.sem(x))
    assert (mean - half, mean + half) == pytest.approx((low, high))
    assert np.isnan(mean_interval([3.0])[1])


@pytest.mark.parametrize(
    ("what", "arguments", "complaint"),
    [
        (group_difference, ([1.0], [1.0, 2.0]), "two or more"),
        (group_difference, ([1.0, 1.0], [1.0, 1.0]), "no spread"),
        (reliability, ([[1.0, 2.0]],), "two or more attempts"),
        (learning_slope, ([1, 1, 1], [1.0, 2.0, 3.0]), "two or more attempts"),
        (learning_slope, ([1, 2, 3], [1.0, 1.0, 1.0]), "all values are alike"),
        (composite, ([1.0], [[1.0], [2.0]]), "three or more"),
    ],
)
def test_too_little_is_refused(what, arguments, complaint):
    with pytest.raises(DataError, match=complaint):
        what(*arguments)
