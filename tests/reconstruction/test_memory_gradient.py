"""The memory gradient against textbook conjugate gradients, coordinate descent, and its own promises."""

import tracemalloc
from itertools import islice

import numpy as np
import pytest
from reconstruction.test_reconstruct import PRIOR, matrix, objective, small

import palpate as pp
from palpate import _core
from palpate.errors import DataError, FileError
from palpate.reconstruction.checkpoint import fingerprint, read_checkpoint, write_checkpoint
from palpate.reconstruction.models.likelihood import Transmission, WeightedLeastSquares
from palpate.reconstruction.multiresolution import coarser_grid, pyramid
from palpate.reconstruction.optimizers.coordinate_descent import coordinate_descent, data_curvature
from palpate.reconstruction.optimizers.memory_gradient import majoriser, memory_gradient, plane_minimum
from palpate.reconstruction.prior_parameters import median_curvature

BETA = 20000.0


@pytest.mark.parametrize("kind", ["optimal", "maximum", "precomputed"])
@pytest.mark.parametrize("seed", [0, 1])
def test_the_objective_never_rises_and_is_what_is_told(kind, seed):
    """From noise, ten times too bright, where the precomputed curvature overshoots."""
    scan, A = small()
    start = np.random.default_rng(seed).uniform(0, 0.2, A.domain_shape).astype(np.float32)
    values = [objective(A, scan, start, PRIOR, BETA)]
    for f, told in islice(memory_gradient(A, Transmission.of(scan), PRIOR, BETA, start, kind), 40):
        assert f.min() >= 0
        values.append(objective(A, scan, f, PRIOR, BETA))
        assert told == pytest.approx(values[-1], rel=1e-5)
    assert values[-1] < 0.2 * values[0]
    assert (np.diff(values) <= 2e-6 * values[-1]).all()  # the volume is stored in float32


@pytest.mark.parametrize("potential", ["lange", "quadratic"])
def test_same_minimiser_as_descent(potential):
    """Through another algorithm, with voxels at the bound; in a fifth of the iterations."""
    scan, A = small()
    prior, data = pp.Prior(potential, edge=0.002), Transmission.of(scan)
    start = np.full(A.domain_shape, 0.02, np.float32)
    slow, reached = next(islice(coordinate_descent(A, data, prior, BETA, start, "optimal"), 799, None))
    slow = slow.copy()
    fast, told = next(islice(memory_gradient(A, data, prior, BETA, start), 149, None))
    assert told == pytest.approx(reached, rel=1e-6)
    assert np.abs(fast - slow).max() < 2e-3 * slow.max()
    assert (slow == 0).sum() > 20
    assert (fast[slow == 0] < 1e-4 * slow.max()).all()


def conjugate_gradients(H, b, x, diagonal):
    """Textbook preconditioned conjugate gradients on xᵀHx/2 − bᵀx, float64."""
    r = b - H @ x
    p = z = r / diagonal
    while True:
        step = (r @ z) / (p @ H @ p)
        x = x + step * p
        yield x
        following = r - step * (H @ p)
        z_next = following / diagonal
        p = z_next + (following @ z_next) / (r @ z) * p
        r, z = following, z_next


def laplacian(A):
    """Σ ω (f_j − f_s)² / 2 as a matrix, from the definition."""
    shape, spacing = A.domain_shape, np.array(A.grid.spacing)
    L, at = np.zeros((A.grid.size, A.grid.size)), list(np.ndindex(*shape))
    for i, here in enumerate(at):
        for step in np.ndindex(3, 3, 3):
            there = np.array(here) + step - 1
            if tuple(step) == (1, 1, 1) or (there < 0).any() or (there >= shape).any():
                continue
            j = np.ravel_multi_index(tuple(there), shape)
            weight = spacing.prod() / (np.linalg.norm((np.array(step) - 1) * spacing) * spacing.min())
            L[i, i] += weight
            L[i, j] -= weight
    return L


def test_on_a_quadratic_away_from_the_bound_it_is_conjugate_gradients():
    _, A = small()
    M = matrix(A)
    rng = np.random.default_rng(3)
    truth = rng.uniform(0.3, 0.6, A.grid.size)
    p, w = (M @ truth).reshape(A.range_shape), rng.uniform(50, 150, A.range_shape)
    beta = 3000.0
    H = M.T @ (w.ravel()[:, None] * M)
    diagonal = H.sum(axis=1)
    assert np.linalg.eigvalsh(np.diag(diagonal) - H).min() > -1e-6 * diagonal.max()
    np.testing.assert_allclose(majoriser(A, w.astype(np.float32))[0].ravel(), diagonal, rtol=1e-4)
    L = laplacian(A)
    H += beta * L
    diagonal = diagonal + 2 * beta * np.diag(L)
    start = np.full(A.domain_shape, 0.45, np.float32)
    ours = memory_gradient(A, WeightedLeastSquares(p, w), pp.Prior("quadratic"), beta, start)
    theirs = conjugate_gradients(H, M.T @ (w * p).ravel(), start.ravel().astype(float), diagonal)
    for _, (f, _), x in zip(range(8), ours, theirs, strict=False):
        assert f.min() > 0.01, "the bound must play no part here"
        assert np.abs(f.ravel() - x).max() < 0.01 * np.abs(x - start.ravel()).max()


def test_sums_over_pairs_and_pixels_are_those_of_the_definition():
    rng = np.random.default_rng(5)
    shape, spacing = (3, 5, 21), (2.0, 1.0, 0.5)
    f, before, u = (rng.normal(0, 0.01, shape).astype(np.float32) for _ in range(3))
    for prior in (pp.Prior("lange", edge=0.004), pp.Prior("huber", edge=0.004), pp.Prior("quadratic")):
        expected = np.zeros(3)
        for step in np.ndindex(3, 3, 3):
            d = np.array(step) - 1
            if tuple(d) <= (0, 0, 0):
                continue
            here = tuple(slice(max(0, -s), n - max(0, s)) for s, n in zip(d, shape, strict=True))
            there = tuple(slice(max(0, s), n - max(0, -s)) for s, n in zip(d, shape, strict=True))
            t, du, dp = ((a[here] - a[there]).astype(np.float64) for a in (f, u, f - before))
            size = np.abs(t)
            bend = {"lange": 0.004 / (0.004 + size), "huber": np.minimum(1, 0.004 / size)}.get(prior.potential, 1.0)
            weight = np.prod(spacing) / (np.linalg.norm(d * spacing) * 0.5)
            expected += [weight * (bend * a).sum() for a in (du * du, du * dp, dp * dp)]
        made = _core.subspace.prior_curvatures(f, before, u, spacing, *prior.law)
        np.testing.assert_allclose(made, expected, rtol=1e-5, atol=1e-6 * expected[0])
    c, l, old, q = (rng.uniform(0, 1, (2, 90, 95)).astype(np.float32) for _ in range(4))
    s = (l - old).astype(np.float64)
    np.testing.assert_allclose(
        _core.subspace.data_curvatures(c, l, old, q),
        [(c * q * q).sum(), (c * q * s).sum(), (c * s * s).sum()],
        rtol=1e-5,
        atol=1e-2,
    )


def pairs(shape, spacing):
    """Each of the 26 steps with its weight and the slices of voxel and neighbour."""
    for step in np.ndindex(3, 3, 3):
        d = np.array(step) - 1
        if not d.any():
            continue
        here = tuple(slice(max(0, -s), n - max(0, s)) for s, n in zip(d, shape, strict=True))
        there = tuple(slice(max(0, s), n - max(0, -s)) for s, n in zip(d, shape, strict=True))
        yield np.prod(spacing) / (np.linalg.norm(d * spacing) * min(spacing)), here, there


@pytest.mark.parametrize("shape", [(3, 5, 21), (1, 4, 9), (2, 1, 1), (2, 34, 35)])
@pytest.mark.parametrize("potential", ["lange", "huber", "quadratic", "generalized"])
def test_the_direction_is_that_of_the_definition(shape, potential):
    """u = −g / (d + 2β bend), held at 0 where it would sink; the majoriser's map of cells of 8 linear between middles."""
    rng, spacing, edge, beta = np.random.default_rng(6), (2.0, 1.0, 0.5), 0.004, 30.0
    f, before, gradient = (rng.normal(0, 0.01, shape).astype(np.float32) for _ in range(3))
    f = np.maximum(f, 0)
    prior = pp.Prior(potential, edge=None if potential == "quadratic" else edge)
    slope, bend = np.zeros(shape), np.zeros(shape)
    for weight, here, there in pairs(shape, spacing):
        t = f[here].astype(np.float64) - f[there]
        s = np.abs(t) / edge + 1e-30
        u = s ** (2 - prior.exponent)
        k = {
            "lange": 1 / (1 + s),
            "huber": np.minimum(1, 1 / s),
            "generalized": (1 + prior.exponent / 2 * u) / (1 + u) ** 2,
        }.get(potential, np.ones_like(s))
        slope[here] += weight * k * t
        bend[here] += weight * k
    for step in (1, 8):
        cells = rng.uniform(1, 2, (shape[0], -(-shape[1] // step), -(-shape[2] // step))).astype(np.float32)
        data = cells.astype(np.float64)
        if step > 1:
            for axis in (1, 2):
                at = np.clip((np.arange(shape[axis]) + 0.5) / step - 0.5, 0, cells.shape[axis] - 1)
                low = at.astype(int)
                high, share = np.minimum(low + 1, cells.shape[axis] - 1), (at - low).reshape(-1, *[1] * (2 - axis))
                data = data.take(low, axis) * (1 - share) + data.take(high, axis) * share
        g = gradient + beta * slope
        expected = np.where((f <= 0) & (g > 0), 0, -g / (data + 2 * beta * bend))
        u = gradient.copy()
        slopes = _core.subspace.search_direction(f, before, u, cells, step, beta, spacing, *prior.law)
        np.testing.assert_allclose(u, expected, rtol=2e-5, atol=1e-6 * np.abs(expected).max())
        size = np.abs(g * expected).sum()
        assert slopes[0] == pytest.approx((g * expected).sum(), abs=1e-5 * size)
        assert slopes[1] == pytest.approx((g * (f - before)).sum(), abs=1e-5 * np.abs(g * (f - before)).sum())


def test_the_coarse_majoriser_is_the_mean_of_the_fine_one():
    """To a few hundredths where rays see whole cells: it only scales the direction."""
    panel = pp.Panel((96, 120), (0.5, 0.5), (-29.75, -23.75, 0))
    views = pp.arc_views(panel, np.linspace(-20, 20, 5), radius=500, pivot=(0, 0, 24))
    A = pp.Projector(views, pp.Grid((6, 70, 90), (2, 0.5, 0.5), (-22.25, -17.25, 15)))
    c = np.random.default_rng(2).uniform(50, 150, A.range_shape).astype(np.float32)
    fine, one = majoriser(A, c)
    coarse, eight = majoriser(A, c, 8)
    assert (one, eight) == (1, 8)
    assert coarse.shape == (6, 9, 12)
    means = fine[:, :64, :88].reshape(6, 8, 8, 11, 8).mean(axis=(2, 4))
    np.testing.assert_allclose(coarse[:, 1:7, 1:10], means[:, 1:7, 1:10], rtol=0.05)


def test_three_volumes_live_at_once_and_none_given_is_written_to():
    """Over the arrays of the scan's size, which are small here."""
    panel = pp.Panel((44, 60), (1, 1), (-29.5, -21.5, 0))
    views = pp.arc_views(panel, np.linspace(-25, 25, 3), radius=500, pivot=(0, 0, 24))
    grid = pp.Grid((40, 96, 112), (0.4, 0.4, 0.4), (-22.2, -19, 16))
    A = pp.Projector(views, grid)
    data = WeightedLeastSquares(A(np.full(grid.shape, 0.02, np.float32)), np.full(A.range_shape, 50, np.float32))
    start = np.random.default_rng(0).uniform(0, 0.04, grid.shape).astype(np.float32)
    kept = start.copy()
    steps = memory_gradient(A, data, PRIOR, BETA, start)
    for _ in range(2):
        next(steps)
    tracemalloc.start()  # what lives already is two iterates
    for _ in range(3):
        f, _ = next(steps)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 3.2 * start.nbytes + 12 * A(f).nbytes
    assert (start == kept).all()
    last = f.copy()
    next(steps)
    assert (f == last).all()


def test_the_plane_minimum_is_one():
    """Slopes vanish there; along u alone where the last step says nothing new."""
    rng = np.random.default_rng(1)
    B = rng.normal(size=(5, 2))
    M, slopes = B.T @ B, rng.normal(size=2)
    w = plane_minimum(slopes, M[0, 0], M[0, 1], M[1, 1])
    np.testing.assert_allclose(M @ w, -slopes, rtol=1e-10)
    assert plane_minimum((-2.0, 0.0), 4.0, 0.0, 0.0) == (0.5, 0.0)
    assert plane_minimum((-2.0, -4.0), 4.0, 8.0, 16.0) == (0.5, 0.0)


def test_it_goes_on_exactly_from_two_iterates():
    scan, A = small()
    start = np.random.default_rng(0).uniform(0, 0.2, A.domain_shape).astype(np.float32)
    whole = [(start, None)]
    whole += [(f.copy(), o) for f, o in islice(memory_gradient(A, Transmission.of(scan), PRIOR, BETA, start), 12)]
    for k in range(1, 12):
        steps = memory_gradient(A, Transmission.of(scan), PRIOR, BETA, whole[k][0], previous=whole[k - 1][0])
        for (f, told), (same, there) in zip(steps, whole[k + 1 :], strict=False):
            assert told == there
            assert (f == same).all()


def test_at_the_minimum_it_stays():
    """A uniform volume that meets the data exactly has no slope: the iterate comes back, and the run does not break."""
    _, A = small()
    f = np.full(A.domain_shape, 0.02, np.float32)
    data = WeightedLeastSquares(A(f), np.ones(A.range_shape, np.float32))
    for made, told in islice(memory_gradient(A, data, PRIOR, BETA, f), 3):
        assert told == 0
        assert (made == f).all()


def test_threads_do_not_change_a_bit():
    scan, A = small()
    start = np.full(A.domain_shape, 0.02, np.float32)
    ends = []
    for n in (1, 2, 3):
        _core.base.set_threads(n)
        ends.append(next(islice(memory_gradient(A, Transmission.of(scan), PRIOR, BETA, start), 5, None))[0].copy())
    _core.base.set_threads(0)
    assert (ends[0] == ends[1]).all()
    assert (ends[0] == ends[2]).all()


def test_optimizers_a_level_and_their_refusals():
    scan, A = small()
    both = {}
    for name in ("descent", "momentum", "subsets", ["momentum", "descent"]):
        *_, step = pp.iterates(scan, A.grid, levels=2, prior=PRIOR, optimizer=name, tolerance=1e-7, iterations=200)
        both[str(name)] = step.objective
    assert max(both.values()) < (1 + 1e-4) * min(both.values())
    with pytest.raises(
        DataError, match=r"optimizer: there is no 'newton'; choose from auto, momentum, descent, subsets"
    ):
        pp.iterates(scan, A.grid, levels=2, optimizer="newton")
    with pytest.raises(DataError, match=r"optimizer: expected one, or 2 \(finest first\), got \['descent'\]"):
        pp.iterates(scan, A.grid, levels=2, optimizer=["descent"])


def test_a_checkpoint_whose_two_iterates_differ_in_shape_is_damaged(tmp_path):
    scan, A = small()
    step = next(pp.iterates(scan, A.grid, levels=1, prior=PRIOR))
    run = fingerprint(scan, {})
    write_checkpoint(tmp_path / "run.h5", pp.Step(step.volume, 1.0, 0, 1, 1.0, False, step.previous[1:]), run)
    with pytest.raises(FileError, match=r"truncated or damaged \(previous: expected shape"):
        read_checkpoint(tmp_path / "run.h5", run)


def test_a_jump_weighs_the_same_on_every_level():
    """Twice the strength a level: that is the objective which is told, and it keeps β R of a step edge.

    But for the grid's faces where voxels halve in all three directions, within a quarter where slices stay as thick.
    """
    scan, A = small()
    beta = PRIOR.strength * median_curvature(data_curvature(A, Transmission.of(scan)))
    coarse, grid = pyramid(scan, A.grid, 2)[1]
    step = next(pp.iterates(scan, A.grid, levels=2, prior=PRIOR))
    data = Transmission.of(coarse).value(pp.Projector(coarse.views, grid)(step.volume.values))
    smooth = PRIOR.value(step.volume.values, grid)
    assert step.level == 1
    assert step.objective == pytest.approx(data + 2 * beta * smooth, rel=1e-6)
    for spacing, within in (((1, 1, 1), 0.1), ((1, 0.5, 0.5), 0.25)):
        fine, sharp, weighed = pp.Grid((16, 64, 64), spacing, (0, 0, 0)), pp.Prior(edge=1e-6), []
        for level, grid in enumerate((fine, coarser_grid(fine))):
            halves = np.zeros(grid.shape, np.float32)
            halves[:, :, grid.shape[2] // 2 :] = 0.02
            weighed.append(2**level * sharp.value(halves, grid))
        assert weighed[1] == pytest.approx(weighed[0], rel=within)
