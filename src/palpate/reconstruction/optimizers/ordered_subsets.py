"""Ordered subsets with Nesterov's momentum; a pass that raises the objective is repeated with more care."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np

from palpate import _core
from palpate.arrays import Float32, UInt8
from palpate.reconstruction.baselines.sart import spread_order
from palpate.reconstruction.models.likelihood import Curvature, Likelihood
from palpate.reconstruction.models.mrf_prior import Prior
from palpate.reconstruction.optimizers.memory_gradient import majoriser
from palpate.reconstruction.optimizers.problem import Problem, hold_outside
from palpate.reconstruction.projector import Projector

VIEWS = 3  # views in a subset by default: with fewer, a subset's gradient is too far from the full one
HALVINGS = 12  # of a step that does not lower the objective, before the search ends


@dataclass
class SubsetsState:
    """The state of a run besides the iterate.

    subsets: groups of views, from one to the number of views. accelerated: with momentum. t: Nesterov's sequence, 1 where
    momentum begins anew. previous: the iterate one step (not one pass) before. share: of each step that is taken.
    """

    subsets: int
    accelerated: bool = True
    t: float = 1.0
    previous: Float32 | None = None
    share: float = 1.0

    @classmethod
    def of(cls, previous: Float32, numbers: tuple[float, ...]) -> Self:
        """The pace whose `state` that was."""
        subsets, accelerated, t, share = numbers
        return cls(int(subsets), bool(accelerated), t, previous, share)

    def state(self) -> tuple[Float32 | None, tuple[float, ...]]:
        """A copy of `previous`, and the rest, for `of`."""
        previous = None if self.previous is None else self.previous.copy()
        return previous, (self.subsets, self.accelerated, self.t, self.share)


def ordered_subsets(
    A: Projector,
    likelihood: Likelihood,
    prior: Prior,
    beta: float,
    values: Float32,
    part: Callable[[list[int]], Likelihood],
    pace: SubsetsState | None = None,
    curvature: Curvature = "precomputed",
    support: UInt8 | None = None,
) -> Iterator[tuple[Float32, float]]:
    """Separable surrogates of Φ(f) = likelihood(A f) + β R(f), f >= 0, by ordered subsets of views and with momentum.

    Each step is to the minimum of a separable parabola whose slope is that of one subset, times their number, and of the
    whole prior (Erdogan & Fessler, Phys. Med. Biol. 44:2835, 1999), from a point ahead of the last iterate (Nesterov 1983;
    Kim, Ramani & Fessler, IEEE TMI 34:167, 2015). A pass over all subsets costs a projection, a backprojection, and for
    each subset a pass over the neighbours; the objective after it costs another projection.

    Subsets do not end at the minimum, momentum may overshoot and the precomputed curvature lie below, so the full
    objective is watched. A pass that raised it is made again: without the momentum gathered before; if there was none,
    with half the subsets; with one subset, with steps half as long. So the objective never rises, and the end is the
    minimum. Yields the iterate after each pass and its objective, without end. part: the likelihood of some of the views.
    pace: with how many subsets to begin, or where to go on; by default a third of the views. It changes as the run goes
    on. support: as in `coordinate_descent`. The yielded volume and `pace.previous` are working arrays: copy them to keep
    them.
    """
    pace = pace if pace is not None else SubsetsState(default_subsets(len(A.views)))
    problem = Problem(A, likelihood, prior, beta, curvature, support)
    run = _Subsets(problem, part)
    x = np.array(values, np.float32)
    previous = np.array(values if pace.previous is None else pace.previous, np.float32)
    kept, objective, share = np.empty_like(x), problem.objective(x), pace.share
    while True:
        np.copyto(kept, x)
        while True:
            x, previous, t = run.passed(x, previous, pace)
            now = problem.objective(x)
            if now <= objective:
                objective, pace.previous, pace.t, share = now, previous, t, pace.share
                break
            np.copyto(x, kept)
            np.copyto(previous, kept)
            if pace.t > 1:
                pace.t = 1.0
            elif pace.subsets > 1:
                pace.subsets //= 2
            elif pace.share > share / 2**HALVINGS:
                pace.share /= 2
            else:
                pace.share, pace.previous = share, previous
                break
        yield x, objective


def default_subsets(views: int) -> int:
    """One for every `VIEWS` views."""
    return max(1, views // VIEWS)


class _Subsets:
    """The problem in groups of views, and its buffers."""

    def __init__(self, problem: Problem, part: Callable[[list[int]], Likelihood]) -> None:
        self.A, self.measured, self.beta, self.part = problem.A, problem.likelihood.measured, problem.beta, part
        self.kind: Curvature = "precomputed" if problem.curvature == "precomputed" else "maximum"
        self.groups: list[tuple[Projector, Likelihood]] = []
        self.bound, self.z = (np.zeros(self.A.domain_shape, np.float32) for _ in range(2))
        self.law, self.support = problem.law, problem.support

    def passed(self, x: Float32, previous: Float32, pace: SubsetsState) -> tuple[Float32, Float32, float]:
        """The iterate after each subset had its step, the one before it, and t. Both arrays are written to."""
        if len(self.groups) != pace.subsets:
            self._split(pace.subsets)
        t, beta = pace.t, self.beta / len(self.groups)
        for A, likelihood in self.groups:
            following = (1 + np.sqrt(1 + 4 * t * t)) / 2 if pace.accelerated else 1.0
            _core.subspace.subspace_step(x, previous, (0.0, (t - 1) / following), self.z)
            A.backproject(np.ascontiguousarray(likelihood.slope(A(self.z))), previous)
            hold_outside(previous, self.support)
            _core.subspace.search_direction(
                self.z, self.z, previous, self.bound, 1, beta, self.A.grid.spacing, *self.law
            )
            _core.subspace.subspace_step(self.z, self.z, (pace.share, 0.0), previous)
            x, previous, t = previous, x, following
        return x, previous, t

    def _split(self, count: int) -> None:
        """Every count-th view from each of the first `count` ones, in an order in which neighbours see differently.

        `bound`: above the data's curvature in each voxel, of whichever subset bends most there: where only some views
        see a voxel, their number times one subset's slope is too steep for the mean.
        """
        views = [k for k in range(len(self.A.views)) if self.measured[k].any()]
        order = spread_order(self.A.views.source[views[:count]])
        self.groups.clear()
        self.bound[:] = 0
        for first in order:
            chosen = views[first::count]
            A = self.A
            if len(chosen) < len(A.views):
                A = Projector(A.views[chosen], A.grid, A.tolerance)
            likelihood = self.part(chosen)
            bend = likelihood.curvature(np.zeros(A.range_shape, np.float32), self.kind)
            np.maximum(self.bound, majoriser(A, np.ascontiguousarray(bend))[0], out=self.bound)
            self.groups.append((A, likelihood))
