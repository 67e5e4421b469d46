"""Operations for JAX: gradients against the transpose and against differences, under jit, vmap and second derivatives."""

import numpy as np
import pytest
from support.jax_here import required_jax
from support.scan_and_organ import GRID, VIEWS, lumpy, poisson_scan, projector

import palpate as pp
from palpate.differentiable.map_estimate import MapEstimate
from palpate.errors import DataError

jax = required_jax()
jnp = jax.numpy
operations = pytest.importorskip("palpate.differentiable.jax")

RNG = np.random.default_rng(5)
X = 0.02 * RNG.random(GRID.shape, np.float32)
DIRECTION = 0.01 * RNG.standard_normal(GRID.shape, np.float32)
Y = RNG.standard_normal(VIEWS.shape, np.float32)
POINT, YOUNG = np.array([20.0, 25, 50]), np.array([5.0, 40.0])


@pytest.fixture(scope="module")
def project():
    return operations.projection(projector())


def poisson_value(scan, x):
    """Minus log-likelihood in float64, from its definition, without the part that does not depend on x."""
    l = np.asarray(projector()(x), np.float64)
    mean = np.where(scan.mask, scan.incident * np.exp(-l) + scan.background, 1)
    return float(np.where(scan.mask, mean - scan.counts * np.log(mean), 0).sum())


def test_projection_is_the_projectors(project):
    A = projector()
    assert np.abs(A(X)).max() > 0
    np.testing.assert_array_equal(project(X), A(X))
    np.testing.assert_array_equal(jax.jit(project)(X), A(X))
    np.testing.assert_array_equal(operations.projection(A.T)(Y), A.T(Y))


@pytest.mark.parametrize("compiled", [False, True])
def test_projection_and_gradient_are_adjoint(project, compiled):
    forward = jax.jit(project) if compiled else project
    p, pull = jax.vjp(forward, X)
    (back,) = pull(Y)
    inner, outer = np.vdot(np.float64(p), Y), np.vdot(np.float64(X), back)
    assert abs(inner - outer) <= 1e-6 * np.linalg.norm(p) * np.linalg.norm(Y)
    assert np.linalg.norm(back) > 0


def test_second_derivative_of_half_the_squares_is_the_normal_map(project):
    A = projector()

    def gradient_along(x):
        return jnp.vdot(jax.grad(lambda z: (project(z) ** 2).sum() / 2)(x), DIRECTION)

    np.testing.assert_allclose(jax.grad(gradient_along)(X), A.T(A(DIRECTION)), rtol=1e-5, atol=1e-6)


def test_vmap_applies_it_to_each(project):
    many = np.stack([X, DIRECTION])
    np.testing.assert_array_equal(jax.vmap(project)(many), np.stack([projector()(X), projector()(DIRECTION)]))
    gradients = jax.vmap(jax.grad(lambda z: (project(z) * Y).sum()))(many)
    np.testing.assert_array_equal(gradients, np.stack([projector().T(Y)] * 2))


@pytest.mark.parametrize("compiled", [False, True])
def test_likelihood_gradient_by_the_volume_against_differences(project, compiled):
    scan = poisson_scan()
    value = operations.likelihood_value(pp.Transmission.of(scan))

    def loss(x):
        return value(project(x))

    gradient = (jax.jit if compiled else lambda f: f)(jax.grad(loss))(X)
    step = 0.02
    difference = poisson_value(scan, X + step * DIRECTION) - poisson_value(scan, X - step * DIRECTION)
    assert float(jnp.vdot(gradient, DIRECTION)) == pytest.approx(difference / (2 * step), rel=1e-3)
    assert float(loss(X)) == pytest.approx(pp.Transmission.of(scan).value(projector()(X)), rel=1e-6)


def test_chain_rule_scales_the_slope():
    value = operations.likelihood_value(pp.Transmission.of(poisson_scan()))
    l = projector()(X)
    np.testing.assert_allclose(jax.grad(lambda z: -3 * value(z))(l), -3 * jax.grad(value)(l), rtol=1e-6)


def test_gradient_descent_in_jax_lowers_the_likelihood(project):
    """A loop that is compiled as a whole."""
    value = operations.likelihood_value(pp.Transmission.of(poisson_scan()))
    loss = jax.jit(jax.value_and_grad(lambda x: value(project(x))))
    x, values = jnp.zeros(GRID.shape), []
    for _ in range(10):
        now, gradient = loss(x)
        values.append(float(now))
        x = jnp.maximum(x - 2e-8 * gradient, 0)
    assert (np.diff(values) < 0).all()


def test_map_estimate_and_its_gradient():
    scan, v = poisson_scan(), np.ones(GRID.shape, np.float32)
    exact = MapEstimate(projector(), scan, 1.0)
    f, pull = jax.vjp(jax.jit(operations.map_estimate(projector(), scan, 1.0)), scan.counts)
    np.testing.assert_array_equal(f, exact.volume(scan.counts))
    np.testing.assert_array_equal(pull(v)[0], exact.gradient(scan.counts, f, v))


def test_force_and_its_derivatives_against_differences():
    with jax.enable_x64(True):
        force = operations.push_force(lumpy(), POINT, 9)
        weights = jnp.array([0.2, -1.0, 0.7])

        def weighted(depth, young):
            return weights @ force(depth * jnp.array([0.1, 0, -1]), young)

        by_depth, by_young = jax.jit(jax.grad(weighted, argnums=(0, 1)))(jnp.float64(2.0), jnp.array(YOUNG))

        def exact(depth, young):
            tissue = lumpy().replace(young={3: young[0], 7: young[1]})
            push = depth * np.array([0.1, 0, -1])
            return float(np.asarray(weights) @ pp.finite_elements(tissue).push(POINT, push, 9).force)

        assert by_depth.dtype == by_young.dtype == np.float64
        assert float(by_depth) == pytest.approx(exact(2.5, YOUNG) - exact(1.5, YOUNG), rel=1e-8)
        for r, h in enumerate(1e-4 * YOUNG):
            step = h * (np.arange(2) == r)
            difference = exact(2.0, YOUNG + step) - exact(2.0, YOUNG - step)
            assert float(by_young[r]) == pytest.approx(difference / (2 * h), rel=1e-6)


def test_second_derivatives_of_a_likelihood_are_refused():
    value = operations.likelihood_value(pp.Transmission.of(poisson_scan()))
    with pytest.raises(ValueError, match="callbacks do not support"):
        jax.grad(lambda l: jax.grad(value)(l).sum())(projector()(X))


def test_forces_in_32_bits_are_refused():
    force = operations.push_force(lumpy(), POINT, 9)
    with pytest.raises(DataError, match=r"displacements: forces need float64.*jax_enable_x64"):
        force(np.array([0, 0, -2.0]), YOUNG)


def test_wrong_shapes_are_refused(project):
    with pytest.raises(DataError, match=r"x: expected shape \(4, 10, 12\), got \(4, 10, 11\)"):
        project(X[:, :, 1:])
    value = operations.likelihood_value(pp.Transmission.of(poisson_scan()))
    with pytest.raises(DataError, match=r"l: expected shape \(3, 12, 16\), got \(2, 12, 16\)"):
        jax.jit(value)(Y[1:])
