"""What the places and the order of the focal spots give away."""

import numpy as np
import pytest
from support.wrong_scans import mistaken, setting

import palpate as pp
from palpate.scans.plausibility import check_distance, check_geometry
from palpate.scans.source_path import degrees_as_radians


def circle(t):
    return 200 * np.cos(t), 200 * np.sin(t)


def ellipse(t):
    return 250 * np.cos(t), 120 * np.sin(t)


def deltoid(t):
    return 80 * (2 * np.cos(t) + np.cos(2 * t)), 80 * (2 * np.sin(t) - np.sin(2 * t))


@pytest.mark.parametrize("path", [circle, ellipse, deltoid])
@pytest.mark.parametrize("count", range(7, 25))
def test_degrees_taken_as_radians_lie_on_the_path_at_other_places(path, count):
    degrees = 17 + 360 * np.arange(count) / count

    def spots(t):
        return np.column_stack([*path(t), np.full(count, 700.0)])

    assert degrees_as_radians(spots(degrees))
    assert not degrees_as_radians(spots(np.radians(degrees)))


def test_open_paths_have_no_such_steps():
    t = np.radians(np.linspace(-20, 20, 11))
    arc = np.column_stack([600 * np.sin(t), 0 * t, 600 * np.cos(t)])
    line = np.column_stack([300 * t, 100 * t, 0 * t + 700])
    bent = line + np.column_stack([0 * t, 40 * t**2, 0 * t])
    assert not any(degrees_as_radians(spots) for spots in (arc, line, bent))


def test_radians_of_a_hypocycloid_are_named():
    case = mistaken(setting(3, "hypocycloid", "slab"), "radians", 1, np.random.default_rng(0))
    assert pp.check_scan(case.scan, case.grid)[0].cause == "angle units"


@pytest.mark.parametrize(("height", "noted"), [(700, False), (520, False), (420, True)])
def test_focal_spots_nearer_than_in_any_unit_for_patients_are_noted(height, noted):
    panel = pp.Panel((40, 48), (4, 4), (-94, -78, 0))
    views = pp.Views([(x, 0, height) for x in (-100, 0, 100)], panel)
    assert check_geometry(views) == []
    said = check_distance(views)
    assert bool(said) == noted
    assert not any(finding.alarm for finding in said)
