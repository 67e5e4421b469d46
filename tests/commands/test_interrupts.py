"""Ctrl-C: one is enough, wherever it falls; exit code 130, one line, no traceback."""

import signal
import socket
import subprocess
import sys
import threading
import time

import pytest
from support.running_server import HERE, ended, start, until

import palpate as pp
from palpate import interrupts

# An optimizer that says when it works. Ctrl-C comes while Python cannot let an exception out: in a destructor, in a
# weak reference's callback, in a generator that is thrown away.
PLUGIN = """
import signal, time, weakref
from pathlib import Path
import palpate as pp

class Dropped:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)

class Thing: pass

def thrown_away():
    try:
        yield
    finally:
        signal.raise_signal(signal.SIGINT)

def drop(how):
    if how == "destructor":
        Dropped()
    elif how == "callback":
        thing = Thing()
        kept = weakref.ref(thing, lambda gone: signal.raise_signal(signal.SIGINT))
        del thing
    elif how == "generator":
        half = thrown_away()
        next(half)
        del half
    elif how == "converted":
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise TypeError("incompatible function arguments") from None
    else:
        signal.raise_signal(signal.SIGINT)

@pp.register_optimizer("endless")
class Endless:
    def __init__(self, problem, values, state): self.values = values
    def update(self):
        drop(Path("how").read_text())
        time.sleep(0.05)
        return self.values, 1.0
    def state(self): return {}
"""

SOON = """
import threading
from palpate import interrupts

interrupts.AGAIN = 0.001
start = threading.Thread.start
threading.Thread.start = lambda thread: start(thread) or time.sleep(0.05)
"""


@pytest.fixture(scope="module")
def scan_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("scan") / "scan.h5"
    views = pp.circular_views(pp.Panel((24, 24), (3, 3), (-34.5, -34.5, 0)), radius=150, height=600, count=3)
    pp.write_scan(path, pp.simulate_scan(pp.slab_phantom(), views, 5000, seed=4))
    return path


@pytest.mark.parametrize("how", ["", "destructor", "callback", "generator", "converted"])
@pytest.mark.parametrize("soon", [False, True])
def test_one_is_enough_wherever_it_falls(how, soon, scan_file, tmp_path):
    """Soon: what was dropped is sent again before the thread that sends it has been started."""
    (tmp_path / "plugin.py").write_text(PLUGIN + soon * SOON)
    (tmp_path / "how").write_text(how)
    words = (
        f"--plugin plugin.py reconstruct {scan_file} -o v.nii.gz --thickness 20 --levels 1 --optimizer endless "
        "--tolerance 0 --iterations 60"
    )
    run = start(words, tmp_path)
    _, said = run.communicate(timeout=60)
    assert run.returncode == 130, said
    assert "Traceback" not in said
    assert "Exception ignored" not in said
    assert said.splitlines()[-1].startswith("palpate: stopped" if how == "converted" else "palpate: stopped; "), said
    assert not (tmp_path / "v.nii.gz").exists()


BUSY = """
import hashlib, threading
from pathlib import Path
import palpate as pp

def work():  # one call into C, which no signal ends and which would take a minute
    Path("begun").touch()
    hashlib.pbkdf2_hmac("sha256", b"", b"", 10**8)
    Path("ended").touch()

@pp.register_optimizer("busy")
class Busy:
    def __init__(self, problem, values, state): self.values = values
    def update(self):
        if WHERE == "thread":
            thread = threading.Thread(target=work)
            thread.start()
            thread.join()
        else:
            work()
        return self.values, 1.0
    def state(self): return {}
"""


@pytest.mark.parametrize("where", ["main", "thread"])
def test_within_a_long_call_outside_python(where, scan_file, tmp_path):
    (tmp_path / "plugin.py").write_text(BUSY.replace("WHERE", repr(where)))
    run = start(f"--plugin plugin.py reconstruct {scan_file} -o v.nii.gz --thickness 20 --optimizer busy", tmp_path)
    until(lambda: (tmp_path / "begun").exists() or run.poll() is not None)
    run.send_signal(signal.SIGINT)
    _, said = run.communicate(timeout=120)
    assert run.returncode == 130, said
    assert "palpate: stopped" in said.splitlines()[-1]
    assert "Traceback" not in said
    assert not (tmp_path / "ended").exists()
    assert not (tmp_path / "v.nii.gz").exists()


@pytest.mark.parametrize("moment", [0.05, 0.2, 0.4, 0.8])
def test_while_modules_are_loaded(moment, tmp_path):
    """From the moment on that the command's own code runs, which Python's own start precedes."""
    began = "import sys, palpate.__main__; print(flush=True); sys.argv[1:] = ['demo', '-o', 'demo']; palpate.__main__.main()"
    run = subprocess.Popen(
        [sys.executable, "-c", began], cwd=tmp_path, env=HERE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    run.stdout.readline()
    time.sleep(moment)
    run.send_signal(signal.SIGINT)
    _, said = run.communicate(timeout=60)
    assert run.returncode == 130, said
    assert said.startswith("palpate: stopped"), said
    assert "Traceback" not in said
    assert "Aborted" not in said


@pytest.mark.parametrize("threads", ["as many", "none"])
def test_the_watch_leaves_no_socket_open(threads, monkeypatch):
    if threads == "none":
        monkeypatch.setattr(threading.Thread, "start", refused)
    sockets = []
    pair = socket.socketpair
    monkeypatch.setattr(socket, "socketpair", lambda: sockets.append(pair()) or sockets[-1])
    with interrupts.raised():
        pass
    until(lambda: all(end.fileno() == -1 for end in sockets[0]), seconds=10)


def refused(thread):
    raise RuntimeError("can't start new thread")


def test_threads_and_temporary_files_at_the_end(tmp_path):
    """Temporary files go; a thread that works on does not keep the process, nor lose what it uses."""
    code = """
import tempfile, threading, time
from palpate import interrupts

kept = tempfile.TemporaryDirectory(dir=".")
threading.Thread(target=time.sleep, args=(60,)).start()
print("last word")
interrupts.end_process()
"""
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=HERE, capture_output=True, text=True, timeout=30
    )
    assert (run.returncode, run.stdout) == (130, "last word\n"), run.stderr
    assert not list(tmp_path.iterdir())


def test_while_the_core_is_made():
    """Its first enumeration calls Python code, where Ctrl-C would be raised."""
    code = """
import enum, signal, sys
import palpate

def interrupt(frame, event, argument):
    if event == "call" and frame.f_code.co_filename == enum.__file__:
        sys.setprofile(None)
        print("sent")
        signal.raise_signal(signal.SIGINT)

sys.setprofile(interrupt)
try:
    from palpate import _core
except KeyboardInterrupt:
    print("raised")
from palpate import _core
print(_core.__name__)
"""
    run = subprocess.run([sys.executable, "-c", code], env=HERE, capture_output=True, text=True, timeout=60)
    assert run.stdout.split() == ["sent", "raised", "palpate._core"], run.stderr


def test_one_that_is_sent_again_waits_for_the_end_of_a_write(tmp_path):
    """It came while a module was loaded, and is sent each 20 ms until it is heard. It is still the first one."""
    (tmp_path / "loads.py").write_text("import signal\nsignal.raise_signal(signal.SIGINT)\n")
    code = """
import sys, time
from palpate import interrupts

sys.path.insert(0, ".")
try:
    with interrupts.raised():
        with interrupts.waiting():  # as an output is begun
            pass
        import loads
        with interrupts.waiting():
            end = time.monotonic() + 0.3
            while time.monotonic() < end:
                pass
            print("written")
except KeyboardInterrupt:
    print("raised")
"""
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=HERE, capture_output=True, text=True, timeout=60
    )
    assert run.stdout.split() == ["written", "raised"], run.stderr


def test_a_second_one_within_a_write_of_hdf5(tmp_path):
    """The library calls Python to write, and would crash where KeyboardInterrupt came out of that."""
    code = """
import signal, sys, time
import numpy as np
from palpate.volumes import hdf5_output

sent = []

def interrupt(frame, event, argument):
    if event == "call" and frame.f_code.co_name == "write" and frame.f_code.co_filename == hdf5_output.__file__:
        if len(sent) < 3:
            sent.append("sent")
            signal.raise_signal(signal.SIGINT)

try:
    with hdf5_output.replacing_hdf5("whole.h5") as file:
        sys.setprofile(interrupt)
        file["values"] = np.arange(10**5)
        file.flush()
        while True:  # the second one does not wait for this
            pass
except KeyboardInterrupt:
    sys.setprofile(None)
    time.sleep(0.1)  # the third one is the second one still
    print(*sent, "raised")
"""
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=HERE, capture_output=True, text=True, timeout=60
    )
    assert run.stdout.split() == ["sent"] * 3 + ["raised"], (run.returncode, run.stderr)
    assert not list(tmp_path.iterdir())


def test_while_a_command_loads_a_module_that_swallows_it(scan_file, tmp_path):
    """As extension modules do: what is raised while they are made is an ImportError, or nothing at all."""
    swallows = (
        "try:\n    signal.raise_signal(signal.SIGINT)\n    print('loaded')\nexcept KeyboardInterrupt:\n    pass\n"
    )
    (tmp_path / "swallows.py").write_text(f"import signal\n{swallows}")
    (tmp_path / "how").write_text("none")
    plugin = PLUGIN.replace(
        '    if how == "destructor":', '    if how == "none":\n        import swallows\n    elif how == "destructor":'
    )
    (tmp_path / "plugin.py").write_text(f"import sys\nsys.path.insert(0, '.')\n{plugin}")
    words = f"--plugin plugin.py reconstruct {scan_file} -o v.nii.gz --thickness 20 --optimizer endless --iterations 60"
    code, out, said = ended(words, tmp_path, seconds=60)
    assert code == 130, said
    assert "loaded" in out
    assert said.splitlines()[-1].startswith("palpate: stopped; "), said


def test_one_that_the_shell_ignores_is_ignored(tmp_path):
    """As of a command that a script puts into the background."""
    run = subprocess.Popen(
        ["sh", "-c", f'trap "" INT; exec {sys.executable} -m palpate demo kidney --no-browser -o demo'],
        cwd=tmp_path, env=HERE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    until(lambda: (tmp_path / "demo" / "ct.nii.gz").exists() or run.poll() is not None)
    run.send_signal(signal.SIGINT)
    _, said = run.communicate(timeout=120)
    assert run.returncode == 0, said
    assert (tmp_path / "demo" / "report.html").exists()
