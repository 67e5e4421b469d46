"""A device of your own in one file: python examples/own_device.py

It is a computed hand: a mass under its weight, which is let fall onto the organ and comes to rest where the tissue carries
it. For the command, with 20 g:

    palpate --plugin examples/own_device.py touch tissue.vtu --device falling-mass:0.02
"""

import time

import numpy as np

import palpate as pp

GRAVITY = 9.81  # m/s²
DRAG = 10.0  # N s/m, as in oil: the mass sinks at 20 mm/s


@pp.register_device("falling-mass")
class FallingMass:
    """A mass that moves along z alone. It starts 60 mm above the middle of the organ."""

    rate = 500
    force, stiffness = 3.0, 0.3  # N, N/mm; with the drag it stays stable while the tissue answers within 50 ms
    lowest, highest = (-200.0, -200.0, -200.0), (200.0, 200.0, 200.0)

    def __init__(self, where=None):
        self.mass = float(where or 0.02)  # kg
        self.height, self.speed = 60.0, 0.0  # mm, mm/s
        self.felt = np.zeros(3)
        self.moved = None

    def read(self):
        """Where the mass is now; no button is down."""
        now = time.perf_counter()
        step = min(now - (self.moved or now), 0.01) / 8  # s; time stands still while the computer does other things
        for _ in range(8):
            push = self.felt[2] - self.mass * GRAVITY - DRAG * self.speed / 1000
            self.speed += 1000 * step * push / (self.mass + step * DRAG)
            self.height += step * self.speed
        self.moved = now
        return (0.0, 0.0, self.height), 0

    def write(self, force):
        """The force of the tissue on the mass."""
        self.felt = force


def soft_ball():
    """A ball of 30 mm and 5 kPa, whose lower quarter is held."""
    grid = pp.Grid((21, 21, 21), (4, 4, 4), (-40, -40, -40))
    ball = np.linalg.norm(grid.points(np.argwhere(np.ones(grid.shape))), axis=1).reshape(grid.shape) < 30
    mesh = pp.tetrahedralize(pp.Labels(ball.astype(np.int32), grid), 1, edge=8.0)
    return pp.Tissue(mesh, 5.0, 0.45, pp.fixed_beyond(mesh, (0, 0, -15), (0, 0, -1)))


def main(mass=0.02, longest=60.0):
    """Lets the mass fall on a ball of soft tissue until it has not moved for a second, at most for `longest` seconds. Gives
    its weight and the tissue's force on it, both in N, and the session's last frame."""
    from palpate.haptics.python_device import PythonDevice

    hand = FallingMass(mass)
    hand.height = 35.0
    with pp.Session(pp.model(soft_ball(), "compliance")) as session, PythonDevice("falling-mass", hand) as device:
        session.start(device)
        heights = [hand.height]  # mm, twenty times a second
        while len(heights) < 20 * longest and (hand.felt[2] == 0 or np.ptp(heights[-20:]) > 0.01):
            time.sleep(0.05)
            heights.append(hand.height)
        return mass * GRAVITY, float(hand.felt[2]), session.frame()


if __name__ == "__main__":
    weight, force, _ = main()
    print(f"a weight of {weight:.3f} N rests on the organ, which pushes back with {force:.3f} N")
