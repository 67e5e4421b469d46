"""Memory gradient: all voxels at once, along the scaled slope and the last step together."""

from collections.abc import Iterator, Sequence

import numpy as np

from palpate import _core
from palpate.arrays import Float32, Float64
from palpate.reconstruction.likelihood import Curvature, Likelihood
from palpate.reconstruction.prior import Prior
from palpate.reconstruction.projector import Projector

HALVINGS = 12  # of a step that does not lower the objective, before the iterate is taken for the minimiser


def accelerate(
    A: Projector,
    likelihood: Likelihood,
    prior: Prior,
    beta: float,
    values: Float32,
    curvature: Curvature = "precomputed",
    previous: Float32 | None = None,
) -> Iterator[tuple[Float32, float]]:
    """Momentum on Φ(f) = likelihood(A f) + β R(f), f >= 0, with both step lengths from a parabola above Φ.

    Each iteration goes along two directions at once: u, the slope over a separable majoriser's curvature, and p, the last
    step. How far along each is the minimum, in their plane, of the paraboloid that lies above Φ (Chouzenoux, Idier &
    Moussaoui, IEEE TIP 20:1517, 2011); on a quadratic without bounds that is conjugate gradients. It costs two
    projections (of u and of the new iterate), one backprojection and two passes over the neighbours. Voxels at 0 that
    would sink stay there, and the step is cut at 0.

    Yields each iterate and its objective, without end; it never rises: a step that raised it is made again with the
    "optimal" curvature, then without p, then shorter. previous: the iterate before `values`, None at a start. Both
    together are all that is carried from one iteration to the next, so a run that goes on from them goes on exactly as
    the one that made them. The yielded volume is a working array: copy it to keep it.
    """
    run = _Run(A, likelihood, prior, beta, curvature)
    here = run.point(np.array(values, np.float32))
    before = here if previous is None else run.projected(np.array(previous, np.float32))
    spare = np.empty_like(here.f)
    while True:
        following = run.step(here, before, spare)
        if following is not here:
            spare, before, here = (np.empty_like(here.f) if before is here else before.f), here, following
        else:
            before = here
        yield here.f, here.objective


class _Point:
    """An iterate with its line integrals, and its objective where that is known."""

    def __init__(self, f: Float32, l: Float32, objective: float = np.inf) -> None:
        self.f, self.l, self.objective = f, l, objective


class _Run:
    """The problem, and what stays the same over all iterations."""

    def __init__(self, A: Projector, likelihood: Likelihood, prior: Prior, beta: float, curvature: Curvature) -> None:
        self.A, self.likelihood, self.prior, self.beta, self.kind = A, likelihood, prior, beta, curvature
        nothing = np.zeros(A.range_shape, np.float32)
        self.bend = np.ascontiguousarray(likelihood.curvature(nothing, "precomputed"))
        self.majoriser = majoriser(A, self.bend)
        self.u, self.gradient = (np.zeros(A.domain_shape, np.float32) for _ in range(2))
        self.nothing = np.zeros(A.domain_shape, np.float32) if beta == 0 else None

    def projected(self, f: Float32) -> _Point:
        return _Point(f, _project(self.A, f))

    def point(self, f: Float32) -> _Point:
        point = self.projected(f)
        point.objective = self.likelihood.value(point.l)
        if self.beta > 0:
            point.objective += self.beta * self.prior.value(f, self.A.grid)
        return point

    def step(self, here: _Point, before: _Point, spare: Float32) -> _Point:
        """The next iterate, written to `spare`, or `here` where nothing lowers the objective."""
        g, grid = self.gradient, self.A.grid
        _core.backproject(self.A.geometry, np.ascontiguousarray(self.likelihood.slope(here.l)), g)
        slope, bend = (self.nothing,) * 2 if self.nothing is not None else self.prior.surrogate(here.f, grid)
        slopes = _core.steer(g, slope, bend, self.majoriser, self.beta, here.f, before.f, self.u)
        q = _project(self.A, self.u)
        smooth = np.zeros(3)
        if self.beta > 0:
            smooth += _core.prior_bends(here.f, before.f, self.u, grid.spacing, *self.prior.law)
            smooth *= self.beta
        for weights in self._weights(here, before, q, slopes, smooth):
            _core.advance(here.f, before.f, self.u, weights, spare)
            following = self.point(spare)
            if following.objective <= here.objective:
                return following
        return here

    def _weights(
        self, here: _Point, before: _Point, q: Float32, slopes: Sequence[float], smooth: Float64
    ) -> Iterator[tuple[float, float]]:
        """How far along u and p: the minimum of the parabola, and then ever more careful ones."""
        kinds: tuple[Curvature, ...] = (self.kind, "optimal") if self.kind == "precomputed" else (self.kind,)
        along = 0.0
        for kind in kinds:
            bend = np.ascontiguousarray(self.likelihood.curvature(here.l, kind))
            uu, up, pp = np.array(_core.data_bends(bend, here.l, before.l, q)) + smooth
            if not uu > 0:
                return
            yield plane_minimum(slopes, uu, up, pp)
            along = -slopes[0] / uu
        for _ in range(HALVINGS):
            yield along, 0.0
            along /= 2


def majoriser(A: Projector, curvature: Float32) -> Float32:
    """Σ_i a_ij c_i Σ_k a_ik (z, y, x): a diagonal above Aᵀ diag(c) A (De Pierro, IEEE TMI 14:132, 1995)."""
    length = _project(A, np.ones(A.domain_shape, np.float32))
    out = np.empty(A.domain_shape, np.float32)
    _core.backproject(A.geometry, curvature * length, out)
    return out


def plane_minimum(slopes: Sequence[float], uu: float, up: float, pp: float) -> tuple[float, float]:
    """Where slopes·w + (uu w0² + 2 up w0 w1 + pp w1²)/2 is least; along u alone if p is nothing or parallel to it."""
    determinant = uu * pp - up * up
    if not determinant > 1e-6 * uu * pp:
        return -slopes[0] / uu, 0.0
    return (up * slopes[1] - pp * slopes[0]) / determinant, (up * slopes[0] - uu * slopes[1]) / determinant


def _project(A: Projector, f: Float32) -> Float32:
    out = np.empty(A.range_shape, np.float32)
    _core.project(A.geometry, f, out)
    return out
