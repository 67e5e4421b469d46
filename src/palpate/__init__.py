"""palpate: from X-ray projections to an organ you can touch.

The public names stand in `__init__.pyi`. Each is imported when it is first used, so that `palpate --help`
is quick.
"""

from contextlib import suppress
from importlib import import_module
from typing import Any

import lazy_loader

from palpate.interrupts import waiting
from palpate.version import __version__ as __version__

# Some compilers make one _core for each level of x86-64: the newest level that this CPU offers comes first.
with suppress(ModuleNotFoundError):
    __path__.insert(0, f"{__path__[0]}/{import_module('palpate._x86_64_level').level}")

_RENAMED = {  # in 0.2: old name, new name
    "Common": "Intersection",
    "Refinement": "Calibration",
    "demonstrate": "run_demo",
    "held_beyond": "fixed_beyond",
    "held_near": "fixed_near",
    "ladder": "select_model",
    "moved_panels": "shift_panels",
    "refine": "calibrate",
    "refined": "apply_calibration",
    "two_material": "two_material_beam_hardening",
    "two_material_likelihood": "two_material_beam_hardening_likelihood",
}
_load, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__all__.remove("__version__")


def __getattr__(name: str) -> Any:
    if name == "_core":  # nanobind aborts the process where KeyboardInterrupt is raised while it makes the module
        with waiting():
            return import_module("palpate._core")
    if name in _RENAMED:
        raise AttributeError(f"palpate.{name} has been renamed to palpate.{_RENAMED[name]} in version 0.2")
    return _load(name)
