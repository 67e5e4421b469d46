"""Three sweeps of descent, then momentum: nothing but the two, one after the other."""

import tracemalloc
from itertools import islice, pairwise

import numpy as np
import pytest
from reconstruction.test_coordinate_descent import GEOMETRIES, GRID, problem
from reconstruction.test_reconstruct import PRIOR, small

import palpate as pp
from palpate.reconstruction.models.likelihood import Transmission
from palpate.reconstruction.optimizers.coordinate_descent import coordinate_descent
from palpate.reconstruction.optimizers.hybrid_descent import SWEEPS, hybrid_descent
from palpate.reconstruction.optimizers.memory_gradient import memory_gradient

BETA = 20000.0


@pytest.mark.parametrize("done", [1, SWEEPS, SWEEPS + 1])
def test_iterates_are_those_of_descent_and_then_of_momentum(done):
    """And what goes on from any of them has the same bits."""
    scan, A = small()
    data, start = Transmission.of(scan), np.full(A.domain_shape, 0.02, np.float32)
    whole = list(islice(hybrid_descent(A, data, PRIOR, BETA, start), SWEEPS + 3))
    assert all(after < before for (_, before), (_, after) in pairwise(whole))
    assert (start == 0.02).all()
    for (f, _), (swept, _) in zip(whole[:SWEEPS], coordinate_descent(A, data, PRIOR, BETA, start), strict=False):
        np.testing.assert_array_equal(f, swept)
    rest = memory_gradient(A, data, PRIOR, BETA, whole[SWEEPS - 1][0])
    for (f, _), (moved, _) in zip(whole[SWEEPS:], rest, strict=False):
        np.testing.assert_array_equal(f, moved)
    before = whole[done - 2][0] if done > 1 else None
    again = hybrid_descent(A, data, PRIOR, BETA, whole[done - 1][0], done=done, previous=before)
    for (f, value), (g, other) in zip(whole[done:], again, strict=False):
        np.testing.assert_array_equal(f, g)
        assert value == other


@pytest.mark.parametrize("geometry", GEOMETRIES)
@pytest.mark.parametrize("levels", [1, 2])
def test_only_after_coarser_levels_and_where_panel_and_slices_are_parallel(geometry, levels):
    """Elsewhere a sweep costs too much, or what is broad is not done yet: there "auto" is momentum from the first on."""
    scan, _, _ = problem(geometry())
    swept = levels > 1 and all(abs(panel.normal[2]) == pytest.approx(1) for panel in scan.views.panels)
    start = pp.Volume(np.full(GRID.shape, 0.02, np.float32), GRID)
    runs = {}
    for name in ("auto", "momentum", "descent"):
        each = [name, *["momentum"] * (levels - 1)]
        given = {"levels": levels, "prior": PRIOR, "start": start, "optimizer": each, "iterations": 2, "tolerance": 0.0}
        runs[name] = [step.objective for step in pp.iterates(scan, GRID, **given) if step.level == 0]
    assert runs["momentum"] != runs["descent"]
    assert runs["auto"] == runs["descent" if swept else "momentum"]


def test_coarse_levels_begin_with_sweeps_too():
    """Each where it is "auto", and nothing else is asked for there."""
    scan, _, _ = problem(GEOMETRIES[0]())

    def coarse(*optimizers):
        given = {"prior": PRIOR, "optimizer": optimizers, "iterations": SWEEPS + 1, "tolerance": 0.0, "levels": 2}
        return [step.objective for step in pp.iterates(scan, GRID, **given) if step.level == 1]

    swept, whole = coarse("auto", "auto"), coarse("auto", "descent")
    assert swept[:SWEEPS] == whole[:SWEEPS] == coarse("momentum", "auto")[:SWEEPS]
    assert swept[SWEEPS] != whole[SWEEPS]
    assert coarse("auto", "momentum")[0] != swept[0]


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
