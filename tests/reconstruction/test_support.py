"""The support: what the hull keeps, and the constrained optimum that every optimizer must reach."""

from itertools import islice

import numpy as np
import pytest
from reconstruction.test_reconstruct import PRIOR, matrix, psi, small
from scipy import ndimage
from scipy.optimize import minimize

import palpate as pp
from palpate import plugins
from palpate.errors import DataError, FileError
from palpate.reconstruction.air_level import air_levels, without_sheet
from palpate.reconstruction.checkpoint import fingerprint, read_checkpoint, write_checkpoint
from palpate.reconstruction.models.likelihood import Transmission
from palpate.reconstruction.multiresolution import coarser_grid, coarser_support
from palpate.reconstruction.optimizers.coordinate_descent import coordinate_descent
from palpate.reconstruction.optimizers.hybrid_descent import hybrid_descent
from palpate.reconstruction.optimizers.memory_gradient import memory_gradient
from palpate.reconstruction.optimizers.ordered_subsets import ordered_subsets
from palpate.reconstruction.optimizers.problem import OUTLINE, Problem
from palpate.reconstruction.support import windows

BETA = 20000.0
WATER = 0.02
GRID = pp.Grid((15, 40, 48), (2, 1, 1), (-23.5, -19.5, 1))


def views(shape=(60, 72), count=9):
    panel = pp.Panel(shape, (1, 1), (-(shape[1] - 1) / 2, -(shape[0] - 1) / 2, 0))
    return pp.arc_views(panel, np.linspace(-25, 25, count), radius=500)


def half_empty(A):
    """A support that cuts through the object, so that the constraint is felt."""
    inside = np.ones(A.domain_shape, np.uint8)
    inside[:, :, :4] = 0
    inside[0, 5:] = 0
    return inside


def pairs_inside(A, inside):
    """Numbers of both voxels and weight ω of all pairs of neighbours within the support, by its definition."""
    number, d, found = np.arange(inside.size).reshape(inside.shape), np.array(A.grid.spacing), []
    for step in np.ndindex(3, 3, 3):
        step = np.array(step) - 1
        if tuple(step) <= (0, 0, 0):
            continue
        here = tuple(slice(max(0, -s), n - max(0, s)) for s, n in zip(step, inside.shape, strict=True))
        there = tuple(slice(max(0, s), n - max(0, -s)) for s, n in zip(step, inside.shape, strict=True))
        both = (inside[here] > 0) & (inside[there] > 0)
        weight = np.full(both.sum(), d.prod() / (np.linalg.norm(step * d) * d.min()))
        found.append((number[here][both], number[there][both], weight))
    return [np.concatenate(column) for column in zip(*found, strict=True)]


def solvers(A, scan, inside, start):
    data = Transmission.of(scan)
    arguments = (A, data, PRIOR, BETA, start)
    return {
        "descent": coordinate_descent(*arguments, "optimal", support=inside),
        "over-relaxed": coordinate_descent(*arguments, "optimal", 1.5, support=inside),
        "momentum": memory_gradient(*arguments, support=inside),
        "subsets": ordered_subsets(*arguments, lambda k: Transmission.of(scan[k]), support=inside),
        "hybrid": hybrid_descent(*arguments, support=inside),
    }


@pytest.fixture(scope="module")
def constrained():
    """Scan, projector, support, and the minimiser over f >= 0, f = 0 outside by SciPy, on float64 matrices."""
    scan, A = small()
    inside = OUTLINE * half_empty(A)
    M, free = matrix(A), inside.ravel() > 0
    y, b, r = (a.ravel().astype(np.float64) for a in (scan.counts, scan.incident, scan.background))
    problem = Problem(A, Transmission.of(scan), PRIOR, BETA, "optimal", inside)
    first, second, weight = pairs_inside(A, inside)

    def value_and_gradient(x):
        """Φ by its definition: pairs with a voxel outside do not count."""
        f = np.zeros(A.grid.size)
        f[free] = x
        l = M @ f
        m = b * np.exp(-l) + r
        value = np.sum(m - y + np.where(y > 0, y * np.log(np.maximum(y, 1) / m), 0))
        slope = M.T @ ((m - r) * (y / m - 1))
        t = f[first] - f[second]
        pull = BETA * weight * t / (1 + np.abs(t) / PRIOR.edge)  # Lange's ψ'
        slope += np.bincount(first, pull, f.size) - np.bincount(second, pull, f.size)
        return value + BETA * (weight * psi(t, PRIOR.edge)).sum(), slope[free]

    found = minimize(
        value_and_gradient, np.full(free.sum(), 0.01), jac=True, bounds=[(0, None)] * int(free.sum()),
        method="L-BFGS-B", options={"maxiter": 2000, "maxfun": 4000, "ftol": 1e-12, "gtol": 1e-3},
    )  # fmt: skip
    return scan, A, inside, problem, found.fun


@pytest.mark.parametrize("name", ["descent", "over-relaxed", "momentum", "subsets", "hybrid"])
def test_every_optimizer_ends_at_the_constrained_optimum(constrained, name):
    """Karush, Kuhn and Tucker: no slope where f > 0, none downwards into f < 0; SciPy's minimum; exact zeros always."""
    scan, A, inside, problem, least = constrained
    start = 0.02 * (inside > 0).astype(np.float32)
    for f, told in islice(solvers(A, scan, inside, start)[name], 300 if "desc" in name or "over" in name else 200):
        assert (f[inside == 0] == 0).all()
        last = told
    assert last == pytest.approx(least, rel=2e-6)
    g, steep = problem.gradient(f), np.abs(problem.gradient(start)).max()
    assert np.abs(g[f > 1e-3 * f.max()]).max() < 2e-3 * steep
    assert g[(f == 0) & (inside > 0)].min() > -2e-3 * steep
    assert g[inside == 0].min() < -0.05 * steep  # the data would fill what the constraint holds


@pytest.mark.filterwarnings("ignore:support")  # the mask cuts the object on purpose
@pytest.mark.parametrize("optimizer", ["auto", "momentum", "descent", "subsets"])
def test_zeros_outside_at_every_iterate_of_every_level(optimizer):
    scan, A = small()
    inside = half_empty(A)
    grid, supports = A.grid, [inside]
    for _ in range(2):
        supports.append(coarser_support(supports[-1], grid))
        grid = coarser_grid(grid)
    steps = list(
        pp.iterates(scan, A.grid, levels=3, iterations=4, optimizer=optimizer, support=inside > 0, tolerance=0)
    )
    assert {step.level for step in steps} == {0, 1, 2}
    for step in steps:
        outside = supports[step.level] == 0
        assert outside.any() or step.level == 2
        assert (step.volume.values[outside] == 0).all()
        assert step.volume.values[~outside].any()


def test_a_coarse_voxel_is_inside_if_any_of_its_fine_voxels_is():
    """By upsampling: each coarse voxel's fine voxels, which the volume's edge may cut off."""
    rng = np.random.default_rng(0)
    for shape, spacing in (((5, 7, 9), (1, 1, 1)), ((3, 8, 5), (4, 1, 1)), ((1, 6, 6), (1, 1, 1))):
        fine = (rng.random(shape) < 0.1).astype(np.uint8)
        grid = pp.Grid(shape, spacing)
        coarse = coarser_support(fine, grid)
        assert coarse.shape == coarser_grid(grid).shape
        step = np.round(np.array(coarser_grid(grid).spacing) / grid.spacing).astype(int)
        for at in np.ndindex(coarse.shape):
            part = tuple(slice(s * i, s * i + s) for s, i in zip(step, at, strict=True))
            assert coarse[at] == fine[part].any()


@pytest.mark.filterwarnings("ignore:support")  # the mask cuts the object on purpose
@pytest.mark.parametrize("optimizer", ["auto", "momentum", "descent", "subsets"])
def test_a_resumed_run_is_the_uninterrupted_one(tmp_path, optimizer):
    scan, A = small()
    options = dict(levels=2, iterations=6, optimizer=optimizer, support=pp.Labels(half_empty(A), A.grid), tolerance=0)
    whole, run = list(pp.iterates(scan, A.grid, **options)), fingerprint(scan, options)
    for stop in (2, 9, 14, 17):
        write_checkpoint(tmp_path / "run.h5", whole[stop - 1], run)
        rest = list(pp.iterates(scan, A.grid, **options, resume=read_checkpoint(tmp_path / "run.h5", run)))
        assert len(rest) == len(whole) - stop
        assert np.array_equal(rest[-1].volume.values, whole[-1].volume.values)
    other = fingerprint(scan, options | {"support": pp.Labels(np.ones(A.domain_shape, int), A.grid)})
    with pytest.raises(FileError, match=r"support was"):
        read_checkpoint(tmp_path / "run.h5", other)


def test_a_support_of_all_voxels_changes_nothing():
    scan, A = small()
    options = dict(levels=2, iterations=5, start="backprojection")
    free = pp.reconstruct(scan, A.grid, **options)
    held = pp.reconstruct(scan, A.grid, **options, support=np.ones(A.domain_shape, bool))
    assert np.array_equal(free.values, held.values)
    assert free.notes == {}
    assert held.notes == {"support": "mask, 100% of the voxels"}


def chord_phantom(*more):
    return pp.Phantom([(pp.Ellipsoid((0, 0, 14), (15, 12, 8)), WATER), *more])


def test_without_noise_the_hull_is_the_voxels_no_ray_through_air_meets():
    """Oracle: straight rays to each voxel's centre, by the phantom's own line integrals."""
    body, scanned = chord_phantom(), views()
    hull = pp.support_hull(pp.simulate_scan(body, scanned, 1e6, seed=None), GRID).values > 0
    z, y, x = np.meshgrid(*(GRID.axis(a) for a in "zyx"), indexing="ij")
    centres = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    air = np.zeros(len(centres), int)
    for source in scanned.source:
        beyond = source + (centres - source) * (source[2] / (source[2] - centres[:, 2:]))  # on the panel
        air += body.line_integrals(source, beyond) == 0
    shadowed = (air < 2).reshape(GRID.shape)
    assert hull[shadowed].all()  # all that the object may be
    grown = shadowed.copy()  # by the three pixels of margin, footprint and voxel
    for _ in range(4):
        grown = np.logical_or.reduce([np.roll(grown, s, a) for a in (1, 2) for s in (-1, 0, 1)])
    assert not hull[~grown].any()
    assert 0.2 < hull.mean() < 0.8


def test_a_large_grid_is_cut_by_cells_that_keep_all_of_the_object(monkeypatch):
    """Cells of 2 x 2 voxels and pixels: nothing of the object is lost, and little more is kept than voxel by voxel."""
    from palpate.reconstruction import support

    scan = pp.simulate_scan(chord_phantom(), views(), 2000, seed=4)
    fine = pp.support_hull(scan, GRID).values > 0
    monkeypatch.setattr(support, "CELLS", 40)
    cells = pp.support_hull(scan, GRID).values > 0
    assert np.array_equal(cells[:, ::2, ::2], cells[:, 1::2, 1::2])
    assert cells[chord_phantom().volume(GRID).values > 0].all()
    assert fine.mean() < cells.mean() < 1.5 * fine.mean()


@pytest.mark.parametrize("seed", [1000, 1001, 1002])
def test_a_fold_of_one_millimetre_of_water_is_kept_at_two_thousand_photons(seed):
    fold = pp.Intersection([pp.Ellipsoid((0, 0, 10), (20, 17, 40)), pp.Box((0, 0, 10), (99, 99, 1))])
    body = chord_phantom((fold, 2 * WATER))
    scan = pp.simulate_scan(body, views(), 2000, seed=seed)
    truly = body.volume(GRID).values > 0.1 * WATER
    with np.errstate(all="raise"):
        hull = pp.support_hull(scan, GRID).values > 0
    assert hull[truly].mean() >= 0.999
    assert hull.mean() < 0.8


def test_noise_alone_is_called_object_as_rarely_as_stated():
    """Of pixels in air, at most the stated share belongs to the shadow before its margin: 5 standard deviations."""
    from palpate.reconstruction.support import FALSE_ALARM, seen_object

    for photons in (40, 2000):
        empty = pp.Phantom([(pp.Ellipsoid((0, 0, 5), 1), 1e-9)])
        scan = pp.simulate_scan(empty, views((300, 300), 1), photons, seed=3, background=0.2 * photons)
        share = seen_object(scan, 0, 0.0).mean()
        assert 0 < share < FALSE_ALARM + 5 * np.sqrt(FALSE_ALARM / 300**2) * windows(photons)[-1]
        assert windows(photons)[-1] > windows(100 * photons)[-1]


def test_a_paddle_is_read_from_the_air_and_leaves_the_object_as_without():
    paddle = pp.Box((0, 0, 40), (400, 400, 3))
    plain, pressed = (pp.simulate_scan(chord_phantom(*more), views(), 2000, seed=5) for more in ((), ((paddle, 0.05),)))
    assert np.abs(air_levels(plain)).max() < 0.005
    assert air_levels(pressed) == pytest.approx(0.15, abs=0.005)
    # Each pixel's expected counts in air, by the phantom of the paddle alone.
    alone = pp.simulate_scan(pp.Phantom([(paddle, 0.05)]), views(), 2000, seed=None)
    assert without_sheet(pressed).incident == pytest.approx(alone.counts, rel=0.005)
    assert without_sheet(plain) is plain
    with_paddle, without = (pp.support_hull(scan, GRID).values for scan in (pressed, plain))
    assert (with_paddle != without).mean() < 0.02
    found = pp.reconstruct(pressed, GRID, support="hull", levels=2, iterations=15)
    truth = chord_phantom().volume(GRID).values
    assert "sheet" in found.notes["support"]
    inside = truth > 0.9 * WATER
    assert found.values[inside].mean() == pytest.approx(
        pp.reconstruct(plain, GRID, support="hull", levels=2, iterations=15).values[inside].mean(), rel=0.02
    )


def test_without_air_nothing_is_cut_and_it_is_said():
    """Thick, the object leaves no air; thin and even, it could be a paddle, and nothing else is seen."""
    for half, words in ((14, "no view shows air"), (5, "air everywhere")):
        covering = pp.Phantom([(pp.Ellipsoid((0, 0, 15), (300, 300, half)), WATER)])
        scan = pp.simulate_scan(covering, views(), 2000, seed=1)
        with pytest.warns(UserWarning, match=words):
            assert pp.support_hull(scan, GRID).values.all()
    with pytest.warns(UserWarning, match="air everywhere"):
        found = pp.reconstruct(scan, GRID, support="hull", levels=1, iterations=5)
    assert np.array_equal(found.values, pp.reconstruct(scan, GRID, levels=1, iterations=5).values)


def test_what_leaves_the_panel_is_kept():
    """A body across two sides of the panel, seen by part of the views only: no voxel of it is cut."""
    body = pp.Phantom([(pp.Ellipsoid((24, -20, 14), (22, 18, 9)), WATER)])
    scan = pp.simulate_scan(body, views((40, 48)), 2000, seed=1)
    hull = pp.support_hull(scan, GRID).values > 0
    assert hull[body.volume(GRID).values > 0.3 * WATER].all()
    assert not hull.all()


def test_a_strong_prior_does_not_draw_the_rim_towards_the_air():
    """Within its own outline an even body comes out even: neighbours in the air do not count."""
    body = pp.Phantom([(pp.Ellipsoid((0, 0, 14), (18, 14, 9)), WATER)])
    scan = pp.simulate_scan(body, views(), 1e5, seed=None)
    inside = body.volume(GRID).values > 0.5 * WATER
    prior = pp.Prior("quadratic", strength=300)
    for support, low, high in ((inside, 0.95, 1.15), ("none", 0.0, 0.9)):
        f = pp.reconstruct(scan, GRID, prior=prior, support=support, levels=2, tolerance=1e-4).values
        rim = inside & (ndimage.distance_transform_edt(inside, sampling=GRID.spacing) <= 2)
        assert low < f[rim].mean() / WATER < high


def test_a_hull_that_would_press_attenuation_from_beyond_into_the_object_is_not_held():
    """Rays along the sweep pass the part of the body that lies beside the grid."""
    body = pp.Phantom([(pp.Ellipsoid((24, 0, 14), (22, 12, 8)), WATER)])
    scan = pp.simulate_scan(body, views(), 2000, seed=1)
    with pytest.warns(UserWarning, match="beyond a side of the grid"):
        held = pp.reconstruct(scan, GRID, support="hull", levels=2, iterations=5)
    assert np.array_equal(held.values, pp.reconstruct(scan, GRID, levels=2, iterations=5).values)


def test_unmeasured_pixels_are_no_air():
    scan = pp.simulate_scan(chord_phantom(), views(), 2000, seed=1)
    mask = np.ones(scan.shape, bool)
    mask[:, :, 50:] = False
    half = pp.Scan(scan.counts, scan.incident, scan.views, scan.background, mask)
    more, hull = (pp.support_hull(s, GRID).values > 0 for s in (half, scan))
    assert more[hull].mean() > 0.999
    assert more[:, :, 40:].mean() > hull[:, :, 40:].mean() + 0.3


@pytest.mark.parametrize(
    ("mask", "words"),
    [
        (np.ones((2, 3, 4)), r"support: expected a mask of shape"),
        (np.zeros(GRID.shape), r"support: the mask is empty"),
        (np.full(GRID.shape, np.nan), r"support: the mask is not finite"),
        (pp.Labels(np.ones(GRID.shape, int), pp.Grid(GRID.shape, (2, 2, 2))), r"support: expected a mask on the grid"),
        ("hul", r"support: there is no 'hul'"),
    ],
)
def test_masks_that_cannot_be_are_refused_before_work(mask, words):
    scan = pp.simulate_scan(chord_phantom(), views(), 2000, seed=1)
    with pytest.raises(DataError, match=words):
        pp.iterates(scan, GRID, support=mask)


def test_a_method_without_constraint_refuses_it():
    scan = pp.simulate_scan(chord_phantom(), views(), 2000, seed=1)
    with pytest.raises(DataError, match="support: of the methods map and ml"):
        pp.iterates(scan, GRID, support="hull", method="sart")


def test_a_mask_beside_the_object_is_warned_of():
    scan = pp.simulate_scan(chord_phantom(), views(), 2000, seed=1)
    beside = np.zeros(GRID.shape, bool)
    beside[:, :, 24:] = True
    with pytest.warns(UserWarning, match="do not meet the mask"):
        pp.iterates(scan, GRID, support=beside)


@pytest.mark.filterwarnings("ignore:support")
def test_a_registered_optimizer_must_hold_the_constraint(monkeypatch):
    class Careless:
        def __init__(self, problem, values, state):
            self.values = values

        def update(self):
            return np.ones_like(self.values), 1.0

        def state(self):
            return {}

    monkeypatch.setitem(plugins._registered["optimizer"], "careless", Careless)
    scan, A = small()
    with pytest.raises(DataError, match="leaves the support"):
        list(pp.iterates(scan, A.grid, levels=1, optimizer="careless", support=half_empty(A)))
