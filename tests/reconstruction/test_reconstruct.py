"""Reconstructions of scans that never came from our projector: analytic solids, rays averaged over each pixel."""

from itertools import islice

import numpy as np
import pytest

import palpate as pp
from palpate.errors import DataError, FileError, GeometryError
from palpate.reconstruction.checkpoint import fingerprint, read_checkpoint, with_checkpoints, write_checkpoint
from palpate.reconstruction.models.likelihood import Transmission
from palpate.reconstruction.optimizers.coordinate_descent import coordinate_descent, data_curvature
from palpate.reconstruction.prior_parameters import choose_prior_parameters
from palpate.scans.analytic_phantoms import Ellipsoid, Phantom

BODY = Phantom([(Ellipsoid((0, 0, 24), (17, 13, 8)), 0.02), (Ellipsoid((5, 2, 24), 4), 0.02)])
GRID = pp.Grid((10, 32, 40), (2, 1, 1), (-19.5, -15.5, 15))
PRIOR = pp.Prior("lange", strength=0.3, edge=0.002)


def arc(shape=(44, 60)):
    panel = pp.Panel(shape, (1, 1), (-(shape[1] - 1) / 2, -(shape[0] - 1) / 2, 0))
    return pp.arc_views(panel, np.linspace(-25, 25, 7), radius=500, pivot=(0, 0, 24))


@pytest.fixture(scope="module")
def scan():
    return pp.simulate_scan(BODY, arc(), incident=5000, seed=2, background=30)


def psi(t, edge):
    t = np.abs(t) / edge
    return edge**2 * (t - np.log1p(t))


def objective(A, scan, f, prior, beta):
    """Φ in float64: line integrals by a dense float64 product, likelihood and prior from their definitions."""
    l = matrix(A) @ f.ravel().astype(np.float64)
    y, b, r = (a.ravel().astype(np.float64) for a in (scan.counts, scan.incident, scan.background))
    m = b * np.exp(-l) + r
    total = np.sum((m - y + np.where(y > 0, y * np.log(np.maximum(y, 1) / m), 0))[scan.mask.ravel()])
    f, d = f.astype(np.float64), np.array(A.grid.spacing)
    for step in np.ndindex(3, 3, 3):
        step = np.array(step) - 1
        if tuple(step) <= (0, 0, 0):
            continue
        here = tuple(slice(max(0, -s), n - max(0, s)) for s, n in zip(step, f.shape, strict=True))
        there = tuple(slice(max(0, s), n - max(0, -s)) for s, n in zip(step, f.shape, strict=True))
        weight = d.prod() / (np.linalg.norm(step * d) * d.min())
        total += beta * weight * psi(f[here] - f[there], prior.edge).sum()
    return total


_matrices: dict = {}


def matrix(A):
    if id(A) not in _matrices:
        dense = np.empty((np.prod(A.range_shape), A.grid.size), np.float32)
        for j in range(A.grid.size):
            unit = np.zeros(A.grid.size, np.float32)
            unit[j] = 1
            dense[:, j] = A(unit.reshape(A.domain_shape)).ravel()
        _matrices[id(A)] = (A, dense.astype(np.float64))
    return _matrices[id(A)][1]


def small():
    """A problem whose matrix fits: 4 x 10 x 12 voxels."""
    grid = pp.Grid((4, 10, 12), (4, 3, 3), (-16.5, -13.5, 18))
    views = arc((22, 30))
    panels = [pp.Panel(p.shape, (2, 2), (-29, -21, 0)) for p in views.panels]
    views = pp.Views(views.source, panels)
    scan = pp.simulate_scan(BODY, views, incident=3000, seed=5, background=10)
    return scan, pp.Projector(views, grid)


@pytest.mark.parametrize("kind", ["optimal", "maximum", "precomputed"])
@pytest.mark.parametrize("relaxation", [1.0, 1.6])
def test_descent_never_raises_the_objective(kind, relaxation):
    scan, A = small()
    start = np.random.default_rng(0).uniform(0, 0.2, A.domain_shape).astype(np.float32)
    beta = 20000.0
    values = [objective(A, scan, start, PRIOR, beta)]
    steps = coordinate_descent(A, Transmission.of(scan), PRIOR, beta, start, kind, relaxation)
    for _, (f, told) in zip(range(40), steps, strict=False):
        values.append(objective(A, scan, f, PRIOR, beta))
        assert told == pytest.approx(values[-1], rel=1e-5)
    assert values[-1] < 0.2 * values[0]
    assert (np.diff(values) <= 2e-6 * values[-1]).all()  # the volume is stored in float32


def test_all_curvatures_reach_the_same_minimiser():
    """And a minimiser it is: no voxel's slope points down, save at 0 (float64, dense matrix, central differences)."""
    scan, A = small()
    beta, ends = 20000.0, {}
    for kind in ("optimal", "maximum", "precomputed"):
        steps = coordinate_descent(
            A, Transmission.of(scan), PRIOR, beta, np.full(A.domain_shape, 0.02, np.float32), kind
        )
        f, _ = next(islice(steps, 1499, None))
        ends[kind] = f.copy()
    values = {kind: objective(A, scan, f, PRIOR, beta) for kind, f in ends.items()}
    assert values["maximum"] == pytest.approx(values["optimal"], rel=1e-6)
    assert values["precomputed"] == pytest.approx(values["optimal"], rel=1e-6)
    for kind in ("maximum", "precomputed"):
        assert np.abs(ends[kind] - ends["optimal"]).max() < 2e-3 * ends["optimal"].max()
    f, step = ends["optimal"], 1e-4
    here = values["optimal"]
    for voxel in [(0, 0, 0), (1, 5, 6), (2, 4, 3), (3, 9, 11), (2, 6, 8)]:
        for sign in (-1, 1):
            moved = f.astype(np.float64)
            moved[voxel] = max(0, moved[voxel] + sign * step)
            assert objective(A, scan, moved, PRIOR, beta) >= here - 1e-7 * here


def last(steps):
    *_, step = steps
    return step


def test_one_and_three_levels_end_at_the_same_objective(scan):
    options = {"prior": PRIOR, "tolerance": 1e-6, "iterations": 400}
    one, three = (last(pp.iterates(scan, GRID, levels=n, **options)) for n in (1, 3))
    assert one.level == three.level == 0
    assert three.objective == pytest.approx(one.objective, rel=1e-3)
    uniform = last(pp.iterates(scan, GRID, levels=3, start="uniform", **options))
    assert uniform.objective == pytest.approx(one.objective, rel=1e-3)


def test_coarse_levels_save_fine_iterations(scan):
    """To within 1 % of the converged objective."""
    best = last(pp.iterates(scan, GRID, levels=3, prior=PRIOR, tolerance=1e-6, iterations=400)).objective
    needed = []
    for levels in (1, 3):
        steps = pp.iterates(scan, GRID, levels=levels, prior=PRIOR, tolerance=1e-4, start="uniform")
        needed.append(next(s.iteration for s in steps if s.level == 0 and s.objective < 1.01 * best))
    assert needed[1] < needed[0]


@pytest.mark.parametrize("prior", [PRIOR, None])
def test_three_levels_of_descent_end_nearer_the_minimiser_than_one(scan, prior):
    """All by the same rule. Sweeps are slow at what is broad: coarse levels that ended at once would not have found it."""
    found = last(
        pp.iterates(scan, GRID, prior=prior, optimizer="momentum", tolerance=1e-8, iterations=800)
    ).volume.values
    away, swept = [], []
    for levels in (1, 3):
        step = last(pp.iterates(scan, GRID, levels=levels, prior=prior, optimizer="descent", start="uniform"))
        away.append(np.linalg.norm(step.volume.values - found))
        swept.append(step.iteration)
    assert away[1] < 0.75 * away[0]
    assert swept[1] < 0.5 * swept[0]


@pytest.mark.parametrize(("iterations", "made"), [(2, [2, 4, 8]), ([3, 1, 2], [3, 1, 2])])
def test_a_level_down_twice_as_many_iterations_are_allowed(scan, iterations, made):
    steps = list(pp.iterates(scan, GRID, prior=PRIOR, iterations=iterations, tolerance=0))
    assert [sum(s.level == k for s in steps) for k in range(3)] == made
    assert [s.finished for s in steps].count(True) == 3


def test_the_object_is_found(scan):
    """Prior and likelihood beat the baselines; the ball stands out at its place."""
    truth = BODY.volume(GRID).values
    wrong = {}
    for method in ("map", "backprojection", "sirt", "sart", "fbp"):
        made = pp.reconstruct(scan, GRID, method=method, prior=PRIOR, tolerance=1e-4, iterations=60).values
        wrong[method] = np.linalg.norm(made - truth) / np.linalg.norm(truth)
        if method == "map":
            z, y, x = np.unravel_index(np.argmax(made), made.shape)
            assert np.abs(GRID.points([(z, y, x)])[0] - [5, 2, 24]).max() <= 4
            # a narrow arc smears depth, but what lies along the rays must be all there
            column, expected = made.sum(axis=0) * 2, truth.sum(axis=0) * 2
            assert column[10:22, 12:28].mean() == pytest.approx(expected[10:22, 12:28].mean(), rel=0.03)
    assert wrong["map"] < wrong["sirt"]
    assert wrong["map"] < wrong["sart"]
    assert wrong["map"] < wrong["backprojection"]
    assert wrong["map"] < wrong["fbp"]


def test_backprojection_of_a_uniform_box_is_that_box():
    A = pp.Projector(arc(), GRID)
    p = A(np.full(GRID.shape, 0.03, np.float32))
    scan = pp.Scan(1e5 * np.exp(-p.astype(np.float64)), 1e5, arc())
    made = pp.backproject(A, Transmission.of(scan))
    assert np.abs(made[A.T(np.ones(A.range_shape)) > 0] - 0.03).max() < 1e-4


def test_tilted_panels_and_least_squares_find_it_too():
    panel = pp.Panel((44, 60), (1, 1), (-29.5, -21.5, 0))
    views = pp.rotating_views(panel, np.linspace(-25, 25, 7), source=(0, 0, 500), pivot=(0, 0, 24), axis=(0.1, 1, 0))
    scan = pp.simulate_scan(BODY, views, incident=5000, seed=2)
    volume = pp.reconstruct(scan, GRID, prior=PRIOR, likelihood="least-squares")
    z, y, x = np.unravel_index(np.argmax(volume.values), GRID.shape)
    assert np.abs(GRID.points([(z, y, x)])[0] - [5, 2, 24]).max() <= 4


def test_a_resumed_run_is_the_uninterrupted_one(scan, tmp_path):
    """Same bits, from any step, through a file."""
    options = {"levels": 2, "prior": pp.Prior(), "iterations": 4}
    whole = list(pp.iterates(scan, GRID, **options))
    assert {s.level for s in whole} == {0, 1}
    run = fingerprint(scan, {"grid": GRID, **options})
    for stop, step in enumerate(whole[:-1]):
        write_checkpoint(tmp_path / "run.h5", step, run)
        rest = list(pp.iterates(scan, GRID, **options, resume=read_checkpoint(tmp_path / "run.h5", run)))
        assert [(s.level, s.iteration, s.objective) for s in rest] == [
            (s.level, s.iteration, s.objective) for s in whole[stop + 1 :]
        ]
        assert (rest[-1].volume.values == whole[-1].volume.values).all()
    write_checkpoint(tmp_path / "run.h5", whole[-1], run)
    assert not list(pp.iterates(scan, GRID, **options, resume=read_checkpoint(tmp_path / "run.h5", run)))


def test_a_stopped_run_keeps_its_last_iterate(scan, tmp_path):
    run = fingerprint(scan, {"levels": 1})

    def interrupted():
        for step in pp.iterates(scan, GRID, levels=1, prior=PRIOR):
            if step.iteration == 4:
                raise KeyboardInterrupt
            yield step

    kept = None
    try:
        for step in with_checkpoints(interrupted(), tmp_path / "run.h5", run, every=100):
            kept = step
    except KeyboardInterrupt:
        pass
    else:
        pytest.fail("not stopped")
    again = read_checkpoint(tmp_path / "run.h5", run)
    assert again.iteration == 3
    assert (again.volume.values == kept.volume.values).all()


def test_what_a_killed_run_has_lost_is_no_more_than_was_asked(scan, tmp_path):
    """After a kill nothing more is written: the file holds the last third iterate, or the last of a level."""
    path, run = tmp_path / "run.h5", fingerprint(scan, {"levels": 2})
    steps = pp.iterates(scan, GRID, levels=2, prior=PRIOR, iterations=[7, 5], tolerance=0)
    held = []
    for step in with_checkpoints(steps, path, run, every=3):
        there = read_checkpoint(path, run) if path.exists() else None
        held.append((step.level, step.iteration, there and (there.level, there.iteration)))
    coarse = [None, None, (1, 3), (1, 3), (1, 5)]
    fine = [(0, 1), (0, 1), (0, 1), (0, 4), (0, 4), (0, 4), (0, 7)]  # iterates 6, 9 and 12 of the run
    assert [one for *_, one in held] == coarse + fine


def test_checkpoints_of_another_run_or_damaged_are_refused(scan, tmp_path):
    path, run = tmp_path / "run.h5", fingerprint(scan, {"levels": 1})
    with pytest.raises(FileError, match=r"run.h5: there is no checkpoint .* leave out --resume"):
        read_checkpoint(path, run)
    write_checkpoint(path, next(pp.iterates(scan, GRID, levels=1, prior=PRIOR)), run)
    with pytest.raises(FileError, match=r"levels was 1, now 3.* leave out --resume"):
        read_checkpoint(path, fingerprint(scan, {"levels": 3}))
    with pytest.raises(FileError, match=r"scan was .*, now .*"):
        read_checkpoint(path, fingerprint(scan[:3], {"levels": 1}))
    path.write_bytes(path.read_bytes()[:-2000])
    with pytest.raises(FileError, match=r"run.h5: truncated or damaged .* remove it"):
        read_checkpoint(path, run)
    path.write_text("not a checkpoint")
    with pytest.raises(FileError, match=r"run.h5: truncated or damaged"):
        read_checkpoint(path, run)


def test_strength_and_edge_survive_a_change_of_dose():
    """β follows the data's curvature: ten times the photons, ten times β, the same picture but for noise."""
    ends = []
    for incident in (1e4, 1e5):
        quiet = pp.simulate_scan(BODY, arc(), incident=incident, seed=None)
        ends.append(pp.reconstruct(quiet, GRID, prior=PRIOR, tolerance=1e-6, iterations=100).values)
    assert np.abs(ends[0] - ends[1]).max() < 0.01 * ends[0].max()


def test_open_knobs_are_chosen_from_the_data():
    """More photons, less smoothing; a denser object, a larger edge; a given knob is left alone."""
    knobs = {}
    for incident in (1e3, 1e5):
        quiet = pp.simulate_scan(BODY, arc(), incident=incident, seed=None)
        A, data = pp.Projector(quiet.views, GRID), Transmission.of(quiet)
        knobs[incident] = choose_prior_parameters(pp.Prior(), A, data, data_curvature(A, data))
        assert choose_prior_parameters(PRIOR, A, data, data_curvature(A, data)) == PRIOR
    assert knobs[1e3].strength == pytest.approx(10 * knobs[1e5].strength, rel=0.05)
    assert 0.02 * 0.05 * 0.3 < knobs[1e5].edge < 0.05 * 0.04


def test_a_grid_is_chosen_where_the_thickness_is_known(scan):
    with pytest.raises(
        GeometryError, match=r"thickness: .* cannot be known from the geometry, got None; give thickness"
    ):
        pp.reconstruct(scan)
    grid = pp.covering_grid(scan.views, thickness=36)
    low, high = grid.bounds
    assert low[2] == pytest.approx(0)
    assert high[2] == pytest.approx(36)
    body = BODY.bounds()
    assert (low[:2] < body[0, :2]).all()
    assert (high[:2] > body[1, :2]).all()
    assert grid.spacing[2] == pytest.approx(1 * (500 + 24 - 18) / (500 + 24), rel=0.05)
    turning = pp.rotating_views(scan.views.panels[0], [-20, 20], source=(0, 0, 500), pivot=(0, 0, 24))
    assert pp.covering_grid(turning, thickness=20).axis("z").mean() == pytest.approx(24, abs=1e-6)
    with pytest.raises(GeometryError, match=r"thickness: 900 mm reaches z = 900 mm, the lowest focal spot"):
        pp.covering_grid(scan.views, thickness=900)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"method": "magic"}, ("method", "magic", "choose from map")),
        ({"curvature": "steep"}, ("curvature", "steep", "optimal")),
        ({"start": "zero"}, ("start", "zero", "uniform")),
        ({"likelihood": "gauss"}, ("likelihood", "gauss", "least-squares")),
        ({"interpolation": "cubic"}, ("interpolation", "cubic", "linear")),
        ({"downsample": "mode"}, ("downsample", "mode", "sum")),
        ({"levels": 0}, ("levels", "0", "at least 1")),
        ({"iterations": 0}, ("iterations", "0", "at least 1")),
        ({"iterations": [3, 3], "levels": 3}, ("iterations", "[3, 3]", "finest first")),
        ({"method": "fbp", "window": "kaiser"}, ("window", "kaiser", "ram-lak")),
        ({"method": "fbp", "cutoff": 0.0}, ("cutoff", "0.0", "Nyquist")),
        ({"method": "sart", "relaxation": 2.0}, ("relaxation", "2.0", "below 2")),
        ({"tolerance": -1.0}, ("tolerance", "-1.0", "from 0 to below 1")),
    ],
)
def test_options_that_cannot_be_are_refused_before_work(scan, options, told):
    with pytest.raises(DataError) as refusal:
        pp.iterates(scan, GRID, **options)
    for words in told:
        assert words in str(refusal.value)


def test_a_grid_that_no_measured_ray_meets_is_refused(scan):
    with pytest.raises(GeometryError, match="geometry misses the volume"):
        pp.iterates(scan, pp.Grid((4, 8, 8), (1, 1, 1), (400, 0, 10)))
    mask = np.zeros(scan.shape, bool)
    mask[:, :2, :2] = True
    corner = pp.Scan(scan.counts, scan.incident, scan.views, scan.background, mask)
    with pytest.raises(GeometryError, match="no measured ray meets the grid; check"):
        list(pp.iterates(corner, pp.Grid((2, 4, 4), (1, 1, 1), (-1, -1, 20)), levels=1))
