"""Left is left on every picture: one anatomy, stored in every order of its axes, gives one picture with its letters."""

import ast
from itertools import permutations, product
from pathlib import Path

import nibabel
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import palpate as pp
from palpate.demos import kidney
from palpate.volumes.patient_axes import patient_grid, patient_view
from palpate.volumes.volume import Labels

ORDERS = [(order, signs) for order in permutations(range(3)) for signs in product((1, -1), repeat=3)]
SPACING = np.array([1.0, 2.0, 3.0])  # mm along x, y, z
CORNER = np.array([-40.0, 15.0, 198.0])  # mm, of the first voxel


def anatomy():
    """(z, y, x), axes to superior, posterior, left: no two voxels alike, and an organ on the left, at the back, low."""
    values = np.random.default_rng(3).permutation(10 * 14 * 18).reshape(10, 14, 18).astype(np.float32) - 900
    organ = np.zeros(values.shape, dtype=np.int16)
    organ[2:7, 8:13, 11:16] = 1
    return values, organ


def stored(path, values, order, signs):
    """The same voxels in a NIfTI file whose axes are patient axes `order`, reversed where a sign is -1."""
    affine = np.eye(4)
    first = CORNER.copy()
    for axis, (patient, sign) in enumerate(zip(order, signs, strict=True)):
        affine[:3, axis] = 0
        affine[patient, axis] = sign * SPACING[patient]
        if sign < 0:
            first[patient] += SPACING[patient] * (values.shape[2 - patient] - 1)
    affine[:3, 3] = first
    array = values.transpose(2, 1, 0).transpose(order)[tuple(slice(None, None, s) for s in signs)]
    image = nibabel.Nifti1Image(array, np.diag([-1.0, -1, 1, 1]) @ affine)  # LPS to the file's RAS
    image.header.set_xyzt_units("mm")
    nibabel.save(image, path)


def seen(axes):
    """The picture in a frame as it lies on the page: row 0 above, column 0 on the left."""
    values = np.asarray(axes.images[0].get_array())
    assert axes.get_xlim()[0] < axes.get_xlim()[1]
    return values if axes.get_ylim()[0] > axes.get_ylim()[1] else values[::-1]


def letters(axes):
    """What is written at the left, right, upper and lower edge."""
    at = {text.get_text(): text.get_position() for text in axes.texts if len(text.get_text()) < 3}
    return [min(at, key=lambda t: np.hypot(*np.subtract(at[t], e))) for e in ((0, 0.5), (1, 0.5), (0.5, 1), (0.5, 0))]


def words(axes):
    return " ".join([axes.get_title(), *(text.get_text() for text in axes.texts)])


def assert_radiological(figure, index):
    """The three planes through a voxel (z, y, x) of the anatomy, with their letters and places."""
    values, organ = anatomy()
    k, j, i = index
    expected = [values[k], values[::-1, j], values[::-1, :, i]]
    outlined = [organ[k], organ[::-1, j], organ[::-1, :, i]]
    for axes, plane, inside, name, place, ends in zip(
        figure.axes,
        expected,
        outlined,
        "zyx",
        (CORNER + SPACING * index[::-1])[::-1],
        (["R", "L", "A", "P"], ["R", "L", "S", "I"], ["A", "P", "S", "I"]),
        strict=False,
    ):
        np.testing.assert_array_equal(seen(axes), plane)
        assert f"{name} = {place:.1f} mm" in words(axes)
        assert letters(axes) == ends
        if axes.collections:
            left, right, bottom, top = axes.images[0].get_extent()
            way = np.concatenate([path.vertices for path in axes.collections[0].get_paths()])
            rows, columns = np.nonzero(inside)
            x, y = ((way - [left, top]) / [right - left, bottom - top] * plane.shape[::-1] - 0.5).T
            for found, lines in ((x, columns), (y, rows)):
                assert [found.min(), found.max()] == pytest.approx([lines.min() - 0.5, lines.max() + 0.5])


@pytest.mark.parametrize(("order", "signs"), ORDERS)
def test_a_picture_is_that_of_the_anatomy_in_whatever_order_the_file_stores_it(tmp_path, order, signs):
    values, organ = anatomy()
    stored(tmp_path / "ct.nii", values, order, signs)
    stored(tmp_path / "labels.nii", organ, order, signs)
    volume, labels = pp.read_volume(tmp_path / "ct.nii", unit="HU"), pp.read_labels(tmp_path / "labels.nii")
    assert_radiological(pp.plot_volume(volume), (5, 7, 9))
    at = CORNER + SPACING * (12, 9, 3)
    assert_radiological(pp.plot_volume(volume, at, labels=labels), (3, 9, 12))


@pytest.mark.parametrize(("order", "signs"), [ORDERS[k] for k in (0, 3, 7, 13, 26, 44)])
def test_the_report_of_the_kidney_shows_its_ct_as_it_lies_in_the_patient(tmp_path, monkeypatch, order, signs):
    values, organ = anatomy()
    stored(tmp_path / "ct.nii.gz", values, order, signs)
    stored(tmp_path / "labels.nii.gz", organ, order, signs)
    one = pp.TetMesh([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [(0, 1, 2, 3)])
    for name, stand_in in {
        "sample": lambda _: tmp_path,
        "read_labels": lambda path: Labels(pp.read_labels(path).values, pp.read_labels(path).grid, {1: "kidney_left"}),
        "mesh_stage": lambda *_, **__: one,
        "fit_stage": lambda *_: None,
        "resting_on": lambda *_, **__: [0, 1, 2],
        "mesh_section": lambda *_: None,
        "tissue_section": lambda *_: None,
        "files_section": lambda *_: None,
        "write_report": lambda _path, _title, _command, sections: shown.extend(sections),
    }.items():
        monkeypatch.setattr(kidney, name, stand_in)
    shown = []

    class Stages:
        folder = tmp_path

        def __call__(self, name, make, *_):
            return make()

    kidney.kidney(Stages())
    assert_radiological(shown[0].pictures[0][0], (4, 10, 13))


def test_of_an_oblique_volume_the_letters_are_those_of_the_nearest_rotation():
    """The 24 rotations of a cube leave none further than 62.8°; voxels keep their places."""
    for turn in Rotation.random(500, random_state=0).as_matrix():
        grid = pp.Grid((2, 3, 4), (1, 2, 3), (5, 6, 7), turn)
        upright = patient_grid(grid)
        assert np.trace(upright.direction) > 1 + 2 * np.cos(np.radians(62.9))
        index = np.argwhere(np.ones(upright.shape))
        number = patient_view(np.arange(24).reshape(grid.shape), grid)[tuple(index.T)]
        np.testing.assert_allclose(
            upright.points(index), grid.points(np.stack(np.unravel_index(number, grid.shape), axis=1)), atol=1e-9
        )


def test_every_picture_of_a_volume_is_drawn_by_one_function():
    """`draw_plane` calls `draw_image`, as the projections of a scan do; a report's row of projections is no volume."""
    source = Path(pp.__file__).parent
    calls = [
        f"{path.relative_to(source)}: {name.attr}"
        for folder in ("demos", "report", "studies", "volumes")
        for path in sorted((source / folder).rglob("*.py"))
        for name in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(name, ast.Attribute) and name.attr in ("imshow", "matshow", "pcolormesh", "imsave")
    ]
    assert calls == ["report/figures.py: imshow", "volumes/notebook_figure.py: imshow"]
