"""Projections, likelihoods and forces as functions that PyTorch differentiates. Tensors are shared by DLPack."""

from collections.abc import Callable
from typing import Any

import numpy as np

from palpate.arrays import AnyArray, ArrayLike, Float32, float32
from palpate.differentiable.map_estimate import MapEstimate
from palpate.differentiable.push_response import PushResponse
from palpate.errors import DataError, ExtraError
from palpate.reconstruction.models.likelihood import Likelihood
from palpate.reconstruction.projector import LinearMap, Projector
from palpate.scans.scan import Scan
from palpate.tissue.tissue import Tissue

try:
    import torch
except ModuleNotFoundError as error:
    raise ExtraError("PyTorch is not installed: pip install 'palpate[torch]'") from error

Tensor = Any


def projection(A: LinearMap) -> Callable[[Tensor], Tensor]:
    """Return x -> A x for tensors. The gradient is Aᵀ, whose own gradient is A again.

    Parameters
    ----------
    A : Projector or Transpose
        The linear map.

    Returns
    -------
    callable
        From tensors of shape `A.domain_shape` to float32 tensors of shape `A.range_shape`, on the CPU. It can be
        differentiated to any order.

    Raises
    ------
    DataError
        In the call, if a tensor has the wrong shape, is not finite, or lies on another device.

    Examples
    --------
    >>> import torch
    >>> A = pp.Projector(views, grid)
    >>> x = torch.ones(grid.shape, requires_grad=True)
    >>> (projection(A)(x) ** 2).sum().backward()
    >>> bool(np.allclose(np.from_dlpack(x.grad), 2 * A.T(A(x.detach())), rtol=1e-5))
    True
    """
    return lambda x: _Linear.apply(x, A)


def likelihood_value(likelihood: Likelihood) -> Callable[[Tensor], Tensor]:
    """Return l -> the likelihood's value, minus log-likelihood, for tensors. The gradient is the likelihood's slope.

    Parameters
    ----------
    likelihood : Likelihood
        Such as `pp.Transmission.of(scan)`, or one of your own.

    Returns
    -------
    callable
        From line integrals (views, rows, columns) on the CPU to a number. It can be differentiated once. As a function of
        the volume, it is the value of `projection(A)`.

    Raises
    ------
    DataError
        In the call, if a tensor has the wrong shape, is not finite, or lies on another device.

    Examples
    --------
    >>> import torch
    >>> likelihood = pp.Transmission.of(scan)
    >>> l = torch.ones(scan.shape, requires_grad=True)
    >>> likelihood_value(likelihood)(l).backward()
    >>> bool(np.allclose(np.from_dlpack(l.grad), likelihood.slope(l.detach())))
    True
    """
    return lambda l: _Likelihood.apply(l, likelihood)


def map_estimate(A: Projector, scan: Scan, strength: float) -> Callable[[Tensor], Tensor]:
    """Return counts -> the maximum-a-posteriori volume with a quadratic prior, for tensors.

    The gradient is exact at the optimum, by implicit differentiation; nothing is unrolled.

    Parameters
    ----------
    A : Projector
        The projector of the scan's views.
    scan : Scan
        Its incident beam, background and mask count; its counts set the prior's weight, which then stays.
    strength : float
        Strength of the prior, as in `pp.Prior`.

    Returns
    -------
    callable
        From counts (views, rows, columns) to attenuation (z, y, x), 1/mm, float32. It can be differentiated once.

    Raises
    ------
    DataError
        As `MapEstimate` does.

    Examples
    --------
    >>> import torch
    >>> counts = torch.from_dlpack(np.array(scan.counts)).requires_grad_()
    >>> map_estimate(pp.Projector(views, grid), scan, strength=1.0)(counts).sum().backward()
    >>> bool(counts.grad.sum() < 0)  # more photons arrive through less tissue
    True
    """
    estimate = MapEstimate(A, scan, strength)
    return lambda counts: _Map.apply(counts, estimate)


def push_force(tissue: Tissue, points: ArrayLike, radii: ArrayLike) -> Callable[[Tensor, Tensor], Tensor]:
    """Return (displacements, young) -> the force on the tools, for tensors, by linear finite elements.

    Parameters
    ----------
    tissue : Tissue
        The solid.
    points : array_like, (m, 3) or (3,)
        Rest positions of the contacts on the surface, mm.
    radii : float or array_like (m,)
        Radii of the contacts, mm.

    Returns
    -------
    callable
        From displacements, mm, shaped as `points`, and Young's modulus of each region, (R,) kPa in the order of the region
        numbers, to float64 forces of the tissue on the tools, N, shaped as `points`. It can be differentiated once by both.

    Raises
    ------
    DataError
        As `PushResponse` does.
    MaterialError
        As `PushResponse` does.

    Examples
    --------
    >>> import torch
    >>> young = torch.tensor([5.0, 50.0], dtype=torch.float64, requires_grad=True)
    >>> push_force(tissue, top, radii=10)(torch.tensor([0, 0, -2.0]), young)[2].backward()
    >>> bool((young.grad > 0).all())
    True
    """
    response = PushResponse(tissue, points, radii)
    return lambda displacements, young: _Push.apply(displacements, young, response)


class _Linear(torch.autograd.Function):  # type: ignore[misc]
    @staticmethod
    def forward(ctx: Any, x: Tensor, A: LinearMap) -> Tensor:
        ctx.A, ctx.dtype = A, x.dtype
        return _tensor(A(x.detach()))

    @staticmethod
    def backward(ctx: Any, g: Tensor) -> tuple[Tensor, None]:
        return _Linear.apply(g, ctx.A.T).to(ctx.dtype), None


class _Likelihood(torch.autograd.Function):  # type: ignore[misc]
    @staticmethod
    def forward(ctx: Any, l: Tensor, likelihood: Likelihood) -> Tensor:
        ctx.likelihood = likelihood
        ctx.save_for_backward(l)
        return torch.tensor(likelihood.value(_array(l, likelihood.measured.shape)), dtype=l.dtype)

    @staticmethod
    def backward(ctx: Any, g: Tensor) -> tuple[Tensor, None]:
        (l,) = ctx.saved_tensors
        slope = _tensor(ctx.likelihood.slope(_array(l, ctx.likelihood.measured.shape))).to(l.dtype)
        return g * _Once.apply(slope, l), None


class _Map(torch.autograd.Function):  # type: ignore[misc]
    @staticmethod
    def forward(ctx: Any, counts: Tensor, estimate: MapEstimate) -> Tensor:
        ctx.estimate = estimate
        f = _tensor(estimate.volume(counts.detach()))
        ctx.save_for_backward(counts, f)
        return f

    @staticmethod
    def backward(ctx: Any, g: Tensor) -> tuple[Tensor, None]:
        counts, f = ctx.saved_tensors
        by_counts = ctx.estimate.gradient(counts.detach(), f.detach(), g.detach())
        return _Once.apply(_tensor(by_counts).to(counts.dtype), counts, g), None


class _Push(torch.autograd.Function):  # type: ignore[misc]
    @staticmethod
    def forward(ctx: Any, d: Tensor, young: Tensor, response: PushResponse) -> Tensor:
        ctx.response = response
        ctx.save_for_backward(d, young)
        return _tensor(response.force(d.detach(), young.detach()))

    @staticmethod
    def backward(ctx: Any, g: Tensor) -> tuple[Tensor, Tensor, None]:
        d, young = ctx.saved_tensors
        found = ctx.response.gradient(d.detach(), young.detach(), g.detach())
        answers = (_tensor(array).to(x.dtype) for array, x in zip(found, (d, young), strict=True))
        return *(_Once.apply(answer, d, young, g) for answer in answers), None


class _Once(torch.autograd.Function):  # type: ignore[misc]
    """A gradient that remembers what it came from, so that a second derivative is refused and not silently lost."""

    @staticmethod
    def forward(ctx: Any, gradient: Tensor, *seen: Tensor) -> Tensor:
        return gradient.clone()

    @staticmethod
    def backward(ctx: Any, _: Tensor) -> None:
        raise DataError("second derivative: only projections can be differentiated more than once")


def _array(l: Tensor, shape: tuple[int, ...]) -> Float32:
    """The checks that a likelihood leaves to its caller."""
    return float32("l", l.detach(), shape)


def _tensor(array: AnyArray) -> Tensor:
    return torch.from_dlpack(np.ascontiguousarray(array))
