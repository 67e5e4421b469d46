"""Total variation against an independent dense solution and against what is known of it in closed form."""

from itertools import islice

import numpy as np
import pytest
from scipy.optimize import minimize

import palpate as pp
from palpate.errors import DataError, GeometryError
from palpate.reconstruction.baselines.total_variation import (
    _gradient,
    _scale,
    _transposed,
    denoise,
    total_variation,
    tv,
)
from palpate.reconstruction.models.likelihood import Transmission, WeightedLeastSquares
from palpate.scans.analytic_phantoms import Ellipsoid, Phantom

BODY = Phantom([(Ellipsoid((0, 0, 24), (17, 13, 8)), 0.02), (Ellipsoid((5, 2, 24), 4), 0.02)])


def views(n=5, spacing=2):
    shape = (44 // spacing, 60 // spacing)
    panel = pp.Panel(shape, (spacing, spacing), (-(60 - spacing) / 2, -(44 - spacing) / 2, 0))
    return pp.arc_views(panel, np.linspace(-25, 25, n), radius=500, pivot=(0, 0, 24))


SMALL = pp.Grid((3, 5, 6), (6, 5, 5), (-12.5, -10, 18))


def differences(grid):
    """(3, voxels, voxels): forward differences by mm along z, y, x, written out entry by entry."""
    D = np.zeros((3, grid.size, grid.size))
    for j, at in enumerate(np.ndindex(grid.shape)):
        for axis in range(3):
            if at[axis] + 1 < grid.shape[axis]:
                on = list(at)
                on[axis] += 1
                D[axis, j, np.ravel_multi_index(on, grid.shape)] = 1 / grid.spacing[axis]
                D[axis, j, j] = -1 / grid.spacing[axis]
    return D


def dense(A):
    unit = np.eye(A.grid.size, dtype=np.float32)
    return np.stack([A(e.reshape(A.domain_shape)).ravel() for e in unit], axis=1).astype(np.float64)


def test_it_reaches_the_minimiser_of_an_independent_solver():
    """SciPy's, float64, dense: min ½Σw(Mf − p)² + β V Σ √(|D_j f|² + ε²), f >= 0, ε down to 1e-8 1/mm²."""
    scan = pp.simulate_scan(BODY, views(3, 4), incident=300, seed=4)
    A, data = pp.Projector(scan.views, SMALL), WeightedLeastSquares.of(scan)
    strength, M, D = 0.003, dense(A), differences(SMALL)
    w, p = data.weights.ravel().astype(float), data.line_integrals.ravel().astype(float)
    weight = strength * np.median(M.T @ (w * M.sum(axis=1)))

    def objective(f, epsilon):
        gap, slopes = M @ f - p, D @ f
        length = np.sqrt((slopes**2).sum(axis=0) + epsilon**2)
        pull = sum(D[a].T @ (slopes[a] / np.maximum(length, 1e-300)) for a in range(3))
        return w @ gap**2 / 2 + weight * length.sum(), M.T @ (w * gap) + weight * pull

    def scaled(g, epsilon):  # so that all unknowns are of order one
        value, slope = objective(g / 100, epsilon)
        return value, slope / 100

    g, options = np.ones(SMALL.size), {"maxiter": 1500, "maxfun": 2000, "ftol": 1e-15, "gtol": 1e-9, "maxcor": 12}
    for epsilon in 10.0 ** np.arange(-3, -8.5, -1):
        g = minimize(scaled, g, (epsilon,), "L-BFGS-B", jac=True, bounds=[(0, None)] * g.size, options=options).x
    best, f = objective(g / 100, 0)[0], g / 100
    made, told = next(islice(tv(A, data, np.full(SMALL.shape, 0.01, np.float32), strength), 800, None))
    assert told == pytest.approx(objective(made.ravel().astype(float), 0)[0], rel=1e-5)
    assert told == pytest.approx(best, rel=1e-5)
    assert np.abs(made.ravel() - f).max() < 0.01 * f.max()
    assert np.linalg.norm(D @ f) < 0.8 * np.linalg.norm(D @ np.linalg.lstsq(M, p, rcond=None)[0])  # the prior had a say


@pytest.mark.parametrize("kind", [Transmission, WeightedLeastSquares])
@pytest.mark.parametrize("strength", [None, 0.0, 1e-3, 0.1])
def test_the_objective_never_rises(kind, strength):
    scan = pp.simulate_scan(BODY, views(), incident=500, seed=1, background=20)
    A, data = pp.Projector(scan.views, pp.Grid((6, 16, 20), (3, 2, 2), (-19, -15, 16))), kind.of(scan)
    start = np.random.default_rng(0).uniform(0, 0.1, A.domain_shape).astype(np.float32)
    told = [objective for _, objective in islice(tv(A, data, start, strength), 40)]
    assert (np.diff(told) <= 0).all()
    assert told[-1] < 0.9 * told[0]


def test_two_voxels_move_towards_each_other():
    """argmin ½(a − 5)² + ½(b − 1)² + w|a − b|/d is (5 − w/d, 1 + w/d), and their mean once they meet; none below 0."""
    grid = pp.Grid((1, 1, 2), (1, 1, 0.5))
    z, one = np.array([[[5, 1]]], np.float32), np.ones((1, 1, 2), np.float32)
    none = np.zeros((3, *grid.shape), np.float32)
    for weight, expected in ((0.0, [5, 1]), (0.5, [4, 2]), (0.9, [3.2, 2.8]), (3.0, [3, 3])):
        x, q = denoise(z, one, np.float32(weight), none, grid, 200)
        np.testing.assert_allclose(x.ravel(), expected, atol=1e-4)
        assert (np.sqrt((q**2).sum(axis=0)) <= 1 + 1e-6).all()
    x, _ = denoise(z - 4, np.array([[[1, 2]]], np.float32), np.float32(0.1), none, grid, 200)
    np.testing.assert_allclose(x.ravel(), [0.8, 0], atol=1e-4)


def test_differences_and_their_transpose():
    grid, rng = pp.Grid((4, 5, 6), (3, 2, 1)), np.random.default_rng(0)
    x, q = rng.normal(size=grid.shape).astype(np.float32), rng.normal(size=(3, *grid.shape)).astype(np.float32)
    D = differences(grid)
    np.testing.assert_allclose(_gradient(x, grid).reshape(3, -1), D @ x.ravel(), atol=1e-5)
    np.testing.assert_allclose(_transposed(q, grid).ravel(), sum(D[a].T @ q[a].ravel() for a in range(3)), atol=1e-5)
    step = np.zeros(grid.shape, np.float32)
    step[:, :, 3:] = 0.02  # a wall of 12 x 10 mm
    assert total_variation(step, grid) == pytest.approx(0.02 * 120, rel=1e-5)


def test_a_column_loses_what_the_strength_says():
    """2 strength / r of its contrast, seen from far above; forward differences measure a disc's rim to some per cent."""
    radius, strength, contrast = 12, 0.006, 0.01
    grid = pp.Grid((1, 48, 48), (10, 1, 1), (-23.5, -23.5, 15))
    panel = pp.Panel((60, 60), (1, 1), (-29.5, -29.5, 0))
    A = pp.Projector(pp.Views([(0, 0, 9000)], panel), grid)
    y, x = np.meshgrid(grid.axis("y"), grid.axis("x"), indexing="ij")
    inside = (x**2 + y**2 < radius**2)[None]
    truth = (0.02 + contrast * inside).astype(np.float32)
    p = A(truth)
    data = WeightedLeastSquares(p, (p > 0).astype(np.float32))
    f, _ = next(islice(tv(A, data, truth, strength), 300, None))
    core, rim = (x**2 + y**2 < 64)[None], (x**2 + y**2 > 15**2)[None]
    assert (truth - f)[core].mean() == pytest.approx(2 * strength / radius, rel=0.08)
    assert np.abs((truth - f)[rim]).max() < 0.7 * 2 * strength / radius


def test_strength_survives_a_change_of_dose_and_of_grid():
    """β follows the dose, and is the same on a finer grid."""
    one, ten = (pp.simulate_scan(BODY, views(), incident=n, seed=None) for n in (1e4, 1e5))
    coarse, fine = (
        pp.Grid((6, 16, 20), (3, 2, 2), (-19, -15, 16)),
        pp.Grid((12, 32, 40), (1.5, 1, 1), (-19.5, -15.5, 15.25)),
    )

    def beta(scan, grid):
        return _scale(pp.Projector(scan.views, grid), Transmission.of(scan), 0.01)[1]

    assert beta(ten, coarse) == pytest.approx(10 * beta(one, coarse), rel=1e-4)
    assert beta(one, fine) == pytest.approx(beta(one, coarse), rel=0.02)


def test_a_better_picture_than_without_it():
    """Piecewise constant solids, few photons: nearer to the truth than the likelihood alone after as many steps."""
    scan = pp.simulate_scan(BODY, views(7, 1), incident=1000, seed=2)
    grid = pp.Grid((10, 32, 40), (2, 1, 1), (-19.5, -15.5, 15))
    truth = BODY.volume(grid).values
    far = {
        method: np.linalg.norm(pp.reconstruct(scan, grid, method=method, levels=1, iterations=30).values - truth)
        for method in ("tv", "ml", "sart")
    }
    assert far["tv"] < 0.95 * far["ml"]
    assert far["tv"] < 0.95 * far["sart"]


def test_strengths_that_cannot_be_are_refused():
    scan = pp.simulate_scan(BODY, views(), incident=500, seed=1)
    A, data = pp.Projector(scan.views, SMALL), Transmission.of(scan)
    for strength in (-1, float("nan"), float("inf")):
        with pytest.raises(DataError, match="strength: expected 0 or more"):
            next(tv(A, data, np.zeros(SMALL.shape, np.float32), strength))
    corner = np.zeros(scan.shape, np.float32)
    corner[:, 0, 0] = 1
    with pytest.raises(GeometryError, match="no measured ray meets the grid"):
        next(tv(A, WeightedLeastSquares(corner, corner), np.zeros(SMALL.shape, np.float32)))
