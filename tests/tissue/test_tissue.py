"""Tissue: constants and supports that can be, and clear words for those that cannot."""

import numpy as np
import pytest
from support.brick_meshes import brick

import palpate as pp
from palpate.errors import MaterialError

MESH = brick((3, 3, 3), region=lambda c: np.where(c[:, 2] > 30, 2, 1))
BOTTOM = MESH.nodes[:, 2] == 0


def test_constants_may_be_given_per_region_by_number_or_name():
    named = pp.TetMesh(MESH.nodes, MESH.tets, MESH.region, {1: "fat", 2: "lump"})
    tissue = pp.Tissue(named, {"fat": 3.25, 2: 42.5}, {1: 0.3, "lump": 0.45}, BOTTOM)
    np.testing.assert_array_equal(tissue.young, np.where(MESH.region == 2, 42.5, 3.25))
    np.testing.assert_array_equal(tissue.poisson, np.where(MESH.region == 2, 0.45, 0.3))


def test_fixed_nodes_may_be_a_mask_or_indices():
    by_mask = pp.Tissue(MESH, 5, 0.3, BOTTOM)
    by_index = pp.Tissue(MESH, np.full(len(MESH.tets), 5.0), 0.3, np.flatnonzero(BOTTOM))
    np.testing.assert_array_equal(by_mask.fixed, by_index.fixed)
    np.testing.assert_array_equal(by_mask.held, BOTTOM)


@pytest.mark.parametrize(
    ("constants", "words"),
    [
        ({"young": -5.0}, ["young", "-5", "tet 0", "positive"]),
        ({"young": 0.0}, ["young", "0 kPa", "positive"]),
        ({"young": np.nan}, ["young", "finite"]),
        ({"young": [1.0, 2.0]}, ["young", "(2,)", str(len(MESH.tets))]),
        ({"young": {1: 5.0}}, ["young", "region 2", "no value"]),
        ({"young": {1: 5.0, 2: 5.0, 7: 5.0}}, ["young", "7", "1, 2"]),
        ({"young": {"lump": 5.0}}, ["young", "lump", "1, 2"]),
        ({"young": {1: 5.0, 2: -1.0}}, ["young", "-1", "positive"]),
        ({"poisson": 0.5}, ["poisson", "0.5", "0.49", "mixed"]),
        ({"poisson": 0.51, "element": "mixed"}, ["poisson", "0.51", "mixed"]),
        ({"poisson": -0.1}, ["poisson", "-0.1"]),
        ({"element": "P3"}, ["element", "P3", "P2", "mixed"]),
    ],
)
def test_impossible_constants_are_refused(constants, words):
    given = {"young": 5.0, "poisson": 0.3, "element": "P1"} | constants
    element = given.pop("element")
    with pytest.raises(ValueError) as refusal:
        pp.Tissue(MESH, **given, fixed=BOTTOM, element=element)
    for word in words:
        assert word in str(refusal.value)


@pytest.mark.parametrize(
    ("fixed", "words"),
    [
        ([], ["fixed", "no node", "resting_on"]),
        ([0], ["fixed", "3 rigid motions", "three or more"]),
        (np.flatnonzero((MESH.nodes[:, 1:] == 0).all(axis=1)), ["fixed", "1 rigid motion", "not on one line"]),
        ([999], ["fixed", "999", "63"]),
        ([-1, 0, 5], ["fixed", "-1"]),
        (np.zeros(7, dtype=bool), ["fixed", "(64,)", "(7,)"]),
        ([0.5, 1.5], ["fixed", "float"]),
    ],
)
def test_supports_that_leave_a_rigid_motion_are_refused(fixed, words):
    with pytest.raises(MaterialError) as refusal:
        pp.Tissue(MESH, 5, 0.3, fixed)
    for word in words:
        assert word in str(refusal.value)


def test_each_loose_part_needs_its_own_support():
    one = brick((1, 1, 1))
    two = pp.TetMesh(np.concatenate([one.nodes, one.nodes + 100]), np.concatenate([one.tets, one.tets + 8]))
    with pytest.raises(MaterialError, match="part 1 of 2"):
        pp.Tissue(two, 5, 0.3, np.arange(4))
    pp.Tissue(two, 5, 0.3, np.concatenate([np.arange(4), 8 + np.arange(4)]))


def test_a_part_hinged_on_one_edge_still_swings():
    # Two tets that share only an edge: holding one leaves the other free to turn about it.
    nodes = [[0, 0, 0], [0, 0, 10], [10, 0, 0], [0, 10, 0], [-10, 0, 0], [0, -10, 0]]
    mesh = pp.TetMesh(nodes, [[0, 2, 3, 1], [0, 4, 5, 1]])
    with pytest.raises(MaterialError, match="1 rigid motion"):
        pp.Tissue(mesh, 5, 0.3, [0, 1, 2, 3])
    pp.Tissue(mesh, 5, 0.3, [0, 1, 2, 3, 4])


def test_resting_on_finds_the_face_on_the_table():
    np.testing.assert_array_equal(pp.resting_on(MESH, (0, 0, -1)), np.flatnonzero(BOTTOM))
    np.testing.assert_array_equal(pp.resting_on(MESH, (3, 0, 0)), np.flatnonzero(MESH.nodes[:, 0] == 50))
    # Deeper: still the face, for the walls stand on the table and do not lie on it.
    np.testing.assert_array_equal(pp.resting_on(MESH, (0, 0, -1), depth=17), np.flatnonzero(BOTTOM))


def test_a_round_bottom_rests_on_its_cap():
    ball = brick((8, 8, 8), (2.0, 2.0, 2.0)).nodes - 1  # a cube drawn onto a ball of radius 30
    nodes = 30 * ball * (np.abs(ball).max(axis=1) / np.maximum(np.linalg.norm(ball, axis=1), 1e-9))[:, None]
    mesh = pp.TetMesh(nodes, brick((8, 8, 8)).tets)
    for depth, height in ((None, -24.0), (3.0, -27.0)):
        expected = np.flatnonzero((np.linalg.norm(nodes, axis=1) > 29.9) & (nodes[:, 2] <= height + 1e-6))
        np.testing.assert_array_equal(pp.resting_on(mesh, (0, 0, -1), depth), expected)


@pytest.mark.parametrize(
    ("direction", "depth", "words"),
    [
        ((0, 0, 0), None, ["direction", "(0, 0, -1)"]),
        ((1, 1, 1), 1.0, ["1 nodes", "larger depth"]),
        ((0, 0, -1), -2, ["depth", "-2"]),
        ((0, np.nan, 1), None, ["direction", "finite"]),
    ],
)
def test_a_table_that_holds_nothing_is_refused(direction, depth, words):
    with pytest.raises(ValueError) as refusal:
        pp.resting_on(MESH, direction, depth)
    for word in words:
        assert word in str(refusal.value)


@pytest.mark.parametrize(
    ("law", "words"),
    [
        ({"law": "cubic"}, ["law", "cubic", "exponential"]),
        ({"rsc": 0.1}, ["rsc", "0.1", "negative"]),
        ({"law": "uniform", "rsc": -0.1}, ["rsc", "-0.1", "positive"]),
        ({"scale": -1.0}, ["scale", "-1", "positive"]),
    ],
)
def test_springs_that_would_push_outwards_are_refused(law, words):
    with pytest.raises(MaterialError) as refusal:
        pp.SpringLaw(**law)
    for word in words:
        assert word in str(refusal.value)


def test_a_clamp_holds_what_is_near_it():
    corner = np.flatnonzero(np.linalg.norm(MESH.nodes - [50, 50, 50], axis=1) <= 20)
    np.testing.assert_array_equal(pp.fixed_near(MESH, [50, 50, 50], 20), corner)
    assert len(corner) > 3
    inner = np.flatnonzero(((MESH.nodes > 0) & (MESH.nodes < 50)).all(axis=1))
    assert not np.isin(pp.fixed_near(MESH, [25, 25, 25], 40), inner).any()  # a clamp does not reach inside
    pp.Tissue(MESH, 5, 0.3, np.union1d(pp.fixed_near(MESH, [0, 0, 0], 18), pp.fixed_near(MESH, [50, 50, 50], 18)))


def test_plaster_holds_all_beyond_its_plane():
    np.testing.assert_array_equal(pp.fixed_beyond(MESH, [9, 9, 0], (0, 0, -1)), np.flatnonzero(BOTTOM))
    half = pp.fixed_beyond(MESH, [25, 25, 25], (1, 0, 1))
    np.testing.assert_array_equal(half, np.flatnonzero(MESH.nodes[:, [0, 2]].sum(axis=1) >= 50 - 1e-9))
    assert 0 < len(half) < len(MESH.nodes)


@pytest.mark.parametrize(
    ("support", "words"),
    [
        (lambda: pp.fixed_near(MESH, [0, 0, 0], 1.0), ["1 nodes", "16.7", "radius"]),
        (lambda: pp.fixed_near(MESH, [0, 0, 0], 0.0), ["radius", "0"]),
        (lambda: pp.fixed_near(MESH, [0, np.nan, 0], 9.0), ["point", "finite"]),
        (lambda: pp.fixed_beyond(MESH, [0, 0, -1], (0, 0, -1)), ["0 of 64", "1 to"]),
        (lambda: pp.fixed_beyond(MESH, [0, 0, -1], (0, 0, 1)), ["64 of 64"]),
        (lambda: pp.fixed_beyond(MESH, [0, 0, 0], (0, 0, 0)), ["normal", "(0, 0, -1)"]),
    ],
)
def test_supports_that_hold_nothing_or_all_are_refused(support, words):
    with pytest.raises(ValueError) as refusal:
        support()
    for word in words:
        assert word in str(refusal.value)
