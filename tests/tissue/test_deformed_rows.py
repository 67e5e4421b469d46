"""The deformed-node index table: which nodes a push moves, row by row, and that it solves the springs it holds."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array, csgraph
from support.brick_meshes import brick

import palpate as pp
from palpate.errors import DataError
from palpate.tissue.models.deformed_rows import deformed_rows
from palpate.tissue.models.mass_spring import SpringModel, edge_stiffness

LAW = pp.SpringLaw("exponential", -0.14, "equal", "rings")
POINT = [27.0, 26.0, 50.0]


@pytest.fixture(scope="module")
def tissue():
    mesh = brick((7, 7, 7), warp=0.2)
    return pp.Tissue(mesh, 5.0, 0.3, mesh.nodes[:, 2] == 0)


@pytest.fixture(scope="module")
def model(tissue):
    return SpringModel(tissue, LAW, relaxation=1.0, rigid=True)


def push(model, depth, least=0.2, **more):
    return deformed_rows(model, POINT, [0, 0, -depth], 0.0, least, **more)


def test_rows_of_the_table_are_distances_along_edges(tissue, model):
    found = push(model, 5.0)
    n = len(tissue.mesh.nodes)
    graph = coo_array((np.ones(len(tissue.edges)), tuple(tissue.edges.T)), shape=(n, n)).tocsr()
    touched = np.flatnonzero(found.displacement[:, 2] == -5.0)
    assert len(touched) == 3
    away = csgraph.dijkstra(graph, directed=False, unweighted=True, indices=touched).min(axis=0)
    assert len(found.rows) > 3
    for k, row in enumerate(found.rows):
        np.testing.assert_array_equal(row, np.flatnonzero(away == k))
    outside = np.setdiff1d(np.arange(n), np.concatenate(found.rows))
    assert len(outside) > 0
    assert not found.displacement[outside].any()


@settings(max_examples=25, deadline=None)
@example(depth=7.0, factor=1.25, least=0.2578125)  # ends a sweep sooner, with as many rows
@given(depth=st.floats(1e-3, 20.0), factor=st.floats(1.0, 4.0), least=st.floats(1e-3, 0.3))
def test_a_larger_push_never_moves_fewer_rows(model, depth, factor, least):
    """Gauss-Seidel from rest on an M-matrix rises towards the solution, so a larger push is ahead at every sweep."""
    small, large = push(model, depth, least), push(model, factor * depth, least)
    assert len(large.rows) >= len(small.rows)
    if large.sweeps >= small.sweeps:
        assert (np.abs(large.displacement[:, 2]) >= np.abs(small.displacement[:, 2]) - 1e-12).all()


def test_a_push_below_the_threshold_moves_the_touched_nodes_alone_and_a_large_one_reaches_further(model):
    assert [len(row) for row in push(model, 0.19).rows] == [3]
    reached = [push(model, depth).nodes for depth in (0.19, 0.5, 2.0, 8.0)]
    assert (np.diff(reached) > 0).all()


def test_the_table_solves_its_springs_with_all_other_nodes_at_home(tissue, model):
    """Against a dense solution of the nodes in the table."""
    found = push(model, 5.0, 1e-9, most_sweeps=1)  # one sweep: row 1, and row 2 joined
    assert found.sweeps == 1
    found = push(model, 5.0, 0.05)
    K = -edge_stiffness(tissue, "equal").toarray()
    total, degree = -K.sum(axis=1), np.count_nonzero(K, axis=1)
    row = np.zeros(len(K))
    for k, nodes in enumerate(found.rows):
        row[nodes] = k + 1
    K += np.diag(total + (1 - np.exp(LAW.rsc * row)) * total / degree)
    u = np.zeros(len(K))
    u[found.rows[0]] = -5.0
    free = np.setdiff1d(np.concatenate(found.rows[1:]), tissue.fixed)
    u[free] = np.linalg.solve(K[np.ix_(free, free)], -(K @ u)[free])
    assert np.abs(found.displacement[:, 2] - u).max() < 0.5  # it stops when steps, not errors, are below 0.05 mm
    fine = push(model, 5.0, 1e-7)
    exact = model.push(POINT, [0, 0, -5.0], 0.0, tolerance=1e-8)
    assert np.abs(fine.displacement - exact.displacement).max() < 1e-5
    np.testing.assert_allclose(fine.force, exact.force, rtol=1e-5)


def test_the_whole_mesh_from_the_start_has_all_rows(tissue, model):
    whole = push(model, 5.0, whole=True)
    assert whole.nodes == len(tissue.mesh.nodes)
    assert len(whole.rows) > len(push(model, 5.0).rows)


def test_memory_of_an_earlier_push_changes_nothing(model):
    first = push(model, 5.0)
    again = push(model, 1.0, warm=first.warm)
    np.testing.assert_array_equal(again.displacement, push(model, 1.0).displacement)


@pytest.mark.parametrize("least", [0.0, -1.0, np.nan, np.inf])
def test_a_threshold_that_is_none_is_refused(model, least):
    with pytest.raises(DataError, match="least"):
        push(model, 5.0, least)
