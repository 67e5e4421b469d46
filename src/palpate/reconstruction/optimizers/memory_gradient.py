"""The majorize-minimize memory gradient: a step in the plane of the scaled gradient and the last step."""

from collections.abc import Iterator, Sequence

import numpy as np

from palpate import _core
from palpate.arrays import Float32, UInt8
from palpate.reconstruction.models.blurred import Blurred
from palpate.reconstruction.models.blurred_least_squares import BlurredLeastSquares
from palpate.reconstruction.models.likelihood import Curvature, Likelihood
from palpate.reconstruction.models.mrf_prior import Prior
from palpate.reconstruction.optimizers.problem import Problem, value_and_slope
from palpate.reconstruction.projector import Projector
from palpate.reconstruction.slab_passes import passes
from palpate.reconstruction.volume_pool import VolumePool
from palpate.scans.views import Panel, Views
from palpate.volumes.grid import Grid

SHORTER = 7  # times that a step which does not lower the objective is divided by 4 before the search ends
STEP = _core.subspace.COARSE_STEP  # voxels and pixels along a cell of the coarse majoriser


def memory_gradient(
    A: Projector,
    likelihood: Likelihood,
    prior: Prior,
    beta: float,
    values: Float32,
    curvature: Curvature = "precomputed",
    previous: Float32 | None = None,
    pool: VolumePool | None = None,
    support: UInt8 | None = None,
    linear: Float32 | None = None,
) -> Iterator[tuple[Float32, float]]:
    """Minimises Φ(f) = likelihood(A f) + β R(f) − ⟨linear, f⟩ over f >= 0 by the majorize-minimize memory gradient.

    Each iteration moves in the plane of two directions: u, the gradient divided by the curvature of a separable
    majoriser, and p, the last step. It goes to the minimum in that plane of a paraboloid above Φ (Chouzenoux, Idier &
    Moussaoui, IEEE TIP 20:1517, 2011). On a quadratic without bounds this is the method of conjugate gradients. It needs
    two projections (of u and of the new iterate), one backprojection and three passes over the neighbours. The step is
    cut at 0, and a voxel at 0 stays there if it would become negative.

    Yields each iterate and its objective, without end. The objective never rises: a step that raises it is repeated with
    the "optimal" curvature, then without p, then shorter. previous: the iterate before `values`, None at a start. The two
    iterates are the whole state, so that a run resumes from them exactly. No array that is given or yielded is written
    to, and the caller may not write to them during the run. Three volumes exist at a time: the last two iterates and the
    gradient. pool: the source of the iterates' memory; None makes one. support: as in `coordinate_descent`.
    """
    pool = pool if pool is not None else VolumePool(A.grid.shape)
    run = _MemoryGradient(Problem(A, likelihood, prior, beta, curvature, support, linear), pool)
    f, before = np.ascontiguousarray(values, np.float32), previous
    del values, previous  # the generator's arguments would keep a volume that is no longer needed
    objective = run.look(f, before)
    while True:
        following, objective = run.step(f, f if before is None else before, objective)
        f, before = following, f
        yield f, objective


class _MemoryGradient:
    """The problem, what stays the same over all iterations, and what the last two iterates project to.

    l, l_before: their line integrals. slope: the likelihood's there. spare: for what the direction projects to, and then
    for the line integrals of the next iterate. With the curvature five arrays of the scan's size.

    An iteration passes twice over the volumes, slab by slab: the direction is made, projected and measured in one pass; in
    the other the step is made, projected and its penalty taken.
    """

    def __init__(self, problem: Problem, pool: VolumePool) -> None:
        A, likelihood, curvature = problem.A, problem.likelihood, problem.curvature
        self.A, self.likelihood, self.beta, self.kind = A, likelihood, problem.beta, curvature
        self.problem, self.pool = problem, pool
        self.l, self.l_before, self.spare, self.slope = (np.zeros(A.range_shape, np.float32) for _ in range(4))
        self.bend = np.ascontiguousarray(likelihood.curvature(self.l, "precomputed"))
        self.majoriser, self.cell = majoriser(A, self.bend, STEP)
        if curvature != "precomputed":
            self.bend = self.l  # never read
        self.law = problem.law

    def look(self, f: Float32, before: Float32 | None) -> float:
        """The objective at f, from which `step` goes on."""
        penalty = self._project(f, self.l)
        if before is not None:
            self._project(before, self.l_before)
        else:
            np.copyto(self.l_before, self.l)
        return value_and_slope(self.likelihood, self.l, self.slope) + penalty

    def _project(self, f: Float32, out: Float32) -> float:
        """Writes the line integrals of a volume, and returns its penalty."""
        penalty = 0.0
        for slab in passes(self.problem.slabs, [f]):
            self.A.project_slices(*slab, f, out)
            penalty += self.problem.penalty_before(slab, f)
        return penalty

    def step(self, f: Float32, before: Float32, objective: float) -> tuple[Float32, float]:
        """The next iterate and its objective; f itself where nothing lowers it."""
        u = self.pool.empty()
        for attempt in range(SHORTER + 2):
            if attempt == 1 and self.kind != "precomputed":
                continue  # it has the safe curvature already
            if attempt > 0:
                value_and_slope(self.likelihood, self.l, self.slope)
            weights = self._direction(f, before, u, attempt)
            if weights is None:
                break
            penalty = 0.0
            for slab in passes(self.problem.slabs, [f, before, u]):
                part = slice(*slab)
                _core.subspace.subspace_step(f[part], before[part], weights, u[part])
                self.A.project_slices(*slab, u, self.spare)
                penalty += self.problem.penalty_before(slab, u)
            now = value_and_slope(self.likelihood, self.spare, self.slope) + penalty
            if now <= objective:
                self.l_before, self.l, self.spare = self.l, self.spare, self.l_before
                return u, now
        value_and_slope(self.likelihood, self.l, self.slope)
        np.copyto(self.l_before, self.l)
        return f, objective

    def _direction(self, f: Float32, before: Float32, u: Float32, attempt: int) -> tuple[float, float] | None:
        """Writes u and tells how far to go along it and along p, ever more carefully; None where there is no slope."""
        spacing, slopes, prior_bends = self.A.grid.spacing, np.zeros(2), np.zeros(3)
        for slab in passes(self.problem.slabs, [f, before], [u]):
            self.A.backproject_slices(*slab, self.slope, u)
            self.problem.complete(u, slab)
            slopes += _core.subspace.search_direction(
                f, before, u, self.majoriser, self.cell, self.beta, spacing, *self.law, *slab
            )
            self.A.project_slices(*slab, u, self.spare)
            if self.beta > 0:
                pairs = self.problem.pairs_before(slab)
                prior_bends += _core.subspace.prior_curvatures(f, before, u, spacing, *self.law, *pairs)
        if self.kind == "precomputed" and attempt == 0 and isinstance(self.likelihood, Blurred | BlurredLeastSquares):
            bends = np.array(self.likelihood.curvatures_along(self.l, self.l_before, self.spare))
        else:
            bends = np.array(_core.subspace.data_curvatures(self._bend(attempt), self.l, self.l_before, self.spare))
        uu, up, pp = (bends + self.beta * prior_bends).tolist()
        if not uu > 0:
            return None
        if attempt < 2:
            return plane_minimum(slopes.tolist(), uu, up, pp)
        return -slopes[0] / uu / 4 ** (attempt - 2), 0.0

    def _bend(self, attempt: int) -> Float32:
        """The curvature of a parabola in each line integral."""
        if self.kind == "precomputed" and attempt == 0:
            return self.bend
        kind: Curvature = "optimal" if self.kind == "precomputed" else self.kind
        return np.ascontiguousarray(self.likelihood.curvature(self.l, kind))


def majoriser(A: Projector, curvature: Float32, step: int = 1) -> tuple[Float32, int]:
    """Σ_i a_ij c_i Σ_k a_ik: a diagonal above Aᵀ diag(c) A (De Pierro, IEEE TMI 14:132, 1995), and the step it is on.

    step: on cells of step x step voxels, from pixels as much larger; it only scales the direction, and is smooth, so that a
    map of so few cells serves. The mean over a cell is that of the voxels. (z, y/step, x/step); 1 for small grids.
    """
    if min(*A.grid.shape[1:], *A.range_shape[1:]) < 4 * step:
        step = 1
    coarse = A if step == 1 else _coarser(A, step)
    out = np.empty(coarse.domain_shape, np.float32)
    weights = curvature if step == 1 else _summed(curvature, step)
    length = np.empty(coarse.range_shape, np.float32)
    coarse.project(np.ones(coarse.domain_shape, np.float32), length)
    coarse.backproject(weights * length, out)
    out /= step * step
    return out, step


def _coarser(A: Projector, step: int) -> Projector:
    """The same rays through cells of step x step voxels to cells of step x step pixels."""
    grid, steps = A.grid, np.array([1, step, step])
    shift = (step - 1) / 2
    offset = grid.direction @ np.array([shift * grid.spacing[2], shift * grid.spacing[1], 0])
    cells = Grid(-(-np.array(grid.shape) // steps), steps * grid.spacing, grid.origin + offset, grid.direction)
    panels = []
    for p in A.views.panels:
        shape, pitch = -(-np.array(p.shape) // step), step * np.array(p.pitch)
        panels.append(Panel(shape, pitch, p.points([shift, shift])[0], p.row_axis, p.column_axis))
    return Projector(Views(A.views.source, panels), cells, A.tolerance)


def _summed(curvature: Float32, step: int) -> Float32:
    """Sums over step x step pixels; what is missing of the last ones is 0."""
    rows = np.add.reduceat(curvature, np.arange(0, curvature.shape[1], step), axis=1)
    return np.ascontiguousarray(np.add.reduceat(rows, np.arange(0, curvature.shape[2], step), axis=2))


def plane_minimum(slopes: Sequence[float], uu: float, up: float, pp: float) -> tuple[float, float]:
    """Where slopes·w + (uu w0² + 2 up w0 w1 + pp w1²)/2 is least; along u alone if p is nothing or parallel to it."""
    determinant = uu * pp - up * up
    if not determinant > 1e-6 * uu * pp:
        return -slopes[0] / uu, 0.0
    return (up * slopes[1] - pp * slopes[0]) / determinant, (up * slopes[0] - uu * slopes[1]) / determinant
