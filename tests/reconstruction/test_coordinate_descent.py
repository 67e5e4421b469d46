"""Coordinate descent against a scalar float64 implementation with a dense matrix (A applied to unit volumes)."""

from itertools import islice

import numpy as np
import pytest

import palpate as pp
from palpate import _core
from palpate.reconstruction.models.likelihood import Transmission
from palpate.reconstruction.optimizers.coordinate_descent import coordinate_descent
from palpate.scans.analytic_phantoms import Box, Ellipsoid, Phantom

GRID = pp.Grid((3, 7, 9), (2.0, 1.0, 1.5), (-6.0, -3.0, 20.0))
PHANTOM = Phantom([(Ellipsoid((0, 0, 22), (5, 2.6, 2.4)), 0.05), (Ellipsoid((2, 0.5, 22), (1.5, 1, 1)), 0.05)])


def level_panel():
    return pp.Panel((12, 14), (0.9, 1.3), (-8.5, -5, 0))


def arc():
    return pp.arc_views(level_panel(), [-20, 0, 15], radius=200, pivot=(0, 0, 20))


def mirrored():
    """Rows along −x, columns along +y: rows and columns change places, one of them mirrored."""
    panel = pp.Panel((14, 12), (1.3, 0.9), (8.5, -5, 0), row_axis=(-1, 0, 0), column_axis=(0, 1, 0))
    return pp.arc_views(panel, [-20, 10], radius=200, pivot=(0, 0, 20))


def oblique():
    """Far off both axes: several sub-slices."""
    return pp.Views([(150, 120, 200), (-100, 130, 220), (0, 0, 200)], pp.Panel((40, 40), (1, 1), (-30, -30, 0)))


def tilted():
    views = pp.rotating_views(level_panel(), [-20, 0, 25], source=(0, 0, 200), pivot=(0, 0, 20), axis=(0.3, 1, 0))
    rolled = pp.rotating_views(level_panel(), [35], source=(0, 0, 200), pivot=(0, 0, 20), axis=(0, 0, 1))
    return pp.Views(np.concatenate([views.source, rolled.source]), [*views.panels, *rolled.panels])


def turned():
    """About y, as on a C-arm; magnification differs by column."""
    return pp.rotating_views(level_panel(), [-25, -10, 20], source=(3, 40, 200), pivot=(0, 0, 20))


def turned_about_x():
    panel = pp.Panel((14, 12), (1.3, 0.9), (-5, -8.5, 0))
    return pp.rotating_views(panel, [-25, 15], source=(30, 3, 200), pivot=(0, 0, 20), axis=(1, 0, 0))


GEOMETRIES = [arc, mirrored, oblique, turned, turned_about_x, tilted]


def dense(A):
    """A as a float64 matrix (pixels, voxels)."""
    matrix = np.empty((np.prod(A.range_shape), np.prod(A.domain_shape)))
    for j in range(matrix.shape[1]):
        unit = np.zeros(matrix.shape[1], np.float32)
        unit[j] = 1
        matrix[:, j] = A(unit.reshape(A.domain_shape)).ravel()
    return matrix


def neighbours(grid):
    """(j, s, ω) of every ordered pair among 26 neighbours, straight from the definition."""
    index = np.arange(grid.size).reshape(grid.shape)
    d = np.array(grid.spacing)
    pairs = []
    for step in np.ndindex(3, 3, 3):
        step = np.array(step) - 1
        if not step.any():
            continue
        weight = d.prod() / (np.linalg.norm(step * d) * d.min())
        for voxel in np.ndindex(*grid.shape):
            other = np.array(voxel) + step
            if (other >= 0).all() and (other < grid.shape).all():
                pairs.append((index[voxel], index[tuple(other)], weight))
    return pairs


def lange(t, edge):
    return edge**2 * (abs(t / edge) - np.log1p(abs(t / edge)))


PART = 64  # voxels along x that the kernel works on at once
ROWS = 8  # rows of a class in a block


def order(grid, slabs, backwards=False):
    """Voxels in the order that the kernel promises: slabs, blocks (even, odd), parts, slices, classes, rows, x."""
    index = np.arange(grid.size).reshape(grid.shape)
    voxels = []
    for begin, end, stride in slabs:
        blocks = [index[begin:end, y : y + ROWS * stride] for y in range(0, grid.shape[1], ROWS * stride)]
        for block in blocks[::2] + blocks[1::2]:
            for x in range(0, grid.shape[2], PART):
                for rows in block:
                    for first in range(stride):
                        voxels.extend(rows[first::stride, x : x + PART].ravel())
    return voxels[::-1] if backwards else voxels


def sweep(matrix, slope, curvature, f, grid, edge, beta, voxels, relaxation=1.0):
    """PS,P,CD voxel by voxel: float64, no footprints."""
    around = {}
    for j, s, weight in neighbours(grid):
        around.setdefault(j, []).append((s, weight))
    f, g = f.copy(), slope.copy()
    for j in voxels:
        a = matrix[:, j]
        t = np.array([f[j] - f[s] for s, _ in around[j]])
        k = np.array([w for _, w in around[j]]) / (1 + abs(t) / edge)
        curve = (a**2 * curvature).sum() + beta * k.sum()
        if curve == 0:
            continue
        new = max(0.0, f[j] - relaxation * ((a * g).sum() + beta * (k * t).sum()) / curve)
        g += a * curvature * (new - f[j])
        f[j] = new
    return f


def problem(views, grid=GRID, **accuracy):
    scan = pp.simulate_scan(PHANTOM, views, incident=5000, seed=3, background=20)
    A = pp.Projector(views, grid, **accuracy)
    f = np.random.default_rng(1).uniform(0, 0.05, grid.shape).astype(np.float32)
    return scan, A, f


def fine_pixels():
    """Pixels a quarter of a voxel's shadow, seen by a source off both axes."""
    return pp.Views([(40, 60, 200), (-30, 0, 200)], pp.Panel((48, 60), (0.23, 0.3), (-9.5, -5.5, 0)))


def coarse_pixels():
    """Several voxels a pixel."""
    return pp.Views([(40, 60, 200), (-30, 0, 200)], pp.Panel((5, 6), (2.7, 3.1), (-8, -6, 0)))


def cut_panel():
    """The shadow runs over three of the panel's edges."""
    return pp.arc_views(pp.Panel((7, 8), (0.9, 1.3), (-3.5, -3.1, 0)), [-20, 0, 25], radius=200, pivot=(0, 0, 20))


def paraboloid(A, slope, curvature):
    data = _core.icd.SurrogateImages(A.geometry)
    data.set_slope(slope)
    data.set_curvature(curvature)
    return data


def one_after_the_other(views, grid, beta, backwards=False, relaxation=1.0, **accuracy):
    """(kernel, oracle, start), flat."""
    scan, A, f = problem(views, grid, **accuracy)
    model = Transmission.of(scan)
    slope, curvature = model.slope(A(f)), model.curvature(A(f), "optimal")
    g, c = slope.ravel().astype(float), curvature.ravel().astype(float)
    voxels = order(grid, _core.icd.slabs(A.geometry), backwards)
    expected = sweep(dense(A), g, c, f.ravel().astype(float), grid, 0.004, beta, voxels, relaxation)
    made = f.copy()
    _core.icd.sweep(paraboloid(A, slope, curvature), made, 2, 0.004, beta, relaxation, backwards)
    return made.ravel(), expected, f.ravel()


@pytest.mark.parametrize("geometry", [*GEOMETRIES, fine_pixels, coarse_pixels, cut_panel])
@pytest.mark.parametrize("beta", [0.0, 3000.0])
def test_rows_by_class_and_thread_are_the_sequential_sweep(geometry, beta):
    made, expected, start = one_after_the_other(geometry(), GRID, beta)
    assert np.abs(expected - start).max() > 0.01  # there was something to do
    assert np.abs(made - expected).max() <= 1e-6 * expected.max()


@pytest.mark.parametrize("geometry", [arc, oblique, turned, tilted])
@pytest.mark.parametrize(("backwards", "relaxation"), [(True, 1.0), (False, 1.6), (True, 0.7)])
def test_reversed_and_relaxed_sweeps_are_sequential_too(geometry, backwards, relaxation):
    made, expected, _ = one_after_the_other(geometry(), GRID, 3000.0, backwards, relaxation)
    assert np.abs(made - expected).max() <= 1e-6 * expected.max()


@pytest.mark.parametrize("geometry", [oblique, turned])
def test_so_are_sweeps_with_many_products_a_slice(geometry):
    products = pp.Projector(geometry(), GRID, tolerance=1e-4).geometry.products
    assert products(0) > 3  # as many as have kernels of their own
    made, expected, _ = one_after_the_other(geometry(), GRID, 3000.0, tolerance=1e-4)
    assert np.abs(made - expected).max() <= 1e-6 * expected.max()


@pytest.mark.parametrize("geometry", [arc, turned, tilted])
@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize(("shape", "spacing"), [((2, 53, 3), (2, 0.15, 4)), ((2, 3, 270), (2, 2.5, 0.05))])
def test_so_are_sweeps_of_several_blocks_and_parts(geometry, backwards, shape, spacing):
    origin = (-spacing[2] * (shape[2] - 1) / 2, -spacing[1] * (shape[1] - 1) / 2, 20.0)
    grid = pp.Grid(shape, spacing, origin)
    made, expected, start = one_after_the_other(geometry(), grid, 3000.0, backwards)
    assert np.abs(expected - start).max() > 0.01
    assert np.abs(made - expected).max() <= 1e-6 * expected.max()


FINE = pp.Grid((2, 19, 45), (1.0, 0.1, 0.1), (-2.2, -0.9, 30.0))


def under(source):
    """Pixels of 0.13 mm, in the shadow of FINE's middle."""
    x, y, z = source
    share = 30.5 / (z - 30.5)
    return pp.Views([source], pp.Panel((36, 66), (0.13, 0.13), (-4.2 - share * x, -2.3 - share * y, 0)))


@pytest.mark.parametrize(
    ("source", "products"), [((260, 0, 600), 1), ((150, -35, 640), 3), ((260, -60, 600), 4), ((260, -120, 600), 6)]
)
@pytest.mark.parametrize("backwards", [False, True])
def test_so_are_sweeps_over_voxels_finer_than_pixels_in_thick_slices(source, products, backwards):
    """Each shares its pixels with many ahead of it, in as many products as the source lies off both axes."""
    views = under(source)
    assert pp.Projector(views, FINE).geometry.products(0) == products
    made, expected, start = one_after_the_other(views, FINE, 3000.0, backwards)
    assert np.abs(expected - start).max() > 0.01
    assert np.abs(made - expected).max() <= 1e-6 * expected.max()


@pytest.mark.parametrize("backwards", [False, True])
def test_so_are_sweeps_over_rows_that_need_fewer_products_than_others(backwards):
    """Those near a source's own y; a strip takes as many as one of its rows needs."""
    grid = pp.Grid((2, 70, 17), (1, 0.3, 0.1), (-0.8, -10.2, 30.0))
    views = [(260, -6, 600), (-200, 3, 640)]
    panels = [
        pp.Panel((66, 40), (0.39, 0.13), (-2.5 - 30.5 / (z - 30.5) * x, -12.6 - 30.5 / (z - 30.5) * y, 0))
        for x, y, z in views
    ]
    scene = pp.Views(views, panels)
    A = pp.Projector(scene, grid, tolerance=1e-3)
    for view in range(2):
        assert {A.geometry.products(view, row) for row in range(70)} == {1, 2}
    made, expected, start = one_after_the_other(scene, grid, 3000.0, backwards, tolerance=1e-3)
    assert np.abs(expected - start).max() > 0.01
    assert np.abs(made - expected).max() <= 1e-6 * expected.max()


def narrow_arc():
    return pp.arc_views(pp.Panel((4, 64), (2.5, 0.1), (-3.2, -4, 0)), [-20, 0, 15], radius=200, pivot=(0, 0, 20))


def narrow_turned():
    panel = pp.Panel((4, 64), (2.5, 0.1), (-3.2, -4, 0))
    return pp.rotating_views(panel, [-25, -10, 20], source=(3, 40, 200), pivot=(0, 0, 20))


@pytest.mark.parametrize("geometry", [narrow_arc, narrow_turned])
@pytest.mark.parametrize("backwards", [False, True])
def test_so_are_sweeps_over_rows_that_reach_far_beyond_the_panel(geometry, backwards):
    """On either side more voxels than are worked on at once have no shadow on the panel."""
    grid = pp.Grid((2, 3, 430), (2, 2.5, 0.1), (-21.5, -2.5, 20.0))
    seen = pp.Projector(geometry(), grid).T(np.ones((3, 4, 64), np.float32))
    assert (seen == 0).sum() > seen.size / 2
    made, expected, start = one_after_the_other(geometry(), grid, 3000.0, backwards)
    assert np.abs(expected - start).max() > 0.01
    assert np.abs(made - expected).max() <= 1e-6 * expected.max()


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_diagonal_is_that_of_the_matrix(geometry):
    scan, A, f = problem(geometry())
    curvature = Transmission.of(scan).curvature(A(f), "precomputed")
    expected = (dense(A) ** 2).T @ curvature.ravel()
    assert expected.max() > 0
    whole = _core.icd.diagonal(A.geometry, curvature)
    np.testing.assert_allclose(whole.ravel(), expected, rtol=1e-4, atol=1e-5 * expected.max())
    np.testing.assert_allclose(_core.icd.diagonal(A.geometry, curvature, 2, 3), whole[1::2, 1::3], rtol=1e-6)


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_rows_of_a_class_share_no_pixel(geometry):
    A = pp.Projector(geometry(), GRID)
    touched = (dense(A) != 0).reshape(-1, *GRID.shape)
    for begin, end, stride in _core.icd.slabs(A.geometry):
        assert stride < GRID.shape[1]  # or nothing is tested
        for z in range(begin, end):
            rows = touched[:, z].any(axis=2)
            for first in range(stride):
                assert rows[:, first::stride].sum(axis=1).max() <= 1


def fine_arc():
    return pp.arc_views(pp.Panel((160, 6), (0.1, 3), (-7.5, -8, 0)), [-20, 0, 15], radius=200, pivot=(0, 0, 20))


def fine_oblique():
    return pp.Views([(150, 120, 200), (-100, 130, 220)], pp.Panel((280, 20), (0.1, 3), (-30, -20, 0)))


@pytest.mark.parametrize("geometry", [fine_arc, fine_oblique])
def test_blocks_of_one_parity_share_no_pixel_in_any_slice_of_a_slab(geometry):
    grid = pp.Grid((12, 60, 2), (0.2, 0.15, 4.0), (-2.0, -4.4, 14.0))
    A = pp.Projector(geometry(), grid)
    touched = (dense(A) != 0).reshape(-1, *grid.shape)
    slabs = _core.icd.slabs(A.geometry)
    assert [0, *(end for _, end, _ in slabs)] == [*(begin for begin, _, _ in slabs), 12]
    assert max(end - begin for begin, end, _ in slabs) > 1
    for begin, end, stride in slabs:
        rows = touched[:, begin:end].any(axis=(1, 3))
        blocks = np.stack([rows[:, y : y + ROWS * stride].any(axis=1) for y in range(0, 60, ROWS * stride)], axis=1)
        assert blocks.shape[1] > 2  # or nothing is tested
        for parity in (0, 1):
            assert blocks[:, parity::2].sum(axis=1).max() <= 1


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_same_bits_for_any_number_of_threads(geometry):
    grid = pp.Grid((4, 25, 11), (1.5, 0.4, 1.2), (-6.0, -4.8, 20.0))
    scan, A, f = problem(geometry(), grid)
    model = Transmission.of(scan)
    slope, curvature = model.slope(A(f)), model.curvature(A(f))
    answers = []
    for n in (1, 2, 5):
        _core.base.set_threads(n)
        made = f.copy()
        for _ in range(3):
            _core.icd.sweep(paraboloid(A, slope, curvature), made, 2, 0.004, 3000.0)
        answers.append(made)
    _core.base.set_threads(0)
    assert np.abs(answers[0] - f).max() > 0.01
    assert (answers[0] == answers[1]).all()
    assert (answers[0] == answers[2]).all()


def test_descent_by_precomputed_curvature_falls_where_its_parabolas_are_too_flat():
    """Behind a body that lets hardly a photon through, from a start of air: the first sweep would go far too far."""
    grid = pp.Grid((3, 6, 7), (2.0, 2.0, 2.0), (-6, -5, 20))
    views = pp.arc_views(pp.Panel((12, 14), (1.4, 1.4), (-9, -8, 0)), [-20, 0, 15], radius=200, pivot=(0, 0, 20))
    scan = pp.simulate_scan(Phantom([(Box((0, 0, 22), (13, 11, 6)), 0.6)]), views, incident=1e4, seed=1)
    A, data = pp.Projector(views, grid), Transmission.of(scan)
    air = np.zeros(grid.shape, np.float32)
    steps = coordinate_descent(A, data, pp.Prior("quadratic", 1.0), 0.0, air, "precomputed")
    objectives = [data.value(A(air)), *(objective for _, objective in islice(steps, 4))]
    assert (np.diff(objectives) < 0).all(), objectives
