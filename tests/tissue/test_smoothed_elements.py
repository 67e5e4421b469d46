"""Smoothed elements: rigid motions and linear fields are exact, a material ends where its region does, and no locking."""

import sys
from pathlib import Path

import numpy as np
import pytest
from support.brick_meshes import block, brick

import palpate as pp
from palpate.errors import MaterialError
from palpate.tissue.models.neo_hookean import neo_hookean_energy
from palpate.tissue.models.registry import STAND_IN
from palpate.tissue.reference.linear_elasticity import lame
from palpate.tissue.smoothed_elements import p1_stiffness, smoothed_stiffness, smoothing_cells

sys.path.append(str(Path(__file__).parents[2]))
from benchmarks.certificate_soundness import stiffness

TOP = np.array([25.0, 25.0, 50.0])


@pytest.fixture(scope="module")
def mixed():
    """An irregular block of two materials."""
    mesh = brick((3, 4, 5), (30, 40, 50), warp=0.3, region=lambda x: 1 + (x[:, 2] > 25))
    return pp.Tissue(mesh, {1: 5.0, 2: 20.0}, {1: 0.45, 2: 0.2}, mesh.nodes[:, 2] == 0)


def matrix(tissue):
    return smoothed_stiffness(tissue.mesh, *lame(tissue.young, tissue.poisson))


def test_the_stiffness_is_that_of_its_definition(mixed):
    K, expected = matrix(mixed), stiffness(mixed)
    assert mixed.element == "smoothed"  # the default
    assert abs(K - expected).max() < 1e-12 * abs(expected).max()
    assert abs(K - pp.finite_elements(mixed).K).max() == 0


def test_cells_share_out_the_whole_volume(mixed):
    cells = smoothing_cells(mixed.mesh, *lame(mixed.young, mixed.poisson))
    for volumes in (cells.edge_volumes, cells.node_volumes):
        assert volumes.sum() == pytest.approx(30 * 40 * 50)


def test_it_is_symmetric_and_only_the_six_rigid_motions_are_free(mixed):
    K, x = matrix(mixed).toarray(), mixed.mesh.nodes
    assert (K == K.T).all()
    turns = [np.cross(axis, x).ravel() for axis in np.eye(3)]
    moves = [np.tile(axis, len(x)) for axis in np.eye(3)]
    for motion in turns + moves:
        assert np.abs(K @ motion).max() < 1e-12 * np.abs(K).max() * np.abs(motion).max()
    values = np.linalg.eigvalsh(K)
    assert (np.abs(values[:6]) < 1e-12 * values[-1]).all()
    assert values[6] > 1e-4 * values[-1]


def test_a_linear_displacement_is_in_balance_with_its_tractions():
    """The patch test: inner nodes need no force, and the outer ones that of P1, for which the field is exact too."""
    mesh = brick((4, 4, 4), warp=0.3)
    constants = lame(np.full(len(mesh.tets), 5.0), np.full(len(mesh.tets), 0.45))
    u = (mesh.nodes @ np.array([[0.1, 0.2, 0.3], [-0.2, 0.1, 0.0], [0.4, 0.5, 0.6]])).ravel()
    force = (smoothed_stiffness(mesh, *constants) @ u).reshape(-1, 3)
    linear = (stiffness(pp.Tissue(mesh, 5.0, 0.45, mesh.nodes[:, 2] == 0, element="P1")) @ u).reshape(-1, 3)
    inner = np.setdiff1d(np.arange(len(u) // 3), mesh.surface_nodes)
    assert len(inner) == 27
    assert np.abs(force[inner]).max() < 1e-13 * np.abs(force).max()
    np.testing.assert_allclose(force, linear, atol=1e-13 * np.abs(force).max())


def test_a_material_ends_where_its_region_does():
    """Stacked layers in series: each strains as its own modulus says, and their nodes are where the exact ones are."""
    mesh = brick((3, 3, 6), region=lambda x: 1 + (x[:, 2] > 25))
    tissue = pp.Tissue(mesh, {1: 5.0, 2: 50.0}, 0.0, mesh.nodes[:, 2] == 0)
    K, x = matrix(tissue).tocsr(), mesh.nodes
    u = np.zeros_like(x)
    u[:, 2] = -np.where(x[:, 2] < 25, x[:, 2] / 25, 1 + (x[:, 2] - 25) / 250)  # 10 to 1 of strain, ν = 0
    force = (K @ u.ravel()).reshape(-1, 3)
    between = (x[:, 2] > 0) & (x[:, 2] < 50)
    assert np.abs(force[between]).max() < 1e-13 * np.abs(force).max()


def test_a_cell_takes_the_mean_shear_modulus_and_the_harmonic_mean_of_lambda():
    mesh = brick((2, 2, 2))
    rng = np.random.default_rng(2)
    lam, mu = rng.uniform(1, 9, (2, len(mesh.tets)))
    cells = smoothing_cells(mesh, lam, mu)
    around = (mesh.tets == 13).any(axis=1)  # the middle node: all tets have the same volume
    assert cells.lam[13] == pytest.approx(1 / np.mean(1 / lam[around]))
    at_edge = (mesh.tets == 13).any(axis=1) & (mesh.tets == 0).any(axis=1)
    one = int(np.flatnonzero(at_edge)[0])
    pair = [(a, b) for a in range(4) for b in range(a + 1, 4)]
    place = next(k for k, (a, b) in enumerate(pair) if set(mesh.tets[one, [a, b]].tolist()) == {0, 13})
    assert at_edge.sum() == 6
    assert cells.mu[cells.edge[one, place]] == pytest.approx(mu[at_edge].mean())


def test_it_does_not_lock():
    """Force over that of P2 elements, which have eight times the unknowns; the same for P1."""
    off = {}
    for element in ("smoothed", "P1"):
        for nu in (0.3, 0.49):
            tissue = block(7, poisson=nu, element=element)
            truth = pp.finite_elements(tissue, "P2").push(TOP, [0, 0, -1.0], 20.0).force[2]
            off[element, nu] = pp.finite_elements(tissue).push(TOP, [0, 0, -1.0], 20.0).force[2] / truth - 1
    assert abs(off["smoothed", 0.3]) < 0.015
    assert abs(off["smoothed", 0.49]) < 0.015
    assert off["P1", 0.3] > 0.1
    assert off["P1", 0.49] > 0.35


@pytest.mark.parametrize("name", ["blocks", "multigrid", "compliance", "neo-hookean"])
def test_every_model_solves_these_elements(name):
    tissue = block(6, poisson=0.45)
    push = np.array([0.002, 0.001, -0.004]) if name == "neo-hookean" else np.array([1.0, 0.5, -2.0])
    truth = pp.finite_elements(tissue).push(TOP, push, 15.0)
    answer = pp.model(tissue, name).push(TOP, push, 15.0, tolerance=1e-5)
    np.testing.assert_allclose(answer.force, truth.force, atol=1e-3 * np.linalg.norm(truth.force))
    np.testing.assert_allclose(answer.displacement, truth.displacement, atol=1e-3 * np.abs(push).max())


def test_the_model_that_stands_in_solves_p1_elements(mixed):
    """Against scikit-fem's: the stiffness, and a push."""
    K = p1_stiffness(mixed.mesh, *lame(mixed.young, mixed.poisson)).toarray()
    expected = pp.finite_elements(mixed, "P1").K.toarray()
    np.testing.assert_allclose(K, expected, atol=1e-12 * np.abs(expected).max())
    top = mixed.mesh.nodes.max(axis=0) * [0.5, 0.5, 1]
    answers = [
        way.push(top, [1.0, 0.5, -2.0], 15.0) for way in (pp.finite_elements(mixed, "P1"), pp.model(mixed, STAND_IN))
    ]
    np.testing.assert_allclose(answers[1].force, answers[0].force, rtol=1e-8)


def test_the_model_that_stands_in_tells_its_own_errors():
    """That of its elements, and of linear strain that of the same elements: a small push has none."""
    tissue = block(7, poisson=0.45)
    estimates = [pp.model(tissue, name).push(TOP, [0, 0, -0.2], 15.0).estimate for name in (STAND_IN, "compliance")]
    assert estimates[0].mesh > 0.05 + estimates[1].mesh
    for estimate in estimates:
        assert abs(estimate.linearisation) < 0.02


@pytest.mark.parametrize("element", ["P2", "mixed"])
def test_models_refuse_what_only_references_have(element):
    tissue = block(3, element=element)
    for name in ("blocks", "multigrid", "compliance", "neo-hookean"):
        with pytest.raises(MaterialError, match=f'"{element}".*finite_elements.*springs.*smoothed'):
            pp.model(tissue, name)
    assert pp.model(tissue, "springs").push(TOP, [0, 0, -1.0], 20.0).force[2] > 0
    assert pp.select_model(tissue, depth=1, contacts=1).trials[0].name == "springs"


def energy_of(tissue, u):
    """By its definition in words: mean F of each edge, volume of each node, a barrier for flat tets."""
    lam, mu = lame(tissue.young, tissue.poisson)
    cells, tets = smoothing_cells(tissue.mesh, lam, mu), tissue.mesh.tets
    F = np.eye(3) + np.einsum("mai,maj->mij", u[tets], cells.slopes)
    J = np.linalg.det(F)
    mean, volume = np.zeros((len(cells.mu), 3, 3)), np.zeros(len(cells.lam))
    for k in range(6):
        np.add.at(mean, cells.edge[:, k], cells.volumes[:, None, None] / 6 * F)
    for k in range(4):
        np.add.at(volume, cells.node[:, k], cells.volumes / 4 * J)
    mean /= cells.edge_volumes[:, None, None]
    shear = cells.mu * (((mean**2).sum(axis=(1, 2)) - 3) / 2 - np.log(np.linalg.det(mean)))
    bulk = cells.lam / 2 * np.log(volume / cells.node_volumes) ** 2
    barrier = mu * np.log(np.minimum(J / 0.3, 1)) ** 2
    return shear @ cells.edge_volumes + bulk @ cells.node_volumes + barrier @ cells.volumes, J


def crushed(tissue):
    """A displacement (N, 3) mm that flattens some tets below the barrier."""
    x, rng = tissue.mesh.nodes, np.random.default_rng(0)
    return np.ascontiguousarray(2.0 * np.sin(x[:, [1, 2, 0]] / 7) + 1.4 * rng.standard_normal(x.shape))


def test_the_energy_at_finite_strain_is_the_stated_one(mixed):
    u = crushed(mixed)
    expected, J = energy_of(mixed, u)
    value, _, least = neo_hookean_energy(mixed).energy(u)
    assert 0 < J.min() < 0.2  # the barrier is at work
    assert least == pytest.approx(J.min(), rel=1e-12)
    assert value == pytest.approx(expected, rel=1e-12)
