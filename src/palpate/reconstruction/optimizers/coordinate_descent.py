"""Iterative coordinate descent on paraboloidal surrogates (PS,P,CD)."""

from collections.abc import Iterator

import numpy as np

from palpate import _core
from palpate.arrays import Float32, UInt8
from palpate.reconstruction.models.likelihood import Curvature, Likelihood
from palpate.reconstruction.models.mrf_prior import Prior
from palpate.reconstruction.optimizers.problem import Problem, value_and_slope
from palpate.reconstruction.projector import Projector
from palpate.reconstruction.slab_passes import passes, slabs_of
from palpate.reconstruction.slicing import ORDER
from palpate.reconstruction.volume_pool import VolumePool

SLICES, ROWS = 8, 64  # sampled for the median curvature
VIEWS = 24  # the same, of views that are not all from above: each costs more


def coordinate_descent(
    A: Projector,
    likelihood: Likelihood,
    prior: Prior,
    beta: float,
    values: Float32,
    curvature: Curvature = "precomputed",
    relaxation: float = 1.0,
    pool: VolumePool | None = None,
    support: UInt8 | None = None,
) -> Iterator[tuple[Float32, float]]:
    """Minimises Φ(f) = likelihood(A f) + β R(f) over f >= 0, voxel by voxel (Erdogan & Fessler, IEEE TMI 18:801, 1999).

    Yields each iterate and its objective, without end. The objective never rises: "optimal" and "maximum" curvature
    guarantee that, and an iteration with "precomputed" that raised it is repeated with "optimal". relaxation: 1 goes to
    the minimum of each voxel's parabola, values up to 2 go beyond it. The iterate is the whole state, so that a run
    resumes from it exactly. No array that is given or yielded is written to, and the caller may not write to them during
    the run. Two volumes exist at a time: the last iterate and the next. pool: the source of the iterates' memory; None
    makes one. support: (z, y, x), 0 where f = 0 is a constraint and `values` are 0.
    """
    pool = pool if pool is not None else VolumePool(A.grid.shape)
    values = np.ascontiguousarray(values, np.float32)
    l, slope, following = (np.empty(A.range_shape, np.float32) for _ in range(3))
    problem = Problem(A, likelihood, prior, beta, curvature, support)
    slabs, law = slabs_of(A.grid.shape, [end for _, end, _ in _core.icd.slabs(A.geometry)]), problem.law
    penalty = 0.0
    for slab in passes(slabs, [values]):
        A.project_slices(*slab, values, l)
        penalty += problem.penalty_before(slab, values)
    objective = value_and_slope(likelihood, l, slope) + penalty
    kinds: tuple[Curvature, ...] = (curvature, "optimal") if curvature == "precomputed" else (curvature,)
    data, held = _core.icd.SurrogateImages(A.geometry), ""
    while True:
        old, values = values, pool.empty()
        for kind in kinds:
            data.set_slope(slope)
            if kind != "precomputed" or kind != held:  # the precomputed curvature does not depend on l
                data.set_curvature(np.ascontiguousarray(likelihood.curvature(l, kind)))
                held = kind
            penalty, copied = 0.0, 0
            for slab in passes(slabs, [old], [values]):
                beside = min(slab[1] + 1, len(values))  # the slice after the slab is a neighbour of its last one
                np.copyto(values[copied:beside], old[copied:beside])
                copied = beside
                _core.icd.sweep(data, values, *law, beta, relaxation, False, support, *slab)
                A.project_slices(*slab, values, following)
                penalty += problem.penalty_before(slab, values)
            now = value_and_slope(likelihood, following, slope) + penalty
            if now <= objective or kind == kinds[-1]:
                break
            value_and_slope(likelihood, l, slope)
        objective, l, following = now, following, l
        yield values, objective


def data_curvature(A: Projector, likelihood: Likelihood) -> Float32:
    """d_j = Σ_i a_ij² c_i with the precomputed curvature: how well the data alone know a voxel, mm²; a sample of it."""
    return sampled_diagonal(A, likelihood.curvature(np.zeros(A.range_shape, np.float32), "precomputed"))


def sampled_diagonal(A: Projector, weights: Float32) -> Float32:
    """Σ_i a_ij² w_i of `SLICES` slices and `ROWS` rows evenly spread, (slices, rows, x): enough for a median.

    Of views that are not all from above `VIEWS` stand for the rest.
    """
    every = [*(max(1, n // most) for n, most in zip(A.grid.shape, (SLICES, ROWS), strict=False)), 1]
    if not A.upright and len(A.views) > VIEWS:
        some = np.unique(np.linspace(0, len(A.views) - 1, VIEWS).astype(int))
        weights = weights[some] * np.float32(len(A.views) / len(some))
        A = Projector(A.views[some.tolist()], A.grid, A.tolerance)
    total: Float32 | None = None
    for s in A.slicings:
        # Where the samples along the first axis would not be those of the other slicings, all are made and some taken.
        first, second = (every[axis] for axis in ORDER[s.axis][:2])
        first = 1 if s.below else first
        part = s.restored(_core.icd.diagonal(s.geometry, np.ascontiguousarray(weights[s.views]), first, second))
        taken = [
            np.s_[e // 2 :: e] if n == m else np.s_[:] for e, n, m in zip(every, part.shape, A.grid.shape, strict=True)
        ]
        part = part[tuple(taken)]
        total = part if total is None else total + part
    assert total is not None
    return np.ascontiguousarray(total)
