"""A mesh of each organ of a label map, and the scene that one begins with."""

import json

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import palpate as pp
from palpate.commands import app
from palpate.errors import DataError, FileError
from palpate.meshes.mesh_labels import LabelMesh
from palpate.tissue.scene_file import scene_text

BALL = 4 / 3 * np.pi * 20**3  # mm³


def label_map():
    """Two balls of 20 mm radius that touch, and a speck."""
    z, y, x = np.mgrid[:24, :24, :44] * 2.0
    values = np.zeros(z.shape, dtype=int)
    for value, middle in ((3, 23.0), (7, 63.0)):
        values[(x - middle) ** 2 + (y - 23) ** 2 + (z - 23) ** 2 < 20**2] = value
    values[0, 0, 0] = 9
    return values


@pytest.fixture
def labels():
    names = {3: "liver", 7: "../Kidney (left)", 9: "speck"}
    return pp.Labels(label_map(), pp.Grid((24, 24, 44), (2, 2, 2)), names)


def test_each_label_is_meshed_by_itself(labels, tmp_path):
    made = pp.mesh_labels(labels, tmp_path / "made", edge=6)
    assert [(one.label, one.name) for one in made] == [(3, "liver"), (7, "../Kidney (left)"), (9, "speck")]
    for one in made[:2]:
        assert one.file.parent == tmp_path / "made"
        mesh = pp.read_mesh(one.file)
        assert (one.nodes, one.tets) == (len(mesh.nodes), len(mesh.tets))
        assert one.volume == pytest.approx(mesh.volumes.sum())
        assert one.volume == pytest.approx(BALL, rel=0.05)
    assert made[2].file is None
    assert made[2].problem
    assert sorted(file.name for file in (tmp_path / "made").iterdir()) == ["Kidney_left.vtu", "liver.vtu"]
    assert list(tmp_path.iterdir()) == [tmp_path / "made"]


@pytest.mark.parametrize("nodes", [400, 1500])
def test_without_an_edge_each_has_about_as_many_nodes(labels, tmp_path, nodes):
    for one in pp.mesh_labels(labels, tmp_path, nodes=nodes)[:2]:
        assert 0.5 * nodes < one.nodes < 2 * nodes


def test_labels_of_one_name_have_files_of_their_own(labels, tmp_path):
    same = pp.Labels(labels.values, labels.grid, {3: "Lung", 7: "lung", 9: "speck"})
    files = [one.file for one in pp.mesh_labels(same, tmp_path, edge=8)[:2]]
    assert len({str(file).lower() for file in files}) == 2
    assert all(file.exists() for file in files)


def test_what_cannot_be_meshed_is_refused_before_it_begins(labels, tmp_path):
    empty = pp.Labels(0 * labels.values, labels.grid)
    for given, options, words in (
        (empty, {}, "all of it is 0"),
        (labels, {"edge": -1}, "edge"),
        (labels, {"nodes": 0}, "nodes"),
    ):
        with pytest.raises(DataError, match=words):
            pp.mesh_labels(given, tmp_path / "new", **options)
    assert not (tmp_path / "new").exists()
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match="folder"):
        pp.mesh_labels(labels, tmp_path / "file")


def test_the_command_writes_a_scene_that_one_completes(labels, tmp_path):
    """The balls as liver, which the table knows, and stomach, which it does not, and as bones."""
    pp.write_labels(tmp_path / "labels.nii.gz", labels)
    words = {3: "liver", 7: "stomach", 9: "speck"}
    (tmp_path / "label_names.json").write_text(json.dumps(words))
    given = ["mesh", str(tmp_path / "labels.nii.gz"), "--all", "--edge", "9", "-o", str(tmp_path / "made")]
    run = CliRunner().invoke(app, given)
    assert run.exit_code == 0, run.output
    assert "wrote 2 of 3 labels" in run.output
    scene = tmp_path / "made" / "scene.yaml"
    with pytest.raises(DataError, match="give two organs"):
        pp.read_scene(scene)
    text = scene.read_text()
    scene.write_text(text.replace("# stomach: {young: ,", "stomach: {young: 5,"))
    assert set(pp.read_scene(scene).mesh.names.values()) == {"liver", "stomach"}
    complete = scene.read_text()
    assert CliRunner().invoke(app, given).exit_code == 0
    assert scene.read_text() == complete

    (tmp_path / "label_names.json").write_text(json.dumps(words | {7: "vertebrae_L1"}))
    other = [*given[:-1], str(tmp_path / "bones")]
    assert CliRunner().invoke(app, other).exit_code == 0
    assert "bones:\n  vertebrae_L1: {edge: 9}" in (tmp_path / "bones" / "scene.yaml").read_text()


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("liver", "organ"),
        ("Kidney_left", "organ"),
        ("lung_upper_lobe_right", "organ"),
        ("adrenal_gland_left", "unknown"),
        ("kidney_cyst_left", "unknown"),
        ("rib_left_7", "bone"),
        ("7", "unknown"),
        ("left: kidney # {1}", "unknown"),
        ("no", "unknown"),
    ],
)
def test_a_scene_says_no_more_of_an_organ_than_its_name(name, said, tmp_path):
    """Whatever the name is, the file can be read, and has it."""
    text = scene_text("a: b.nii", [LabelMesh(1, name, 4.0, tmp_path / "one.vtu")])
    found = yaml.safe_load(text.replace("# Say", "#Say").replace("  # ", "  "))
    assert found["labels"] == "a: b.nii"
    assert [*(found.get("bones" if said == "bone" else "organs") or {})] == [name]
    assert ("  # " in text) == (said == "unknown")


def test_a_label_without_a_name_has_its_number(labels, tmp_path):
    made = pp.mesh_labels(pp.Labels(labels.values, labels.grid), tmp_path, edge=9)
    assert [(one.name, one.file.name) for one in made[:2]] == [("3", "3.vtu"), ("7", "7.vtu")]
    assert pp.tetrahedralize(pp.Labels(labels.values, labels.grid), made[0].name, 9.0).tets.shape == (made[0].tets, 4)


def test_options_of_one_organ_are_refused(labels, tmp_path):
    pp.write_labels(tmp_path / "labels.nii.gz", labels)
    given = ["mesh", str(tmp_path / "labels.nii.gz"), "--all", "-o", str(tmp_path / "made")]
    run = CliRunner().invoke(app, [*given, "--label", "3"])
    assert run.exit_code == 2
    assert not (tmp_path / "made").exists()
