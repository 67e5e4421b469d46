"""The derivative of a reconstruction by its counts: against differences of Newton's method on dense matrices in float64."""

import functools

import numpy as np
import pytest
from support.scan_and_organ import GRID, VIEWS, poisson_scan, projector

import palpate as pp
from palpate.differentiable.map_estimate import MapEstimate
from palpate.errors import DataError

STRENGTH = 0.02
RNG = np.random.default_rng(8)
WEIGHTS = RNG.standard_normal(GRID.shape).astype(np.float32)


@functools.cache
def matrices():
    """A and the Hessian K of R, column by column."""
    units = np.eye(GRID.size, dtype=np.float32).reshape(-1, *GRID.shape)
    prior = pp.Prior("quadratic", strength=STRENGTH)
    A = np.stack([projector()(e).ravel() for e in units], axis=1)
    K = np.stack([prior.surrogate(e, GRID)[0].ravel() for e in units], axis=1)
    return A.astype(np.float64), K.astype(np.float64)


def newton(scan, counts, beta):
    """The minimum over f >= 0 by a projected Newton method (Bertsekas, SIAM J. Control Optim. 20:221, 1982)."""
    A, K = matrices()
    y, used = np.float64(counts).ravel(), scan.mask.ravel()
    b, r = (np.where(used, np.float64(a).ravel(), 0) for a in (scan.incident, scan.background))
    f = np.full(GRID.size, 0.01)

    def parts(f):
        primary = b * np.exp(-(A @ f))
        return primary, np.where(used, primary + r, 1)

    def objective(f):
        mean = parts(f)[1]
        return np.where(used, mean - y * np.log(mean), 0).sum() + beta / 2 * f @ K @ f

    for _ in range(60):
        primary, mean = parts(f)
        gradient = A.T @ (primary * (y / mean - 1)) + beta * K @ f
        free = (f > 0) | (gradient < 0)
        bend = np.maximum(primary * (1 - y * r / mean**2), 0)
        H = (A[:, free].T * bend) @ A[:, free] + beta * K[np.ix_(free, free)]
        step = np.zeros_like(f)
        step[free] = np.linalg.solve(H, gradient[free])
        t = 1.0
        while objective(np.maximum(f - t * step, 0)) > objective(f) and t > 1e-6:
            t /= 2
        f, before = np.maximum(f - t * step, 0), f
        if np.abs(f - before).max() < 1e-13:
            break
    return f.reshape(GRID.shape)


@pytest.fixture(scope="module")
def scan():
    return poisson_scan()


@pytest.fixture(scope="module")
def estimate(scan):
    return MapEstimate(projector(), scan, STRENGTH)


@pytest.fixture(scope="module")
def volume(scan, estimate):
    return estimate.volume(scan.counts)


def test_the_estimate_is_newtons(scan, estimate, volume):
    exact = newton(scan, scan.counts, estimate.beta)
    assert 0.02 < (exact == 0).mean() < 0.8, "some voxels must be held at 0, for the derivative to leave them out"
    assert np.abs(volume - exact).max() < 2e-3 * exact.max()


def test_derivative_by_counts_against_differences_of_newton(scan, estimate, volume):
    gradient = estimate.gradient(scan.counts, volume, WEIGHTS)
    direction = RNG.standard_normal(VIEWS.shape) * scan.mask
    h = 1e-3
    apart = newton(scan, scan.counts + h * direction, estimate.beta) - newton(
        scan, scan.counts - h * direction, estimate.beta
    )
    expected = (WEIGHTS * apart).sum() / (2 * h)
    scale = np.linalg.norm(gradient) * np.linalg.norm(direction)
    assert abs(np.vdot(gradient, direction) - expected) < 1e-4 * scale
    assert (gradient[~scan.mask] == 0).all()


def test_each_component_of_the_derivative(scan, estimate, volume):
    gradient = estimate.gradient(scan.counts, volume, WEIGHTS)
    for view, row, column in np.argwhere(scan.mask)[:: scan.mask.sum() // 6]:
        h = np.zeros(VIEWS.shape)
        h[view, row, column] = 0.01
        apart = newton(scan, scan.counts + h, estimate.beta) - newton(scan, scan.counts - h, estimate.beta)
        expected = (WEIGHTS * apart).sum() / 0.02
        assert gradient[view, row, column] == pytest.approx(
            expected, rel=0.01, abs=1e-3 * float(np.abs(gradient).max())
        )


def test_what_cannot_be_is_refused(scan, estimate):
    with pytest.raises(DataError, match=r"strength: 0; give a number above 0"):
        MapEstimate(projector(), scan, 0)
    with pytest.raises(DataError, match=r"scan: shape \(2, 12, 16\), but the projector gives \(3, 12, 16\)"):
        MapEstimate(projector(), scan[:2], 1.0)
    with pytest.raises(DataError, match=r"counts: .* measured pixels are negative"):
        estimate.volume(np.array(scan.counts) - 1000)


def test_where_nothing_was_absorbed_the_estimate_is_air(scan, estimate):
    """Counts above what air lets through: by noise, or by a dose that was higher than told."""
    air = np.where(scan.mask, 1.05 * scan.incident + scan.background, scan.counts)
    np.testing.assert_array_equal(estimate.volume(air), 0)
