"""A limit of memory: the same volume, within what the system grants, and a clear word where that is impossible."""

import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import palpate as pp
from palpate import _core
from palpate.errors import DataError, FileError
from palpate.reconstruction import memory_limit as module
from palpate.reconstruction.memory_limit import bytes_of, file_system, scratch_bytes

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no limit of memory on Windows")
MB = 10**6
GRANTED = 460 * MB  # bytes of private memory that the system gives a process below


def private_in_use():
    """Bytes of large arrays in memory and in files now."""
    return _core.base.scratch_use()[:2]


def test_arrays_beyond_the_limit_lie_in_files_without_a_name(tmp_path):
    before = private_in_use()
    with pp.memory_limit("500MB", tmp_path):
        held = [np.full(12 * MB, k, np.float32) for k in range(9)]  # 48 MB each
        in_memory, in_files = scratch_bytes()
        assert (in_memory - before[0], in_files - before[1]) == (2 * 48 * MB, 7 * 48 * MB)
        assert not list(tmp_path.iterdir())
    assert [float(array.mean()) for array in held] == list(range(9))  # they outlive the block
    held.append(np.ones(12 * MB, np.float32))  # and after it arrays are NumPy's own again
    assert private_in_use()[0] - before[0] == 2 * 48 * MB
    held.clear()
    assert private_in_use() == before


@settings(max_examples=40, deadline=None)
@given(sizes=st.lists(st.integers(0, 3 * MB), min_size=2, max_size=6), seed=st.integers(0, 1000))
def test_arrays_that_grow_and_shrink_keep_what_they_hold(sizes, seed, tmp_path_factory):
    """From a small one to a large one and back, in memory and in files, as `resize` and `append` do it."""
    rng = np.random.default_rng(seed)
    with pp.memory_limit("500MB", tmp_path_factory.mktemp("scratch")):
        _core.base.set_scratch(str(tmp_path_factory.getbasetemp()), int(rng.integers(0, 4 * MB)))
        array = rng.integers(0, 256, sizes[0], np.uint8)
        expected = bytes(array)
        for size in sizes[1:]:
            array.resize(size, refcheck=False)
            expected = expected[:size].ljust(size, b"\0")
            assert bytes(array) == expected
        assert not np.zeros(2 * MB, np.uint8).any()


def test_arrays_of_other_threads_are_left_alone(tmp_path):
    with pp.memory_limit("500MB", tmp_path):
        before, held = private_in_use(), []
        thread = threading.Thread(target=lambda: held.append(np.ones(2 * MB)))
        thread.start()
        thread.join()
        assert private_in_use() == before


CODE = """
import sys, resource
import numpy as np
import palpate as pp

limit, granted, side, out = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), sys.argv[4]
panel = pp.Panel((side, side), (1, 1), (-side / 2, -side / 2, 0))
views = pp.arc_views(panel, np.linspace(-15, 15, 5), radius=2000, pivot=(0, 0, 20))
grid = pp.Grid((60, side, side), (1, 1, 1), (-side / 2, -side / 2, 2))
counts = np.random.default_rng(1).poisson(500, views.shape).astype(np.float32)
if granted:
    resource.setrlimit(resource.RLIMIT_DATA, (granted, granted))

def made():
    return pp.reconstruct(pp.Scan(counts, 1000, views), grid, iterations=3, tolerance=0, levels=2)

try:
    if limit == "none":
        volume = made()
    else:
        with pp.memory_limit(limit, out + ".scratch"):
            volume = made()
            print(pp.reconstruction.memory_limit.scratch_bytes(), file=sys.stderr)
except MemoryError:
    sys.exit("MemoryError")
with open(out, "wb") as file:
    file.write(volume.values.data)
"""


def reconstruct(limit, granted, out, side=620):
    """In a process to which the system grants so many bytes of private memory; 0: all."""
    words = [sys.executable, "-c", CODE, limit, str(granted), str(side), str(out)]
    return subprocess.run(words, capture_output=True, text=True, timeout=300)


def test_a_reconstruction_that_the_system_has_no_memory_for_is_the_same(tmp_path):
    """Volumes of 90 MB, several at a time, where fewer fit; the limit is the operating system's, not ours."""
    whole = reconstruct("none", 0, tmp_path / "whole")
    assert whole.returncode == 0, whole.stderr
    assert "MemoryError" in reconstruct("none", GRANTED, tmp_path / "lacking").stderr
    limited = reconstruct("500MB", GRANTED, tmp_path / "limited")
    assert limited.returncode == 0, limited.stderr
    one, other = (np.fromfile(tmp_path / name, np.float32) for name in ("whole", "limited"))
    assert np.linalg.norm(one - other) < 1e-6 * np.linalg.norm(one)


def test_a_full_disk_is_said(tmp_path):
    full = tmp_path / "full"
    full.mkdir()
    code = f"""
import resource, palpate as pp, numpy as np
resource.setrlimit(resource.RLIMIT_FSIZE, (10**7, 10**7))
import signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
with pp.memory_limit("500MB", {str(full)!r}):
    held = [np.ones(10**7) for _ in range(5)]
"""
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert "FileError" in ended.stderr
    assert f"{full}: File too large; make room, or name another folder" in ended.stderr
    assert not list(full.iterdir())


@pytest.mark.parametrize(
    ("words", "amount"), [("4GB", 4e9), ("800 MB", 8e8), ("2GiB", 2**31), ("1.5gb", 1.5e9), (6e8, 6e8)]
)
def test_amounts(words, amount):
    assert bytes_of(words) == amount


@pytest.mark.parametrize("words", ["", "four", "4 parsecs", "-4GB", "1MB", "nan"])
def test_what_is_no_amount_is_refused(words):
    with pytest.raises(DataError, match="memory: "):
        bytes_of(words)


def test_files_in_memory_are_refused(tmp_path, monkeypatch):
    assert file_system(Path("/proc/self")) == "proc"
    monkeypatch.setattr(module, "file_system", lambda folder: "tmpfs")
    with pytest.raises(FileError, match="lies in memory itself"), pp.memory_limit("1GB", tmp_path):
        pass


def test_the_command_has_the_same_bits(tmp_path):
    from support.small_archive import small_scan
    from typer.testing import CliRunner

    from palpate.commands import app

    pp.write_scan(tmp_path / "scan.h5", small_scan(1, side=200))
    words = ["reconstruct", str(tmp_path / "scan.h5"), "--thickness", "20", "--iterations", "2", "--no-check"]
    for name, more in (("a.nii.gz", []), ("b.nii.gz", ["--memory", "500MB"])):
        result = CliRunner().invoke(app, [*words, "-o", str(tmp_path / name), *more])
        assert result.exit_code == 0, result.output
    assert (tmp_path / "a.nii.gz").read_bytes() == (tmp_path / "b.nii.gz").read_bytes()
    assert "large arrays: at most" in result.output
    assert private_in_use() == (0, 0)
    refused = CliRunner().invoke(app, [*words, "-o", str(tmp_path / "c.nii.gz"), "--scratch", str(tmp_path)])
    assert "--memory" in str(refused.exception)
