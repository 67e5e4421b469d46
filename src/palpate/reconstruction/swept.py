"""Coordinate descent, then momentum: each where it is the quicker."""

from collections.abc import Iterator

from palpate.arrays import Float32
from palpate.reconstruction.descent import descend
from palpate.reconstruction.likelihood import Curvature, Likelihood
from palpate.reconstruction.momentum import accelerate
from palpate.reconstruction.prior import Prior
from palpate.reconstruction.projector import Projector
from palpate.reconstruction.shelf import Shelf

SWEEPS = 3  # the fourth gains no more than the momentum that could be had for it


def sweep_then_accelerate(
    A: Projector,
    likelihood: Likelihood,
    prior: Prior,
    beta: float,
    values: Float32,
    curvature: Curvature = "precomputed",
    done: int = 0,
    previous: Float32 | None = None,
) -> Iterator[tuple[Float32, float]]:
    """`SWEEPS` sweeps of `descend`, then `accelerate`, on Φ(f) = likelihood(A f) + β R(f), f >= 0.

    What a coarser grid hands on lacks all that only the finer one can show, and a sweep finds most of that at once, where
    momentum takes several iterations. What a sweep is slow at, broad changes, the coarse levels have done, and what they
    left momentum does. Source: ours; descent before momentum, measured in `benchmarks/convergence.py` (the finest level) and
    `benchmarks/clinical.py` (all).

    Yields each iterate, (z, y, x) in 1/mm as `values`, and its objective, without end; it never rises. done: iterations
    made before, the last two of which are `previous` (read after `SWEEPS` + 1 of them) and `values`: the run then goes on
    exactly as the one that made them. No array given or yielded is ever written to, and none may be while the run goes
    on.
    """
    shelf = Shelf(A.grid.shape)
    run = descend(A, likelihood, prior, beta, values, curvature, shelf=shelf)
    for _ in range(done, SWEEPS):
        values, objective = next(run)
        yield values, objective
    run = accelerate(A, likelihood, prior, beta, values, curvature, previous if done > SWEEPS else None, shelf)
    del values, previous  # a volume would stay for nothing
    yield from run


def sweeps_are_cheap(A: Projector) -> bool:
    """Whether a sweep takes a few iterations' time: each panel lies parallel to the slices."""
    return all(A.geometry.pose(view) == "parallel" for view in range(len(A.views)))
