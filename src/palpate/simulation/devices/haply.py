"""Inverse3 and its kin, through the Inverse Service that the user has installed (Haply Hub)."""

import os
from typing import Any

import numpy as np

from palpate import _core
from palpate.errors import DataError
from palpate.simulation.devices.haptic import Haptic

ADDRESS = "localhost:10001"  # where the service listens by default


def driver(address: str | None = None, rate: int = 1000) -> Any:
    """Of the service's first device, `rate` ticks a second."""
    address = address or os.environ.get("PALPATE_HAPLY", ADDRESS)
    host, _, port = address.removeprefix("ws://").rstrip("/").rpartition(":")
    if not host or not port.isdigit():
        raise DataError(f"address: {address!r}, expected host:port, as in {ADDRESS}")
    try:
        return _core.haply(host.strip("[]"), int(port), rate)
    except (ValueError, TypeError) as problem:
        raise DataError(f"address, rate: {problem}") from None


class Haply(Haptic):
    """A device of Haply's. address: of its service (default: PALPATE_HAPLY, or localhost:10001).

    rate: ticks a second, 500 to 5000. The rest: see `Haptic`. Its frame is the user's already.
    """

    axes = np.eye(3)

    def __init__(self, address: str | None = None, rate: int = 1000, **settings: Any) -> None:
        super().__init__(driver(address, rate), **settings)
