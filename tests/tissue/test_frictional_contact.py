"""Contacts that slide and open: the laws themselves, and independent solvers of the same problem."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear
from support.brick_meshes import block

import palpate as pp
from palpate.errors import DataError
from palpate.tissue import frictional_contact
from palpate.tissue.frictional_contact import contact_states, sliding_forces

MANY = st.integers(1, 5)
SEED = st.integers(0, 2**31)


def problem(m, seed, coupling=0.3):
    """A random compliance whose contacts act on each other, as patches on one organ do; tools; normals."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((3 * m, 3 * m))
    C = np.kron(np.eye(m), np.diag([1.6, 1.5, 1.0])) + coupling * A @ A.T / (3 * m)
    n = rng.standard_normal((m, 3))
    return C, rng.normal(0, 2, (m, 3)), n / np.linalg.norm(n, axis=1, keepdims=True)


def parts(C, d, n, f):
    """Pressure, tangential force, gap and tangential slip of each contact."""
    slip = (C @ f.ravel()).reshape(-1, 3) - d
    pressure, gap = -(f * n).sum(axis=1), -(slip * n).sum(axis=1)
    return pressure, f + pressure[:, None] * n, gap, slip + gap[:, None] * n


@settings(max_examples=80, deadline=None)
@given(MANY, st.sampled_from([0.0, 0.1, 0.3, 0.6]), SEED)
def test_the_forces_obey_signorini_and_coulomb(m, friction, seed):
    C, d, n = problem(m, seed)
    f = sliding_forces(C, d, n, friction)
    pressure, along, gap, slip = parts(C, d, n, f)
    tiny = 1e-9 * max(np.abs(f).max(), np.abs(d).max())
    assert (pressure >= -tiny).all()
    assert (gap >= -tiny).all()
    assert np.abs(pressure * gap).max() < tiny
    assert (np.linalg.norm(along, axis=1) <= friction * pressure + tiny).all()
    for p, t, s, state in zip(pressure, along, slip, contact_states(f, n, friction), strict=True):
        if state == "open":
            assert (t == 0).all()
        elif state == "stick":
            assert np.abs(s).max() < tiny
        else:  # what slips is held back along its slip, with all the friction there is
            assert abs(np.linalg.norm(t) - friction * p) < tiny
            assert t @ s <= tiny
            assert np.linalg.norm(np.cross(t, s)) < 10 * tiny * max(1, np.linalg.norm(t))


def test_all_three_states_come_about():
    seen = {s for seed in range(10) for s in contact_states(*solved(3, 0.3, seed), 0.3)}
    assert seen == {"open", "stick", "slide"}


def solved(m, friction, seed):
    C, d, n = problem(m, seed)
    return sliding_forces(C, d, n, friction), n


@settings(max_examples=60, deadline=None)
@given(MANY, SEED)
def test_without_friction_it_is_the_convex_problem(m, seed):
    """min p'Ap/2 − p'b over p ≥ 0, by bounded least squares on the root of A."""
    C, d, n = problem(m, seed)
    N = np.zeros((3 * m, m))
    for c in range(m):
        N[3 * c : 3 * c + 3, c] = -n[c]
    A, b = N.T @ C @ N, N.T @ d.ravel()
    root = np.linalg.cholesky(A)
    p = lsq_linear(root.T, np.linalg.solve(root, b), (0, np.inf), tol=1e-14).x
    pressure = parts(C, d, n, sliding_forces(C, d, n, 0.0))[0]
    np.testing.assert_allclose(pressure, p, atol=1e-6 * max(1, np.abs(p).max()))


@pytest.mark.parametrize("friction", [0.15, 0.3])
@pytest.mark.parametrize("seed", range(5))
def test_it_is_the_fixed_point_of_convex_cone_problems(friction, seed):
    """Haslinger's: with the friction's bound μp given the balance is a convex minimum, here by projected gradients."""
    m = 1 + seed % 4
    C, d, n = problem(m, seed)
    f, bound, step = np.zeros((m, 3)), np.zeros(m), 1 / np.linalg.eigvalsh(C)[-1]
    for _ in range(40):
        for _ in range(200):
            f = f - step * (C @ f.ravel() - d.ravel()).reshape(m, 3)
            pressure = -(f * n).sum(axis=1)
            along = f + pressure[:, None] * n
            length = np.linalg.norm(along, axis=1)
            along *= np.minimum(1, bound / np.maximum(length, 1e-300))[:, None]
            f = along - np.maximum(pressure, 0)[:, None] * n
        bound = friction * np.maximum(-(f * n).sum(axis=1), 0)
    np.testing.assert_allclose(sliding_forces(C, d, n, friction), f, atol=1e-8 * max(1, np.abs(f).max()))


@pytest.mark.parametrize("make", [pp.finite_elements, lambda tissue: pp.model(tissue, "compliance")])
def test_tools_on_a_tissue_slide_stick_and_lose_touch(make):
    tissue = block(7)
    model = make(tissue)
    points = [[12.0, 12.0, 50.0], [38.0, 12.0, 50.0], [25.0, 38.0, 50.0]]
    push = [[0.1, 0.0, -2.0], [3.0, 0.0, -2.0], [0.0, 0.0, 1.0]]  # in; in and along; away
    answer = model.push(points, push, 9.0, friction=0.3)
    assert answer.state == ("stick", "slide", "open")
    assert (answer.force[2] == 0).all()
    assert (answer.force[:2, 2] > 0).all()  # the tissue pushes back
    along = np.linalg.norm(answer.force[:, :2], axis=1)
    assert along[0] < 0.3 * answer.force[0, 2]
    assert abs(along[1] - 0.3 * answer.force[1, 2]) < 1e-9
    assert answer.force[1, 0] < 0  # and holds back what slides over it
    np.testing.assert_allclose(answer.realised[0], push[0], atol=1e-9)
    assert abs(answer.realised[1, 2] + 2) < 1e-9
    assert answer.realised[1, 0] < 2.5


def test_much_friction_is_glue_and_normals_may_be_given():
    tissue = block(6)
    model = pp.model(tissue, "compliance")
    glued = model.push([25.0, 25.0, 50.0], [0.2, 0.0, -2.0], 12.0)
    rough = model.push([25.0, 25.0, 50.0], [0.2, 0.0, -2.0], 12.0, friction=5.0)
    np.testing.assert_allclose(rough.force, glued.force, rtol=1e-9)
    assert rough.state == glued.state == "stick"
    given_ = model.push([25.0, 25.0, 50.0], [0.2, 0.0, -2.0], 12.0, [0.0, 0.0, 7.0], 0.0)
    own = model.push([25.0, 25.0, 50.0], [0.2, 0.0, -2.0], 12.0, friction=0.0)
    np.testing.assert_allclose(given_.force, own.force, atol=1e-12)
    assert own.state == "slide"
    turned = model.push([25.0, 25.0, 50.0], [0.2, 0.0, -2.0], 12.0, [0.0, 0.0, -1.0], 0.0)
    assert turned.state == "open"  # a normal that points inwards: the tool moves away


def test_what_cannot_be_is_refused():
    tissue = block(5)
    model = pp.model(tissue, "compliance")
    for friction in (-0.1, np.nan):
        with pytest.raises(DataError, match="friction"):
            model.push([25.0, 25.0, 50.0], [0.0, 0.0, -1.0], 15.0, friction=friction)
    with pytest.raises(DataError, match="normals: that of contact 0 is zero"):
        model.push([25.0, 25.0, 50.0], [0.0, 0.0, -1.0], 15.0, [0.0, 0.0, 0.0], 0.3)
    with pytest.raises(DataError, match="glued"):
        pp.model(tissue, "blocks").push([25.0, 25.0, 50.0], [0.0, 0.0, -1.0], 15.0, friction=0.3)


def test_no_balance_is_said(monkeypatch):
    C, d, n = problem(4, 1, coupling=2.0)
    sliding_forces(C, d, n, 0.3)
    monkeypatch.setattr(frictional_contact, "_MOST_SWEEPS", 1)
    with pytest.raises(DataError, match="less friction, or move the contacts apart"):
        sliding_forces(C, d, n, 0.3)
    up = np.array([0.0, 0.0, 1.0])
    with pytest.raises(DataError, match="finds no balance"):  # pressed straight in: nothing slips
        frictional_contact._sliding_force(np.eye(3), -up, up, 0.3)
