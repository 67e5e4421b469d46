"""What a ball leaves in another slice: a ring where the source moves on a circle, a streak where it moves on a line."""

import numpy as np

from palpate.arrays import AnyArray
from palpate.studies.tomosynthesis.config import HEIGHT, RADIUS, phantom
from palpate.studies.tomosynthesis.image_quality import ImageQuality

BALL = 8  # part of the phantom: the bright ball at z = 70 mm
SLICE = 38.0  # mm, far below it
REACH = 1.45  # radii of the ring around its centre that are looked at: no other insert lies there


def ghost_shape(values: AnyArray, image_quality: ImageQuality) -> dict[str, float]:
    """ring: power of the ghost at the ring's radius over that at its centre. streak: its second moment along x over y.

    A source at s, seen from a ball at b, casts its ghost to b + m (b - s) in a slice at z, m = (b_z - z) / (s_z - b_z):
    sources on a circle of radius R to a circle of radius m R, those on a line to a line.
    """
    grid = image_quality.setting.grid
    low, high = phantom().parts[BALL][0].bounds()
    ball = (low + high) / 2
    k = int(np.argmin(np.abs(grid.axis("z") - SLICE)))
    m = (ball[2] - grid.axis("z")[k]) / (HEIGHT - ball[2])
    x = grid.axis("x") - (1 + m) * ball[0]
    y = grid.axis("y")[:, None] - (1 + m) * ball[1]
    radius = np.hypot(x, y) / (m * RADIUS)
    plain = np.median(values[k][image_quality.slab[k]])
    power = (values[k] - plain).astype(np.float64) ** 2 * (radius < REACH)
    ring = power[np.abs(radius - 1) < 0.25].mean() / power[radius < 0.35].mean()
    return {"ring": float(ring), "streak": float((power * x**2).sum() / (power * y**2).sum())}
