"""Beam hardening: a tube's beam loses its soft part first, so that twice the tissue takes away less than twice as much.

A curve g says what a polychromatic beam shows, g(l) = −log(signal/open signal), behind tissue whose line integral at one
reference energy is l. Used inside the likelihood the counts stay what was measured, and their noise what it is.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np

from palpate.arrays import ArrayLike, Bool, Float32, Float64, float64
from palpate.errors import DataError
from palpate.reconstruction.models.blurred import Blurred
from palpate.reconstruction.models.likelihood import Curvature, Likelihood
from palpate.scans.scan import Scan

REACH = 12.0  # line integral beyond which the curve is straight: 6 photons of a million pass
STEPS = 2400


class Curve(Protocol):
    """g of line integrals l, with its first two derivatives: g(0) = 0, rising, bending down or straight."""

    def __call__(self, l: Float64) -> tuple[Float64, Float64, Float64]:
        """g, g', g''; the shape of l."""


@dataclass(frozen=True)
class Polynomial:
    """A beam-hardening curve g(l) = c₁ l + c₂ l² + …, as a step wedge gives it.

    Parameters
    ----------
    coefficients : tuple of float
        c₁, c₂, …, no unit.

    Raises
    ------
    DataError
        If a coefficient is not finite.

    Examples
    --------
    >>> g, slope, second = pp.Polynomial((1.0, -0.02))(np.array([1.0]))
    >>> g.round(6), slope.round(6), second.round(6)
    (array([0.98]), array([0.96]), array([-0.04]))
    """

    coefficients: tuple[float, ...]

    def __call__(self, l: Float64) -> tuple[Float64, Float64, Float64]:
        """g, g', g''."""
        g = np.polynomial.Polynomial([0.0, *self.coefficients])
        return g(l), g.deriv()(l), g.deriv(2)(l)


@dataclass(frozen=True, eq=False)
class Spectrum:
    """The beam-hardening curve g(l) = −log Σ w e^(−ρ l) of a spectrum behind one material.

    Parameters
    ----------
    weights : array_like, (energies,)
        Share of each energy in the open signal: photons × detected part × signal of a photon. Normalized here.
    ratios : array_like, (energies,)
        Attenuation of the material over its attenuation at the reference energy, no unit. Reconstructions are at that
        energy.

    Raises
    ------
    DataError
        If a weight or ratio is negative or not finite.

    Examples
    --------
    >>> curve = pp.Spectrum(weights=[1, 1], ratios=[1.2, 0.8])
    >>> g, slope, second = curve(np.array([0.0]))
    >>> float(slope[0])
    1.0
    """

    weights: ArrayLike
    ratios: ArrayLike

    def __post_init__(self) -> None:
        w, rho = float64("spectrum weights", self.weights, (None,)), float64("spectrum ratios", self.ratios, (None,))
        if w.shape != rho.shape or (w < 0).any() or not w.sum() > 0 or (rho <= 0).any():
            raise DataError(
                f"spectrum: expected one weight (0 or more) and one ratio (above 0) an energy, "
                f"got {w.shape} from {w.min():g} and {rho.shape} from {rho.min():g}"
            )
        object.__setattr__(self, "weights", w / w.sum())
        object.__setattr__(self, "ratios", rho)

    def __call__(self, l: Float64) -> tuple[Float64, Float64, Float64]:
        """g, the mean ratio of what has come through, and minus its variance."""
        w, rho = np.asarray(self.weights), np.asarray(self.ratios)
        passed = w * np.exp(-rho * np.asarray(l)[..., None])
        total = passed.sum(axis=-1)
        mean = (passed * rho).sum(axis=-1) / total
        return -np.log(total), mean, mean**2 - (passed * rho**2).sum(axis=-1) / total


@dataclass(frozen=True)
class Tabulated:
    """A curve on a fine grid from 0 to `REACH`, straight beyond: quick for millions of pixels.

    g' is linear in between and g its exact integral, so that value and slope are of one function. Raises `DataError`
    for a curve that does not rise, or bends up.
    """

    curve: Curve

    def __call__(self, l: ArrayLike) -> tuple[Float64, Float64, Float64]:
        """g, g', g'' at l >= 0 or a little below."""
        g, slope = self.points
        l, step = np.asarray(l, np.float64), REACH / STEPS
        at = np.clip((l / step).astype(np.int64), 0, STEPS - 1)
        bend = np.where((l >= 0) & (l < REACH), (slope[at + 1] - slope[at]) / step, 0)
        rest = l - at * step
        far = l >= REACH
        value = np.where(far, g[-1] + slope[-1] * (l - REACH), g[at] + rest * (slope[at] + bend * rest / 2))
        return value, np.where(far, slope[-1], slope[at] + bend * rest), bend

    def inverse(self, p: ArrayLike) -> Float64:
        """l with g(l) = p; straight below 0 and beyond the end."""
        g, slope = self.points
        p = np.asarray(p, np.float64)
        l = np.interp(p, g, np.linspace(0, REACH, STEPS + 1))
        l = np.where(p < 0, p / slope[0], np.where(p > g[-1], REACH + (p - g[-1]) / slope[-1], l))
        value, rise, _ = self(l)  # one Newton step is enough between points 0.005 apart
        inverse: Float64 = l - (value - p) / rise
        return inverse

    @property
    def steepest(self) -> float:
        """Largest g'."""
        return float(self.points[1][0])

    @property
    def sharpest(self) -> float:
        """Largest −g''."""
        return float(-np.diff(self.points[1]).min() * STEPS / REACH)

    @cached_property
    def points(self) -> tuple[Float64, Float64]:
        """g and g' at `STEPS` + 1 line integrals from 0 to `REACH`."""
        l = np.linspace(0, REACH, STEPS + 1)
        g, slope, _ = (np.asarray(a, np.float64) for a in self.curve(l))
        if not np.isfinite([g, slope]).all() or abs(g[0]) > 1e-9:
            raise DataError(f"hardening: expected a curve with g(0) = 0, finite to l = {REACH:g}; g(0) is {g[0]:g}")
        if not (slope > 0).all():
            raise DataError(
                f"hardening: the curve falls from l = {l[np.argmax(slope <= 0)]:.3g} on (slope {slope.min():.3g}); it must "
                f"rise to l = {REACH:g}: fit fewer coefficients, or give a spectrum"
            )
        if (np.diff(slope) > 1e-9 * slope[0]).any():
            raise DataError(
                f"hardening: the curve bends up at l = {l[np.argmax(np.diff(slope) > 1e-9 * slope[0])]:.3g}; a beam only "
                f"hardens, so g may rise ever more slowly but not faster, to l = {REACH:g}"
            )
        slope = np.minimum.accumulate(slope)
        integral = np.concatenate([[0], np.cumsum((slope[1:] + slope[:-1]) * REACH / STEPS / 2)])
        return integral, slope


@runtime_checkable
class Table(Protocol):
    """A curve that is quick for millions of pixels, or one for each of them."""

    def __call__(self, l: ArrayLike) -> tuple[Float64, Float64, Float64]:
        """g, g', g''."""

    def inverse(self, p: ArrayLike) -> Float64:
        """l with g(l) = p."""

    @property
    def steepest(self) -> float | Float64:
        """Largest g', of all or of each pixel."""

    @property
    def sharpest(self) -> float | Float64:
        """Largest −g'', or a bound on it."""


class Hardened:
    """The likelihood of a polychromatic beam, h(g(l)), for line integrals l at the reference energy.

    Parameters
    ----------
    likelihood : Likelihood
        The likelihood of the same pixels for a monochromatic beam: `Transmission`, `Gaussian`, `WeightedLeastSquares`,
        `Blurred` or one of your own whose slope h' is nowhere below min(0, h'(0)).
    curve : Curve or Table
        g: a `Polynomial`, a `Spectrum`, one of your own, or one for each ray (`TwoMaterials.behind`).

    Raises
    ------
    DataError
        If the curve does not rise or is convex.

    Examples
    --------
    >>> likelihood = pp.Hardened(pp.Transmission.of(scan), pp.Polynomial((1.0, -0.02)))
    >>> bool((likelihood.line_integrals >= pp.Transmission.of(scan).line_integrals - 1e-3).all())
    True
    """

    def __init__(self, likelihood: Likelihood, curve: Curve | Table) -> None:
        self.likelihood = likelihood
        self.curve = _table(curve)
        self.curve(0.0)  # raises DataError for an invalid curve

    @property
    def measured(self) -> Bool:
        """Pixels that carry weight, (views, rows, columns), bool."""
        return self.likelihood.measured

    @property
    def line_integrals(self) -> Float32:
        """Line integrals at the reference energy, g⁻¹ of those measured, (views, rows, columns)."""
        return self.curve.inverse(self.likelihood.line_integrals).astype(np.float32)

    def value(self, l: Float32) -> float:
        """Return Σ h(g(l)).

        Parameters
        ----------
        l : ndarray, (views, rows, columns)
            Line integrals, float32.

        Returns
        -------
        float
            The value.
        """
        return self.likelihood.value(self.curve(l)[0].astype(np.float32))

    def slope(self, l: Float32) -> Float32:
        """Return h'(g) g'.

        Parameters
        ----------
        l : ndarray, (views, rows, columns)
            Line integrals, float32.

        Returns
        -------
        ndarray, (views, rows, columns)
            The slope.
        """
        g, rise, _ = self.curve(l)
        return (self.likelihood.slope(g.astype(np.float32)) * rise).astype(np.float32)

    def curvature(self, l: Float32, kind: Curvature = "optimal") -> Float32:
        """Return the curvature of a parabola that lies above for all l ≥ 0.

        The second derivative is h''(g) g'² + h'(g) g''. Since g'' ≤ 0, the second term adds only where h' < 0, and −h' is
        largest at l = 0. So it is at most max h'' · max g'² + max(0, −h'(0)) · max(−g'').

        Parameters
        ----------
        l : ndarray, (views, rows, columns)
            Line integrals, float32.
        kind : {"optimal", "maximum", "precomputed"}, optional
            As in `Transmission.curvature`. The first two give a bound, "precomputed" the value at the minimum.

        Returns
        -------
        ndarray, (views, rows, columns)
            The curvature.
        """
        nothing = np.zeros(self.measured.shape, np.float32)
        if kind == "precomputed":
            _, rise, _ = self.curve(self.line_integrals)
            return (self.likelihood.curvature(nothing, "precomputed") * rise**2).astype(np.float32)
        most = self.likelihood.curvature(nothing, "maximum")
        # The surrogate of blurred counts has −h'(0) <= I, its largest curvature; other pixels have the slope of their own.
        fall = most if isinstance(self.likelihood, Blurred) else np.maximum(0, -self.likelihood.slope(nothing))
        return (most * self.curve.steepest**2 + fall * self.curve.sharpest).astype(np.float32)


def precorrected(scan: Scan, curve: Curve | Table) -> Scan:
    """Return the scan that a monochromatic beam of the reference energy would have shown.

    It serves methods without statistics. The noise is no longer that of counts, so prefer `Hardened` for "map" and "ml".

    Parameters
    ----------
    scan : Scan
        The projections.
    curve : Curve or Table
        The beam-hardening curve g.

    Returns
    -------
    Scan
        Each line integral p is replaced by g⁻¹(p). A pixel without a net count stays as it is.

    Raises
    ------
    DataError
        If the curve does not rise.

    Examples
    --------
    >>> pp.precorrected(scan, pp.Polynomial((1.0, -0.02))).shape
    (5, 40, 48)
    """
    signal = scan.counts.astype(np.float64) - scan.background
    lit = scan.mask & (signal > 0)
    p = np.log(np.where(lit, scan.incident, 1) / np.where(lit, signal, 1))
    corrected = np.where(lit, scan.incident * np.exp(-_table(curve).inverse(p)) + scan.background, scan.counts)
    return Scan(corrected, scan.incident, scan.views, scan.background, scan.mask, scan.notes, scan.blur)


def _table(curve: Curve | Table) -> Table:
    return curve if isinstance(curve, Table) else Tabulated(curve)
