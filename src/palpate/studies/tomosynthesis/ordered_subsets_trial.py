"""Ordered subsets on the finest grid, each pass counted, until they are as far as another optimiser was."""

from collections.abc import Callable

from palpate.arrays import Float32
from palpate.reconstruction.baselines.sirt import backproject
from palpate.reconstruction.models.likelihood import Likelihood, Transmission
from palpate.reconstruction.optimizers.ordered_subsets import SubsetsState, ordered_subsets
from palpate.studies.tomosynthesis.convergence_traces import ConvergenceTrace, CpuClock, ReconstructionProblem, note


def trace_subsets(
    problem: ReconstructionProblem, subsets: int, momentum: bool, enough: float, most: int
) -> ConvergenceTrace:
    """From the backprojection to the posterior `enough`, or for `most` passes. A pass that is made again counts again."""
    seen, clock, made = ConvergenceTrace(), CpuClock(), [0.0]
    pace = SubsetsState(subsets, momentum)
    start = backproject(problem.A, problem.data)
    solver = ordered_subsets(problem.A, problem.data, problem.prior, problem.beta, start, _counted(problem, made), pace)
    for iteration, (values, objective) in enumerate(clock.each(solver), 1):
        note(seen, problem, values, (0, iteration, made[0], objective), clock)
        if objective <= enough or made[0] >= most:
            break
    seen.stop = len(seen.trace["level"]) - 1
    return seen


def _counted(problem: ReconstructionProblem, made: list[float]) -> Callable[[list[int]], Likelihood]:
    """The likelihood of some of the views; made: takes note of each use of them as a share of a pass."""

    class Counted(Transmission):
        def slope(self, l: Float32) -> Float32:
            made[0] += len(l) / len(problem.scan.views)
            return super().slope(l)

    return lambda views: Counted.of(problem.scan[views])
