"""Omega, Delta, Sigma, Lambda and Falcon, through the Force Dimension library that the user has installed."""

import os
from typing import Any

import numpy as np

from palpate import _core
from palpate.errors import DataError
from palpate.haptics.haptic_device import Haptic


def driver(library: str | None = None, rate: int = 1000) -> Any:
    """Of the first device, `rate` ticks a second."""
    try:
        return _core.haptics.force_dimension(library or os.environ.get("PALPATE_LIBDHD", ""), rate)
    except ValueError as problem:
        raise DataError(str(problem)) from None


class ForceDimension(Haptic):
    """A device of Force Dimension.

    `with` starts and stops it. It was tried against a stand-in only.

    Parameters
    ----------
    library : str, optional
        Path of libdhd.so. The default is PALPATE_LIBDHD, or where the loader looks.
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
    ...     pp.ForceDimension(library="missing.so")
    ... except pp.errors.DeviceError as problem:
    ...     print("no device")
    no device
    """

    axes = np.array([[0, 1.0, 0], [-1.0, 0, 0], [0, 0, 1.0]])  # the maker's x is towards the user, its y to the right

    def __init__(self, library: str | None = None, rate: int = 1000, **settings: Any) -> None:
        super().__init__(driver(library, rate), **settings)
