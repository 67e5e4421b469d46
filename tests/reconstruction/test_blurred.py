"""Blur of panel and focal spot in the model: against dense matrices, SciPy's optimizer, and scans of a real focal spot."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reconstruction.test_reconstruct import matrix
from scipy.linalg import toeplitz
from scipy.ndimage import gaussian_filter
from scipy.optimize import minimize
from support.blurred_scans import magnifying_scan

import palpate as pp
from palpate.errors import DataError, FileError, GeometryError
from palpate.reconstruction.checkpoint import fingerprint, read_checkpoint, write_checkpoint
from palpate.reconstruction.models.likelihood import Transmission
from palpate.reconstruction.multiresolution import coarser_scan
from palpate.reconstruction.optimizers.coordinate_descent import coordinate_descent
from palpate.reconstruction.optimizers.hybrid_descent import hybrid_descent
from palpate.reconstruction.optimizers.memory_gradient import memory_gradient
from palpate.reconstruction.optimizers.ordered_subsets import ordered_subsets
from palpate.reconstruction.optimizers.problem import Problem

FWHM = 2 * np.sqrt(2 * np.log(2))
PRIOR, BETA = pp.Prior("quadratic"), 300.0


def sampled(count, t):
    """(count, count): samples of a normal distribution whose variance as samples is t, by bisection."""
    n = np.arange(-60, 61)
    low, high = 1e-3, t + 1
    for _ in range(60):
        middle = (low + high) / 2
        weights = np.exp(-(n**2) / (2 * middle))
        weights /= weights.sum()
        low, high = (middle, high) if (weights * n**2).sum() < t else (low, middle)
    return toeplitz(weights[60 : 60 + count])


def dense_blur(scan):
    """(pixels, pixels): every view's blur from its widths on the panel, rows of sum 1; float64."""
    views, rows, columns = scan.shape
    size = rows * columns
    out = np.zeros((views * size, views * size))
    for k, (source, panel) in enumerate(zip(scan.views.source, scan.views.panels, strict=True)):
        to_panel = np.dot(panel.origin - source, panel.normal)
        to_plane = np.dot(np.array(scan.blur.at) - source, panel.normal)
        sigma = np.hypot(scan.blur.panel, scan.blur.focal_spot * (to_panel / to_plane - 1)) / FWHM
        along = [sampled(n, (sigma / d) ** 2) for n, d in zip((rows, columns), panel.pitch, strict=True)]
        both = np.kron(*along)
        out[k * size : (k + 1) * size, k * size : (k + 1) * size] = both / both.sum(axis=1, keepdims=True)
    return out


def blurred_small(seed=5, masked=0.05):
    """4 x 8 x 9 voxels in four views at different magnifications, with scatter, masked pixels, uneven beam and pitch."""
    rng = np.random.default_rng(seed)
    panel = pp.Panel((14, 15), (1.5, 1.2), (-8.4, -9.75, 0))
    views = pp.Views([(-20, 0, 70), (0, 5, 60), (15, -10, 80), (5, 0, 65)], panel)
    grid = pp.Grid((4, 8, 9), (3, 1, 1), (-4, -3.5, 15))
    f = rng.uniform(-0.05, 0.05, grid.shape).clip(0).astype(np.float32)
    f[1:3, 3:5, 4:6] = 0.3
    incident = rng.uniform(500, 1500, views.shape)
    mask = rng.random(views.shape) >= masked
    blank = pp.Scan(np.ones(views.shape), incident, views, 60.0, mask, blur=pp.Blur(2.0, 3.0, at=20))
    A = pp.Projector(views, grid)
    light = dense_blur(blank) @ np.exp(-matrix(A) @ f.ravel().astype(np.float64))
    counts = rng.poisson(incident * light.reshape(views.shape) + 60)
    return replace(blank, counts=counts.astype(np.float32)), A, f


@pytest.fixture(scope="module")
def problem():
    scan, A, f = blurred_small()
    return scan, A, f, dense_blur(scan)


def deviance(scan, B, l):
    """Half of it, from its definition in float64."""
    mask = scan.mask.ravel()
    y, b, r = (
        np.broadcast_to(a, scan.shape).ravel()[mask].astype(np.float64)
        for a in (scan.counts, scan.incident, scan.background)
    )
    m = b * (B[mask] @ np.exp(-l.ravel().astype(np.float64))) + r
    return np.sum(m - y + np.where(y > 0, y * np.log(np.maximum(y, 1) / m), 0))


def penalty(A, f):
    """β R of the quadratic prior from its definition."""
    f, d, total = f.astype(np.float64), np.array(A.grid.spacing), 0.0
    for step in np.ndindex(3, 3, 3):
        step = np.array(step) - 1
        if tuple(step) <= (0, 0, 0):
            continue
        here = tuple(slice(max(0, -s), n - max(0, s)) for s, n in zip(step, f.shape, strict=True))
        there = tuple(slice(max(0, s), n - max(0, -s)) for s, n in zip(step, f.shape, strict=True))
        total += d.prod() / (np.linalg.norm(step * d) * d.min()) * ((f[here] - f[there]) ** 2).sum() / 2
    return BETA * total


def test_the_kernel_is_that_of_each_view(problem):
    scan, _, _, B = problem
    widths = scan.blur.widths(scan.views)
    assert len(set(widths.round(3))) == len(widths)  # no two views are alike
    l = np.random.default_rng(1).uniform(0, 3, scan.shape).astype(np.float32)
    seen = pp.Blurred.of(scan).seen(l)
    expected = -np.log(B @ np.exp(-l.ravel().astype(np.float64)))
    assert seen.ravel() == pytest.approx(expected, abs=1e-4)  # of the light, 1e-5 beyond the end of the kernel
    assert np.abs(seen - l).max() > 0.3


def test_an_open_beam_stays_as_it_is(problem):
    """At the edge of the panel too, and where pixels are masked."""
    scan, *_ = problem
    assert np.abs(pp.Blurred.of(scan).seen(np.zeros(scan.shape, np.float32))).max() < 1e-6


def test_what_pixels_see_of_fine_detail_is_blurred_as_the_light_is():
    """Waves of all lengths from two pixels on: SciPy's Gaussian on pixels of an eighth, which then sum the light."""
    views = pp.Views([(0, 0, 100)], pp.Panel((3, 240), (0.4, 0.4), (0, 0, 0)))
    taps = pp.Blur(panel=0.4 * FWHM).taps(views)[0, 1].astype(np.float64)
    kernel = np.concatenate([taps[:0:-1], taps])
    x = (np.arange(240 * 8) + 0.5) / 8
    for length in (2.0, 2.5, 4.0, 10.0):
        light = np.cos(2 * np.pi * (x - 120.5) / length)  # not nothing in the middles of pixels
        pixels, soft = (a.reshape(240, 8).mean(axis=1) for a in (light, gaussian_filter(light, 8.0)))
        seen = np.convolve(pixels, kernel, mode="same")
        assert np.abs(seen - soft)[20:-20].max() < 0.02 * np.abs(pixels).max()


@pytest.mark.parametrize("pitch", [0.1, 0.2, 0.5, 1.0])
def test_the_blur_has_its_width_on_pixels_of_any_size(pitch):
    """Its variance is that of the normal distribution with the given full width, on coarse pixels too."""
    views = pp.Views([(0, 0, 100)], pp.Panel((80, 90), (pitch, 2 * pitch), (0, 0, 0)))
    taps = pp.Blur(panel=0.6).taps(views)[0].astype(np.float64)
    n = np.arange(taps.shape[1])
    for line, step in zip(taps, (pitch, 2 * pitch), strict=True):
        assert line[0] + 2 * line[1:].sum() == pytest.approx(1, abs=1e-6)
        assert (line >= 0).all()
        variance = 2 * (line * (n * step) ** 2).sum()
        assert variance == pytest.approx((0.6 / FWHM) ** 2, rel=0.01)


def test_coarse_pixels_see_the_same_blur():
    """Blurred by SciPy on fine pixels and summed, a smooth image is what the coarse level's kernel makes of the sum."""
    rng = np.random.default_rng(0)
    views = pp.Views([(0, 0, 100)], pp.Panel((64, 64), (0.1, 0.1), (0, 0, 0)))
    shadow = gaussian_filter(rng.uniform(0, 1, (1, 64, 64)), (0, 5, 5)) * 20
    soft = gaussian_filter(shadow, (0, 3, 3))
    scan = pp.Scan(soft * 1000, 1000, views, blur=pp.Blur(panel=0.3 * FWHM))
    coarse = coarser_scan(scan)
    four = shadow.reshape(1, 32, 2, 32, 2).mean(axis=(2, 4))
    seen = np.exp(-pp.Blurred.of(coarse).seen(-np.log(four).astype(np.float32)))
    measured = coarse.counts / coarse.incident
    inner = np.s_[:, 6:-6, 6:-6]
    assert np.abs(seen - measured)[inner].max() < 0.02 * np.abs(four - measured)[inner].max()


def test_the_value_is_that_of_dense_matrices(problem):
    scan, A, _, B = problem
    for seed in range(3):
        l = A(np.random.default_rng(seed).uniform(0, 0.2, A.domain_shape).astype(np.float32))
        assert pp.Blurred.of(scan).value(l) == pytest.approx(deviance(scan, B, l), rel=1e-5)


def test_the_gradient_is_the_derivative_of_the_objective(problem):
    """By central differences of the dense float64 objective, through projector, blur, masks and scatter."""
    scan, A, _, B = problem
    rng = np.random.default_rng(3)
    at = rng.uniform(0, 0.2, A.domain_shape).astype(np.float32)
    gradient = Problem(A, pp.Blurred.of(scan), PRIOR, BETA, "precomputed").gradient(at).astype(np.float64)
    P = matrix(A)
    for _ in range(5):
        way, step = rng.normal(size=A.domain_shape), 1e-5
        up, down = (at + sign * step * way for sign in (1, -1))
        rise = sum(s * (deviance(scan, B, P @ g.ravel()) + penalty(A, g)) for s, g in ((1, up), (-1, down)))
        assert np.vdot(gradient, way) == pytest.approx(rise / (2 * step), rel=1e-3)


seeds, roughness = st.integers(0, 2**31), st.sampled_from([0.0, 0.1, 1.0])
tops = st.one_of(st.just(0.0), st.floats(0.01, 0.3), st.floats(0.01, 6))


def line_integrals(scan, seed, tops, rough):
    """One array for each top: values from (1 - rough) top to top."""
    rng = np.random.default_rng(seed)
    return [(top * (1 - rng.uniform(0, rough, scan.shape))).astype(np.float32) for top in tops]


@settings(max_examples=60, deadline=None)
@given(seeds, tops, tops, roughness, st.sampled_from(["optimal", "maximum"]))
def test_the_surrogates_touch_and_lie_above(problem, seed, here, there, rough, kind):
    """Any line integrals, masked pixels and the panel's edge included, not only those of a volume. Even ones, where the
    parabolas come nearest, too."""
    scan, _, _, B = problem
    data, (l, t) = pp.Blurred.of(scan), line_integrals(scan, seed, (here, there), rough)
    slope, curvature = data.slope(l).astype(np.float64), data.curvature(l, kind).astype(np.float64)
    step = t.astype(np.float64) - l
    parabola = deviance(scan, B, l) + (slope * step + curvature / 2 * step**2).sum()
    assert deviance(scan, B, t) <= parabola + 1e-5 * abs(parabola)
    assert (curvature >= 0).all()


@settings(max_examples=40, deadline=None)
@given(seeds, tops, tops, roughness, st.booleans())
def test_the_surrogates_of_a_hardening_beam_lie_above(problem, seed, here, there, rough, dark):
    """Behind lead too, where nothing is counted: there the curve's bend counts most."""
    scan, _, _, B = problem
    scan = replace(scan, counts=0 * scan.counts, background=0) if dark else scan
    curve = pp.Polynomial((1.0, -0.04))
    data, (l, t) = pp.Hardened(pp.Blurred.of(scan), curve), line_integrals(scan, seed, (here, there), rough)
    slope, curvature = data.slope(l).astype(np.float64), data.curvature(l, "optimal").astype(np.float64)
    step = t.astype(np.float64) - l
    parabola = deviance(scan, B, curve(l)[0]) + (slope * step + curvature / 2 * step**2).sum()
    assert deviance(scan, B, curve(t)[0]) <= parabola + 1e-5 * abs(parabola)


def solver(name, A, data, scan, start):
    some = lambda views: pp.Blurred.of(scan[views])  # noqa: E731
    return {
        "momentum": lambda: memory_gradient(A, data, PRIOR, BETA, start),
        "careful momentum": lambda: memory_gradient(A, data, PRIOR, BETA, start, "optimal"),
        "descent": lambda: coordinate_descent(A, data, PRIOR, BETA, start),
        "careful descent": lambda: coordinate_descent(A, data, PRIOR, BETA, start, "optimal"),
        "auto": lambda: hybrid_descent(A, data, PRIOR, BETA, start),
        "subsets": lambda: ordered_subsets(A, data, PRIOR, BETA, start, some),
    }[name]()


EVERY = ["momentum", "careful momentum", "descent", "careful descent", "auto", "subsets"]


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("seed", [0, 1])
def test_the_objective_never_rises(problem, name, seed):
    scan, A, _, B = problem
    start = np.random.default_rng(seed).uniform(0, 0.4, A.domain_shape).astype(np.float32)
    P, values = matrix(A), []
    for f, told in islice(solver(name, A, pp.Blurred.of(scan), scan, start), 25):
        values.append(deviance(scan, B, P @ f.ravel()) + penalty(A, f))
        assert told == pytest.approx(values[-1], rel=1e-4)
        assert f.min() >= 0
    assert (np.diff(values) <= 1e-5 * values[-1]).all()
    assert values[-1] < 0.5 * (deviance(scan, B, P @ start.ravel()) + penalty(A, start))


def test_the_optimum_is_that_of_an_independent_solver(problem):
    """L-BFGS-B of SciPy with a dense B, in float64, from its own derivative."""
    scan, A, _, B = problem
    P, mask = matrix(A), scan.mask.ravel()
    y, b, r = (
        np.broadcast_to(a, scan.shape).ravel()[mask].astype(np.float64)
        for a in (scan.counts, scan.incident, scan.background)
    )

    def value_and_gradient(f):
        e = np.exp(-P @ f)
        m = b * (B[mask] @ e) + r
        back = P.T @ (e * (B[mask].T @ (b * (y / m - 1))))
        volume = f.reshape(A.domain_shape)
        pull = np.array([penalty(A, volume + d) - penalty(A, volume - d) for d in units]) / 2
        return deviance(scan, B, P @ f) + penalty(A, volume), back + pull

    units = np.eye(A.grid.size).reshape(-1, *A.domain_shape)  # of a quadratic the central difference is exact
    start = np.full(A.grid.size, 0.02)
    found = minimize(
        value_and_gradient,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=[(0, None)] * A.grid.size,
        options={"maxiter": 300, "ftol": 1e-12, "gtol": 1e-4},
    )
    ours, told = next(
        islice(
            memory_gradient(A, pp.Blurred.of(scan), PRIOR, BETA, start.reshape(A.domain_shape).astype(np.float32)),
            399,
            None,
        )
    )
    assert told == pytest.approx(found.fun, rel=1e-5)
    assert np.abs(ours.ravel() - found.x).max() < 0.01 * found.x.max()
    assert (found.x < 1e-6).any()  # voxels at the bound
    plain, _ = next(islice(memory_gradient(A, Transmission.of(scan), PRIOR, BETA, ours), 99, None))
    assert np.abs(plain - ours).max() > 0.1 * found.x.max()  # the blur matters here


@pytest.fixture(scope="module")
def sharp_and_soft():
    """A speck of 0.2 mm in a ball of 4 mm, behind a real focal spot of 0.4 mm at magnification 2 and a panel of 0.3 mm:
    (figures without, figures with blur in the model), of some strengths of the prior each."""
    centre, ball = np.array([0.68, 0.44, 0.04]), (np.zeros(3), 2.0, 0.05)
    grid = pp.Grid.centred((36, 50, 50), (0.08, 0.08, 0.08))
    scan, clean = (magnifying_scan([ball, (centre, 0.1, 1.0)], photons=2e4, seed=seed) for seed in (0, None))
    places = grid.points(np.stack(np.indices(grid.shape), axis=-1).reshape(-1, 3)).reshape(*grid.shape, 3)
    flat = (np.linalg.norm(places, axis=-1) < 1.5) & (np.linalg.norm(places - centre, axis=-1) > 0.8)
    z, y, x = grid.indices(centre)[0].round().astype(int)

    def figures(blur, strength):
        """Standard deviation of the noise in the ball, FWHM of the speck in mm, and its height in 1/mm without noise."""
        options = {"levels": 2, "prior": pp.Prior("quadratic", strength=strength), "iterations": 40, "tolerance": 0}
        noisy, exact = (pp.reconstruct(replace(s, blur=blur), grid, **options).values for s in (scan, clean))
        line = exact[z, y].astype(np.float64) - ball[2]
        fine = np.linspace(0, len(line) - 1, 20 * len(line))
        above = np.interp(fine, np.arange(len(line)), line) > line[x] / 2
        width = np.count_nonzero(above & (np.abs(fine - x) < 8)) * (fine[1] - fine[0]) * grid.spacing[2]
        return (noisy - exact)[flat].std(), width, line[x]

    return [np.array([figures(blur, s) for s in (0.1, 0.4, 1.6)]) for blur in (None, scan.blur)]


def test_at_equal_noise_a_speck_keeps_more_contrast(sharp_and_soft):
    """Data with no part of the model: chords from 25 point sources in the spot, SciPy's Gaussian on finer pixels."""
    without, blurred = sharp_and_soft
    noise, _, height = blurred[1]
    order = np.argsort(without[:, 0])
    assert without[:, 0].min() < noise < without[:, 0].max()
    assert height > 1.5 * np.interp(noise, without[order, 0], without[order, 2])


def test_a_weak_prior_shows_a_speck_sharper_than_any_does_without(sharp_and_soft):
    without, blurred = sharp_and_soft
    assert blurred[0, 1] < 0.95 * without[:, 1].min()


def test_a_blur_that_is_not_there_is_not_in_the_way():
    """A width far below a pixel changes next to nothing: the blurred model has the plain one as its limit."""
    scan, A, _ = blurred_small()
    thin = pp.Blurred.of(replace(scan, blur=pp.Blur(panel=0.01)))
    l = np.random.default_rng(0).uniform(0, 2, A.range_shape).astype(np.float32)
    plain = Transmission.of(scan)
    assert thin.value(l) == pytest.approx(plain.value(l), rel=1e-3)
    assert thin.slope(l) == pytest.approx(plain.slope(l), abs=float(1e-3 * np.abs(plain.slope(l)).max()))


def test_without_blur_the_model_is_the_plain_one():
    """The same class, and so the same kernels and bits, on every level and in every optimizer."""
    scan, A, _ = blurred_small()
    scan = replace(scan, blur=None)
    made = []

    def spy(given):
        made.append(given)
        return pp.Transmission.of(given)

    options = {"levels": 2, "iterations": 3}
    ours = pp.reconstruct(scan, A.grid, **options)
    again = pp.reconstruct(scan, A.grid, likelihood=spy, **options)
    assert (ours.values == again.values).all()
    assert len(made) == 2
    assert "blur" not in ours.notes


@pytest.mark.filterwarnings("ignore:support")  # which leaves out a part of the object, here by intention
@pytest.mark.parametrize("optimizer", ["auto", "momentum", "descent", "subsets"])
def test_levels_supports_and_masks_go_with_it(optimizer):
    scan, A, truth = blurred_small()
    inside = np.ones(A.grid.shape, bool)
    inside[:, :2] = False
    steps = list(pp.iterates(scan, A.grid, levels=2, iterations=6, optimizer=optimizer, support=inside))
    for level in (1, 0):
        values = [step.objective for step in steps if step.level == level]
        assert (np.diff(values) <= 1e-6 * values[0]).all()
    volume = steps[-1].volume
    assert not volume.values[:, :2].any()
    assert volume.values[1:3, 3:5, 4:6].mean() > 3 * truth[0].mean()
    assert volume.notes["blur"] == "panel 2 mm, focal spot 3 mm at (0, 0, 20) mm"


def test_the_plane_is_the_middle_of_the_volume_by_default():
    scan, A, _ = blurred_small()
    middle = A.grid.bounds.mean(axis=0)
    free, placed = (replace(scan, blur=pp.Blur(2.0, 3.0, at)) for at in (None, middle))
    ours, told = (pp.reconstruct(s, A.grid, levels=1, iterations=2) for s in (free, placed))
    assert (ours.values == told.values).all()
    assert ours.notes == told.notes
    lower = pp.reconstruct(replace(scan, blur=pp.Blur(2.0, 3.0, 5.0)), A.grid, levels=1, iterations=2)
    assert not (ours.values == lower.values).all()


def test_the_residuals_are_those_of_the_blurred_views():
    scan, A, f = blurred_small(masked=0)
    volume = pp.Volume(f, A.grid)
    right, wrong = (pp.residuals(s, volume).deviance.mean() for s in (scan, replace(scan, blur=None)))
    assert right == pytest.approx(1, abs=0.15)
    assert wrong > 1.3 * right


def test_a_changed_blur_is_another_run(tmp_path):
    scan, A, _ = blurred_small()
    run = fingerprint(scan, {"grid": A.grid})
    step = next(iter(pp.iterates(scan, A.grid, levels=1, iterations=2)))
    write_checkpoint(tmp_path / "run.h5", step, run)
    rest = list(
        pp.iterates(scan, A.grid, levels=1, iterations=2, resume=read_checkpoint(tmp_path / "run.h5", run), tolerance=0)
    )
    whole = list(pp.iterates(scan, A.grid, levels=1, iterations=2, tolerance=0))
    assert (rest[-1].volume.values == whole[-1].volume.values).all()
    for blur in (None, pp.Blur(2.0, 3.1, at=20), pp.Blur(2.0, 3.0, at=21)):
        other = fingerprint(replace(scan, blur=blur), {"grid": A.grid})
        with pytest.raises(FileError, match=r"blur was panel 2 mm, focal spot 3 mm at \(0, 0, 20\) mm, now"):
            read_checkpoint(tmp_path / "run.h5", other)


def test_the_blur_stays_with_the_scan(tmp_path):
    scan, *_ = blurred_small()
    pp.write_scan(tmp_path / "scan.h5", scan)
    assert pp.read_scan(tmp_path / "scan.h5").blur == scan.blur == scan[1:3].blur == coarser_scan(scan).blur
    pp.write_scan(tmp_path / "scan.h5", replace(scan, blur=None))
    assert pp.read_scan(tmp_path / "scan.h5").blur is None


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ({"panel": -0.1}, r"blur: panel must be a full width .* 0 or more in mm, got -0.1"),
        ({"focal_spot": float("nan")}, r"blur: focal_spot must be a full width .* got nan"),
        ({"panel": "wide"}, r"blur: panel .* got 'wide'"),
        ({}, r"blur: the widths .* are both 0"),
        ({"panel": 0.2, "at": (1, 2)}, r"blur at: expected shape \(3\)"),
        ({"panel": 0.2, "at": float("inf")}, r"blur at: 1 values are not finite"),
    ],
)
def test_widths_that_cannot_be_are_refused(words, told):
    with pytest.raises(DataError, match=told):
        pp.Blur(**words)


def test_a_blur_that_does_not_fit_the_scan_is_refused():
    scan, A, _ = blurred_small()
    with pytest.raises(DataError, match=r"blur: panel of 18 mm is wider than the panel \(18 mm\); check the units"):
        replace(scan, blur=pp.Blur(panel=18))
    with pytest.raises(GeometryError, match=r"blur: the plane .* not .* between focal spot and panel of view 1"):
        pp.reconstruct(replace(scan, blur=pp.Blur(focal_spot=0.1, at=65)), A.grid, levels=1)
    with pytest.raises(DataError, match=r"blur: .* mm is as wide as the panel"):
        pp.reconstruct(replace(scan, blur=pp.Blur(panel=17, focal_spot=17)), A.grid, levels=1)


def test_what_has_no_blur_in_its_model_says_so():
    scan, A, _ = blurred_small()
    for likelihood in (
        "gaussian",
        "least-squares",
        lambda s: pp.Hardened(pp.Transmission.of(s), pp.Polynomial((1.0,))),
    ):
        with pytest.raises(DataError, match=r"blur: the likelihood \w+ has none in its model"):
            pp.reconstruct(scan, A.grid, levels=1, likelihood=likelihood)
    with pytest.raises(DataError, match=r"samples: with blur in the model only of the likelihood .poisson"):
        pp.posterior(scan, A.grid, samples=2, likelihood=pp.Blurred.of)
    for method in ("fbp", "sirt"):
        plain, given = (
            pp.reconstruct(s, A.grid, method=method, iterations=2) for s in (replace(scan, blur=None), scan)
        )
        assert (plain.values == given.values).all()
        assert "blur" not in given.notes


def test_curvatures_of_directions_are_those_of_dense_matrices(problem):
    """Far below the parabolas' for detail finer than the blur, which is what makes the memory gradient fast."""
    scan, _, _, B = problem
    rng, data = np.random.default_rng(4), pp.Blurred.of(scan)
    l, before, u = (rng.uniform(0, 1, scan.shape).astype(np.float32) for _ in range(3))
    u[:, ::2] *= -1
    x = np.exp(-l.ravel().astype(np.float64))
    share = B * x / (B @ x)[:, None]
    y, r = scan.counts.ravel().astype(np.float64), scan.background.ravel().astype(np.float64)
    own = np.where(scan.mask.ravel() & (y > r), (y - r) ** 2 / np.maximum(y, 1), 0)
    seen = [share @ v.ravel().astype(np.float64) for v in (u, l - before)]
    expected = [(own * seen[i] * seen[k]).sum() for i, k in ((0, 0), (0, 1), (1, 1))]
    along = data.curvatures_along(l, before, u)
    assert along == pytest.approx(expected, rel=1e-3)
    assert along[0] < 0.3 * (data.curvature(l, "precomputed") * u**2).sum()
