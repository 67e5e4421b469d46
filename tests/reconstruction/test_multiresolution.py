import numpy as np
import pytest

import palpate as pp
from palpate.errors import DataError, GeometryError
from palpate.reconstruction.multiresolution import coarser_grid, coarser_panel, coarser_scan, default_levels, pyramid
from palpate.scans.analytic_phantoms import Ellipsoid, Phantom

PANEL = pp.Panel((21, 30), (0.8, 1.0), (-14.5, -8, 0))
VIEWS = pp.arc_views(PANEL, [-15, 0, 20], radius=300, pivot=(0, 0, 20))


def flat(counts, incident=100.0, background=0.0, mask=None):
    return pp.Scan(counts, incident, VIEWS, background, mask)


def test_summed_counts_stay_poisson():
    """Mean, variance and third moment of sums of Poisson counts are all equal to the summed mean."""
    rng = np.random.default_rng(4)
    panel = pp.Panel((200, 200), (1, 1), (-100, -100, 0))
    views = pp.Views([(0, 0, 1000)] * 8, panel)
    coarse = coarser_scan(pp.Scan(rng.poisson(7, views.shape), 20, views, background=1))
    y = coarse.counts.astype(np.float64)
    n = y.size
    assert y.mean() == pytest.approx(28, abs=5 * np.sqrt(28 / n))
    assert y.var() == pytest.approx(28, abs=5 * 28 * np.sqrt(2 / n))
    assert ((y - y.mean()) ** 3).mean() == pytest.approx(28, abs=5 * np.sqrt(15 / n) * 28**1.5)
    assert (coarse.incident == 80).all()
    assert (coarse.background == 4).all()


def test_mean_of_four_is_not_poisson():
    rng = np.random.default_rng(4)
    coarse = coarser_scan(flat(rng.poisson(20, VIEWS.shape)), "linear")
    full = coarse.counts[:, :-1]  # the last row had an odd one
    assert full.mean() == pytest.approx(20, rel=0.05)
    assert full.var() < 0.5 * full.mean()


def test_only_measured_pixels_count_and_half_must_be():
    counts = np.arange(np.prod(VIEWS.shape), dtype=float).reshape(VIEWS.shape) % 7
    mask = np.ones(VIEWS.shape, bool)
    mask[0, 0, 0] = mask[1, 0, :2] = mask[2, :2, 0] = mask[2, 0, 1] = False
    counts[0, 0, 0] = 1e6
    coarse = coarser_scan(flat(counts, mask=mask))
    assert coarse.counts[0, 0, 0] == counts[0, 0, 1] + counts[0, 1, 0] + counts[0, 1, 1]
    assert coarse.incident[0, 0, 0] == 300
    assert coarse.mask[0, 0, 0]
    assert coarse.mask[1, 0, 0]
    assert not coarse.mask[2, 0, 0]
    assert coarse.shape == (3, 11, 15)
    assert coarse.mask[:, -1, 1:].all()  # two of four, the other two are padding
    assert (coarse.incident[:, -1, 3] == 200).all()


@pytest.mark.parametrize("downsample", ["sum", "linear", "nearest", "median"])
@pytest.mark.parametrize("shape", [(20, 30), (21, 30), (7, 5)])
@pytest.mark.parametrize("measured", [1.0, 0.7])
def test_one_number_a_view_is_made_coarser_as_the_whole_array_is(shape, measured, downsample):
    """Each fine pixel by itself, in a loop: what of four is measured, its sum, its mean, its median, or the first."""
    rng = np.random.default_rng(1)
    views = pp.Views([(0, 0, 1000)] * 2, pp.Panel(shape, (1, 1), (0, 0, 0)))
    mask, incident = rng.random(views.shape) < measured, np.array([50.0, 80.0])
    counts = rng.integers(0, 40, views.shape).astype(np.float32)
    whole = np.broadcast_to(incident[:, None, None], views.shape).copy()
    few, all_of_them = (coarser_scan(pp.Scan(counts, b, views, 0.5, mask), downsample) for b in (incident, whole))
    for name in ("counts", "incident", "background", "mask"):
        np.testing.assert_array_equal(getattr(few, name), getattr(all_of_them, name))
    how = {"sum": np.sum, "linear": np.mean, "median": np.median, "nearest": lambda four: four[0]}[downsample]
    for k, r, c in np.ndindex(few.shape):
        block = np.s_[k, 2 * r : 2 * r + 2, 2 * c : 2 * c + 2]
        there = np.array([True]) if downsample == "nearest" else mask[block].ravel()
        if few.mask[k, r, c]:
            four = counts[block].ravel()[: there.size][there]
            assert few.counts[k, r, c] == pytest.approx(how(four), rel=1e-6)


@pytest.mark.parametrize("rotated", [False, True])
def test_coarse_pixels_lie_in_the_middle_of_their_fine_ones(rotated):
    panel = pp.Panel((4, 6), (0.5, 0.7), (3, 2, 1), (0.6, 0, 0.8), (0, 1, 0)) if rotated else PANEL
    coarse = coarser_panel(panel)
    fine = panel.points([(2, 4), (2, 5), (3, 4), (3, 5)]).mean(axis=0)
    np.testing.assert_allclose(coarse.points((1, 2))[0], fine, atol=1e-12)
    np.testing.assert_allclose(coarser_panel(panel, "nearest").points((1, 2)), panel.points((2, 4)), atol=1e-12)


def test_coarse_cells_fill_the_same_box():
    grid = pp.Grid((6, 8, 10), (0.5, 1, 1), (5, 6, 7))
    coarse = coarser_grid(grid)
    assert coarse.shape == (3, 4, 5)
    np.testing.assert_allclose(coarse.bounds, grid.bounds)
    thick = coarser_grid(pp.Grid((6, 8, 10), (4, 1, 1), (0, 0, 0)))
    assert thick.shape == (6, 4, 5)
    odd = coarser_grid(pp.Grid((6, 7, 9), (4, 1, 1), (0, 0, 0)))
    assert odd.shape == (6, 4, 5)
    assert (odd.bounds[0] == (-0.5, -0.5, -2)).all()


@pytest.mark.parametrize("downsample", ["sum", "linear", "nearest", "median"])
def test_the_coarse_scan_is_of_the_same_object(downsample):
    """Coarse line integrals of an analytic ellipsoid are those simulated on the coarse panel; half a pixel off is seen."""
    ball = Phantom([(Ellipsoid((2, 1, 20), (8, 5, 6)), 0.02)])
    panel = pp.Panel((40, 60), (0.5, 0.5), (-14.75, -9.75, 0))
    views = pp.arc_views(panel, [-15, 20], radius=300, pivot=(0, 0, 20))
    fine = pp.simulate_scan(ball, views, 1e6, seed=None, subrays=2)
    coarse = coarser_scan(fine, downsample)
    truth = pp.simulate_scan(ball, coarse.views, 1e6, seed=None, subrays=4)
    p, q = (-np.log(s.counts / s.incident) for s in (coarse, truth))
    off = pp.simulate_scan(ball, views, 1e6, seed=None)[:].counts[:, 1::2, 1::2]
    wrong = np.abs(-np.log(off / 1e6) - q).mean()
    assert np.abs(p - q).mean() < 0.25 * wrong


def test_levels_that_cannot_be_are_refused():
    scan, grid = flat(np.ones(VIEWS.shape)), pp.Grid((4, 8, 8), (1, 1, 1), (-3.5, -3.5, 10))
    with pytest.raises(DataError, match=r"levels: 9 would halve 8 voxels or pixels 8 times; take at most 4"):
        pyramid(scan, grid, 9)
    with pytest.raises(DataError, match="downsample: there is no 'mode'; choose from sum"):
        pyramid(scan, grid, 2, "mode")
    mask = np.zeros(VIEWS.shape, bool)
    mask[:, 0, 0] = True
    with pytest.raises(DataError, match="take fewer levels"):
        pyramid(flat(np.ones(VIEWS.shape), mask=mask), grid, 2)


@pytest.mark.parametrize(
    ("pixels", "side", "measured", "levels"),
    [
        (400, 255, 400, 3),
        (400, 256, 400, 3),  # 64 on the coarsest
        (400, 511, 400, 3),
        (400, 512, 400, 4),
        (400, 1996, 400, 5),
        (400, 40, 400, 3),
        (400, 3, 400, 2),
        (2, 40, 2, 2),
        (400, 1996, 5, 3),
        (400, 1996, 1, 1),
    ],
)
def test_as_many_levels_as_the_size_asks_for(pixels, side, measured, levels):
    """And the pyramid can be made, where rows are masked too."""
    panel = pp.Panel((pixels, pixels), (1, 1), (0, 0, 0))
    mask = np.zeros((1, pixels, pixels), bool)
    mask[:, pixels - measured :] = True
    scan = pp.Scan(np.ones(mask.shape), 100.0, pp.Views([[200, 200, 900]], panel), 0, mask)
    grid = pp.Grid((1, side, side + 1), (1, 0.1, 0.1), (0, 0, 10))
    assert default_levels(scan, grid) == levels
    assert pyramid(scan, grid, levels)[-1][0].mask.any()


def test_linear_interpolation_keeps_what_is_linear():
    coarse = pp.Grid((4, 5, 6), (2, 2, 2), (1, 1, 1))
    fine = pp.Grid((8, 10, 12), (1, 1, 1), (0.5, 0.5, 0.5))
    z, y, x = np.meshgrid(*(coarse.axis(a) for a in "zyx"), indexing="ij")
    values = 1 + 2 * x - y + 0.5 * z
    made = pp.resample(pp.Volume(values, coarse), fine).values
    z, y, x = np.meshgrid(*(fine.axis(a) for a in "zyx"), indexing="ij")
    inside = np.s_[1:-1, 1:-1, 1:-1]
    np.testing.assert_allclose(made[inside], (1 + 2 * x - y + 0.5 * z)[inside], rtol=1e-6)
    assert made.min() == values.min()  # the outermost value is held, not continued
    assert made.max() == values.max()


def test_nearest_repeats_cells_and_median_drops_a_lone_one():
    coarse = pp.Grid((2, 3, 3), (2, 2, 2), (1, 1, 1))
    fine = pp.Grid((4, 12, 12), (1, 0.5, 0.5), (0.25, 0.25, 0.5))
    values = np.zeros((2, 3, 3))
    values[0, 1, 1] = 5
    near = pp.resample(pp.Volume(values, coarse), fine, "nearest").values
    assert (near[:2, 4:8, 4:8] == 5).all()
    assert near.sum() == 5 * 2 * 16
    same = pp.Grid(coarse.shape, coarse.spacing, coarse.origin)
    assert pp.resample(pp.Volume(values, coarse), same, "median").values.max() == 0


def test_outside_the_box_is_zero_and_turned_grids_are_refused():
    grid = pp.Grid((2, 2, 2), (1, 1, 1), (0, 0, 0))
    ones = pp.Volume(np.ones((2, 2, 2)), grid)
    beyond = pp.resample(ones, pp.Grid((2, 2, 4), (1, 1, 1), (-1, 0, 0))).values
    assert (beyond == [0, 1, 1, 0]).all()
    turned = pp.Grid((2, 2, 2), (1, 1, 1), (0, 0, 0), [[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    with pytest.raises(GeometryError, match="different directions"):
        pp.resample(ones, turned)
    with pytest.raises(DataError, match="interpolation: there is no 'cubic'; choose from linear"):
        pp.resample(ones, grid, "cubic")
