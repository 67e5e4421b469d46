"""Gains and shifts of views, estimated from scans in which they are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage
from support.shifted_scans import shifted_case

import palpate as pp
from palpate.errors import DataError
from palpate.reconstruction.self_calibration import Calibration, accelerated, interpolate_over_angle
from palpate.scans.analytic_phantoms import Ellipsoid

PITCH, BEAM = 3.0, 20_000.0
GRID = pp.Grid((21, 90, 90), (8.0, 2.0, 2.0), (-89.0, -89.0, -80.0))


def pebbles(seed):
    rng = np.random.default_rng(seed)
    solids = [(Ellipsoid((0, 0, 0), (60, 75, 60)), 0.004)]
    for _ in range(25):
        centre = rng.uniform(-1, 1, 3) * (35, 45, 35)
        solids.append((Ellipsoid(centre, rng.uniform(4, 12, 3)), rng.uniform(-0.003, 0.006)))
    return pp.Phantom(solids)


def nine_views():
    panel = pp.Panel((96, 96), (PITCH, PITCH), (-142.5, -142.5, -300.0))
    return pp.rotating_views(panel, np.linspace(-20, 20, 9), source=(0, 0, 800), pivot=(0, 0, 0))


@pytest.fixture(scope="module")
def recorded():
    """A scan said to be of nine regular views, and what it was really recorded with."""
    rng = np.random.default_rng(5)
    views = nine_views()
    shifts = pp.without_displacement(views, rng.uniform(-1.5, 1.5, (9, 2)), GRID)
    gains = 1 + rng.uniform(-0.06, 0.06, 9)
    gains /= gains.mean()
    ideal = pp.simulate_scan(pebbles(3), pp.shift_panels(views, shifts), BEAM, seed=1)
    counts = BEAM * (np.maximum(ideal.counts, 0.5) / BEAM) ** gains[:, None, None]
    return pp.Scan(counts, BEAM, views), ideal, Calibration(gains, shifts)


@pytest.fixture(scope="module")
def found(recorded):
    return pp.calibrate(recorded[0], GRID, rounds=4, iterations=12)


def test_shifts_of_half_a_pixel_are_found_to_a_twentieth(recorded, found):
    true = recorded[2].shifts
    assert np.abs(true).max() > 0.4 * PITCH
    error = (found.shifts - true) / PITCH
    assert np.sqrt(np.mean(error**2)) < 0.03
    assert np.abs(error).max() < 0.08


def test_gains_of_some_per_cent_are_found_to_one(recorded, found):
    true = recorded[2].gains
    assert np.abs(true - 1).max() > 0.03
    assert np.abs(found.gains - true).max() < 0.01


def test_refined_undoes_what_is_known(recorded):
    scan, ideal, truth = recorded
    again = pp.apply_calibration(scan, truth)
    assert np.allclose(again.counts, np.maximum(ideal.counts, 0.5), rtol=1e-4)
    at = [p.origin for p in again.views.panels]
    assert np.allclose(at, [p.origin for p in ideal.views.panels])


def test_refined_views_predict_a_true_view_better(recorded, found):
    scan, ideal, _ = recorded
    others = [0, 1, 2, 3, 5, 6, 7, 8]
    errors = []
    for what in (scan, pp.apply_calibration(scan, found)):
        volume = pp.reconstruct(what[others], GRID, levels=1, iterations=12)
        p = pp.Projector(ideal.views[[4]], GRID)(volume.values)[0]
        errors.append(1 - np.corrcoef(p.ravel(), pp.line_integrals(ideal)[4].ravel())[0, 1])
    assert errors[1] < errors[0]


@given(step=st.tuples(*[st.floats(-25, 25)] * 3), spin=st.floats(-30, 30))
@settings(max_examples=20, deadline=None)
def test_a_displaced_object_is_no_shift(step, spin):
    views = nine_views()
    middle = np.asarray(GRID.bounds).mean(axis=0)
    moved = views.project(middle + 1e-3 * np.array(step))[:, 0] - views.project(middle)[:, 0]
    left = pp.without_displacement(views, moved * PITCH, GRID)
    assert np.abs(left).max() < 1e-6 + 1e-3 * np.abs(moved).max()
    own = np.zeros((9, 2))
    own[4, 0] = spin  # one panel alone: no displacement does that
    kept = pp.without_displacement(views, own, GRID)
    assert np.allclose(pp.without_displacement(views, kept, GRID), kept, atol=1e-9)
    assert abs(kept[4, 0]) >= 0.8 * abs(spin)


@given(down=st.floats(-1.5, 1.5), across=st.floats(-1.5, 1.5), gain=st.floats(0.5, 2), offset=st.floats(-1, 1))
@settings(max_examples=20, deadline=None)
def test_the_shift_of_an_image_whatever_its_gain_and_offset(down, across, gain, offset):
    image = ndimage.gaussian_filter(np.random.default_rng(2).standard_normal((80, 90)), 3.0)
    # The panel that lies further along sees everything at lower indices.
    measured = gain * ndimage.shift(image, (-down, -across), order=5, mode="nearest") + offset
    region = np.zeros(image.shape, bool)
    region[15:-15, 15:-15] = True
    shift = pp.image_shift(measured, image, region)
    # Linear in the shift: a bias of second order remains, which further rounds remove.
    assert np.abs(shift - (down, across)).max() < 0.02 + 0.12 * np.hypot(down, across) ** 2


def test_between_is_linear_inside_and_the_nearest_outside():
    values = np.array([[0.0, 4.0], [1.0, 2.0], [3.0, 0.0]])
    angles = np.array([0.0, 1.0, 2.0])
    assert np.allclose(interpolate_over_angle(angles, values, 1.5), (2, 1))
    assert np.allclose(interpolate_over_angle(angles[::-1], values[::-1], 1.5), (2, 1))
    assert np.allclose(interpolate_over_angle(angles, values, 5), (3, 0))


def test_what_cannot_be_refined_is_refused():
    scan = pp.Scan(np.full((9, 96, 96), BEAM), BEAM, nine_views())
    with pytest.raises(DataError, match="at least 1 round"):
        pp.calibrate(scan, GRID, rounds=0)
    with pytest.raises(DataError, match="view 0: nothing dense"):
        pp.calibrate(scan, GRID, rounds=1, iterations=1)
    with pytest.raises(DataError, match="gains: expected numbers above 0"):
        pp.apply_calibration(scan, Calibration(np.zeros(9), np.zeros((9, 2))))
    blank, everywhere = np.zeros((30, 30)), np.ones((30, 30), bool)
    with pytest.raises(DataError, match="no detail"):
        pp.image_shift(blank, blank, everywhere)
    with pytest.raises(DataError, match="nothing to compare"):
        pp.view_gain(blank, blank, everywhere)


@given(seed=st.integers(0, 10**6))
@settings(max_examples=20, deadline=None)
def test_extrapolation_ends_a_linear_iteration_after_as_many_steps_as_it_has_speeds(seed):
    # x <- x + (b - A x) with A of three distinct eigenvalues; Anderson's method is then GMRES and ends after three steps.
    rng = np.random.default_rng(seed)
    Q = np.linalg.qr(rng.standard_normal((8, 8)))[0]
    A = Q @ np.diag(np.repeat([0.2, 0.5, 0.9], [3, 3, 2])) @ Q.T
    answer = rng.standard_normal(8)
    x, tried, made = np.zeros(8), [], []
    for _ in range(4):
        tried, made = [*tried, x], [*made, x + A @ (answer - x)]
        x = accelerated([t.reshape(4, 2) for t in tried], [m.reshape(4, 2) for m in made], noise=1e-13).ravel()
    assert np.linalg.norm(x - answer) < 1e-6 * np.linalg.norm(answer)
    assert np.linalg.norm(made[-2] - answer) > 1e-3 * np.linalg.norm(answer)


def test_shifts_of_a_still_panel_are_found_at_low_dose():
    # The case that converges slowest by turns: the depth of the object trades with shifts along the arc.
    views, body, grid, true = shifted_case(0, "arc")
    seen = pp.simulate_scan(body, pp.shift_panels(views, true), 2000, seed=0)
    scan, errors = pp.Scan(seen.counts, seen.incident, views), []
    want = pp.without_displacement(views, true, grid)
    for memory in (0, 4):
        found = pp.calibrate(scan, grid, drift=False, rounds=8, memory=memory)
        errors.append(np.sqrt(np.mean((found.shifts - want) ** 2)) / views.panels[0].pitch[0])
    assert np.sqrt(np.mean(want**2)) > 0.5
    assert errors[1] < 0.05
    assert errors[1] < 0.8 * errors[0]
