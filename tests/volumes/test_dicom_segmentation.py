"""DICOM segmentations that highdicom, another library, has written."""

import warnings

import numpy as np
import pydicom
import pytest
from support.dicom_files import ct_slice

import palpate as pp

hd = pytest.importorskip("highdicom", reason="highdicom is not installed: pip install 'palpate[test]'")
from highdicom.seg import SegmentAlgorithmTypeValues, Segmentation, SegmentDescription  # noqa: E402
from pydicom.sr.codedict import codes  # noqa: E402

SHAPE, SPACING, STEP = (7, 12, 10), (1.5, 0.75), 2.5  # slices, rows, columns; mm of rows, columns; between slices
TURNED = (0.8, 0.6, 0, 0, 0, -1)  # coronal, turned about the patient's axis


def series(folder, axes=(1, 0, 0, 0, 1, 0)):
    """A CT series, and what reads it."""
    normal = np.cross(axes[:3], axes[3:])
    for k in range(SHAPE[0]):
        place = np.array([10.0, -20.0, 30.0]) + k * STEP * normal
        ct_slice(
            folder / f"{k}.dcm", np.zeros(SHAPE[1:], np.int16), position=tuple(place), axes=axes,
            PixelSpacing=list(SPACING), SliceThickness=STEP, InstanceNumber=k + 1,
        )  # fmt: skip
    images = [pydicom.dcmread(folder / f"{k}.dcm") for k in range(SHAPE[0])]
    frame, study = hd.UID(), hd.UID()
    for image in images:  # what highdicom asks of its source images
        image.FrameOfReferenceUID, image.StudyInstanceUID = frame, study
        for name in ("PatientID", "PatientName", "PatientBirthDate", "PatientSex", "AccessionNumber", "StudyID",
                     "StudyDate", "StudyTime"):  # fmt: skip
            if name not in image:
                setattr(image, name, None)
    return images, pp.read_volume(folder).grid


def described(number, label):
    return SegmentDescription(
        number, label, codes.SCT.Organ, codes.SCT.Liver, SegmentAlgorithmTypeValues.MANUAL
    )  # fmt: skip


def labels(seed=0):
    """Two bodies that do not overlap; the outer slices are empty."""
    rng = np.random.default_rng(seed)
    values = np.zeros(SHAPE, np.uint8)
    values[1:5, 2:8, 1:6] = 1
    values[2:6, 3:11, 6:9] = 2
    values[rng.random(SHAPE) < 0.1] = 0
    return values


def written(folder, images, values, kind="BINARY", **more):
    """The path of a segmentation file."""
    made = Segmentation(
        images, values, kind, [described(1, "liver"), described(2, "left kidney")], hd.UID(), 1, hd.UID(), 1,
        "maker", "model", "1", "serial", **more,
    )  # fmt: skip
    made.save_as(folder / "seg.dcm")
    return folder / "seg.dcm"


@pytest.mark.parametrize("axes", [(1, 0, 0, 0, 1, 0), TURNED])
@pytest.mark.parametrize(
    ("kind", "sparse"), [("BINARY", True), ("BINARY", False), ("FRACTIONAL", True), ("LABELMAP", False)]
)
def test_labels_come_with_place_and_names(tmp_path, axes, kind, sparse):
    images, _ = series(tmp_path, axes)
    values = labels()
    path = written(tmp_path, images, values, kind, omit_empty_frames=sparse)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of what leaves out empty slices
        read = pp.read_labels(path)
    assert read.names == {1: "liver", 2: "left kidney"}
    for number in (1, 2):
        ours = read.grid.points(np.argwhere(np.asarray(read.values) == number))
        theirs = _points(images, np.argwhere(values == number))
        np.testing.assert_allclose(np.unique(ours.round(3), axis=0), np.unique(theirs.round(3), axis=0), atol=2e-3)
    assert sorted(read.grid.spacing) == sorted((STEP, *SPACING))


def _points(images, at):
    """(n, 3) mm of slice, row, column, by the standard's formula (PS3.3 C.7.6.2.1.1)."""
    row, column = np.reshape(np.array(images[0].ImageOrientationPatient, dtype=float), (2, 3))
    first = np.array([image.ImagePositionPatient for image in images], dtype=float)[at[:, 0]]
    return first + at[:, 2:3] * SPACING[1] * row + at[:, 1:2] * SPACING[0] * column


def test_a_label_of_it_is_meshed(tmp_path):
    images, _ = series(tmp_path)
    values = np.zeros(SHAPE, np.uint8)
    values[1:6, 2:10, 1:9] = 1
    with pytest.warns(UserWarning, match="cannot tell whether a body is cut off"):
        read = pp.read_labels(written(tmp_path, images, values))
    assert read.values.shape[0] == 7  # five with a body, one free on each side
    mesh = pp.tetrahedralize(read, "liver", edge=3)
    assert mesh.volumes.sum() == pytest.approx(np.count_nonzero(values) * STEP * np.prod(SPACING), rel=0.1)


def test_overlap_is_told(tmp_path):
    images, _ = series(tmp_path)
    both = np.stack([labels() > 0, labels() == 2], axis=-1).astype(np.uint8)
    path = written(tmp_path, images, both)
    with pytest.warns(UserWarning, match=f"overlap in {np.count_nonzero(labels() == 2)} voxels"):
        read = pp.read_labels(path)
    assert np.count_nonzero(np.asarray(read.values) == 2) == np.count_nonzero(labels() == 2)


def test_damage_is_named(tmp_path):
    images, _ = series(tmp_path)
    path = written(tmp_path, images, labels())
    whole = pydicom.dcmread(path)
    cut = pydicom.dcmread(path)
    cut.PixelData = whole.PixelData[:10]
    cut.save_as(tmp_path / "cut.dcm")
    lost = pydicom.dcmread(path)
    for frame in lost.PerFrameFunctionalGroupsSequence:
        del frame.PlanePositionSequence
    lost.save_as(tmp_path / "lost.dcm")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(pp.errors.FileError, match="truncated: 10 bytes"):
            pp.read_labels(tmp_path / "cut.dcm")
        with pytest.raises(pp.errors.FileError, match="Image Position"):
            pp.read_labels(tmp_path / "lost.dcm")
