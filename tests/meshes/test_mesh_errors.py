"""What meshing refuses: the thing, the value and the way out are in the message, and no output is touched."""

import re

import numpy as np
import pytest
from typer.testing import CliRunner

import palpate as pp
from palpate.commands import app
from palpate.errors import DataError, FileError, MeshError, PalpateError


def ball(shape, centre, radius):
    place = np.moveaxis(np.indices(shape), 0, -1) - np.asarray(centre)
    return np.linalg.norm(place, axis=-1) < radius


def labels_of(values, spacing=(1, 1, 1), names=None):
    values = np.asarray(values).astype(int)
    return pp.Labels(values, pp.Grid(values.shape, spacing), names or {1: "organ", 2: "lump"})


ORGAN = labels_of(ball((30, 30, 30), (15, 15, 15), 11))


def refused(error, words, labels, label=1, edge=3.0, **options):
    with pytest.raises(error) as refusal:
        pp.tetrahedralize(labels, label, edge, **options)
    for word in words:
        assert word in str(refusal.value), str(refusal.value)
    return str(refusal.value)


def test_label_absent():
    refused(DataError, ["'spleen' is absent", "1 (organ)"], ORGAN, "spleen")
    refused(DataError, ["'lump' is absent", "1 (organ)"], ORGAN, inclusions=["lump"])


def test_empty_mask():
    refused(DataError, ["1 is absent", "labels present: none"], labels_of(np.zeros((5, 5, 5))))


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [0, 29])
def test_mask_touching_the_border(axis, side):
    centre = [15, 15, 15]
    centre[axis] = side
    labels = labels_of(ball((30, 30, 30), centre, 10))
    count = np.count_nonzero(np.take(labels.values, side, axis))
    layer = f"{'last' if side else 'first'} {'zyx'[axis]} layer"
    refused(
        DataError, ["'organ' touches the border", f"{count} voxels in the {layer}", "closed_at_border=True"], labels
    )


@pytest.mark.parametrize("edge", [0, -1, np.nan, np.inf])
def test_edges_that_are_no_length(edge):
    refused(MeshError, ["edge: expected a positive length", repr(edge)], ORGAN, edge=edge)


def way_out(message):
    return float(re.search(r"use an edge of ([\d.e+-]+) mm or (less|more)", message).group(1))


def test_edge_longer_than_the_organ_is_thick():
    message = refused(MeshError, ["edge 30 mm", "'organ'", "at its thickest"], ORGAN, edge=30)
    assert abs(pp.tetrahedralize(ORGAN, 1, way_out(message)).volumes.sum() / (4 / 3 * np.pi * 11**3) - 1) < 0.03


def test_edge_that_makes_too_many_tets():
    message = refused(MeshError, ["edge 0.05 mm", "million tets", "'organ'"], ORGAN, edge=0.05)
    # 12 tets a cube of 1.1 edges: the way out stays just within 5 million.
    assert 12 * ORGAN.values.sum() / (1.1 * way_out(message)) ** 3 == pytest.approx(5e6, rel=0.1)


def test_thin_parts_that_would_be_lost():
    values = ball((40, 60, 40), (20, 20, 20), 12)
    values[19:21, 30:55, 10:30] = True  # a sheet 2 mm thin, 1 ml of 8
    labels = labels_of(values)
    message = refused(
        MeshError,
        ["'organ' is thinner than elements of 6 mm", "most_lost is 5.0%"],
        labels,
        edge=6,
        finer_where_thin=False,
    )
    lost = float(re.search(r"([\d.]+)% of", message).group(1)) / 100
    assert 0.05 < lost < 1000 / values.sum()
    mesh = pp.tetrahedralize(labels, 1, way_out(message), finer_where_thin=False)
    assert mesh.nodes[:, 1].max() > 50  # the sheet is there
    with pytest.warns(UserWarning, match="thinner than elements of 6 mm: lost"):
        mesh = pp.tetrahedralize(labels, 1, 6, most_lost=0.2, finer_where_thin=False)
    assert mesh.nodes[:, 1].max() < 40
    assert pp.tetrahedralize(labels, 1, 6).nodes[:, 1].max() > 50  # smaller elements, there alone


def test_inclusion_smaller_than_an_element():
    values = ball((30, 30, 30), (15, 15, 15), 11) * 1
    values[15, 15, 15] = 2
    message = refused(MeshError, ["'lump'", "elements of 6 mm"], labels_of(values), edge=6, inclusions=[2])
    assert way_out(message) < 6


def test_inclusion_outside_the_organ():
    values = ball((30, 30, 60), (15, 15, 15), 11) * 1
    values[ball((30, 30, 60), (15, 15, 45), 5)] = 2
    with pytest.warns(UserWarning, match="2 parts that do not touch; the largest is kept, 0.485 ml dropped"):
        refused(DataError, ["'lump' lies outside", "keep='all'"], labels_of(values), inclusions=[2])


def test_options_that_cannot_be():
    for keep in ("some", 0, True, 1.5, (1, 2), (1, 2, np.nan), None):
        refused(DataError, ["keep: expected 'largest', 'all', a side (left, ", repr(keep)], ORGAN, keep=keep)
    refused(DataError, ["smooth", "-1"], ORGAN, smooth=-1)
    refused(DataError, ["inclusions [1]", "not the organ"], ORGAN, inclusions=[1])


def run(*words):
    """Exit code and message of `palpate words`; a refusal comes out of the app as an exception."""
    result = CliRunner().invoke(app, [str(w) for w in words])
    if isinstance(result.exception, PalpateError):
        return 2, str(result.exception)
    return result.exit_code, result.output


def test_the_command_leaves_no_output_behind_when_it_refuses(tmp_path):
    source = tmp_path / "labels.nii.gz"
    pp.write_labels(source, ORGAN)
    before = tmp_path / "before.vtu"
    before.write_text("an older mesh")
    for options, words in (
        (["--label", "spleen"], ["'spleen' is absent"]),
        (["--label", "organ", "--edge", "-2"], ["positive length", "-2"]),
        (["--label", "organ", "--names", tmp_path / "none.json"], ["none.json", "no such file"]),
    ):
        code, message = run("mesh", source, "-o", before, *options)
        assert code == 2
        assert all(word in message for word in words), message
        assert before.read_text() == "an older mesh"
    code, message = run("mesh", source, "-o", tmp_path / "mesh.xyz", "--label", "organ")
    assert (code, "cannot tell the format" in message) == (2, True)
    code, message = run("mesh", tmp_path / "none.nii.gz", "-o", before, "--label", "organ")
    assert (code, "none.nii.gz" in message) == (2, True)
    assert {p.name for p in tmp_path.iterdir()} == {"labels.nii.gz", "before.vtu"}


def test_the_command_meshes_by_name_and_says_what_it_made(tmp_path):
    source = tmp_path / "labels.nii.gz"
    values = ball((30, 30, 30), (15, 15, 15), 11) * 1 + ball((30, 30, 30), (15, 14, 15), 4)
    pp.write_labels(source, pp.Labels(values, ORGAN.grid))
    (tmp_path / "label_names.json").write_text('{"1": "breast", "2": "lesion"}')
    code, said = run(
        "mesh", source, "--label", "breast", "--inclusion", "lesion", "--edge", 3, "-o", tmp_path / "b.msh"
    )
    assert code == 0, said
    assert "region 1 (breast)" in said
    assert "region 2 (lesion)" in said
    mesh = pp.read_mesh(tmp_path / "b.msh")
    assert mesh.names == {1: "breast", 2: "lesion"}
    assert mesh.volumes[mesh.region == 2].sum() == pytest.approx((values == 2).sum(), rel=0.03)


def test_names_that_are_no_names(tmp_path):
    source = tmp_path / "labels.nii.gz"
    pp.write_labels(source, ORGAN)
    for text in ("[1, 2]", "{", '{"one": "organ"}'):
        (tmp_path / "n.json").write_text(text)
        code, message = run("mesh", source, "--label", 1, "--names", tmp_path / "n.json", "-o", tmp_path / "m.vtu")
        assert code == 2
        assert "n.json: expected a JSON object such as" in message
    with pytest.raises(FileError):
        pp.read_mesh(tmp_path / "m.vtu")
