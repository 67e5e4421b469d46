"""Three sweeps of descent, then momentum: nothing but the two, one after the other."""

import tracemalloc
from itertools import islice, pairwise

import numpy as np
import pytest
from test_descent import GEOMETRIES, GRID, problem
from test_reconstruct import PRIOR, small

import palpate as pp
from palpate.reconstruction.descent import descend
from palpate.reconstruction.likelihood import Transmission
from palpate.reconstruction.momentum import accelerate
from palpate.reconstruction.swept import SWEEPS, sweep_then_accelerate

BETA = 20000.0


@pytest.mark.parametrize("done", [1, SWEEPS, SWEEPS + 1])
def test_iterates_are_those_of_descent_and_then_of_momentum(done):
    """And what goes on from any of them has the same bits."""
    scan, A = small()
    data, start = Transmission.of(scan), np.full(A.domain_shape, 0.02, np.float32)
    whole = list(islice(sweep_then_accelerate(A, data, PRIOR, BETA, start), SWEEPS + 3))
    assert all(after < before for (_, before), (_, after) in pairwise(whole))
    assert (start == 0.02).all()
    for (f, _), (swept, _) in zip(whole[:SWEEPS], descend(A, data, PRIOR, BETA, start), strict=False):
        np.testing.assert_array_equal(f, swept)
    rest = accelerate(A, data, PRIOR, BETA, whole[SWEEPS - 1][0])
    for (f, _), (moved, _) in zip(whole[SWEEPS:], rest, strict=False):
        np.testing.assert_array_equal(f, moved)
    before = whole[done - 2][0] if done > 1 else None
    again = sweep_then_accelerate(A, data, PRIOR, BETA, whole[done - 1][0], done=done, previous=before)
    for (f, value), (g, other) in zip(whole[done:], again, strict=False):
        np.testing.assert_array_equal(f, g)
        assert value == other


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_only_where_panel_and_slices_are_parallel(geometry):
    """Elsewhere a sweep costs too much: there "auto" is momentum from the first iterate on."""
    scan, _, _ = problem(geometry())
    flat = all(abs(panel.normal[2]) == pytest.approx(1) for panel in scan.views.panels)
    runs = {
        name: next(pp.iterates(scan, GRID, levels=1, prior=PRIOR, optimiser=name)).objective
        for name in ("auto", "momentum", "descent")
    }
    assert runs["momentum"] != runs["descent"]
    assert runs["auto"] == runs["descent" if flat else "momentum"]


def test_three_volumes_live_at_once_in_a_whole_run():
    """Whoever keeps no step but the last. Pixels are few here, so that volumes are all that counts."""
    panel = pp.Panel((44, 60), (1, 1), (-29.5, -21.5, 0))
    views = pp.arc_views(panel, np.linspace(-25, 25, 3), radius=500, pivot=(0, 0, 24))
    grid = pp.Grid((40, 96, 112), (0.4, 0.4, 0.4), (-22.2, -19, 16))
    scan = pp.Scan(np.full(views.shape, 400, np.float32), 1000, views)
    volume, scans = 4 * np.prod(grid.shape), 4 * np.prod(views.shape)
    tracemalloc.start()
    levels = set()
    for step in pp.iterates(scan, grid, levels=2, iterations=SWEEPS + 4, tolerance=0.0):
        levels.add((step.level, step.iteration))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert (0, SWEEPS + 4) in levels
    assert peak < 3.3 * volume + 20 * scans
