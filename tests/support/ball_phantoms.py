"""Phantoms of balls before a tomosynthesis arc or a C-arm, and starts that are wrong by stated amounts.

Nothing here uses the code that calibrates: views are built by their own formulas, shadows by `pp.simulate_scan`.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

import palpate as pp

VIEWS = 15
# What a start may be off by: ten times the accuracy that is asked for.
TILT, ARC, DISTANCE = 1.0, 2.0, 0.02  # degrees, degrees at each end of the arc, of a distance
PLACED, TURNED = 3.0, 1.0  # mm and degrees by which the phantom lies elsewhere than thought


@dataclass(frozen=True, eq=False)
class BallCase:
    """True views and start, places of balls (N, 3) mm, their diameter mm, the block that holds them (2, 3) mm."""

    views: pp.Views
    start: pp.Views
    balls: np.ndarray
    diameter: float
    block: np.ndarray

    def scan(self, incident=2000.0, seed=0):
        """Counts of the phantom from its true place, said to be those of the start.

        The rays within a pixel are others, and mostly more, than those of the fit: equal ones would make it look too good.
        """
        holder = pp.Box(self.block.mean(axis=0), np.ptp(self.block, axis=0) + 20)
        parts = [(holder, 0.003)] + [(pp.Ellipsoid(ball, self.diameter / 2), 0.5) for ball in self.balls]
        fine = self.views.panels[0].pitch[0] < 0.4
        seen = pp.simulate_scan(pp.Phantom(parts), self.views, incident, seed, subrays=4 if fine else 8)
        return pp.Scan(seen.counts, seen.incident, self.start)


def direction(rng):
    way = rng.standard_normal(3)
    return way / np.linalg.norm(way)


def tilted(views, turn, shift=(0, 0, 0)):
    """Views whose panels are turned about their middles by a rotation in their own frame, and shifted."""
    panels = []
    for p in views.panels:
        own = np.stack([p.row_axis, p.column_axis, p.normal])
        row, column, _ = Rotation.from_rotvec(np.radians(turn)).as_matrix() @ own
        half = (np.array(p.shape) - 1) / 2
        middle = p.points(half)[0] + np.array(shift) @ own
        corner = middle - half[0] * p.pitch[0] * row - half[1] * p.pitch[1] * column
        panels.append(pp.Panel(p.shape, p.pitch, corner, row, column))
    same = all(np.array_equal(p.origin, panels[0].origin) for p in panels)
    return pp.Views(views.source, panels[0] if same else panels)


def displaced(views, turn, shift, centre):
    """Views as seen by an object that lies elsewhere: turned about a centre and shifted."""
    R = Rotation.from_rotvec(np.radians(turn)).as_matrix()

    def to(points):
        return (points - centre) @ R.T + centre + shift

    panels = [pp.Panel(p.shape, p.pitch, to(p.origin), R @ p.row_axis, R @ p.column_axis) for p in views.panels]
    same = all(np.array_equal(p.origin, panels[0].origin) for p in panels)
    return pp.Views(to(views.source), panels[0] if same else panels)


def ball_case(seed, motion, pitch, worse=1.0):
    """A random phantom of 16 to 27 balls of 2, 3 or 4 mm, a random `motion` (arc or orbit), tilted panel, wrong start.

    worse: times the stated amounts by which the start is wrong.
    """
    rng = np.random.default_rng(seed)
    sign = rng.choice([-1, 1], 4)
    if motion == "arc":
        half, block = rng.uniform(7, 25), np.array([[-50.0, -50, 10], [50, 50, 70]])
        shape = (round(150 / pitch),) * 2
        panel = pp.Panel(shape, (pitch, pitch), (-(shape[1] - 1) / 2 * pitch, -(shape[0] - 1) / 2 * pitch, 0))

        def views(off):
            ends = np.array([-half - off * ARC * sign[0], half + off * ARC * sign[0]])
            radius = 620 * (1 + off * DISTANCE * sign[1])
            return pp.arc_views(panel, np.linspace(*ends, VIEWS), radius=radius, pivot=(0, 0, 40))
    else:
        arc, first, block = rng.uniform(100, 200), rng.uniform(0, 90), np.array([[-60.0, -60, -60], [60, 60, 60]])
        shape = (round(300 / pitch),) * 2

        def views(off):
            return pp.orbit_views(
                shape,
                (pitch, pitch),
                source_to_centre=620 * (1 + off * DISTANCE * sign[0]),
                source_to_panel=1000 * (1 + off * DISTANCE * sign[1]),
                count=VIEWS,
                arc=arc + 2 * off * ARC * sign[2],
                start=first - off * ARC * sign[2],
            )

    diameter = float(rng.choice([2, 3, 4]))
    balls, count = [], int(rng.integers(16, 28))
    while len(balls) < count:
        ball = rng.uniform(*block)
        if all(np.linalg.norm(ball - other) > 3 * diameter for other in balls):
            balls.append(ball)
    balls = np.array(balls)
    own = rng.uniform(0, 5) * direction(rng)  # the panel is tilted in truth, and the start knows that but for TILT
    start = tilted(tilted(views(worse), own), worse * TILT * direction(rng), worse * rng.uniform(-2, 2, 3))
    placed = worse * rng.uniform(-PLACED, PLACED, 3)
    start = displaced(start, worse * TURNED * direction(rng), placed, balls.mean(axis=0))
    return BallCase(tilted(views(0), own), start, balls, diameter, block)


def angle(a, b):
    """Degrees between vectors (views, 3)."""
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ki,ki->k", a, b)))


def errors(found, true, balls):
    """RMS over views: tilt of the panel, its turn, direction of the source from the balls, degrees; distances, %."""
    middle = balls.mean(axis=0)
    normal = [np.array([p.normal for p in v.panels]) for v in (found, true)]
    row = [np.array([p.row_axis for p in v.panels]) for v in (found, true)]
    to_balls = [np.linalg.norm(v.source - middle, axis=1) for v in (found, true)]
    to_panel = [
        np.array([abs((s - p.origin) @ p.normal) for s, p in zip(v.source, v.panels, strict=True)])
        for v in (found, true)
    ]
    every = {
        "tilt": angle(*normal),
        "turn": angle(*row),
        "arc": angle(found.source - middle, true.source - middle),
        "source to balls": 100 * (to_balls[0] / to_balls[1] - 1),
        "source to panel": 100 * (to_panel[0] / to_panel[1] - 1),
    }
    return {name: float(np.sqrt(np.mean(e**2))) for name, e in every.items()}
