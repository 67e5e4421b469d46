"""CT series as anonymisers leave them: without preamble, without numbers of the series, beside files of other kinds."""

import warnings

import numpy as np
import pydicom
import pytest
from support.dicom_files import MR, changed, ct_slice, save

import palpate as pp
from palpate.errors import FileError

STACK = np.random.default_rng(1).integers(0, 4000, (4, 5, 6)).astype(np.uint16)
REPORT = "1.2.840.10008.5.1.4.1.1.88.67"  # X-Ray Radiation Dose SR
UIDS = ("SeriesInstanceUID", "StudyInstanceUID", "SOPInstanceUID", "FrameOfReferenceUID")


def series(folder, pixels=STACK, name="", **tags):
    folder.mkdir(exist_ok=True)
    for k, image in enumerate(pixels):
        ct_slice(folder / f"{name}{k}", image, (10, 10, 10 + 2.5 * k), **tags)
    return folder


def without_preamble(path, meta):
    """The bare data set, with or without its group of meta information before it; implicit if there is none to tell."""
    dataset = pydicom.dcmread(path)
    whole = path.read_bytes()
    if meta:
        path.write_bytes(whole[132:])
        return
    bare = pydicom.Dataset(dataset)
    pydicom.dcmwrite(path, bare, implicit_vr=True, little_endian=True)


def same(folder, words=None):
    """The volume is that of STACK; the warning holds `words`, or there is none."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        volume = pp.read_volume(folder)
    assert np.array_equal(volume.values, STACK.astype(np.float32) - 1024)
    assert volume.grid == pp.Grid((4, 5, 6), (2.5, 0.7, 0.4), (10, 10, 10))
    told = [str(w.message) for w in said]
    assert (words is None and told == []) or any(all(word in one for word in words) for one in told), told


@pytest.mark.parametrize("meta", [True, False])
def test_files_without_preamble_are_read(tmp_path, meta):
    folder = series(tmp_path / "s")
    for path in folder.iterdir():
        without_preamble(path, meta)
        assert path.read_bytes()[128:132] != b"DICM"
    same(folder)
    same(folder / "2")


def test_a_bare_data_set_is_judged(tmp_path):
    """Packed pixels of unknown packing, another kind of image, and what only begins like a data set."""
    one = save(tmp_path / "a.dcm", MR, STACK[0], Modality="MR", SeriesInstanceUID="1.2")
    without_preamble(one, meta=False)
    with pytest.raises(ValueError, match=r"a\.dcm: SOP Class UID \(0008,0016\) is MR"):
        pp.read_volume(one)
    packed = ct_slice(tmp_path / "b.dcm", np.zeros((64, 64), np.uint16), syntax=pydicom.uid.RLELossless)
    content = packed.read_bytes()
    packed.write_bytes(content[content.index(b"\x08\x00\x16\x00UI") :])
    with pytest.raises(FileError, match=r"b\.dcm: lacks Transfer Syntax UID"):
        pp.read_volume(packed)
    (tmp_path / "c.dcm").write_bytes(b"\x08\x00\x05\x00CS\x0a\x00" + bytes(500))
    with pytest.raises((FileError, ValueError), match=r"c\.dcm: "):
        pp.read_volume(tmp_path / "c.dcm")


def test_slices_without_numbers_are_taken_together_by_geometry(tmp_path):
    folder = series(tmp_path / "s")
    for path in folder.iterdir():
        dataset = pydicom.dcmread(path)
        for keyword in UIDS:
            setattr(dataset, keyword, "")
        dataset.save_as(path)
    same(folder, ["4 files without Series Instance UID", "size, spacing and orientation"])
    series(folder, STACK[:2, ::-1].transpose(0, 2, 1), "turned-", SeriesInstanceUID="")
    with pytest.raises(FileError, match=r"holds 2 series; .*0 \(4 files\), turned-0 \(2 files\)"):
        pp.read_volume(folder)
    same(folder / "1")  # a slice stands for its like
    assert pp.read_volume(folder / "turned-0").grid.shape == (2, 6, 5)


def test_a_foreign_file_beside_a_series_is_passed_over_with_a_word(tmp_path):
    folder = series(tmp_path / "s")
    save(folder / "dose", REPORT, STACK[0], Modality="SR", SeriesInstanceUID="9")
    same(folder, ["passed over 1 files", "dose"])
    ct_slice(folder / "9", STACK[0, 1:], (0, 0, 99), series="8")  # one image of another size
    same(folder, ["passed over 2 files", "9", "dose"])
    same(folder / "3")


def test_what_may_belong_to_the_series_is_not_passed_over(tmp_path):
    """An image alike in another series; a slice that is cut; a negative spacing."""
    folder = series(tmp_path / "s")
    changed(folder / "0", SeriesInstanceUID="9.9")
    with pytest.raises(FileError, match=r"holds 2 series.*\(3 files\)"):
        pp.read_volume(folder)
    folder = series(tmp_path / "t")
    (folder / "0").write_bytes((folder / "0").read_bytes()[:300])
    with pytest.raises(FileError, match=r"0: lacks Series Instance UID \(0020,000E\) and Rows"):
        pp.read_volume(folder)
    folder = series(tmp_path / "u", PixelSpacing=[-0.7, 0.4])
    with pytest.raises(FileError, match=r"Pixel Spacing \(0028,0030\) is \[-0.7, 0.4\]"):
        pp.read_volume(folder)
