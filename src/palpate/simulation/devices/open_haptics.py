"""PHANToM and Touch, through the OpenHaptics library that the user has installed."""

import os
from typing import Any

import numpy as np

from palpate import _core
from palpate.simulation.devices.haptic import Haptic


def driver(library: str | None = None, name: str = "") -> Any:
    """Of the device called `name` in the maker's set-up, or of the first one."""
    return _core.open_haptics(library or os.environ.get("PALPATE_LIBHD", ""), name)


class OpenHaptics(Haptic):
    """A PHANToM or Touch. library: path of libHD.so (default: PALPATE_LIBHD, or where the loader looks).

    name: as in the maker's set-up. The rest: see `Haptic`. Its library calls at 1 kHz from a thread of its own.
    """

    axes = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])  # the maker's y is up, its z towards the user

    def __init__(self, library: str | None = None, name: str = "", **settings: Any) -> None:
        super().__init__(driver(library, name), **settings)
