"""What napari gets of palpate's files, and what comes back from its layers. No napari is needed."""

from importlib.metadata import entry_points
from importlib.resources import files
from types import SimpleNamespace

import nibabel as nib
import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from support.example_organs import ellipsoid

import palpate as pp
from palpate.napari_plugin.layers import affine_of, grid_of, labels_of
from palpate.napari_plugin.readers import get_reader


def in_viewer(data, affine, name="drawn"):
    """What this needs of a layer of napari."""
    return SimpleNamespace(data=data, name=name, data_to_world=lambda index: (affine @ [*index, 1])[:3])


def grid_turned(seed):
    random = np.random.default_rng(seed)
    turn = Rotation.random(random_state=seed).as_matrix()
    return pp.Grid((3, 4, 5), random.uniform(0.2, 5, 3), random.uniform(-200, 200, 3), turn)


@given(st.integers(0, 2**31))
def test_a_voxel_lies_in_the_viewer_where_it_lies_in_the_patient(seed):
    grid = grid_turned(seed)
    index = np.stack(np.indices(grid.shape), axis=-1).reshape(-1, 3)
    there = index @ affine_of(grid)[:3, :3].T + affine_of(grid)[:3, 3]
    np.testing.assert_allclose(there[:, ::-1], grid.points(index), atol=1e-9)
    assert grid_of(in_viewer(np.zeros(grid.shape), affine_of(grid))) == grid


def test_what_cannot_be_a_grid_is_said():
    sheared = np.eye(4)
    sheared[0, 1] = 0.3
    with pytest.raises(pp.errors.DataError, match="layer drawn: its axes are not square"):
        grid_of(in_viewer(np.zeros((2, 3, 4)), sheared))
    with pytest.raises(pp.errors.GeometryError, match="mirrors"):
        grid_of(in_viewer(np.zeros((2, 3, 4)), np.diag([1.0, 1.0, -1.0, 1.0])))
    with pytest.raises(pp.errors.DataError, match="2 axes"):
        grid_of(in_viewer(np.zeros((2, 3)), np.eye(4)))


@pytest.mark.parametrize("suffix", ["nii.gz", "nrrd", "mha"])
def test_volumes_are_images_and_labels_are_labels(tmp_path, suffix):
    grid = grid_turned(5)
    values = np.random.default_rng(0).uniform(0, 0.05, grid.shape).astype(np.float32)
    pp.write_volume(tmp_path / f"volume.{suffix}", pp.Volume(values, grid))
    pp.write_labels(
        tmp_path / f"organs.{suffix}", pp.Labels(np.arange(60).reshape(grid.shape) % 3, grid, {1: "liver", 2: "vein"})
    )
    ((data, keywords, kind),) = get_reader(str(tmp_path / f"volume.{suffix}"))(None)
    assert (kind, keywords["name"]) == ("image", "volume")
    np.testing.assert_array_equal(data, values)
    np.testing.assert_allclose(keywords["affine"], affine_of(grid), atol=1e-4)
    ((data, keywords, kind),) = get_reader([str(tmp_path / f"organs.{suffix}")])(None)
    assert (kind, keywords["name"]) == ("labels", "organs")
    assert data.max() == 2
    again = labels_of(in_viewer(data, keywords["affine"]))
    assert again.grid == grid


def test_another_library_s_file_lies_where_it_says(tmp_path):
    """The corner of a NIfTI file (RAS) by its own affine."""
    affine = np.diag([2.0, 3.0, 4.0, 1.0])
    affine[:3, 3] = 10, 20, 30
    nib.save(nib.Nifti1Image(np.random.default_rng(0).normal(size=(5, 6, 7)), affine), tmp_path / "a.nii")
    ((data, keywords, _),) = get_reader(str(tmp_path / "a.nii"))(None)
    stored = np.asarray(nib.load(tmp_path / "a.nii").dataobj)
    index = (4, 2, 3)  # x, y, z of the file
    x, y, z = (affine @ [*index, 1])[:3] * (-1, -1, 1)
    at = np.rint(np.linalg.solve(keywords["affine"], [z, y, x, 1]))[:3].astype(int)
    assert data[tuple(at)] == pytest.approx(stored[index], rel=1e-6)


def test_a_scan_is_its_line_integrals(tmp_path):
    panel = pp.Panel((6, 8), (2.0, 3.0), (0.0, 0.0, 0.0))
    views = pp.arc_views(panel, [-5, 0, 5], radius=500, pivot=(0, 0, 20))
    lines = np.random.default_rng(1).uniform(0, 3, views.shape)
    pp.write_scan(tmp_path / "scan.h5", pp.Scan(1000 * np.exp(-lines), 1000, views))
    ((data, keywords, kind),) = get_reader(str(tmp_path / "scan.h5"))(None)
    np.testing.assert_allclose(data, lines, rtol=1e-4, atol=1e-5)
    assert (kind, keywords["scale"]) == ("image", (1.0, 2.0, 3.0))


def test_a_mesh_is_its_surface_with_normals_outwards(tmp_path):
    mesh = ellipsoid(6)
    pp.write_mesh(tmp_path / "organ.vtu", mesh)
    (((points, faces), keywords, kind),) = get_reader(str(tmp_path / "organ.vtu"))(None)
    assert (kind, keywords["name"]) == ("surface", "organ")
    a, b, c = (points[faces[:, k]] for k in range(3))
    enclosed = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    assert enclosed == pytest.approx(mesh.volumes.sum(), rel=1e-9)


def test_other_files_are_left_to_others(tmp_path):
    (tmp_path / "pictures").mkdir()
    for path in (tmp_path / "pictures", tmp_path / "a.png", tmp_path / "b.czi"):
        assert get_reader(str(path)) is None
    (tmp_path / "bad.h5").write_bytes(b"nothing")
    with pytest.raises(pp.errors.FileError, match="no HDF5 file"):
        get_reader(str(tmp_path / "bad.h5"))(None)


def test_napari_finds_the_plugin_and_all_that_it_names():
    (found,) = entry_points(group="napari.manifest", name="palpate")
    package, _, name = found.value.partition(":")
    manifest = yaml.safe_load((files(package) / name).read_text())
    commands = {one["id"]: one["python_name"] for one in manifest["contributions"]["commands"]}
    for kind in ("readers", "widgets", "sample_data"):
        for one in manifest["contributions"][kind]:
            assert one["command"] in commands
    for python_name in commands.values():
        module, _, name = python_name.partition(":")
        folder, _, file = module.rpartition(".")
        source = (files(folder) / f"{file}.py").read_text()
        assert f"def {name}(" in source or f"class {name}(" in source
