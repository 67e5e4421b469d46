"""Parallax tells how deep an object lies; a wrong sense of rotation, or a wrong distance, puts it elsewhere."""

import numpy as np
import pytest
from support.wrong_scans import disturbed, mistaken, setting

import palpate as pp
from palpate.reconstruction.depth_check import check_depth
from palpate.scans.consistency import centre_of_mass, whole_views

PANEL = pp.Panel((70, 80), (2.5, 2.5), (-98.75, -86.25, -150))
PIVOT = np.array([0, 0, 25.0])  # of tube and panel, mm; the object's middle is at z = 0


def turned(angles):
    """Tube and panel that turn together about an axis along y."""
    sources, panels = [], []
    for a in np.radians(angles):
        R = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
        sources.append(PIVOT + R @ ((0, 0, 700) - PIVOT))
        panels.append(
            pp.Panel(
                PANEL.shape, PANEL.pitch, PIVOT + R @ (PANEL.origin - PIVOT), R @ PANEL.row_axis, R @ PANEL.column_axis
            )
        )
    return pp.Views(np.array(sources), panels)


ANGLES = np.linspace(-20, 20, 9)
GRID = pp.Grid.centred((12, 30, 36), (5, 2.5, 2.5), x=0, y=0, z=0)


def depth_findings(angles, close=True):
    solid = pp.Phantom([(pp.Ellipsoid((0, 0, 0), (40, 34, 24)), 0.02)])
    right = pp.simulate_scan(solid, turned(ANGLES), 20_000, seed=1, subrays=1)
    scan = pp.Scan(right.counts, right.incident, turned(angles))
    l = pp.line_integrals(scan).astype(float)
    centre = centre_of_mass(scan, l, whole_views(scan, l))
    return centre, check_depth(scan, l, centre, GRID, close)


def test_the_right_sense_of_rotation_puts_the_object_into_the_middle():
    centre, found = depth_findings(ANGLES)
    assert abs(centre.point[2]) < 5
    assert found == []


def test_the_wrong_sense_exchanges_what_is_before_the_axis_and_behind_it():
    centre, found = depth_findings(-ANGLES)
    assert centre.point[2] == pytest.approx(2 * PIVOT[2], abs=8)
    assert (found[0].cause, found[0].alarm) == ("view order", True)  # beyond the grid, whatever it was made for
    assert [f.cause for f in depth_findings(-ANGLES, close=False)[1]] == [f.cause for f in found]


@pytest.mark.parametrize(("seed", "size"), [(54, 0), (65, 0), (65, 1)])
def test_a_rotating_tube_that_turns_the_wrong_way(seed, size):
    found = setting(seed)
    case = mistaken(found, "mirrored angles", size, np.random.default_rng(0))
    assert "view order" in [finding.cause for finding in pp.check_scan(case.scan, case.grid)][:2]
    for how in ("noise", "scatter", "gain drift"):
        right = disturbed(found, how, np.random.default_rng(0))
        assert pp.check_scan(right.scan, right.grid) == []
