"""PHANToM and Touch, through the OpenHaptics library that the user has installed."""

import os
from typing import Any

import numpy as np

from palpate import _core
from palpate.haptics.haptic_device import Haptic


def driver(library: str | None = None, name: str = "") -> Any:
    """Of the device called `name` in the maker's set-up, or of the first one."""
    return _core.haptics.open_haptics(library or os.environ.get("PALPATE_LIBHD", ""), name)


class OpenHaptics(Haptic):
    """A PHANToM or Touch device.

    Its library calls the servo at 1 kHz from a thread of its own. `with` starts and stops it. It was tried against a stand-in
    only.

    Parameters
    ----------
    library : str, optional
        Path of libHD.so. The default is PALPATE_LIBHD, or where the loader looks.
    name : str, optional
        Name of the device in the maker's set-up.
    **settings
        scale (world mm for a mm of the hand), rotation (3, 3), offset (3,) mm, force N and stiffness N/mm: the most that
        the device gives. energy mJ: given to the hand in a contact, from which on the force fades, without a damper then.

    Raises
    ------
    DeviceError
        If the device does not answer. Its `fault` names the reason.
    DataError
        If a setting is not valid.

    Examples
    --------
    >>> try:
    ...     pp.OpenHaptics(library="missing.so")
    ... except pp.errors.DeviceError as problem:
    ...     print("no device")
    no device
    """

    axes = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])  # the maker's y is up, its z towards the user

    def __init__(self, library: str | None = None, name: str = "", **settings: Any) -> None:
        super().__init__(driver(library, name), **settings)
