"""A region alone, with what lies around it modelled: analytic solids inside and outside."""

from itertools import islice

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from support.blurred_scans import FWHM, magnifying_scan

import palpate as pp
from palpate.errors import DataError, GeometryError
from palpate.reconstruction.models.likelihood import Transmission, WeightedLeastSquares
from palpate.reconstruction.region_of_interest import average_onto, crop_to_region, reconstruct_full_field
from palpate.scans.analytic_phantoms import Box, Ellipsoid, Intersection, Phantom

PARTS = [
    (Box((0, 0, 26), (76, 76, 32)), 0.02),
    (Ellipsoid((1, -2, 26), 4), 0.015),
    (Ellipsoid((-5, 4, 22), 2.5), 0.02),
    (Ellipsoid((-26, 20, 24), 8), 0.015),
    (Ellipsoid((24, -22, 32), (6, 9, 5)), -0.01),
    (Ellipsoid((22, 18, 18), 5), 0.02),
    (Ellipsoid((-20, -24, 34), 4), 0.03),
    (Box((2, 28, 26), (20, 6, 8)), 0.015),
]
GRID = pp.Grid((16, 80, 80), (2, 1, 1), (-39.5, -39.5, 11))
LOW, HIGH = (-12, -12, 10), (12, 12, 42)
PRIOR = pp.Prior("lange", strength=0.03, edge=0.001)


def views():
    panel = pp.Panel((130, 130), (0.8, 0.8), (-51.6, -51.6, 0))
    return pp.circular_views(panel, radius=250, height=1000, count=8)


@pytest.fixture(scope="module")
def scan():
    return pp.simulate_scan(Phantom(PARTS), views(), incident=20_000, seed=1, background=20)


@pytest.fixture(scope="module")
def region():
    return pp.region_grid(GRID, LOW, HIGH)


def line_integrals(phantom, views):
    pixels = np.stack(np.meshgrid(*map(np.arange, views.shape[1:]), indexing="ij"), -1).reshape(-1, 2)
    ends = [(s, p.points(pixels)) for s, p in zip(views.source, views.panels, strict=True)]
    return np.array([phantom.line_integrals(s, e) for s, e in ends]).reshape(views.shape)


def test_the_region_is_as_good_as_in_the_full_volume(scan, region):
    """The solver is close to linear in the line integrals, so what it makes of their error must be in proportion.

    r: error of the modelled line integrals of what lies outside, over their size, both RMS and against the exact ones.
    Leaving all of them out ruins the region by some amount; the model may do r times that harm, in the region
    against the one cut from the full volume, which has errors of its own.
    """
    options = {"levels": 2, "prior": PRIOR}
    local = pp.local_scan(scan, GRID, region, **options)
    whole, bare = pp.reconstruct(scan, GRID, **options), crop_to_region(scan, region)
    full = whole.values[:, 28:52, 28:52]
    inside, ignored = (pp.reconstruct(s, region, **options).values for s in (local, bare))
    box = Box(np.add(LOW, HIGH) / 2, np.subtract(HIGH, LOW))
    exact = line_integrals(Phantom(PARTS), local.views) - line_integrals(
        Phantom([(Intersection([solid, box]), value) for solid, value in PARTS]), local.views
    )
    modelled = np.log(bare.incident / local.incident)
    sees = pp.Projector(local.views, region)(np.ones(region.shape)) > 0
    r = np.sqrt(((modelled - exact)[sees] ** 2).mean() / (exact[sees] ** 2).mean())
    truth = Phantom(PARTS).volume(region).values
    made = {"local": inside, "ignored": ignored, "full": full}
    wrong = {name: np.linalg.norm(values - truth) for name, values in made.items()}
    assert r < 0.1  # it is a model
    assert np.linalg.norm(inside - full) < r * np.linalg.norm(ignored - full)
    assert wrong["local"] < wrong["full"] + r * wrong["ignored"]
    assert wrong["local"] < 0.1 * wrong["ignored"]


def random_volume(grid, seed=0):
    return pp.Volume(np.random.default_rng(seed).uniform(0, 0.03, grid.shape), grid)


@pytest.mark.parametrize("tilted", [False, True])
def test_the_beam_has_passed_just_what_lies_outside(scan, region, tilted):
    """For a volume on the fine grid: incident · exp(−A f) with f zero in the region, on the window of each view."""
    if tilted:
        panel = scan.views.panels[0]
        turned = pp.rotating_views(panel, [-15, 0, 20], source=(0, 0, 1000), pivot=(0, 0, 26))
        scan = pp.Scan(np.full(turned.shape, 90.0), np.linspace(100, 200, 3), turned, background=3)
    volume = random_volume(GRID)
    local = pp.local_scan(scan, GRID, region, volume)
    emptied = volume.values.copy()
    emptied[:, 28:52, 28:52] = 0
    expected = crop_to_region(scan, region).incident * np.exp(-pp.Projector(local.views, GRID)(emptied))
    np.testing.assert_allclose(local.incident, expected, rtol=3e-3)
    assert (local.background == crop_to_region(scan, region).background).all()


def test_likelihoods_of_the_region_are_those_of_the_rest_of_the_line_integral(scan, region):
    """Counts stay as they were; both likelihoods see log(b/(y − r)) less what lies outside."""
    local, bare = pp.local_scan(scan, GRID, region, random_volume(GRID)), crop_to_region(scan, region)
    outside = np.log(bare.incident / local.incident)
    assert (local.counts == bare.counts).all()
    for kind in (Transmission, WeightedLeastSquares):
        np.testing.assert_allclose(
            kind.of(local).line_integrals, kind.of(bare).line_integrals - outside, rtol=1e-4, atol=1e-5
        )
    assert (WeightedLeastSquares.of(local).weights == WeightedLeastSquares.of(bare).weights).all()


def test_behind_a_blur_the_light_of_the_region_is_that_of_the_whole(region):
    """Against SciPy's Gaussian of the whole's light: exact where light of the region falls, if the volume is as told."""
    views = pp.circular_views(pp.Panel((130, 130), (0.8, 0.8), (-51.6, -51.6, 0)), radius=250, height=1000, count=3)
    scan = pp.Scan(np.full(views.shape, 90.0), np.linspace(100, 200, 3), views, 3, blur=pp.Blur(panel=2.5))
    volume = random_volume(GRID)
    local = pp.local_scan(scan, GRID, region, volume)
    part = pp.Volume(volume.values[:, 28:52, 28:52], region)
    whole = scan.incident * gaussian_filter(
        np.exp(-pp.Projector(views, GRID)(volume.values)), (0, *2 * [2.5 / FWHM / 0.8]), truncate=8
    )
    l = pp.Projector(local.views, region)(part.values)
    mine = local.incident * np.exp(-pp.Blurred.of(local).seen(l))
    sharp = local.incident * np.exp(-l)
    shadow = pp.Projector(local.views, region)(np.ones(region.shape, np.float32)) > 0
    lit = gaussian_filter(shadow.astype(float), (0, *2 * [2.5 / FWHM / 0.8])) > 1e-3
    assert lit.sum() > 1.1 * shadow.sum()
    rows, columns = local.shape[1:]
    for k, (panel, window) in enumerate(zip(views.panels, local.views.panels, strict=True)):
        shift = window.origin - panel.origin
        v, u = np.rint([shift @ panel.row_axis / 0.8, shift @ panel.column_axis / 0.8]).astype(int)
        theirs = whole[k, v : v + rows, u : u + columns][lit[k]]
        np.testing.assert_allclose(mine[k][lit[k]], theirs, rtol=2e-4)
        assert np.abs(sharp[k][lit[k]] / theirs - 1).max() > 0.02  # the blur matters here


def test_behind_a_blur_the_region_is_as_in_the_full_volume():
    """Specks beside and above a speck, through a real focal spot: the model shares nothing with what made the counts."""
    centre = np.array([0.68, 0.44, 0.04])
    specks = [
        (centre, 0.1, 1.0),
        ((-0.9, 0.3, 0.1), 0.25, 1.0),
        ((0.7, -0.9, 0.5), 0.3, 1.0),
        ((0.6, 0.4, 1.3), 0.25, 1.0),
    ]
    scan = magnifying_scan([(np.zeros(3), 2.0, 0.05), *specks], photons=2e4)
    grid = pp.Grid.centred((48, 56, 56), (0.08, 0.08, 0.08))
    region = pp.region_grid(grid, centre - 0.55, centre + 0.55)
    options = {"levels": 2, "prior": pp.Prior("quadratic", strength=0.4), "iterations": 40, "tolerance": 0}
    full = pp.reconstruct(scan, grid, **options)
    known = pp.reconstruct(pp.local_scan(scan, grid, region, full), region, **options).values
    modelled = pp.reconstruct(pp.local_scan(scan, grid, region, **options), region, **options).values
    ignored = pp.reconstruct(crop_to_region(scan, region), region, **options).values
    cut = average_onto(full, region)
    assert np.linalg.norm(known - cut) < 0.1 * np.linalg.norm(cut)
    assert np.linalg.norm(modelled - cut) < 0.04 * np.linalg.norm(ignored - cut)
    z, y, x = region.indices(centre)[0].round().astype(int)
    np.testing.assert_allclose([known[z, y, x], modelled[z, y, x]], cut[z, y, x], rtol=0.1)


def test_the_windows_hold_all_of_the_shadow_and_little_else(scan, region):
    moved = pp.region_grid(GRID, (-35, 20, 14), (-5, 38, 30))  # near a corner: the windows differ from view to view
    for part in (region, moved):
        ones = np.ones(part.shape, np.float32)
        small = crop_to_region(scan, part)
        whole, window = pp.Projector(scan.views, part)(ones), pp.Projector(small.views, part)(ones)
        assert window.sum() == pytest.approx(whole.sum(), rel=1e-5)
        assert np.count_nonzero(window) == np.count_nonzero(whole)
        assert np.count_nonzero(window) > 0.6 * window.size
    corners = {tuple(p.origin) for p in crop_to_region(scan, moved).views.panels}
    assert len(corners) > 1


def test_cut_voxels_are_shared_by_their_parts():
    """The mean over each new cell, against 20³ points in each."""
    coarse = pp.Grid((5, 6, 7), (3, 2, 2), (1, 2, 3))
    volume = random_volume(coarse)
    part = pp.Grid((3, 4, 4), (2.5, 1.5, 1.1), (3.3, 4.1, 6.7))
    made = average_onto(volume, part)
    steps = (np.arange(20) + 0.5) / 20 - 0.5
    fine = pp.Grid(
        np.multiply(part.shape, 20),
        np.divide(part.spacing, 20),
        np.array(part.origin) + np.array(part.spacing[::-1]) * steps[0],
    )
    points = pp.resample(volume, fine, "nearest").values.reshape(3, 20, 4, 20, 4, 20).mean(axis=(1, 3, 5))
    np.testing.assert_allclose(made, points, atol=0.06 * 0.03)
    inside = pp.region_grid(coarse, *coarse.bounds)
    np.testing.assert_allclose(average_onto(volume, inside), volume.values, rtol=1e-5)


def test_what_surrounds_is_coarse_and_may_be_watched(scan):
    steps = list(islice(reconstruct_full_field(scan, GRID, halvings=2, levels=2, prior=PRIOR, iterations=[2, 2]), 4))
    assert [s.level for s in steps] == [1, 1, 0, 0]
    assert steps[-1].volume.grid.spacing == (4, 4, 4)
    np.testing.assert_allclose(steps[-1].volume.grid.bounds, GRID.bounds)
    last = list(reconstruct_full_field(scan, GRID, halvings=9, levels=9, prior=PRIOR, iterations=1))[-1]
    assert last.volume.grid.shape[1:] == (10, 10)


def test_a_region_is_made_of_the_voxels_of_the_grid():
    part = pp.region_grid(GRID, (-12.2, -3, 11), (12.2, 9, 29))
    assert part.spacing == GRID.spacing
    assert part.axis("x")[0] == -11.5
    assert part.axis("x")[-1] == 11.5
    np.testing.assert_allclose(part.bounds, [[-12, -3, 10], [12, 9, 30]])
    assert pp.region_grid(GRID, *GRID.bounds) == GRID


@pytest.mark.parametrize(
    ("low", "high", "told"),
    [
        ((-50, 0, 20), (0, 10, 30), "reaches beyond the grid"),
        ((0, 0, 20), (10, 10, 60), "reaches beyond the grid"),
        ((0, 0, 20), (0.5, 10, 30), "thinner than a voxel"),
        ((10, 0, 20), (0, 10, 30), "thinner than a voxel"),
    ],
)
def test_boxes_that_are_no_region_are_refused(low, high, told):
    with pytest.raises(GeometryError, match=rf"region: .* {told}"):
        pp.region_grid(GRID, low, high)


def test_regions_that_do_not_fit_the_scan_are_refused_before_work(scan, region):
    aside = pp.Grid((4, 8, 8), (2, 1, 1), (36, 0, 20))
    with pytest.raises(GeometryError, match=r"region: .* reaches beyond the grid"):
        pp.local_scan(scan, GRID, aside)
    turned = pp.Grid(region.shape, region.spacing, region.origin, [[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    with pytest.raises(GeometryError, match="different directions"):
        pp.local_scan(scan, GRID, turned)
    far = pp.Grid((4, 300, 300), (2, 1, 1), (-150, -150, 20))
    with pytest.raises(GeometryError, match="its shadow misses every panel"):
        pp.local_scan(scan, far, pp.region_grid(far, (100, 100, 20), (110, 110, 26)))
    with pytest.raises(DataError, match="halvings: expected a whole number of at least 0"):
        pp.local_scan(scan, GRID, region, halvings=-1)
