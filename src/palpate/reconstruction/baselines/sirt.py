"""Backprojection, a uniform start, and SIRT, with the same projector."""

from collections.abc import Iterator

import numpy as np

from palpate.arrays import Float32, UInt8
from palpate.errors import GeometryError
from palpate.reconstruction.models.likelihood import Likelihood
from palpate.reconstruction.projector import Projector


def backproject(A: Projector, likelihood: Likelihood) -> Float32:
    """Backproject by shift-and-add.

    Each voxel is the mean, over its rays, of line integral / length in the box, weighted by that length. A uniform box
    comes back as it is.

    Parameters
    ----------
    A : Projector
        The projector.
    likelihood : Likelihood
        It gives the line integrals.

    Returns
    -------
    ndarray, (z, y, x)
        Attenuation, 1/mm; 0 where no ray passes.

    Raises
    ------
    GeometryError
        If no measured ray meets the grid.

    Examples
    --------
    >>> pp.backproject(pp.Projector(views, grid), pp.Transmission.of(scan)).shape
    (8, 20, 24)
    """
    measured = likelihood.measured
    length = A(np.ones(A.domain_shape, np.float32)) * measured
    check_seen(length)
    seen = A.T(length)
    summed = A.T(np.maximum(likelihood.line_integrals, 0) * measured)
    values: Float32 = np.where(seen > 0, summed / np.where(seen > 0, seen, 1), 0).astype(np.float32)
    return values


def uniform_volume(A: Projector, likelihood: Likelihood, support: UInt8 | None = None) -> Float32:
    """A volume (z, y, x) of one value, 1/mm, whose line integrals are closest to the measured ones; 0 outside `support`."""
    inside = np.ones(A.domain_shape, np.float32) if support is None else (support > 0).astype(np.float32)
    length = (A(inside) * likelihood.measured).astype(np.float64)
    check_seen(length)
    value = max(0.0, float((length * likelihood.line_integrals).sum() / (length * length).sum()))
    return inside * np.float32(value)


def sirt(A: Projector, likelihood: Likelihood, values: Float32) -> Iterator[tuple[Float32, float]]:
    """Iterate f ← [f + C Aᵀ R (p − A f)]₊, with the inverse column and row sums C and R.

    Parameters
    ----------
    A : Projector
        The projector.
    likelihood : Likelihood
        It gives the line integrals. There is no statistics and no prior.
    values : ndarray, (z, y, x)
        The start, 1/mm.

    Yields
    ------
    tuple of ndarray and float
        The iterate, and Σ R (p − A f)² / 2. The iteration has no end.

    Raises
    ------
    GeometryError
        If no measured ray meets the grid.

    References
    ----------
    Gregor & Benson, IEEE TMI 27:918, 2008.

    Examples
    --------
    >>> A, start = pp.Projector(views, grid), np.zeros(grid.shape, np.float32)
    >>> iterate, value = next(pp.sirt(A, pp.Transmission.of(scan), start))
    """
    values = np.array(values, np.float32)
    length = A(np.ones(A.domain_shape, np.float32))
    rows = np.where(likelihood.measured & (length > 0), 1 / np.where(length > 0, length, 1), 0).astype(np.float32)
    weight = A.T((rows > 0).astype(np.float32))
    columns = np.where(weight > 0, 1 / np.where(weight > 0, weight, 1), 0).astype(np.float32)
    p = likelihood.line_integrals
    gap = p - A(values)
    while True:
        values += columns * A.T(rows * gap)
        np.maximum(values, 0, out=values)
        gap = p - A(values)
        yield values, float(np.sum(rows * gap * gap, dtype=np.float64) / 2)


def check_seen(length: np.ndarray) -> None:
    """Raises `GeometryError` where nothing is above 0."""
    if not (length > 0).any():
        raise GeometryError(
            "geometry misses the volume: no measured ray meets the grid; check the grid's origin and spacing (mm), the "
            "panel's origin and axes, and the mask"
        )
