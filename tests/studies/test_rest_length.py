"""Springs with rest length: the gradient of their energy, in balance, and linear where displacements vanish."""

import numpy as np
import pytest
from support.brick_meshes import brick

import palpate as pp
from palpate.studies.deformation.config import contact, tissue
from palpate.studies.deformation.rest_length import RestLengthSprings, rest_length_push
from palpate.studies.deformation.spring_laws import spring_law
from palpate.tissue.models.mass_spring import edge_stiffness

LAW = spring_law("exponential", 0.14, "equal")


def system(solid, home=0.01):
    K = edge_stiffness(solid, "equal")
    k = np.asarray(K[solid.edges[:, 0], solid.edges[:, 1]]).ravel()
    n = len(solid.mesh.nodes)
    return RestLengthSprings(solid.edges, k, np.full(n, home), solid.mesh.nodes, np.arange(n, dtype=np.int32))


@pytest.fixture(scope="module")
def warped():
    mesh = brick((2, 2, 2), warp=0.2)
    return pp.Tissue(mesh, 5.0, 0.3, mesh.nodes[:, 2] == 0)


def test_force_and_tangent_are_the_derivatives_of_the_energy(warped):
    springs, rng = system(warped), np.random.default_rng(1)
    u = rng.uniform(-3, 3, warped.mesh.nodes.shape)
    force, tangent = springs.force(u), springs.tangent(u, definite=False)
    assert np.abs(force).max() > 0.1
    for _ in range(5):
        way = rng.standard_normal(u.shape)
        h = 1e-4
        slope = (springs.energy(u + h * way) - springs.energy(u - h * way)) / (2 * h)
        assert slope == pytest.approx((force * way).sum(), rel=1e-6)
        change = (springs.force(u + h * way) - springs.force(u - h * way)).ravel() / (2 * h)
        np.testing.assert_allclose(tangent @ way.ravel(), change, atol=1e-5 * np.abs(change).max())


def test_the_definite_tangent_is_definite_and_differs_only_under_compression(warped):
    springs = system(warped, home=1e-3)
    x = warped.mesh.nodes
    squeezed, stretched = -0.3 * (x - x.mean(axis=0)), 0.3 * (x - x.mean(axis=0))
    assert np.linalg.eigvalsh(springs.tangent(squeezed, True).toarray())[0] > 0
    assert np.linalg.eigvalsh(springs.tangent(squeezed, False).toarray())[0] < 0
    np.testing.assert_array_equal(
        springs.tangent(stretched, True).toarray(), springs.tangent(stretched, False).toarray()
    )


def home_springs(solid, touched):
    """(N,) N/mm by the law as it is written, rows by a walk of our own."""
    weights = edge_stiffness(solid, "equal")
    neighbours = weights.toarray() > 0
    row = np.zeros(len(neighbours), int)
    row[touched] = 1
    for r in range(1, len(row)):
        row[neighbours[row == r].any(axis=0) & (row == 0)] = r + 1
    return (1 - np.exp(LAW.rsc * row)) * weights.sum(axis=1) / neighbours.sum(axis=1)


def along_edges(solid, touched, push):
    """The linear limit, by a dense solution: each edge resists along itself alone, k (e e')(u_j - u_i)."""
    n, x = len(solid.mesh.nodes), solid.mesh.nodes
    weights = edge_stiffness(solid, "equal")
    K = np.kron(np.diag(home_springs(solid, touched)), np.eye(3))
    for i, j in solid.edges:
        e = (x[j] - x[i]) / np.linalg.norm(x[j] - x[i])
        block = weights[i, j] * np.outer(e, e)
        for a, b, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
            K[3 * a : 3 * a + 3, 3 * b : 3 * b + 3] += sign * block
    unknowns = np.arange(3 * n).reshape(n, 3)
    u = np.zeros(3 * n)
    u[unknowns[touched]] = push
    free = np.setdiff1d(unknowns[~solid.held], unknowns[touched])
    u[free] = np.linalg.solve(K[np.ix_(free, free)], -(K @ u)[free])
    return u.reshape(n, 3), -(K @ u)[unknowns[touched]].sum(axis=0)


def test_small_pushes_are_linear_to_first_order():
    """The relative difference to the linear limit falls in proportion to the push."""
    solid = tissue(5, 0.3)
    point, radius = contact(solid, "node", 0.0)
    touched = np.flatnonzero((solid.mesh.nodes == point).all(axis=1))
    gaps = []
    for depth in (0.4, 0.2, 0.1, 0.05):
        push = np.array([0.3 * depth, 0.0, -depth])
        exact, force = along_edges(solid, touched, push)
        u, f = rest_length_push(solid, LAW, point, push, radius, rigid=True)
        gaps.append([np.abs(u - exact).max() / depth, np.abs(f - force).max() / np.abs(force).max()])
    order = np.log2(np.array(gaps[:-1]) / np.array(gaps[1:]))
    np.testing.assert_allclose(order[-1], 1, atol=0.1)
    assert (np.array(gaps[-1]) > 1e-5).all()  # they do differ


@pytest.mark.parametrize("name", ["node", "triangle"])
def test_pushes_and_pulls_are_in_balance_and_a_pull_is_stiffer(name):
    """Pulled edges straighten, pushed ones fold away."""
    solid = tissue(5, 0.3)
    point, radius = contact(solid, name, 0.0)
    touched = solid.surface.patch(solid.surface.closest(point), radius).nodes
    springs = system(solid)
    springs = RestLengthSprings(
        springs.ends, springs.stiffness, home_springs(solid, touched), springs.places, springs.free
    )
    others = np.setdiff1d(np.flatnonzero(~solid.held), touched)
    forces = []
    for z in (-5.0, 5.0):
        u, force = rest_length_push(solid, LAW, point, np.array([0.0, 0.0, z]), radius, rigid=True)
        np.testing.assert_allclose(u[touched], [[0, 0, z]] * len(touched), atol=1e-9)
        assert not u[solid.held].any()
        out = springs.force(u)
        assert np.abs(out[others]).max() < 1e-6 * np.abs(out[touched]).max()
        np.testing.assert_allclose(-out[touched].sum(axis=0), force, rtol=1e-6, atol=1e-9)
        forces.append(force[2])
    assert forces[0] > 0 > forces[1]
    assert -forces[1] > 1.05 * forces[0]


def test_the_mean_of_a_patch_is_moved_as_asked():
    solid = tissue(5, 0.3)
    spot = solid.surface.patch(solid.surface.closest(np.array([25.0, 25.0, 50.0])), 20.0)
    tool = np.array([0.5, 0.0, -3.0])
    u, _ = rest_length_push(solid, LAW, np.array([25.0, 25.0, 50.0]), tool, 20.0, rigid=False)
    np.testing.assert_allclose(spot.weights @ u[spot.nodes], tool, atol=1e-9)
    assert np.ptp(u[spot.nodes, 2]) > 0.1
