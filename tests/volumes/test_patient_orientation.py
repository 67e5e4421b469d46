"""Left is left: marked phantoms from DICOM projections through reconstruction to the files that others read."""

import nibabel
import numpy as np
import pytest
from support.dicom_files import breast_projection, view

import palpate as pp

ANGLES = [-20, -10, 0, 10, 20]
SHAPE, PITCH, OPEN = (60, 64), 0.8, 50_000
# Marks of different weight in the patient, LPS mm above the panel: nothing is symmetric.
LEFT, FRONT, TOP = [13.0, -20, 14], [-9.0, -36, 14], [-9.0, -14, 26]
MARKS = {"left": LEFT, "front": FRONT, "top": TOP}


def shadow(source, corner, row, column, marks):
    """Counts behind three small balls of gaussian profile at `marks`: closed-form line integrals."""
    r, c = np.indices(SHAPE)
    pixels = corner + r[..., None] * PITCH * row + c[..., None] * PITCH * column
    rays = pixels - source
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    l = np.zeros(SHAPE)
    for weight, mark in zip((1, 0.8, 0.6), marks, strict=True):
        away = np.array(mark) - source
        squared = away @ away - (rays @ away) ** 2
        l += weight * np.exp(-squared / (2 * 2.5**2))
    return np.rint(OPEN * np.exp(-l)).astype(np.uint16)


def left_cranio_caudal(folder):
    """A file a view: rows of pixels to anterior, columns to the right; the tube from right to left."""
    folder.mkdir()
    corner = np.array([(SHAPE[0] - 1) / 2 * PITCH, -PITCH / 2, 0])
    for k, angle in enumerate(np.radians(ANGLES)):
        source = np.array([660 * np.sin(angle), 0, 40 + 660 * np.cos(angle)])
        y = shadow(source, corner, np.array([-1.0, 0, 0]), np.array([0, -1.0, 0]), MARKS.values())
        tags = {"PositionerPrimaryAngle": ANGLES[k], "InstanceNumber": k + 1, "ImagerPixelSpacing": [PITCH, PITCH]}
        view(folder / f"{k}.dcm", y, **tags)
    return folder


def oblique(path):
    """One file: gantry, panel and compressed breast at 45°; the marks turn with them, and the patient stays upright.

    In the isocentre's frame (right, rear, up) tube and panel are turned from up to the right.
    """
    c = np.sqrt(0.5)
    turn = np.array([[c, 0, c], [0, 1, 0], [-c, 0, c]])
    marks = np.array(list(MARKS.values())) * [-1, -1, 1] - [0, 0, 40]
    stack = []
    for angle in np.radians(ANGLES):
        source = 660 * np.array([np.sin(angle), 0, np.cos(angle)])
        corner = np.array([-(SHAPE[0] - 1) / 2 * PITCH, PITCH / 2, -40])
        y = shadow(source, corner, np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), marks)
        stack.append(y)
    iso = {
        "DetectorIsocenterPrimaryAngle": 45.0,
        "DetectorXPositionToIsocenter": -40 * c,
        "DetectorZPositionToIsocenter": -40 * c,
        "DetectorActiveAreaTLHCPosition": [-(SHAPE[0] - 1) / 2 * PITCH, PITCH / 2, 0.0],
    }
    breast_projection(path, np.array(stack), np.array(ANGLES) + 45.0, iso, pitch=(PITCH, PITCH))
    return path, turn


def reconstructed(scan):
    grid = pp.covering_grid(scan.views, 45, 1.2)
    return pp.reconstruct(scan, grid, method="sirt", iterations=15, levels=1)


def peaks(values, places):
    """LPS places of the three strongest well separated spots, strongest first. places: (N, 3) of the flat values."""
    found, left = [], values.ravel().copy()
    for _ in range(3):
        best = places[left.argmax()]
        near = np.linalg.norm(places - best, axis=1)
        core = near < 4
        found.append((places[core] * values.ravel()[core, None]).sum(axis=0) / values.ravel()[core].sum())
        left[near < 9] = -np.inf
    return np.array(found)


def by_nibabel(path):
    image = nibabel.load(path)
    index = np.indices(image.shape).reshape(3, -1).T
    ras = index @ image.affine[:3, :3].T + image.affine[:3, 3]
    return np.asarray(image.dataobj), ras * [-1, -1, 1]


def by_itk(path):
    sitk = pytest.importorskip("SimpleITK")
    names = [str(p) for p in sorted(path.iterdir())] if path.is_dir() else str(path)
    image = sitk.ReadImage(names)
    values = sitk.GetArrayFromImage(image).astype(float)
    k, j, i = np.indices(values.shape).reshape(3, -1)
    turn = np.reshape(image.GetDirection(), (3, 3)) * image.GetSpacing()
    return values, np.stack([i, j, k], axis=1) @ turn.T + image.GetOrigin()


@pytest.fixture(scope="module")
def upright(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cc")
    return reconstructed(pp.read_scan(left_cranio_caudal(folder / "views")))


READERS = {"v.nii.gz": by_nibabel, "v.nii": by_itk, "v.mha": by_itk, "v.nrrd": by_itk, "v.dcm": by_itk, "ct": by_itk}


@pytest.mark.parametrize("name", READERS)
def test_marks_of_a_left_breast_are_where_they_were(tmp_path, upright, name):
    pp.write_volume(tmp_path / name, upright)
    values, places = READERS[name](tmp_path / name)
    seen = peaks(values, places)
    assert np.abs(seen[:, :2] - np.array(list(MARKS.values()))[:, :2]).max() < 1.5  # in the slice: about a voxel
    assert np.abs(seen[:, 2] - np.array(list(MARKS.values()))[:, 2]).max() < 6  # 40° see depth less well
    assert seen[2, 2] > seen[:2, 2].max() + 4


@pytest.mark.parametrize("name", ["v.nii.gz", "v.mha", "v.dcm", "ct"])
def test_marks_seen_by_a_turned_gantry_keep_their_directions_in_the_patient(tmp_path, name):
    """Of a volume on turned axes the origin means little, the ways from mark to mark mean everything."""
    path, turn = oblique(tmp_path / "p.dcm")
    scan = pp.read_scan(path)
    pp.write_volume(tmp_path / name, reconstructed(scan))
    values, places = READERS.get(name, by_itk)(tmp_path / name)
    seen = peaks(values, places)
    standing = np.diag([-1.0, -1.0, 1.0])
    # The marks were cast in the turned gantry's frame; in the patient they are turned by it.
    true = np.array(list(MARKS.values())) @ (standing @ turn @ standing).T
    normal = standing @ turn[:, 2]
    for a, b in ((0, 1), (0, 2), (1, 2)):
        off = (seen[a] - seen[b]) - (true[a] - true[b])
        across = off - (off @ normal) * normal
        assert np.linalg.norm(across) < 2
        assert abs(off @ normal) < 7
