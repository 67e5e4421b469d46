"""The projector: exact line integrals, an exact transpose, and the symmetries of space."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, reject, settings
from hypothesis import strategies as st
from support.projector_scenes import (
    about_either_axis,
    breast,
    centred,
    circular,
    finer_pixels,
    head,
    long_breast,
    noise,
    several_threads,  # noqa: F401
    skew,
    small,
    turned,
)
from support.reference_projector import projections

import palpate as pp
from palpate import _core
from palpate.errors import GeometryError
from palpate.reconstruction.projector import check_field_of_view

FAST = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])


@pytest.mark.parametrize(
    "case", [circular, breast, long_breast, head, about_either_axis, skew], ids=lambda case: case.__name__
)
def test_exact_line_integrals_of_white_noise(case):
    views, grid, tolerance = case()
    rng = np.random.default_rng(7)
    x = rng.random(grid.shape, dtype=np.float32)
    p = pp.Projector(views, grid)(x)
    for view in sorted({0, 1, len(views) - 1}):
        hit = np.argwhere(p[view] > 0.05 * p[view].max())
        pixels = hit[rng.integers(0, len(hit), 40)]
        exact = projections(x, views, grid, view, pixels)
        error = p[view][tuple(pixels.T)] - exact
        assert np.linalg.norm(exact) > 0
        assert np.linalg.norm(error) <= tolerance * np.linalg.norm(exact), f"view {view}"


@pytest.mark.parametrize(
    ("case", "poses"),
    [
        (circular, {"parallel"}),
        (breast, {"parallel"}),
        (head, {"rotated", "parallel"}),
        (about_either_axis, {"rotated"}),
        (skew, {"oblique"}),
    ],
)
def test_these_cases_take_every_path_through_the_kernels(case, poses):
    views, grid, _ = case()
    geometry = pp.Projector(views, pp.Grid((1, 2, 2), grid.spacing, np.array(grid.origin) + 60)).geometry
    assert {geometry.orientation(view) for view in range(len(views))} == poses


def test_a_finer_tolerance_is_met_by_more_products_of_weights():
    views, grid, _ = circular()
    views = views[1]
    x = np.random.default_rng(3).random(grid.shape, dtype=np.float32)
    pixels = np.random.default_rng(4).integers(200, 300, (80, 2))
    exact = projections(x, views, grid, 0, pixels, within=5e-5)
    products = []
    for tolerance in (1e-2, 1e-3, 2e-4):
        A = pp.Projector(views, grid, tolerance)
        error = A(x)[0][tuple(pixels.T)] - exact
        assert np.linalg.norm(error) <= tolerance * np.linalg.norm(exact)
        products.append(A.geometry.products(0))
    assert products[0] < products[-1]
    assert products == sorted(products)


def test_a_turned_panel_meets_a_finer_tolerance_too():
    views, grid, _ = head()
    views, grid = views[0], pp.Grid((8, 120, 130), grid.spacing, (-100, -30, 20))
    x = np.random.default_rng(3).random(grid.shape, dtype=np.float32)
    products = []
    for tolerance in (1e-2, 2e-3, 5e-4):
        A = pp.Projector(views, grid, tolerance)
        p = A(x)[0]
        hit = np.argwhere(p > 0.7 * p.max())
        pixels = hit[np.random.default_rng(4).integers(0, len(hit), 20)]
        exact = projections(x, views, grid, 0, pixels, within=2e-4)
        assert np.linalg.norm(p[tuple(pixels.T)] - exact) <= tolerance * np.linalg.norm(exact)
        products.append(A.geometry.products(0))
    assert products[0] < products[1] < products[2]
    assert products[2] > 3  # sub-slices, then, and not Gauss points alone


@st.composite
def scenes(draw):
    """One to three views of a small grid that some ray meets; panels parallel or posed anyhow, odd shapes."""
    number = st.floats(-1, 1, allow_nan=False)
    shape = tuple(draw(st.integers(1, 9)) for _ in range(3))
    spacing = tuple(draw(st.sampled_from([0.4, 1.0, 2.7])) for _ in range(3))
    grid = pp.Grid(shape, spacing, -np.array(spacing[::-1]) * (np.array(shape[::-1]) - 1) / 2)
    rows, columns = draw(st.integers(1, 23)), draw(st.integers(1, 23))
    source, panels = [], []
    for _ in range(draw(st.integers(1, 3))):
        source.append((60 * draw(number), 60 * draw(number), 100 + 20 * draw(number)))
        axes = ((0, 1, 0), (1, 0, 0))
        pose = draw(st.sampled_from(["parallel", "rotated", "oblique"]))
        if pose == "rotated":
            axes = turned(0.6 * draw(number), np.pi / 2 * draw(st.integers(0, 3)), np.pi / 2 * draw(st.integers(0, 3)))
        elif pose == "oblique":
            axes = turned(0.6 * draw(number), 3 * draw(number), 3 * draw(number))
        pitch = (draw(st.sampled_from([0.3, 1.0, 2.2])), draw(st.sampled_from([0.3, 1.0, 2.2])))
        middle = -np.array(source[-1]) * 0.4 + [draw(number), draw(number), draw(number)]
        panels.append(centred((rows, columns), pitch, middle, *axes))
    views = pp.Views(source, panels)
    try:
        check_field_of_view(views, grid)
    except GeometryError:  # a single pixel may lie beside the shadow of a single voxel
        reject()
    return views, grid, draw(st.integers(0, 2**31))


@FAST
@given(scenes())
def test_the_transpose_is_exact(scene):
    views, grid, seed = scene
    A = pp.Projector(views, grid)
    rng = np.random.default_rng(seed)
    x = rng.random(A.domain_shape, dtype=np.float32)  # of one sign: a single pixel may cancel to rounding
    y = rng.standard_normal(A.range_shape).astype(np.float32)
    Ax, Aty = A(x).astype(np.float64), A.T(y).astype(np.float64)
    gap = abs(np.vdot(Ax, y.astype(np.float64)) - np.vdot(x.astype(np.float64), Aty))
    assert gap <= 1e-6 * np.linalg.norm(Ax) * np.linalg.norm(y)


@pytest.mark.parametrize("case", [circular, head, skew], ids=lambda case: case.__name__)
def test_the_transpose_is_exact_at_size(case):
    views, grid, _ = case()
    A = pp.Projector(views[:3], grid)
    rng = np.random.default_rng(0)
    x, y = rng.random(A.domain_shape, dtype=np.float32), rng.random(A.range_shape, dtype=np.float32)
    Ax, Aty = A(x).astype(np.float64), A.T(y).astype(np.float64)
    assert np.linalg.norm(Ax) > 0
    assert abs(np.vdot(Ax, y) - np.vdot(x, Aty)) <= 1e-6 * np.linalg.norm(Ax) * np.linalg.norm(y)


def test_the_transpose_of_the_transpose_is_the_projector():
    views, grid, _ = circular()
    A = pp.Projector(views, grid)
    assert A.T.T is A
    assert A.T is A.T
    assert (A.T.domain_shape, A.T.range_shape) == (A.range_shape, A.domain_shape) == ((8, 512, 512), (48, 256, 256))


@FAST
@given(scenes())
def test_a_footprint_is_a_column_of_the_projector(scene):
    views, grid, seed = scene
    A = pp.Projector(views, grid)
    z, y, x = (int(i) for i in np.random.default_rng(seed).integers(0, grid.shape))
    unit = np.zeros(grid.shape, np.float32)
    unit[z, y, x] = 1
    column = np.zeros(A.range_shape)
    pixels, weights = A.geometry.column(z, y, x)
    column.reshape(-1)[pixels] = weights
    np.testing.assert_allclose(A(unit), column, rtol=1e-4, atol=1e-6 * max(1.0, column.max()))


AT_SIZE = [circular, breast, skew, finer_pixels, long_breast]


@pytest.mark.parametrize("case", AT_SIZE, ids=lambda case: case.__name__)
def test_footprints_are_columns_of_the_projector_at_size(case):
    """Of voxels anywhere, corners too: those of A add up to the image of all, and A' gives each its sum over its own."""
    views, grid, _ = case()
    A, rng = pp.Projector(views[:3], grid), np.random.default_rng(5)
    voxels = {tuple(int(i) for i in rng.integers(0, grid.shape)) for _ in range(250)}
    voxels |= {tuple((n - 1) * c for n, c in zip(grid.shape, corner, strict=True)) for corner in np.ndindex(2, 2, 2)}
    x, y = np.zeros(grid.shape, np.float32), rng.random(A.range_shape, dtype=np.float32)
    image, back = np.zeros(A.range_shape), A.T(y)
    for voxel in voxels:
        x[voxel] = 1 + rng.random()
        pixels, weights = A.geometry.column(*voxel)
        image.reshape(-1)[pixels] += float(x[voxel]) * np.asarray(weights, np.float64)
        own = np.asarray(weights, np.float64) @ y.reshape(-1)[pixels]
        assert abs(back[voxel] - own) <= 1e-5 * max(own, grid.spacing[0])
    np.testing.assert_allclose(A(x), image, rtol=1e-4, atol=2e-6 * image.max())


@pytest.mark.parametrize("case", AT_SIZE, ids=lambda case: case.__name__)
def test_sixteen_columns_in_registers_give_what_eight_in_memory_do(case):
    """Where the machine has the wider registers; elsewhere both ways are the same."""
    views, grid, _ = case()
    A, x = pp.Projector(views[:3], grid), noise(grid)
    y = np.random.default_rng(1).random(A.range_shape, dtype=np.float32)
    p, f = A(x), A.T(y)
    _core.projection.allow_avx512_passes(False)
    try:
        np.testing.assert_allclose(A(x), p, rtol=1e-5, atol=1e-5 * p.max())
        np.testing.assert_allclose(A.T(y), f, rtol=1e-5, atol=1e-5 * f.max())
    finally:
        _core.projection.allow_avx512_passes(True)


@pytest.mark.parametrize(
    "axes",
    [((0, 1, 0), (1, 0, 0)), turned(0.35, np.pi / 2, 0), turned(0.35, 0.9, 0.5)],
    ids=["parallel", "rotated", "oblique"],
)
def test_ray_through_a_box_reads_its_chord(axes):
    source = np.array([30.0, -20.0, 120.0])
    middle = np.array([-6.0, 4.0, -24.0])  # on the ray through the origin, where the box is
    views = pp.Views([source], centred((5, 5), (0.2, 0.2), middle, *axes))
    grid = pp.Grid((10, 30, 30), (1, 1, 1), (-14.5, -14.5, -4.5))
    p = pp.Projector(views, grid)(np.full(grid.shape, 0.02))
    chord = 10 * np.linalg.norm(source) / source[2]
    assert p[0, 2, 2] == pytest.approx(0.02 * chord, rel=1e-4)


@pytest.mark.parametrize("height", [1000, 60], ids=["far", "near"])
@pytest.mark.parametrize("axes", [((0, 1, 0), (1, 0, 0)), ((0, -1, 0), (-1, 0, 0)), ((1, 0, 0), (0, 1, 0))])
def test_a_slab_reads_the_length_of_each_ray(height, axes):
    """From near, rays' lengths change much from column to column, from far little; in rows of 150 pixels."""
    row_axis, column_axis = np.array(axes)
    panel = pp.Panel((90, 150), (1, 1), -44.5 * row_axis - 74.5 * column_axis, row_axis, column_axis)
    views = pp.Views([[13.0, -7, height]], panel)
    grid = pp.Grid((4, 220, 220), (1, 1, 1), (-109.5, -109.5, 5))
    A = pp.Projector(views, grid)
    p = A(np.ones(grid.shape, np.float32))[0].astype(float)
    r, c = np.indices(p.shape)
    rays = panel.origin + r[..., None] * row_axis + c[..., None] * column_axis - views.source[0]
    lengths = 4 * np.linalg.norm(rays, axis=-1) / height
    np.testing.assert_allclose(p, lengths, rtol=1 / 6 / height**2 + 1e-6)  # a pixel's mean is not its middle
    x, y = noise(grid), np.random.default_rng(1).random(views.shape, np.float32)
    forward, back = (float((a * b.astype(float)).sum()) for a, b in ((A(x), y), (A.T(y), x)))
    assert forward == pytest.approx(back, rel=1e-6)


def test_it_is_linear():
    views, grid = small()
    A, x, y = pp.Projector(views, grid), noise(grid, 1), noise(grid, 2)
    np.testing.assert_allclose(A(2 * x - 3 * y), 2 * A(x) - 3 * A(y), atol=1e-5)
    assert not A(np.zeros(grid.shape)).any()


def test_rays_beside_the_volume_read_zero():
    views, grid = small(pitch=(4, 4), origin=(-24, -24, 0))
    p = pp.Projector(views, grid)(np.ones(grid.shape))
    low, high = grid.bounds
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    for view, shadow in enumerate(views.project(corners)):
        row, column = np.indices(views.shape[1:])
        beside = np.zeros(views.shape[1:], dtype=bool)
        for index, axis in ((row, 0), (column, 1)):
            beside |= (index + 0.5 < shadow[:, axis].min()) | (index - 0.5 > shadow[:, axis].max())
        assert beside.any()
        assert not p[view][beside].any()
        assert p[view][~beside].any()


def test_a_mirrored_panel_gives_the_flipped_image():
    views, grid = small()
    p = pp.Projector(views, grid)(noise(grid))
    flipped, _ = small(origin=(-8 + 13 * 1.25, -8 + 11 * 1.5, 0), row_axis=(0, -1, 0), column_axis=(-1, 0, 0))
    np.testing.assert_array_equal(pp.Projector(flipped, grid)(noise(grid)), p[:, ::-1, ::-1])
    swapped, _ = small(shape=(14, 12), pitch=(1.25, 1.5), row_axis=(1, 0, 0), column_axis=(0, 1, 0))
    np.testing.assert_array_equal(pp.Projector(swapped, grid)(noise(grid)), p.transpose(0, 2, 1))


def quarter(v):
    """90 degrees about z."""
    return np.stack([-v[..., 1], v[..., 0], v[..., 2]], axis=-1)


def mirror(v):
    return v * np.array([-1, 1, 1])


@pytest.mark.parametrize("pose", [(0, 0, 0), (0.3, 0, 0), (0.3, 0.8, 0.5)], ids=["parallel", "rotated", "oblique"])
@pytest.mark.parametrize(
    ("move", "volume"),
    [
        (quarter, lambda x: x.transpose(0, 2, 1)[:, :, ::-1]),
        (mirror, lambda x: x[:, :, ::-1]),
    ],
    ids=["quarter turn", "mirror"],
)
def test_moving_everything_by_a_symmetry_changes_nothing(pose, move, volume):
    grid = pp.Grid((4, 9, 9), (2, 1, 1), (-4, -4, 3))
    source = np.array([(20.0, -12.0, 90.0), (-9.0, 30.0, 80.0)])
    axes = [np.asarray(axis, dtype=float) for axis in turned(*pose)]
    panel = centred((25, 22), (0.8, 0.7), (-2, 1, -15), *axes)
    moved = pp.Panel(panel.shape, panel.pitch, move(panel.origin), *(move(axis) for axis in axes))
    x = noise(grid)
    p = pp.Projector(pp.Views(source, panel), grid)(x)
    q = pp.Projector(pp.Views(move(source), moved), grid)(volume(x))
    assert np.linalg.norm(q - p) <= (0.02 if pose[1] else 2e-3 if pose[0] else 1e-5) * np.linalg.norm(p)


@pytest.mark.parametrize("tolerance", [3e-3, 1e-3, 3e-4])
def test_whichever_way_a_shadow_moves_along_x_and_y_the_weights_are_as_good(tolerance):
    """Sources far off both axes, in the four directions: mirror images of one another, in what they cost too."""
    grid = pp.Grid((8, 150, 150), (1, 0.1, 0.1), (-7.45, -7.45, 30.5))
    f, kept, costs = noise(grid), [], []
    for x, y in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
        panel = centred((300, 300), (0.13, 0.13), (-13 * x, -9 * y, 0), (0, 1, 0), (1, 0, 0))  # under the grid
        A = pp.Projector(pp.Views([(250 * x, 170 * y, 600)], panel), grid, tolerance)
        kept.append(A(f[:, ::y, ::x])[:, ::y, ::x])
        costs.append(A.geometry.products(0))
    assert costs == [costs[0]] * 4
    assert costs[0] > 1
    for image in kept[1:]:
        assert np.abs(image - kept[0]).max() < 1e-5 * kept[0].max()


@pytest.mark.parametrize("pose", [(0, 0, 0), (0.3, 0, 0), (0.3, 0.8, 0.5)], ids=["parallel", "rotated", "oblique"])
def test_moving_everything_by_a_shift_changes_nothing(pose):
    axes, shift = turned(*pose), np.array([32.0, -16.0, 64.0])
    grid = pp.Grid((4, 9, 9), (2, 1, 1), (-4, -4, 3))
    moved = pp.Grid(grid.shape, grid.spacing, np.array(grid.origin) + shift)
    source = np.array([(20.0, -12.0, 90.0)])
    p = pp.Projector(pp.Views(source, centred((25, 22), (0.8, 0.7), (-2, 1, -15), *axes)), grid)(noise(grid))
    panel = centred((25, 22), (0.8, 0.7), np.array([-2, 1, -15]) + shift, *axes)
    q = pp.Projector(pp.Views(source + shift, panel), moved)(noise(grid))
    np.testing.assert_allclose(q, p, atol=1e-4 * p.max())


def test_a_small_panel_is_a_window_of_a_large_one():
    grid = pp.Grid((6, 40, 40), (1, 1, 1), (-20, -20, 10))
    source, x = [(25, 14, 100)], noise(grid)
    whole = pp.Projector(pp.Views(source, pp.Panel((64, 60), (1, 1), (-36, -34, 0))), grid)(x)
    window = pp.Projector(pp.Views(source, pp.Panel((20, 17), (1, 1), (-36 + 22, -34 + 20, 0))), grid)(x)
    assert whole[0, 20:40, 22:39].all()
    np.testing.assert_allclose(window[0], whole[0, 20:40, 22:39], rtol=1e-5)


def test_voxels_that_no_ray_meets_get_nothing_back():
    grid = pp.Grid((2, 8, 30), (1, 1, 1), (-15, -4, 10))
    A = pp.Projector(pp.Views([(0, 0, 100)], pp.Panel((8, 4), (1, 1), (-1.5, -3.5, 0))), grid)
    back = A.T(np.ones(A.range_shape))
    assert back[:, :, 14:16].all()
    assert not back[:, :, :10].any()


@pytest.mark.parametrize("case", [circular, head, skew], ids=lambda case: case.__name__)
def test_any_number_of_threads_gives_the_same_bits(case):
    views, grid, _ = case()
    views = views[:3]
    grid = pp.Grid((9, *grid.shape[1:]), grid.spacing, grid.origin)
    A = pp.Projector(views, grid)
    x, y = noise(grid), np.random.default_rng(1).random(A.range_shape, dtype=np.float32)
    answers = []
    for threads in (1, 2, 3):
        _core.base.set_threads(threads)
        answers.append((pp.Projector(views, grid)(x), A.T(y)))
    _core.base.set_threads(2)
    for p, f in answers[1:]:
        np.testing.assert_array_equal(p, answers[0][0])
        np.testing.assert_array_equal(f, answers[0][1])
