"""Suppresses warnings and log lines of libraries; palpate's own error names the problem."""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

TALKERS = ("pydicom", "pylibjpeg", "openjpeg", "tifffile", "nibabel.global")


@contextmanager
def suppress_output() -> Iterator[None]:
    """Context in which readers print no warnings and no log lines."""
    levels = {name: logging.getLogger(name).level for name in TALKERS}
    for name in TALKERS:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            warnings.filterwarnings("always", category=UserWarning, module=r"palpate\.")  # a reader's own word
            yield
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)
