"""Which devices with motors answer here."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from palpate.errors import DataError, DeviceError
from palpate.haptics import force_dimension, haply, open_haptics
from palpate.haptics.haptic_device import Found, Haptic, sighted
from palpate.haptics.python_device import PythonDevice
from palpate.meshes.tet_mesh import TetMesh
from palpate.plugins import names, part

_DRIVERS: dict[str, Callable[[], Any]] = {
    "OpenHaptics": open_haptics.driver,
    "Force Dimension": force_dimension.driver,
    "Haply": haply.driver,
}
DEVICES: dict[str, Callable[..., Haptic]] = {
    "open-haptics": open_haptics.OpenHaptics,
    "force-dimension": force_dimension.ForceDimension,
    "haply": haply.Haply,
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
    """Return the devices with motors that answer, at most one of each maker. No force is given.

    Returns
    -------
    list of Found
        Maker's interface, model, serial number and version.

    Examples
    --------
    >>> isinstance(pp.find_devices(), list)
    True
    """
    return [sighting.found for sighting in look_for_devices() if sighting.found]


def open_device(name: str, mesh: TetMesh, **settings: Any) -> Haptic:
    """The device called `name`, its origin in the middle of `mesh`, a mm of the hand a mm of the organ.

    A name may carry what the maker's class takes first, after a colon: "haply:localhost:10001", or the path of a library.
    settings: of `Haptic`. Raises `DeviceError` if it does not answer, `DataError` for a name that is none.
    """
    which, _, where = name.partition(":")
    if which not in names("device"):
        raise DataError(f"device: {which!r} is none; choose one of {', '.join(names('device'))}")
    middle = (mesh.nodes.min(axis=0) + mesh.nodes.max(axis=0)) / 2
    # The user's right, away and up are the mesh's x, y and z.
    if own := part("device", which):
        return PythonDevice(which, own(where or None), offset=middle, **settings)
    return DEVICES[which](where or None, offset=middle, **settings)


def _look(name: str, make: Callable[[], Any]) -> Sighting:
    try:
        found = sighted(make())
    except DeviceError as problem:
        return Sighting(name, None, problem.fault, str(problem))
    except DataError as problem:
        return Sighting(name, None, "setting", str(problem))
    return Sighting(name, found, "", "")
