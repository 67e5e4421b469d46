"""glTF files: nodes with their transforms, all that a file may hold, and files that lie."""

import copy

import numpy as np
import pytest
from support.ball_surfaces import Gltf, packed
from support.nested_balls import check_balls, gltf_balls, read, volume

import palpate as pp
from palpate.errors import DataError, FileError, MeshError


@pytest.mark.parametrize("name", ["organ.glb", "organ.gltf", "organ beside.gltf"])
def test_nodes_of_gltf_are_moved_scaled_and_named(tmp_path, name):
    check_balls(*read(gltf_balls().save(tmp_path / name), edge=4), name.rpartition(".")[0])


def test_transforms_of_gltf_follow_each_other(tmp_path):
    """A matrix above, then translation, rotation and scale, in this order: of a box, whose sides tell."""
    turn = np.array([[0, 0, 2.0], [2, 0, 0], [0, 2, 0]])
    check_balls(*read(gltf_balls(0.5 * turn).save(tmp_path / "turned.glb"), edge=4), "turned")
    made = Gltf()
    corner = np.array([[x, y, z] for x in (0, 1.0) for y in (0, 1.0) for z in (0, 1.0)])
    sides = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
    mesh = made.mesh(made.primitive(corner, np.concatenate([sides[:, :3], sides[:, [0, 2, 3]]])))
    half = np.sqrt(0.5)
    box = made.node(
        False, mesh=mesh, scale=[0.01, 0.02, 0.03], rotation=[0, 0, half, half], translation=[0.1, 0.2, 0.3]
    )
    made.node(children=[box], matrix=(np.diag([2.0, 2, 2, 1]) @ turned_about_x()).T.ravel().tolist())
    labels, said = read(made.save(tmp_path / "box.glb"), edge=4)
    points = labels.grid.points(np.argwhere(labels.values == 1))
    # The quarter turn about z takes x to y and y to -x, the one about x y to z and z to -y. Then y is up, z in front.
    low, high = np.array([160, -420, -660]), np.array([200, -400, -600])
    assert said == []
    assert np.allclose([points.min(axis=0), points.max(axis=0)], [low, high], atol=0.81)
    assert volume(labels, 1) == pytest.approx(np.prod(high - low), rel=0.05)


def turned_about_x():
    return np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


def test_all_ways_to_draw_triangles_and_types_of_numbers(tmp_path):
    """The corners of a tetrahedron as a strip, as a fan and a triangle, without indices, and in rows with a stride."""
    corner = np.array([[0, 0, 0], [0.04, 0, 0], [0, 0.04, 0], [0, 0, 0.04]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 2, 3]])
    strip, fan, soup, rows = (Gltf() for _ in range(4))
    place = strip.numbers(corner.astype("<f4"), 5126, "VEC3")
    short = strip.numbers(np.array([0, 1, 2, 3, 0, 1], "<u2"), 5123, "SCALAR")
    strip.mesh({"attributes": {"POSITION": place}, "indices": short, "mode": 5})
    place = fan.numbers(corner.astype("<f4"), 5126, "VEC3")
    byte = fan.numbers(np.array([0, 1, 2, 3, 1], "u1"), 5121, "SCALAR")
    last = fan.numbers(np.array([1, 2, 3], "u1"), 5121, "SCALAR")
    kinds = ({"indices": byte, "mode": 6}, {"indices": last}, {"mode": 1}, {"mode": 0})
    fan.mesh(*({"attributes": {"POSITION": place}, **kind} for kind in kinds))
    soup.mesh({"attributes": {"POSITION": soup.numbers(corner[faces].reshape(-1, 3).astype("<f4"), 5126, "VEC3")}})
    primitive = rows.primitive(corner, faces)
    both = np.column_stack([corner, corner + 9]).astype("<f4")  # positions and normals by turns
    primitive["attributes"]["POSITION"] = rows.numbers(both, 5126, "VEC3")
    rows.said["bufferViews"][-1]["byteStride"] = 24
    rows.mesh(primitive)
    for name, made in (("strip", strip), ("fan", fan), ("soup", soup), ("rows", rows)):
        made.node(mesh=0)
        labels, _ = read(made.save(tmp_path / f"{name}.glb"), edge=4)
        assert labels.names == {1: name}
        assert volume(labels, 1) == pytest.approx(40**3 / 6, rel=0.05), name


def refused(path, made, kind, match):
    made.save(path)
    with pytest.raises(kind, match=rf"{path.name}: .*{match}"):
        pp.read_surfaces(path)


def test_gltf_that_cannot_be_is_refused(tmp_path):
    path, whole = tmp_path / "organ.glb", gltf_balls()

    def changed(change):
        other = copy.deepcopy(whole)
        change(other.said)
        return other

    for change, kind, match in (
        (lambda said: said["nodes"][0].update(children=[2]), FileError, "node . is below two nodes, or below itself"),
        (lambda said: said["nodes"][2].update(children=[0, 0]), FileError, "below two nodes"),
        (lambda said: said["nodes"][2].update(children=[-1]), FileError, "nodes: none has the number -1"),
        (lambda said: said["nodes"][1].update(mesh=7), FileError, "meshes: none has the number 7"),
        (lambda said: said["nodes"][1].update(skin=0), FileError, "has a skin"),
        (lambda said: said["nodes"][2].update(scale=[0, 0, 0]), MeshError, "all triangles are without area"),
        (lambda said: said["nodes"][1].update(translation=[float("nan"), 0, 0]), DataError, "not finite"),
        (lambda said: said["nodes"][1].update(matrix=[1] * 16), FileError, "no affine transform"),
        (lambda said: said["nodes"][2].update(translation=[1e9, 0, 0]), MeshError, "nodes lie up to"),
        (lambda said: said["accessors"][0].update(count=2**40), FileError, "says 1099511627776 values"),
        (lambda said: said["accessors"][1].update(count=2**40), FileError, "corners of triangles are shown"),
        (lambda said: said["accessors"][1].update(count=-3), FileError, "count: expected a number"),
        (lambda said: said["accessors"][0].update(count=5), FileError, "a triangle names point"),
        (lambda said: said["bufferViews"][1].update(byteLength=2**31), FileError, "a view of bytes .* in a buffer of"),
        (lambda said: said.update(extensionsRequired=["KHR_draco_mesh_compression"]), FileError, "it needs KHR_draco"),
        (lambda said: said.update(asset={"version": "1.0"}), FileError, "not glTF of version 2"),
        (lambda said: said["scenes"][0].update(nodes=[]), MeshError, "no triangles"),
        (lambda said: said["nodes"].extend([{}] * 100_000), FileError, "100003 nodes"),
    ):
        refused(path, changed(change), kind, match)


def test_a_node_that_is_flat_is_left_out_with_a_word(tmp_path):
    made = gltf_balls()
    made.said["nodes"][0]["scale"] = [0, 0, 0]
    labels, said = read(made.save(tmp_path / "organ.glb"), edge=4)
    assert labels.names == {1: "organ"}
    assert any("triangles without area: dropped" in one for one in said), said


def test_a_gltf_reads_no_file_that_is_not_beside_it(tmp_path):
    (tmp_path / "below").mkdir()
    made = gltf_balls()
    made.save(tmp_path / "beside.gltf")
    text = (tmp_path / "beside.gltf").read_text()
    for uri in (
        "../its%20bytes.bin",
        "%2e%2e/its%20bytes.bin",
        str(tmp_path / "its%20bytes.bin"),
        "file:its%20bytes.bin",
        "https://example.org/a.bin",
    ):
        (tmp_path / "below" / "beside.gltf").write_text(text.replace("its%20bytes.bin", uri))
        with pytest.raises(FileError, match=r"below/beside\.gltf: .*no file beside or below it"):
            pp.read_surfaces(tmp_path / "below" / "beside.gltf")
    (tmp_path / "below" / "beside.gltf").write_text(text)
    with pytest.raises(FileError, match=r"below/beside\.gltf: .*its buffer is missing"):
        pp.read_surfaces(tmp_path / "below" / "beside.gltf")


def test_glb_that_ends_too_early_or_says_more_than_it_holds_is_refused(tmp_path):
    path = gltf_balls().save(tmp_path / "organ.glb")
    data = path.read_bytes()
    for spoilt in (
        b"",
        data[:11],
        data[:40],
        data[:-100],
        packed((b"BIN\0", b"")),
        packed(length=2**32 - 1),
        b"x" * 99,
    ):
        path.write_bytes(spoilt)
        with pytest.raises(FileError, match=r"organ\.glb: cannot be read as a \.glb surface"):
            pp.read_surfaces(path)
