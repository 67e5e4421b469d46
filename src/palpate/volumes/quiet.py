"""What libraries mumble about a damaged file stays unheard: the refusal says it."""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

TALKERS = ("pydicom", "pylibjpeg", "openjpeg", "tifffile", "nibabel.global")


@contextmanager
def quiet() -> Iterator[None]:
    """No warnings and no log lines of the readers within."""
    levels = {name: logging.getLogger(name).level for name in TALKERS}
    for name in TALKERS:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)
