"""What an unknown object hides of the geometry: known cases, and a scene that is moved as the gauge says."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import palpate as pp
from palpate.errors import DataError
from palpate.scans.view_parameters import moved, poses, shadows

PANEL = pp.Panel((120, 140), (1.0, 1.0), (-69.5, -59.5, -40))
DISPLACED = [f"displacement of the object along {axis}" for axis in "xyz"]


def cloud(count=40):
    return np.random.default_rng(1).uniform(-35, 35, (count, 3))


def cameras(count=8):
    """Views from all sides with distances of their own."""
    rng, sources, panels = np.random.default_rng(4), [], []
    for k in range(count):
        R, away, back = Rotation.random(random_state=k).as_matrix(), rng.uniform(500, 700), rng.uniform(250, 350)
        sources.append(R @ [0, 0, away] + rng.uniform(-10, 10, 3))
        panels.append(pp.Panel((100, 100), (1, 1), R @ [-49.5, -49.5, -back], R[:, 1], R[:, 0]))
    return pp.Views(sources, panels)


@pytest.mark.parametrize(
    "views",
    [
        pp.linear_views(PANEL, length=300, height=600, count=9),
        pp.circular_views(PANEL, radius=150, height=600, count=9),
        pp.hypocycloid_views(PANEL, radius=150, height=600, count=11),
    ],
    ids=["line", "circle", "hypocycloid"],
)
def test_sources_at_one_height_hide_shifts_of_three_displacements_exactly(views):
    # A shift of every panel alike, and one in proportion to the source's place: each is exactly undone by moving points.
    gauge = pp.calibration_gauge(views, cloud(), tolerance=1e-6)
    assert list(gauge.words) == DISPLACED
    assert gauge.left.max() < 1e-7
    flat = gauge.directions.reshape(3, -1)
    path = views.source[:, :2] - views.source[:, :2].mean(axis=0)
    known = [np.tile([1.0, 0], (len(views), 1)), np.tile([0, 1.0], (len(views), 1)), path[:, ::-1]]
    for shift in known:
        rest = shift.ravel() - flat.T @ np.linalg.lstsq(flat.T, shift.ravel(), rcond=None)[0]
        assert np.abs(rest).max() < 1e-6 * np.abs(shift).max()


def test_free_cameras_hide_a_similarity_and_nothing_else():
    gauge = pp.calibration_gauge(cameras(), cloud(), moves="poses", tolerance=1e-4)
    turned = [f"rotation of the object about {axis}" for axis in "xyz"]
    assert list(gauge.words) == [*DISPLACED, *turned, "scale of the object"]
    assert gauge.left.max() < 1e-5


@pytest.mark.parametrize("moves", ["shifts", "sources", "poses"])
@pytest.mark.parametrize("tolerance", [1e-3, 0.1])
def test_points_can_move_so_that_the_shadows_stay(moves, tolerance):
    views, points = pp.arc_views(PANEL, np.linspace(-20, 20, 9), radius=600), cloud(12)
    gauge, at = pp.calibration_gauge(views, points, moves=moves, tolerance=tolerance), poses(views)
    kept = {"shifts": (3, 4), "sources": (0, 1, 2), "poses": range(9)}[moves]
    assert moves == "shifts" or len(gauge.words) >= 3
    for direction, left in zip(gauge.directions, gauge.left, strict=True):
        numbers = np.zeros((9, 9))
        numbers[:, list(kept)] = 1e-2 * direction
        before, after = shadows(at, points), shadows(moved(at, numbers), points)
        assert np.sqrt(((after - before) ** 2).sum(axis=2).mean()) == pytest.approx(1e-2, rel=0.05)
        # Newton's steps for each point by itself
        X = points.copy()
        for _ in range(5):
            seen, J = shadows(moved(at, numbers), X), []
            for step in 1e-3 * np.eye(3):
                J.append((shadows(moved(at, numbers), X + step) - seen) / 1e-3)
            for n in range(len(X)):
                slopes = np.array([j[:, n].ravel() for j in J]).T
                X[n] += np.linalg.lstsq(slopes, (before - seen)[:, n].ravel(), rcond=None)[0]
        rest = np.sqrt(((shadows(moved(at, numbers), X) - before) ** 2).sum(axis=2).mean())
        assert rest <= 1e-2 * (1.05 * left + 0.01)
        assert left <= tolerance


def test_the_gauge_of_shifts_is_what_without_displacement_removes():
    views = pp.rotating_views(PANEL, np.linspace(-20, 20, 9), source=(0, 0, 600))
    grid = pp.Grid((20, 20, 20), (3.5, 3.5, 3.5), (-33.25, -33.25, -33.25))
    gauge = pp.calibration_gauge(views, cloud())
    assert list(gauge.words) == DISPLACED
    for shifts in gauge.directions:
        assert np.abs(pp.without_displacement(views, shifts, grid)).max() < 0.05 * np.abs(shifts).max()


def test_what_has_no_gauge_is_refused():
    views = pp.linear_views(PANEL, length=300, height=600, count=9)
    with pytest.raises(DataError, match="not in one plane"):
        pp.calibration_gauge(views, cloud() * (1, 1, 0))
    with pytest.raises(DataError, match="moves: expected one of"):
        pp.calibration_gauge(views, cloud(), moves="tilts")
