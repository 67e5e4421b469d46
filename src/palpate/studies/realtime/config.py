"""What is timed, and for how long: the full study, and a small one for tests."""

from dataclasses import dataclass

import numpy as np

from palpate.arrays import Float64
from palpate.tissue.models.registry import names
from palpate.tissue.tissue import Tissue

DEPTH = 3.0  # mm, pressed in
SWING = 15.0  # mm, to either side along the kidney
SPEED = 0.05  # mm a tick: 50 mm/s
RAMP = 300  # ticks in which the press comes on, not judged
HAND = 16  # ticks between two commands of a hand, some 60 a second


@dataclass(frozen=True)
class Setting:
    """kidneys: name and edge length, mm. ticks: of a slide. seconds: of a loop; watched: of a page, for each of modes."""

    quick: bool
    kidneys: tuple[tuple[str, float], ...]
    models: tuple[str, ...]
    ticks: int
    seconds: float
    watched: float
    modes: tuple[str, ...] = ("Smooth", "Wireframe", "See inside")


FULL = Setting(False, (("low", 8.0), ("medium", 5.0), ("high", 3.5), ("finest", 2.36)), names(), 5_000, 10.0, 6.0)
QUICK = Setting(True, (("low", 12.0),), ("blocks", "compliance"), 600, 1.0, 1.0, ("Wireframe",))


def path(tissue: Tissue, ticks: int) -> tuple[Float64, Float64]:
    """(ticks, 3) mm on the skin, to and fro along the kidney's front, and the displacement (3,) that presses it in."""
    nodes = tissue.mesh.nodes
    front = nodes[np.argmin(nodes[:, 1])]
    phase = (SPEED * np.arange(ticks) + SWING) % (4 * SWING)
    along = np.abs(phase - 2 * SWING) - SWING
    points = [tissue.surface.closest(front + [0.0, 0.0, z]).point for z in along]
    return np.array(points), np.array([0.0, DEPTH, 0.0])
