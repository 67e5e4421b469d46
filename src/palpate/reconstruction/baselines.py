"""What users compare with, from the same projector: backprojection, uniform start, SIRT."""

from collections.abc import Iterator

import numpy as np

from palpate.arrays import Float32
from palpate.errors import GeometryError
from palpate.reconstruction.likelihood import Likelihood
from palpate.reconstruction.projector import Projector


def backproject(A: Projector, likelihood: Likelihood) -> Float32:
    """Shift-and-add (z, y, x), 1/mm: each voxel the mean, over the rays through it, of line integral / length in the box.

    Weighted by that length, so that a uniform box comes back as it is. Voxels that no ray sees are 0. Raises
    `GeometryError` if no measured ray meets the grid.
    """
    measured = likelihood.measured
    length = A(np.ones(A.domain_shape, np.float32)) * measured
    refuse_unseen(length)
    seen = A.T(length)
    summed = A.T(np.maximum(likelihood.line_integrals, 0) * measured)
    values: Float32 = np.where(seen > 0, summed / np.where(seen > 0, seen, 1), 0).astype(np.float32)
    return values


def uniform(A: Projector, likelihood: Likelihood) -> Float32:
    """The one value (z, y, x), 1/mm, whose line integrals meet the measured ones best."""
    length = (A(np.ones(A.domain_shape, np.float32)) * likelihood.measured).astype(np.float64)
    refuse_unseen(length)
    value = max(0.0, float((length * likelihood.line_integrals).sum() / (length * length).sum()))
    return np.full(A.domain_shape, value, np.float32)


def sirt(A: Projector, likelihood: Likelihood, values: Float32) -> Iterator[tuple[Float32, float]]:
    """Simultaneous iterations f ← [f + C Aᵀ R (p − A f)]₊, C and R the inverse sums of A's columns and rows.

    Yields each iterate and Σ R (p − A f)²/2 without end; no statistics, no prior (Gregor & Benson, IEEE TMI 27:918, 2008).
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


def refuse_unseen(length: np.ndarray) -> None:
    """Raises `GeometryError` where nothing is above 0."""
    if not (length > 0).any():
        raise GeometryError(
            "geometry misses the volume: no measured ray meets the grid; check the grid's origin and spacing (mm), the "
            "panel's origin and axes, and the mask"
        )
