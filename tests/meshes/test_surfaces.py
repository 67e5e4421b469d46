"""Closed surfaces come in from other programs, are repaired or refused, and leave for printers and viewers."""

import json
import struct
import sys
import warnings

import meshio
import numpy as np
import pytest
from support.ball_surfaces import ball

import palpate as pp
from palpate.commands import main
from palpate.errors import DataError, FileError, MeshError

AXES = np.array([30.0, 22.0, 18.0])
CENTRE = np.array([12.0, -40.0, 105.0])


def ellipsoid():
    points, faces = ball()
    return points * AXES + CENTRE, faces


VOLUME = 4 / 3 * np.pi * AXES.prod()


def saved(path, points, faces):
    if path.suffix == ".obj":
        lines = [f"v {x} {y} {z}" for x, y, z in points] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
        path.write_text("\n".join(lines) + "\n")
    else:
        meshio.Mesh(points, [("triangle", faces)]).write(path, binary=path.stem != "text")
    return path


def read(path, **options):
    """Labels and what was said."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        labels = pp.read_surfaces(path, **options)
    return labels, [str(w.message) for w in said]


def volume(labels, value=1):
    return np.count_nonzero(labels.values == value) * labels.grid.voxel_volume


@pytest.mark.parametrize("name", ["organ.stl", "text.stl", "organ.ply", "text.ply", "organ.obj"])
def test_a_surface_becomes_the_label_that_it_encloses(tmp_path, name):
    labels, said = read(saved(tmp_path / name, *ellipsoid()), edge=4)
    assert said == []
    assert labels.names == {1: name[:-4]}
    centre = labels.grid.points(np.argwhere(labels.values == 1)).mean(axis=0)
    assert np.allclose(centre, CENTRE, atol=0.05)
    assert volume(labels) == pytest.approx(VOLUME, rel=0.01)
    points = labels.grid.points(np.argwhere(labels.values == 1))
    assert (np.linalg.norm((points - CENTRE) / AXES, axis=1) < 1.02).all()


def test_inside_does_not_depend_on_which_way_triangles_face(tmp_path):
    points, faces = ellipsoid()
    turned = faces.copy()
    turned[::3] = turned[::3, ::-1]
    a, _ = read(saved(tmp_path / "a.ply", points, faces))
    b, _ = read(saved(tmp_path / "b.ply", points, turned))
    assert np.array_equal(a.values, b.values)


def test_a_cube_on_round_coordinates_is_filled_to_the_voxel(tmp_path):
    """Columns through edges and diagonals would count a crossing twice."""
    corner = np.array([[x, y, z] for x in (0, 20.0) for y in (0, 20.0) for z in (0, 20.0)])
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
             [1, 5, 7], [1, 7, 3]]  # fmt: skip
    labels, _ = read(saved(tmp_path / "cube.ply", corner, np.array(faces)), edge=5)
    assert labels.grid.spacing == (1, 1, 1)
    assert np.count_nonzero(labels.values) == 20**3


def test_defects_are_repaired_with_a_word(tmp_path):
    points, faces = ellipsoid()
    whole, _ = read(saved(tmp_path / "whole.ply", points, faces))
    soup = points[faces].reshape(-1, 3)  # no triangle shares a point
    split = np.arange(len(soup)).reshape(-1, 3)
    bad = np.concatenate([split, split[:5], [[0, 0, 1], [3, 4, 4]]])
    labels, said = read(saved(tmp_path / "soup.ply", soup, bad))
    assert np.array_equal(labels.values, whole.values)
    assert any("2 triangles without area: dropped" in one for one in said), said
    assert any("5 triangles that are there twice: dropped" in one for one in said), said
    labels, said = read(saved(tmp_path / "hole.ply", points, np.delete(faces, [7, 200], axis=0)))
    assert any("2 holes, the widest " in one and "closed" in one for one in said), said
    assert np.count_nonzero(labels.values != whole.values) < 30


def test_a_wide_hole_is_refused_with_its_place(tmp_path):
    points, faces = ellipsoid()
    open_end = faces[(points[faces][:, :, 2] < CENTRE[2] + 12).all(axis=1)]
    path = saved(tmp_path / "cup.stl", points, open_end)
    with pytest.raises(MeshError, match=r"cup\.stl: not closed: a hole 4\d.* mm across near \[12\.\d, -40\.\d, 11\d"):
        pp.read_surfaces(path)


def test_shells_within_are_voids_and_shells_that_cross_are_joined(tmp_path):
    points, faces = ball(20.0)
    n = len(points)
    hollow = saved(tmp_path / "hollow.ply", np.concatenate([points, points / 2]), np.concatenate([faces, faces + n]))
    labels, said = read(hollow, edge=4)
    assert said == []
    assert volume(labels) == pytest.approx(4 / 3 * np.pi * (20**3 - 10**3), rel=0.01)
    two = np.concatenate([points, points + [20, 0, 0]])
    labels, said = read(saved(tmp_path / "two.ply", two, np.concatenate([faces, faces + n])), edge=4)
    assert any("1 of its 2 parts cross others: joined" in one for one in said), said
    lens = np.pi * (4 * 20 + 20) * (2 * 20 - 20) ** 2 / 12
    assert volume(labels) == pytest.approx(2 * 4 / 3 * np.pi * 20**3 - lens, rel=0.01)


def test_what_is_no_solid_is_refused(tmp_path):
    points, faces = ellipsoid()
    with pytest.raises(DataError, match=r"nan\.obj: points: 1 values are not finite"):
        pp.read_surfaces(
            saved(tmp_path / "nan.obj", np.where(np.arange(len(points))[:, None] == 3, [0, np.nan, 0], points), faces)
        )
    with pytest.raises(MeshError, match=r"far\.ply: nodes lie up to"):
        pp.read_surfaces(saved(tmp_path / "far.ply", points * 1e200, faces))
    with pytest.raises(MeshError, match=r"none\.ply: no triangles"):
        pp.read_surfaces(saved(tmp_path / "none.ply", points, np.empty((0, 3), int)))
    with pytest.raises(MeshError, match=r"index\.obj: a triangle names a point that is none"):
        pp.read_surfaces(saved(tmp_path / "index.obj", points, faces + len(points)))
    (tmp_path / "cut.ply").write_bytes(saved(tmp_path / "a.ply", points, faces).read_bytes()[:-500])
    (tmp_path / "head.ply").write_text("ply\nformat ascii 1.0\nelement vertex 99\n")
    (tmp_path / "text.obj").write_text("v 1 2\nf 1 2 x\n")
    for name in ("cut.ply", "head.ply", "text.obj", "gone.stl"):
        with pytest.raises(FileError, match=name):
            pp.read_surfaces(tmp_path / name)
    with pytest.raises(MeshError, match="edge: expected a positive length"):
        pp.read_surfaces(saved(tmp_path / "b.ply", points, faces), edge=0)


def palpate(monkeypatch, capsys, *words):
    monkeypatch.setattr(sys, "argv", ["palpate", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr()
    return ended.value.code or 0, said.out + said.err


def test_the_command_meshes_a_surface_with_one_inside(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    saved(tmp_path / "organ.stl", *ellipsoid())
    points, faces = ball(7.0)
    saved(tmp_path / "lump.obj", points + CENTRE + [8, 0, 0], faces)
    words = ["mesh", "organ.stl", "--inclusion", "lump.obj", "--edge", 5, "--fine", "lump=3", "-o", "both.vtu"]
    code, said = palpate(monkeypatch, capsys, *words)
    assert code == 0, said
    mesh = pp.read_mesh("both.vtu")
    assert mesh.names == {1: "organ", 2: "lump"}
    assert mesh.volumes.sum() == pytest.approx(VOLUME, rel=0.02)
    assert mesh.volumes[mesh.region == 2].sum() == pytest.approx(4 / 3 * np.pi * 7**3, rel=0.05)
    for name in ("both.stl", "both.ply", "both.obj", "both.glb", "both.msh"):  # and a mesh leaves in other forms
        code, said = palpate(monkeypatch, capsys, "mesh", "both.vtu", "-o", name)
        assert code == 0, said
    for name in ("both.stl", "both.ply", "both.obj", "both.glb"):
        back, said = read(tmp_path / name, edge=5)
        assert (back.names, said) == ({1: "both", 2: "lump"}, [])
        for label in (1, 2):
            assert volume(back, label) == pytest.approx(mesh.volumes[mesh.region == label].sum(), rel=0.03)
    words = ["mesh", "both.stl", "--edge", 5, "--fine", "lump=3", "-o", "again.vtu"]
    code, said = palpate(monkeypatch, capsys, *words)
    assert code == 0, said
    again = pp.read_mesh("again.vtu")
    assert again.names == {1: "both", 2: "lump"}
    assert again.volumes[again.region == 2].sum() == pytest.approx(4 / 3 * np.pi * 7**3, rel=0.06)


def solids(path, *surfaces):
    """A text STL as other programs write it."""
    lines = []
    for name, points, faces in surfaces:
        lines.append(f"solid {name}".rstrip())
        for corners in points[faces]:
            lines += ["facet normal 0 0 0", "outer loop", *("vertex {} {} {}".format(*p) for p in corners)]
            lines += ["endloop", "endfacet"]
        lines.append(f"endsolid {name}".rstrip())
    path.write_text("\n".join(lines) + "\n")
    return path


def test_solids_in_one_file_are_an_organ_and_its_inclusions_in_any_order(tmp_path):
    points, faces = ball(20.0)
    lump, other = (points / 4 + [8, 0, 0], faces), (points / 4 - [8, 0, 0], faces)
    path = solids(tmp_path / "organ.stl", ("lump", *lump), ("skin", points, faces), ("", *other))
    labels, said = read(path, edge=5)
    assert said == []
    assert labels.names == {1: "organ", 2: "lump", 3: "organ 3"}
    for label in (2, 3):
        assert volume(labels, label) == pytest.approx(4 / 3 * np.pi * 5**3, rel=0.03)
    assert np.count_nonzero(labels.values) * labels.grid.voxel_volume == pytest.approx(4 / 3 * np.pi * 20**3, rel=0.01)
    places = [np.argwhere(labels.values == label).mean(axis=0)[2] for label in (2, 3)]
    assert places[0] > places[1]  # the lump lies at positive x


def test_no_solid_is_lost_to_a_name_that_another_has(tmp_path):
    points, faces = ball(20.0)
    at = [[0, 0, 0], [9, 0, 0], [-9, 0, 0], [0, 9, 0], [0, -9, 0]]
    names = ("a", "a 3", "a", "a", "organ")
    every = [
        (name, points / (6 if k else 1) + centre, faces) for k, (name, centre) in enumerate(zip(names, at, strict=True))
    ]
    labels, said = read(solids(tmp_path / "organ.stl", *every), edge=5)
    assert said == []
    assert sorted(labels.names) == [1, 2, 3, 4, 5]
    assert len(set(labels.names.values())) == 5
    assert labels.names[1] == "organ"
    assert all(np.count_nonzero(labels.values == label) for label in labels.names)


def test_a_solid_outside_is_joined_with_a_word_and_open_ones_are_one_surface(tmp_path):
    points, faces = ball(20.0)
    path = solids(tmp_path / "pair.stl", ("organ", points, faces), ("beside", points / 4 + [24, 0, 0], faces))
    labels, said = read(path, edge=5)
    assert labels.names == {1: "pair"}
    assert any("beside lies outside pair: joined" in one for one in said), said
    half = points[faces].mean(axis=1)[:, 2] > 0
    path = solids(tmp_path / "halves.stl", ("upper", points, faces[half]), ("lower", points, faces[~half]))
    labels, said = read(path, edge=5)
    assert (labels.names, said) == ({1: "halves"}, [])
    assert volume(labels) == pytest.approx(4 / 3 * np.pi * 20**3, rel=0.01)


# --- out -------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def mesh():
    place = np.moveaxis(np.indices((24, 24, 24)), 0, -1) - 11.5
    values = 1 * (np.linalg.norm(place, axis=-1) < 10) + (np.linalg.norm(place - [2, 0, 0], axis=-1) < 4)
    labels = pp.Labels(values, pp.Grid(values.shape, (1, 1, 1), (5, -7, 50)), {1: "organ", 2: "a lump"})
    return pp.tetrahedralize(labels, 1, 3, inclusions=[2])


def enclosed(points, faces):
    """Volume by the divergence theorem; positive if normals point outwards."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    return np.einsum("ij,ij->i", np.cross(a, b), c).sum() / 6


def test_stl_has_a_solid_for_each_region(tmp_path, mesh):
    pp.write_mesh(tmp_path / "m.stl", mesh)
    text = (tmp_path / "m.stl").read_text()
    parts = text.split("endsolid")
    assert [line for line in text.splitlines() if line.startswith("solid")] == ["solid organ", "solid a lump"]
    for part, wanted in zip(parts, (mesh.volumes.sum(), mesh.volumes[mesh.region == 2].sum()), strict=False):
        x = np.array([[float(w) for w in line.split()[1:]] for line in part.splitlines() if "vertex" in line])
        assert enclosed(x, np.arange(len(x)).reshape(-1, 3)) == pytest.approx(wanted, rel=1e-5)
    assert enclosed(*(lambda m: (m.points, m.cells[0].data))(meshio.read(tmp_path / "m.stl"))) > 0


def test_ply_has_the_label_of_each_face(tmp_path, mesh):
    pp.write_mesh(tmp_path / "m.ply", mesh)
    head, body = (tmp_path / "m.ply").read_bytes().split(b"end_header\n")
    assert b"comment region 2: a lump\n" in head
    points, faces = (int(head.split(f"element {name} ".encode())[1].split()[0]) for name in ("vertex", "face"))
    x = np.frombuffer(body, "<f8", 3 * points).reshape(-1, 3)
    rows = np.frombuffer(body, [("n", "u1"), ("nodes", "<i4", 3), ("region", "<i4")], faces, x.nbytes)
    assert x.nbytes + rows.nbytes == len(body)
    assert (rows["n"] == 3).all()
    for label, wanted in ((1, mesh.volumes.sum()), (2, mesh.volumes[mesh.region == 2].sum())):
        assert enclosed(x, rows["nodes"][rows["region"] == label]) == pytest.approx(wanted, rel=1e-9)


def test_ply_of_other_writers_is_read(tmp_path):
    """Other names, properties before and after the corners, quadrilaterals, either order of bytes."""
    corner = [(x, y, z) for x in (0, 20.0) for y in (0, 20.0) for z in (0, 20.0)]
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    head = (
        "ply\r\nformat {} 1.0\r\ncomment x\r\nelement vertex 8\r\nproperty float x\r\nproperty uchar red\r\n"
        "property float y\r\nproperty float z\r\nelement face 6\r\nproperty short flags\r\n"
        "property list uchar uint vertex_index\r\nproperty float quality\r\nend_header\r\n"
    )
    text = "".join(f"{x} 9 {y} {z}\n" for x, y, z in corner)
    text += "".join(f"-1 4 {' '.join(map(str, side))} 0.5\n" for side in sides)
    (tmp_path / "text.ply").write_bytes(head.format("ascii").encode() + text.encode())
    for name, order in (("binary_little_endian", "<"), ("binary_big_endian", ">")):
        data = b"".join(struct.pack(order + "fBff", x, 9, y, z) for x, y, z in corner)
        data += b"".join(struct.pack(order + "hB4If", -1, 4, *side, 0.5) for side in sides)
        (tmp_path / f"{name}.ply").write_bytes(head.format(name).encode() + data)
    for name in ("text", "binary_little_endian", "binary_big_endian"):
        labels, said = read(tmp_path / f"{name}.ply", edge=5)
        assert said == []
        assert np.count_nonzero(labels.values) == 20**3


def test_gltf_has_a_mesh_for_each_region_in_metres_upright(tmp_path, mesh):
    pp.write_mesh(tmp_path / "m.glb", mesh)
    data = (tmp_path / "m.glb").read_bytes()
    magic, version, length = struct.unpack_from("<4s2I", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    said, body = json.loads(data[20 : 20 + size]), data[28 + size :]
    assert kind == b"JSON"
    assert struct.unpack_from("<I4s", data, 20 + size) == (len(body), b"BIN\0")
    assert [node["name"] for node in said["nodes"][:2]] == ["organ", "a lump"]
    root = said["nodes"][said["scenes"][0]["nodes"][0]]
    matrix = np.array(root["matrix"]).reshape(4, 4).T
    assert np.allclose(matrix @ [0, 0, 1000, 1], [0, 1, 0, 1])  # the head is up
    assert np.allclose(matrix @ [0, -1000, 0, 1], [0, 0, 1, 1])  # the front is towards the viewer
    assert np.allclose(matrix @ [1000, 0, 0, 1], [1, 0, 0, 1])

    def values(number, kind):
        one = said["accessors"][number]
        view = said["bufferViews"][one["bufferView"]]
        return np.frombuffer(body[view["byteOffset"] : view["byteOffset"] + view["byteLength"]], kind)

    for part, wanted in zip(said["meshes"], (mesh.volumes.sum(), mesh.volumes[mesh.region == 2].sum()), strict=True):
        primitive = part["primitives"][0]
        points = values(primitive["attributes"]["POSITION"], "<f4").reshape(-1, 3).astype(float)
        bounds = said["accessors"][primitive["attributes"]["POSITION"]]
        assert np.allclose([bounds["min"], bounds["max"]], [points.min(axis=0), points.max(axis=0)])
        assert enclosed(points, values(primitive["indices"], "<u4").reshape(-1, 3)) == pytest.approx(wanted, rel=1e-4)


def test_a_surface_holds_no_fields(tmp_path, mesh):
    with pytest.raises(MeshError, match=r"m\.ply: fields height: a surface holds none"):
        pp.write_mesh(tmp_path / "m.ply", mesh, {"height": mesh.nodes[:, 2]})
    assert not (tmp_path / "m.ply").exists()
