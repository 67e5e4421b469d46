"""The minimisation problem of one resolution level, as an optimizer of a user's own gets it."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from palpate import _core
from palpate.arrays import AnyArray, Float32, UInt8
from palpate.reconstruction.models.likelihood import Curvature, Likelihood
from palpate.reconstruction.models.mrf_prior import Prior
from palpate.reconstruction.projector import Projector

# In a support: a voxel within the object's own outline. Its neighbours outside do not count in R, which would draw the
# object's rim towards the air. In a hull they do: much of it is air, as they are.
OUTLINE = 2
RISING = 1e30  # any gradient so steep that the prior does not outweigh it


@dataclass(frozen=True, eq=False)
class Problem:
    """Φ(f) = likelihood(A f) + β R(f) − ⟨linear, f⟩, to be minimised over f >= 0, (z, y, x) 1/mm.

    beta: strength of the prior on this level, 0 for maximum likelihood. curvature: the kind that the user asked for.
    support: (z, y, x), 0 where f = 0 is a constraint, else 1, or `OUTLINE`; None where there is none. linear: (z, y, x), mm;
    None is 0.
    """

    A: Projector
    likelihood: Likelihood
    prior: Prior
    beta: float
    curvature: Curvature
    support: UInt8 | None = None
    linear: Float32 | None = None

    def objective(self, f: Float32) -> float:
        """Φ(f)."""
        return self.likelihood.value(self.A(f)) + self.penalty(f)

    def penalty(self, f: Float32) -> float:
        """β R(f) − ⟨linear, f⟩."""
        value = self.beta * _core.statistics.prior_value(f, self.A.grid.spacing, *self.law) if self.beta > 0 else 0.0
        if self.linear is not None:  # slice by slice, so that the sum is one of doubles
            value -= sum(float(np.vdot(e, g)) for e, g in zip(self.linear, f, strict=True))
        return value

    @cached_property
    def law(self) -> tuple[_core.statistics.PriorKernel, float]:
        """The prior's, as the kernels take it; some law where there is no prior."""
        kernel, edge = (self.prior if self.beta > 0 else Prior("quadratic")).law
        if self.support is None or not (self.support == OUTLINE).any():
            return kernel, edge
        inside = np.asarray(self.support > 0, np.float32)
        pull = Prior("quadratic", neighbours=self.prior.neighbours).surrogate(inside, self.A.grid)[0]
        return kernel.within(pull * (self.support == OUTLINE)), edge

    def gradient(self, f: Float32) -> Float32:
        """∇Φ(f), (z, y, x)."""
        slope = self.A.T(self.likelihood.slope(self.A(f)))
        self.add_linear(slope)
        return slope + self.prior_surrogate(f)[0] if self.beta > 0 else slope

    def prior_surrogate(self, f: Float32) -> tuple[Float32, Float32]:
        """The gradient of β R, and the curvature of a separable parabola above it."""
        slope, bend = _core.statistics.prior_surrogate(f, self.A.grid.spacing, *self.law)
        return np.float32(self.beta) * slope, np.float32(self.beta) * bend

    def add_linear(self, gradient: Float32) -> None:
        """Adds the gradient of −⟨linear, f⟩, in place."""
        if self.linear is not None:
            gradient -= self.linear


def hold_outside(gradient: Float32, support: UInt8 | None) -> None:
    """Makes the gradient positive outside the support, in place: there f is 0, and a step of f >= 0 leaves it so."""
    if support is not None:
        np.copyto(gradient, np.float32(RISING), where=support == 0)


class Optimizer(Protocol):
    """What `register_optimizer` asks of a class; see there."""

    def __init__(self, problem: Problem, values: Float32, state: Mapping[str, AnyArray]) -> None: ...

    def update(self) -> tuple[Float32, float]:
        """The next iterate (z, y, x) 1/mm, and Φ there."""

    def state(self) -> Mapping[str, AnyArray]:
        """All that `update` needs besides the iterate to go on to the bit."""
