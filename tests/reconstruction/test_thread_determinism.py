"""The same bits from one, two and four threads, whole runs of every method on every pose of the panel."""

import resource
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from support.running_server import HERE

import palpate as pp
from palpate import _core
from palpate.reconstruction.reconstruct import Method
from palpate.scans.analytic_phantoms import Ellipsoid, Phantom

BODY = Phantom([(Ellipsoid((0, 0, 24), (13, 9, 8)), 0.02), (Ellipsoid((4, 2, 24), 3), 0.02)])
GRID = pp.Grid((7, 26, 31), (2, 1, 1), (-15, -12.5, 18))
SHAPE = (37, 46)


def flat():
    panel = pp.Panel(SHAPE, (1, 1), (-22.5, -18, 0))
    return pp.arc_views(panel, np.linspace(-25, 25, 5), radius=500, pivot=(0, 0, 24))


def turned():
    """About y, with the source."""
    return posed([(-0.35, 0), (0, 0), (0.23, 0)])


def tilted():
    """About y and x at once."""
    return posed([(-0.35, 0.2), (0.12, -0.2), (0.23, 0.1)])


def posed(angles):
    source, panels = [], []
    for a, b in angles:
        across = np.array((np.cos(a), 0, -np.sin(a)))
        up = np.array((np.sin(a) * np.cos(b), np.sin(b), np.cos(a) * np.cos(b)))
        down = np.cross(up, across)
        source.append((0, 0, 24) + 400 * up)
        panels.append(pp.Panel(SHAPE, (1, 1), (0, 0, -4) - 18 * down - 22.5 * across, down, across))
    return pp.Views(source, panels)


POSES = {flat: {"parallel"}, turned: {"rotated", "parallel"}, tilted: {"oblique"}}


@pytest.fixture(params=POSES, ids=lambda views: views.__name__)
def views(request):
    made = request.param()
    geometry = pp.Projector(made, GRID).geometry
    assert {geometry.orientation(view) for view in range(len(made))} == POSES[request.param]
    return made


@pytest.fixture
def each_number():
    """Runs a function once for each number of threads and compares what comes back, bit by bit."""

    def compare(work):
        answers = []
        for n in (1, 2, 4):
            _core.base.set_threads(n)
            answers.append(work())
        for answer in answers[1:]:
            np.testing.assert_array_equal(answer, answers[0])
        return answers[0]

    yield compare
    _core.base.set_threads(0)


def test_projections(views, each_number):
    x = np.random.default_rng(1).random(GRID.shape, dtype=np.float32)
    p = each_number(lambda: pp.Projector(views, GRID)(x))
    f = each_number(lambda: pp.Projector(views, GRID).T(p))
    assert p.any()
    assert f.any()


@pytest.mark.parametrize("method", get_args(Method))
def test_reconstructions(views, method, each_number):
    scan = pp.simulate_scan(BODY, views, incident=5000, seed=2, background=30)
    made = each_number(lambda: pp.reconstruct(scan, GRID, method=method, levels=2, iterations=2).values)
    assert made.std() > 0


def test_calls_that_find_the_threads_awake_asleep_or_busy(each_number):
    """At once after the last call, within what threads stay awake, after that, and while another call has them."""
    A = pp.Projector(flat(), GRID)
    x = np.random.default_rng(3).random(GRID.shape, dtype=np.float32)

    def work(seed):
        for pause in np.random.default_rng(seed).choice((0, 2e-5, 5e-5, 2e-3), 150):
            time.sleep(pause)
            np.testing.assert_array_equal(A(x), right)
        return True

    right = each_number(lambda: A(x))
    for n in (2, 4, 3):
        _core.base.set_threads(n)
        assert work(n)
        with ThreadPoolExecutor(3) as pool:
            assert all(pool.map(work, range(3)))


FEW = """
import os, resource, sys
import numpy as np
import palpate as pp
from palpate import _core

panel = pp.Panel((37, 46), (1, 1), (-22.5, -18, 0))
grid = pp.Grid((7, 26, 31), (2, 1, 1), (-15, -12.5, 18))
A = pp.Projector(pp.arc_views(panel, np.linspace(-25, 25, 5), radius=500, pivot=(0, 0, 24)), grid)
x = np.random.default_rng(0).random(grid.shape, np.float32)
_core.base.set_threads(1)
alone = A(x), A.T(A(x))
if sys.argv[1] == "second":  # the pool is there already, and is to grow
    _core.base.set_threads(2)
    A(x)
taken = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
room = int(sys.argv[2]) * 2**30 + 2**29  # the half is for everything but stacks
resource.setrlimit(resource.RLIMIT_AS, (taken + room,) * 2)
before = len(os.listdir("/proc/self/task"))
_core.base.set_threads(40)
for _ in range(3):
    assert np.array_equal(A(x), alone[0]) and np.array_equal(A.T(A(x)), alone[1])
print(len(os.listdir("/proc/self/task")) - before)
"""


def large_stacks():
    """A thread that is started from now on reserves 1 GiB, so that a limit of memory is one of threads."""
    resource.setrlimit(resource.RLIMIT_STACK, (2**30, resource.getrlimit(resource.RLIMIT_STACK)[1]))


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="the limit of memory is counted from /proc")
@pytest.mark.parametrize("pool", ["first", "second"])
@pytest.mark.parametrize("room", [0, 1, 3])
def test_a_system_that_gives_no_more_threads_is_lived_with(pool, room):
    run = subprocess.run(
        [sys.executable, "-c", FEW, pool, str(room)],
        env=HERE, capture_output=True, text=True, timeout=60, preexec_fn=large_stacks,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert run.stdout == f"{room}\n"
