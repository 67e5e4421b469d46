"""Views from any side: line integrals, transposes, symmetries of space, and reconstructions."""

import numpy as np
import pytest
from support.projector_scenes import centred, several_threads  # noqa: F401
from support.random_poses import boxes, random_pose
from support.reference_projector import projections

import palpate as pp
from palpate.errors import GeometryError
from palpate.reconstruction.optimizers.coordinate_descent import data_curvature
from palpate.scans.grid_placement import check_grid
from palpate.scans.plausibility import check_geometry

ORBITS = {
    "z": dict(axis=(0, 0, 1)),
    "y": dict(axis=(0, 1, 0)),
    "skew": dict(axis=(1, 2, 3)),
    "laminography": dict(axis=(0, 0, 1), elevation=60),
    "low laminography": dict(axis=(0, 1, 0), elevation=-35),
}
GRID = pp.Grid((12, 14, 16), (2.5, 2, 2), (-13, -11, -16))


def orbit(count=8, parallel=False, **where):
    """No ray runs along a face of voxels."""
    where = {"count": count, "start": 7, **where}
    if parallel:
        return pp.parallel_views((46, 48), (1.25, 1.3), centre_to_panel=60, **where)
    return pp.orbit_views((40, 44), (2, 2), source_to_centre=160, source_to_panel=220, **where)


@pytest.mark.parametrize("seed", range(30))
def test_line_integrals_and_the_transpose_from_a_random_place(seed):
    views, grid = random_pose(seed)
    A = pp.Projector(views, grid, tolerance=2e-3)
    rng = np.random.default_rng(seed)
    x, y = boxes(grid, seed), rng.standard_normal(A.range_shape).astype(np.float32)
    p = A(x)
    pixels = np.argwhere(p[0] > 0.05 * p.max())
    pixels = pixels[rng.integers(0, len(pixels), 40)]
    exact = projections(x, views, grid, 0, pixels)
    error = p[0][tuple(pixels.T)] - exact
    assert np.linalg.norm(exact) > 0
    assert np.linalg.norm(error) <= 1e-2 * np.linalg.norm(exact)  # that of `skew` in test_projector.py
    gap = abs(np.vdot(p.astype(np.float64), y) - np.vdot(x.astype(np.float64), A.T(y)))
    assert gap <= 1e-6 * np.linalg.norm(p) * np.linalg.norm(y)


@pytest.mark.parametrize("parallel", [False, True], ids=["cone", "parallel"])
@pytest.mark.parametrize("where", ORBITS.values(), ids=ORBITS)
def test_an_orbit_has_exact_line_integrals_and_an_exact_transpose(where, parallel):
    # Parallel rays that lie in planes between rows of voxels would never let the oracle settle.
    views = orbit(parallel=parallel, **({"elevation": 4} | where if parallel else where))
    A, rng = pp.Projector(views, GRID, tolerance=2e-3), np.random.default_rng(3)
    x, y = rng.random(GRID.shape, np.float32), rng.standard_normal(A.range_shape).astype(np.float32)
    p = A(x)
    for view in (0, 3, 5):
        hit = np.argwhere(p[view] > 0.1 * p.max())
        pixels = hit[rng.integers(0, len(hit), 40)]
        exact = projections(x, views, GRID, view, pixels)
        assert np.linalg.norm(p[view][tuple(pixels.T)] - exact) <= 7e-3 * np.linalg.norm(exact)
    gap = abs(np.vdot(p.astype(np.float64), y) - np.vdot(x.astype(np.float64), A.T(y)))
    assert gap <= 1e-6 * np.linalg.norm(p) * np.linalg.norm(y)


def test_views_that_are_not_above_are_projected_along_the_axis_they_look_along():
    views = orbit(4, axis=(0, 1, 0), start=0)
    found = {(s.axis, s.below): s.views for s in pp.Projector(views, GRID).slicings}
    assert found == {(0, False): [0], (2, True): [1], (0, True): [2], (2, False): [3]}


def test_a_turned_volume_is_a_turned_scan():
    """Axes exchanged and reversed in both volume and views leave the projections as they were."""
    views, x = orbit(5, axis=(0, 0, 1)), np.random.default_rng(1).random((10, 12, 14), np.float32)
    p = pp.Projector(views, pp.Grid(x.shape, (1.5, 1.5, 1.5), (-9.75, -8.25, -6.75)), 2e-3)(x)
    turn = np.array([[0, 0, -1.0], [1, 0, 0], [0, -1, 0]])  # x, y, z -> y, -z, -x
    panels = [
        pp.Panel(v.shape, v.pitch, turn @ v.origin, turn @ v.row_axis, turn @ v.column_axis) for v in views.panels
    ]
    turned = pp.Views(views.source @ turn.T, panels)
    moved = np.ascontiguousarray(x[::-1, ::-1].transpose(1, 2, 0))
    q = pp.Projector(turned, pp.Grid(moved.shape, (1.5, 1.5, 1.5), (-6.75, -9.75, -8.25)), 2e-3)(moved)
    assert np.linalg.norm(q - p) < 5e-3 * np.linalg.norm(p)


def test_a_parallel_beam_does_not_magnify():
    views = pp.parallel_views((30, 30), (1, 1), centre_to_panel=50, count=6, axis=(1, 2, 3), elevation=20)
    points = np.random.default_rng(0).uniform(-9, 9, (5, 3))
    for view, (source, panel) in enumerate(zip(views.source, views.panels, strict=True)):
        ray = source / np.linalg.norm(source)
        here, along = views.project(points)[view], views.project(points + 30 * ray)[view]
        np.testing.assert_allclose(along, here, atol=1e-4)
        flat = points @ np.stack([panel.row_axis, panel.column_axis], axis=1)
        np.testing.assert_allclose(here, flat + 14.5, atol=1e-4)


def test_the_datas_curvature_adds_up_over_the_sides_that_are_looked_from():
    """Σ a² c of single voxels, by columns of A."""
    views = orbit(6, axis=(1, 1, 1))
    A = pp.Projector(views, GRID)
    scan = pp.Scan(np.full(views.shape, 500.0), 1000, views)
    found = data_curvature(A, pp.Transmission.of(scan))
    assert found.shape == (12, 14, 16)  # so few are all sampled, but every second slice of 16 would not be
    for z, y, x in [(0, 0, 0), (5, 7, 3), (11, 2, 15)]:
        unit = np.zeros(GRID.shape, np.float32)
        unit[z, y, x] = 1
        assert found[z, y, x] == pytest.approx(500 * float((A(unit).astype(np.float64) ** 2).sum()), rel=1e-3)


def test_sampled_curvature_of_a_large_grid_is_of_the_same_voxels():
    grid = pp.Grid((20, 140, 18), (1, 0.2, 1), (-8.5, -13.9, -9.5))
    scan = pp.Scan(np.full((6, 40, 44), 500.0), 1000, orbit(6, axis=(1, 1, 1)))
    A = pp.Projector(scan.views, grid)
    found = data_curvature(A, pp.Transmission.of(scan))
    assert found.shape[0] < 20
    assert found.shape[1] < 140
    for k, j, i in [(0, 3, 4), (found.shape[0] - 1, found.shape[1] - 2, 9)]:
        unit = np.zeros(grid.shape, np.float32)
        unit[2 // 2 + 2 * k, 2 // 2 + 2 * j, i] = 1
        assert found[k, j, i] == pytest.approx(500 * float((A(unit).astype(np.float64) ** 2).sum()), rel=1e-3)


BALLS = pp.Phantom([(pp.Ellipsoid((0, 0, 0), (17, 13, 15)), 0.02), (pp.Ellipsoid((6, -3, 4), (4, 4, 4)), 0.02)])


@pytest.mark.parametrize("parallel", [False, True], ids=["cone", "parallel"])
def test_the_default_reconstructs_a_full_orbit_of_known_ellipsoids(parallel):
    views = orbit(24, parallel=parallel, axis=(0, 1, 0))
    scan = pp.simulate_scan(BALLS, views, incident=1e5, seed=2)
    grid = pp.covering_grid(views, None, spacing=2)
    assert (grid.bounds[0] < (-17, -13, -15)).all()
    assert (grid.bounds[1] > (17, 13, 15)).all()
    truth = BALLS.volume(grid).values
    found = pp.reconstruct(scan, grid)
    assert pp.nmse(found.values, truth) < 0.02
    assert not check_geometry(views)
    assert not check_grid(views, grid)


def test_a_lateral_view_tells_the_depth_that_a_short_arc_cannot():
    panel = centred((40, 44), (2, 2), (0, 0, -60), (0, 1, 0), (1, 0, 0))
    arc = pp.rotating_views(panel, [-8, -4, 0, 4, 8], source=(0, 0, 160))
    lateral = pp.rotating_views(panel, [-8, -4, 0, 4, 8, 86, 90, 94], source=(0, 0, 160))
    grid = pp.Grid((24, 24, 28), (1.5, 1.5, 1.5), (-20.25, -17.25, -17.25))
    truth = BALLS.volume(grid).values
    errors = [
        pp.nmse(pp.reconstruct(pp.simulate_scan(BALLS, views, 1e5, seed=1), grid).values, truth)
        for views in (arc, lateral)
    ]
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.parametrize("options", [dict(method="fbp"), dict(optimizer="descent")], ids=["fbp", "descent"])
def test_what_needs_views_from_above_says_so_before_any_work(options):
    scan = pp.simulate_scan(BALLS, orbit(8), 1e4)
    with pytest.raises(GeometryError, match=r"focal spots above the slices only.*momentum"):
        pp.iterates(scan, GRID, **options)


@pytest.mark.parametrize(
    "options",
    [
        dict(method="sart"),
        dict(method="sirt"),
        dict(method="tv"),
        dict(optimizer="subsets"),
        dict(optimizer="momentum"),
    ],
    ids=str,
)
def test_every_other_method_lowers_its_objective_on_an_orbit(options):
    scan = pp.simulate_scan(BALLS, orbit(16, axis=(0, 1, 0)), 1e4)
    steps = list(pp.iterates(scan, GRID, levels=1, iterations=3, **options))
    assert steps[-1].objective < steps[0].objective


def test_a_region_of_an_orbit_is_reconstructed():
    scan = pp.simulate_scan(BALLS, orbit(24, axis=(0, 1, 0)), 1e5, seed=None)
    region = pp.region_grid(GRID, low=(-5, -5, -5), high=(11, 9, 10))
    part = pp.local_scan(scan, GRID, region)
    found = pp.reconstruct(part, region, levels=1)
    assert pp.nmse(found.values, BALLS.volume(region).values) < 0.02


def test_geometries_with_a_spot_far_away_are_parallel_or_wrong():
    panel = centred((40, 44), (2, 2), (0, 0, -60), (0, 1, 0), (1, 0, 0))
    with pytest.raises(GeometryError, match="check the units"):
        pp.Views([(0, 0, 6e5)], panel)
    assert pp.Views([(0, 0, 600), (0, 0, 5e8)], panel).parallel.tolist() == [False, True]
