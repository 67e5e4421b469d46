"""The demos end to end, judged against the raw data and by independent readers of their files."""

import re
import subprocess
import sys

import h5py
import meshio
import nibabel as nib
import numpy as np
import psutil
import pytest
import scipy.io
from scipy import ndimage

import palpate as pp
from palpate.demos.breast import fixed_nodes
from palpate.samples import sample
from palpate.tissue.lump_detectability import lump_map

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def breast(tmp_path_factory):
    """Folder of the breast demo, and the greatest memory of its process, bytes."""
    folder = tmp_path_factory.mktemp("breast")
    command = [sys.executable, "-m", "palpate", "demo", "--no-browser", "-o", str(folder)]
    run = psutil.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    most = 0
    while run.poll() is None:
        try:
            most = max(most, run.memory_info().rss)
        except psutil.NoSuchProcess:
            break
        try:
            run.wait(0.2)
        except psutil.TimeoutExpired:
            continue
    out, err = run.communicate()
    assert run.returncode == 0, err
    assert str(folder / "report.html") in out
    return folder, most


@pytest.fixture(scope="module")
def lesion(breast):
    """Centre (x, y, z) mm of the lesion's label, from the file alone."""
    image = nib.load(breast[0] / "labels.nii.gz")
    index = np.array(ndimage.center_of_mass(np.asarray(image.dataobj) == 2))
    right, front, up = (image.affine @ [*index, 1])[:3]  # NIfTI is RAS, the file's frame LPS
    return np.array([-right, -front, up])


def test_the_breast_demo_stays_below_three_gigabytes(breast):
    assert 1e8 < breast[1] < 3e9


def test_its_files_open_elsewhere(breast):
    folder, _ = breast
    volume, labels = nib.load(folder / "volume.nii.gz"), nib.load(folder / "labels.nii.gz")
    assert volume.shape == labels.shape
    np.testing.assert_allclose(volume.affine, labels.affine)
    assert 0.03 < np.median(np.asarray(volume.dataobj)[np.asarray(labels.dataobj) == 1]) < 0.08  # 1/mm, at 20 keV
    with h5py.File(folder / "scan.h5") as file:
        assert file["counts"].shape == (7, 170, 615)
        assert file["counts"].attrs["units"] == "photons"
    for name in ("mesh.vtu", "tissue.vtu", "training.vtu"):
        mesh = meshio.read(folder / name)
        assert len(mesh.cells_dict["tetra"]) > 10_000
    report = (folder / "report.html").read_text()
    assert report.count("data:image/png;base64") >= 7


def blob(view):
    """(row, column) of the strongest small bright disc inside the breast of one raw view of counts (x, y)."""
    p = -np.log(np.maximum(view, 1) / 42857.142857)
    inside = ndimage.binary_erosion(p > 0.5 * np.median(p[p > 0.5]), iterations=15, border_value=1)
    size = 6.0  # pixels: between a vessel and a gland
    bright = ndimage.gaussian_filter(p, size / 2) - ndimage.gaussian_filter(p, size * 1.5)
    column, row = np.unravel_index(np.argmax(np.where(inside, bright, -1)), p.shape)
    window = bright[column - 8 : column + 9, row - 8 : row + 9]
    weight = np.maximum(window - window.max() / 2, 0)
    dx, dy = ndimage.center_of_mass(weight)
    return np.array([row - 8 + dy, column - 8 + dx])


def test_the_lesion_reprojects_onto_its_blob_in_all_seven_raw_views(lesion):
    raw = scipy.io.loadmat(sample("breast") / "proj_noi.mat")["proj_noi"].astype(float)
    for k, angle in enumerate(np.radians([-15, -10, -5, 0, 5, 10, 15])):  # geometry.json's own words, in mm
        source = np.array([-605 * np.sin(angle), 0, 605 * np.cos(angle)])
        landed = source + (lesion - source) * (source[2] + 45) / (source[2] - lesion[2])
        row, column = landed[1] / 0.4 - 0.5, landed[0] / 0.4 + 307
        assert np.hypot(*(blob(raw[:, :, k]) - (row, column))) < 2


def test_the_lump_follows_faces_keeps_its_volume_and_its_angles(breast):
    folder, _ = breast
    for mesh_name, labels in (("mesh.vtu", pp.read_labels(folder / "labels.nii.gz")), ("training-mesh.vtu", None)):
        mesh = pp.read_mesh(folder / mesh_name)
        quality = pp.mesh_quality(mesh, labels)
        assert quality.manifold
        assert quality.dihedral_min >= 10
        if labels is not None:
            for region in quality.regions:
                assert abs(region.volume_error) < 0.03
        assert set(np.unique(mesh.region)) == {1, 2}


def test_what_rests_and_what_goes_on_into_the_chest_is_held(breast):
    mesh = pp.read_mesh(breast[0] / "mesh.vtu")
    fixed = fixed_nodes(mesh)
    x = mesh.nodes[fixed]
    assert ((x[:, 2] < mesh.nodes[:, 2].min() + 1.5) | (x[:, 1] < mesh.nodes[:, 1].min() + 1.5)).all()
    assert set(pp.read_tissue(breast[0] / "tissue.vtu").fixed) == set(fixed)


@pytest.mark.parametrize(("name", "felt"), [("tissue.vtu", False), ("training.vtu", True)])
def test_the_model_reproduces_what_the_lump_adds(breast, name, felt):
    found = lump_map(pp.read_tissue(breast[0] / name), "lesion", 5.0, 8.0, most=16)
    assert (found.stiff > found.plain - 1e-9).all()  # stiffer inside cannot be softer to the touch
    assert found.model_gap < 0.10
    assert (found.difference.max() > 0.08) == felt  # the least published threshold


def test_its_report_says_what_is_assumed_added_and_felt(breast):
    report = " ".join((breast[0] / "report.html").read_text().split())
    for words in ("Assumed: the breast rests on the panel", "held still", "has no stiffness: a carcinoma is assumed"):
        assert words in report
    lesion, training = re.split("The training lump: added by us", report)
    assert "not in the data" in training
    assert "a hand could not tell it by force" in lesion
    assert "a hand could not tell" not in training
    assert "a hand feels the lump with a probability of below" in lesion
    assert "90% intervals: diameter" in lesion
    for source in ("Percept. Psychophys.", "IEEE Trans. Haptics", "Exp. Brain Res."):  # the thresholds' papers
        assert source in lesion
        assert source in training


@pytest.fixture(scope="module")
def head(tmp_path_factory):
    folder = tmp_path_factory.mktemp("head")
    pp.run_demo("head", folder)
    return folder


def test_the_head_reprojects_onto_every_measured_view(head):
    volume = pp.read_volume(head / "volume.nii.gz")
    scan = pp.import_scan("head")
    again = pp.Projector(scan.views, volume.grid)(volume.values)
    for k in range(11):
        raw = np.fromfile(sample("head") / f"1-{k + 2:04d}", np.uint8).reshape(512, 512).astype(float)
        beam = float(scan.incident[k].max())
        measured = -np.log(np.maximum(raw, 0.5) / beam)
        region = ndimage.binary_erosion(raw > 0, iterations=16) & (measured > 0.15)
        assert np.corrcoef(again[k][region], measured[region])[0, 1] >= 0.985


def test_the_head_report_scores_left_out_views_beside_the_null(head):
    report = (head / "report.html").read_text()
    assert "null, high-passed" in report
    rows = report.split("<tr>")[2:13]
    scores = np.array([[float(c.split("<")[0]) for c in row.split("<td>")[3:5]] for row in rows])
    assert scores.shape == (11, 2)
    assert (scores > 0.5).all()
    assert (scores <= 1).all()
    assert (scores[1:-1, 0] > 0.98).all()  # predicted, not noise; the report says where the null is better
