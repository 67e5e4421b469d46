"""SART: the simultaneous algebraic reconstruction technique, one view at a time."""

from collections.abc import Iterator

import numpy as np

from palpate.arrays import Float32, Float64
from palpate.errors import DataError
from palpate.reconstruction.baselines.sirt import check_seen
from palpate.reconstruction.models.likelihood import Likelihood
from palpate.reconstruction.projector import Projector


def sart(
    A: Projector, likelihood: Likelihood, values: Float32, relaxation: float = 1.0
) -> Iterator[tuple[Float32, float]]:
    """Iterate view by view f ← [f + λ C_k A_kᵀ R_k (p_k − A_k f)]₊.

    R_k and C_k are the inverse row and column sums of view k. The next view is always the one whose focal spot is farthest
    from those just used.

    Parameters
    ----------
    A : Projector
        The projector.
    likelihood : Likelihood
        It gives the line integrals. There is no statistics and no prior.
    values : ndarray, (z, y, x)
        The start, 1/mm.
    relaxation : float, optional
        λ between 0 and 2; take less for noisy data.

    Yields
    ------
    tuple of ndarray and float
        The iterate after each pass over all views, and Σ R (p − A f)² / 2. The iteration has no end.

    Raises
    ------
    DataError
        If the relaxation is not valid.
    GeometryError
        If no measured ray meets the grid.

    References
    ----------
    Andersen & Kak, Ultrasonic Imaging 6:81, 1984. Guan & Gordon, Phys. Med. Biol. 39:2005, 1994. Jiang & Wang, IEEE TIP
    12:957, 2003.

    Examples
    --------
    >>> A, start = pp.Projector(views, grid), np.zeros(grid.shape, np.float32)
    >>> iterate, value = next(pp.sart(A, pp.Transmission.of(scan), start, relaxation=0.5))
    """
    check_relaxation(relaxation)
    values = np.array(values, np.float32)
    length = A(np.ones(A.domain_shape, np.float32)) * likelihood.measured
    check_seen(length)
    rows = np.where(length > 0, 1 / np.where(length > 0, length, 1), 0).astype(np.float32)
    p = likelihood.line_integrals
    order = [k for k in spread_order(A.views.source) if rows[k].any()]
    single = {k: Projector(A.views[k], A.grid, A.tolerance) for k in order}
    while True:
        for k in order:
            here = slice(k, k + 1)
            weight = single[k].T((rows[here] > 0).astype(np.float32))
            step = single[k].T(rows[here] * (p[here] - single[k](values)))
            values += np.divide(np.float32(relaxation) * step, weight, out=np.zeros_like(step), where=weight > 0)
            np.maximum(values, 0, out=values)
        gap = p - A(values)
        yield values, float(np.sum(rows * gap * gap, dtype=np.float64) / 2)


def check_relaxation(relaxation: float) -> None:
    """Raises `DataError` unless SART converges with it."""
    if not 0 < relaxation < 2:
        raise DataError(f"relaxation: expected a number above 0 and below 2, got {relaxation!r}")


def spread_order(source: Float64) -> list[int]:
    """All views; the first is the middlemost, each further one the farthest from those used (the latest count most)."""
    apart = np.linalg.norm(source[:, None] - source, axis=2)
    order = [int(np.argmin(apart.sum(axis=1)))]
    while len(order) < len(source):
        left = [k for k in range(len(source)) if k not in order]
        ages = np.arange(len(order), 0, -1)  # 1 for the latest
        near = [float((1 / (ages * np.maximum(apart[k, order], 1e-9))).sum()) for k in left]
        order.append(left[int(np.argmin(near))])
    return order
