"""What every device with motors shares: it is opened, its servo runs at its own rate, and its force is zero at the end."""

import atexit
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

import numpy as np

from palpate import _core
from palpate.arrays import Float64, float64
from palpate.errors import DataError, DeviceError

Vector = tuple[float, float, float]
NO_DAMPING = 1e-9  # N s/mm


@dataclass(frozen=True)
class Found:
    """A device that answered: the maker's interface, and what the device says of itself."""

    driver: str
    model: str
    serial: str
    version: str


@dataclass(frozen=True)
class Status:
    """How a device fares. force: N on the hand, position: mm of the hand, both in the world's frame.

    ticks, late: readings, and how many came more than half a period late. period, worst: s between readings, the last
    and the longest. energy: mJ taken from the hand in this contact, below zero if it was given some; damping: N s/mm
    that the passivity controller adds now. gain: 0 to 1, the ramp. fault: its short name ("none" if all is well), text:
    what to do; last: the newest fault that was not mere waiting; faults: how many. zeroed: the force is zero.
    """

    ticks: int
    late: int
    period: float
    worst: float
    energy: float
    damping: float
    gain: float
    force: Vector
    position: Vector
    fault: str
    text: str
    last: str
    faults: int
    zeroed: bool


class Haptic:
    """A device with motors. Opened by its making; `start` and `stop`, or `with`, run its servo.

    scale: mm in the world for a mm of the hand. rotation: (3, 3), from the user's frame (x right, y away, z up) to the
    world. offset: mm, where the device's origin lies in the world. force: N, and stiffness: N/mm, the most it shall
    give, by default and at most what the device bears. energy: mJ given to the hand in a contact from which on the force
    fades; at twice that it is zero; then no damper takes energy back, which would answer at once to whoever else moves the
    tissue. Raises `DeviceError` (its `fault` says which) if the device does
    not answer, `DataError` on settings that cannot be. The servo answers to a solver loop: a session.
    """

    axes: Float64  # (3, 3), from the device's frame to the user's

    def __init__(
        self,
        driver: Any,
        *,
        scale: float = 1.0,
        rotation: Any = None,
        offset: Any = (0.0, 0.0, 0.0),
        force: float | None = None,
        stiffness: float | None = None,
        energy: float | None = None,
    ) -> None:
        self.driver = driver
        self.found = _found(calling(driver.open))
        try:
            settings = self._settings(driver.limits(), scale, rotation, offset, force, stiffness)
            if energy is not None:
                settings.energy_limit, settings.max_damping = float(energy), NO_DAMPING
            try:
                self.servo = _core.haptics.Servo(settings)
            except ValueError as problem:
                raise DataError(f"{self.found.driver}: {problem}") from None
        except DataError:
            driver.stop()
            raise
        self.core: Any = _core.haptics.ServoDevice(self.servo)  # what a session asks of a device

    def _settings(
        self, bounds: Any, scale: float, rotation: Any, offset: Any, force: float | None, stiffness: float | None
    ) -> Any:
        for name, value, most in (("force", force, bounds.force), ("stiffness", stiffness, bounds.stiffness)):
            if value is None:
                continue
            if not 0 < value <= most:
                raise DataError(f"{name}: {value:g}, expected more than 0 and at most {most:g}, which the device bears")
            setattr(bounds, name, float(value))
        bounds.damping = min(bounds.damping, 1e-3 * bounds.stiffness)
        turn = np.eye(3) if rotation is None else float64("rotation", rotation, (3, 3))
        if abs(np.linalg.det(turn) - 1) > 1e-6:
            raise DataError("rotation: a mirror or no rotation; give three orthogonal rows of length 1")
        bounds.scale = float(scale)
        bounds.rotation = (turn @ self.axes).ravel().tolist()
        bounds.offset = float64("offset", offset, (3,)).tolist()
        return bounds

    def start(self) -> None:
        """Runs the servo: from now on the device calls. Raises `DeviceError`."""
        calling(self.driver.start, self.servo)
        atexit.register(self.stop)  # a program that ends leaves no force behind

    def stop(self) -> None:
        """Leaves the device without force and closes it. To use it again, make a new one."""
        atexit.unregister(self.stop)
        self.driver.stop()

    def status(self) -> Status:
        """How it fares now. From one thread only."""
        now = self.servo.status()
        values = {name: getattr(now, name) for name in Status.__dataclass_fields__}
        return Status(**{**values, "force": tuple(now.force), "position": tuple(now.position)})

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()


def calling(function: Callable[..., Any], *arguments: Any) -> Any:
    """What `function` returns; the core's errors of devices become `DeviceError`."""
    try:
        return function(*arguments)
    except _core.haptics.DriverError as problem:
        fault, text = problem.args
        raise DeviceError(text, fault) from None


def sighted(driver: Any) -> Found:
    """Opens `driver`'s device, asks what it is, and closes it without force. Raises `DeviceError`."""
    try:
        return _found(calling(driver.open))
    finally:
        driver.stop()


def _found(found: Any) -> Found:
    return Found(found.driver, found.model, found.serial, found.version)
