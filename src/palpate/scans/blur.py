"""Blur of a scan: the point spread of the panel, and the shadow of a focal spot that is no point."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import brentq

from palpate.arrays import AnyArray, ArrayLike, Float32, Float64, float64
from palpate.errors import DataError, GeometryError
from palpate.scans.views import Views
from palpate.volumes.grid import Grid

FWHM = 2 * np.sqrt(2 * np.log(2))  # of a normal distribution, over its standard deviation
TAIL = 1e-5  # of the light that may fall beyond the end of a kernel, on both sides together
LEAST, NARROW = 0.02, 1e-10  # pixels²: of a normal distribution whose samples are one, and of a blur that is none


@dataclass(frozen=True)
class Blur:
    """How wide a point becomes on the panel: a normal distribution, of the panel and of the focal spot together.

    The shadow of the focal spot has its width times (M − 1) on the panel, with the magnification M = SDD / SOD of one
    plane parallel to the panel. What lies above the plane is blurred more than that, and what lies below, less.

    Parameters
    ----------
    panel : float, optional
        Full width at half maximum of the panel's point spread before its pixels sum the light, mm.
    focal_spot : float, optional
        Full width at half maximum of the focal spot, mm.
    at : float or array_like, (3,), optional
        A point (x, y, z) of the plane, mm, or its height z. By default the middle of the volume.

    Raises
    ------
    DataError
        If a width is negative or not finite, or both are 0.

    References
    ----------
    Tilley et al., Phys. Med. Biol. 61:296, 2016.

    Examples
    --------
    >>> pp.Blur(panel=0.2, focal_spot=0.3)
    Blur(panel=0.2, focal_spot=0.3, at=None)
    """

    panel: float = 0.0
    focal_spot: float = 0.0
    at: float | tuple[float, float, float] | ArrayLike | None = None

    def __post_init__(self) -> None:
        for name in ("panel", "focal_spot"):
            given = getattr(self, name)
            try:
                width = float(given)
            except (TypeError, ValueError):
                width = np.nan
            if not 0 <= width < np.inf:
                raise DataError(f"blur: {name} must be a full width at half maximum of 0 or more in mm, got {given!r}")
            object.__setattr__(self, name, width)
        if self.panel == 0 and self.focal_spot == 0:
            raise DataError("blur: the widths of panel and focal spot are both 0; give one in mm, or no blur")
        if self.at is not None:
            place: Any = self.at
            at = float64("blur at", [0.0, 0.0, place] if np.ndim(place) == 0 else place, (3,))
            object.__setattr__(self, "at", tuple(float(v) for v in at))

    def __str__(self) -> str:
        place: Any = self.at
        plane = "" if place is None or not self.focal_spot else f" at ({', '.join(f'{v:g}' for v in place)}) mm"
        return f"panel {self.panel:g} mm, focal spot {self.focal_spot:g} mm{plane}"

    def through(self, grid: Grid) -> "Blur":
        """Return the blur at the middle of a grid if it has no plane yet.

        Parameters
        ----------
        grid : Grid
            The voxels.

        Returns
        -------
        Blur
            With a plane.
        """
        return self if self.at is not None else replace(self, at=grid.bounds.mean(axis=0))

    def check(self, views: Views) -> None:
        """Refuse a width that no panel of the views could show.

        Parameters
        ----------
        views : Views
            The geometry.

        Raises
        ------
        DataError
            If a width is not smaller than the panel.
        """
        side = min(n * d for panel in views.panels for n, d in zip(panel.shape, panel.pitch, strict=True))
        for name, width in (("panel", self.panel), ("focal_spot", self.focal_spot)):
            if width >= side:
                raise DataError(f"blur: {name} of {width:g} mm is wider than the panel ({side:g} mm); check the units")

    def widths(self, views: Views) -> Float64:
        """Return the full width at half maximum on the panel.

        Parameters
        ----------
        views : Views
            The geometry.

        Returns
        -------
        ndarray, (views,)
            Of each view, mm.

        Raises
        ------
        GeometryError
            If the plane does not lie between a focal spot and its panel.
        """
        widths = np.full(len(views), self.panel)
        if self.focal_spot == 0:
            return widths
        if self.at is None:
            raise GeometryError("blur: the focal spot's shadow depends on a plane; give `at`, a point of it, in mm")
        for k, (source, panel) in enumerate(zip(views.source, views.panels, strict=True)):
            distance = abs((panel.origin - source) @ panel.normal)
            reach = (np.array(self.at) - source) @ panel.normal * np.sign((panel.origin - source) @ panel.normal)
            if not 0 < reach <= distance:
                raise GeometryError(
                    f"blur: the plane through {self.at} mm does not lie between focal spot and panel of view {k}"
                )
            widths[k] = np.hypot(self.panel, self.focal_spot * (distance - reach) / reach)
        return widths

    def taps(self, views: Views) -> Float32:
        """Return the kernels on the pixels: nonnegative, of sum 1, with the variance of the blur at any pitch.

        They are samples of a normal distribution, whose own width is such that their variance is t = σ² / pitch². Where t is
        above ½ the two widths are the same, and what pixels see of a smooth image is what they see of the blurred one.
        Where a pixel is wide, a share t/2 goes to each neighbour. Kernels on coarser pixels are those of the same blur.

        Parameters
        ----------
        views : Views
            The geometry.

        Returns
        -------
        ndarray, (views, 2, reach + 1)
            From the middle outwards, across rows and across columns, float32.

        Raises
        ------
        DataError
            If the blur is as wide as the panel.
        GeometryError
            As for `widths`.
        """
        sigma = self.widths(views) / FWHM
        t = np.square(sigma[:, None] / np.array([panel.pitch for panel in views.panels]))  # (views, 2)
        most = max(views.shape[1:])
        n = np.arange(int(np.ceil(6 * np.sqrt(t.max()) + 6)) + 1)
        taps = np.array([[_samples(variance, n) for variance in both] for both in t])
        beyond = 1 - np.cumsum(taps, axis=2)
        enough = np.flatnonzero((beyond <= TAIL).all(axis=(0, 1)))
        if enough.size == 0 or enough[0] >= most:
            raise DataError(f"blur: {self.widths(views).max():g} mm is as wide as the panel; check the units")
        taps = taps[:, :, : enough[0] + 1] / (1 - beyond[:, :, enough[0], None])
        taps[:, :, 1:] /= 2
        return np.ascontiguousarray(taps, np.float32)


def _samples(variance: float, n: AnyArray) -> Float64:
    """Of a normal distribution at 0, ±1, ±2..., whose variance as samples is given, both sides together; of sum 1."""

    def samples(own: float) -> Float64:
        weights = np.where(n > 0, 2.0, 1.0) * np.exp(-np.square(n, dtype=np.float64) / (2 * own))
        return np.asarray(weights / weights.sum(), np.float64)

    if variance < NARROW:
        return samples(LEAST)
    own = brentq(lambda own: float(samples(own) @ np.square(n)) - variance, LEAST, variance + 1, xtol=1e-12)
    return samples(float(own))
