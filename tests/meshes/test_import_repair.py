"""Tetrahedra from anywhere: what can be mended is, and said; what cannot is refused with a word on what is wrong."""

import itertools
import re
import warnings

import meshio
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.brick_meshes import brick

import palpate as pp
from palpate.errors import MeshError

BRICK = brick((3, 2, 2), (30.0, 20.0, 20.0), warp=0.2)
VOLUME = 30 * 20 * 20


def read(path):
    """The mesh, and what was said of it."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        mesh = pp.read_mesh(path)
    assert all(str(w.message).startswith(f"{path}: ") for w in said)
    return mesh, [str(w.message).removeprefix(f"{path}: ") for w in said]


def written(path, nodes, cells, form=None, **options):
    form = form or ("gmsh" if path.suffix == ".msh" else None)  # to meshio, .msh alone is Ansys
    meshio.Mesh(nodes, cells).write(path, file_format=form, **options)
    return path


KINDS = [
    ("a.vtk", "vtk42", {"binary": True}),
    ("a.vtk", "vtk42", {"binary": False}),
    ("a.vtk", "vtk51", {"binary": True}),
    ("a.vtk", "vtk51", {"binary": False}),
    ("a.vtu", "vtu", {"binary": False}),
    ("a.vtu", "vtu", {"compression": "lzma"}),
    ("a.vtu", "vtu", {"compression": None}),
    ("a.msh", "gmsh22", {"binary": True}),
    ("a.msh", "gmsh22", {"binary": False}),
    ("a.msh", "gmsh", {"binary": True}),
    ("a.msh", "gmsh", {"binary": False}),
]


@pytest.mark.parametrize(("name", "form", "options"), KINDS, ids=lambda v: str(v))
def test_what_meshio_writes_is_read_as_it_is(tmp_path, name, form, options):
    mesh, said = read(written(tmp_path / name, BRICK.nodes, [("tetra", BRICK.tets)], form, **options))
    np.testing.assert_allclose(mesh.nodes, BRICK.nodes, rtol=1e-10)
    np.testing.assert_array_equal(mesh.tets, BRICK.tets)
    assert said == []


GMSH_41 = """$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
2
2 7 "skin"
3 9 "liver"
$EndPhysicalNames
$Entities
0 0 1 1
1 0 0 0 5 5 5 1 7 0
4 0 0 0 5 5 5 1 9 1 1
$EndEntities
$Nodes
2 5 1 12
2 1 0 3
1
2
3
0 0 0
5 0 0
0 5 0
3 4 0 2
11
12
0 0 5
5 5 5
$EndNodes
$Elements
2 3 1 3
2 1 2 1
1 1 2 3
3 4 4 2
2 1 2 3 11
3 2 3 11 12
$EndElements
"""


def test_a_gmsh_file_with_sparse_numbers_surfaces_and_physical_names(tmp_path):
    path = tmp_path / "organ.msh"
    path.write_text(GMSH_41)
    mesh, said = read(path)
    assert mesh.volumes.sum() == pytest.approx(125 / 6 + 125 / 3)
    assert mesh.region.tolist() == [9, 9]
    assert mesh.names == {9: "liver"}
    assert said == ["cells that are no solid: 1 triangle: ignored"]


@settings(max_examples=25, deadline=None, derandomize=True)
@given(st.integers(0, 2**32 - 1), st.floats(0, 1), st.floats(0, 1))
def test_shuffled_split_and_turned_tets_come_back_as_the_same_solid(tmp_path_factory, seed, apart, turned):
    """Any node may be stored several times, any tet inside out, in any order, with nodes between that nobody uses."""
    rng = np.random.default_rng(seed)
    tets = BRICK.tets[rng.permutation(len(BRICK.tets))].astype(np.int64)
    nodes = BRICK.nodes.copy()
    own = rng.random(tets.shape) < apart
    copies = np.concatenate([nodes, nodes[tets[own]]])
    tets[own] = len(nodes) + np.arange(own.sum())
    flip = rng.random(len(tets)) < turned
    tets[flip] = tets[flip][:, [1, 0, 2, 3]]
    order = rng.permutation(len(copies))
    place = np.argsort(order)
    path = tmp_path_factory.mktemp("any") / "a.vtu"
    mesh, said = read(written(path, copies[order], [("tetra", place[tets])]))
    assert len(mesh.nodes) == len(BRICK.nodes)
    assert mesh.volumes.sum() == pytest.approx(VOLUME)
    assert len(mesh.surface) == len(BRICK.surface)
    assert any("inverted: turned" in note for note in said) == flip.any()
    assert any("lie where another does: merged" in note for note in said) == own.any()


def test_nodes_of_two_pieces_that_only_lie_close_stay_two(tmp_path):
    nodes = np.concatenate([BRICK.nodes, BRICK.nodes + [30.05, 0, 0]])
    tets = np.concatenate([BRICK.tets, BRICK.tets + len(BRICK.nodes)])
    mesh, said = read(written(tmp_path / "two.vtk", nodes, [("tetra", tets)]))
    assert len(mesh.nodes) == 2 * len(BRICK.nodes)
    assert said == ["2 parts that no face joins (50.0%, 50.0% of the volume); each moves by itself"]


def quadratic(mesh):
    """The same solid of tets with 10 nodes, in the order of VTK, which meshio takes."""
    sides = [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)]
    key = np.sort(np.concatenate([mesh.tets[:, s] for s in sides]), axis=1)
    ends, index = np.unique(key, axis=0, return_inverse=True)
    middles = mesh.nodes[ends].mean(axis=1)
    middle_of = index.reshape(6, -1).T + len(mesh.nodes)
    return np.concatenate([mesh.nodes, middles]), np.hstack([mesh.tets, middle_of])


@pytest.mark.parametrize("name", ["q.vtu", "q.vtk", "q.msh"])
def test_quadratic_tets_are_reduced_to_their_corners(tmp_path, name):
    nodes, tets = quadratic(BRICK)
    mesh, said = read(written(tmp_path / name, nodes, [("tetra10", tets)]))
    np.testing.assert_allclose(mesh.nodes, BRICK.nodes)
    np.testing.assert_array_equal(mesh.tets, BRICK.tets)
    assert said == ["72 tets have 10 nodes: their 4 corners are kept, so that curved sides become straight"]


CUBE = np.array(list(itertools.product([0.0, 10], repeat=3)))[[0, 4, 6, 2, 1, 5, 7, 3]]


def refused(path, *words):
    with pytest.raises(MeshError) as refusal:
        pp.read_mesh(path)
    for word in (path.name, *words):
        assert re.search(word, str(refusal.value)), str(refusal.value)


def test_other_solids_are_refused_by_name_and_number(tmp_path):
    hexes = [("hexahedron", np.arange(8)[None])]
    refused(written(tmp_path / "h.vtu", CUBE, hexes), "no tetrahedra", "1 hexahedron", "mesh the solid")
    mixed = [("hexahedron", np.arange(8)[None]), ("tetra", [[4, 5, 6, 8]])]
    nodes = np.vstack([CUBE, [[5, 5, 20]]])
    refused(written(tmp_path / "m.vtk", nodes, mixed), "cells other than tetrahedra", "1 hexahedron", "split them")
    wedge = [("wedge", np.array([[0, 1, 3, 4, 5, 7]])), ("tetra", [[4, 5, 7, 8]])]
    refused(written(tmp_path / "w.vtu", nodes, wedge), "1 wedge")
    cubic = [("tetra20", np.arange(20)[None])]
    points = np.random.default_rng(0).normal(size=(20, 3))
    refused(written(tmp_path / "c.msh", points, cubic), "no tetrahedra with 4 or 10 nodes", "1 tetra20")


def test_tets_with_two_corners_in_one_place_are_dropped(tmp_path):
    nodes = np.vstack([BRICK.nodes, BRICK.nodes[5]])
    flat = [[5, *[n for n in BRICK.tets[0] if n != 5][:2], len(BRICK.nodes)]]
    mesh, said = read(written(tmp_path / "f.vtu", nodes, [("tetra", np.concatenate([BRICK.tets, flat]))]))
    np.testing.assert_array_equal(mesh.tets, BRICK.tets)
    assert "1 tets have two corners in one place: dropped" in said
    refused(written(tmp_path / "a.vtu", np.ones((4, 3)), [("tetra", [[0, 1, 2, 3]])]), "two corners in one place")


def test_metres_are_suspected(tmp_path):
    mesh, said = read(written(tmp_path / "m.vtu", BRICK.nodes / 1000, [("tetra", BRICK.tets)]))
    assert said == ["it is 0.03 mm across: coordinates are read as mm; multiply by 1000 if they are metres"]
    assert mesh.volumes.sum() == pytest.approx(VOLUME * 1e-9)


def test_regions_by_the_names_that_programs_give(tmp_path):
    tags = np.arange(len(BRICK.tets)) % 3 + 4
    for name in ("region", "medit:ref", "gmsh:physical"):
        path = tmp_path / "r.vtu"
        meshio.Mesh(BRICK.nodes, [("tetra", BRICK.tets)], cell_data={name: [tags]}).write(path)
        np.testing.assert_array_equal(read(path)[0].region, tags)
