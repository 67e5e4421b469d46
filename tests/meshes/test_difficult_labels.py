"""Shapes that are hard to mesh, and regions that meet: what every mesh must be, whatever the label."""

import re
import sys
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes.test_isosurface_stuffing import angles, check_solid, skin
from scipy import ndimage
from scipy.spatial import cKDTree
from skimage.measure import marching_cubes
from support.difficult_labels import ORGAN, SHAPES, ball, capsule, plain, regions, rounded_box

import palpate as pp
from palpate.errors import DataError, MeshError
from palpate.meshes.element_quality import dihedrals, smallest_dihedral
from palpate.meshes.stuffing.dihedral_improvement import improve_dihedrals
from palpate.meshes.stuffing.nested_solids import solids
from palpate.meshes.stuffing.thin_features import predict_losses


def meshed(shape, **more):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return pp.tetrahedralize(shape.labels, 1, shape.edge, **{**shape.options, **more})


def voxels(shape):
    """What the mesh is to fill, without parts that are dropped and with voids that are filled."""
    mask = shape.labels.values > 0
    if shape.options.get("keep") != "all":
        part, _ = ndimage.label(mask)
        mask = part == 1 + np.argmax(np.bincount(part.ravel())[1:])
    return ndimage.binary_fill_holes(mask) if shape.options.get("fill_holes", True) else mask


def check(mesh, shape, tolerance=0.02):
    check_solid(mesh.nodes, mesh.tets)
    assert angles(mesh.nodes, mesh.tets).min() >= 10
    whole = voxels(shape)
    assert mesh.volumes.sum() == pytest.approx(whole.sum() * shape.labels.grid.voxel_volume, rel=tolerance)
    for value in np.unique(mesh.region):
        label = ((shape.labels.values == value) & whole).sum() * shape.labels.grid.voxel_volume
        if len(np.unique(mesh.region)) > 1:
            assert mesh.volumes[mesh.region == value].sum() == pytest.approx(label, rel=tolerance)
    return whole


def check_regions_share_faces(mesh):
    """The skins of all regions together are the skin of the whole and faces between two regions, each from both."""
    count = {}
    for value in np.unique(mesh.region):
        for face in np.sort(skin(mesh.tets[mesh.region == value]), axis=1).tolist():
            count[tuple(face)] = count.get(tuple(face), 0) + 1
    outer = {tuple(face) for face in np.sort(skin(mesh.tets), axis=1).tolist()}
    assert all(n == (1 if face in outer else 2) for face, n in count.items())
    assert outer <= set(count)


FAST = ("thin plate", "narrow neck", "three handles", "sponge", "rough", "wedge", "several parts", "halves")


@pytest.mark.parametrize("name", FAST)
def test_hard_shapes_keep_angles_volume_and_surface(name):
    shape = SHAPES[name]()
    mesh = meshed(shape)
    whole = check(mesh, shape)
    check_regions_share_faces(mesh)
    # Half an edge either way, to marching cubes over the label smoothed by 0.7 voxels at equal volume: its nodes and middles.
    fine = np.pad(whole, 4).repeat(2, 0).repeat(2, 1).repeat(2, 2)
    field = ndimage.gaussian_filter(fine.astype(np.float32), 1.4)
    level = np.partition(field.ravel(), -fine.sum())[-fine.sum()]
    vertices, triangles, _, _ = marching_cubes(field, level)
    points = shape.labels.grid.points((np.concatenate([vertices, vertices[triangles].mean(axis=1)]) + 0.5) / 2 - 4.5)
    corners = mesh.nodes[skin(mesh.tets)]
    weights = np.random.default_rng(0).dirichlet([1, 1, 1], 60)
    strewn = np.concatenate([np.einsum("j,tjk->tk", w, corners) for w in weights])
    assert cKDTree(strewn).query(points)[0].max() < 0.5 * shape.edge
    assert cKDTree(points).query(strewn)[0].max() < 0.5 * shape.edge


@st.composite
def touching(draw):
    """An ellipsoid with a ball and a rod anywhere in it, also across its skin and through one another."""
    centre = [draw(st.floats(-14, 14)), draw(st.floats(-8, 8)), draw(st.floats(-6, 6))]
    ends = [[x, draw(st.floats(-8, 8)), draw(st.floats(-6, 6))] for x in (-24, 24)]
    lump = ball(centre, draw(st.floats(5, 8)))
    vessel = capsule(*ends, draw(st.floats(3.2, 4.5)))
    return regions([ORGAN, *draw(st.permutations([lump, vessel]))], (22, 15, 13), draw(st.sampled_from([2.6, 3.0])))


@settings(max_examples=4, deadline=None, derandomize=True)
@given(touching())
def test_regions_anywhere_conform_and_keep_their_volumes(shape):
    counts = np.bincount(shape.labels.values.ravel(), minlength=4)[1:]
    if counts.min() < 400:  # hidden behind the other or outside
        return
    mesh = meshed(shape)
    check(mesh, shape, 0.04)  # regions of a few hundred tets
    check_regions_share_faces(mesh)


def test_a_tumour_at_the_skin_lies_where_it_is():
    shape = regions([ORGAN, ball((14, 6, 4), 8)], (22, 15, 13), 2.6)
    mesh = meshed(shape)
    inner = {tuple(f) for f in np.sort(skin(mesh.tets[mesh.region == 2]), axis=1).tolist()}
    between = np.array(sorted(inner - {tuple(f) for f in np.sort(skin(mesh.tets), axis=1).tolist()}))
    away = np.linalg.norm(mesh.nodes[np.unique(between)] - [14, 6, 4], axis=1) - 8
    assert np.abs(away).max() < 0.5 * shape.edge
    assert np.abs(away).mean() < 0.1 * shape.edge
    alone = meshed(plain(ORGAN, (22, 15, 13), 2.6))
    skin_nodes = mesh.nodes[np.unique(skin(mesh.tets))]
    assert cKDTree(alone.nodes[np.unique(skin(alone.tets))]).query(skin_nodes)[0].max() < 0.5 * shape.edge


def test_low_medium_and_high_of_one_label_have_one_volume():
    shape = SHAPES["lobed"]()
    tets, volume = [], []
    for edge in (3.2, 2.4, 1.8):
        mesh = pp.tetrahedralize(shape.labels, 1, edge)
        check_solid(mesh.nodes, mesh.tets)
        tets.append(len(mesh.tets))
        volume.append(mesh.volumes.sum())
    assert tets[0] * 1.7 < tets[1] < tets[2] / 1.7
    assert np.ptp(volume) < 0.015 * np.mean(volume)


def test_elements_grow_towards_the_interior():
    shape = plain(ball((0, 0, 0), 18), (18, 18, 18), 2.0)
    even, graded = meshed(shape), meshed(shape, interior=4.5)
    check(graded, shape)
    assert len(graded.tets) < 0.7 * len(even.tets)
    assert len(graded.surface) == pytest.approx(len(even.surface), rel=0.25)
    x = graded.nodes[graded.tets]
    edge = np.mean([np.linalg.norm(x[:, i] - x[:, j], axis=1) for i in range(4) for j in range(i)], axis=0)
    deep = np.linalg.norm(x.mean(axis=1), axis=1) < 5
    assert edge[deep].mean() > 1.6 * edge[~deep].mean()
    for wrong in (1.0, np.nan, 1e3):
        with pytest.raises(MeshError, match="interior: expected an edge from that of the surface, 2 mm, to 32 times"):
            meshed(shape, interior=wrong)


def test_thin_places_get_smaller_elements_only_there():
    shape = SHAPES["wedge"]()
    same, finer = meshed(shape, finer_where_thin=False), meshed(shape)
    assert finer.nodes[:, 0].min() < same.nodes[:, 0].min() - 1  # the sharp end is there
    assert len(finer.tets) < 1.4 * len(same.tets)


def test_what_would_be_lost_is_told_before_work_starts(monkeypatch):
    sheet = lambda p: np.minimum(1.0 - np.abs(p[:, 2]), 14 - np.abs(p[:, :2]).max(axis=1))  # noqa: E731
    thick = rounded_box((14, 6, 8), 2)
    shape = plain(lambda p: np.maximum(sheet(p), thick(p)), (14, 14, 8), 6.0)
    body = solids(shape.labels, 1, [], keep="largest", fill_holes=True, closed_at_border=False)[0]
    lost = predict_losses(body, 6.0)
    beyond = (np.abs(shape.labels.grid.points(np.argwhere(shape.labels.values))[:, 1]) > 6).sum()
    assert 0.02 < lost.part <= beyond / (shape.labels.values > 0).sum()
    assert lost.places == 2
    assert lost.thickness == pytest.approx(2)
    assert 2 < lost.furthest <= 14
    assert predict_losses(body, 2.0).part == 0

    def work(*_):
        raise AssertionError("work has started")

    monkeypatch.setattr("palpate.meshes.tetrahedralize.stuff_to_volume", work)
    with pytest.raises(MeshError) as refusal:
        pp.tetrahedralize(shape.labels, 1, 6.0, most_lost=0.01, finer_where_thin=False)
    assert re.search(r"% of the volume, in 2 places up to 2 mm thick, reaching [\d.]+ mm from what", str(refusal.value))


@pytest.mark.parametrize("seed", range(3))
def test_the_quick_angle_is_the_smallest_dihedral(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(40, 3))
    tets = np.array([rng.permutation(40)[:4] for _ in range(200)])
    np.testing.assert_allclose(smallest_dihedral(points, tets), dihedrals(points, tets).min(axis=1), atol=1e-5)
    points[:, 2] = 0
    assert (smallest_dihedral(points, tets) < 1e-5).all()
    assert smallest_dihedral(points, tets[:, [0, 0, 1, 2]]).max() == 0


def test_a_node_pushed_into_its_neighbours_is_lifted_out():
    mesh = meshed(plain(ball((0, 0, 0), 8), (8, 8, 8), 2.5))
    x = mesh.nodes.copy()
    inner = np.setdiff1d(np.arange(len(x)), mesh.surface)[7]
    star = (mesh.tets == inner).any(axis=1)
    neighbours = np.setdiff1d(mesh.tets[star], inner)
    x[inner] += 0.55 * (x[neighbours[0]] - x[inner])
    before = smallest_dihedral(x, mesh.tets).min()
    after = improve_dihedrals(x, mesh.tets, before + 3)
    assert smallest_dihedral(after, mesh.tets).min() >= before + 3
    moved = np.flatnonzero((after != x).any(axis=1))
    assert 0 < len(moved) < 40
    assert (improve_dihedrals(x, mesh.tets, before - 1) == x).all()


def test_tetwild_is_asked_for_by_name_and_its_absence_is_told(monkeypatch):
    shape = SHAPES["rod"]()
    monkeypatch.setitem(sys.modules, "pytetwild", None)
    with pytest.raises(MeshError, match=r"needs pytetwild .*pip install 'palpate\[tetwild\]'.*Mozilla Public License"):
        meshed(shape, mesher="tetwild")
    with pytest.raises(DataError, match="mesher: expected 'stuffing' or 'tetwild', got 'gmsh'"):
        meshed(shape, mesher="gmsh")


def test_tetwild_fills_a_shape_with_two_regions():
    pytest.importorskip("pytetwild", exc_type=ImportError)
    shape = regions([ORGAN, ball((14, 6, 4), 8)], (22, 15, 13), 5.0)
    mesh = meshed(shape, mesher="tetwild")
    check(mesh, shape, 0.05)
    check_regions_share_faces(mesh)
    with pytest.raises(DataError, match="fine, interior: mesher 'tetwild' makes elements of one size"):
        meshed(shape, mesher="tetwild", fine={2: 2.0})
