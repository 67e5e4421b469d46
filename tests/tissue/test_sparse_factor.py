"""Sparse Cholesky factors: against dense algebra, on what is not positive definite, and along part of the tree."""

import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_array, diags_array, kron
from scipy.sparse.linalg import spsolve
from support.brick_meshes import block, brick

import palpate as pp
from palpate import _core
from palpate.errors import DataError, MaterialError
from palpate.tissue.reference.linear_elasticity import FiniteElements, basis, stiffness
from palpate.tissue.sparse_factor import Factors


def coupled(nodes, degree, seed):
    """A random symmetric matrix of 3×3 blocks whose graph is random too, and its nodes' places (some coincide)."""
    rng = np.random.default_rng(seed)
    places = np.round(rng.uniform(0, 4, (nodes, 3)), rng.integers(0, 3))
    A = np.zeros((3 * nodes, 3 * nodes))
    for _ in range(degree * nodes):
        a, b = rng.integers(0, nodes, 2)
        A[3 * a : 3 * a + 3, 3 * b : 3 * b + 3] += rng.standard_normal((3, 3))
    return A + A.T, places


def definite(A, least):
    return A + (least - np.linalg.eigvalsh(A)[0]) * np.eye(len(A))


@functools.cache
def cube(n=11):
    truth = FiniteElements(block(n))
    return truth.K[truth.free][:, truth.free], truth.space.doflocs[:, truth.free[::3]].T


@functools.cache
def factored_cube(n):
    return Factors(*cube(n))


@pytest.fixture(autouse=True, scope="module")
def forget():
    """The native objects go before the interpreter does."""
    yield
    factored_cube.cache_clear()


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 45), st.integers(0, 4), st.integers(1, 19), st.integers(0, 2**31))
def test_solves_like_dense_algebra(nodes, degree, columns, seed):
    A, places = coupled(nodes, degree, seed)
    A = definite(A, 0.1)
    condition = np.abs(A).sum(axis=1).max() / 0.1
    factors = Factors(csr_array(A), places)
    assert factors.positive
    b = np.random.default_rng(seed).standard_normal((len(A), columns))
    wanted = np.linalg.solve(A, b)
    scale = np.abs(wanted).max() * condition * 1e-14
    np.testing.assert_allclose(factors.solve(b), wanted, rtol=0, atol=scale)
    np.testing.assert_allclose(factors.solve(b[:, 0]), wanted[:, 0], rtol=0, atol=scale)


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 40), st.integers(0, 4), st.floats(-3, -1e-6), st.integers(0, 2**31))
def test_what_is_not_positive_definite_is_refused(nodes, degree, least, seed):
    A, places = coupled(nodes, degree, seed)
    factors = Factors(csr_array(definite(A, least)), places)
    assert not factors.positive
    with pytest.raises(MaterialError, match="not positive definite"):
        factors.solve(np.ones(3 * nodes))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_entries_that_are_no_numbers_are_refused(bad):
    A = np.eye(9)
    A[4, 4] = bad
    assert not Factors(csr_array(A), np.eye(3)).positive


def test_rounding_hides_no_negative_eigenvalue_beyond_the_slack():
    """A body that nothing holds has six zero eigenvalues: shifted down by a little more than the slack it must fail."""
    mesh = brick((4, 4, 4), warp=0.2)
    space = basis(mesh)
    K = stiffness(space, np.full(len(mesh.tets), 5.0), np.full(len(mesh.tets), 0.3))
    K = csr_array((K + K.T) / 2)
    one = csr_array(np.eye(K.shape[0]))
    slack = Factors(K + one, mesh.nodes).slack
    assert 0 < slack < 1e-8 * np.abs(K).max()
    assert not Factors(K - 1.01 * slack * one, mesh.nodes).positive
    assert Factors(K + 1.01 * slack * one, mesh.nodes).positive


def test_shape_is_checked():
    with pytest.raises(DataError, match="does not fit 2 nodes"):
        Factors(csr_array(np.eye(9)), np.zeros((2, 3)))


def test_residual_is_at_rounding_and_agrees_with_superlu():
    K, places = cube()
    b = np.random.default_rng(1).standard_normal((K.shape[0], 11))
    u = Factors(K, places).solve(b)
    assert np.abs(K @ u - b).max() < 1e-13 * np.abs(K).max() * np.abs(u).max()
    other = spsolve(K.tocsc(), b[:, 0])
    assert np.abs(u[:, 0] - other).max() < 1e-11 * np.abs(other).max()


def test_threads_change_no_bit():
    K, places = cube()
    b = np.random.default_rng(2).standard_normal((K.shape[0], 70))
    answers = []
    for threads in (1, 2, 5):
        _core.base.set_threads(threads)
        answers.append(Factors(K, places).solve(b))
    _core.base.set_threads(0)
    assert (answers[0] == answers[1]).all()
    assert (answers[0] == answers[2]).all()


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 25), st.integers(1, 60), st.integers(1, 17), st.integers(0, 2**31))
def test_part_of_the_tree_gives_the_full_answer(loaded, wanted, columns, seed):
    K, places = cube(6)
    rng = np.random.default_rng(seed)
    nodes = rng.permutation(len(places))[:loaded].astype(np.int32)
    shown = rng.permutation(len(places))[:wanted].astype(np.int32)
    load = rng.standard_normal((3 * loaded, columns))
    factors = factored_cube(6)
    whole = np.zeros((K.shape[0], columns))
    whole[(3 * nodes[:, None] + np.arange(3)).ravel()] = load
    full = factors.solve(whole)[(3 * shown[:, None] + np.arange(3)).ravel()]
    scale = np.abs(factors.solve(whole)).max()
    assert np.abs(factors.native.partial_solve(nodes, load, shown) - full).max() < 1e-12 * scale
    assert np.abs(factors.native.partial_solve(nodes, load, shown, True) - full).max() < 1e-3 * scale


def test_single_precision_is_mended_by_one_refinement():
    K, places = cube()
    factors = Factors(K, places)
    every = np.arange(len(places), dtype=np.int32)
    b = np.random.default_rng(3).standard_normal((K.shape[0], 8))
    true = factors.solve(b)
    once = factors.native.partial_solve(every, b, every, True)
    twice = once + factors.native.partial_solve(every, np.ascontiguousarray(b - K @ once), every, True)
    first, second = (np.abs(u - true).max() / np.abs(true).max() for u in (once, twice))
    assert 1e-9 < first < 1e-3
    assert second < 1e-3 * first


def test_part_refuses_nodes_that_are_not_there_or_come_twice():
    K, places = cube(5)
    native = Factors(K, places).native
    for nodes, match in (([0, len(places)], "does not have"), ([3, 3], "twice")):
        with pytest.raises(ValueError, match=match):
            native.partial_solve(np.array(nodes, np.int32), np.ones((6, 1)), np.array([0], np.int32))


def test_a_graph_of_two_bodies_is_factored():
    """Nodes that no entry joins, as two organs in one matrix."""
    A = np.diag(np.arange(1.0, 61))
    assert np.allclose(Factors(csr_array(A), np.zeros((20, 3))).solve(np.ones(60)), 1 / np.arange(1.0, 61))


@settings(max_examples=50, deadline=None)
@given(st.integers(1, 400), st.integers(0, 2**32 - 1))
def test_cuts_through_places_that_coincide_lose_no_node(nodes, seed):
    rng = np.random.default_rng(seed)
    a, b = rng.integers(0, nodes, (2, nodes))
    one = np.ones(nodes)
    graph = csr_array((np.concatenate([one, one]), (np.concatenate([a, b]), np.concatenate([b, a]))))
    graph.resize(nodes, nodes)
    A = csr_array(kron(graph, np.ones((3, 3))))
    A = csr_array(A + diags_array(A.sum(axis=1) + 1))
    x = Factors(A, rng.integers(0, 4, (nodes, 3)).astype(float)).solve(A @ np.arange(3.0 * nodes))
    np.testing.assert_allclose(x, np.arange(3.0 * nodes), atol=1e-9 * nodes)


def test_finite_elements_of_second_order_use_it():
    truth = pp.finite_elements(block(4, element="P2"))
    answer = truth.push((25.0, 25.0, 50.0), (0.0, 0.0, -2.0), 15.0)
    assert answer.error < 1e-10
