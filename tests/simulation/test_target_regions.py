"""Strain of an element, and what lies in a lump or how far from it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.example_organs import organ
from support.scored_session import in_which_region

import palpate as pp
from palpate.simulation.principal_stretch import Stretch, greatest_eigenvalue
from palpate.simulation.target_regions import connected_lumps


@pytest.fixture(scope="module")
def tissue():
    return organ(9)


@settings(max_examples=50)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1.0, 1e-6, 1e6]))
def test_greatest_eigenvalue_is_that_of_lapack(seed, scale):
    a = np.random.default_rng(seed).normal(0, scale, (20, 3, 3))
    a = a + np.swapaxes(a, 1, 2)
    a[0] = scale * np.eye(3)  # three alike
    a[1] = scale * np.diag([1.0, 2.0, 2.0])  # the greatest two alike
    a[2] = 0
    wanted = np.linalg.eigvalsh(a)[:, -1]
    np.testing.assert_allclose(greatest_eigenvalue(a), wanted, atol=1e-7 * scale)


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.floats(0.01, 0.8))
def test_stretch_of_an_even_deformation_is_its_greatest_singular_value(seed, size):
    mesh = organ(5).mesh
    rng = np.random.default_rng(seed)
    gradient = np.eye(3) + rng.normal(0, size, (3, 3))
    found = Stretch(mesh)(mesh.nodes @ gradient.T + rng.normal(0, 5, 3) - mesh.nodes)
    np.testing.assert_allclose(found, np.linalg.svd(gradient)[1][0] - 1, atol=1e-6)


def test_turning_stretches_nothing():
    mesh = organ(5).mesh
    turn = np.linalg.qr(np.random.default_rng(3).normal(0, 1, (3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    assert np.abs(Stretch(mesh)(mesh.nodes @ turn.T - mesh.nodes)).max() < 1e-7


def test_what_lies_in_a_deformed_lump(tissue):
    """Points of an organ that is sheared, turned and squeezed, against volumes of tets."""
    mesh, rng = tissue.mesh, np.random.default_rng(0)
    (lump,) = connected_lumps(mesh, 2)
    moved = mesh.nodes @ (np.eye(3) + rng.normal(0, 0.2, (3, 3))).T + 0.3 * np.sin(mesh.nodes)
    told = {True: 0, False: 0}
    for tet in rng.integers(0, len(mesh.tets), 150).tolist() + rng.choice(lump.tets, 50).tolist():
        point = rng.dirichlet(np.ones(4)) @ moved[mesh.tets[tet]]
        inside = in_which_region(mesh, moved, point) == 2
        assert (lump.distance(point, moved - mesh.nodes) == 0) == inside
        told[inside] += 1
    assert min(told.values()) > 40


def test_distance_from_a_ball_is_that_from_its_middle_less_its_radius(tissue):
    (lump,) = connected_lumps(organ(21).mesh, 2)
    ball = lump.mesh.nodes[np.unique(lump.faces)]
    radius = np.linalg.norm(ball - (0, 0, 10), axis=1)
    for point in ((0, 0, 40.0), (30.0, 20, 10), (-20, 5, -15.0)):
        far = np.linalg.norm(np.subtract(point, (0, 0, 10)))
        assert far - radius.max() <= lump.distance(point) <= far - radius.min()
    assert np.linalg.norm(lump.centre() - (0, 0, 10)) < 1.0


def test_a_region_in_two_parts_is_two_lumps(tissue):
    mesh = tissue.mesh
    middles = mesh.nodes[mesh.tets].mean(axis=1)
    region = np.where(np.linalg.norm(np.abs(middles) - (20, 0, 0), axis=1) < 9, 2, 1)
    two = connected_lumps(pp.TetMesh(mesh.nodes, mesh.tets, region), 2)
    assert len(two) == 2
    assert sorted(np.sign(lump.centre()[0]) for lump in two) == [-1, 1]
    assert sum(len(lump.tets) for lump in two) == (region == 2).sum()
