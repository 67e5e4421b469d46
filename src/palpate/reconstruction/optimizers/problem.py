"""The minimisation problem of one resolution level, as an optimizer of a user's own gets it."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from palpate import _core
from palpate.arrays import AnyArray, Float32, UInt8
from palpate.reconstruction.models.blurred import Blurred
from palpate.reconstruction.models.likelihood import Curvature, Gaussian, Likelihood, Transmission
from palpate.reconstruction.models.mrf_prior import Prior
from palpate.reconstruction.projector import Projector
from palpate.reconstruction.slab_passes import Slab, passes, slabs_of

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
        return sum(self.penalty_before(slab, f) for slab in passes(self.slabs, [f]))

    def penalty_before(self, slab: Slab, f: Float32) -> float:
        """The part of it that is known once the slabs up to this one are: their pairs with each other and with it."""
        first, end = self.pairs_before(slab)
        value = 0.0
        if self.beta > 0:
            value = self.beta * _core.statistics.prior_value(f, self.A.grid.spacing, *self.law, first, end)
        if self.linear is not None:  # slice by slice, so that the sum is one of doubles
            value -= sum(float(np.vdot(e, g)) for e, g in zip(self.linear[first:end], f[first:end], strict=True))
        return value

    def pairs_before(self, slab: Slab) -> Slab:
        """The slices whose next slice is known as well once the slabs up to this one are; the last one has none."""
        first, end = slab
        return max(0, first - 1), end if end == self.A.grid.shape[0] else end - 1

    @cached_property
    def slabs(self) -> list[Slab]:
        """In which a pass goes over the volumes."""
        shape = self.A.grid.shape
        return slabs_of(shape) if self.A.upright else [(0, shape[0])]

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
        if self.linear is not None:
            slope -= self.linear
        return slope + self.prior_surrogate(f)[0] if self.beta > 0 else slope

    def prior_surrogate(self, f: Float32) -> tuple[Float32, Float32]:
        """The gradient of β R, and the curvature of a separable parabola above it."""
        slope, bend = _core.statistics.prior_surrogate(f, self.A.grid.spacing, *self.law)
        return np.float32(self.beta) * slope, np.float32(self.beta) * bend

    def complete(self, gradient: Float32, slab: Slab) -> None:
        """Adds the gradient of −⟨linear, f⟩ to some slices, in place, and holds f at 0 outside the support."""
        part = slice(*slab)
        if self.linear is not None:
            gradient[part] -= self.linear[part]
        if self.support is not None:
            hold_outside(gradient[part], self.support[part])


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


def value_and_slope(likelihood: Likelihood, l: Float32, slope: Float32) -> float:
    """The value; the slope is written to `slope`. In one pass for our own, not for what overrides parts of them."""
    if type(likelihood) is Transmission or type(likelihood) is Gaussian or isinstance(likelihood, Blurred):
        return likelihood.value_and_slope(l, slope)
    np.copyto(slope, likelihood.slope(l))
    return likelihood.value(l)
