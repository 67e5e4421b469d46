"""Which devices with motors answer here."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from palpate.errors import DataError, DeviceError
from palpate.simulation.devices import force_dimension, haply, open_haptics
from palpate.simulation.devices.haptic import Found, sighted

_DRIVERS: dict[str, Callable[[], Any]] = {
    "OpenHaptics": open_haptics.driver,
    "Force Dimension": force_dimension.driver,
    "Haply": haply.driver,
}


@dataclass(frozen=True)
class Sighting:
    """Of one maker's interface: the device that answered, or the fault's name and what to do about it."""

    driver: str
    found: Found | None
    fault: str
    text: str


def look_for_devices() -> list[Sighting]:
    """Tries each maker's interface: opens its first device, asks what it is, and closes it. No force is given."""
    return [_look(name, make) for name, make in _DRIVERS.items()]


def find_devices() -> list[Found]:
    """The devices with motors that answer here, at most one of each maker's. No force is given."""
    return [sighting.found for sighting in look_for_devices() if sighting.found]


def _look(name: str, make: Callable[[], Any]) -> Sighting:
    try:
        found = sighted(make())
    except DeviceError as problem:
        return Sighting(name, None, problem.fault, str(problem))
    except DataError as problem:
        return Sighting(name, None, "setting", str(problem))
    return Sighting(name, found, "", "")
