"""Scans in Zarr folders: the scan of the HDF5 file, which others can read; what is damaged or missing is named."""

import shutil
import sys

import numpy as np
import pytest
from support.stored_scans import a_scan, same
from typer.testing import CliRunner

import palpate as pp
from palpate.commands import app
from palpate.errors import DataError, FileError

zarr = pytest.importorskip("zarr")


@pytest.fixture
def folder(tmp_path):
    pp.write_scan(tmp_path / "a.zarr", a_scan())
    return tmp_path / "a.zarr"


@pytest.mark.parametrize("moving", [True, False])
def test_a_scan_comes_back_bit_for_bit(tmp_path, moving):
    """With its notes, blur and patient frame, as from an HDF5 file."""
    bare = a_scan(moving)
    views = pp.Views(bare.views.source, bare.views.panels, np.diag([-1.0, -1.0, 1.0]))
    blur = pp.Blur(0.1, 0.3)
    scan = pp.Scan(bare.counts, bare.incident, views, bare.background, bare.mask, {"scatter": "none"}, blur)
    for name in ("a.zarr", "a.h5"):
        pp.write_scan(tmp_path / name, scan)
        back = pp.read_scan(tmp_path / name)
        assert same(back, scan)
        assert (dict(back.notes), back.blur) == ({"scatter": "none"}, blur)
        assert np.array_equal(back.views.direction, views.direction)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.h5", "a.zarr"]
    assert pp.is_scan(tmp_path / "a.zarr")


def test_the_folder_reads_without_palpate_as_documented(folder):
    group = zarr.open_group(folder, mode="r")
    assert (group.attrs["format"], group.attrs["version"]) == ("palpate scan", 1)
    assert group["counts"].chunks == (1, 40, 40)
    assert np.array_equal(group["counts"][...], a_scan().counts)
    assert group["counts"].attrs["units"] == "photons"
    assert group["incident"].shape == (3, 1, 1)
    assert group["views/panel/pitch"].shape == (1, 2)


def test_another_writers_folder_is_read(tmp_path, folder):
    """Of the third version of Zarr, with chunks of its own, and without those that hold nothing but zeros."""
    there = zarr.open_group(folder, mode="r")
    group = zarr.open_group(tmp_path / "b.zarr", mode="w", zarr_format=3)
    group.attrs.update(dict(there.attrs))
    for name in ("counts", "incident", "mask", "background"):
        group.create_array(name, data=there[name][...], chunks=tuple(min(7, n) for n in there[name].shape))
    for name in ("source", "panel/pitch", "panel/origin", "panel/row_axis", "panel/column_axis"):
        group.create_array(f"views/{name}", data=there[f"views/{name}"][...])
    assert same(pp.read_scan(tmp_path / "b.zarr"), a_scan())
    assert pp.is_scan(tmp_path / "b.zarr")


def test_a_volume_is_no_scan(tmp_path):
    pp.write_volume(tmp_path / "v.zarr", pp.Volume(np.ones((4, 5, 6), np.float32), pp.Grid((4, 5, 6), (1, 1, 1))))
    assert not pp.is_scan(tmp_path / "v.zarr")
    with pytest.raises(FileError, match=r"v\.zarr: its attribute 'format' is not 'palpate scan'; write it with"):
        pp.read_scan(tmp_path / "v.zarr")


def chunk(folder, k):
    return folder / "counts" / f"{k}.0.0"


def shortened(path):
    path.write_bytes(path.read_bytes()[:-9])


def flipped(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)


def rewritten(name, values):
    def change(folder):
        group = zarr.open_group(folder, mode="r+")
        del group[name]
        group.create_array(name, data=np.asarray(values))

    return change


def group_for(name):
    def change(folder):
        group = zarr.open_group(folder, mode="r+")
        del group[name]
        group.create_group(name)

    return change


SPOILT = {
    "a view is missing": (lambda f: chunk(f, 1).unlink(), FileError, "1 of 3 chunks of counts are missing"),
    "a view is cut short": (lambda f: shortened(chunk(f, 2)), FileError, "truncated or damaged Zarr folder"),
    "a view is damaged": (lambda f: flipped(chunk(f, 0)), FileError, "truncated or damaged Zarr folder"),
    "no group": (lambda f: (f / ".zgroup").unlink(), FileError, "not a Zarr folder"),
    "no attributes": (lambda f: (f / ".zattrs").unlink(), FileError, "'format' is not 'palpate scan'"),
    "no pose": (lambda f: shutil.rmtree(f / "views/panel/pitch"), FileError, "array views/panel/pitch is missing"),
    "a group for an array": (group_for("incident"), FileError, "array incident is missing"),
    "words": (rewritten("incident", ["a"] * 3), FileError, "incident: expected real numbers"),
    "negative counts": (rewritten("counts", -np.ones((3, 40, 40))), DataError, "counts"),
}


@pytest.mark.parametrize("case", SPOILT)
def test_what_is_wrong_in_a_folder_is_named(folder, case):
    change, kind, words = SPOILT[case]
    change(folder)
    with pytest.raises(kind) as refusal:
        pp.read_scan(folder)
    assert "a.zarr" in str(refusal.value)
    assert words in str(refusal.value)


def test_a_folder_that_claims_more_than_it_holds_is_refused(folder):
    head = folder / "counts" / ".zarray"
    head.write_text(head.read_text().replace("40", str(2**20)))
    with pytest.raises(FileError, match=r"a\.zarr: says \(3, 1048576, 1048576\) numbers of counts"):
        pp.read_scan(folder)


def test_a_folder_that_is_there_is_kept(folder):
    with pytest.raises(FileError, match=r"a\.zarr"):
        pp.write_scan(folder, a_scan())
    assert same(pp.read_scan(folder), a_scan())


def test_without_zarr_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(FileError, match=r"pip install 'palpate\[zarr\]'"):
        pp.write_scan(tmp_path / "a.zarr", a_scan())
    assert list(tmp_path.iterdir()) == []


def test_commands_write_and_read_it(tmp_path):
    """The volume is that of the same scan in HDF5, to the bit."""
    simulate = ["scan", "simulate", "--motion", "arc", "--views", "5", "--pixels", "40", "40", "--seed", "1"]
    for name in ("s.zarr", "s.h5"):
        reconstruct = ["reconstruct", str(tmp_path / name), "--thickness", "40", "-o", str(tmp_path / f"{name}.nii.gz")]
        for words in ([*simulate, "-o", str(tmp_path / name)], reconstruct):
            done = CliRunner().invoke(app, words)
            assert done.exit_code == 0, done.output
    volumes = [pp.read_volume(tmp_path / f"{name}.nii.gz").values for name in ("s.zarr", "s.h5")]
    assert np.array_equal(*volumes)
