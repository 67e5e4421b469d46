"""Centre lines against those of tubes whose axis is known."""

import numpy as np
import pytest
from support.lumens import R, bent, blind, forked, straight

import palpate as pp

TURNED = np.array([[0.8, 0, 0.6], [0, 1, 0], [-0.6, 0, 0.8]])


@pytest.mark.parametrize("spacing", [(1, 1, 1), (2.5, 1.2, 0.9)])
@pytest.mark.parametrize("direction", [None, TURNED])
def test_a_straight_tube(spacing, direction):
    labels, middle, axis = straight(spacing, direction=direction)
    line = pp.centerline(labels, "tube")
    apart = line.points - middle
    along = apart @ axis
    voxel = max(spacing)
    off = np.linalg.norm(apart - along[:, None] * axis, axis=1)
    assert off.max() < voxel
    assert np.ptp(along) == pytest.approx(45, abs=2 * voxel)
    np.testing.assert_allclose(line.radius, R - off, atol=0.75 * voxel)
    assert not line.branch.any()
    assert len(line.openings) == 2
    np.testing.assert_allclose(np.sort(line.openings[:, 3:] @ axis), [-1, 1], atol=1e-9)
    at = line.openings[:, :3] - middle
    np.testing.assert_allclose(np.abs(at @ axis), 22.5, atol=voxel)
    np.testing.assert_allclose(np.sign(at @ axis), np.sign(line.openings[:, 3:] @ axis))


def test_a_bend_is_followed_in_the_middle():
    labels, center = bent()
    line = pp.centerline(labels, 1)
    _, y, z = (line.points - center).T
    x = line.points[:, 0] - center[0]
    assert np.hypot(np.hypot(y, z) - 25, x).max() < 1.2
    steps = np.linalg.norm(np.diff(line.points, axis=0), axis=1)
    assert steps.sum() == pytest.approx(25 * np.pi / 2, rel=0.04)
    assert len(line.openings) == 2


def test_a_fork_has_a_branch_with_an_opening_of_its_own():
    line = pp.centerline(forked(), 1)
    assert np.unique(line.branch).tolist() == [0, 1]
    assert len(line.openings) == 3
    main, side = (line.points[line.branch == b] for b in (0, 1))
    assert np.linalg.norm(main - side[0], axis=1).min() < 3  # it leaves the other one
    away = side[-1] - side[0]
    assert abs(away[1]) == pytest.approx(abs(away[2]), rel=0.25)  # at 45 degrees
    assert np.median(line.radius[line.branch == 1]) < np.median(line.radius[line.branch == 0])


def test_a_closed_lumen_has_no_opening():
    labels, middle = blind()
    line = pp.centerline(labels, 1)
    assert line.openings.shape == (0, 6)
    assert np.linalg.norm(line.points - middle, axis=1).min() < 2


def test_a_bump_of_the_wall_is_no_branch():
    labels, _, _ = straight((1, 1, 1))
    values = np.array(labels.values)
    z, y, x = np.indices(values.shape)
    values[np.hypot(np.hypot(z - 20, y - 13), x - 20) < 4] = 1
    assert not pp.centerline(pp.Labels(values, labels.grid), 1).branch.any()


def test_an_absent_label_is_refused():
    labels, _, _ = straight()
    with pytest.raises(pp.errors.DataError, match="absent"):
        pp.centerline(labels, "colon")
