"""The default optimizer: some sweeps of coordinate descent, then the memory gradient."""

from collections.abc import Iterator

from palpate.arrays import Float32, UInt8
from palpate.reconstruction.models.likelihood import Curvature, Likelihood
from palpate.reconstruction.models.mrf_prior import Prior
from palpate.reconstruction.optimizers.coordinate_descent import coordinate_descent
from palpate.reconstruction.optimizers.memory_gradient import memory_gradient
from palpate.reconstruction.projector import Projector
from palpate.reconstruction.volume_pool import VolumePool

SWEEPS = 3  # a fourth gains no more than iterations of the memory gradient in the same time


def hybrid_descent(
    A: Projector,
    likelihood: Likelihood,
    prior: Prior,
    beta: float,
    values: Float32,
    curvature: Curvature = "precomputed",
    done: int = 0,
    previous: Float32 | None = None,
    support: UInt8 | None = None,
) -> Iterator[tuple[Float32, float]]:
    """`SWEEPS` sweeps of `coordinate_descent`, then `memory_gradient`, on Φ(f) = likelihood(A f) + β R(f), f >= 0.

    A volume from a coarser grid lacks high spatial frequencies. One sweep finds most of them, while the memory gradient
    needs several iterations. Sweeps are slow for low frequencies; the coarse levels and the memory gradient find those.
    Source: ours, measured in `benchmarks/convergence.py` (the finest level) and `benchmarks/clinical.py` (all levels).

    Yields each iterate, (z, y, x) in 1/mm as `values`, and its objective, without end. The objective never rises. done:
    iterations made before; `previous` (read after `SWEEPS` + 1 of them) and `values` are the last two, from which the run
    resumes exactly. support: as in `coordinate_descent`. No array that is given or yielded is written to, and the caller
    may not write to them during the run.
    """
    pool = VolumePool(A.grid.shape)
    run = coordinate_descent(A, likelihood, prior, beta, values, curvature, pool=pool, support=support)
    for _ in range(done, SWEEPS):
        values, objective = next(run)
        yield values, objective
    run = memory_gradient(
        A, likelihood, prior, beta, values, curvature, previous if done > SWEEPS else None, pool, support
    )
    del values, previous  # they would keep a volume that is no longer needed
    yield from run


def sweeps_are_cheap(A: Projector) -> bool:
    """Whether a sweep takes a few iterations' time: each panel lies parallel to the slices, below them."""
    return A.upright and all(A.geometry.orientation(view) == "parallel" for view in range(len(A.views)))
