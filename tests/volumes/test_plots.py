"""Pictures in notebooks, and the plots: right places, right values, right words."""

import base64
import io
import re
from itertools import pairwise

import numpy as np
import pytest
from skimage.io import imread

import palpate as pp
from palpate.volumes.patient_axes import reorient_to_patient


def head():
    """A patient stored from left to right and from back to front; one bright voxel, left, posterior, superior."""
    values = np.full((11, 21, 31), 40.0)
    values[9, 4, 6] = 3000
    return pp.Volume(values, pp.Grid(values.shape, (3, 2, 1), (10, 20, 30), np.diag([-1.0, -1.0, 1.0])), "HU")


def drawn(figure, k):
    """The picture in frame k, as it lies on the page: row 0 above."""
    image = figure.axes[k].images[0]
    values = np.asarray(image.get_array())
    return values[::-1] if image.origin == "lower" else values


def test_planes_go_through_the_point_with_the_patients_right_on_the_left():
    volume = head()
    figure = pp.plot_volume(volume, at=volume.grid.points((9, 4, 6))[0], window=(0, 1000))
    axial, coronal, sagittal = (drawn(figure, k) for k in range(3))
    spots = [np.argwhere(plane == 3000).tolist() for plane in (axial, coronal, sagittal)]
    # left is on the right, posterior below (right in the sagittal plane), superior above
    assert spots == [[[20 - 4, 30 - 6]], [[10 - 9, 30 - 6]], [[10 - 9, 20 - 4]]]
    assert figure.axes[0].images[0].get_clim() == (0, 1000)
    words = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert {"R", "L", "A", "P", "10 mm"} <= set(words)
    assert any(text.startswith("z = 57.0 mm") for text in words)
    assert figure.axes[-1].get_ylabel() == "HU"


def test_planes_and_scale_bar_are_to_one_scale():
    volume = head()
    figure = pp.plot_volume(volume)
    inches = figure.get_size_inches()
    sides = np.array(volume.grid.shape) * volume.grid.spacing
    for frame, (down, across) in zip(figure.axes, ((1, 2), (0, 2), (0, 1)), strict=False):
        box = frame.get_position()
        mm = np.array([sides[across], sides[down]]) / (np.array([box.width, box.height]) * inches)
        np.testing.assert_allclose(mm, mm[0])
        bar = frame.lines[0].get_xdata()
        length = next(float(t.get_text().split()[0]) for t in frame.texts if re.fullmatch(r"[\d.]+ mm", t.get_text()))
        assert (bar[1] - bar[0]) * sides[across] == pytest.approx(length)


def test_a_volume_shows_itself_in_a_notebook():
    volume = head()
    shown = volume._repr_html_()
    assert "11 × 21 × 31 voxels (z, y, x) of 3 × 2 × 1 mm, 40 to 3000 HU" in shown
    picture = imread(io.BytesIO(base64.b64decode(re.search("base64,([^']+)'", shown)[1])))
    assert picture[..., :3].std() > 20
    step = pp.Step(volume, 12.5, 1, 3, 0.25)
    assert "level 1, iteration 3, objective 12.5" in step._repr_html_()
    assert step._repr_html_().endswith(shown)
    assert np.shares_memory(reorient_to_patient(volume)[0], volume.values)  # nothing as large as the volume is copied


def test_the_report_of_a_fit_shows_its_figures():
    from palpate.tissue.spring_fit_report import FitReport

    three = np.ones((2, 3))
    report = FitReport("P1", 8, 2, three, three, np.ones(2), np.ones(2), three, 1.1 * three, np.ones(4))
    assert report._repr_html_() == f"<pre>{report.text()}</pre>"
    assert "force off by 10 %" in report._repr_html_()


def scan(views=12):
    counts = np.random.default_rng(0).uniform(100, 900, (views, 10, 20))
    counts[3, 2, 5] = np.nan
    mask = np.ones(counts.shape, dtype=bool)
    mask[3, 2, 5] = False
    panel = pp.Panel((10, 20), (0.5, 0.25), (0, 0, 0))
    source = np.stack([np.arange(views) * 10.0, np.zeros(views), np.full(views, 500.0)], axis=1)
    return pp.Scan(counts, 1000, pp.Views(source, panel), background=50, mask=mask)


def test_projections_are_shown_as_line_integrals_or_counts():
    measured = scan()
    figure = pp.plot_scan(measured, views=[3, 11])
    expected = np.log(1000 / np.maximum(measured.counts[3] - 50, 0.5))
    picture = drawn(figure, 0)
    assert np.isnan(picture[2, 5])
    picture[2, 5] = expected[2, 5]
    np.testing.assert_allclose(picture, expected, rtol=1e-5)
    np.testing.assert_array_equal(drawn(pp.plot_scan(measured, [11], counts=True), 0), measured.counts[11])
    assert "view 11, source (110, 0, 500) mm" in figure.axes[1].texts[-1].get_text()
    shown = [axes for axes in pp.plot_scan(measured).axes[:-1] if axes.images]
    assert len(shown) == 8
    html = measured._repr_html_()
    assert "12 views of 10 × 20 pixels (rows, columns) of 0.5 × 0.25 mm" in html
    assert "0.04% of the pixels not measured" in html


def test_a_profile_of_a_ramp_is_its_line():
    grid = pp.Grid((6, 7, 8), (2, 1.5, 1), (-3, 4, 5))
    x, y, z = (grid.axis(name) for name in "xyz")
    ramp = pp.Volume(0.1 + 0.01 * x + 0.02 * y[:, None] + 0.03 * z[:, None, None], grid)
    start, end = np.array([-3, 4, 5]), np.array([4, 13, 15])
    figure = pp.plot_profile({"ramp": ramp, "twice": pp.Volume(2 * ramp.values, grid)}, start, end)
    one, two = figure.axes[0].lines
    distance = one.get_xdata()
    assert distance[-1] == pytest.approx(np.linalg.norm(end - start))
    points = start + (distance / distance[-1])[:, None] * (end - start)
    np.testing.assert_allclose(one.get_ydata(), 0.1 + points @ (0.01, 0.02, 0.03), rtol=1e-5)
    np.testing.assert_allclose(two.get_ydata(), 2 * one.get_ydata(), rtol=1e-5)
    beyond = pp.plot_profile(ramp, start, start - (20, 0, 0)).axes[0].lines[0].get_ydata()
    assert np.isfinite(beyond[0])
    assert np.isnan(beyond[-1])


def test_what_cannot_be_drawn_is_refused():
    volume = head()
    with pytest.raises(pp.errors.DataError, match="lies outside the volume"):
        pp.plot_volume(volume, at=(500, 0, 0))
    with pytest.raises(pp.errors.DataError, match="has no width"):
        pp.plot_volume(volume, window=(3, 3))
    with pytest.raises(pp.errors.DataError, match=r"the scan has views 0 to 11"):
        pp.plot_scan(scan(), views=[12])
    with pytest.raises(pp.errors.DataError, match="lies outside; points are"):
        pp.plot_profile(volume, (500, 0, 0), (600, 0, 0))


def test_the_geometry_is_drawn_where_it_is():
    """A tube that turns with its panel: spots, the corners of each panel, and the box of the volume, in mm."""
    panel = pp.Panel((10, 20), (2.0, 1.0), (-9.5, -9, -100))
    views = pp.rotating_views(panel, [0, 90], source=(0, 0, 400))
    grid = pp.Grid((4, 5, 6), (3, 2, 1), (10, 20, 30))
    axes = pp.plot_geometry(views, grid).axes[0]
    lines = {}
    for line in axes.lines:
        lines.setdefault(line.get_label().removeprefix("_"), []).append(np.stack(line.get_data_3d(), axis=1))
    np.testing.assert_allclose(lines["focal spots"][0], [(0, 0, 400), (400, 0, 0)], atol=1e-9)
    flat, upright = (np.unique(outline.round(6), axis=0) for outline in lines["panels"])
    np.testing.assert_allclose(flat, [(-10, -10, -100), (-10, 10, -100), (10, -10, -100), (10, 10, -100)])
    np.testing.assert_allclose(upright, [(-100, -10, -10), (-100, -10, 10), (-100, 10, -10), (-100, 10, 10)])
    (box,) = lines["volume"]
    np.testing.assert_allclose([box.min(axis=0), box.max(axis=0)], [(9.5, 19, 28.5), (15.5, 29, 40.5)])
    sides = np.linalg.norm(np.diff(box, axis=0), axis=1)
    assert {6, 10, 12} == set(sides.round(6)), "only edges of the box are drawn"
    drawn = {frozenset((tuple(a), tuple(b))) for a, b in pairwise(box)}
    assert len(drawn) == 12
    np.testing.assert_allclose(lines["ray"][1], [(400, 0, 0), (-100, 0, 0)], atol=1e-9)
