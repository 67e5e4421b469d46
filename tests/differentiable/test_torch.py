"""Operations for PyTorch, outside the gate (make test-torch): gradients against the transpose and against differences."""

import numpy as np
import pytest
from support.scan_and_organ import GRID, VIEWS, lumpy, poisson_scan, projector

import palpate as pp
from palpate.arrays import float32
from palpate.differentiable.map_estimate import MapEstimate
from palpate.errors import DataError

torch = pytest.importorskip("torch", reason="PyTorch is not installed here: make test-torch")
operations = pytest.importorskip("palpate.differentiable.torch")

RNG = np.random.default_rng(5)
X = 0.02 * RNG.random(GRID.shape, np.float32)
DIRECTION = 0.01 * RNG.standard_normal(GRID.shape, np.float32)
Y = RNG.standard_normal(VIEWS.shape, np.float32)
POINT, YOUNG = np.array([20.0, 25, 50]), np.array([5.0, 40.0])


def tensor(array, requires_grad=True):
    return torch.from_dlpack(np.array(array)).requires_grad_(requires_grad)


def array(tensor):
    return np.from_dlpack(tensor.detach())


def poisson_value(scan, x):
    """Minus log-likelihood in float64, from its definition, without the part that does not depend on x."""
    l = np.asarray(projector()(x), np.float64)
    mean = np.where(scan.mask, scan.incident * np.exp(-l) + scan.background, 1)
    return float(np.where(scan.mask, mean - scan.counts * np.log(mean), 0).sum())


def test_memory_is_shared():
    x = tensor(X, False)
    assert float32("x", x).__array_interface__["data"][0] == x.data_ptr()


def test_projection_and_gradient_are_adjoint():
    A, x = projector(), tensor(X)
    p = operations.projection(A)(x)
    np.testing.assert_array_equal(array(p), A(X))
    assert np.abs(A(X)).max() > 0
    (back,) = torch.autograd.grad(p, x, tensor(Y, False))
    inner, outer = np.vdot(np.float64(array(p)), Y), np.vdot(np.float64(X), array(back))
    assert abs(inner - outer) <= 1e-6 * np.linalg.norm(array(p)) * np.linalg.norm(Y)
    assert np.linalg.norm(array(back)) > 0


def test_second_derivative_of_half_the_squares_is_the_normal_map():
    A, x = projector(), tensor(X)
    loss = (operations.projection(A)(x) ** 2).sum() / 2
    (gradient,) = torch.autograd.grad(loss, x, create_graph=True)
    (gradient * tensor(DIRECTION, False)).sum().backward()
    np.testing.assert_allclose(array(x.grad), A.T(A(DIRECTION)), rtol=1e-5, atol=1e-6)


def test_likelihood_gradient_by_the_volume_against_differences():
    scan, x = poisson_scan(), tensor(X)
    operations.likelihood_value(pp.Transmission.of(scan))(operations.projection(projector())(x)).backward()
    step = 0.02
    difference = poisson_value(scan, X + step * DIRECTION) - poisson_value(scan, X - step * DIRECTION)
    assert np.vdot(array(x.grad), DIRECTION) == pytest.approx(difference / (2 * step), rel=1e-3)


def test_chain_rule_scales_the_slope():
    likelihood, l = pp.Transmission.of(poisson_scan()), tensor(projector()(X))
    (-3 * operations.likelihood_value(likelihood)(l)).backward()
    np.testing.assert_allclose(array(l.grad), -3 * likelihood.slope(projector()(X)), rtol=1e-6)


def test_map_estimate_and_its_gradient():
    scan, v = poisson_scan(), np.ones(GRID.shape, np.float32)
    counts, exact = tensor(scan.counts), MapEstimate(projector(), scan, 1.0)
    f = operations.map_estimate(projector(), scan, 1.0)(counts)
    np.testing.assert_array_equal(array(f), exact.volume(scan.counts))
    f.sum().backward()
    np.testing.assert_array_equal(array(counts.grad), exact.gradient(scan.counts, array(f), v))


def test_force_and_its_derivatives():
    d, young = tensor([0.3, -0.2, -2.0]), tensor(YOUNG)
    force = operations.push_force(lumpy(), POINT, 9)
    assert torch.autograd.gradcheck(force, (d, young), eps=1e-3, atol=1e-8, rtol=1e-5)
    expected = pp.finite_elements(lumpy()).push(POINT, array(d), 9).force
    np.testing.assert_allclose(array(force(d, young)), expected, rtol=1e-12)


def test_second_derivatives_of_forces_and_likelihoods_are_refused():
    d, young, l = tensor([0.3, -0.2, -2.0]), tensor(YOUNG), tensor(projector()(X))
    force = operations.push_force(lumpy(), POINT, 9)(d, young)
    value = operations.likelihood_value(pp.Transmission.of(poisson_scan()))(l)
    for once, by in ((force.sum(), young), (force.sum(), d), (value, l)):
        (gradient,) = torch.autograd.grad(once, by, create_graph=True)
        with pytest.raises(DataError, match="second derivative: only projections can be differentiated more than once"):
            gradient.sum().backward()


def test_a_wrong_shape_and_a_gradient_outside_are_refused():
    with pytest.raises(DataError, match=r"volume: expected shape \(4, 10, 12\), got \(4, 10, 11\)"):
        operations.projection(projector())(tensor(X[:, :, 1:]))
    with pytest.raises(DataError, match=r"volume: Tensor does not export its memory.*detach"):
        projector()(tensor(X))
