"""How well line integrals explain the counts: small values that answer value, slope and curvature.

All live on line integrals l, (views, rows, columns) without unit, and never see the projector. A pixel that was not
measured carries no weight, whatever lies there. One of your own: see `Likelihood` and `examples/own_likelihood.py`.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike

from palpate import _core
from palpate.arrays import Bool, Float32, float32
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
    """Poisson counts behind an absorber: mean = incident · e^-l + background.

    counts, incident, background: photons, (views, rows, columns) float32; incident is 0 where nothing was measured.
    h(l) = m − y + y log(y/m), which differs from m − y log m only by what does not depend on l. A scan of an integrating
    panel (`integrating_scan`) holds its read-out noise σ² in both counts and background; then this is the shifted
    Poisson model, y + σ² ~ Poisson(m + σ²), right in mean and variance (Snyder et al., JOSA A 12:272, 1995).
    """

    counts: Float32
    incident: Float32
    background: Float32
    _noise: ClassVar[int] = 0

    @classmethod
    def of(cls, scan: Scan) -> Self:
        """The likelihood of a scan; masked pixels get incident 0. Shares the scan's arrays where no pixel is masked."""
        whole = bool(scan.mask.all())
        arrays = (scan.counts, scan.incident, scan.background)
        return cls(*(np.ascontiguousarray(a if whole else np.where(scan.mask, a, np.float32(0))) for a in arrays))

    @property
    def measured(self) -> Bool:
        """Pixels with an incident beam."""
        return self.incident > 0

    @property
    def line_integrals(self) -> Float32:
        """log(b / (y − r)); a pixel without a count over background is taken to have half a photon."""
        return _line_integrals(self.counts, self.incident, self.background)

    def value(self, l: Float32) -> float:
        """Sum of h over measured pixels; for Poisson half the deviance, about half a pixel where the model is right."""
        return _core.transmission_value(self.counts, self.incident, self.background, self._checked(l), self._noise)

    def value_and_slope(self, l: Float32, slope: Float32) -> float:
        """Both in one pass, the slope written to an array given."""
        l = self._checked(l)
        return _core.transmission_value_and_slope(self.counts, self.incident, self.background, l, self._noise, slope)

    def slope(self, l: Float32) -> Float32:
        """h'(l), photons; for Poisson b e^-l (y/m − 1)."""
        return _core.transmission_slope(self.counts, self.incident, self.background, self._checked(l), self._noise)

    def curvature(self, l: Float32, kind: Curvature = "optimal") -> Float32:
        """Curvature of the parabola through h at l, photons (Erdogan & Fessler, IEEE TMI 18:801, 1999).

        "optimal" is the smallest that stays above h for all l >= 0, "maximum" the largest h'' there: neither ever
        raises the objective. "precomputed" is (y − r)²/y, h'' at its minimum: cheap, and not guaranteed to descend.
        """
        l, index = self._checked(l), CURVATURES.index(kind)
        return _core.transmission_curvature(self.counts, self.incident, self.background, l, self._noise, index)

    def _checked(self, l: Float32) -> Float32:
        return np.ascontiguousarray(np.broadcast_to(np.asarray(l, np.float32), self.counts.shape))


@dataclass(frozen=True, eq=False)
class Gaussian(Transmission):
    """Normal noise whose variance is the mean m = incident · e^-l + background: photons behind electronic noise.

    h(l) = (m − y)²/2m + ½ log(m/y). Its variance follows the line integral, so that noise does not draw the estimate down
    as it does with weights taken from the counts. The scan is one of `integrating_scan`, whose background holds the
    variance of the read-out: where it is 0, dark pixels would make h as steep as one likes, and a `DataError` says so.
    Curvature: as for `Transmission`, but "optimal" is a bound, close where read-out noise is a few photons or more.
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
    """Σ weight (l − p)²/2, for panels that integrate energy and for intensities that are no counts.

    line_integrals: p, no unit. weights: 1/variance of p, 0 where nothing was measured. Both (views, rows, columns).
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
        """p = log(b / (y − r)), weight (y − r)² / (y + electronic²): the variance of a count, carried through the log.

        electronic: standard deviation of the read-out noise, photons; 0 where the scan holds it (`integrating_scan`). A
        pixel with no signal over its background carries no weight.
        """
        signal = scan.counts - scan.background
        used = scan.mask & (signal > 0)
        variance = scan.counts + np.square(np.asarray(electronic, np.float32))
        weights = np.where(used, np.square(signal) / np.where(used, variance, 1), 0)
        incident = np.where(used, scan.incident, 0)
        return cls(_line_integrals(scan.counts, incident, scan.background), weights.astype(np.float32))

    @property
    def measured(self) -> Bool:
        """Pixels with weight."""
        return self.weights > 0

    def value(self, l: Float32) -> float:
        """Σ weight (l − p)²/2."""
        l = np.ascontiguousarray(np.broadcast_to(np.asarray(l, np.float32), self.weights.shape))
        return _core.least_squares_value(self.weights, self.line_integrals, l)

    def slope(self, l: Float32) -> Float32:
        """weight (l − p)."""
        return self.weights * (l - self.line_integrals)

    def curvature(self, l: Float32, kind: Curvature = "optimal") -> Float32:
        """The weights: a parabola is its own surrogate."""
        return self.weights


def value_and_slope(likelihood: Likelihood, l: Float32, slope: Float32) -> float:
    """The value; the slope is written to `slope`. In one pass for our own, not for what overrides parts of them."""
    if type(likelihood) is Transmission or type(likelihood) is Gaussian:
        return likelihood.value_and_slope(l, slope)
    np.copyto(slope, likelihood.slope(l))
    return likelihood.value(l)


def _line_integrals(counts: Float32, incident: Float32, background: Float32) -> Float32:
    measured = incident > 0
    signal = np.maximum(counts - background, np.float32(0.5))
    p: Float32 = np.where(measured, np.log(np.where(measured, incident, signal) / signal), np.float32(0))
    return p
