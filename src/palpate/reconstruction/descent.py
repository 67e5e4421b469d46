"""PS,P,CD: paraboloidal surrogates of likelihood and prior, minimised voxel by voxel."""

from collections.abc import Iterator

import numpy as np

from palpate import _core
from palpate.arrays import Float32
from palpate.reconstruction.likelihood import Curvature, Likelihood, value_and_slope
from palpate.reconstruction.prior import Prior
from palpate.reconstruction.projector import Projector
from palpate.reconstruction.shelf import Shelf

SLICES, ROWS = 8, 64  # whose curvature stands for that of all


def descend(
    A: Projector,
    likelihood: Likelihood,
    prior: Prior,
    beta: float,
    values: Float32,
    curvature: Curvature = "precomputed",
    relaxation: float = 1.0,
    shelf: Shelf | None = None,
) -> Iterator[tuple[Float32, float]]:
    """Coordinate descent on Φ(f) = likelihood(A f) + β R(f), f >= 0 (Erdogan & Fessler, IEEE TMI 18:801, 1999).

    Yields each iterate and its objective, without end; it never rises. "optimal" and "maximum" curvature see to that by
    themselves; an iteration in which "precomputed" raised the objective is made again with "optimal". relaxation: 1 goes
    to the minimum of each voxel's parabola, up to 2 beyond it. Nothing but the iterate is carried from one iteration to
    the next, so a run that starts from one goes on exactly as the one that made it. No array given or yielded is ever
    written to, and none may be while the run goes on: two volumes live at a time, the last iterate and the next. shelf:
    where iterates come from, one of the run's own if None.
    """
    shelf = shelf if shelf is not None else Shelf(A.grid.shape)
    values = np.ascontiguousarray(values, np.float32)
    l, slope, following = A(values), np.empty(A.range_shape, np.float32), np.empty(A.range_shape, np.float32)
    objective = value_and_slope(likelihood, l, slope) + _roughness(A, prior, beta, values)
    kinds: tuple[Curvature, ...] = (curvature, "optimal") if curvature == "precomputed" else (curvature,)
    data, held = _core.Paraboloid(A.geometry), ""
    while True:
        old, values = values, shelf.copy(values)
        for kind in kinds:
            data.set_slope(slope)
            if kind != "precomputed" or kind != held:  # that one is the same at every l
                data.set_curvature(np.ascontiguousarray(likelihood.curvature(l, kind)))
                held = kind
            _core.descend(data, values, *prior.law, beta, relaxation)
            _core.project(A.geometry, values, following)
            now = value_and_slope(likelihood, following, slope) + _roughness(A, prior, beta, values)
            if now <= objective or kind == kinds[-1]:
                break
            np.copyto(values, old)
            value_and_slope(likelihood, l, slope)
        objective, l, following = now, following, l
        yield values, objective


def _roughness(A: Projector, prior: Prior, beta: float, values: Float32) -> float:
    return beta * prior.value(values, A.grid) if beta > 0 else 0.0


def data_curvature(A: Projector, likelihood: Likelihood) -> Float32:
    """d_j = Σ_i a_ij² c_i with the precomputed curvature: how well the data alone know a voxel, mm².

    Of `SLICES` slices and `ROWS` rows evenly spread, (slices, rows, x): enough for the median, which is all that is asked.
    """
    nothing = np.zeros(A.range_shape, np.float32)
    every, every_row = (max(1, n // most) for n, most in zip(A.grid.shape, (SLICES, ROWS), strict=False))
    curvature = np.ascontiguousarray(likelihood.curvature(nothing, "precomputed"))
    return _core.diagonal(A.geometry, curvature, every, every_row)
