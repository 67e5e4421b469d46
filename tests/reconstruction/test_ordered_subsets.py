"""Ordered subsets against one plain step of separable surrogates, coordinate descent, and their own promises."""

from itertools import islice

import numpy as np
import pytest
from reconstruction.test_reconstruct import PRIOR, matrix, objective, small

import palpate as pp
from palpate import _core
from palpate.reconstruction.checkpoint import fingerprint, read_checkpoint, write_checkpoint
from palpate.reconstruction.models.likelihood import Transmission
from palpate.reconstruction.optimizers.coordinate_descent import coordinate_descent
from palpate.reconstruction.optimizers.ordered_subsets import SubsetsState, default_subsets, ordered_subsets

BETA = 20000.0


def run(scan, A, prior, start, pace=None, curvature="precomputed"):
    part = lambda views: Transmission.of(scan[views])  # noqa: E731
    return ordered_subsets(A, Transmission.of(scan), prior, BETA, start, part, pace, curvature)


@pytest.mark.parametrize("count", [1, 2, 7])
@pytest.mark.parametrize("kind", ["optimal", "precomputed"])
def test_the_objective_never_rises_and_is_what_is_told(count, kind):
    """From noise, ten times too bright, where the precomputed curvature overshoots and subsets of one view diverge."""
    scan, A = small()
    start = np.random.default_rng(count).uniform(0, 0.2, A.domain_shape).astype(np.float32)
    values, pace = [objective(A, scan, start, PRIOR, BETA)], SubsetsState(count)
    for f, told in islice(run(scan, A, PRIOR, start, pace, kind), 40):
        assert f.min() >= 0
        values.append(objective(A, scan, f, PRIOR, BETA))
        assert told == pytest.approx(values[-1], rel=1e-5)
    assert values[-1] < 0.2 * values[0]
    assert (np.diff(values) <= 2e-6 * values[-1]).all()  # the volume is stored in float32
    assert pace.subsets <= count


@pytest.mark.parametrize("potential", ["lange", "quadratic"])
def test_same_minimiser_as_descent(potential):
    """Through another algorithm, with voxels at the bound: subsets do not end at a cycle of their own."""
    scan, A = small()
    prior = pp.Prior(potential, edge=0.002)
    start = np.full(A.domain_shape, 0.02, np.float32)
    slow, reached = next(islice(coordinate_descent(A, Transmission.of(scan), prior, BETA, start, "optimal"), 799, None))
    pace = SubsetsState(7)
    fast, told = next(islice(run(scan, A, prior, start, pace), 299, None))
    assert told == pytest.approx(reached, rel=1e-6)
    assert np.abs(fast - slow).max() < 2e-3 * slow.max()
    assert (slow == 0).sum() > 20
    assert (fast[slow == 0] < 1e-4 * slow.max()).all()
    assert pace.subsets < 7


def test_one_subset_without_momentum_is_a_step_of_separable_surrogates():
    """f − slope / (Σ_i a_ij c_i Σ_k a_ik + 2β Σ_s ω ψ'(t)/t), 0 at least, in float64 from the matrix."""
    scan, A = small()
    M, data = matrix(A), Transmission.of(scan)
    y, b, r = (a.ravel().astype(np.float64) for a in (scan.counts, scan.incident, scan.background))
    used = scan.mask.ravel()
    c = np.where(used & (y > r), (y - r) ** 2 / np.maximum(y, 1), 0)
    f = np.random.default_rng(4).uniform(0, 0.04, A.domain_shape).astype(np.float32)
    steps = run(scan, A, PRIOR, f, SubsetsState(1, accelerated=False))
    for made, _ in islice(steps, 5):
        slope, bend = (a.ravel().astype(np.float64) for a in PRIOR.surrogate(f, A.grid))
        primary = b * np.exp(-(M @ f.ravel().astype(np.float64)))
        pull = M.T @ np.where(used, primary * (y / (primary + r) - 1), 0) + BETA * slope
        expected = np.maximum(0, f.ravel() - pull / (M.T @ (c * M.sum(axis=1)) + 2 * BETA * bend))
        assert np.abs(made.ravel() - expected).max() < 1e-5 * expected.max()
        f = made.copy()
    assert data.value(A(f)) < data.value(A(np.full_like(f, 0.02)))


def test_subsets_sooner_come_near():
    """Two passes with subsets and momentum are worth more than two without either."""
    scan, A = small()
    start = np.full(A.domain_shape, 0.02, np.float32)
    ends = {
        pace: next(islice(run(scan, A, PRIOR, start, SubsetsState(*pace)), 1, None))[1]
        for pace in ((1, False), (1, True), (3, False), (3, True))
    }
    assert ends[3, True] < min(ends[1, True], ends[3, False]) <= max(ends[1, True], ends[3, False]) < ends[1, False]


def test_views_that_saw_nothing_are_in_no_subset():
    """More subsets than views are asked for too; each view gives its slope just once."""
    scan, A = small()
    mask = scan.mask.copy()
    mask[[1, 4]] = False
    scan = pp.Scan(scan.counts, scan.incident, scan.views, scan.background, mask)
    start, seen = np.full(A.domain_shape, 0.02, np.float32), []

    def part(views):
        seen.append(views)
        return Transmission.of(scan[views])

    for count, sizes in ((1, [5]), (2, [2, 3]), (9, [1] * 5)):
        seen.clear()
        next(ordered_subsets(A, Transmission.of(scan), PRIOR, BETA, start, part, SubsetsState(count)))
        first = seen[: len(sizes)]
        assert sorted(map(len, first)) == sizes
        assert sorted(k for views in first for k in views) == [0, 2, 3, 5, 6]


def test_a_voxel_that_one_view_alone_sees_does_not_overshoot():
    """Its subset's slope, times the number of subsets, has a curvature so much larger than the mean's."""
    _, A = small()
    lone = np.zeros(A.range_shape, bool)
    lone[0], lone[1:, :11] = True, True
    truth = np.full(A.domain_shape, 0.02, np.float32)
    scan = pp.Scan(1e6 * np.exp(-A(truth)), 1e6, A.views, 0, lone)
    pace = SubsetsState(7, accelerated=False)
    start = 0.5 * truth
    steps = ordered_subsets(A, Transmission.of(scan), PRIOR, 0.0, start, lambda k: Transmission.of(scan[k]), pace)
    for f, _ in islice(steps, 3):
        assert f.max() < 0.03
    assert pace.subsets == 7


def test_it_goes_on_exactly(tmp_path):
    """From checkpoints on two levels, of a run whose subsets are halved on the way."""
    scan, A = small()
    options = {
        "levels": 2,
        "prior": PRIOR,
        "optimizer": "subsets",
        "start": "uniform",
        "iterations": 40,
        "tolerance": 0,
    }
    whole = list(pp.iterates(scan, A.grid, **options))
    assert {step.pace[0] for step in whole if step.pace} == {1, 2}
    for k in (0, 13, 39, 40, 50, 65):
        write_checkpoint(tmp_path / "run.h5", whole[k], fingerprint(scan, {}))
        held = read_checkpoint(tmp_path / "run.h5", fingerprint(scan, {}))
        again = list(pp.iterates(scan, A.grid, resume=held, **options))
        assert [s.objective for s in again] == [s.objective for s in whole[k + 1 :]]
        assert (again[-1].volume.values == whole[-1].volume.values).all()


def test_threads_do_not_change_a_bit():
    scan, A = small()
    start = np.full(A.domain_shape, 0.02, np.float32)
    ends = []
    for n in (1, 2, 3):
        _core.base.set_threads(n)
        ends.append(next(islice(run(scan, A, PRIOR, start, SubsetsState(3)), 5, None))[0].copy())
    _core.base.set_threads(0)
    assert (ends[0] == ends[1]).all()
    assert (ends[0] == ends[2]).all()


def test_three_views_a_subset():
    assert [default_subsets(n) for n in (1, 4, 8, 15, 25)] == [1, 1, 2, 5, 8]
