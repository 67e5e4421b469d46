"""Projections, likelihoods and forces as functions that JAX differentiates."""

from collections.abc import Callable
from typing import Any

import numpy as np

from palpate.arrays import ArrayLike
from palpate.differentiable.map_estimate import MapEstimate
from palpate.differentiable.push_response import PushResponse
from palpate.errors import DataError, ExtraError
from palpate.reconstruction.models.likelihood import Likelihood
from palpate.reconstruction.projector import LinearMap, Projector
from palpate.scans.scan import Scan
from palpate.tissue.tissue import Tissue

try:
    import jax
except ModuleNotFoundError as error:
    raise ExtraError("JAX is not installed: pip install 'palpate[jax]'") from error

# JAX has no stubs that hold across versions.
JaxArray = Any


def projection(A: LinearMap) -> Callable[[JaxArray], JaxArray]:
    """Return x -> A x for JAX arrays. The gradient is Aᵀ, whose own gradient is A again.

    Parameters
    ----------
    A : Projector or Transpose
        The linear map.

    Returns
    -------
    callable
        From float32 arrays of shape `A.domain_shape` to those of shape `A.range_shape`. It can be used in `jax.jit`,
        `jax.vjp`, `jax.grad` (to any order) and `jax.vmap`, which applies A to one array after the other.

    Raises
    ------
    DataError
        In the call, if an array has the wrong shape. Wrong values are refused as `A` does.

    Examples
    --------
    >>> import jax
    >>> A = pp.Projector(views, grid)
    >>> project = projection(A)
    >>> gradient = jax.grad(lambda x: (project(x) ** 2).sum() / 2)(volume.values)
    >>> bool(np.allclose(gradient, A.T(A(volume.values)), rtol=1e-5))
    True
    """

    def forward(x: JaxArray) -> JaxArray:
        return _called(A, A.range_shape, np.float32, _single("x", x, A.domain_shape))

    apply = jax.custom_vjp(forward)
    apply.defvjp(lambda x: (apply(x), None), lambda _, g: (projection(A.T)(g),))
    return lambda x: apply(_single("x", x, A.domain_shape))


def likelihood_value(likelihood: Likelihood) -> Callable[[JaxArray], JaxArray]:
    """Return l -> the likelihood's value, minus log-likelihood, for JAX arrays. The gradient is the likelihood's slope.

    Parameters
    ----------
    likelihood : Likelihood
        Such as `pp.Transmission.of(scan)`, or one of your own.

    Returns
    -------
    callable
        From line integrals (views, rows, columns), float32, to a float32 number. It can be differentiated once. As a
        function of the volume, it is the value of `projection(A)`.

    Raises
    ------
    DataError
        In the call, if an array has the wrong shape.

    Examples
    --------
    >>> import jax
    >>> A, likelihood = pp.Projector(views, grid), pp.Transmission.of(scan)
    >>> project, value = projection(A), likelihood_value(likelihood)
    >>> gradient = jax.grad(lambda x: value(project(x)))(volume.values)
    >>> bool(np.allclose(gradient, A.T(likelihood.slope(A(volume.values))), rtol=1e-4, atol=1e-2))
    True
    """
    shape = likelihood.measured.shape

    def value(l: JaxArray) -> JaxArray:
        return _called(lambda l: np.float32(likelihood.value(l)), (), np.float32, l)

    def slope(l: JaxArray, g: JaxArray) -> tuple[JaxArray]:
        return (g * _called(likelihood.slope, shape, np.float32, l),)

    apply = jax.custom_vjp(value)
    apply.defvjp(lambda l: (apply(l), l), slope)
    return lambda l: apply(_single("l", l, shape))


def map_estimate(A: Projector, scan: Scan, strength: float) -> Callable[[JaxArray], JaxArray]:
    """Return counts -> the maximum-a-posteriori volume with a quadratic prior, for JAX arrays.

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
    >>> import jax
    >>> estimate = map_estimate(pp.Projector(views, grid), scan, strength=1.0)
    >>> by_counts = jax.grad(lambda y: estimate(y).sum())(scan.counts)
    >>> bool(by_counts.sum() < 0)  # more photons arrive through less tissue
    True
    """
    estimate = MapEstimate(A, scan, strength)

    def volume(counts: JaxArray) -> JaxArray:
        return _called(estimate.volume, A.domain_shape, np.float32, counts)

    def forward(counts: JaxArray) -> tuple[JaxArray, tuple[JaxArray, JaxArray]]:
        f = apply(counts)
        return f, (counts, f)

    def gradient(seen: tuple[JaxArray, JaxArray], g: JaxArray) -> tuple[JaxArray]:
        return (_called(estimate.gradient, A.range_shape, np.float32, *seen, g),)

    apply = jax.custom_vjp(volume)
    apply.defvjp(forward, gradient)
    return lambda counts: apply(_single("counts", counts, A.range_shape))


def push_force(tissue: Tissue, points: ArrayLike, radii: ArrayLike) -> Callable[[JaxArray, JaxArray], JaxArray]:
    """Return (displacements, young) -> the force on the tools, for JAX arrays, by linear finite elements.

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
        numbers, to forces of the tissue on the tools, N, shaped as `points`. All are float64. It can be differentiated
        once by both.

    Raises
    ------
    DataError
        If JAX is set to 32 bits, or as `PushResponse` does.
    MaterialError
        As `PushResponse` does.

    Examples
    --------
    >>> import jax
    >>> with jax.enable_x64(True):
    ...     force = push_force(tissue, top, radii=10)
    ...     by_young = jax.grad(lambda E: force(np.array([0, 0, -2.0]), E)[2])(np.array([5.0, 50.0]))
    >>> bool((np.asarray(by_young) > 0).all())
    True
    """
    response = PushResponse(tissue, points, radii)
    contacts, regions = response.points.shape, response.regions.shape

    def force(d: JaxArray, young: JaxArray) -> JaxArray:
        return _called(response.force, contacts, np.float64, d, young)

    def gradient(seen: tuple[JaxArray, JaxArray], g: JaxArray) -> JaxArray:
        shapes = tuple(jax.ShapeDtypeStruct(shape, np.float64) for shape in (contacts, regions))
        return jax.pure_callback(_on_cpu(response.gradient), shapes, *seen, g, vmap_method="sequential")

    apply = jax.custom_vjp(force)
    apply.defvjp(lambda d, young: (apply(d, young), (d, young)), gradient)
    return lambda d, young: apply(_double("displacements", d, contacts), _double("young", young, regions))


def _called(function: Callable[..., Any], shape: tuple[int, ...], dtype: Any, *arrays: JaxArray) -> JaxArray:
    """function(*arrays), outside what JAX compiles."""
    return jax.pure_callback(_on_cpu(function), jax.ShapeDtypeStruct(shape, dtype), *arrays, vmap_method="sequential")


def _on_cpu(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function on NumPy arrays, wherever JAX keeps its own."""
    return lambda *arrays: function(*(np.asarray(array) for array in arrays))


def _single(name: str, x: JaxArray, shape: tuple[int, ...]) -> JaxArray:
    return _shaped(name, jax.numpy.asarray(x, np.float32), shape)


def _double(name: str, x: JaxArray, shape: tuple[int, ...]) -> JaxArray:
    if not jax.config.jax_enable_x64:
        raise DataError(
            f"{name}: forces need float64, and JAX is set to 32 bits; call jax.config.update('jax_enable_x64', True) first"
        )
    return _shaped(name, jax.numpy.asarray(x, np.float64), shape)


def _shaped(name: str, x: JaxArray, shape: tuple[int, ...]) -> JaxArray:
    if x.shape != shape:
        raise DataError(f"{name}: expected shape {shape}, got {x.shape}")
    return x
