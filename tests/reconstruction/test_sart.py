"""SART and SIRT on problems whose answer is known."""

from itertools import islice

import numpy as np
import pytest

import palpate as pp
from palpate.errors import DataError, GeometryError
from palpate.reconstruction.baselines.sart import sart, spread_order
from palpate.reconstruction.models.likelihood import WeightedLeastSquares

PANEL = pp.Panel((30, 34), (2, 2), (-33, -29, 0))


def problem(views):
    """More equations than unknowns, and no two voxels alike: one solution."""
    A = pp.Projector(views, pp.Grid((2, 6, 8), (8, 4, 4), (-14, -10, 20)))
    truth = np.random.default_rng(1).uniform(0.01, 0.03, A.domain_shape).astype(np.float32)
    p = A(truth)
    return A, truth, WeightedLeastSquares(p, np.ones(p.shape, np.float32))


def wide():
    return pp.arc_views(PANEL, np.linspace(-40, 40, 9), radius=300, pivot=(0, 0, 24))


@pytest.mark.parametrize(("solve", "passes"), [(pp.sirt, 3000), (pp.sart, 400)])
def test_a_consistent_system_is_solved(solve, passes):
    A, truth, data = problem(wide())
    f, objective = next(islice(solve(A, data, np.full(A.domain_shape, 0.02, np.float32)), passes - 1, None))
    assert np.abs(f - truth).max() < 0.01 * truth.max()
    assert objective < 1e-6


@pytest.mark.parametrize("solve", [pp.sirt, pp.sart])
def test_the_solution_is_a_fixed_point(solve):
    A, truth, data = problem(wide())
    for f, _ in islice(solve(A, data, truth), 5):
        assert np.abs(f - truth).max() < 1e-5 * truth.max()


def test_every_pass_comes_nearer_to_the_solution():
    """For 0 < λ < 2 each update is a contraction in the norm that the columns weigh; the voxels weigh much alike here."""
    A, truth, data = problem(wide())
    for relaxation in (0.3, 1.0, 1.5):
        start = np.full(A.domain_shape, 0.02, np.float32)
        far = [np.linalg.norm(f - truth) for f, _ in islice(sart(A, data, start, relaxation), 12)]
        assert far[0] < np.linalg.norm(start - truth)
        assert (np.diff(far) < 0).all()


def test_a_pass_is_what_its_definition_says():
    """One pass, voxel by voxel in float64 with a dense matrix, in the same order of views."""
    A, _, data = problem(wide())
    dense = np.stack([A(e.reshape(A.domain_shape)).ravel() for e in np.eye(A.grid.size, dtype=np.float32)], axis=1)
    dense = dense.reshape(len(A.views), -1, A.grid.size).astype(np.float64)
    f = np.full(A.grid.size, 0.02)
    for k in spread_order(A.views.source):
        rows, columns = dense[k].sum(axis=1), (dense[k][dense[k].sum(axis=1) > 0] > 0).any(axis=0)
        weight = dense[k][rows > 0].sum(axis=0)
        gap = (data.line_integrals[k].ravel() - dense[k] @ f)[rows > 0] / rows[rows > 0]
        f[columns] += 0.7 * (dense[k][rows > 0].T @ gap)[columns] / weight[columns]
        f = np.maximum(f, 0)
    made, _ = next(sart(A, data, np.full(A.domain_shape, 0.02, np.float32), 0.7))
    assert np.abs(made.ravel() - f).max() < 1e-5 * f.max()


def test_voxels_stay_above_zero_and_unmeasured_pixels_have_no_say():
    A, truth, _ = problem(wide())
    noise = np.random.default_rng(0).normal(0, 0.5, A.range_shape)
    weights = np.ones(A.range_shape, np.float32)
    weights[:, ::3] = 0
    p = (A(truth) + noise) * weights
    f, objective = next(islice(sart(A, WeightedLeastSquares(p, weights), truth), 3, None))
    assert f.min() == 0
    lies = np.where(weights > 0, p, 1e3).astype(np.float32)
    g, same = next(islice(sart(A, WeightedLeastSquares(lies, weights), truth), 3, None))
    assert (f == g).all()
    assert objective == same


def test_the_order_takes_every_view_once_and_leaps():
    source = pp.arc_views(PANEL, np.linspace(-25, 25, 15), radius=600).source
    order = spread_order(source)
    assert sorted(order) == list(range(15))
    assert np.abs(np.diff(order)).mean() > 4  # in order of the arc it would be 1, at random (15 + 1)/3


def test_relaxations_that_diverge_are_refused():
    A, truth, data = problem(wide())
    for relaxation in (0, 2, -1, float("nan")):
        with pytest.raises(DataError, match="relaxation: expected a number above 0 and below 2"):
            next(sart(A, data, truth, relaxation))
    corner = np.zeros(A.range_shape, np.float32)
    corner[:, 0, 0] = 1
    with pytest.raises(GeometryError, match="no measured ray meets the grid"):
        next(sart(A, WeightedLeastSquares(corner, corner), truth))
