"""The bright ball is found where it is, at any size and place, whatever ridges lie around it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate import Grid, Volume
from palpate.errors import DataError
from palpate.volumes.lesion_detection import ball, find_inclusion

GRID = Grid((24, 60, 80), (1.0, 0.5, 0.5), (-20.0, 3.0, -12.0))


def organ_with(centre, radius, contrast, seed=0):
    rng = np.random.default_rng(seed)
    values = np.full(GRID.shape, 0.05) + 0.002 * rng.standard_normal(GRID.shape)
    values[:, 20:22, :] += 0.6 * contrast  # a vessel, nearly as bright
    values[ball(GRID, centre, radius)] += contrast
    return Volume(values, GRID)


@settings(max_examples=12, deadline=None)
@given(
    x=st.floats(-12, 12), y=st.floats(16, 24), z=st.floats(-7, 7), radius=st.floats(1.5, 3.5), seed=st.integers(0, 99)
)
def test_a_bright_ball_is_found_where_it_is(x, y, z, radius, seed):
    found = find_inclusion(organ_with((x, y, z), radius, 0.05, seed), np.ones(GRID.shape, bool))
    assert np.linalg.norm(np.array(found.centre) - (x, y, z)) < 1.0
    assert found.radius == pytest.approx(radius, rel=0.25)
    assert found.contrast == pytest.approx(0.05, rel=0.25)
    assert found.prominence > 1.3


def test_a_vessel_alone_is_no_ball():
    plain = find_inclusion(organ_with((0, 18, 0), 2.5, 0.05), np.ones(GRID.shape, bool))
    none = find_inclusion(organ_with((99, 99, 99), 1, 0.05), np.ones(GRID.shape, bool))
    assert none.prominence < 1.3 < plain.prominence


def test_ball_has_the_volume_of_a_ball():
    inside = ball(GRID, (0, 18, 0), 6.0)
    assert inside.sum() * GRID.voxel_volume == pytest.approx(4 / 3 * np.pi * 6**3, rel=0.02)  # voxels are in or out


def test_no_organ_is_refused():
    volume = organ_with((0, 18, 0), 2, 0.05)
    with pytest.raises(DataError, match=r"inside.*\(24, 60, 80\)"):
        find_inclusion(volume, np.zeros(GRID.shape, bool))
    with pytest.raises(DataError, match=r"inside.*\(2, 2, 2\)"):
        find_inclusion(volume, np.ones((2, 2, 2), bool))
    with pytest.raises(DataError, match="brighter"):
        find_inclusion(Volume(np.ones(GRID.shape), GRID), np.ones(GRID.shape, bool))
