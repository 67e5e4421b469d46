"""Samples of the posterior: their mean and covariance are those of dense matrices, and truths rank among them at random."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.stats import chi2
from support.reference_projector import pixel_means

import palpate as pp
from palpate import _core
from palpate.reconstruction.checkpoint import read_checkpoint, write_checkpoint
from palpate.reconstruction.laplace_approximation import LaplaceApproximation, restricted
from palpate.reconstruction.models.likelihood import Transmission
from palpate.reconstruction.optimizers.coordinate_descent import data_curvature
from palpate.reconstruction.optimizers.problem import Problem
from palpate.reconstruction.posterior import mean_and_std, sample_steps
from palpate.reconstruction.prior_parameters import median_curvature
from palpate.reconstruction.projector import Projector

GRID = pp.Grid.centred((4, 6, 6), (3, 2, 2.5), z=20)
VIEWS = pp.arc_views(pp.Panel((12, 18), (2, 2), (-17, -11, 0)), np.linspace(-25, 25, 6), radius=300, pivot=(0, 0, 20))
INCIDENT, LEVEL = 20_000.0, 0.03
BETA = 1e4  # the prior decides half of what is found, the data the other half: trace(H⁻¹ β K) / voxels is 0.6
CONVERGED = 60  # iterations; a draw ends before where rounding is reached
EXACT = {"levels": 1, "iterations": 60, "tolerance": 0, "sample_iterations": CONVERGED}


def dense_projector():
    """(pixels, voxels), by Siddon's method in double precision, 256 rays a pixel."""
    voxels = np.moveaxis(np.eye(144).reshape(144, *GRID.shape), 0, -1)
    pixels = np.stack(np.unravel_index(np.arange(12 * 18), (12, 18)), axis=1)
    return np.concatenate([pixel_means(voxels, VIEWS, GRID, view, pixels, 8) for view in range(len(VIEWS))])


def dense_prior():
    """K, the Hessian of R: ω = V / (d d̄) of each pair of 26 neighbours, mm."""
    spacing = np.array(GRID.spacing)
    at = np.array(list(np.ndindex(GRID.shape)))
    steps = np.abs(at[:, None] - at[None])
    distance = np.sqrt(((steps * spacing) ** 2).sum(-1))
    pair = steps.max(-1) == 1
    K = -np.where(pair, spacing.prod() / (np.where(pair, distance, 1) * spacing.min()), 0)
    return K - np.diag(K.sum(1))


def functionals():
    """(5, voxels): a voxel, the mean, a slice, the contrast of a block, a slope along x."""
    z, y, x = np.indices(GRID.shape)
    block = (z == 1) & (abs(y - 3) <= 1) & (abs(x - 2) <= 1)
    voxel = (z == 2) & (y == 4) & (x == 3)
    each = [voxel, np.ones(GRID.shape), z == 2, block / block.sum() - ~block / (~block).sum(), x - x.mean()]
    return np.array([np.asarray(g, float).ravel() for g in each])


def scan_of(truth, seed):
    mean = INCIDENT * np.exp(-Projector(VIEWS, GRID)(truth.astype(np.float32)).astype(float))
    return pp.Scan(np.random.default_rng(seed).poisson(mean), INCIDENT, VIEWS)


def prior_for(scan):
    """The quadratic prior whose β is BETA."""
    known = data_curvature(Projector(VIEWS, GRID), Transmission.of(scan))
    return pp.Prior("quadratic", strength=BETA / median_curvature(known))


@pytest.fixture(scope="module")
def dense():
    return dense_projector(), dense_prior()


@pytest.fixture(scope="module")
def found():
    scan = scan_of(np.full(GRID.shape, LEVEL), seed=1)
    return pp.posterior(scan, GRID, samples=1000, seed=3, prior=prior_for(scan), **EXACT)


def covariance_of(found, dense):
    A, K = dense
    weights = INCIDENT * np.exp(-A @ found.map.values.ravel().astype(float))
    return np.linalg.inv(A.T @ (weights[:, None] * A) + BETA * K)


def test_the_samples_have_mean_and_covariance_of_the_dense_posterior(found, dense):
    """1,000 samples: a standard deviation has an error of 2.2 %, the variance of all together one of 0.4 %."""
    covariance = covariance_of(found, dense)
    assert found.map.values.min() > 10 * np.sqrt(covariance.diagonal().max())  # f >= 0 does not bind
    changes = (found.samples - found.map.values).reshape(len(found.samples), -1).astype(float)
    ratio = found.std.values.ravel() / np.sqrt(covariance.diagonal())
    assert np.sqrt(((ratio - 1) ** 2).mean()) < 0.03
    for g in functionals():
        assert (changes @ g).std() == pytest.approx(np.sqrt(g @ covariance @ g), rel=0.05)
    white = changes @ np.linalg.cholesky(np.linalg.inv(covariance))
    assert white.var() == pytest.approx(1, abs=0.01)
    # The mean of n samples lies 1/n of a covariance from the MAP estimate, if they are centred there.
    assert (white.mean(axis=0) ** 2).mean() * len(white) == pytest.approx(1, abs=5 * np.sqrt(2 / 144))


def test_one_solve_gives_the_standard_deviation_of_a_linear_functional(found, dense):
    covariance = covariance_of(found, dense)
    for g in functionals():
        first_order = found.linear_std(g.reshape(GRID.shape))
        assert first_order == pytest.approx(np.sqrt(g @ covariance @ g), rel=5e-3)
        sampled = found.samples.reshape(len(found.samples), -1) @ g
        assert sampled.std() == pytest.approx(first_order, rel=0.05)


def dense_kernel(scan):
    """(pixels, pixels) of one view's blur: every view's, where the focal spot is a point; rows of sum 1."""
    rows, columns = scan.shape[1:]
    unit = np.eye(rows * columns).reshape(-1, rows, columns)
    sigma = [scan.blur.panel / 2.3548 / pitch for pitch in scan.views.panels[0].pitch]
    soft = np.array([gaussian_filter(one, sigma, mode="constant", truncate=8) for one in unit]).reshape(len(unit), -1).T
    return soft / soft.sum(axis=1, keepdims=True)


def test_behind_a_blur_too_the_samples_have_the_covariance_of_the_dense_posterior(dense):
    """J = B diag(e⁻ˡ) A is the derivative of the pixels' light by the voxels: the Fisher information is Jᵀ diag(I / light) J.

    Without the blur in it these standard deviations would be 4 to 23 % less, and the variance of all together a third.
    """
    A, K = dense
    sharp = scan_of(np.full(GRID.shape, LEVEL), seed=1)
    soft = replace(sharp, blur=pp.Blur(panel=4.0))
    B = np.kron(np.eye(len(VIEWS)), dense_kernel(soft))
    truth = LEVEL * (1 + 0.5 * (np.indices(GRID.shape)[2] > 2))
    light = B @ np.exp(-A @ truth.ravel())
    counts = np.random.default_rng(8).poisson(INCIDENT * light).reshape(sharp.shape)
    scan = replace(soft, counts=counts.astype(np.float32))
    found = pp.posterior(scan, GRID, samples=600, seed=5, prior=prior_for(sharp), **EXACT)
    passed = np.exp(-A @ found.map.values.ravel().astype(float))
    J = B @ (passed[:, None] * A)
    beta = found.laplace.levels[0][1].beta
    covariance = np.linalg.inv(J.T @ (INCIDENT / (B @ passed)[:, None] * J) + beta * K)
    assert found.map.values.min() > 5 * np.sqrt(covariance.diagonal().max())
    changes = (found.samples - found.map.values).reshape(len(found.samples), -1).astype(float)
    for g in functionals():
        exact = np.sqrt(g @ covariance @ g)
        assert (changes @ g).std() == pytest.approx(exact, rel=0.08)  # 600 samples: 2.9 %
        assert found.linear_std(g.reshape(GRID.shape)) == pytest.approx(exact, rel=0.02)
    white = changes @ np.linalg.cholesky(np.linalg.inv(covariance))
    assert white.var() == pytest.approx(1, abs=0.02)


def test_truths_from_the_prior_rank_among_the_samples_at_random(dense):
    """The prior is improper: it does not know the mean, which is the same for all truths here. The data tell it."""
    rng = np.random.default_rng(7)
    values, vectors = np.linalg.eigh(BETA * dense[1])
    root = vectors[:, 1:] / np.sqrt(values[1:])
    truths, samples = 80, 7
    ranks = []
    for number in range(truths):
        truth = LEVEL + (root @ rng.standard_normal(143)).reshape(GRID.shape)
        assert truth.min() > 0.005
        scan = scan_of(truth, seed=[7, number])
        found = pp.posterior(scan, GRID, samples=samples, seed=number, prior=prior_for(scan), **EXACT)
        drawn = found.samples.reshape(samples, -1) @ functionals().T
        ranks.append((drawn < functionals() @ truth.ravel()).sum(axis=0))
    for each in np.transpose(ranks):
        counts = np.bincount(each, minlength=samples + 1)
        expected = truths / (samples + 1)
        assert chi2.sf(((counts - expected) ** 2 / expected).sum(), samples) > 0.01 / len(functionals())


def body_in_air():
    """Scan, grid and truth of an ellipsoid with air around it."""
    grid = pp.Grid.centred((6, 24, 28), (3, 1, 1), z=20)
    views = pp.arc_views(pp.Panel((40, 60), (1, 1), (-29.5, -19.5, 0)), np.linspace(-20, 20, 5), radius=500)
    body = pp.Phantom([(pp.Ellipsoid((0, 0, 20), (9, 8, 8)), 0.03)])
    return pp.simulate_scan(body, views, incident=5000, seed=1), grid, body.volume(grid).values


@pytest.mark.parametrize("blur", [None, pp.Blur(panel=3.0)])
def test_coarser_levels_only_give_a_start(blur):
    """Converged draws are the same from one level and from three; on the way the start is nearer. Behind a blur they do not
    end on the way."""
    scan, grid, _ = body_in_air()
    scan = replace(scan, blur=blur)
    options = {"prior": pp.Prior("quadratic", 1.0), "samples": 2, "iterations": 100, "tolerance": 0}
    one, three = (pp.posterior(scan, grid, levels=levels, **options).laplace for levels in (1, 3))
    three = LaplaceApproximation([one.levels[0], *three.levels[1:]])  # one centre
    converged = one.draw(5, 0, 300)
    size = np.linalg.norm(converged - one.levels[0][0])
    assert np.linalg.norm(three.draw(5, 0, 300) - converged) < 0.01 * size
    inner = np.s_[1:-1, 6:-6, 6:-6]

    def error(laplace):
        return np.linalg.norm((laplace.draw(5, 0, 2) - converged)[inner].mean(axis=0))

    assert blur is not None or error(three) < 0.7 * error(one)


def test_draws_behind_a_blur_go_on_until_their_fine_detail_is_there():
    """A prior so weak that the image is sharper than the views: two iterations would find a part of the noise."""
    scan, grid, _ = body_in_air()
    scan = replace(scan, blur=pp.Blur(panel=2.5))
    options = {"prior": pp.Prior("quadratic", 0.003), "samples": 6, "keep": False, "levels": 2}
    quick, long = (
        pp.posterior(scan, grid, sample_iterations=count, **options).std.values[1:-1, 8:-8, 8:-8] for count in (2, 100)
    )
    assert np.sqrt((quick**2).mean()) == pytest.approx(np.sqrt((long**2).mean()), rel=0.05)


def test_samples_keep_the_constraints():
    """In the air beside the body f = 0 binds for some of them, and outside the support it is held."""
    scan, grid, truth = body_in_air()
    mask = np.ones(grid.shape, bool)
    mask[:, :3] = False
    found = pp.posterior(scan, grid, samples=20, levels=2, prior=pp.Prior("quadratic", 0.3), support=mask)
    assert found.samples.min() == 0
    assert not found.samples[:, ~mask].any()
    assert (found.samples[:, mask] > 0).any(axis=0).mean() > 0.9
    assert 0.05 < (found.samples[:, (truth == 0) & mask] == 0).mean() < 0.95


def test_within_an_outline_the_prior_has_no_pairs_beyond_it_and_nor_has_its_noise(dense):
    """The rim's standard deviation is that of the dense matrices of the voxels inside: 500 samples, 24 voxels."""
    A, K = dense
    mask = np.indices(GRID.shape)[1] > 1
    inside = mask.ravel()
    scan = scan_of(LEVEL * mask, seed=2)
    found = pp.posterior(scan, GRID, samples=500, prior=prior_for(scan), support=mask, **EXACT)
    pairs = K[np.ix_(inside, inside)]
    np.fill_diagonal(pairs, 0)
    pairs -= np.diag(pairs.sum(1))
    weights = INCIDENT * np.exp(-A @ found.map.values.ravel().astype(float))
    beta = found.laplace.levels[0][1].beta
    exact = np.linalg.inv(A[:, inside].T @ (weights[:, None] * A[:, inside]) + beta * pairs)
    ratio = found.std.values[mask] / np.sqrt(exact.diagonal())
    rim = (np.indices(GRID.shape)[1] == 2)[mask]
    assert ratio[rim].mean() == pytest.approx(1, abs=0.03)
    assert ratio.mean() == pytest.approx(1, abs=0.02)


def test_a_linear_term_has_its_gradient():
    scan = scan_of(np.full(GRID.shape, LEVEL), seed=1)
    rng = np.random.default_rng(0)
    linear, f, step = (rng.standard_normal(GRID.shape).astype(np.float32) for _ in range(3))
    f, step = 0.03 + 0.001 * f, 1e-3 * step
    linear *= 1e4
    problem = Problem(Projector(VIEWS, GRID), Transmission.of(scan), prior_for(scan), BETA, "precomputed", None, linear)
    slope = (problem.objective(f + step) - problem.objective(f - step)) / 2
    assert slope == pytest.approx(float(np.vdot(problem.gradient(f).astype(float), step)), rel=1e-3)
    without = replace(problem, linear=None)
    assert problem.objective(f) == pytest.approx(without.objective(f) - float(np.vdot(linear, f)), rel=1e-5)


def test_equal_seeds_give_equal_samples_on_any_number_of_threads(found):
    laplace = found.laplace
    first = laplace.draw(3, 0, CONVERGED)
    np.testing.assert_array_equal(first, found.samples[0])
    try:
        _core.base.set_threads(1)
        np.testing.assert_array_equal(laplace.draw(3, 0, CONVERGED), first)
    finally:
        _core.base.set_threads(0)
    assert abs(laplace.draw(4, 0, CONVERGED) - first).max() > 0
    assert abs(laplace.draw(3, 1, CONVERGED) - first).max() > 0


def test_sampling_goes_on_from_a_checkpoint_to_the_bit(found, tmp_path):
    whole = list(sample_steps(found.laplace, pp.Step(found.map, 0.0, 0, 1, 0.0, True), 4, seed=3))
    write_checkpoint(tmp_path / "c.h5", whole[1], {})
    rest = list(sample_steps(found.laplace, read_checkpoint(tmp_path / "c.h5", {}), 4, seed=3))
    assert [step.iteration for step in rest] == [3, 4]
    for resumed, once in zip(mean_and_std(rest[-1]), mean_and_std(whole[-1]), strict=True):
        np.testing.assert_array_equal(resumed.values, once.values)


def test_intervals_are_quantiles_between_which_a_further_draw_lies(found):
    some = replace(found, samples=found.samples[:9])
    means = np.sort(some.samples.reshape(9, -1).mean(axis=1))
    assert some.interval(lambda volume: volume.values.mean(), level=0.8) == pytest.approx(
        (means[0], means[-1]), rel=1e-6
    )
    with pytest.raises(pp.errors.DataError, match=r"at most 0\.8"):
        some.interval(lambda volume: volume.values.mean())
    with pytest.raises(pp.errors.DataError, match="keep=True"):
        replace(found, samples=None).interval(lambda volume: 0.0)


def test_what_cannot_be_sampled_is_refused():
    scan = scan_of(np.full(GRID.shape, LEVEL), seed=1)
    for options, said in (
        ({"prior": pp.Prior()}, "quadratic"),
        ({"prior": pp.Prior("quadratic", 0.0)}, "strength"),
        ({"method": "sirt"}, "map"),
        ({"samples": 1}, "samples"),
        ({"seed": -1}, "seed"),
        ({"sample_iterations": 0}, "sample_iterations"),
    ):
        with pytest.raises(pp.errors.DataError, match=said):
            pp.posterior(scan, GRID, **options)


def test_the_command_writes_the_standard_deviation_beside_the_volume(tmp_path):
    views = pp.arc_views(pp.Panel((50, 70), (1, 1), (-34.5, -24.5, 0)), [-20, -7, 7, 20], radius=500, pivot=(0, 0, 20))
    body = pp.Phantom([(pp.Ellipsoid((0, 0, 15), (20, 14, 9)), 0.02)])
    scan = pp.simulate_scan(body, views, incident=5000, seed=1)
    pp.write_scan(tmp_path / "scan.h5", scan)

    def run(*options):
        words = ["reconstruct", str(tmp_path / "scan.h5"), "-o", str(tmp_path / "body.nii.gz"), "--thickness", "30"]
        words += ["--spacing", "1", "--samples", "3", "--seed", "4", *options]
        return subprocess.run([sys.executable, "-m", "palpate", *words], capture_output=True, text=True, timeout=120)

    done = run("--resolution", "2mm")
    assert done.returncode == 0, done.stderr
    assert "body-std.nii.gz: standard deviation of 3 samples" in done.stdout
    found = pp.posterior(scan, pp.covering_grid(views, 30, 1), samples=3, seed=4, resolution=2)
    np.testing.assert_array_equal(pp.read_volume(tmp_path / "body.nii.gz").values, found.map.values)
    np.testing.assert_array_equal(pp.read_volume(tmp_path / "body-std.nii.gz").values, found.std.values)
    refused = run("--prior", "huber")
    assert refused.returncode == 2
    assert "quadratic" in refused.stderr


@pytest.mark.parametrize("size", [2, 5, 8])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_restriction_is_the_transpose_of_linear_interpolation(axis, size):
    """Between the middles of voxels twice as long, whose ends go on; NumPy's own interpolation, column by column."""
    coarse = -(-size // 2)
    middles = (np.arange(size) + 0.5) / 2 - 0.5
    interpolation = np.stack([np.interp(middles, np.arange(coarse), unit) for unit in np.eye(coarse)], axis=1)
    shapes = [[3, 3, 3], [3, 3, 3]]
    shapes[0][axis], shapes[1][axis] = size, coarse
    spacing = [1.0, 1.0, 1.0]
    spacing[axis] = 2.0
    fine, wide = pp.Grid(tuple(shapes[0]), (1.0, 1.0, 1.0)), pp.Grid(tuple(shapes[1]), tuple(spacing))
    values = np.random.default_rng(size).normal(size=fine.shape).astype(np.float32)
    expected = np.moveaxis(np.tensordot(interpolation.T, np.moveaxis(values, axis, 0), 1), 0, axis)
    inner = [slice(None)] * 3
    if size % 2:  # the last coarse voxel reaches beyond the fine ones, and takes the end's share from there
        inner[axis] = slice(None, -1)
    np.testing.assert_allclose(restricted(values, fine, wide)[tuple(inner)], expected[tuple(inner)], atol=1e-6)
