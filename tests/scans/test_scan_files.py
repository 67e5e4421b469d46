"""Scans in HDF5: what goes in comes out, others can read it, and damage is named."""

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.stored_scans import a_scan, same

import palpate as pp
from palpate.errors import DataError, FileError, GeometryError
from palpate.scans.io import drop_constant_axes
from palpate.volumes.hdf5_guard import read_dataset


@pytest.mark.parametrize("moving", [True, False])
def test_a_scan_comes_back_bit_for_bit(tmp_path, moving):
    scan = a_scan(moving)
    pp.write_scan(tmp_path / "a.h5", scan)
    assert same(pp.read_scan(tmp_path / "a.h5"), scan)
    assert [p.name for p in tmp_path.iterdir()] == ["a.h5"]


def test_the_file_reads_without_palpate_as_documented(tmp_path):
    scan = a_scan()
    pp.write_scan(tmp_path / "a.h5", scan)
    with h5py.File(tmp_path / "a.h5") as f:
        assert f.attrs["format"] == "palpate scan"
        assert f.attrs["version"] == 1
        assert f["counts"].attrs["units"] == "photons"
        assert f["counts"].compression == "gzip"
        assert f["views/source"].attrs["units"] == "mm"
        assert f["incident"].shape == (3, 1, 1)
        assert f["background"].shape == (1, 1, 1)
        assert f["mask"].shape == (1, 40, 1)
        # the third pixel of the fifth row of view 1, from the datasets alone
        pose = {k: f[f"views/panel/{k}"][()] for k in ("origin", "pitch", "row_axis", "column_axis")}
        o, d, r, c = (v[1 if len(v) > 1 else 0] for v in pose.values())
        assert np.allclose(o + 4 * d[0] * r + 2 * d[1] * c, scan.views.panels[1].points([4, 2])[0])


def test_a_flag_mask_of_another_writer_is_read(tmp_path):
    pp.write_scan(tmp_path / "a.h5", a_scan())
    with h5py.File(tmp_path / "a.h5", "r+") as f:
        mask = f["mask"][()].astype(np.uint8)
        del f["mask"]
        f["mask"] = mask
    assert same(pp.read_scan(tmp_path / "a.h5"), a_scan())


@settings(max_examples=60)
@given(
    shape=st.tuples(st.integers(1, 3), st.integers(1, 3), st.integers(1, 3)),
    cut=st.tuples(st.booleans(), st.booleans(), st.booleans()),
    seed=st.integers(0, 9),
)
def test_smallest_form_broadcasts_back(shape, cut, seed):
    form = tuple(1 if c else n for c, n in zip(cut, shape, strict=True))
    full = np.broadcast_to(np.random.default_rng(seed).integers(0, 3, form), shape)
    for values in (full, full.copy()):
        small = drop_constant_axes(values)
        assert np.array_equal(np.broadcast_to(small, shape), full)
        assert small.size <= np.prod(form)


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.7, 0.99])
def test_a_truncated_file_is_named_with_a_way_out(tmp_path, share):
    whole, part = tmp_path / "whole.h5", tmp_path / "part.h5"
    pp.write_scan(whole, a_scan(rows=200))
    content = whole.read_bytes()
    part.write_bytes(content[: int(share * len(content))])
    with pytest.raises(FileError, match=r"part\.h5: (not an HDF5|truncated or damaged).*palpate scan import"):
        pp.read_scan(part)


def test_damaged_counts_are_noticed(tmp_path):
    path = tmp_path / "a.h5"
    pp.write_scan(path, a_scan(rows=200))
    with h5py.File(path) as f:
        start = f["counts"].id.get_chunk_info(1).byte_offset
    content = bytearray(path.read_bytes())
    content[start + 100] ^= 0xFF
    path.write_bytes(content)
    with pytest.raises(FileError, match=r"a\.h5: truncated or damaged HDF5 file.*copy it again"):
        pp.read_scan(path)


def spoil(path, change):
    pp.write_scan(path, a_scan())
    with h5py.File(path, "r+") as f:
        change(f)


def replace(name, value):
    def change(f):
        del f[name]
        f[name] = value

    return change


SPOILT = {
    "missing dataset": (lambda f: f.__delitem__("incident"), FileError, ["/incident is missing", "counts", "import"]),
    "missing pose": (lambda f: f.__delitem__("views/panel/pitch"), FileError, ["/views/panel/pitch is missing"]),
    "another HDF5": (lambda f: f.attrs.__delitem__("format"), FileError, ["'palpate scan'", "import"]),
    "newer layout": (lambda f: f.attrs.__setitem__("version", 9), FileError, ["version 9", "reads 1", "update"]),
    "counts of two axes": (replace("counts", np.ones((3, 4))), DataError, ["/counts", "(3, 4)"]),
    "incident shape": (replace("incident", np.ones(5)), DataError, ["incident", "(3,)", "(5,)"]),
    "negative counts": (replace("counts", -np.ones((3, 40, 40))), DataError, ["counts", "-1", "mask"]),
    "poses for views": (replace("views/panel/origin", np.ones((2, 3))), DataError, ["origin", "(2, 3)", "one a view"]),
    "60 m source": (replace("views/source", np.full((3, 3), 6e4)), GeometryError, ["60 m", "check the units"]),
}


@pytest.mark.parametrize("case", SPOILT)
def test_what_is_wrong_in_a_file_is_named(tmp_path, case):
    change, kind, words = SPOILT[case]
    spoil(tmp_path / "a.h5", change)
    with pytest.raises(kind) as refusal:
        pp.read_scan(tmp_path / "a.h5")
    for word in ["a.h5", *words]:
        assert word in str(refusal.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileError, match=r"none\.h5: no such file; check the name"):
        pp.read_scan(tmp_path / "none.h5")
    with pytest.raises(FileError, match="is a folder; name a file"):
        pp.read_scan(tmp_path)


def test_a_write_that_fails_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "a.h5"
    pp.write_scan(path, a_scan())
    before = path.read_bytes()

    def fails(*args, **kwargs):
        raise OSError("disk full")

    monkeypatch.setattr("palpate.scans.io.drop_constant_axes", fails)
    with pytest.raises(OSError, match="disk full"):
        pp.write_scan(path, a_scan())
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.h5"]


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match=r"folder .*file does not exist; make it first"):
        pp.write_scan(tmp_path / "file" / "a.h5", a_scan())
    with pytest.raises(FileError, match=r"folder /proc is not writable.*choose another folder"):
        pp.write_scan("/proc/a.h5", a_scan())


@pytest.mark.parametrize(
    ("shape", "chunks", "kind", "way"),
    [
        ((5, 7, 9), (2, 3, 4), "f4", {"compression": 4, "shuffle": True}),
        ((5, 7), (5, 7), ">i2", {"compression": 1}),
        ((11,), (4,), "f8", {"compression": 4, "shuffle": True, "fletcher32": True}),
        ((4, 4), (2, 2), "u1", {"compression": 1, "shuffle": True}),
        ((0, 3), (1, 3), "f8", {"compression": 1, "maxshape": (None, 3)}),
        ((3, 4), None, "i8", {}),
    ],
)
def test_chunks_of_any_shape_are_unpacked(tmp_path, shape, chunks, kind, way):
    """Chunks are unpacked here, not by the HDF5 library: the last of an axis may reach beyond it, or be missing."""
    values = (np.random.default_rng(0).random(shape) * 100).astype(kind)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("x", data=values, chunks=chunks, **way)
        file.create_dataset("y", shape, kind, chunks=chunks, fillvalue=7, **way)
    with h5py.File(tmp_path / "a.h5") as file:
        assert np.array_equal(read_dataset(tmp_path / "a.h5", file, "x"), values)
        assert (read_dataset(tmp_path / "a.h5", file, "y") == 7).all()
