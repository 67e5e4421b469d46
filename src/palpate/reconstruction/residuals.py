"""What a volume leaves unexplained of the views that it was reconstructed from."""

from dataclasses import dataclass, replace

import numpy as np

from palpate.arrays import Float32, Float64
from palpate.errors import DataError
from palpate.reconstruction.coarse_fit import OFFSET, smooth_line_integrals, unexplained, without_offset
from palpate.reconstruction.models.blurred import Blurred
from palpate.reconstruction.models.likelihood import Transmission
from palpate.reconstruction.multiresolution import coarser_scan
from palpate.reconstruction.projector import Projector
from palpate.scans.finding import Finding
from palpate.scans.scan import Scan
from palpate.volumes.volume import Volume

SIDE = 64  # pixels along a panel's longer side at which what is left is judged: no noise, no edges of voxels
POOR = 0.15  # of a view's contrast: more than this left in the mean is an alarm
ODD = 0.08, 4.0  # of a view's contrast, and times the views' median: one view that is left over alone


@dataclass(frozen=True, eq=False)
class Residuals:
    """What a volume leaves unexplained of each view.

    Parameters
    ----------
    expected : ndarray, (views, rows, columns)
        Photons that the volume lets through, and the background.
    deviance : ndarray, (views,)
        Poisson deviance over the number of measured pixels. It is about 1 where counts are photons and the model is right.
        Scatter, drifting gains and voxels larger than pixels make it larger in a bright beam.
    unexplained : ndarray, (views,)
        Share of the contrast of the smoothed line integrals that the volume does not explain, whatever the dose and
        but for a constant, which an open beam that drifts or scatter may add.

    Examples
    --------
    >>> left = pp.residuals(scan, volume)
    >>> left.expected.shape, left.deviance.shape
    ((5, 40, 48), (5,))
    """

    expected: Float32
    deviance: Float64
    unexplained: Float64


def residuals(scan: Scan, volume: Volume) -> Residuals:
    """Compare the views with those of a volume.

    Parameters
    ----------
    scan : Scan
        The projections.
    volume : Volume
        Attenuation, 1/mm.

    Returns
    -------
    Residuals
        What is left of each view.

    Raises
    ------
    DataError
        If the volume is not one of attenuation.
    GeometryError
        If no ray meets it.

    Examples
    --------
    >>> bool(pp.residuals(scan, volume).unexplained.max() < 0.1)
    True
    """
    if volume.unit != "1/mm":
        raise DataError(f"volume: expected attenuation in 1/mm, got {volume.unit}")
    l = Projector(scan.views, volume.grid)(volume.values)
    if scan.blur is not None:
        l = Blurred.of(replace(scan, blur=scan.blur.through(volume.grid))).seen(l)
    deviance = np.array([2 * Transmission.of(scan[k]).value(l[k : k + 1]) for k in range(len(l))])
    deviance /= np.maximum(scan.mask.sum(axis=(1, 2)), 1)
    expected = scan.incident * np.exp(-l) + scan.background
    coarse, model = scan, np.where(scan.mask, expected, np.float32(0))
    while max(coarse.shape[1:]) > SIDE:
        coarse, model = coarser_scan(coarse), _quadrupled(model)
    measured, variance, weight = smooth_line_integrals(coarse)
    modelled = Scan(np.where(coarse.mask, model, 0), coarse.incident, coarse.views, coarse.background, coarse.mask)
    error = without_offset(measured - smooth_line_integrals(modelled)[0], weight, OFFSET)
    left = unexplained(measured, measured - error, variance, weight)
    return Residuals(expected, deviance, left)


def _quadrupled(a: Float32) -> Float32:
    """Sums over 2 x 2 pixels; odd sizes are filled up with 0."""
    _, rows, columns = a.shape
    a = np.pad(a, ((0, 0), (0, rows % 2), (0, columns % 2)))
    a = a[:, ::2] + a[:, 1::2]
    return np.asarray(a[:, :, ::2] + a[:, :, 1::2])


def check_residuals(left: Residuals) -> list[Finding]:
    """Say which views a volume does not explain.

    Parameters
    ----------
    left : Residuals
        Of the volume.

    Returns
    -------
    list of Finding
        What is wrong; empty if nothing is.

    Raises
    ------
    AttributeError
        If `left` is not what `residuals` returns.

    Examples
    --------
    >>> pp.check_residuals(pp.residuals(scan, volume))
    []
    """
    share = left.unexplained
    least, times = ODD
    odd = np.flatnonzero(share > max(least, times * float(np.median(share))))
    each = ", ".join(f"{k} ({share[k]:.0%}, deviance {left.deviance[k]:.3g} a pixel)" for k in odd[:4])
    if 0 < len(odd) <= len(share) / 3:
        return [
            Finding("odd views", f"the volume does not explain view {each}: check its file, its angle and its panel")
        ]
    mean = float(np.sqrt(np.mean(share**2)))
    if mean > POOR:
        words = (
            f"the volume leaves {mean:.0%} of the views' contrast unexplained (deviance {np.median(left.deviance):.3g} a "
            f"pixel, 1 is noise alone)"
        )
        return [Finding("poor fit", f"{words}: check the geometry, incident and the grid with `palpate scan check`")]
    return []
