"""Filtered backprojection against what is known in closed form of a limited angle."""

import numpy as np
import pytest

import palpate as pp
from palpate.errors import DataError, GeometryError
from palpate.reconstruction.baselines.filtered_backprojection import WINDOWS, fbp
from palpate.reconstruction.models.likelihood import Transmission, WeightedLeastSquares
from palpate.scans.analytic_phantoms import Box, Ellipsoid, Phantom

GRID = pp.Grid((20, 48, 48), (2, 1, 1), (-23.5, -23.5, 21))
MIDDLE = 40.0


def panel(n=140):
    return pp.Panel((n, n), (1, 1), (-(n - 1) / 2, -(n - 1) / 2, 0))


MOTIONS = {
    "along x": pp.linear_views(panel(), length=600, height=1000, count=21),
    "along y": pp.linear_views(panel(), length=600, height=1000, count=21, direction=90),
    "aslant": pp.linear_views(panel(), length=600, height=1000, count=21, direction=30),
    "off to one side": pp.linear_views(panel(220), length=400, height=1000, count=21, centre=(300, 100)),
    "arc": pp.arc_views(panel(), np.linspace(-20, 20, 21), radius=650, pivot=(0, 0, MIDDLE)),
    "rotating": pp.rotating_views(panel(), np.linspace(-20, 20, 21), source=(0, 0, 1000), pivot=(0, 0, MIDDLE)),
    "moving panel": pp.linear_views(panel(), length=600, height=1000, count=21, fulcrum=MIDDLE),
    "circular": pp.circular_views(panel(), radius=300, height=1000, count=24),
    "hypocycloid": pp.hypocycloid_views(panel(), radius=400, height=1000, count=24),
}


def of(line_integrals, weights=None):
    return WeightedLeastSquares(line_integrals, np.ones(line_integrals.shape) if weights is None else weights)


def made(phantom, views, grid=GRID, **options):
    scan = pp.simulate_scan(phantom, views, 1e6, seed=None)
    return fbp(pp.Projector(views, grid), Transmission.of(scan), **options)


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("width", [12, 400])
def test_what_does_not_vary_in_depth_comes_back_in_the_middle(motion, width):
    """A block through the whole depth, its sides along the rays of the mean source, narrow or beyond the panel.

    Two slices share the middle; 3 % is the square of the magnification over half the depth (20 / 650 mm, the arc).
    """
    views = MOTIONS[motion]
    if motion == "off to one side" and width < 400:
        views = pp.Views(views.source - [300, 100, 0], views.panels)
    block = Phantom([(Box((0, 0, MIDDLE), (width, width, 40)), 0.02)])
    middle = made(block, views, window="ram-lak")[9:11].mean(axis=0)
    assert middle[22:26, 22:26].mean() == pytest.approx(0.02, rel=0.03)
    if width == 400:
        assert np.abs(middle - 0.02).max() < 0.03 * 0.02
    else:
        assert np.abs(middle[24, :12]).max() < 0.1 * 0.02


def test_a_ball_comes_back_with_the_share_of_its_spectrum_that_was_seen():
    """Each direction gives the same share of a ball's centre: 2a/π of it over ±a radians.

    a: as seen from the ball, to the outer edges of the last views' bands. The depth is far beyond the ball's, so that the
    levelled ramp adds at most πr²/(depth² tan a), here 0.4 %, with r the radius.
    """
    reach, radius, depth = 5000.0, 12.0, 480.0
    ends = reach * np.linspace(-1, 1, 60)[:, None] * [1, 0]
    angle = np.arctan(reach * 60 / 59 / (9000 - depth / 2))
    views = pp.Views(np.column_stack([ends, np.full(60, 9000.0)]), pp.Panel((24, 700), (2, 1), (-349.5, -23, 0)))
    grid = pp.Grid((121, 4, 4), (depth / 121, 1, 1), (-1.5, -1.5, depth / 242))
    shape = Ellipsoid((0, 0, depth / 2), radius)
    scan = pp.simulate_scan(Phantom([(shape, 0.02)]), views, 1e6, seed=None)
    centre = fbp(pp.Projector(views, grid), Transmission.of(scan), window="ram-lak")[60, 1:3, 1:3].mean()
    assert centre / 0.02 == pytest.approx(2 * angle / np.pi, rel=0.01)


@pytest.mark.parametrize("motion", ["arc", "circular", "rotating"])
def test_it_is_linear_in_the_line_integrals(motion):
    views, rng = MOTIONS[motion], np.random.default_rng(3)
    A = pp.Projector(views, GRID)
    p, q = (rng.normal(0, 1, views.shape).astype(np.float32) for _ in range(2))
    both = fbp(A, of(2 * p - 3 * q))
    apart = 2 * fbp(A, of(p)) - 3 * fbp(A, of(q))
    assert np.abs(both - apart).max() < 1e-5 * np.abs(both).max()


def test_a_shifted_shadow_is_a_shifted_slice():
    """Voxels that cast shadows of one pixel: three pixels on, three voxels on, to twice the projector's tolerance."""
    views = pp.linear_views(panel(80), length=300, height=1000, count=9)
    grid = pp.Grid((1, 40, 40), (4, 0.96, 0.96), (-19.5 * 0.96, -19.5 * 0.96, 40))
    rng, p = np.random.default_rng(1), np.zeros(views.shape, np.float32)
    p[:, 30:50, 30:50] = rng.uniform(0, 1, (9, 20, 20))
    shifted = np.roll(p, (3, -2), (1, 2))
    A = pp.Projector(views, grid)
    one, other = (fbp(A, of(a, np.ones(a.shape))) for a in (p / _cosine(views), shifted / _cosine(views)))
    inner = np.s_[:, 8:-8, 8:-8]
    assert np.abs(np.roll(one, (3, -2), (1, 2)) - other)[inner].max() < 2 * A.tolerance * np.abs(one).max()


def _cosine(views):
    """Of each ray with the vertical: what the weighting undoes."""
    pixels = np.stack(np.meshgrid(*map(np.arange, views.shape[1:]), indexing="ij"), -1).reshape(-1, 2)
    rays = views.panels[0].points(pixels) - views.source[:, None]
    return (-rays[..., 2] / np.linalg.norm(rays, axis=2)).reshape(views.shape).astype(np.float32)


def test_windows_trade_noise_for_sharpness_in_their_order():
    views = MOTIONS["along x"]
    noise = np.random.default_rng(0).normal(0, 0.1, views.shape).astype(np.float32)
    A = pp.Projector(views, GRID)
    spread = {w: fbp(A, of(noise), w).std() for w in WINDOWS}
    order = ["ram-lak", "shepp-logan", "cosine", "hamming", "hann"]
    assert sorted(spread, key=spread.__getitem__, reverse=True) == order
    assert fbp(A, of(noise), "hann", 0.5).std() < 0.6 * spread["hann"]


def test_nothing_beyond_the_cutoff_passes():
    """A wave of half the Nyquist frequency along the motion: gone below, kept above; across the motion never filtered."""
    views = pp.linear_views(panel(128), length=1, height=9000, count=3)
    grid = pp.Grid((1, 64, 64), (40, 1, 1), (-31.5, -31.5, 21))
    A, wave = pp.Projector(views, grid), np.cos(np.pi / 2 * np.arange(128), dtype=np.float32)
    along = np.ascontiguousarray(np.broadcast_to(wave, views.shape))
    across = np.ascontiguousarray(along.transpose(0, 2, 1))
    inner = np.s_[0, 16:48, 16:48]
    kept = {c: np.abs(fbp(A, of(along), "ram-lak", c)[inner]).max() for c in (0.4, 0.6)}
    assert kept[0.4] < 0.02 * kept[0.6]
    assert np.abs(fbp(A, of(across), "ram-lak", 0.4)[inner]).max() == pytest.approx(1 / 40, rel=0.2)


def test_dead_pixels_leave_no_streaks():
    views = MOTIONS["arc"]
    ball = Phantom([(Ellipsoid((0, 0, MIDDLE), 15), 0.02)])
    whole = pp.simulate_scan(ball, views, 1e6, seed=None)
    mask = np.random.default_rng(2).uniform(size=views.shape) > 0.01
    dead = pp.Scan(np.where(mask, whole.counts, 0), 1e6, views, mask=mask)
    A = pp.Projector(views, GRID)
    good, mended = (fbp(A, Transmission.of(scan)) for scan in (whole, dead))
    assert np.isfinite(mended).all()
    careless = pp.Scan(np.where(mask, whole.counts, 1), 1e6, views)
    assert np.abs(mended - good).std() < 0.05 * good.std()
    assert np.abs(fbp(A, Transmission.of(careless)) - good).std() > good.std()


def test_one_view_is_spread_evenly_over_the_depth():
    views = pp.Views([(0, 0, 9000)], panel())
    slab = Phantom([(Box((0, 0, MIDDLE), (400, 400, 40)), 0.02)])
    assert np.abs(made(slab, views) - 0.02).max() < 0.01 * 0.02


def test_windows_and_cutoffs_that_cannot_be_are_refused():
    views = MOTIONS["arc"]
    A, data = pp.Projector(views, GRID), of(np.ones(views.shape, np.float32))
    with pytest.raises(DataError, match="window: there is no 'kaiser'; choose from ram-lak"):
        fbp(A, data, "kaiser")
    for cutoff in (0, -0.5, 1.2, float("nan")):
        with pytest.raises(DataError, match="cutoff: expected a share of the Nyquist frequency"):
            fbp(A, data, "hann", cutoff)
    corner = np.zeros(views.shape, np.float32)
    corner[:, :2, :2] = 1
    with pytest.raises(GeometryError, match="no measured ray meets the grid"):
        fbp(A, of(corner, corner))
