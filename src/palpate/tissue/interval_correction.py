"""Intervals of samples, corrected by factors that were learnt where the truth was known."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.stats import theilslopes

from palpate.arrays import ArrayLike, Float64, float64
from palpate.errors import DataError

FEWEST = 3  # bodies; of fewer than 20 the quantiles of 5 % and 95 % are the extremes


@dataclass(frozen=True, eq=False)
class IntervalCorrection:
    """What samples of a positive quantity say of its truth, learnt on bodies whose truth is known.

    On logarithms, with the median m of a body's samples and their standard deviation s, the truth is taken to be
    offset + slope m + √(s² + extra²) e, where e has the distribution of the residuals of the bodies that taught it: a
    predictive distribution, locally weighted as in split conformal prediction.

    Parameters
    ----------
    offset, slope : float
        Of the line through medians and truths, by Theil and Sen.
    extra : float
        Spread that the samples do not have, of the logarithm.
    residuals : array_like, (bodies,)
        In units of √(s² + extra²).

    References
    ----------
    Lei, G'Sell, Rinaldo, Tibshirani & Wasserman, J. Am. Stat. Assoc. 113:1094, 2018, section 5.2.

    Examples
    --------
    >>> truths = np.exp(np.random.default_rng(0).normal(2, 0.3, 200))
    >>> samples = [1.2 * t * np.exp(np.random.default_rng(k).normal(0, 0.05, 20)) for k, t in enumerate(truths)]
    >>> correction = pp.IntervalCorrection.learn(samples, truths)
    >>> low, high = correction.interval(samples[0], 0.9)
    >>> bool(low < high < 1.1 * samples[0].mean())
    True
    """

    offset: float
    slope: float
    extra: float
    residuals: Float64

    @classmethod
    def learn(cls, samples: Sequence[ArrayLike], truths: ArrayLike) -> Self:
        """Return the correction that bodies of known truth teach.

        Parameters
        ----------
        samples : sequence of array_like, (samples,)
            Of each body, above 0.
        truths : array_like, (bodies,)
            Above 0.

        Returns
        -------
        IntervalCorrection
            For bodies of the same kind, scanned in the same way.

        Raises
        ------
        DataError
            If there are fewer than 3 bodies, or a number is not positive.
        """
        truth = _logarithms("truths", truths)
        if len(truth) < FEWEST or len(samples) != len(truth):
            raise DataError(
                f"truths: expected at least {FEWEST}, one for each of {len(samples)} bodies, got {len(truth)}"
            )
        middle, spread = np.array([_summary(each) for each in samples]).T
        slope, offset = theilslopes(truth, middle)[:2]
        off = truth - offset - slope * middle
        extra = 1.4826 * float(np.median(np.abs(off - np.median(off))))
        return cls(float(offset), float(slope), extra, np.sort(off / np.hypot(spread, max(extra, 1e-6))))

    def interval(self, samples: ArrayLike, level: float = 0.9) -> tuple[float, float]:
        """Return the interval that holds the truth with a probability.

        Parameters
        ----------
        samples : array_like, (samples,)
            Of the body, above 0.
        level : float, optional
            The probability.

        Returns
        -------
        tuple of float
            The lower and the upper end.

        Raises
        ------
        DataError
            If a sample is not positive, or the level is not between 0 and 1.
        """
        check_level(level)
        centre, scale = self._centre(samples)
        tail = (1 - level) / 2
        low, high = np.exp(centre + scale * np.quantile(self.residuals, [tail, 1 - tail], method="weibull"))
        return float(low), float(high)

    def probability_above(self, samples: ArrayLike, value: float) -> float:
        """Return the probability that the truth lies above a value.

        Parameters
        ----------
        samples : array_like, (samples,)
            Of the body, above 0.
        value : float
            Above 0.

        Returns
        -------
        float
            Between 0 and 1, never quite either.

        Raises
        ------
        DataError
            If a number is not positive.
        """
        centre, scale = self._centre(samples)
        above = np.count_nonzero(self.residuals > (float(_logarithms("value", [value])[0]) - centre) / scale)
        return (above + 0.5) / (len(self.residuals) + 1)

    def _centre(self, samples: ArrayLike) -> tuple[float, float]:
        middle, spread = _summary(samples)
        return self.offset + self.slope * middle, float(np.hypot(spread, max(self.extra, 1e-6)))


def check_level(level: float) -> None:
    """Raises `DataError`."""
    if not 0 < level < 1:
        raise DataError(f"level: expected a probability between 0 and 1, got {level!r}")


def sample_interval(values: Float64, level: float) -> tuple[float, float]:
    """Between the k-th of n samples and the k-th from above a further draw lies with probability (n + 1 − 2k) / (n + 1)."""
    check_level(level)
    tail, n = (1 - level) / 2, len(values)
    if tail * (n + 1) < 1 - 1e-9:
        raise DataError(
            f"level: of {n} samples at most {(n - 1) / (n + 1):.3g}, got {level!r}; more samples allow more"
        )
    low, high = np.quantile(values, [tail, 1 - tail], method="weibull")
    return float(low), float(high)


def _summary(samples: ArrayLike) -> tuple[float, float]:
    """Median and standard deviation of the logarithms."""
    values = _logarithms("samples", samples)
    return float(np.median(values)), float(values.std(ddof=1)) if len(values) > 1 else 0.0


def _logarithms(name: str, values: ArrayLike) -> Float64:
    given = float64(name, values, (None,))
    if not (given > 0).all():
        raise DataError(f"{name}: expected numbers above 0, got {given.min():g}")
    return np.asarray(np.log(given))
