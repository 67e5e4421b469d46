"""A label with two kidneys: which of them is meshed."""

import sys
import warnings

import numpy as np
import pytest

import palpate as pp
from palpate.commands import main
from palpate.errors import DataError

TURN = np.array([[-1.0, 0, 0], [0, -1, 0], [0, 0, 1]])  # the file's x runs to the patient's right


def ball(centre, radius, shape=(20, 20, 50)):
    place = np.moveaxis(np.indices(shape), 0, -1) - np.asarray(centre)
    return np.linalg.norm(place, axis=-1) < radius


def kidneys(lump=None, direction=None, shift=(0, 0, 0)):
    """A large one at low x, a smaller one at high x, a speck further out."""
    values = 1 * (ball((10, 10, 12), 8) | ball((10, 9, 36), 7) | ball((10, 10, 48), 1.5))
    if lump is not None:
        values[ball(lump, 3)] = 2
    direction = np.eye(3) if direction is None else direction
    return pp.Labels(values, pp.Grid(values.shape, (1, 1, 1), shift, direction), {1: "kidney", 2: "lump"})


def meshed(labels, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return pp.tetrahedralize(labels, "kidney", 4, **options)


def middle(labels, mesh):
    """Its x index in the file."""
    return float(labels.grid.indices(mesh.nodes)[:, 2].mean())


@pytest.mark.parametrize(
    ("keep", "wanted"),
    [
        ("largest", 12),
        ("left", 36),
        ("right", 12),
        ("anterior", 36),
        (1, 12),
        (2, 36),
        ((36, 9, 10), 36),
        ([12, 10, 10], 12),
    ],
)
def test_a_part_is_chosen(keep, wanted):
    assert middle(kidneys(), meshed(kidneys(), keep=keep)) == pytest.approx(wanted, abs=0.7)


def test_sides_are_the_patients_not_the_files():
    labels = kidneys(direction=TURN, shift=(100, 50, -20))
    assert middle(labels, meshed(labels, keep="left")) == pytest.approx(12, abs=0.7)
    assert middle(labels, meshed(labels, keep="right")) == pytest.approx(36, abs=0.7)
    point = labels.grid.points([(10, 9, 36)])[0]
    assert middle(labels, meshed(labels, keep=point)) == pytest.approx(36, abs=0.7)


def test_the_part_that_holds_the_inclusion_is_kept():
    labels = kidneys(lump=(10, 9, 36))
    with pytest.warns(UserWarning, match="3 parts that do not touch; the one that holds the inclusions is kept, 2.1"):
        mesh = pp.tetrahedralize(labels, "kidney", 3, inclusions=["lump"])
    assert middle(labels, mesh) == pytest.approx(36, abs=0.7)
    assert set(mesh.region) == {1, 2}
    with (
        pytest.raises(DataError, match="'lump' lies outside the part of 'kidney' that is kept"),
        pytest.warns(UserWarning, match="3 parts"),
    ):
        pp.tetrahedralize(labels, "kidney", 3, inclusions=["lump"], keep="right")


def test_a_part_that_is_not_there():
    with pytest.raises(DataError, match="keep: 4, but 'kidney' has 3 parts"):
        meshed(kidneys(), keep=4)
    with pytest.raises(
        DataError, match=r"no part of 'kidney' at \[25.0, 10.0, 10.0\] mm; .*\(12, 10, 10\); \(36, 9, 10\)"
    ):
        meshed(kidneys(), keep=(25, 10, 10))
    with pytest.raises(DataError, match="no part of 'kidney' at"):
        meshed(kidneys(), keep=(-500, 10, 10))


@pytest.mark.parametrize(("option", "wanted"), [("left", 36), ("2", 36), ("12,10,10", 12)])
def test_the_command_takes_each_form(tmp_path, monkeypatch, capsys, option, wanted):
    pp.write_labels(tmp_path / "l.nii.gz", kidneys())
    words = ["mesh", "l.nii.gz", "--label", "kidney", "--keep", option, "-o", "m.vtu"]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["palpate", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    assert middle(kidneys(), pp.read_mesh("m.vtu")) == pytest.approx(wanted, abs=0.7)
    said = capsys.readouterr().err
    assert "(--keep all keeps them)" in said
    assert "keep=" not in said
