"""Runs of the command in processes of their own, for tests that interrupt them."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import palpate as pp

HERE = {**os.environ, "PYTHONPATH": str(Path(pp.__file__).parents[1]), "COLUMNS": "200"}
HERE = {name: value for name, value in HERE.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}  # opens no browser


def start(words, folder):
    """Starts `palpate words` in a folder."""
    return subprocess.Popen(
        [sys.executable, "-m", "palpate", *words.split()],
        cwd=folder,
        env=HERE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def ended(words, folder, seconds=300):
    """Exit code, stdout and stderr of `palpate words` in a folder."""
    run = start(words, folder)
    out, err = run.communicate(timeout=seconds)
    return run.returncode, out, err


def until(true, seconds=120):
    """Waits until `true()`."""
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.001)


def interrupted(run, when):
    """Exit code, stdout and stderr of a run that gets Ctrl-C as soon as `when()`.

    And once more after a while: Python loses a signal that falls within a destructor.
    """
    try:
        until(lambda: when() or run.poll() is not None)
        assert run.poll() is None, run.communicate()
        run.send_signal(signal.SIGINT)
        try:
            out, err = run.communicate(timeout=15)
        except subprocess.TimeoutExpired:
            run.send_signal(signal.SIGINT)
            out, err = run.communicate(timeout=60)
    finally:
        run.kill()
    assert "Traceback" not in out + err
    return run.returncode, out, err
