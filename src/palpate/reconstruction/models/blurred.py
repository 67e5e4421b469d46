"""The likelihood of counts behind a blur of the views: light of a ray reaches several pixels."""

from functools import cached_property
from typing import final

import numpy as np

from palpate import _core
from palpate.arrays import Bool, Float32, as_numpy
from palpate.errors import DataError
from palpate.reconstruction.models.likelihood import Curvature, Transmission
from palpate.scans.scan import Scan


@final
class Blurred:
    """Poisson likelihood with mean = incident · B e⁻ˡ + background, where B blurs each view.

    Incident counts are those read in an open beam, behind the blur, so they stand before B. The rows of B have sum 1: what
    lies beyond the panel's edge is taken to look like what lies beside it. Rays to pixels that were not measured count
    where their light reaches others. Blur is before the noise: light that spreads in the panel after a photon is absorbed
    also correlates the noise, which is not in the model.

    The surrogates come from Jensen's inequality (expectation maximization): above −log L lies a sum over rays of
    I e⁻ˡ + ỹ l + constant with I = Bᵀ incident, which touches it at the present l. Only ỹ depends on the data. So a parabola
    with the slope of −log L, and a curvature that keeps it above I e⁻ˡ, lies above −log L.

    Parameters
    ----------
    pixels : Transmission
        Counts, incident beam and background of each pixel.
    scan : Scan
        The scan they are of. Its blur must have a plane, see `Blur.through`.

    Raises
    ------
    DataError
        If the scan has no blur, or the likelihood is not the Poisson one.
    GeometryError
        If the blur's plane does not lie between focal spot and panel.

    References
    ----------
    Yu, Fessler & Ficaro, IEEE TMI 19:1094, 2000 (surrogates for overlapping beams). De Pierro, IEEE TMI 14:132, 1995.

    Examples
    --------
    >>> from dataclasses import replace
    >>> soft = replace(scan, blur=pp.Blur(panel=3.0))
    >>> likelihood = pp.Blurred.of(soft)
    >>> edge = np.zeros(scan.shape, np.float32)
    >>> edge[:, :, 24:] = 1
    >>> likelihood.seen(edge)[0, 20, 22:26].astype(float).round(2).tolist()
    [0.0, 0.13, 0.72, 0.99]
    """

    def __init__(self, pixels: Transmission, scan: Scan) -> None:
        if scan.blur is None:
            raise DataError("blur: the scan has none; give one, such as Scan(..., blur=Blur(panel=0.2))")
        if type(pixels) is not Transmission:
            raise DataError(f"blur: not with the likelihood {type(pixels).__name__}; take poisson, or leave blur out")
        self.pixels, self.taps = pixels, scan.blur.taps(scan.views)
        self.inside = _core.statistics.blur_views(self.taps, np.ones(pixels.counts.shape, np.float32))
        self.incident = pixels.incident / self.inside

    @classmethod
    def of(cls, scan: Scan) -> "Blurred":
        """Return the likelihood of a scan with blur.

        Parameters
        ----------
        scan : Scan
            The projections.

        Returns
        -------
        Blurred
            The likelihood.
        """
        return cls(Transmission.of(scan), scan)

    @property
    def measured(self) -> Bool:
        """Pixels that carry weight, (views, rows, columns), bool."""
        return self.pixels.measured

    @property
    def line_integrals(self) -> Float32:
        """As the pixels show them, blurred, (views, rows, columns), no unit."""
        return self.pixels.line_integrals

    def seen(self, l: Float32) -> Float32:
        """Return the line integrals as the pixels show them, −log B e⁻ˡ.

        Parameters
        ----------
        l : ndarray, (views, rows, columns)
            Line integrals, float32.

        Returns
        -------
        ndarray, (views, rows, columns)
            Blurred line integrals.
        """
        light = _core.statistics.blur_views(self.taps, np.exp(-self._checked(l))) / self.inside
        return np.asarray(-np.log(np.maximum(light, np.float32(1e-30))))

    def value(self, l: Float32) -> float:
        """Return half the deviance.

        Parameters
        ----------
        l : ndarray, (views, rows, columns)
            Line integrals, float32.

        Returns
        -------
        float
            The value; about half the number of pixels where the model is right.
        """
        return _core.statistics.blurred_value(*self._scan, self.taps, self._checked(l))

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
        return _core.statistics.blurred_value_and_slope(*self._scan, self.taps, self._checked(l), slope)

    def slope(self, l: Float32) -> Float32:
        """Return the derivative by each line integral, e⁻ˡ Bᵀ[incident (y / m − 1)].

        Parameters
        ----------
        l : ndarray, (views, rows, columns)
            Line integrals, float32.

        Returns
        -------
        ndarray, (views, rows, columns)
            The slope, photons.
        """
        slope = np.empty(self.incident.shape, np.float32)
        self.value_and_slope(l, slope)
        return slope

    def curvature(self, l: Float32, kind: Curvature = "optimal") -> Float32:
        """Return the curvature of a parabola in each line integral.

        Parameters
        ----------
        l : ndarray, (views, rows, columns)
            Line integrals, float32.
        kind : {"optimal", "maximum", "precomputed"}, optional
            "optimal" and "maximum" are those of I e⁻ˡ. "precomputed" is Bᵀ of the pixels' own, which does not guarantee
            descent.

        Returns
        -------
        ndarray, (views, rows, columns)
            The curvature, photons.
        """
        if kind == "precomputed":
            return _core.statistics.blur_views(self.taps, self._own / self.inside)
        return self._rays.curvature(l, kind)

    def curvatures_along(self, l: Float32, l_before: Float32, image: Float32) -> tuple[float, float, float]:
        """Return the second derivatives along two directions u and p = l − l_before, with the "precomputed" curvature.

        They are far below those of a separable parabola where a direction has detail finer than the blur.

        Parameters
        ----------
        l, l_before, image : ndarray, (views, rows, columns)
            Line integrals of two iterates, and u, float32.

        Returns
        -------
        tuple of float
            Along u, of u and p, along p.
        """
        u, p = (_core.statistics.blurred_direction(self.taps, l, v) for v in (image, l - l_before))
        along, both, before = _core.subspace.data_curvatures(self._own, p, np.zeros_like(p), u)
        return along, both, before

    @cached_property
    def _own(self) -> Float32:
        """(y − r)² / y of the pixels, (views, rows, columns)."""
        return self.pixels.curvature(np.zeros(self.incident.shape, np.float32), "precomputed")

    @cached_property
    def _rays(self) -> Transmission:
        """Of the surrogate: I = Bᵀ incident photons start along each ray. No curvature of it depends on the counts."""
        nothing = np.zeros(self.incident.shape, np.float32)
        return Transmission(nothing, _core.statistics.blur_views(self.taps, self.incident), nothing)

    @property
    def _scan(self) -> tuple[Float32, Float32, Float32]:
        return self.pixels.counts, self.incident, self.pixels.background

    def _checked(self, l: Float32) -> Float32:
        return np.ascontiguousarray(np.broadcast_to(np.asarray(as_numpy("l", l), np.float32), self.incident.shape))


def poisson(scan: Scan) -> Transmission | Blurred:
    """The Poisson likelihood of a scan, with its blur where it has one."""
    return Transmission.of(scan) if scan.blur is None else Blurred.of(scan)
