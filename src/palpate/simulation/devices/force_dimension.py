"""Omega, Delta, Sigma, Lambda and Falcon, through the Force Dimension library that the user has installed."""

import os
from typing import Any

import numpy as np

from palpate import _core
from palpate.errors import DataError
from palpate.simulation.devices.haptic import Haptic


def driver(library: str | None = None, rate: int = 1000) -> Any:
    """Of the first device, `rate` ticks a second."""
    try:
        return _core.force_dimension(library or os.environ.get("PALPATE_LIBDHD", ""), rate)
    except ValueError as problem:
        raise DataError(str(problem)) from None


class ForceDimension(Haptic):
    """A device of Force Dimension's. library: path of libdhd.so (default: PALPATE_LIBDHD, or where the loader looks).

    rate: ticks a second, 500 to 5000. The rest: see `Haptic`.
    """

    axes = np.array([[0, 1.0, 0], [-1.0, 0, 0], [0, 0, 1.0]])  # the maker's x is towards the user, its y to the right

    def __init__(self, library: str | None = None, rate: int = 1000, **settings: Any) -> None:
        super().__init__(driver(library, rate), **settings)
