"""Meshes on disk: what others read is what we have, and what others write is understood or refused."""

import meshio
import numpy as np
import pytest

import palpate as pp
from palpate.errors import FileError, MeshError


@pytest.fixture(scope="module")
def mesh():
    grid = pp.Grid((20, 20, 20), (1, 1, 1), (-30.25, 12, 7))
    points = np.argwhere(np.ones(grid.shape)) - 9.5
    radius = np.linalg.norm(points, axis=1).reshape(grid.shape)
    labels = pp.Labels((radius < 8) * 1 + (radius < 4) * 6, grid, {1: "organ", 7: 'a <lump> & "more"'})
    return pp.tetrahedralize(labels, 1, 2.5, inclusions=[7])


@pytest.mark.parametrize("suffix", [".vtu", ".msh"])
def test_written_files_open_in_meshio(mesh, tmp_path, suffix):
    path = tmp_path / f"mesh{suffix}"
    field = np.linalg.norm(mesh.nodes, axis=1)
    quality = np.arange(len(mesh.tets), dtype=np.float64)
    pp.write_mesh(path, mesh, {"far": field, "displacement": mesh.nodes * 2}, {"number": quality})
    assert [p.name for p in tmp_path.iterdir()] == [path.name]  # nothing temporary stays
    other = meshio.read(path)
    np.testing.assert_array_equal(other.points, mesh.nodes)
    assert [block.type for block in other.cells] == ["tetra"]
    np.testing.assert_array_equal(other.cells[0].data, mesh.tets)
    region = other.cell_data["region" if suffix == ".vtu" else "gmsh:physical"][0]
    np.testing.assert_array_equal(region, mesh.region)
    np.testing.assert_array_equal(other.point_data["far"], field)
    np.testing.assert_array_equal(other.point_data["displacement"], mesh.nodes * 2)
    np.testing.assert_array_equal(other.cell_data["number"][0], quality)


@pytest.mark.parametrize("suffix", [".vtu", ".msh"])
def test_round_trip(mesh, tmp_path, suffix):
    path = tmp_path / f"mesh{suffix}"
    pp.write_mesh(path, mesh)
    back = pp.read_mesh(path)
    np.testing.assert_array_equal(back.nodes, mesh.nodes)
    np.testing.assert_array_equal(back.tets, mesh.tets)
    np.testing.assert_array_equal(back.region, mesh.region)
    assert back.names[1] == "organ"
    assert back.names[7] == (mesh.names[7] if suffix == ".vtu" else mesh.names[7].replace('"', "'"))


def test_written_twice_is_the_same_file(mesh, tmp_path):
    for suffix in (".vtu", ".msh"):
        for name in ("a", "b"):
            pp.write_mesh(tmp_path / (name + suffix), mesh)
        assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


@pytest.mark.parametrize(("form", "binary"), [("gmsh", True), ("gmsh", False), ("gmsh22", True), ("gmsh40", True)])
def test_gmsh_files_that_others_write(mesh, tmp_path, form, binary):
    path = tmp_path / "other.msh"
    tags = [mesh.region.astype(np.int32)]
    data = {"gmsh:physical": tags, "gmsh:geometrical": tags} if form == "gmsh22" else {}
    stored = meshio.Mesh(mesh.nodes, [("tetra", mesh.tets)], cell_data=data)
    if form == "gmsh40":
        meshio.gmsh.write(path, stored, fmt_version="4.0", binary=binary)
    else:
        stored.write(path, file_format=form, binary=binary)
    back = pp.read_mesh(path)
    np.testing.assert_allclose(back.nodes, mesh.nodes, rtol=1e-14)
    np.testing.assert_array_equal(back.tets, mesh.tets)
    if data:
        np.testing.assert_array_equal(back.region, mesh.region)


GMSH_1 = """$NOD
5
10 0 0 0
20 1 0 0
30 0 1 0
40 0 0 1
50 1 1 1
$ENDNOD
$ELM
3
1 2 9 9 3 10 20 30
2 4 5 1 4 10 20 30 40
3 4 6 1 4 20 30 40 50
$ENDELM
"""


def test_gmsh_1(tmp_path):
    path = tmp_path / "old.msh"
    path.write_text(GMSH_1)
    mesh = pp.read_mesh(path)
    assert mesh.tets.tolist() == [[0, 1, 2, 3], [1, 2, 3, 4]]
    assert mesh.region.tolist() == [5, 6]
    assert mesh.volumes == pytest.approx([1 / 6, 1 / 3])
    path.write_text(GMSH_1[:-25])
    with pytest.raises(FileError, match=r"old\.msh: cannot be read .*it ends too early.*write it again"):
        pp.read_mesh(path)


def test_inverted_tets_are_turned_and_said(mesh, tmp_path):
    path = tmp_path / "inverted.vtu"
    tets = mesh.tets.copy()
    tets[[3, 8]] = tets[[3, 8]][:, [1, 0, 2, 3]]
    meshio.Mesh(mesh.nodes, [("tetra", tets)]).write(path)
    with pytest.warns(UserWarning, match=rf"inverted\.vtu: 2 of {len(tets)} tets were inverted: turned"):
        back = pp.read_mesh(path)
    assert back.volumes == pytest.approx(mesh.volumes)


def test_spare_nodes_and_triangles_are_dropped_and_said(mesh, tmp_path):
    path = tmp_path / "spare.vtu"
    nodes = np.concatenate([[[500, 500, 500]], mesh.nodes])
    meshio.Mesh(nodes, [("triangle", mesh.surface + 1), ("tetra", mesh.tets + 1)]).write(path)
    with pytest.warns(UserWarning, match="1 nodes belong to no tet: dropped"):
        back = pp.read_mesh(path)
    np.testing.assert_array_equal(back.nodes, mesh.nodes)
    np.testing.assert_array_equal(back.tets, mesh.tets)


def refused(path, error, *words):
    with pytest.raises(error) as refusal:
        pp.read_mesh(path)
    for word in (path.name, *words):
        assert word in str(refusal.value), str(refusal.value)


def test_files_that_are_no_solid_are_refused(mesh, tmp_path):
    path = tmp_path / "bad.vtu"
    meshio.Mesh(mesh.nodes, [("triangle", mesh.surface)]).write(path)
    refused(path, MeshError, "no tetrahedra", "triangle", "mesh the solid")
    flat = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]])
    meshio.Mesh(flat, [("tetra", [[0, 1, 2, 3]])]).write(path)
    refused(path, MeshError, "1 flat tets", "tet 0", "remove them or mesh again")
    cube = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, 0], [0, 0, -1.0]])
    meshio.Mesh(cube, [("tetra", [[0, 1, 2, 3], [0, 1, 4, 5]])]).write(path)
    refused(path, MeshError, "not a 2-manifold", "1 edges", "split the mesh")
    meshio.Mesh(cube[:4], [("tetra", [[0, 1, 2, 3], [0, 1, 2, 3], [0, 1, 2, 3]])]).write(path)
    refused(path, MeshError, "there twice", "remove them")
    meshio.Mesh(cube[:4], [("tetra", [[0, 1, 2, 9]])]).write(path)
    refused(path, MeshError, "[0, 1, 2, 9]", "0 to 3", "write it again")
    meshio.Mesh(cube[:4] * np.nan, [("tetra", [[0, 1, 2, 3]])]).write(path)
    with pytest.raises(ValueError, match=r"bad\.vtu.*not finite"):
        pp.read_mesh(path)


@pytest.mark.parametrize("suffix", [".vtu", ".msh"])
@pytest.mark.parametrize("part", [0, 0.3, 0.6, 0.9, 0.999])
def test_truncated_files_are_refused_without_ending_the_program(mesh, tmp_path, capsys, suffix, part):
    path = tmp_path / f"whole{suffix}"
    pp.write_mesh(path, mesh)
    data = path.read_bytes()
    cut = tmp_path / f"cut{suffix}"
    cut.write_bytes(data[: int(part * len(data))])
    refused(cut, FileError, "cannot be read", "truncated", "write it again")
    assert capsys.readouterr() == ("", "")


def test_missing_and_foreign_files(mesh, tmp_path):
    refused(tmp_path / "none.vtu", FileError, "no such file", "check the name")
    refused(tmp_path / "mesh.stl", FileError, "cannot tell the format", ".vtu, .msh")
    noise = tmp_path / "noise.msh"
    noise.write_bytes(bytes(range(256)) * 8)
    refused(noise, FileError, "cannot be read")
    with pytest.raises(FileError, match=r"mesh\.xyz: cannot tell the format"):
        pp.write_mesh(tmp_path / "mesh.xyz", mesh)
    with pytest.raises(FileError, match=r"folder .*none does not exist; make it first"):
        pp.write_mesh(tmp_path / "none" / "mesh.vtu", mesh)
    with pytest.raises(MeshError, match=r"node field 'u': expected \d+ rows of numbers, got \(3,\)"):
        pp.write_mesh(tmp_path / "mesh.vtu", mesh, {"u": [1, 2, 3]})
    assert [p.name for p in tmp_path.iterdir()] == ["noise.msh"]
