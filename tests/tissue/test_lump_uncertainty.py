"""From samples to a lump's size and force: against factorisations, volumes, other meshes, and truths that are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

import palpate as pp
from palpate.errors import DataError, MaterialError
from palpate.reconstruction.posterior import Posterior
from palpate.tissue.interval_correction import sample_interval
from palpate.tissue.lump_outline import contrast_weights, tet_shares
from palpate.tissue.stiffness_draws import latin_normals, log_normal
from palpate.tissue.stiffness_update import StiffnessUpdate
from palpate.volumes.ellipsoid_shares import ellipsoid_shares
from palpate.volumes.radial_gradient import Ball, ball_near

GRID = pp.Grid.centred((16, 24, 28), (2.5, 2, 2))
SIZE = np.array([50.0, 42.0, 34.0])  # mm, of the box of tissue about the origin
CENTRE = (2.0, 1.0, 4.0)
TOP = np.array([2.0, 1.0, 17.0])
SOFT, STIFF = 3.0, 40.0
PUSH, CONTACT = 3.0, 8.0
SMEARED = 1.2  # mm


def box(voxel=2.0):
    """Labels of the box of tissue."""
    shape = np.round(SIZE[::-1] / voxel).astype(int)
    grid = pp.Grid.centred(shape + 2, (voxel,) * 3)
    values = np.zeros(grid.shape, int)
    values[1:-1, 1:-1, 1:-1] = 1
    return values, grid


@pytest.fixture(scope="module")
def tissue():
    values, grid = box()
    mesh = pp.tetrahedralize(pp.Labels(values, grid, {1: "body"}), "body", edge=7.0)
    return pp.Tissue(mesh, SOFT, 0.45, pp.resting_on(mesh, (0, 0, -1)))


def volume_of(ball, seed=None):
    """The body with a smeared bright ball, 1/mm, with noise."""
    r = np.sqrt(
        sum(
            (GRID.axis(n)[tuple(slice(None) if k == "zyx".index(n) else None for k in range(3))] - c) ** 2
            for n, c in zip("xyz", ball.centre, strict=True)
        )
    )
    values = 0.05 + 0.02 / (1 + np.exp((r - ball.radius) / SMEARED))
    noise = 0 if seed is None else 2e-4 * np.random.default_rng(seed).standard_normal(GRID.shape)
    inside = (
        (np.abs(GRID.axis("z"))[:, None, None] < SIZE[2] / 2)
        & (np.abs(GRID.axis("y"))[:, None] < SIZE[1] / 2)
        & (np.abs(GRID.axis("x")) < SIZE[0] / 2)
    )
    return np.asarray(np.where(inside, values + noise, 0), np.float32)


def fake_posterior(balls):
    """Samples whose lumps are known; the first ball is the MAP estimate's."""
    volumes = [volume_of(ball, seed) for seed, ball in enumerate(balls)]
    as_volume = pp.Volume(volumes[0], GRID)
    return Posterior(as_volume, as_volume, as_volume, None, np.stack(volumes[1:]))


@pytest.fixture(scope="module")
def radii():
    return np.random.default_rng(4).uniform(5, 7, 19)


@pytest.fixture(scope="module")
def doubt(tissue, radii):
    found = fake_posterior([Ball(CENTRE, 6.0), *(Ball(CENTRE, float(r)) for r in radii)])
    places = [TOP, (-12.0, -8.0, 17.0)]
    return pp.lump_uncertainty(
        found, tissue, lump=(STIFF, 0), near=CENTRE, point=TOP, push=PUSH, radius=CONTACT, places=places
    )


def test_an_update_is_another_factorisation(tissue):
    """Of a stiffness that changes in some tetrahedra, softer ones too, at two contacts."""
    centres = tissue.mesh.nodes[tissue.mesh.tets].mean(axis=1)
    changed = np.linalg.norm(centres - CENTRE, axis=1) < 10
    young = tissue.young.copy()
    young[changed] *= np.random.default_rng(2).uniform(0.3, 20, changed.sum())
    points = np.array([TOP, (-12.0, 8.0, 17.0)])
    update = StiffnessUpdate(tissue, changed, points, CONTACT)
    again = pp.Tissue(tissue.mesh, young, 0.45, tissue.fixed)
    np.testing.assert_allclose(update.forces(young, PUSH), pp.force_map(again, PUSH, CONTACT, points), rtol=1e-8)
    np.testing.assert_allclose(update.plain_forces(PUSH), pp.force_map(tissue, PUSH, CONTACT, points), rtol=1e-8)
    with pytest.raises(MaterialError, match="changed"):
        StiffnessUpdate(tissue, np.zeros_like(changed), points, CONTACT)


def test_shares_of_voxels_and_tetrahedra_keep_a_balls_volume(tissue):
    for radius in (4.0, 6.5):
        shares = ellipsoid_shares(GRID, CENTRE, radius)
        ball = 4 / 3 * np.pi * radius**3
        assert shares.sum() * GRID.voxel_volume == pytest.approx(ball, rel=0.01)
        filled = tet_shares(tissue.mesh, shares, GRID)
        assert filled @ tissue.mesh.volumes == pytest.approx(ball, rel=0.03)
        centres = tissue.mesh.nodes[tissue.mesh.tets].mean(axis=1)
        far = np.linalg.norm(centres - CENTRE, axis=1) > radius + 8
        assert filled[far].max() == 0


def test_the_ball_near_a_mark_is_found():
    for seed, radius in enumerate((4.0, 6.0, 8.0)):
        ball = Ball((3.3, -2.2, 1.4), radius)
        found = ball_near(pp.Volume(volume_of(ball, seed), GRID), (5.5, 0.0, -4.0))
        np.testing.assert_allclose(found.centre, ball.centre, atol=0.7)
        assert found.radius == pytest.approx(radius, abs=0.5)
    with pytest.raises(DataError, match=r"near: .* outside"):
        ball_near(pp.Volume(volume_of(ball), GRID), (100, 0, 0))


def test_samples_give_their_diameters_and_depths(doubt, radii):
    np.testing.assert_allclose(doubt.diameter, 2 * radii, atol=0.5)
    assert np.corrcoef(doubt.diameter, radii)[0, 1] > 0.98
    np.testing.assert_allclose(doubt.depth, TOP[2] - CENTRE[2], atol=0.6)
    low, high = doubt.interval("diameter")
    assert low == doubt.diameter.min()  # 90 % of 19: between the extremes
    assert high == doubt.diameter.max()


def test_the_added_force_is_that_of_a_mesh_that_follows_the_lump(doubt, radii):
    """By finite elements on a boundary-fitted mesh: another mesh, and no share of any element."""
    k = int(np.argmax(radii))
    values, grid = box(1.0)
    values[ellipsoid_shares(grid, CENTRE, doubt.diameter[k] / 2) > 0.5] = 2
    labels = pp.Labels(values, grid, {1: "body", 2: "lump"})
    mesh = pp.tetrahedralize(labels, "body", edge=7.0, inclusions=["lump"], fine={"lump": 3.0})
    fixed = pp.resting_on(mesh, (0, 0, -1))
    forces = [
        pp.force_map(pp.Tissue(mesh, {"body": SOFT, "lump": E}, 0.45, fixed), PUSH, CONTACT, [TOP])[0]
        for E in (STIFF, SOFT)
    ]
    assert doubt.share[k] == pytest.approx(forces[0] / forces[1] - 1, rel=0.2)


def test_forces_scale_with_stiffness_and_draws_follow_their_range(tissue, doubt):
    found = fake_posterior([Ball(CENTRE, 6.0)] + [Ball(CENTRE, 6.0)] * 19)
    options = {"near": CENTRE, "point": TOP, "push": PUSH, "radius": CONTACT, "seed": 3}
    stiffer = pp.Tissue(tissue.mesh, 2 * SOFT, 0.45, tissue.fixed)
    one = pp.lump_uncertainty(found, tissue, lump=(STIFF, 9), body=(SOFT, 0.6), **options)
    two = pp.lump_uncertainty(found, stiffer, lump=(2 * STIFF, 18), body=(2 * SOFT, 1.2), **options)
    np.testing.assert_allclose(two.added, 2 * one.added, rtol=1e-6)
    np.testing.assert_allclose(two.share, one.share, rtol=1e-6)
    assert one.plain.std() / one.plain.mean() == pytest.approx(0.2, rel=0.15)
    assert (doubt.plain == doubt.plain[0]).all()
    assert doubt.forces[:, 0] == pytest.approx(doubt.plain + doubt.added)  # the first place is the point
    low, high = doubt.band()
    assert (low <= high).all()
    assert high[0] == doubt.forces[:, 0].max()


def test_stiffness_is_log_normal_in_equal_strata():
    z = latin_normals(200, 2, 1)
    for column in norm.cdf(z).T:
        assert (np.sort((200 * column).astype(int)) == np.arange(200)).all()
    mean, std = log_normal("lump", (42.5, 12.5))
    drawn = np.exp(mean + std * z[:, 0])
    assert drawn.mean() == pytest.approx(42.5, rel=0.01)
    assert drawn.std() == pytest.approx(12.5, rel=0.05)
    assert log_normal("lump", pp.tissue_properties("gland").young) == log_normal("lump", (3.24, 0.61))
    for bad in ((-1, 1), (1, np.nan)):
        with pytest.raises(MaterialError, match="lump: expected"):
            log_normal("lump", bad)


def test_the_contrast_is_the_mean_inside_less_that_around():
    shares = ellipsoid_shares(GRID, CENTRE, 6.0)
    weights = contrast_weights(shares)
    assert weights.sum() == pytest.approx(0, abs=1e-5)
    plain = volume_of(Ball(CENTRE, 1e-3))
    sharp = plain + 0.02 * shares
    inside = float(shares.astype(float).ravel() @ shares.ravel())
    expected = 0.02 * inside / shares.sum()
    assert np.vdot(weights, sharp - plain) == pytest.approx(expected, rel=0.02)


def test_a_probability_is_the_share_of_the_draws_above(doubt):
    shares = np.linspace(0.02, 0.38, 19)
    made = replace(doubt, added=shares * doubt.plain)
    for weber in (0.05, 0.1, 0.3):
        assert made.probability_felt(weber) == np.mean(shares > weber)
    assert "with a probability of 74%" in made.text(0.8)
    nothing = replace(doubt, added=1e-4 * doubt.plain)
    assert "below 5%" in nothing.text(0.8).splitlines()[0]
    with pytest.raises(DataError, match="weber"):
        doubt.probability_felt(0)
    with pytest.raises(DataError, match="quantity"):
        doubt.interval("weight")
    with pytest.raises(DataError, match="level: of 19 samples"):
        doubt.interval("depth", 0.99)


def bodies(count, seed):
    """Samples that are biased and too narrow, by a spread of their own, and the truths."""
    rng = np.random.default_rng(seed)
    truth = np.exp(rng.normal(2, 0.5, count))
    spread = rng.uniform(0.02, 0.2, count)
    middle = 0.3 + 0.8 * np.log(truth) + rng.normal(0, np.hypot(0.1, spread), count)
    return [np.exp(m + s * rng.standard_normal(20)) for m, s in zip(middle, spread, strict=True)], truth


def test_a_correction_holds_what_it_promises():
    taught = pp.IntervalCorrection.learn(*bodies(400, 1))
    samples, truth = bodies(3000, 2)
    raw = np.array([sample_interval(s, 0.9) for s in samples])
    ends = np.array([taught.interval(s, 0.9) for s in samples])
    held = np.mean((ends[:, 0] <= truth) & (truth <= ends[:, 1]))
    assert np.mean((raw[:, 0] <= truth) & (truth <= raw[:, 1])) < 0.8
    assert held == pytest.approx(0.9, abs=0.04)
    assert np.median(np.ptp(ends, axis=1)) < 0.8 * np.ptp(np.quantile(truth, [0.05, 0.95]))
    told = np.array([taught.probability_above(s, 8.0) for s in samples])
    for low in (0.1, 0.4, 0.7):
        here = (told >= low) & (told < low + 0.2)
        assert np.mean(truth[here] > 8.0) == pytest.approx(told[here].mean(), abs=0.09)


def test_corrections_reach_intervals_and_probabilities(doubt):
    taught = pp.IntervalCorrection.learn(*bodies(100, 3))
    made = replace(doubt, corrections={"diameter": taught, "share": taught})
    assert made.interval("diameter") == taught.interval(doubt.diameter)
    assert made.interval("depth") == doubt.interval("depth")
    assert made.probability_felt(0.15) == taught.probability_above(doubt.share, 0.15)
    assert "corrected by what other bodies taught" in made.text()


def test_bad_corrections_are_refused():
    samples, truth = bodies(30, 1)
    with pytest.raises(DataError, match="at least 3"):
        pp.IntervalCorrection.learn(samples[:2], truth[:2])
    with pytest.raises(DataError, match="one for each of 30 bodies"):
        pp.IntervalCorrection.learn(samples, truth[:20])
    with pytest.raises(DataError, match="truths: expected numbers above 0"):
        pp.IntervalCorrection.learn(samples, truth - truth[0])


def test_what_cannot_be_sampled_is_refused_by_name(tissue):
    found = fake_posterior([Ball(CENTRE, 6.0)] * 20)
    with pytest.raises(DataError, match="near: give the lump's place"):
        pp.lump_uncertainty(found, tissue, lump=(STIFF, 1))
    with pytest.raises(DataError, match="samples were not kept"):
        pp.lump_uncertainty(replace(found, samples=None), tissue, lump=(STIFF, 1), near=CENTRE)
    with pytest.raises(DataError, match="rule: of the MAP estimate"):
        pp.lump_uncertainty(found, tissue, lump=(STIFF, 1), rule=lambda volume: np.zeros(GRID.shape))
    far = np.zeros(GRID.shape)
    far[0, 0, 0] = 1
    with pytest.raises(MaterialError, match="changed: no tetrahedron"):
        pp.lump_uncertainty(found, tissue, lump=(STIFF, 1), rule=lambda volume: far, point=TOP)
    with pytest.raises(DataError, match="draws, push, radius"):
        pp.lump_uncertainty(found, tissue, lump=(STIFF, 1), near=CENTRE, draws=0)


def test_the_force_map_is_drawn_with_its_band(doubt):
    figure = pp.plot_lump_uncertainty(doubt)
    assert any("90% band" in axes.get_title() for axes in figure.axes)
    with pytest.raises(DataError, match="places"):
        pp.plot_lump_uncertainty(replace(doubt, places=np.zeros((0, 3))))
