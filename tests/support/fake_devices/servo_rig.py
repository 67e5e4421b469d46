"""A servo under a clock of its own, with a wall below z = 0 as its solver."""

import numpy as np

from palpate import _core

MS = 1_000_000  # ns
UP = (0.0, 0.0, 1.0)
ORIGIN = (0.0, 0.0, 0.0)
NONE = [0.0] * 9


def settled(**changes):
    """Settings of a calm little device; the ramp is over at once."""
    s = _core.haptics.ServoSettings()
    s.stiffness, s.damping, s.force, s.ramp, s.recovery = 0.5, 5e-4, 3.0, 1e-3, 0.02
    for name, value in changes.items():
        setattr(s, name, value)
    return s


class Rig:
    """A servo under a clock of its own, with a wall below z = 0 as the solver unless told otherwise."""

    def __init__(self, servo_settings, stiffness=0.5, **wall):
        self.servo = _core.haptics.Servo(servo_settings)
        self.wall = _core.haptics.VirtualWall(self.servo, stiffness, ORIGIN, UP, **wall)
        self.now = 1_000_000_000

    def tick(self, position, buttons=0, ms=1.0, solve=True):
        self.now += int(ms * MS)
        force = np.array(self.servo.tick(position, buttons, self.now))
        if solve:
            self.wall.answer()
        return force

    def rest(self, position, ticks):
        return np.array([self.tick(position) for _ in range(ticks)])[-1]
