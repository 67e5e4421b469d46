"""Likelihoods of line integrals: value, slope and curvature of a surrogate parabola.

All live on line integrals l, (views, rows, columns) without unit, and never see the projector. A pixel that was not
measured carries no weight, whatever lies there. One of your own: see `Likelihood` and `examples/own_likelihood.py`.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal, Protocol, Self

import numpy as np

from palpate import _core
from palpate.arrays import ArrayLike, Bool, Float32, as_numpy, float32
from palpate.errors import DataError
from palpate.scans.scan import Scan

Curvature = Literal["precomputed", "optimal", "maximum"]
CURVATURES: tuple[Curvature, ...] = ("precomputed", "optimal", "maximum")


class Likelihood(Protocol):
    """What the solvers ask of the data. Arrays are (views, rows, columns), float32; l >= 0 is what the volume projects to.

    `reconstruct(scan, likelihood=f)` takes a function f from a scan to one of these; it is called once a level, with the
    scan at that level's resolution, whose counts are sums over pixels.
    """

    @property
    def measured(self) -> Bool:
        """(views, rows, columns): the pixels that carry weight."""

    @property
    def line_integrals(self) -> Float32:
        """What each measured pixel alone says of its line integral, 0 where nothing was measured."""

    def value(self, l: Float32) -> float:
        """Minus log-likelihood, 0 where the data are met exactly."""

    def slope(self, l: Float32) -> Float32:
        """Derivative of `value` by each line integral."""

    def curvature(self, l: Float32, kind: Curvature = "optimal") -> Float32:
        """(views, rows, columns), >= 0: second derivative of a parabola in each line integral that touches at l.

        "optimal" and "maximum" must give one that stays above for all l >= 0; "precomputed" is the second derivative
        at `line_integrals`, whatever l: cheap, and corrected by the solver where it fails.
        """


@dataclass(frozen=True, eq=False)
class Transmission:
    """Poisson likelihood of transmitted photons, with mean = incident · e⁻ˡ + background.

    The value of a pixel is h(l) = m − y + y log(y / m). For a scan of `integrating_scan` it is the shifted Poisson model.

    Parameters
    ----------
    counts, incident, background : ndarray, (views, rows, columns)
        Photons, float32. Incident is 0 where nothing was measured.

    References
    ----------
    Snyder et al., J. Opt. Soc. Am. A 12:272, 1995 (shifted Poisson model).

    Examples
    --------
    >>> likelihood = pp.Transmission.of(scan)
    >>> exact = likelihood.line_integrals
    >>> likelihood.value(exact) <= likelihood.value(exact + np.float32(0.1))
    True
    """

    counts: Float32
    incident: Float32
    background: Float32
    _noise: ClassVar[int] = 0

    @classmethod
    def of(cls, scan: Scan) -> Self:
        """Return the likelihood of a scan. Masked pixels get incident 0.

        Parameters
        ----------
        scan : Scan
            The projections. Their arrays are shared where no pixel is masked.

        Returns
        -------
        Transmission
            The likelihood.
        """
        whole = bool(scan.mask.all())
        arrays = (scan.counts, scan.incident, scan.background)
        return cls(*(np.ascontiguousarray(a if whole else np.where(scan.mask, a, np.float32(0))) for a in arrays))

    @property
    def measured(self) -> Bool:
        """Pixels with an incident beam, (views, rows, columns), bool."""
        return self.incident > 0

    @property
    def line_integrals(self) -> Float32:
        """log(b / (y − r)), (views, rows, columns), no unit. A pixel without a net count is taken to have half a photon."""
        return _line_integrals(*self._scan)

    def value(self, l: Float32) -> float:
        """Return the sum of h over the measured pixels: half the deviance for Poisson counts.

        Parameters
        ----------
        l : ndarray, (views, rows, columns)
            Line integrals, float32.

        Returns
        -------
        float
            The value; about half the number of pixels where the model is right.
        """
        return _core.statistics.transmission_value(*self._scan, self._checked(l), self._noise)

    def value_and_slope(self, l: Float32, slope: Float32) -> float:
        """Return the value and write the slope, in one pass.

        Parameters
        ----------
        l : ndarray, (views, rows, columns)
            Line integrals, float32.
        slope : ndarray, (views, rows, columns)
            Receives the slope, photons.

        Returns
        -------
        float
            The value.
        """
        return _core.statistics.transmission_value_and_slope(*self._scan, self._checked(l), self._noise, slope)

    def slope(self, l: Float32) -> Float32:
        """Return h'(l). For Poisson counts it is b e⁻ˡ (y / m − 1).

        Parameters
        ----------
        l : ndarray, (views, rows, columns)
            Line integrals, float32.

        Returns
        -------
        ndarray, (views, rows, columns)
            The slope, photons.
        """
        return _core.statistics.transmission_slope(*self._scan, self._checked(l), self._noise)

    def curvature(self, l: Float32, kind: Curvature = "optimal") -> Float32:
        """Return the curvature of a parabola through h at l.

        Parameters
        ----------
        l : ndarray, (views, rows, columns)
            Line integrals, float32.
        kind : {"optimal", "maximum", "precomputed"}, optional
            "optimal" is the smallest curvature that stays above h for all l ≥ 0. "maximum" is the largest h'' there. Neither
            raises the objective. "precomputed" is (y − r)² / y, h'' at its minimum, and does not guarantee descent.

        Returns
        -------
        ndarray, (views, rows, columns)
            The curvature, photons.

        References
        ----------
        Erdogan & Fessler, IEEE TMI 18:801, 1999.
        """
        index = CURVATURES.index(kind)
        return _core.statistics.transmission_curvature(*self._scan, self._checked(l), self._noise, index)

    @property
    def _scan(self) -> tuple[Float32, Float32, Float32]:
        return self.counts, self.incident, self.background

    def _checked(self, l: Float32) -> Float32:
        return np.ascontiguousarray(np.broadcast_to(np.asarray(as_numpy("l", l), np.float32), self.counts.shape))


@dataclass(frozen=True, eq=False)
class Gaussian(Transmission):
    """Normal likelihood whose variance is the mean m = incident · e⁻ˡ + background.

    It serves photons with read-out noise: take the scan from `integrating_scan`. The value of a pixel is
    h(l) = (m − y)² / 2m + ½ log(m / y). The "optimal" curvature is a bound, close if the read-out noise is a few photons.

    Parameters
    ----------
    counts, incident, background : ndarray, (views, rows, columns)
        Photons, float32. The background holds the variance of the read-out noise.

    Raises
    ------
    DataError
        If the background is 0 in a dark pixel.

    Examples
    --------
    >>> read_out = pp.integrating_scan(scan.counts, scan.incident, views, electronic=5.0)
    >>> likelihood = pp.Gaussian.of(read_out)
    >>> bool(likelihood.measured.all())
    True
    """

    _noise: ClassVar[int] = 1

    def __post_init__(self) -> None:
        bare = np.count_nonzero(self.measured & ~(self.background > 0))
        if bare:
            raise DataError(
                f"gaussian likelihood: {bare} measured pixels have neither read-out noise nor background; give the panel's "
                f"electronic noise (integrating_scan, palpate reconstruct --electronic), or take the poisson likelihood"
            )


@dataclass(frozen=True, eq=False)
class WeightedLeastSquares:
    """Weighted squares of line integrals, Σ weight (l − p)² / 2.

    It serves intensities that are not counts.

    Parameters
    ----------
    line_integrals : ndarray, (views, rows, columns)
        The data p, no unit.
    weights : ndarray, (views, rows, columns)
        1 / variance of p; 0 where nothing was measured.

    Examples
    --------
    >>> likelihood = pp.WeightedLeastSquares.of(scan)
    >>> likelihood.value(likelihood.line_integrals)
    0.0
    """

    line_integrals: Float32
    weights: Float32

    def __post_init__(self) -> None:
        p = float32("line_integrals", self.line_integrals, (None, None, None))
        w = float32("weights", self.weights, p.shape)
        if (w < 0).any() or not (w > 0).any():
            raise DataError(f"weights: expected none below 0 and some above, found {w.min():g} to {w.max():g}")
        object.__setattr__(self, "line_integrals", p)
        object.__setattr__(self, "weights", w)

    @classmethod
    def of(cls, scan: Scan, electronic: ArrayLike = 0.0) -> Self:
        """Return the likelihood of a scan: p = log(b / (y − r)) with weight (y − r)² / (y + electronic²).

        Parameters
        ----------
        scan : Scan
            The projections.
        electronic : array_like, optional
            Standard deviation of the read-out noise, photons; 0 if the scan is one of `integrating_scan`.

        Returns
        -------
        WeightedLeastSquares
            A pixel without a net count has no weight.
        """
        signal = scan.counts - scan.background
        used = scan.mask & (signal > 0)
        variance = scan.counts + np.square(np.asarray(electronic, np.float32))
        weights = np.where(used, np.square(signal) / np.where(used, variance, 1), 0)
        incident = np.where(used, scan.incident, 0)
        return cls(_line_integrals(scan.counts, incident, scan.background), weights.astype(np.float32))

    @property
    def measured(self) -> Bool:
        """Pixels with weight, (views, rows, columns), bool."""
        return self.weights > 0

    def value(self, l: Float32) -> float:
        """Return Σ weight (l − p)² / 2.

        Parameters
        ----------
        l : ndarray, (views, rows, columns)
            Line integrals, float32.

        Returns
        -------
        float
            The value.
        """
        l = np.ascontiguousarray(np.broadcast_to(np.asarray(as_numpy("l", l), np.float32), self.weights.shape))
        return _core.statistics.least_squares_value(self.weights, self.line_integrals, l)

    def slope(self, l: Float32) -> Float32:
        """Return weight (l − p).

        Parameters
        ----------
        l : ndarray, (views, rows, columns)
            Line integrals, float32.

        Returns
        -------
        ndarray, (views, rows, columns)
            The slope.
        """
        return self.weights * (np.asarray(as_numpy("l", l), np.float32) - self.line_integrals)

    def curvature(self, l: Float32, kind: Curvature = "optimal") -> Float32:
        """Return the weights, since a parabola is its own surrogate.

        Parameters
        ----------
        l : ndarray, (views, rows, columns)
            Line integrals, float32.
        kind : str, optional
            Not used.

        Returns
        -------
        ndarray, (views, rows, columns)
            The weights.
        """
        return self.weights


def _line_integrals(counts: Float32, incident: Float32, background: Float32) -> Float32:
    measured = incident > 0
    signal = np.maximum(counts - background, np.float32(0.5))
    p: Float32 = np.where(measured, np.log(np.where(measured, incident, signal) / signal), np.float32(0))
    return p
