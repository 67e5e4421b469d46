"""TIFF and OME-Zarr: values to the bit, the place kept, the voxel size where other readers look for it."""

import json
import lzma
import os
import shutil
import sys

import numpy as np
import pytest
import tifffile
from fuzz.hostile.tiff_and_dicom import plain_tiff
from scipy.spatial.transform import Rotation

import palpate as pp
from palpate.errors import FileError

TURN = Rotation.from_euler("xyz", [20, -35, 50], degrees=True).as_matrix()
GRID = pp.Grid((4, 5, 6), (1.5, 0.7, 0.4), (10, -20, 30), TURN)
VALUES = np.random.default_rng(5).random(GRID.shape, dtype=np.float32)
NAMES = ["v.tif", "v.tiff", "v.ome.tif", "v.zarr", "v.ome.zarr"]


@pytest.fixture(autouse=True)
def _zarr():
    pytest.importorskip("zarr")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("unit", ["1/mm", "HU"])
def test_a_volume_comes_back_to_the_bit_with_its_place_and_unit(tmp_path, name, unit):
    pp.write_volume(tmp_path / name, pp.Volume(VALUES, GRID, unit))
    back = pp.read_volume(tmp_path / name)
    assert np.array_equal(back.values, VALUES)
    assert (back.grid.spacing, back.grid.origin, back.unit) == (GRID.spacing, GRID.origin, unit)
    assert np.allclose(back.grid.direction, GRID.direction, rtol=0, atol=1e-15)
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_tifffile_and_itk_find_the_voxels_and_their_size(tmp_path):
    sitk = pytest.importorskip("SimpleITK")
    for name in ("v.tif", "v.ome.tif"):
        pp.write_volume(tmp_path / name, pp.Volume(VALUES, GRID))
        assert np.array_equal(sitk.GetArrayFromImage(sitk.ReadImage(str(tmp_path / name))), VALUES)
    with tifffile.TiffFile(tmp_path / "v.tif") as tif:
        assert tif.imagej_metadata["spacing"] == 1.5
        assert tif.imagej_metadata["unit"] == "mm"
        across, down = (tif.pages[0].tags[k].value for k in ("XResolution", "YResolution"))
        assert np.allclose([across[1] / across[0], down[1] / down[0]], [0.4, 0.7], rtol=1e-5)
    said = tifffile.TiffFile(tmp_path / "v.ome.tif").ome_metadata
    for axis, length in zip("ZYX", GRID.spacing, strict=True):
        assert f'PhysicalSize{axis}="{length}"' in said
        assert f'PhysicalSize{axis}Unit="mm"' in said


def test_zarr_finds_voxels_scale_and_shift(tmp_path):
    import zarr

    pp.write_volume(tmp_path / "v.ome.zarr", pp.Volume(VALUES, GRID))
    group = zarr.open_group(tmp_path / "v.ome.zarr", mode="r")
    image = group.attrs["multiscales"][0]
    assert np.array_equal(group[image["datasets"][0]["path"]][...], VALUES)
    scale, shift = image["datasets"][0]["coordinateTransformations"]
    assert tuple(scale["scale"]) == GRID.spacing
    assert tuple(shift["translation"]) == GRID.origin[::-1]
    assert [(a["name"], a["unit"]) for a in image["axes"]] == [(n, "millimeter") for n in "zyx"]
    assert image["version"] == "0.4"


def test_other_makers_files_are_read(tmp_path):
    import zarr

    said = {"axes": "ZYX", "spacing": 0.2, "unit": "cm"}
    tifffile.imwrite(tmp_path / "ij.tif", VALUES, imagej=True, resolution=(25, 10), metadata=said)
    assert pp.read_volume(tmp_path / "ij.tif").grid == pp.Grid(VALUES.shape, (2, 1, 0.4))
    group = zarr.open_group(tmp_path / "v.zarr", mode="w", zarr_format=3)
    data = np.arange(24, dtype=np.int16).reshape(1, 2, 3, 4)
    group.create_array("s0", data=data)
    axes = [{"name": "c", "type": "channel"}, *({"name": n, "type": "space", "unit": "micrometer"} for n in "zyx")]
    scale = {"type": "scale", "scale": [1, 500.0, 250.0, 125.0]}
    group.attrs["ome"] = {
        "version": "0.5",
        "multiscales": [{"axes": axes, "datasets": [{"path": "s0", "coordinateTransformations": [scale]}]}],
    }
    back = pp.read_volume(tmp_path / "v.zarr")
    assert np.array_equal(back.values, data[0])
    assert back.grid == pp.Grid((2, 3, 4), (0.5, 0.25, 0.125))


def test_without_zarr_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(FileError, match=r"pip install 'palpate\[zarr\]'"):
        pp.write_volume(tmp_path / "v.zarr", pp.Volume(VALUES, GRID))
    assert list(tmp_path.iterdir()) == []


def test_a_spacing_edited_in_another_program_is_heeded(tmp_path):
    """Our own text no longer fits then, and does not win."""
    import zarr

    pp.write_volume(tmp_path / "v.zarr", pp.Volume(VALUES, GRID))
    group = zarr.open_group(tmp_path / "v.zarr", mode="r+")
    images = group.attrs["multiscales"]
    images[0]["datasets"][0]["coordinateTransformations"][0]["scale"] = [3, 0.7, 0.4]
    group.attrs["multiscales"] = images
    assert pp.read_volume(tmp_path / "v.zarr").grid == pp.Grid(GRID.shape, (3, 0.7, 0.4), GRID.origin)


def truncated(path):
    path.write_bytes(path.read_bytes()[:700])


def without(path, name):
    next(path.rglob(name)).unlink()


def edited(path, key):
    said = json.loads((path / ".zattrs").read_text())
    del said["multiscales"][0][key]
    (path / ".zattrs").write_text(json.dumps(said))


REFUSED = {
    "cut": ("v.tif", truncated, r"v\.tif: truncated"),
    "cut OME": ("v.ome.tif", truncated, r"v\.ome\.tif: (truncated|says no voxel size)"),
    "no TIFF": ("v.tif", lambda p: p.write_text("x" * 99), r"v\.tif: not a whole TIFF"),
    "no size": ("v.tif", lambda p: tifffile.imwrite(p, VALUES, photometric="minisblack"), "no voxel size"),
    "no unit": ("v.tif", lambda p: tifffile.imwrite(p, VALUES, imagej=True, metadata={"axes": "ZYX"}), "no voxel size"),
    "no group": ("v.zarr", lambda p: without(p, ".zgroup"), "not an OME-Zarr folder"),
    "no array": ("v.zarr", lambda p: shutil.rmtree(p / "0"), "not a whole OME-Zarr"),
    "no axes": ("v.zarr", lambda p: edited(p, "axes"), "not a whole OME-Zarr"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_with_name_and_remedy(tmp_path, case):
    name, spoil, words = REFUSED[case]
    pp.write_volume(tmp_path / name, pp.Volume(VALUES, GRID))
    spoil(tmp_path / name)
    with pytest.raises(FileError, match=words):
        pp.read_volume(tmp_path / name)


def test_a_zarr_folder_that_lies_is_refused(tmp_path):
    """A chunk that is a pipe would be waited for; one chunk cannot be a terabyte; none at all can be a small volume."""
    pp.write_volume(tmp_path / "v.zarr", pp.Volume(VALUES, GRID))
    (chunk,) = (p for p in (tmp_path / "v.zarr" / "0").rglob("*") if p.is_file() and not p.name.startswith("."))
    chunk.unlink()
    assert (pp.read_volume(tmp_path / "v.zarr").values == 0).all()
    os.mkfifo(chunk)
    with pytest.raises(FileError, match=r"v\.zarr: .* in it is a pipe or a device"):
        pp.read_volume(tmp_path / "v.zarr")
    chunk.unlink()
    head = tmp_path / "v.zarr" / "0" / ".zarray"
    head.write_text(json.dumps({**json.loads(head.read_text()), "shape": [2**20, 2**10, 2**10]}))
    with pytest.raises(FileError, match=r"v\.zarr: says \(1048576, 1024, 1024\) voxels, 4398046511104 bytes"):
        pp.read_volume(tmp_path / "v.zarr")


@pytest.mark.parametrize("packed", [lzma.compress(bytes(2**28)), lzma.compress(bytes(1024)) * 2])
def test_lzma_is_unpacked_no_further_than_its_page(tmp_path, packed):
    """One stream may swell, and streams may follow each other."""
    imagej = b"ImageJ=1.11a\nimages=2\nslices=2\nunit=mm\nspacing=1.0\n"
    plain_tiff(tmp_path / "v.tif", lzma.compress(bytes(1024)), compression=34925, description=imagej)
    assert pp.read_volume(tmp_path / "v.tif").grid.shape == (2, 16, 16)
    plain_tiff(tmp_path / "v.tif", packed, compression=34925, description=imagej)
    with pytest.raises(FileError, match="go on after the 1024 bytes"):
        pp.read_volume(tmp_path / "v.tif")
