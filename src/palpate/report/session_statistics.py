"""Statistics of sessions: groups compared, learning, reliability, and a composite score."""

from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.optimize import brentq

from palpate.arrays import ArrayLike, Float64, float64
from palpate.errors import DataError

DRAWS = 2000  # of the bootstrap


@dataclass(frozen=True)
class GroupDifference:
    """Two groups compared. g: Hedges' standardized difference of the means, first less second, with its 95 % interval.

    p: of the Mann-Whitney test. better: chance that one of the first group has a larger value than one of the second.
    """

    g: float
    interval: tuple[float, float]
    p: float
    better: float


def group_difference(first: ArrayLike, second: ArrayLike) -> GroupDifference:
    """Compares the values of two groups, two or more each.

    The interval is the exact one of the noncentral t distribution (Hedges & Olkin, Statistical Methods for Meta-Analysis,
    1985). Raises `DataError` if a group has fewer than two values, or no value differs.
    """
    a, b = float64("first", first), float64("second", second)
    if min(len(a), len(b)) < 2:
        raise DataError(f"groups of {len(a)} and {len(b)}; give two or more values in each")
    n, m = len(a), len(b)
    freedom = n + m - 2
    pooled = np.sqrt(((n - 1) * a.var(ddof=1) + (m - 1) * b.var(ddof=1)) / freedom)
    if pooled == 0:
        raise DataError("groups: all values of each are equal; there is no spread to compare with")
    per_t = np.sqrt(1 / n + 1 / m)
    t = (a.mean() - b.mean()) / pooled / per_t
    correction = 1 - 3 / (4 * freedom - 1)
    ends = [correction * per_t * _noncentrality(t, freedom, level) for level in (0.975, 0.025)]
    test = stats.mannwhitneyu(a, b)
    return GroupDifference(
        correction * t * per_t, (ends[0], ends[1]), float(test.pvalue), float(test.statistic / (n * m))
    )


def _noncentrality(t: float, freedom: int, level: float) -> float:
    """Of the t distribution that has t at this level. Sought in steps from t: far off, SciPy's function is not a number."""

    def above(x: float) -> float:
        return float(stats.nct.cdf(t, freedom, x) - level)

    step = (1 + abs(t) / 4) * (-1 if level > 0.5 else 1)
    far = t + step
    while above(far) * step > 0:
        far += step
    return float(brentq(above, min(t, far), max(t, far)))


def reliability(values: ArrayLike) -> tuple[float, tuple[float, float]]:
    """Test-retest reliability of (persons, attempts): the intraclass correlation ICC(2,1), and its 95 % interval.

    Absolute agreement, persons and attempts both drawn at random (Shrout & Fleiss, Psychol. Bull. 86 (1979) 420; interval by
    McGraw & Wong, Psychol. Methods 1 (1996) 30). Raises `DataError` for fewer than two persons or attempts.
    """
    x = float64("values", values)
    if x.ndim != 2 or min(x.shape) < 2:
        raise DataError(f"reliability: shape {x.shape}; give two or more attempts of two or more persons")
    n, k = x.shape
    whole = x.mean()
    rows = k * ((x.mean(axis=1) - whole) ** 2).sum() / (n - 1)
    columns = n * ((x.mean(axis=0) - whole) ** 2).sum() / (k - 1)
    left = x - x.mean(axis=1, keepdims=True) - x.mean(axis=0) + whole
    error = (left**2).sum() / ((n - 1) * (k - 1))
    icc = (rows - error) / (rows + (k - 1) * error + k * (columns - error) / n)
    a = k * icc / (n * (1 - icc)) if icc < 1 else np.inf
    b = 1 + k * icc * (n - 1) / (n * (1 - icc)) if icc < 1 else np.inf
    if not np.isfinite(a) or error == 0:
        return float(icc), (float(icc), float(icc))
    freedom = (a * columns + b * error) ** 2 / ((a * columns) ** 2 / (k - 1) + (b * error) ** 2 / ((n - 1) * (k - 1)))
    low, high = stats.f.ppf(0.975, n - 1, freedom), stats.f.ppf(0.975, freedom, n - 1)
    rest = k * columns + (k * n - k - n) * error
    return float(icc), (
        float(n * (rows - low * error) / (low * rest + n * rows)),
        float(n * (high * rows - error) / (rest + n * high * rows)),
    )


def learning_slope(attempts: ArrayLike, values: ArrayLike) -> tuple[float, tuple[float, float]]:
    """Change a doubling of practice: Theil and Sen's slope of the values over log2 of the attempt, and its 95 % interval.

    Raises `DataError` for fewer than three sessions, a single attempt, or values that are all alike.
    """
    n, y = float64("attempts", attempts), float64("values", values)
    if len(n) < 3 or np.ptp(n) == 0:
        raise DataError("learning: give three or more sessions of two or more attempts")
    if np.ptp(y) == 0:
        raise DataError("learning: all values are alike")
    found = stats.theilslopes(y, np.log2(n))
    return float(found.slope), (float(found.low_slope), float(found.high_slope))


def mean_interval(values: ArrayLike) -> tuple[float, float]:
    """Half-width of the 95 % interval of the mean is the second; NaN for one value."""
    x = float64("values", values)
    half = stats.t.ppf(0.975, len(x) - 1) * x.std(ddof=1) / np.sqrt(len(x)) if len(x) > 1 else np.nan
    return float(x.mean()), float(half)


def composite(values: ArrayLike, experts: ArrayLike, seed: int = 0) -> tuple[float, tuple[float, float]]:
    """How far a session is from the experts: the mean over its measures of (experts' mean − value) / experts' deviation.

    0 is an expert's mean and −1 a deviation worse, for measures of which less is better. values: (measures,). experts:
    (sessions, measures). The 95 % interval is that of the experts' mean and deviation, by a bootstrap over their sessions.
    Raises `DataError` for fewer than three sessions of experts.
    """
    x, known = float64("values", values), float64("experts", experts)
    if known.ndim != 2 or len(known) < 3 or known.shape[1] != len(x):
        raise DataError(
            f"composite: experts of shape {known.shape}; give three or more sessions with {len(x)} measures"
        )
    rng = np.random.default_rng(seed)
    drawn = known[rng.integers(len(known), size=(DRAWS, len(known)))]
    scores = _standing(x, drawn)
    scores = scores[np.isfinite(scores)]
    low, high = np.quantile(scores, [0.025, 0.975]) if len(scores) else (np.nan, np.nan)
    return float(_standing(x, known[None])[0]), (float(low), float(high))


def _standing(x: Float64, experts: Float64) -> Float64:
    """(draws,) of x (measures,) among experts (draws, sessions, measures). A measure in which they are alike is left out."""
    spread = experts.std(axis=1, ddof=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.where(spread > 0, (experts.mean(axis=1) - x) / spread, np.nan)
    counted = np.isfinite(z).sum(axis=1)
    return np.asarray(np.nansum(z, axis=1) / np.where(counted > 0, counted, np.nan))
