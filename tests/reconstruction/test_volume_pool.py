"""Memory goes round, and nothing that anybody holds is ever written to."""

import gc
import tracemalloc

import numpy as np
import pytest
from reconstruction.test_reconstruct import GRID, PRIOR, scan  # noqa: F401

import palpate as pp
from palpate.reconstruction.optimizers.hybrid_descent import SWEEPS
from palpate.reconstruction.volume_pool import FREE, VolumePool

PARTS = {
    "itself": lambda a: a,
    "a slice": lambda a: a[1],
    "a part of a part": lambda a: a[1:][:, ::2],
    "turned": lambda a: a.T,
    "as of another type": lambda a: a.view(np.uint32),
    "through NumPy": lambda a: np.asarray(a).reshape(-1)[3:],
    "its buffer": lambda a: memoryview(a),
    "a volume": lambda a: pp.Volume(a, pp.Grid(a.shape, (1, 1, 1), (0, 0, 0))),
}


def address(a):
    return a.__array_interface__["data"][0]


@pytest.mark.parametrize("part", PARTS)
def test_memory_is_taken_again_once_no_part_of_a_volume_is_held(part):
    pool = VolumePool((3, 4, 5))
    first = pool.copy(np.ones((3, 4, 5), np.float32))
    where, held = address(first), PARTS[part](first)
    del first
    other = pool.empty()
    assert address(other) != where
    other[:] = 2
    assert (np.asarray(held.values if part == "a volume" else held).view(np.float32) == 1).all()
    del held
    gc.collect()
    assert address(pool.empty()) == where


def test_many_dropped_at_once_do_not_stay():
    pool, size = VolumePool((100, 50, 50)), 4 * 100 * 50 * 50
    tracemalloc.start()
    try:
        held = [pool.empty() for _ in range(7)]
        assert tracemalloc.get_traced_memory()[0] > 7 * size
        held.clear()
        assert tracemalloc.get_traced_memory()[0] < (FREE + 0.5) * size
    finally:
        tracemalloc.stop()


def test_what_is_held_outlives_the_shelf():
    pool = VolumePool((2, 2, 2))
    a = pool.copy(np.full((2, 2, 2), 7, np.float32))
    del pool
    assert (a == 7).all()
    assert a.flags.writeable


@pytest.mark.parametrize("optimizer", ["auto", "momentum", "descent"])
def test_parts_of_all_iterates_may_be_kept(scan, optimizer):  # noqa: F811
    given = {"prior": PRIOR, "iterations": SWEEPS + 4, "tolerance": 0, "levels": 2, "optimizer": optimizer}
    steps = pp.iterates(scan, GRID, **given)
    parts = [(step.volume.values[3], step.volume.values[3].copy()) for step in steps]
    assert all((part == then).all() for part, then in parts)


@pytest.mark.parametrize("optimizer", ["auto", "momentum", "descent"])
def test_who_keeps_but_the_last_step_sees_few_places(scan, optimizer):  # noqa: F811
    """The last two iterates, the next, and where the level began."""
    given = {"prior": PRIOR, "iterations": SWEEPS + 6, "tolerance": 0, "levels": 2, "optimizer": optimizer}
    places = {(step.level, address(step.volume.values)) for step in pp.iterates(scan, GRID, **given)}
    assert sum(level == 0 for level, _ in places) <= 4
