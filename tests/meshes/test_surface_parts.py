"""Objects and groups of OBJ files, and nodes of glTF files, come in as an organ and its inclusions."""

import numpy as np
import pytest
from support.ball_surfaces import Gltf, save_obj
from support.nested_balls import (
    BESIDE,
    CENTRE,
    FACES,
    FLAWLESS,
    ORGAN,
    POINTS,
    TO_GLTF,
    check_balls,
    nested,
    read,
    volume,
)

import palpate as pp
from palpate.errors import MeshError


@pytest.mark.parametrize("word", ["g", "o"])
def test_groups_and_objects_of_obj_are_an_organ_and_its_inclusions(tmp_path, word):
    check_balls(*read(save_obj(tmp_path / "organ.obj", *nested(), word=word), edge=4), "organ")


def test_pieces_that_meet_at_open_edges_are_one_solid(tmp_path):
    """An object of two materials is one; a small one too, whose open pieces would pass for repaired ones."""
    (_, lump, _), (_, skin, _) = nested()
    upper = POINTS[FACES].mean(axis=1)[:, 2] > 0
    names = ("o skin\ng skin_red", "g skin_blue", "o lump\ng lump_red", "g lump_blue")
    halves = ((skin, FACES[upper]), (skin, FACES[~upper]), (lump, FACES[upper]), (lump, FACES[~upper]))
    path = save_obj(tmp_path / "organ.obj", *((n, *half) for n, half in zip(names, halves, strict=True)), word="")
    check_balls(*read(path, edge=4), "organ")
    coarse, said = read(path, edge=8)  # holes up to 16 mm are closed, and a half of the lump is 14 mm across
    assert (coarse.names, said) == ({1: "organ", 2: "lump"}, [])
    assert volume(coarse, 2) == pytest.approx(FLAWLESS * 7**3, rel=0.05)
    made = Gltf()
    made.said["materials"] = [{"name": "red"}, {"name": "blue"}]
    for name, points in (("skin", skin), ("lump", lump)):
        halves = [made.primitive(points @ TO_GLTF.T, FACES[side], material=k) for k, side in enumerate((upper, ~upper))]
        made.node(mesh=made.mesh(*halves, name=name))
    check_balls(*read(made.save(tmp_path / "organ.glb"), edge=4), "organ")


def test_names_are_those_of_objects_else_those_of_groups(tmp_path):
    (_, lump, _), (_, skin, _) = nested()
    every = ("o body\ng skin", skin, FACES), ("g lump", lump, FACES)
    assert read(save_obj(tmp_path / "a.obj", *every, word=""))[0].names == {1: "a", 2: "lump"}
    every = ("g all\no skin", skin, FACES), ("o lump", lump, FACES)
    assert read(save_obj(tmp_path / "b.obj", *every, word=""))[0].names == {1: "b", 2: "lump"}
    every = ("", skin, FACES), ("o \x1b[31mlump\x07\t 2 ", lump, FACES)
    assert read(save_obj(tmp_path / "c.obj", *every, word=""))[0].names == {1: "c", 2: "[31mlump 2"}


def test_nothing_is_lost_to_a_name_that_another_has(tmp_path):
    at = [np.zeros(3), *(9.0 * np.eye(3)), -9.0 * np.eye(3)[0]]
    names = ("a", "a 3", "a", "", "organ")
    every = [
        (name, POINTS * (4 if k else ORGAN) + centre, FACES)
        for k, (name, centre) in enumerate(zip(names, at, strict=True))
    ]
    made = Gltf()
    for name, points, faces in every:
        made.node(name=name, mesh=made.mesh(made.primitive(points @ TO_GLTF.T, faces)))
    (tmp_path / "groups").mkdir()
    paths = [save_obj(tmp_path / "groups" / "organ.obj", *every), save_obj(tmp_path / "organ.obj", *every, word="o")]
    paths.append(made.save(tmp_path / "organ.glb"))
    for path in paths:
        labels, said = read(path, edge=4)
        assert said == []
        assert len(set(labels.names.values())) == len(labels.names) == 5
        for label in range(2, 6):
            assert volume(labels, label) == pytest.approx(FLAWLESS * 4**3, rel=0.03)


def test_obj_of_other_writers_is_read(tmp_path):
    """Corners counted from the end, with texture and normals, quadrilaterals, lines that go on, points with colours."""
    corner = [(x, y, z) for x in (0, 20.0) for y in (0, 20.0) for z in (0, 20.0)]
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    lines = ["# a cube", "mtllib x.mtl", "", *(f"v {x} {y} \\\n {z} 0.5 0.5 0.5" for x, y, z in corner), "vt 0 0"]
    lines += [
        "vn 0 0 1",
        "usemtl y",
        "s off",
        "l 1 2",
        *(f"f {' '.join(f'{k - 8}/1/1' for k in side)}" for side in sides),
    ]
    (tmp_path / "cube.obj").write_bytes("\r\n".join(lines).encode())
    labels, said = read(tmp_path / "cube.obj", edge=5)
    assert said == []
    assert np.count_nonzero(labels.values) == 20**3


def test_a_part_that_is_open_is_refused_by_its_name(tmp_path):
    (_, lump, _), (_, skin, _) = nested()
    cup = FACES[(lump[FACES][:, :, 2] < (CENTRE + BESIDE)[2] + 3).all(axis=1)]
    made = Gltf()
    for name, points, faces in (("skin", skin, FACES), ("lump", lump, cup)):
        made.node(name=name, mesh=made.mesh(made.primitive(points @ TO_GLTF.T, faces)))
    paths = [
        save_obj(tmp_path / "organ.obj", ("skin", skin, FACES), ("lump", lump, cup)),
        made.save(tmp_path / "o.glb"),
    ]
    for path in paths:
        with pytest.raises(
            MeshError, match=rf"{path.name}: lump: not closed: a hole 1\d.* mm across near \[18\.\d, -37"
        ):
            pp.read_surfaces(path)


@pytest.mark.parametrize("suffix", [".stl", ".ply", ".obj", ".glb"])
def test_a_mesh_with_inclusions_is_the_same_regions_again(tmp_path, suffix):
    """Names with spaces and letters beyond ASCII, and a core within the lump."""
    place = np.moveaxis(np.indices((30, 30, 30)), 0, -1) - 14.5
    values = 1 * (np.linalg.norm(place, axis=-1) < 13) + (np.linalg.norm(place - [3, 0, 0], axis=-1) < 6)
    values += np.linalg.norm(place - [3, 0, 0], axis=-1) < 3
    values[np.linalg.norm(place + [7, 0, 0], axis=-1) < 3.5] = 4
    names = {1: "organ", 2: "a lump", 3: "Kern, größer", 4: "cyst"}
    mesh = pp.tetrahedralize(
        pp.Labels(values, pp.Grid(values.shape, (1, 1, 1), (5, -7, 50)), names), 1, 2, inclusions=[2, 3, 4]
    )
    pp.write_mesh(tmp_path / f"organ{suffix}", mesh)
    back, said = read(tmp_path / f"organ{suffix}", edge=2)
    assert said == []
    assert sorted(back.names.values()) == sorted(names.values())
    for label, name in back.names.items():
        (number,) = [n for n, given in names.items() if given == name]
        assert volume(back, label) == pytest.approx(mesh.volumes[mesh.region == number].sum(), rel=0.04), name
