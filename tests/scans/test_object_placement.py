"""Where the object lies in the grid: a shift of all panels fits the data, and moves the object."""

import numpy as np
import pytest
from support.wrong_scans import disturbed, mistaken, setting

import palpate as pp
from palpate.scans.object_placement import check_field, check_outline

GRID = pp.Grid.centred((20, 50, 60), (4, 2, 2), x=0, y=0, z=40)  # x -60 to 60, y -50 to 50
WIDE = np.array([[-100, -90], [100, 90]], dtype=float)


def outline(x, y):
    return np.array([[x[0], y[0]], [x[1], y[1]]], dtype=float)


def test_an_object_in_the_middle_of_its_grid_is_no_finding():
    assert check_outline(outline((-54, 52), (-45, 45)), GRID, WIDE, 2.0, few=False) == []


def test_an_object_beyond_its_grid_is_an_alarm_by_the_distance_that_is_known():
    beyond = outline((-57, 62), (-45, 45))
    assert [f.cause for f in check_outline(beyond, GRID, WIDE, 2.0, few=False)] == ["object outside the grid"]
    assert [f.cause for f in check_outline(beyond, GRID, WIDE, 2.0, few=True) if f.alarm] == []
    farther = outline((-57, 65), (-45, 45))
    assert [f.cause for f in check_outline(farther, GRID, WIDE, 2.0, few=True)] == ["object outside the grid"]


def test_an_object_off_the_middle_of_a_grid_made_for_it_is_a_note_that_says_how_far():
    (found,) = check_outline(outline((-44, 59), (-45, 45)), GRID, WIDE, 2.0, few=False)
    assert (found.cause, found.alarm) == ("panel shifted", False)
    assert "+7.5 mm in x and +0 mm in y" in found.message


def test_a_small_object_in_a_large_grid_may_lie_anywhere():
    assert check_outline(outline((-55, -10), (-45, 0)), GRID, WIDE, 2.0, few=False) == []


def test_an_object_and_a_field_too_small_for_the_grid_ask_for_the_pitch():
    small, narrow = outline((-27, 26), (-22, 22)), np.array([[-50, -42], [50, 42]], dtype=float)
    assert [f.cause for f in check_outline(small, GRID, narrow, 2.0, few=False)] == ["pixel pitch"]


def test_a_grid_as_wide_as_the_field_is_expected_there():
    field = np.array([[-58, -52], [58, 52]], dtype=float)
    assert check_field(field, GRID, 2.0) == []
    (found,) = check_field(field + (0, 9), GRID, 2.0)
    assert (found.cause, found.alarm) == ("panel shifted", False)
    assert check_field(2 * field + (0, 9), GRID, 2.0) == []  # a part of the field was asked for


@pytest.mark.parametrize("seed", [0, 1, 28])  # a head that 3 of 8 views show whole; that all show; a truncated trunk
def test_a_common_shift_by_five_pixels_is_named_by_its_effect(seed):
    found = setting(seed)
    case = mistaken(found, "all views shifted", 0, np.random.default_rng(0))
    causes = [finding.cause for finding in pp.check_scan(case.scan, case.grid)]
    assert set(causes[:2]) & {"panel shifted", "object outside the grid"}, causes


@pytest.mark.parametrize(("motion", "thing"), [("circular", "head"), ("arc", "trunk"), ("linear", "slab")])
def test_a_right_scan_gets_no_note(motion, thing):
    case = disturbed(setting(20, motion, thing), "gain drift", np.random.default_rng(0))
    assert pp.check_scan(case.scan, case.grid) == []


def test_half_the_pitch_is_named_though_few_views_show_the_whole_object():
    found = setting(0)  # 3 of 8 views
    case = mistaken(found, "pixel pitch", 1, np.random.default_rng(0))
    assert pp.check_scan(case.scan, case.grid)[0].cause == "pixel pitch"


def test_a_cause_that_two_checks_find_keeps_the_first_place():
    found = setting(54)  # the views fit better in the other order, and the object then lies in the grid's middle
    case = mistaken(found, "mirrored angles", 0, np.random.default_rng(0))
    causes = [finding.cause for finding in pp.check_scan(case.scan, case.grid)]
    assert causes[0] == "view order"
    assert len(causes) == len(set(causes))
