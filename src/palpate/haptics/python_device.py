"""Devices that a user writes in Python: the servo runs in a Python thread instead of a maker's."""

import threading
import time
from typing import Any, Protocol

import numpy as np

from palpate import _core
from palpate.arrays import ArrayLike, Float64
from palpate.haptics.haptic_device import Found, Haptic

MAX_AGE = 0.1  # s, the age at which an answer or a tick is too old: a Python thread may wait for others


class Device(Protocol):
    """What `register_device` asks of a class. Its frame: x to the right, y away from the user, z up; mm, N.

    rate: readings a second, 500 to 5000. force: N, and stiffness: N/mm, the most that the device can show. lowest,
    highest: (3,) mm, corners of its workspace, whose origin is put in the middle of the organ.
    """

    rate: int
    force: float
    stiffness: float
    lowest: ArrayLike
    highest: ArrayLike

    def __init__(self, where: str | None) -> None: ...

    def read(self) -> tuple[ArrayLike, int]:
        """Position (3,) mm of the hand, and the buttons as bits; with bit 0 the tool holds the tissue."""

    def write(self, force: Float64) -> None:
        """Force (3,) N on the hand; zero at the end."""


class PythonDevice(Haptic):
    """A `Device` of a user's own, with the servo's virtual coupling, limits and passivity controller."""

    axes = np.eye(3)

    def __init__(self, name: str, own: Device, **settings: Any) -> None:
        super().__init__(_Driver(name, own), **settings)


class _Driver:
    """What `Haptic` asks of a driver, by a thread that reads the device and writes the force of the servo."""

    def __init__(self, name: str, own: Device) -> None:
        self.name, self.own = name, own
        self.ended = threading.Event()
        self.thread: threading.Thread | None = None

    def open(self) -> Found:
        return Found(self.name, type(self.own).__name__, "", "")

    def limits(self) -> Any:
        settings = _core.haptics.ServoSettings()
        settings.period, settings.max_age = 1 / self.own.rate, MAX_AGE
        settings.force, settings.stiffness = float(self.own.force), float(self.own.stiffness)
        settings.lowest = np.asarray(self.own.lowest, float).tolist()
        settings.highest = np.asarray(self.own.highest, float).tolist()
        return settings

    def start(self, servo: Any) -> None:
        self.thread = threading.Thread(target=self._run, args=(servo,), daemon=True)
        self.thread.start()

    def stop(self) -> None:
        self.ended.set()
        if self.thread is not None:
            self.thread.join()
            self.thread = None

    def _run(self, servo: Any) -> None:
        servo.restart()
        due = time.perf_counter()
        try:
            while not self.ended.is_set():
                position, buttons = self.own.read()
                force = servo.tick(np.asarray(position, float).tolist(), int(buttons), time.monotonic_ns())
                self.own.write(np.array(force))
                due = max(due + 1 / self.own.rate, time.perf_counter() - MAX_AGE / 2)
                time.sleep(max(0.0, due - time.perf_counter()))
        finally:  # an error of the device's own ends its run, too
            servo.lose()
            self.own.write(np.zeros(3))
