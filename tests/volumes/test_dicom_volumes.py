"""Volumes in DICOM: what is written passes a validator and other readers; what others write is read or refused."""

import io
from types import SimpleNamespace

import numpy as np
import pydicom
import pytest
from PIL import Image
from pydicom.uid import (
    DeflatedExplicitVRLittleEndian,
    ExplicitVRBigEndian,
    ImplicitVRLittleEndian,
    JPEG2000Lossless,
    JPEGBaseline8Bit,
    JPEGLSLossless,
    RLELossless,
)
from scipy.spatial.transform import Rotation
from support.dicom_files import CT, ENHANCED_CT, MR, changed, complaints, ct_slice, item, save

import palpate as pp
from palpate.errors import DataError, FileError, GeometryError
from palpate.volumes.dicom_write import quantized

TURN = Rotation.from_euler("xyz", [20, -35, 50], degrees=True).as_matrix()
GRID = pp.Grid((4, 5, 6), (1.5, 0.7, 0.4), (10, -20, 30), TURN)
FORMS = ["v.dcm", "ct"]


def marked(unit="1/mm"):
    """No symmetry, and nothing that 16 bits hold exactly."""
    values = np.random.default_rng(3).uniform(0.01, 0.06, GRID.shape)
    return pp.Volume(values if unit == "1/mm" else np.rint(values * 1e5) - 1024, GRID, unit)


def files(path):
    return sorted(path.iterdir()) if path.is_dir() else [path]


# --- round trips -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FORMS)
def test_values_come_back_to_half_a_step_and_then_for_ever(tmp_path, name):
    pp.write_volume(tmp_path / name, marked())
    back = pp.read_volume(tmp_path / name)
    q, slope, intercept = quantized(marked().values)
    assert slope <= 1e-6  # of a range of 0.05
    assert np.abs(back.values - marked().values).max() <= 0.5001 * slope
    assert np.array_equal(back.values, np.float32(slope * q.astype(np.float64) + intercept))
    assert back.unit == "1/mm"
    assert back.grid.spacing == GRID.spacing
    assert np.allclose(back.grid.origin, GRID.origin, rtol=0, atol=1e-12)
    assert np.allclose(back.grid.direction, GRID.direction, rtol=0, atol=1e-13)
    pp.write_volume(tmp_path / f"again-{name}", back)
    assert np.array_equal(pp.read_volume(tmp_path / f"again-{name}").values, back.values)
    assert {p.name for p in tmp_path.iterdir()} == {name, f"again-{name}"}


@pytest.mark.parametrize("name", FORMS)
def test_whole_hounsfield_units_are_exact(tmp_path, name):
    pp.write_volume(tmp_path / name, marked("HU"))
    back = pp.read_volume(tmp_path / name)
    assert np.array_equal(back.values, marked("HU").values)
    assert back.unit == "HU"


@pytest.mark.parametrize(
    "values", [[0.0, 0.0], [0.02, 0.02], [-1e-30, 1e30], [3.5, 4.5], [1e7, 1e7 + 1], [-5, 70000.5]]
)
def test_any_range_is_held_to_half_a_step(values):
    volume = np.float32(np.resize(values, (1, 2, 3)))
    q, slope, intercept = quantized(volume)
    assert np.abs(slope * q.astype(np.float64) + intercept - volume).max() <= 0.501 * slope
    assert slope == 1 or slope * 65536 <= 5.1 * np.ptp(volume.astype(np.float64))
    assert len(str(pydicom.valuerep.DS(slope, auto_format=True))) <= 16


@pytest.mark.parametrize("name", FORMS)
@pytest.mark.parametrize("unit", ["1/mm", "HU"])
def test_the_validator_finds_no_error(tmp_path, name, unit):
    pp.write_volume(tmp_path / name, marked(unit))
    for path in files(tmp_path / name):
        assert complaints(path) == []


def test_the_validator_does_find_errors(tmp_path):
    pp.write_volume(tmp_path / "v.dcm", marked())
    assert complaints(changed(tmp_path / "v.dcm", ContentQualification=None))


def test_tags_of_the_caller_are_written_and_nothing_else_of_a_patient(tmp_path):
    tags = {"PatientID": "7", "PatientName": "A^B", "FrameLaterality": "L", "ViewPosition": "MLO"}
    pp.write_volume(tmp_path / "v.dcm", marked(), tags)
    dataset = pydicom.dcmread(tmp_path / "v.dcm")
    assert (dataset.PatientID, dataset.PatientName) == ("7", "A^B")
    assert dataset.SharedFunctionalGroupsSequence[0].FrameAnatomySequence[0].FrameLaterality == "L"
    assert dataset.ViewCodeSequence[0].CodeMeaning == "medio-lateral oblique"
    assert complaints(tmp_path / "v.dcm") == []
    pp.write_volume(tmp_path / "w.dcm", marked())
    other = pydicom.dcmread(tmp_path / "w.dcm")
    assert other.PatientID == ""
    assert other.ImageType[0] == "DERIVED"
    assert (other.BurnedInAnnotation, other.LossyImageCompression) == ("NO", "00")
    assert other.SharedFunctionalGroupsSequence[0].DerivationImageSequence[0].DerivationDescription
    for uid in ("SOPInstanceUID", "SeriesInstanceUID", "StudyInstanceUID", "FrameOfReferenceUID"):
        assert dataset[uid].value != other[uid].value
    for bad, words in (({"PatientID": "7"}, "tags are DICOM's"), ({"NoSuchTag": "7"}, "NoSuchTag")):
        with pytest.raises(DataError, match=words):
            pp.write_volume(tmp_path / ("v.nii" if words[0] == "t" else "x.dcm"), marked(), bad)
    with pytest.raises(DataError, match="ViewPosition is one of CC"):
        pp.write_volume(tmp_path / "x.dcm", marked(), {"ViewPosition": "AP"})
    assert {p.name for p in tmp_path.iterdir()} == {"v.dcm", "w.dcm"}


def test_pydicom_finds_every_voxel_at_its_place(tmp_path):
    pp.write_volume(tmp_path / "ct", marked())
    for path in files(tmp_path / "ct"):
        d = pydicom.dcmread(path)
        row, column = np.reshape(d.ImageOrientationPatient, (2, 3)).astype(float)
        for j, i in [(0, 0), (1, 5), (4, 0)]:
            place = (
                np.array(d.ImagePositionPatient, float) + i * d.PixelSpacing[1] * row + j * d.PixelSpacing[0] * column
            )
            k, jj, ii = GRID.indices(place)[0]
            assert np.allclose([k, jj, ii], [d.InstanceNumber - 1, j, i], atol=1e-9)
            value = d.pixel_array[j, i] * d.RescaleSlope + d.RescaleIntercept
            assert abs(value - marked().values[round(k), j, i]) <= 0.5001 * d.RescaleSlope


@pytest.mark.parametrize("name", FORMS)
def test_itk_finds_every_voxel_at_its_place(tmp_path, name):
    sitk = pytest.importorskip("SimpleITK")
    pp.write_volume(tmp_path / name, marked())
    image = sitk.ReadImage([str(p) for p in files(tmp_path / name)] if name == "ct" else str(tmp_path / name))
    back = pp.read_volume(tmp_path / name).values
    q = quantized(marked().values)[0]
    for k, j, i in [(0, 0, 0), (3, 1, 5), (2, 4, 0)]:
        assert np.allclose(image.TransformIndexToPhysicalPoint((i, j, k)), GRID.points([k, j, i])[0], atol=1e-4)
        seen = image[i, j, k]  # ITK heeds the rescaling of CT; of a tomosynthesis it shows the stored numbers
        assert np.isclose(seen, back[k, j, i], atol=1e-7) if name == "ct" else seen == q[k, j, i]


# --- what others write -----------------------------------------------------------------------------------------------


STACK = np.random.default_rng(1).integers(0, 4000, (4, 5, 6)).astype(np.uint16)


def series(folder, order=(2, 0, 3, 1), axes=(1, 0, 0, 0, 1, 0), step=(0, 0, 2.5), **tags):
    folder.mkdir(exist_ok=True)
    for n, k in enumerate(order):
        ct_slice(folder / f"{n}", STACK[k], 10 + k * np.array(step), axes, InstanceNumber=n, **tags)
    return folder


def test_slices_are_sorted_by_place_not_by_name(tmp_path):
    volume = pp.read_volume(series(tmp_path / "s"))
    assert np.array_equal(volume.values, STACK.astype(np.float32) - 1024)
    assert volume.grid == pp.Grid((4, 5, 6), (2.5, 0.7, 0.4), (10, 10, 10))
    assert volume.unit == "HU"
    same = pp.read_volume(tmp_path / "s" / "2")  # one slice stands for its series
    assert np.array_equal(same.values, volume.values)


@pytest.mark.parametrize(
    ("axes", "step"),
    [((0, 1, 0, 0, 0, -1), (2.5, 0, 0)), ((1, 0, 0, 0, 0, -1), (0, 2.5, 0)), ((-1, 0, 0, 0, 1, 0), (0, 0, 2.5))],
)
def test_any_orientation_keeps_every_voxel_at_its_place(tmp_path, axes, step):
    volume = pp.read_volume(series(tmp_path / "s", axes=axes, step=step))
    row, column = np.reshape(axes, (2, 3))
    for k, j, i in [(0, 0, 0), (3, 1, 5), (2, 4, 0)]:
        place = 10 + k * np.array(step) + i * 0.4 * row + j * 0.7 * column
        at = volume.grid.indices(place)[0]
        assert np.allclose(at, np.round(at), atol=1e-6)
        assert volume.values[tuple(np.round(at).astype(int))] == STACK[k, j, i] - 1024.0


def test_an_overview_and_other_files_in_the_folder_are_passed_over(tmp_path):
    folder = series(tmp_path / "s")
    ct_slice(folder / "scout", STACK[0], ImageType=["ORIGINAL", "PRIMARY", "LOCALIZER"])
    (folder / "notes.txt").write_text("not DICOM")
    assert pp.read_volume(folder).grid.shape == (4, 5, 6)


def enhanced(path, stack=STACK, **tags):
    """Frames in an order of their own, as enhanced CT keeps them."""
    order = [2, 0, 3, 1]
    scale = item(RescaleSlope=2, RescaleIntercept=-1000, RescaleType="HU")
    shared = item(
        PixelMeasuresSequence=[item(PixelSpacing=[0.7, 0.4], SliceThickness=2.5)],
        PlaneOrientationSequence=[item(ImageOrientationPatient=[1, 0, 0, 0, 1, 0])],
        PixelValueTransformationSequence=[scale],
    )
    frames = [item(PlanePositionSequence=[item(ImagePositionPatient=[10, 10, 10 + 2.5 * k])]) for k in order]
    given = {"Modality": "CT", "SharedFunctionalGroupsSequence": [shared], "PerFrameFunctionalGroupsSequence": frames}
    return save(path, ENHANCED_CT, stack[order], **{**given, **tags})


def test_deflated_and_big_endian_files_are_read(tmp_path):
    for k, syntax in enumerate((DeflatedExplicitVRLittleEndian, ImplicitVRLittleEndian, ExplicitVRBigEndian)):
        folder = tmp_path / str(k)
        folder.mkdir()
        dataset = pydicom.dcmread(ct_slice(folder / "a", STACK[0]))
        if syntax == ExplicitVRBigEndian:
            dataset.PixelData = STACK[0].astype(">u2").tobytes()
        dataset.file_meta.TransferSyntaxUID = syntax
        pydicom.dcmwrite(
            folder / "a", dataset, implicit_vr=syntax.is_implicit_VR, little_endian=syntax.is_little_endian
        )
        assert np.array_equal(pp.read_volume(folder).values[0], STACK[0].astype(np.float32) - 1024)


def test_an_image_of_lossy_jpeg_is_read(tmp_path):
    smooth = np.add.outer(np.arange(64), np.arange(64)).astype(np.uint8)
    stream = io.BytesIO()
    Image.fromarray(smooth).save(stream, "JPEG", quality=95)
    path = ct_slice(tmp_path / "a", smooth, BitsAllocated=8, BitsStored=8, HighBit=7, RescaleIntercept=0)
    dataset = pydicom.dcmread(path)
    dataset.PixelData = pydicom.encaps.encapsulate([stream.getvalue()])
    dataset["PixelData"].VR = "OB"
    dataset.file_meta.TransferSyntaxUID = JPEGBaseline8Bit
    dataset.save_as(path)
    assert np.abs(pp.read_volume(path).values[0] - smooth).max() < 8


@pytest.mark.parametrize("syntax", [None, RLELossless, JPEG2000Lossless])
def test_enhanced_multi_frame_ct_is_read_compressed_too(tmp_path, syntax):
    stack = np.tile(STACK, (1, 13, 11)) if syntax else STACK  # JPEG 2000 needs 64 pixels a side
    volume = pp.read_volume(enhanced(tmp_path / "e.dcm", stack, **({"syntax": syntax} if syntax else {})))
    assert np.array_equal(volume.values, 2 * stack.astype(np.float32) - 1000)
    assert volume.grid == pp.Grid(stack.shape, (2.5, 0.7, 0.4), (10, 10, 10))


def test_signed_pixels_with_overlay_bits_are_read(tmp_path):
    """12 bits of 16, signed; something else lies in the other four."""
    pixels = (STACK[0].astype(np.int16) & 0x0FFF) | 0x3000
    path = ct_slice(tmp_path / "a", pixels, BitsStored=12, HighBit=11, RescaleIntercept=0)
    values = STACK[0].astype(int) & 0x0FFF
    assert np.array_equal(pp.read_volume(path).values[0], np.where(values >= 2048, values - 4096, values))


def test_the_unit_of_display_values_is_no_attenuation(tmp_path):
    path = changed(ct_slice(tmp_path / "a", STACK[0]), RescaleType="US")
    assert pp.read_volume(path).unit == "stored values"


# --- what is refused -------------------------------------------------------------------------------------------------


BROKEN = {
    "missing slice": (
        lambda f: (f / "0").unlink(),
        FileError,
        r"5 mm from .*/3 to .*/2, 2.5 mm between other slices: slices are",
    ),
    "twice": (lambda f: changed(f / "0", ImagePositionPatient=[10, 10, 10]), FileError, "lies where .* does"),
    "two series": (lambda f: changed(f / "0", SeriesInstanceUID="9.9"), FileError, r"holds 2 series.*\(3 files\)"),
    "shape": (lambda f: ct_slice(f / "0", STACK[2, 1:], (10, 10, 15)), FileError, r"pixels \[5, 6\], but \[4, 6\]"),
    "spacing": (lambda f: changed(f / "3", PixelSpacing=[0.7, 0.5]), FileError, r"3: mm between pixels \[0.7, 0.5\]"),
    "turned": (lambda f: changed(f / "3", ImageOrientationPatient=[0, 1, 0, 1, 0, 0]), FileError, "3: orientation"),
    "units": (lambda f: changed(f / "3", RescaleType="US"), FileError, "values in stored values, but in HU"),
    "modality": (
        lambda f: changed(f / "2", SOPClassUID=MR, Modality="MR"),
        DataError,
        r"2: SOP Class UID \(0008,0016\).*MR",
    ),
    "projection": (lambda f: changed(f / "2", SOPClassUID="1.2.840.10008.5.1.4.1.1.1.2.1"), DataError, "scan import"),
    "cut": (lambda f: (f / "2").write_bytes((f / "2").read_bytes()[:-9]), FileError, "2: .*(truncated|damaged).*again"),
    "half": (
        lambda f: (f / "2").write_bytes((f / "2").read_bytes()[:300]),
        FileError,
        r"2: lacks Series Instance UID \(0020,000E\)",
    ),
    "no place": (
        lambda f: changed(f / "2", ImagePositionPatient=None),
        FileError,
        r"2: lacks Image Position \(Patient\) \(0020,0032\)",
    ),
    "no axes": (lambda f: changed(f / "2", ImageOrientationPatient=None), FileError, r"\(0020,0037\)"),
    "no spacing": (lambda f: changed(f / "2", PixelSpacing=None), FileError, r"Pixel Spacing \(0028,0030\)"),
    "no pixels": (lambda f: changed(f / "2", PixelData=None), FileError, r"Pixel Data \(7FE0,0010\)"),
    "no rows": (lambda f: changed(f / "2", Rows=None), FileError, r"Rows \(0028,0010\)"),
    "huge": (lambda f: changed(f / "2", Rows=60000, Columns=60000), FileError, "7200000000 expected"),
    "NaN": (
        lambda f: changed(f / "2", RescaleSlope="nan"),
        FileError,
        r"Rescale Slope \(0028,1053\) is .*expected 1 finite",
    ),
    "place of 2": (
        lambda f: changed(f / "2", ImagePositionPatient=[1, 2]),
        FileError,
        r"\(0020,0032\).*expected 3 finite",
    ),
    "sheared": (None, FileError, "not orthogonal"),
    "empty": (lambda f: [p.unlink() for p in f.iterdir()], FileError, "no DICOM file in this folder"),
}


@pytest.mark.parametrize("case", BROKEN)
@pytest.mark.filterwarnings("ignore:Invalid value for VR")
def test_a_series_that_makes_no_volume_is_refused(tmp_path, case):
    spoil, kind, words = BROKEN[case]
    folder = series(tmp_path / "s", step=(0, 1, 2.5) if case == "sheared" else (0, 0, 2.5))
    if spoil:
        spoil(folder)
    with pytest.raises(kind, match=words):
        pp.read_volume(folder)


def test_refusals_of_one_file(tmp_path):
    lone = ct_slice(tmp_path / "a", STACK[0], SliceThickness=None)
    with pytest.raises(FileError, match=r"one slice without Spacing Between Slices \(0018,0088\)"):
        pp.read_volume(lone)
    (tmp_path / "b.dcm").write_bytes(b"x" * 999)
    with pytest.raises(FileError, match=r"b\.dcm: not a DICOM file"):
        pp.read_volume(tmp_path / "b.dcm")
    with pytest.raises(FileError, match=r"c\.dcm: no such file"):
        pp.read_volume(tmp_path / "c.dcm")
    far = changed(enhanced(tmp_path / "e.dcm"), NumberOfFrames=3_000_000)
    with pytest.raises(FileError, match=r"e\.dcm: truncated"):
        pp.read_volume(far)
    wide = ct_slice(
        tmp_path / "w" if (tmp_path / "w").mkdir() else tmp_path / "w" / "1", STACK[0], PixelSpacing=[9e3, 9e3]
    )
    with pytest.raises(GeometryError, match=r"check the units"):
        pp.read_volume(wide)


def test_a_compression_without_decoder_says_what_to_install(tmp_path, monkeypatch):
    path = enhanced(tmp_path / "e.dcm", syntax=RLELossless)
    monkeypatch.setattr("palpate.volumes.dicom_io.get_decoder", lambda syntax: SimpleNamespace(is_available=False))
    with pytest.raises(FileError, match=r"compressed as RLE Lossless.*pip install python-gdcm, or export it"):
        pp.read_volume(path)
    dataset = pydicom.dcmread(path)
    dataset.file_meta.TransferSyntaxUID = JPEGLSLossless
    dataset.save_as(path)
    with pytest.raises(FileError, match=r"compressed as JPEG-LS Lossless.*pip install pyjpegls"):
        pp.read_volume(path)


def test_compressed_pixels_that_cannot_be_so_small_are_refused(tmp_path):
    path = changed(enhanced(tmp_path / "e.dcm", syntax=RLELossless), Rows=65000, Columns=65000)
    with pytest.raises(FileError, match=r"says \(4, 65000, 65000\) pixels"):
        pp.read_volume(path)


def test_a_folder_with_files_is_never_written_over(tmp_path):
    (tmp_path / "ct").mkdir()
    pp.write_volume(tmp_path / "ct", marked())  # an empty one is taken
    assert len(files(tmp_path / "ct")) == 4
    with pytest.raises(FileError, match="ct: is there and holds files; remove it"):
        pp.write_volume(tmp_path / "ct", marked())
    with pytest.raises(FileError, match="does not exist; make it first"):
        pp.write_volume(tmp_path / "none" / "ct", marked())
    (tmp_path / "plain").write_text("kept")
    with pytest.raises(FileError, match="plain: is a file"):
        pp.write_volume(tmp_path / "plain", marked())
    with pytest.raises(FileError, match=r"cannot tell"):
        pp.write_labels(tmp_path / "labels", pp.Labels(np.zeros(GRID.shape, int), GRID))
    assert pydicom.dcmread(files(tmp_path / "ct")[0]).SOPClassUID == CT
    assert sorted(p.name for p in tmp_path.iterdir()) == ["ct", "plain"]
