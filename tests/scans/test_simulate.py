"""Shadows of analytic phantoms, and the noise of counting."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.spatial.transform import Rotation

import palpate as pp
from palpate.errors import DataError, GeometryError

number = st.floats(-1, 1)
triple = st.tuples(number, number, number)
PANEL = pp.Panel((48, 64), (2.4, 2.4), (-75.6, -56.4, 0))
VIEWS = pp.circular_views(PANEL, radius=200, height=1000, count=4)


def marched(phantom, start, end, steps=100_000):
    """Line integral by the midpoint rule: knows nothing of chords."""
    t = (np.arange(steps) + 0.5) / steps
    along = start + t[:, None] * (end - start)
    return phantom.attenuation(along).sum() * np.linalg.norm(end - start) / steps


@given(impact=st.floats(0, 1.2), turn=st.floats(0, 360))
def test_a_ray_through_a_ball_reads_its_chord(impact, turn):
    ball = pp.Phantom([(pp.Ellipsoid((3, -2, 40), 10), 0.05)])
    a = np.radians(turn)
    along, across = np.array([np.cos(a), np.sin(a), 0]), np.array([-np.sin(a), np.cos(a), 0])
    middle = np.array([3, -2, 40]) + 10 * impact * across
    chord = 20 * np.sqrt(max(0, 1 - impact**2))
    assert np.isclose(ball.line_integrals(middle - 500 * along, middle + 300 * along), 0.05 * chord, atol=1e-6)


@given(shift=triple)
def test_a_level_slab_is_crossed_over_its_thickness_divided_by_the_cosine(shift):
    slab = pp.Phantom([(pp.Box((0, 0, 50), (1000, 1000, 30)), 0.02)])
    start, end = np.array([0, 0, 900.0]), np.array([100 * shift[0], 100 * shift[1], 0])
    cosine = 900 / np.linalg.norm(end - start)
    assert np.isclose(slab.line_integrals(start, end), 0.02 * 30 / cosine, rtol=1e-12)


@settings(max_examples=25, deadline=None)
@given(start=triple, end=triple, turn=triple)
def test_chords_agree_with_marching_along_the_ray(start, end, turn):
    axes = Rotation.from_rotvec(np.array(turn) * 2).as_matrix()
    cut = pp.Intersection([pp.Ellipsoid((0, 0, 0), (9, 5, 7), axes), pp.Box((2, 0, 1), (9, 7, 8))])
    phantom = pp.Phantom([(cut, 0.03), (pp.Ellipsoid((1, 1, 0), (3, 2, 4), axes), 0.02), (pp.Box((0, 0, 0), 4), -0.01)])
    s, e = 12 * np.array(start), 12 * np.array(end) + [0, 0, 1e-3]
    assert np.isclose(phantom.line_integrals(s, e)[0], marched(phantom, s, e), atol=1e-4)


def test_rays_parallel_to_a_face_are_inside_or_outside():
    box = pp.Phantom([(pp.Box((0, 0, 0), 2), 1.0)])
    start = np.array([(0, 0, 9.0), (0.999, 0, 9), (1.001, 0, 9), (0, -5, 0)])
    end = np.array([(0, 0, -9.0), (0.999, 0, -9), (1.001, 0, -9), (0, 5, 0)])
    assert np.allclose(box.line_integrals(start, end), [2, 2, 0, 2])


def test_what_lies_behind_source_or_panel_casts_no_shadow():
    ball = pp.Phantom([(pp.Ellipsoid((0, 0, 0), 10), 1.0)])
    assert ball.line_integrals((0, 0, 100), (0, 0, 50))[0] == 0
    assert ball.line_integrals((0, 0, 100), (0, 0, 5))[0] == pytest.approx(5)


def test_the_voxels_of_a_phantom_hold_its_mass():
    volume = pp.Phantom([(pp.Ellipsoid((1, 2, 30), (9, 6, 5)), 0.02), (pp.Box((1, 2, 30), (4, 4, 3)), 0.01)])
    grid = volume.grid(0.5)
    mass = 0.02 * 4 / 3 * np.pi * 9 * 6 * 5 + 0.01 * 4 * 4 * 3
    voxels = volume.volume(grid)
    assert voxels.values.sum() * grid.voxel_volume == pytest.approx(mass, rel=2e-3)
    centre = np.round(grid.indices([[1, 2, 30], [1, 2, 33], [9.5, 7.5, 30]])).astype(int)
    assert np.allclose(voxels.values[tuple(centre.T)], [0.03, 0.02, 0])
    coarse = volume.volume(pp.Grid((8, 8, 10), (2, 2, 2), (-8, -5, 23)))  # cuts the phantom? no: it is wholly inside
    assert coarse.values.sum() * 8 == pytest.approx(mass, rel=1e-2)


@pytest.mark.parametrize("name", ["slab_phantom", "breast_phantom"])
def test_the_built_in_phantoms_attenuate_everywhere_above_nothing(name):
    phantom = getattr(pp, name)()
    values = phantom.volume(phantom.grid(2.0)).values
    assert values.min() > -1e-6
    assert 0.02 < values.max() < 0.12


def test_a_pixel_reads_the_mean_transmission_over_its_area():
    """A slab's edge, seen from straight above, cuts a pixel at 3/4 of its width: intensities average, not logs."""
    slab = pp.Phantom([(pp.Box((500, 0, 10), (1000, 2000, 10)), 0.3)])  # fills x > 0
    views = pp.Views([(0, 0, 9000)], pp.Panel((1, 3), (1, 1), (-1.25, 0, 0)))
    passed = pp.simulate_scan(slab, views, 1, seed=None, subrays=8).counts[0, 0]
    assert np.allclose(passed, [1, 0.75 + 0.25 * np.exp(-3), np.exp(-3)], atol=2e-3)


def test_finer_subrays_converge():
    scans = [pp.simulate_scan(pp.breast_phantom(), VIEWS[:1], 1, None, subrays=n).counts for n in (1, 2, 4, 8)]
    errors = [np.abs(s - scans[-1]).mean() for s in scans[:-1]]
    assert errors[0] > 2 * errors[1] > 4 * errors[2] > 0


def test_the_expected_counts_follow_beer_and_lambert():
    background = np.array([0, 5, 10, 20.0])
    scan = pp.simulate_scan(pp.slab_phantom(), VIEWS, [1000, 2000, 3000, 4000], None, background, subrays=1)
    for view, (row, column) in enumerate([(24, 32), (10, 20), (40, 50), (2, 60)]):
        end = VIEWS.panels[view].points([row, column])[0]
        p = marched(pp.slab_phantom(), VIEWS.source[view], end)
        expected = 1000 * (view + 1) * np.exp(-p) + background[view]
        assert scan.counts[view, row, column] == pytest.approx(expected, rel=1e-4)


def test_counts_scatter_like_poisson_numbers():
    """Sum over pixels of (y - mean)² / mean is chi-squared, up to the 1/mean of its own spread."""
    for seed, incident in ((1, 50), (2, 2_000), (3, 200_000)):
        mean = pp.simulate_scan(pp.slab_phantom(), VIEWS, incident, None, background=4).counts.astype(float)
        counts = pp.simulate_scan(pp.slab_phantom(), VIEWS, incident, seed, background=4).counts.astype(float)
        assert np.array_equal(counts, np.round(counts))
        n, z = counts.size, (counts - mean) / np.sqrt(mean)
        assert abs(z.mean()) < 4 / np.sqrt(n)
        spread = np.sqrt((2 + 1 / mean).mean() / n)  # variance of z² for a Poisson number is 2 + 1/mean
        assert abs((z**2).mean() - 1) < 4 * spread
        below = stats.poisson.cdf(counts - 1, mean)  # a count, smeared over its own step, has a uniform level
        level = below + np.random.default_rng(0).random(counts.shape) * stats.poisson.pmf(counts, mean)
        assert stats.kstest(level.ravel(), "uniform").pvalue > 1e-4
        beside = np.corrcoef(z[:, :, 1:].ravel(), z[:, :, :-1].ravel())[0, 1]
        assert abs(beside) < 4 / np.sqrt(n)  # and neighbours know nothing of each other


def test_the_same_seed_gives_the_same_counts():
    a, b, c = (pp.simulate_scan(pp.slab_phantom(), VIEWS, 2000, seed).counts for seed in (7, 7, 8))
    assert np.array_equal(a, b)
    assert not np.array_equal(a, c)


def test_masked_pixels_stay_empty():
    mask = np.ones(PANEL.shape, bool)
    mask[:, :9] = False
    scan = pp.simulate_scan(pp.slab_phantom(), VIEWS, 2000, 1, mask=mask)
    assert not scan.mask[:, :, :9].any()
    assert (scan.counts[:, :, :9] == 0).all()
    assert scan.counts[:, :, 9:].min() > 0


SLAB = pp.slab_phantom()
REFUSED = {
    "voxels": (lambda: pp.simulate_scan(SLAB.volume(SLAB.grid(8)), VIEWS, 9), ["phantom", "Volume", "flatter"]),
    "zero incident": (lambda: pp.simulate_scan(SLAB, VIEWS, 0), ["incident", "0 or less", "mask"]),
    "NaN incident": (lambda: pp.simulate_scan(SLAB, VIEWS, np.nan), ["incident", "nan"]),
    "negative background": (lambda: pp.simulate_scan(SLAB, VIEWS, 9, background=-1), ["background", "-1"]),
    "subrays": (lambda: pp.simulate_scan(SLAB, VIEWS, 9, subrays=0), ["subrays", "at least 1", "0"]),
    "radii": (lambda: pp.Ellipsoid((0, 0, 0), (1, 0, 1)), ["ellipsoid radii", "positive", "(1, 0, 1)"]),
    "size": (lambda: pp.Box((0, 0, 0), -2), ["box size", "positive", "-2"]),
    "centre": (lambda: pp.Box((0, 0), 2), ["box centre", "(3)", "(2,)"]),
    "axes": (lambda: pp.Ellipsoid((0, 0, 0), 1, np.ones((3, 3))), ["ellipsoid axes", "orthogonal"]),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_with_name_value_and_remedy(case):
    act, words = REFUSED[case]
    with pytest.raises((DataError, GeometryError)) as refusal:
        act()
    for word in words:
        assert word in str(refusal.value)


class Plain:
    """A solid that the kernels do not know."""

    def __init__(self, solid):
        self.span, self.bounds = solid.span, solid.bounds


@pytest.mark.parametrize("name", ["slab_phantom", "breast_phantom"])
def test_kernel_and_solids_of_ones_own_cast_the_same_shadow(name):
    """Ellipsoids, boxes and what they have in common, from NumPy's arithmetic and from the kernel's."""
    phantom = getattr(pp, name)()
    own = pp.Phantom([(Plain(solid), attenuation) for solid, attenuation in phantom.parts])
    for source, subrays in (((10, 30, 600), 1), ((-200, 0, 400), 3), ((0, 0, 80), 2), ((0, 0, 30), 1)):
        views = pp.Views([source], pp.Panel((40, 71), (3, 3), (-100, -60, -5), (0, 0.8, 0.6)))
        ours, theirs = (pp.simulate_scan(p, views, 1, None, subrays=subrays).counts for p in (phantom, own))
        assert ours.min() < 0.9
        np.testing.assert_allclose(ours, theirs, rtol=1e-6)
