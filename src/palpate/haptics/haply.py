"""Inverse3 and its kin, through the Inverse Service that the user has installed (Haply Hub)."""

import os
from typing import Any

import numpy as np

from palpate import _core
from palpate.errors import DataError
from palpate.haptics.haptic_device import Haptic

ADDRESS = "localhost:10001"  # where the service listens by default


def driver(address: str | None = None, rate: int = 1000) -> Any:
    """Of the service's first device, `rate` ticks a second."""
    address = address or os.environ.get("PALPATE_HAPLY", ADDRESS)
    host, _, port = address.removeprefix("ws://").rstrip("/").rpartition(":")
    if not host or not port.isdigit():
        raise DataError(f"address: {address!r}, expected host:port, as in {ADDRESS}")
    try:
        return _core.haptics.haply(host.strip("[]"), int(port), rate)
    except (ValueError, TypeError) as problem:
        raise DataError(f"address, rate: {problem}") from None


class Haply(Haptic):
    """A device of Haply.

    `with` starts and stops it. It was tried against a stand-in only.

    Parameters
    ----------
    address : str, optional
        Address of the service. The default is PALPATE_HAPLY, or localhost:10001.
    rate : int, optional
        Ticks a second, 500 to 5000.
    **settings
        As for `OpenHaptics`.

    Raises
    ------
    DeviceError
        If the device does not answer. Its `fault` names the reason.
    DataError
        If a setting is not valid.

    Examples
    --------
    >>> try:
    ...     pp.Haply(address="localhost:1")
    ... except pp.errors.DeviceError as problem:
    ...     print("no device")
    no device
    """

    axes = np.eye(3)

    def __init__(self, address: str | None = None, rate: int = 1000, **settings: Any) -> None:
        super().__init__(driver(address, rate), **settings)
