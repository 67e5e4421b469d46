"""What every test starts from."""

import os
import signal
from pathlib import Path

import pytest
from hypothesis import settings
from support.browser import launched
from support.example_organs import organ

import palpate as pp

# A runner started in the background may ignore Ctrl-C, and what it starts would too: tests that interrupt need it heard.
signal.signal(signal.SIGINT, signal.default_int_handler)

# No test reads or writes the token of the user who runs it: each server makes one of its own.
os.environ["XDG_STATE_HOME"] = os.devnull

# No test is judged by its time: a busy machine and the sanitizers are slow.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


@pytest.fixture(scope="module")
def browser():
    """Chromium, or a skip that says what is missing; a failure where a browser is required."""
    with launched() as chromium:
        yield chromium


@pytest.fixture(scope="session")
def album(tmp_path_factory):
    """Where screenshots go: PALPATE_SCREENSHOTS, or a temporary folder."""
    folder = Path(os.environ.get("PALPATE_SCREENSHOTS") or tmp_path_factory.mktemp("screenshots"))
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def tissue():
    """What sessions are recorded, replayed and scored on; many files of tests have one of their own."""
    return organ(9)


@pytest.fixture(scope="session")
def models(tissue):
    """Of that tissue, by name."""
    return {name: pp.model(tissue, name) for name in ("blocks", "compliance", "springs")}
