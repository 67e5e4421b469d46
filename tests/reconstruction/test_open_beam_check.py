"""An incident that is too large adds a constant to all line integrals, which no object has."""

import numpy as np
import pytest
from support.wrong_scans import disturbed, setting

import palpate as pp
from palpate.reconstruction.open_beam_check import check_open_beam

PANEL = pp.Panel((40, 48), (4, 4), (-94, -78, 0))
VIEWS = pp.arc_views(PANEL, np.linspace(-25, 25, 9), radius=650, pivot=(0, 0, 30))
FIELD = pp.Grid.centred((12, 60, 80), (10, 4, 4), x=0, y=0, z=60)


def behind_a_layer(constant):
    """Exact views of a layer of 60 mm that is wider than the panel, with a constant added to all line integrals."""
    rays = np.stack([PANEL.points(np.indices(PANEL.shape).reshape(2, -1).T) - s for s in VIEWS.source])
    slant = np.linalg.norm(rays, axis=2) / np.abs(rays[..., 2])
    l = 60 * 0.025 * slant.reshape(VIEWS.shape) + constant
    return pp.Scan(20_000 * np.exp(-l), 20_000, VIEWS)


@pytest.mark.parametrize("factor", [2.5, 3, 4])
def test_the_factor_is_told_where_no_view_shows_air(factor):
    (found,) = check_open_beam(behind_a_layer(np.log(factor)), FIELD)
    assert found.cause == "incident"
    told = float(found.message.split("about ")[1].split(" times")[0])
    assert abs(np.log(told / factor)) < 0.3


@pytest.mark.parametrize("constant", [0, 0.1, -0.2])
def test_a_layer_alone_is_an_object(constant):
    assert check_open_beam(behind_a_layer(constant), FIELD) == []


def test_sources_at_one_angle_cannot_tell_a_constant_from_a_layer():
    t = np.linspace(0, 2 * np.pi, 10)[:-1]
    around = pp.Views(np.column_stack([60 * np.cos(t), 60 * np.sin(t), 0 * t + 1500]), PANEL)
    counts = np.full(around.shape, 20_000 * np.exp(-1.5 - np.log(3)))
    assert check_open_beam(pp.Scan(counts, 20_000, around), FIELD) == []


@pytest.mark.parametrize("motion", ["arc", "linear", "hypocycloid"])
def test_an_object_wider_than_the_panel(motion):
    found = setting(28, motion, "trunk")
    wrong = pp.Scan(found.case.counts, 3 * found.case.incident, found.case.scan.views)
    assert [f.cause for f in pp.check_scan(wrong, found.case.grid)][:1] == ["incident"]
    for how in ("noise", "scatter", "gain drift"):
        right = disturbed(found, how, np.random.default_rng(1))
        assert pp.check_scan(right.scan, right.grid) == []
