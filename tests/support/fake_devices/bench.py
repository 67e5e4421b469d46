"""A stand-in library under a driver, with a wall as the solver: what the tests of devices share."""

import ctypes
import os
import shutil
import subprocess
import time
from pathlib import Path

import pytest

from palpate import _core
from palpate.haptics.force_dimension import ForceDimension
from palpate.haptics.open_haptics import OpenHaptics

HERE = Path(__file__).parent
WALL, UP = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)  # world
MAKERS = {"libHD": OpenHaptics, "libdhd": ForceDimension}
UPWARD = {"libHD": "y", "libdhd": "z"}  # of the device's own axes
ASIDE = {"libHD": "z", "libdhd": "x"}


def built(folder, name):
    """Path of the stand-in library `name`, compiled into `folder`."""
    if shutil.which("g++") is None:
        pytest.skip("g++ is missing: apt install g++")
    out = folder / f"{name}.so"
    command = ["g++", "-std=c++17", "-O0", "-shared", "-fPIC", "-pthread", str(HERE / f"fake_{name.lower()}.cpp")]
    bare = {name: value for name, value in os.environ.items() if name != "LD_PRELOAD"}  # no sanitizer in the compiler
    subprocess.run([*command, "-o", str(out)], check=True, env=bare)
    return out


def library_with(function, folder):
    """Path of a library that has this one function alone."""
    source, out = folder / "one.c", folder / "one.so"
    source.write_text(f"int {function}(void) {{ return 0; }}\n")
    bare = {name: value for name, value in os.environ.items() if name != "LD_PRELOAD"}
    subprocess.run(["g++", "-x", "c", "-shared", "-fPIC", str(source), "-o", str(out)], check=True, env=bare)
    return out


def until(condition, seconds=60.0):
    """Waits for `condition`; a busy machine may take its time."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not come to pass"
        time.sleep(0.002)


class Bench:
    """A device of a stand-in library over a wall of 0.3 N/mm whose solver runs at 1 kHz."""

    def __init__(self, name, path):
        self.name, self.path = name, path
        self.library = ctypes.CDLL(str(path))
        self.library.stand_in_get.restype = ctypes.c_double
        self.library.stand_in_ticks_with_force_after.restype = ctypes.c_int64
        self.library.stand_in_ticks_with_force_after.argtypes = [ctypes.c_int64]
        self.library.stand_in_ticks_with_force_since_fault.restype = ctypes.c_int64
        self.library.stand_in_reset()
        self.device = self.wall = None

    def set(self, what, value):
        self.library.stand_in_set(what.encode(), ctypes.c_double(value))

    def get(self, what):
        return self.library.stand_in_get(what.encode())

    def lower(self, height):
        self.set(ASIDE[self.name], 0.0)
        self.set(UPWARD[self.name], height)

    def make(self, **settings):
        return MAKERS[self.name](str(self.path), **settings)

    def start(self, solve=True, **settings):
        self.device = self.make(**settings)
        self.wall = _core.haptics.VirtualWall(self.device.servo, 0.3, WALL, UP)
        if solve:
            self.wall.start(1000)
        self.device.start()

    def touch(self):
        """Starts, and waits until the wall is felt."""
        self.start()
        self.lower(-4.0)
        until(self.felt_again)

    def ticks_since_fault(self):
        """With a force, from the tick that the last fault met, until the first without."""
        since = self.library.stand_in_ticks_with_force_since_fault
        until(lambda: since() >= 0)
        return since()

    def ticks_since_answer(self):
        """With a force, after the solver's last answer, until the first without."""
        after = self.library.stand_in_ticks_with_force_after
        until(lambda: after(self.wall.last_ns) >= 0)
        return after(self.wall.last_ns)

    def felt_again(self):
        return self.device.status().fault == "none" and self.get("force") > 0.1

    def stop(self):
        if self.device:
            self.device.stop()
        if self.wall:
            self.wall.stop()
