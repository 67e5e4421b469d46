"""A machine that gives few threads: one does the work, and nothing waits for those that could not be started."""

import os
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import pytest
from support.running_server import HERE

import palpate as pp
import palpate.__main__ as command


def test_threads_are_tried_before_a_library_waits_for_them(monkeypatch):
    start, started = threading.Thread.start, []

    def few(thread):
        if len(started) == 3:
            raise RuntimeError("can't start new thread")
        started.append(thread)
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", few)
    assert command.threads_start(3)
    started.clear()
    assert not command.threads_start(4)
    assert not any(thread.is_alive() for thread in started)


@pytest.fixture
def open_folder():
    """One that any user may enter and fill, which pytest's are not."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o777)
        yield Path(folder)


def entered_by_others(path):
    """Whether users without privileges may enter all folders above a file and of what it links to."""
    return all(folder.stat().st_mode & 0o001 for each in (path.absolute(), path.resolve()) for folder in each.parents)


@pytest.mark.skipif(os.name != "posix", reason="limits of processes are POSIX's")
@pytest.mark.parametrize("most", [1, 3, 4, 6])
def test_a_reconstruction_ends_whatever_the_limit(most, open_folder):
    """As a user without privileges, whom the limit binds; a root's child becomes one."""
    import resource

    if os.getuid() == 0 and not entered_by_others(Path(sys.executable)):
        pytest.skip(f"{sys.executable}: only root may enter a folder above it, and limits do not bind root")
    views = pp.circular_views(pp.Panel((24, 24), (3, 3), (-34.5, -34.5, 0)), radius=150, height=600, count=3)
    pp.write_scan(open_folder / "scan.h5", pp.simulate_scan(pp.slab_phantom(), views, 5000, seed=4))

    def bound():
        resource.setrlimit(resource.RLIMIT_NPROC, (most, most))
        if os.getuid() == 0:
            os.setgroups([])
            os.setgid(54321)
            os.setuid(54321)

    def run(code, *words):
        environment = {**HERE, "PALPATE_THREADS": "4", "PYTHONDONTWRITEBYTECODE": "1", "HOME": str(open_folder)}
        return subprocess.run(
            [sys.executable, "-c", code, *words], cwd=open_folder, env=environment, preexec_fn=bound, capture_output=True,
            text=True, timeout=60,
        )  # fmt: skip

    (open_folder / "scan.h5").chmod(0o644)
    if run("import palpate").returncode or os.getuid():
        pytest.skip("another user may not read this Python, or the limit counts this user's other processes")
    words = ["reconstruct", "scan.h5", "-o", "v.nii.gz", "--thickness", "20", "--levels", "1", "--iterations", "3"]
    done = run("from palpate.__main__ import main; main()", *words)
    assert "Traceback" not in done.stderr
    if most > 1 or done.returncode == 0:
        assert done.returncode == 0, done.stderr
        assert (open_folder / "v.nii.gz").exists()
    else:
        assert "the system gives no more threads" in done.stderr
