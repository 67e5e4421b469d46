"""Where rays start and land."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import palpate as pp
from palpate.errors import GeometryError

PANEL = pp.Panel((40, 60), (0.5, 0.4), (-20, 3, 7))
CENTRE = PANEL.points([19.5, 29.5])[0]
finite = st.floats(-1, 1)


def lengths(points):
    """All distances between points (N, 3)."""
    return np.linalg.norm(points[:, None] - points[None], axis=2)


def test_circular_views_are_equally_spaced_on_a_circle_above_the_panel():
    s = pp.circular_views(PANEL, radius=250, height=1000, count=8, start=30).source
    assert np.allclose(np.linalg.norm(s[:, :2] - CENTRE[:2], axis=1), 250)
    assert np.allclose(s[:, 2], 7 + 1000)
    assert np.allclose(lengths(s)[np.arange(8), (np.arange(8) + 1) % 8], 2 * 250 * np.sin(np.pi / 8))
    first, second = s[0, :2] - CENTRE[:2], s[1, :2] - CENTRE[:2]
    assert np.allclose(first, 250 * np.array([np.sqrt(3) / 2, 0.5]))
    assert first[0] * second[1] - first[1] * second[0] > 0  # from +x towards +y


def test_linear_views_go_from_end_to_end_in_equal_steps():
    s = pp.linear_views(PANEL, length=300, height=900, count=7, direction=90, centre=(1, 2)).source
    assert np.allclose(np.diff(s, axis=0), [0, 50, 0])
    assert np.allclose((s[0] + s[-1]) / 2, [1, 2, 907])


def test_arc_views_stay_at_their_radius_and_positive_angles_lie_towards_x():
    s = pp.arc_views(PANEL, [-25, 0, 10], radius=650, pivot=(5, 6, 40)).source - [5, 6, 40]
    assert np.allclose(np.linalg.norm(s, axis=1), 650)
    assert np.allclose(s[:, 1], 0)
    assert np.allclose(np.degrees(np.arctan2(s[:, 0], s[:, 2])), [-25, 0, 10])


@pytest.mark.parametrize("cusps", [3, 4, 5])
def test_hypocycloid_is_drawn_by_a_rolling_circle(cusps):
    radius, count = 240.0, 60
    path = pp.hypocycloid_views(PANEL, radius=radius, height=1000, count=count, cusps=cusps).source[:, :2] - CENTRE[:2]
    rolled = 2 * np.pi * np.arange(count) / count
    small = radius / cusps
    hub = (radius - small) * np.stack([np.cos(rolled), np.sin(rolled)], axis=1)
    spoke = path - hub
    assert np.allclose(np.linalg.norm(spoke, axis=1), small)  # the pen sits on the small circle,
    turned = np.unwrap(np.arctan2(spoke[:, 1], spoke[:, 0]))
    assert np.allclose(turned, -(cusps - 1) * rolled)  # which rolls without slipping
    assert np.isclose(np.linalg.norm(path, axis=1), radius).sum() == (cusps if count % cusps == 0 else 1)


@given(
    angles=st.lists(st.floats(-180, 180), min_size=1, max_size=5),
    axis=st.tuples(finite, finite, finite).filter(lambda a: np.linalg.norm(a) > 0.1),
    pivot=st.tuples(finite, finite, finite),
)
def test_rotating_views_move_tube_panel_and_pivot_as_one_rigid_body(angles, axis, pivot):
    corners = [(0, 0), (0, 59), (39, 0)]
    pivot = 50 * np.array(pivot)
    views = pp.rotating_views(PANEL, angles, source=(30, 20, 1000), pivot=pivot, axis=axis)
    rest = np.vstack([[30, 20, 1000], PANEL.points(corners), pivot, pivot + axis])
    for s, panel in zip(views.source, views.panels, strict=True):
        body = np.vstack([s, panel.points(corners), pivot, pivot + axis])
        assert np.allclose(lengths(body), lengths(rest), atol=1e-8)
        assert np.allclose(np.linalg.det(body[1:4] - body[0]), np.linalg.det(rest[1:4] - rest[0]))  # not mirrored


def test_rotation_about_y_carries_the_tube_from_z_towards_x():
    views = pp.rotating_views(PANEL, [90], source=(0, 0, 1000))
    assert np.allclose(views.source[0], [1000, 0, 0])
    assert np.allclose(views.panels[0].column_axis, [0, 0, -1])


@pytest.mark.parametrize("make", [pp.circular_views, pp.hypocycloid_views])
def test_the_fulcrum_plane_stands_still_and_others_move(make):
    views = make(PANEL, radius=200, height=1000, count=5, fulcrum=60)
    still = views.project([[-12, 8, 67], [3, 20, 67]])
    assert np.allclose(still, still[:1])
    assert np.ptp(views.project([[-12, 8, 90]]), axis=0).max() > 10


@settings(max_examples=50)
@given(
    point=st.tuples(finite, finite, st.floats(0.05, 0.8)),
    turn=st.floats(-40, 40),
    mirrored=st.booleans(),
)
def test_source_point_and_landing_pixel_lie_on_one_line(point, turn, mirrored):
    panel = pp.Panel((40, 60), (0.5, 0.4), (-20, 3, -30), (0, -1 if mirrored else 1, 0))
    views = pp.rotating_views(panel, [0, turn], source=(4, -7, 600))
    p = np.array(point) * [80, 80, 300]
    for k in range(2):
        landed = views.panels[k].points(views.project(p)[k])[0]
        a, b = p - views.source[k], landed - views.source[k]
        assert np.linalg.norm(np.cross(a, b)) <= 1e-9 * np.linalg.norm(a) * np.linalg.norm(b)
        assert a @ b > 0


def test_a_panel_knows_its_pixels():
    assert np.allclose(PANEL.points([(0, 0), (2, 0), (0, 3)]), [(-20, 3, 7), (-20, 4, 7), (-18.8, 3, 7)])


def test_views_can_be_chosen():
    views = pp.circular_views(PANEL, radius=250, height=1000, fulcrum=10)
    chosen = views[1::3]
    assert chosen.shape == (3, 40, 60)
    assert np.array_equal(chosen.source, views.source[[1, 4, 7]])
    assert chosen.panels[1] is views.panels[4]


TILTED = pp.Panel((4, 4), (1, 1), (0, 0, 0), (0, 1, 0), (1, 0, 1))
REFUSED = {
    "60 m source": (lambda: pp.Views([[0, 0, 60_000]], PANEL), ["view 0", "60 m", "check the units"]),
    "source in the panel": (lambda: pp.Views([[500, 0, 7]], PANEL), ["view 0", "500", "check origin and axes"]),
    "NaN source": (lambda: pp.Views([[0, 0, 900], [0, np.nan, 9]], PANEL), ["view 1", "nan"]),
    "source shape": (lambda: pp.Views([1, 2, 3], PANEL), ["source", "(views, 3)", "(3,)"]),
    "panels for views": (lambda: pp.Views([[0, 0, 900]] * 3, [PANEL] * 2), ["panels", "3", "2"]),
    "pitch": (lambda: pp.Panel((4, 4), (0, 1), (0, 0, 0)), ["pitch", "positive", "(0, 1)"]),
    "shape": (lambda: pp.Panel((4, 2.5), (1, 1), (0, 0, 0)), ["panel shape", "whole", "2.5"]),
    "axes": (lambda: pp.Panel((4, 4), (1, 1), (0, 0, 0), (1, 1, 0), (1, 0, 0)), ["row_axis", "not orthogonal"]),
    "huge panel": (lambda: pp.Panel((4000, 4000), (140, 140), (0, 0, 0)), ["560000", "check the units"]),
    "radius": (lambda: pp.circular_views(PANEL, radius=-1, height=9), ["radius", "positive", "-1"]),
    "height": (lambda: pp.linear_views(PANEL, length=10, height=0), ["height", "positive", "0"]),
    "count": (lambda: pp.linear_views(PANEL, length=10, height=9, count=1), ["count", "at least 2", "1"]),
    "cusps": (lambda: pp.hypocycloid_views(PANEL, radius=9, height=9, cusps=2), ["cusps", "at least 3", "2"]),
    "tilted": (lambda: pp.circular_views(TILTED, radius=9, height=99), ["level panel", "rotating_views"]),
    "fulcrum": (lambda: pp.circular_views(PANEL, radius=9, height=99, fulcrum=100), ["fulcrum", "below 99", "100"]),
    "no angles": (lambda: pp.arc_views(PANEL, [], radius=9), ["angles", "at least one"]),
    "angles in what": (lambda: pp.arc_views(PANEL, [1500], radius=900), ["angles", "degrees", "1500"]),
    "axis": (lambda: pp.rotating_views(PANEL, [0], source=(0, 0, 9), axis=(0, 0, 0)), ["axis", "positive"]),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_with_name_value_and_remedy(case):
    act, words = REFUSED[case]
    with pytest.raises(GeometryError) as refusal:
        act()
    for word in words:
        assert word in str(refusal.value)
