"""A smooth surface around a mask that encloses as much as is asked."""

import numpy as np
import pytest

from palpate.meshes.stuffing.level_set import HIGH, LOW, Level

SPACING = np.array([2.0, 1.0, 1.5])  # z, y, x


@pytest.fixture(scope="module")
def ball():
    """Of 9 mm radius about (15, 12, 14) mm."""
    z, y, x = np.indices((15, 26, 21)) * SPACING[:, None, None, None]
    return Level((x - 15) ** 2 + (y - 12) ** 2 + (z - 14) ** 2 < 81, SPACING, 0.7 * SPACING)


@pytest.mark.parametrize("part", [0.6, 0.9, 1.0, 1.2])
def test_it_encloses_the_volume_that_is_asked(ball, part):
    wanted = part * 4 / 3 * np.pi * 9**3
    ball.enclose(wanted)
    points = np.stack(np.meshgrid(*[np.arange(0, n, 0.4) for n in (30, 26, 28)], indexing="ij"), axis=-1)
    assert np.count_nonzero(ball(points.reshape(-1, 3)) > 0) * 0.4**3 == pytest.approx(wanted, rel=0.01)


def test_what_cannot_be_enclosed_is_the_first_or_last_level(ball):
    ball.enclose(0.0)
    assert ball.level == HIGH
    ball.enclose(1e9)
    assert ball.level == LOW
