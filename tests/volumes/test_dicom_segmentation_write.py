"""Labels written as DICOM segmentations: what highdicom, another library, and palpate read of them; what is refused."""

import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np
import pydicom
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from support.dicom_files import MR, changed, complaints, ct_slice, save

import palpate as pp
from palpate.commands import main
from palpate.errors import DataError, FileError, GeometryError
from palpate.volumes import dicom_segmentation_write
from palpate.volumes.dicom_segmentation_write import _segments, packed_bits

hd = pytest.importorskip("highdicom", reason="highdicom is not installed: pip install 'palpate[test]'")

SHAPE, SPACING, STEP = (7, 11, 9), (1.5, 0.75), 2.5  # slices, rows, columns; mm of rows, columns; between slices
TURNED = (0.8, 0.6, 0, 0, 0, -1)  # coronal, turned about the patient's axis
NAMES = {1: "liver", 2: "left kidney"}
COMMON = {  # of a series, beside its images
    "StudyInstanceUID": "1.2.7",
    "FrameOfReferenceUID": "1.2.8",
    "PatientName": "Doe^Jane",
    "PatientID": "7",
    "PatientBirthDate": "19700102",
    "PatientSex": "F",
    "PatientAge": "050Y",
    "StudyDate": "20200304",
    "StudyTime": "101112",
    "StudyID": "S5",
    "StudyDescription": "Abdomen",
    "ReferringPhysicianName": "Roe^Richard",
    "AccessionNumber": "A6",
    "PositionReferenceIndicator": "",
}


def series(folder, shape=SHAPE, spacing=SPACING, step=STEP, axes=(1, 0, 0, 0, 1, 0), **tags):
    """A CT series whose files do not lie in the order of their names."""
    folder.mkdir()
    normal = np.cross(axes[:3], axes[3:])
    for k in range(shape[0]):
        place = np.array([10.0, -20.0, 30.0]) + k * step * normal
        ct_slice(
            folder / f"{k * 3 % 7}-{k}.dcm", np.full(shape[1:], 100 * k, np.int16), tuple(place.round(9)), axes,
            PixelSpacing=list(spacing), SpacingBetweenSlices=step, InstanceNumber=k + 1, **{**COMMON, **tags},
        )  # fmt: skip
    return folder


def bodies(shape=SHAPE):
    """Two bodies; the outer slices are empty."""
    values = np.zeros(shape, int)
    values[1:5, 2:8, 1:6] = 1
    values[2:6, 3:11, 6:9] = 2
    return values


def labelled(folder, values=None, names=NAMES):
    return pp.Labels(bodies() if values is None else values, pp.read_volume(folder).grid, names)


def written(folder, values=None, names=NAMES, **tags):
    """The path of a segmentation of a series in `folder`, and its labels."""
    labels = labelled(series(folder / "ct", **tags), values, names)
    pp.write_labels(folder / "seg.dcm", labels, like=folder / "ct")
    return folder / "seg.dcm", labels


def silently_read(path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return pp.read_labels(path)


def check_the_same(read, labels):
    """To the bit."""
    assert np.array_equal(read.values, labels.values)
    assert dict(read.names) == {value: name for value, name in labels.names.items() if value}
    assert read.grid.shape == labels.grid.shape
    assert read.grid.spacing == labels.grid.spacing
    assert read.grid.origin == labels.grid.origin
    assert np.array_equal(read.grid.direction, labels.grid.direction)


def check_by_highdicom(path, labels):
    """Labels, names and every voxel's place, as another library finds them."""
    found = hd.seg.segread(path)
    values = sorted(set(np.unique(labels.values).tolist()) - {0} | set(labels.names) - {0})
    assert list(found.segment_numbers) == list(range(1, len(values) + 1))
    for number, value in enumerate(values, start=1):
        described = found.get_segment_description(number)
        assert described.segment_label == labels.names.get(value, f"label {value}")
        assert described.segmented_property_type.meaning == "Tissue"
    volume = found.get_volume(combine_segments=True)
    assert volume.spatial_shape == labels.grid.shape
    at = np.argwhere(np.ones(labels.grid.shape, bool))
    places = volume.map_indices_to_reference(at)
    theirs = np.array([0, *values])[np.asarray(volume.array)[tuple(at.T)]]
    k, j, i = np.rint(labels.grid.indices(places)).astype(int).T
    np.testing.assert_allclose(labels.grid.points(np.c_[k, j, i]), places, atol=1e-6)
    assert np.array_equal(labels.values[k, j, i], theirs)
    assert len(np.unique(np.c_[k, j, i], axis=0)) == labels.values.size


# --- what is written, read back --------------------------------------------------------------------------------------


@pytest.mark.parametrize("axes", [(1, 0, 0, 0, 1, 0), TURNED])
def test_labels_names_and_grid_come_back_to_the_bit(tmp_path, axes):
    path, labels = written(tmp_path, axes=axes)
    check_the_same(silently_read(path), labels)
    check_by_highdicom(path, labels)
    assert {p.name for p in tmp_path.iterdir()} == {"ct", "seg.dcm"}


@st.composite
def cases(draw):
    """A series' shape, spacing and axes, labels on it, and names of some."""
    shape = tuple(draw(st.integers(1, most)) for most in (5, 13, 11))
    spacing = [draw(st.integers(20, 500)) / 100 for _ in range(3)]
    if draw(st.booleans()):
        spacing[0] = 0.2 + 1 / draw(st.integers(1, 99))  # no decimal text holds it
    turn = Rotation.random(random_state=draw(st.integers(0, 999))).as_matrix() if draw(st.booleans()) else np.eye(3)
    values = draw(st.lists(st.integers(1, 400) | st.sampled_from([65535, 65536, 2**31 - 1]), min_size=1, max_size=4))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    drawn = rng.choice([0, *values], size=shape, p=[0.6, *[0.4 / len(values)] * len(values)])
    drawn[rng.random(shape[0]) < 0.3] = 0  # some slices are empty
    named = draw(st.lists(st.sampled_from([*values, 77]), min_size=1, unique=True))
    text = st.text(st.characters(codec="utf-8", categories=["L", "N", "P"], exclude_characters="\\"), min_size=1)
    return shape, spacing, turn, drawn, {value: draw(text)[:64] for value in named}


@given(cases())
@settings(max_examples=40)
def test_any_labels_come_back(case):
    shape, (step, *spacing), turn, values, names = case
    with tempfile.TemporaryDirectory() as folder:
        axes = [round(float(v), 10) for v in (*turn[:, 0], *turn[:, 1])]  # a decimal text has 16 characters
        path, labels = written(
            Path(folder), values, names, shape=shape, spacing=spacing, step=round(step, 12), axes=axes
        )
        read = silently_read(path)
        check_the_same(read, labels)
        check_by_highdicom(path, labels)


def test_a_bit_a_voxel_as_pydicom_unpacks_it(tmp_path):
    path, labels = written(tmp_path)
    dataset = pydicom.dcmread(path)
    frames = dataset.pixel_array  # 99 voxels a frame: frames begin within bytes
    for frame, group in zip(frames, dataset.PerFrameFunctionalGroupsSequence, strict=True):
        number = group.SegmentIdentificationSequence[0].ReferencedSegmentNumber
        place = np.array(group.PlanePositionSequence[0].ImagePositionPatient, float)
        k = round(labels.grid.indices(place)[0, 0])
        assert np.array_equal(frame, labels.values[k] == number)
    assert len(dataset.PixelData) == 2 * -(-frames.size // 16)
    whole = packed_bits(labels.values, [(1, k) for k in range(7)] + [(2, k) for k in range(7)])
    bits = np.unpackbits(np.frombuffer(whole, np.uint8), bitorder="little")[: 2 * labels.values.size]
    assert np.array_equal(bits.reshape(2, *SHAPE), [labels.values == 1, labels.values == 2])


def test_empty_frames_are_left_out_but_for_the_ends_of_the_grid(tmp_path):
    path, _ = written(tmp_path)
    found = [
        (
            int(group.SegmentIdentificationSequence[0].ReferencedSegmentNumber),
            float(group.PlanePositionSequence[0].ImagePositionPatient[2]),
            tuple(group.FrameContentSequence[0].DimensionIndexValues),
        )
        for group in pydicom.dcmread(path).PerFrameFunctionalGroupsSequence
    ]
    first, second = [(1, 30 + STEP * k) for k in (0, 1, 2, 3, 4, 6)], [(2, 30 + STEP * k) for k in (2, 3, 4, 5)]
    assert [(number, place) for number, place, _ in found] == first + second
    assert [index for *_, index in found] == sorted(index for *_, index in found)


def test_a_body_that_the_images_cut_off_is_cut_off_when_it_is_read(tmp_path):
    path, labels = written(tmp_path, np.ones(SHAPE, int), {1: "all"})
    check_the_same(silently_read(path), labels)  # of another maker's file a free slice would be put on both sides
    assert pydicom.dcmread(path).NumberOfFrames == SHAPE[0]


def test_one_slice_of_many_is_enough(tmp_path):
    shape = (160, 4, 4)
    values = np.zeros(shape, int)
    values[100, 1:3, 1:3] = 5
    path, labels = written(tmp_path, values, {5: "lump"}, shape=shape)
    check_the_same(silently_read(path), labels)
    groups = pydicom.dcmread(path).PerFrameFunctionalGroupsSequence
    assert [tuple(group.FrameContentSequence[0].DimensionIndexValues) for group in groups] == [(1, 1), (1, 2), (1, 3)]


def test_a_label_without_voxels_keeps_its_name_and_one_without_name_has_none(tmp_path):
    path, labels = written(tmp_path, bodies() * 4, {0: "outside", 4: "label 4", 6: "gone"})
    check_the_same(silently_read(path), labels)
    assert silently_read(path).names == {4: "label 4", 6: "gone"}
    assert [each.SegmentLabel for each in pydicom.dcmread(path).SegmentSequence] == ["label 4", "gone", "label 8"]
    assert complaints(path) == []


def test_a_segmentation_that_another_program_saved_has_the_numbers_of_its_segments(tmp_path):
    path, _ = written(tmp_path, bodies() * 4, {4: "liver", 8: "kidney"})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        assert pp.read_labels(changed(path, Manufacturer="another")).names == {1: "liver", 2: "kidney"}


# --- what it says of patient, study and images -----------------------------------------------------------------------


@pytest.mark.parametrize("axes", [(1, 0, 0, 0, 1, 0), TURNED])
@pytest.mark.parametrize("names", [NAMES, {1: "Großhirn, links", 2: "腎臓"}, {}])
def test_the_validator_finds_no_error(tmp_path, axes, names):
    assert complaints(written(tmp_path, names=names, axes=axes)[0]) == []


def test_the_validator_does_find_errors(tmp_path):
    assert complaints(changed(written(tmp_path)[0], SegmentSequence=None))


def test_patient_study_and_place_are_those_of_the_series(tmp_path):
    path, _ = written(tmp_path)
    dataset = pydicom.dcmread(path)
    for keyword, value in COMMON.items():
        assert dataset[keyword].value == value, keyword
    image = pydicom.dcmread(next((tmp_path / "ct").iterdir()))
    assert dataset.SeriesInstanceUID != image.SeriesInstanceUID
    assert dataset.SOPInstanceUID != image.SOPInstanceUID
    assert (dataset.Modality, dataset.SegmentationType, dataset.Manufacturer) == ("SEG", "BINARY", "palpate")


def test_names_in_the_characters_of_the_series_and_how_it_was_anonymised(tmp_path):
    (folder := tmp_path / "ct").mkdir()
    method = pydicom.Dataset()
    method.CodeValue, method.CodingSchemeDesignator, method.CodeMeaning = "113100", "DCM", "Basic Profile, geprüft"
    for k in range(3):
        path = ct_slice(
            folder / f"{k}.dcm", np.zeros((4, 4), np.int16), (0, 0, 5.0 * k), SpecificCharacterSet="ISO_IR 100",
            **{**COMMON, "PatientName": "Müller^Jörg"}, PatientIdentityRemoved="YES",
            DeidentificationMethodCodeSequence=[method],
        )  # fmt: skip
        assert "Müller".encode("latin-1") in path.read_bytes()
    values = np.zeros((3, 4, 4), int)
    values[1, 1, 1] = 1
    pp.write_labels(tmp_path / "seg.dcm", labelled(folder, values), like=folder)
    dataset = pydicom.dcmread(tmp_path / "seg.dcm")
    assert (str(dataset.PatientName), dataset.SpecificCharacterSet) == ("Müller^Jörg", "ISO_IR 192")
    assert dataset.DeidentificationMethodCodeSequence[0].CodeMeaning == "Basic Profile, geprüft"
    assert complaints(tmp_path / "seg.dcm") == []


@pytest.mark.parametrize("axes", [(1, 0, 0, 0, 1, 0), TURNED])
def test_each_frame_refers_to_the_image_at_its_place(tmp_path, axes):
    path, _ = written(tmp_path, axes=axes)
    dataset = pydicom.dcmread(path)
    images = {image.SOPInstanceUID: image for image in map(pydicom.dcmread, (tmp_path / "ct").iterdir())}
    referred = set()
    for group in dataset.PerFrameFunctionalGroupsSequence:
        (derivation,) = group.DerivationImageSequence
        (source,) = derivation.SourceImageSequence
        image = images[source.ReferencedSOPInstanceUID]
        assert source.ReferencedSOPClassUID == image.SOPClassUID
        assert group.PlanePositionSequence[0].ImagePositionPatient == image.ImagePositionPatient
        assert derivation.DerivationCodeSequence[0].CodeMeaning == "Segmentation"
        assert "ReferencedFrameNumber" not in source
        referred.add(image.SOPInstanceUID)
    assert len(referred) == SHAPE[0]
    (listed,) = dataset.ReferencedSeriesSequence
    assert listed.SeriesInstanceUID == "1.2.3"
    assert {each.ReferencedSOPInstanceUID for each in listed.ReferencedInstanceSequence} == set(images)
    assert len(listed.ReferencedInstanceSequence) == len(images)
    by_image = hd.seg.segread(path).get_pixels_by_source_instance(sorted(images), combine_segments=True)
    labels = pp.read_labels(path)
    for plane, uid in zip(by_image, sorted(images), strict=True):
        k = round(labels.grid.indices([float(v) for v in images[uid].ImagePositionPatient])[0, 0])
        assert np.array_equal(plane, labels.values[k])


def test_frames_of_a_multi_frame_image_are_referred_to_by_number(tmp_path):
    grid = pp.Grid(SHAPE, (2, 1, 0.5), (1, 2, 3))
    pp.write_volume(tmp_path / "v.dcm", pp.Volume(np.zeros(SHAPE), grid), {"PatientID": "7"})
    labels = pp.Labels(bodies(), pp.read_volume(tmp_path / "v.dcm").grid, NAMES)
    pp.write_labels(tmp_path / "seg.dcm", labels, like=tmp_path / "v.dcm")
    check_the_same(silently_read(tmp_path / "seg.dcm"), labels)
    assert complaints(tmp_path / "seg.dcm") == []
    dataset, source = (pydicom.dcmread(tmp_path / name) for name in ("seg.dcm", "v.dcm"))
    for group in dataset.PerFrameFunctionalGroupsSequence:
        (image,) = group.DerivationImageSequence[0].SourceImageSequence
        assert image.ReferencedSOPInstanceUID == source.SOPInstanceUID
        there = source.PerFrameFunctionalGroupsSequence[image.ReferencedFrameNumber - 1]
        assert there.PlanePositionSequence == group.PlanePositionSequence
    assert len(dataset.ReferencedSeriesSequence[0].ReferencedInstanceSequence) == 1


def test_one_file_of_the_series_is_enough_and_the_segmentation_may_lie_beside_it(tmp_path):
    labels = labelled(series(tmp_path / "ct"))
    pp.write_labels(tmp_path / "ct" / "seg.dcm", labels, like=next((tmp_path / "ct").iterdir()))
    pp.write_labels(tmp_path / "again.dcm", labels, like=tmp_path / "ct")
    check_the_same(silently_read(tmp_path / "again.dcm"), labels)
    assert len(pydicom.dcmread(tmp_path / "again.dcm").ReferencedSeriesSequence[0].ReferencedInstanceSequence) == 7


@given(order=st.permutations(range(3)), flips=st.tuples(*[st.booleans()] * 3))
@settings(max_examples=15)
def test_axes_that_another_format_swapped_or_reversed_are_put_back(order, flips):
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        labels = labelled(series(folder / "ct", axes=TURNED))
        turn = np.eye(3)[:, order] * np.where(flips, -1.0, 1.0)  # new axes in old ones, x, y, z
        if np.linalg.det(turn) < 0:
            turn[:, 0] *= -1
        at = [2 - int(np.abs(turn[:, 2 - a]).argmax()) for a in range(3)]  # old axis of each new one, of z, y, x
        back = [turn[:, 2 - a].sum() < 0 for a in range(3)]
        values = np.transpose(labels.values, at)[tuple(slice(None, None, -1 if b else 1) for b in back)]
        first = np.zeros(3)
        for a in range(3):
            first[at[a]] = SHAPE[at[a]] - 1 if back[a] else 0
        grid = pp.Grid(
            values.shape,
            [labels.grid.spacing[a] for a in at],
            labels.grid.points(first)[0],
            labels.grid.direction @ turn,
        )
        pp.write_labels(folder / "l.nii.gz", pp.Labels(values, grid, NAMES))
        pp.write_labels(folder / "seg.dcm", pp.read_labels(folder / "l.nii.gz"), like=folder / "ct")
        check_the_same(silently_read(folder / "seg.dcm"), labels)


# --- what is refused -------------------------------------------------------------------------------------------------


def check_refused(folder, labels, like, error, *words):
    """The words are said, and what was there before stays."""
    path = folder / "seg.dcm"
    path.write_text("kept")
    with pytest.raises(error) as refusal:
        pp.write_labels(path, labels, like=like)
    for word in words:
        assert word in str(refusal.value)
    assert path.read_text() == "kept"
    assert not [p for p in folder.iterdir() if ".part-" in p.name]


def test_without_images_it_is_said_what_is_needed(tmp_path):
    labels = labelled(series(tmp_path / "ct"))
    check_refused(tmp_path, labels, None, DataError, "give the folder of their series with like=", ".nii.gz")
    check_refused(tmp_path, labels, tmp_path / "none", FileError, "like: ", "none", "give the folder")
    (tmp_path / "empty").mkdir()
    check_refused(tmp_path, labels, tmp_path / "empty", FileError, "like: ", "no DICOM file in this folder", "give the")
    pp.write_labels(tmp_path / "l.nii.gz", labels)
    check_refused(tmp_path, labels, tmp_path / "l.nii.gz", FileError, "like: ", "not a DICOM file", "give the folder")
    (tmp_path / "mr").mkdir()
    save(tmp_path / "mr" / "0.dcm", MR, np.zeros((4, 4), np.int16), SeriesInstanceUID="1.2", Modality="MR")
    check_refused(tmp_path, labels, tmp_path / "mr", DataError, "like: ", "modality MR", "give the folder")
    pp.write_labels(tmp_path / "other.dcm", labels, like=tmp_path / "ct")
    check_refused(tmp_path, labels, tmp_path / "other.dcm", DataError, "like: ", "Segmentation Storage", "give the")
    with pytest.raises(DataError, match=r"l\.nii\.gz: like is for DICOM segmentations"):
        pp.write_labels(tmp_path / "l.nii.gz", labels, like=tmp_path / "ct")
    with pytest.raises(FileError, match="does not exist; make it first"):
        pp.write_labels(tmp_path / "no" / "seg.dcm", labels, like=tmp_path / "ct")


def test_images_without_an_identifier_or_of_two_studies_are_refused(tmp_path):
    labels = labelled(series(tmp_path / "ct"))
    victim = sorted((tmp_path / "ct").iterdir())[4]
    for keyword, tag in (("FrameOfReferenceUID", "(0020,0052)"), ("StudyInstanceUID", "(0020,000D)")):
        changed(victim, **{keyword: "1.2.99"})
        check_refused(tmp_path, labels, tmp_path / "ct", FileError, victim.name, tag, "is another one than in")
        changed(victim, **{keyword: None})
        check_refused(tmp_path, labels, tmp_path / "ct", FileError, victim.name, "lacks", tag)
        changed(victim, **{keyword: COMMON[keyword]})
    pp.write_labels(tmp_path / "seg.dcm", labels, like=tmp_path / "ct")


def test_another_grid_is_refused_by_what_is_other(tmp_path):
    grid = labelled(series(tmp_path / "ct")).grid
    cut = pp.Labels(bodies()[1:], pp.Grid((6, *SHAPE[1:]), grid.spacing, grid.points([1, 0, 0])[0]))
    coarse = pp.Labels(bodies(), pp.Grid(SHAPE, (2.5, 1.5, 0.8), grid.origin))
    moved = pp.Labels(bodies(), pp.Grid(SHAPE, grid.spacing, np.add(grid.origin, (0, 0.1, 0))))
    turn = Rotation.from_euler("z", 10, degrees=True).as_matrix()
    oblique = pp.Labels(bodies(), pp.Grid(SHAPE, grid.spacing, grid.origin, turn))
    for labels, words in (
        (cut, ("shape (6, 11, 9)", "the images (7, 11, 9)")),
        (coarse, ("spacing (2.5, 1.5, 0.8)", "the images (2.5, 1.5, 0.75)")),
        (moved, ("begin at (10.0, -19.9, 30.0) mm", "(10.0, -20.0, 30.0)")),
        (oblique, ("oblique", "10°")),
    ):
        check_refused(tmp_path, labels, tmp_path / "ct", GeometryError, "like: the labels", *words, "resample")


def test_labels_that_a_segmentation_cannot_hold_are_refused(tmp_path, monkeypatch):
    series(tmp_path / "ct")
    for values, names, words in (
        (bodies() * 0, {}, "there is none"),
        (-bodies(), {}, "-2 is negative"),
        (bodies(), dict.fromkeys(range(1, 2**16 + 1), "a"), "65536 of them, a DICOM segmentation holds 65535"),
        (bodies(), {1: "x" * 65}, "1 to 64 characters"),
        (bodies(), {1: "a\\b"}, "without backslash"),
        (bodies(), {1: "a\nb"}, "line breaks"),
        (bodies(), {1: " a"}, "spaces at the ends"),
        (bodies(), {2: ""}, "the name of label 2 is ''"),
    ):
        check_refused(tmp_path, labelled(tmp_path / "ct", values, names), tmp_path / "ct", DataError, words)
    assert len(_segments([[1, 2]], dict.fromkeys(range(1, 2**16), "a"))) == 2**16 - 1
    monkeypatch.setattr(dicom_segmentation_write, "MOST_BYTES", 100)
    check_refused(
        tmp_path, labelled(tmp_path / "ct"), tmp_path / "ct", DataError, "10 frames are", "write fewer labels"
    )


def test_an_interrupted_write_leaves_what_was_there(tmp_path, monkeypatch):
    def full(path, dataset):
        path.write_bytes(b"part")
        raise OSError(28, "No space left on device")

    labels = labelled(series(tmp_path / "ct"))
    monkeypatch.setattr(dicom_segmentation_write, "save", full)
    check_refused(tmp_path, labels, tmp_path / "ct", FileError, "No space left", "as it was")


# --- the command -----------------------------------------------------------------------------------------------------


def palpate(words, monkeypatch, capsys):
    """Exit code, stdout and stderr of the command, in this process."""
    monkeypatch.setattr(sys, "argv", ["palpate", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code or 0, *capsys.readouterr()


def test_the_command_segments_a_series_into_a_segmentation_of_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    series(tmp_path / "ct")  # slice k has 100 k - 1024 HU
    words = ["segment", "ct", "-o", "seg.dcm", "--lower", "-750", "--upper", "-550", "--name", "slab"]
    code, out, err = palpate(words, monkeypatch, capsys)
    assert code == 0, err
    assert "slab" in out
    assert "wrote seg.dcm" in out
    values = np.zeros(SHAPE, int)
    values[3:5] = 1
    labels = labelled(tmp_path / "ct", values, {1: "slab"})
    check_the_same(silently_read(tmp_path / "seg.dcm"), labels)
    check_by_highdicom(tmp_path / "seg.dcm", labels)
    assert complaints(tmp_path / "seg.dcm") == []
    assert pydicom.dcmread("seg.dcm").PatientID == "7"
    words = ["segment", "ct", "-o", "two.dcm", "--lower", "-500", "--name", "top", "--onto", "seg.dcm"]
    assert palpate(words, monkeypatch, capsys)[0] == 0
    assert silently_read(tmp_path / "two.dcm").names == {1: "slab", 2: "top"}


def test_the_command_takes_the_images_of_a_converted_volume(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    pp.write_volume("ct.nii.gz", pp.read_volume(series(tmp_path / "ct")))
    words = ["segment", "ct.nii.gz", "-o", "seg.dcm", "--lower", "-750"]
    monkeypatch.setattr(pp, "read_volume", lambda *_: pytest.fail("refused after work was done"))
    code, _, err = palpate(words, monkeypatch, capsys)
    assert (code, Path("seg.dcm").exists()) == (2, False)
    assert "--like: ct.nii.gz: not a DICOM file" in err
    assert "with --like FOLDER" in err
    code, _, err = palpate([*words[:3], "labels.tif", *words[4:]], monkeypatch, capsys)
    assert code == 2
    assert "labels are not written in this format" in err
    code, _, err = palpate([*words[:3], "labels.nrrd", *words[4:], "--like", "ct"], monkeypatch, capsys)
    assert code == 2
    assert "labels.nrrd: --like is for DICOM" in err or "labels.nrrd: like is for DICOM" in err
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path)
    assert palpate([*words, "--like", "ct"], monkeypatch, capsys)[0] == 0
    assert np.array_equal(pp.read_labels("seg.dcm").values.any(axis=(1, 2)), np.arange(7) > 2)
