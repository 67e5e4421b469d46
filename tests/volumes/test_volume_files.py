"""Volumes on disk: a voxel keeps its place in the patient through every format and every reader."""

import gzip

import nibabel
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import palpate as pp
from palpate.errors import DataError, FileError, GeometryError
from palpate.samples import sample

TURN = Rotation.from_euler("xyz", [20, -35, 50], degrees=True).as_matrix()
GRID = pp.Grid((4, 5, 6), (1.5, 0.7, 0.4), (10, -20, 30), TURN)
WRITTEN = [".nii", ".nii.gz", ".nrrd", ".mha"]


def marked():
    """No symmetry: every voxel has its own value."""
    return pp.Volume(np.arange(120.0).reshape(4, 5, 6) / 8, GRID)


@pytest.mark.parametrize("suffix", WRITTEN)
def test_a_volume_comes_back_with_its_place_and_unit(tmp_path, suffix):
    path = tmp_path / f"v.1{suffix}"
    pp.write_volume(path, marked())
    back = pp.read_volume(path)
    assert np.array_equal(back.values, marked().values)
    assert back.grid == GRID
    assert back.unit == "1/mm"
    pp.write_volume(path, pp.Volume(marked().values, GRID, "HU"))
    assert pp.read_volume(path).unit == "HU"
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix", [*WRITTEN, ".tif"])
def test_what_was_assumed_comes_back_with_a_volume(tmp_path, suffix):
    notes = {"scatter": "estimate", "beam": 'W/Rh = 29 kV; "µ"'}
    grid = GRID if suffix != ".tif" else pp.Grid((4, 5, 6), (1.5, 0.7, 0.4))
    pp.write_volume(tmp_path / f"v{suffix}", pp.Volume(marked().values, grid, notes=notes))
    back = pp.read_volume(tmp_path / f"v{suffix}")
    assert (back.notes, back.unit, back.grid) == (notes, "1/mm", grid)
    pp.write_volume(tmp_path / f"v{suffix}", pp.Volume(marked().values, grid))
    assert pp.read_volume(tmp_path / f"v{suffix}").notes == {}


@pytest.mark.parametrize("suffix", WRITTEN)
def test_labels_come_back_with_their_names(tmp_path, suffix):
    labels = pp.Labels(np.arange(120).reshape(4, 5, 6) * 3, GRID, {3: "left kidney", 300: "tumour"})
    pp.write_labels(tmp_path / f"l{suffix}", labels)
    back = pp.read_labels(tmp_path / f"l{suffix}")
    assert np.array_equal(back.values, labels.values)
    assert back.names == labels.names
    assert back.grid == GRID


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz"])
def test_nibabel_finds_every_voxel_at_its_place_in_ras(tmp_path, suffix):
    path = tmp_path / f"v{suffix}"
    pp.write_volume(path, marked())
    image = nibabel.load(path)
    assert image.header.get_xyzt_units()[0] == "mm"
    for affine in (image.affine, image.get_qform(), image.get_sform()):
        for k, j, i in [(0, 0, 0), (3, 1, 5), (2, 4, 0)]:
            left, posterior, superior = GRID.points([k, j, i])[0]
            assert np.allclose(affine @ [i, j, k, 1], [-left, -posterior, superior, 1], atol=1e-4)
            assert image.dataobj[i, j, k] == marked().values[k, j, i]


@pytest.mark.parametrize("suffix", WRITTEN)
def test_itk_finds_every_voxel_at_its_place_in_lps(tmp_path, suffix):
    sitk = pytest.importorskip("SimpleITK")
    pp.write_volume(tmp_path / f"v{suffix}", marked())
    image = sitk.ReadImage(str(tmp_path / f"v{suffix}"))
    for k, j, i in [(0, 0, 0), (3, 1, 5), (2, 4, 0)]:
        assert np.allclose(image.TransformIndexToPhysicalPoint((i, j, k)), GRID.points([k, j, i])[0], atol=1e-4)
        assert image[i, j, k] == marked().values[k, j, i]


@pytest.mark.parametrize("compressed", [True, False])
@pytest.mark.parametrize("suffix", [".nii.gz", ".nrrd", ".nhdr", ".mha", ".mhd"])
def test_what_itk_writes_is_read(tmp_path, suffix, compressed):
    sitk = pytest.importorskip("SimpleITK")
    image = sitk.GetImageFromArray((marked().values * 8).astype(np.int16))
    image.SetOrigin(GRID.origin)
    image.SetSpacing(GRID.spacing[::-1])
    image.SetDirection(GRID.direction.ravel().tolist())
    sitk.WriteImage(image, str(tmp_path / f"v{suffix}"), compressed)
    back = pp.read_volume(tmp_path / f"v{suffix}")
    assert np.array_equal(back.values, marked().values * 8)
    assert back.grid == GRID


@pytest.mark.parametrize("flips", [(1, 1, 1), (-1, 1, 1), (1, -1, 1), (1, 1, -1), (-1, -1, -1), (-1, -1, 1)])
@pytest.mark.parametrize("order", [(0, 1, 2), (1, 2, 0), (0, 2, 1)])
def test_any_storage_order_and_handedness_keeps_voxels_in_place(tmp_path, flips, order):
    affine = np.eye(4)
    affine[:3, :3] = (TURN * np.array([0.4, 0.7, 1.5]) * flips)[:, order]
    affine[:3, 3] = (7, 8, 9)
    data = np.arange(120.0, dtype=np.float32).reshape(4, 5, 6)
    nibabel.save(nibabel.Nifti1Image(data, affine), tmp_path / "v.nii")
    back = pp.read_volume(tmp_path / "v.nii")
    assert np.isclose(np.linalg.det(back.grid.direction), 1)
    for index in [(0, 0, 0), (3, 1, 5), (2, 4, 0)]:
        ras = (affine @ [*index, 1])[:3]
        k, j, i = np.round(back.grid.indices(ras * [-1, -1, 1])[0], 3)
        assert back.values[int(k), int(j), int(i)] == data[index]
        assert (k, j, i) == (int(k), int(j), int(i))


def test_header_slope_units_and_trailing_axis_are_heeded(tmp_path):
    image = nibabel.Nifti1Image(np.arange(24, dtype=np.int16).reshape(2, 3, 4, 1), np.diag([0.002, 0.003, 0.004, 1]))
    image.header.set_xyzt_units("meter")
    image.header.set_slope_inter(0.5, -1000)
    nibabel.save(image, tmp_path / "v.nii")
    back = pp.read_volume(tmp_path / "v.nii")
    assert np.allclose(back.grid.spacing, (4, 3, 2))
    assert back.values[3, 2, 1] == 0.5 * 23 - 1000
    assert back.unit == "HU"  # no attenuation is below 0
    assert pp.read_volume(tmp_path / "v.nii", unit="raw").unit == "raw"


def test_the_abdomen_sample_brings_its_organ_names():
    labels = pp.read_labels(sample("abdomen") / "labels.nii.gz")
    ct = pp.read_volume(sample("abdomen") / "ct.nii.gz")
    assert ct.grid == labels.grid
    assert ct.unit == "HU"
    left, right = (np.argwhere(labels.values == labels.value_of(f"kidney_{s}")) for s in ("left", "right"))
    assert (
        ct.grid.points(left.mean(axis=0))[0, 0] > ct.grid.points(right.mean(axis=0))[0, 0]
    )  # LPS: x grows to the left
    assert len(left) * 27 / 1000 == pytest.approx(137, abs=1)  # ml, counted by others


def cut(path, share):
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])


@pytest.mark.parametrize("share", [0.02, 0.6, 0.97])
@pytest.mark.parametrize("suffix", WRITTEN)
def test_a_truncated_file_is_named(tmp_path, suffix, share):
    path = tmp_path / f"v{suffix}"
    noise = np.random.default_rng(0).random((9, 20, 20), dtype=np.float32)
    pp.write_volume(path, pp.Volume(noise, pp.Grid(noise.shape, (1, 1, 1))))
    cut(path, share)
    with pytest.raises(FileError, match=rf"v{suffix}: .*(truncated|cut short|not a whole|lacks|not a Meta|again)"):
        pp.read_volume(path)


def nifti(path, data, affine=None):
    nibabel.save(nibabel.Nifti1Image(data, np.eye(4) if affine is None else affine), path)


SHEARED = np.eye(4) + np.eye(4, k=1) * 0.2
CUBE = np.zeros((3, 3, 3))
META = "NDims = 3\nElementDataFile = LOCAL\n"
NAN = np.array([[[0, np.nan]]], np.float32)
REFUSED = {
    "missing": ("v.nii", lambda p: None, FileError, ["no such file", "check the name"]),
    "format": ("v.png", lambda p: p.write_text("x"), FileError, ["cannot tell the format", ".nii.gz"]),
    "not NIfTI": ("v.nii", lambda p: p.write_text("x" * 999), FileError, ["NIfTI", "again"]),
    "not gzip": ("v.nii.gz", lambda p: p.write_text("x" * 999), FileError, ["NIfTI", "again"]),
    "not NRRD": ("v.nrrd", lambda p: p.write_text("x" * 999), FileError, ["not an NRRD", "xxx", "check the name"]),
    "not MHA": ("v.mha", lambda p: p.write_text("x" * 999), FileError, ["not a MetaImage", "check the name"]),
    "4-D": ("v.nii", lambda p: nifti(p, np.zeros((2, 3, 4, 5))), FileError, ["3 axes", "(2, 3, 4, 5)", "one volume"]),
    "sheared": ("v.nii", lambda p: nifti(p, CUBE, SHEARED), FileError, ["orthogonal", "0.19", "resample"]),
    "NaN": ("v.nii", lambda p: nifti(p, NAN), DataError, ["v.nii", "nan", "replace"]),
    "complex": ("v.nii", lambda p: nifti(p, CUBE.astype(complex)), DataError, ["complex128", "split"]),
    "metres": ("v.nii", lambda p: nifti(p, CUBE, 9e3 * np.eye(4)), GeometryError, ["27000", "check the units"]),
    "space": ("v.nrrd", lambda p: p.write_text(NRRD + "space: scanner-xyz\n\n" + 8 * "x"), FileError, ["scanner-xyz"]),
    "encoding": ("v.nrrd", lambda p: p.write_text(NRRD.replace("raw", "bz") + "\n"), FileError, ["'bz'", "as raw"]),
    "parted": ("v.nrrd", lambda p: p.write_text(NRRD + "data file: v.raw\n\n"), FileError, ["v.raw is not beside it"]),
    "no voxels": ("v.mhd", lambda p: p.write_text(META.replace("LOCAL", "v.raw")), FileError, ["v.raw", "one folder"]),
    "no sizes": ("v.mha", lambda p: p.write_text(META), FileError, ["DimSize", "again"]),
}  # fmt: skip
NRRD = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n"


@pytest.mark.parametrize("case", REFUSED)
def test_refused_with_name_value_and_remedy(tmp_path, case):
    name, make, kind, words = REFUSED[case]
    make(tmp_path / name)
    with pytest.raises(kind) as refusal:
        pp.read_volume(tmp_path / name)
    for word in [name, *words]:
        assert word in str(refusal.value)


def test_labels_must_be_whole_numbers(tmp_path):
    pp.write_volume(tmp_path / "v.nii", marked())
    with pytest.raises(DataError, match=r"v\.nii: labels: expected whole numbers.*segment the volume first"):
        pp.read_labels(tmp_path / "v.nii")


def test_a_volume_that_cannot_be_written_touches_nothing(tmp_path):
    (tmp_path / "file").write_text("kept")
    for path, words in [
        (tmp_path / "file" / "v.nii", "does not exist; make it first"),
        ("/proc/v.nii", "not writable"),
        (tmp_path / "v.mhd", r"cannot tell the format from its name; name it with one of .*\.mha, \.zarr"),
        (tmp_path / "v.h5", "cannot tell the format"),
    ]:
        with pytest.raises(FileError, match=words):
            pp.write_volume(path, marked())
    assert [p.name for p in tmp_path.iterdir()] == ["file"]
    assert (tmp_path / "file").read_text() == "kept"


def test_the_same_volume_gives_the_same_bytes(tmp_path):
    for suffix in WRITTEN:
        a, b = tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"
        pp.write_volume(a, marked())
        pp.write_volume(b, marked())
        if suffix == ".nii.gz":  # gzip keeps a name and a time in its header
            assert gzip.decompress(a.read_bytes()) == gzip.decompress(b.read_bytes())
        else:
            assert a.read_bytes() == b.read_bytes()
