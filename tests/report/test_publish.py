"""Published figures: every curve can be told from every other, by its colour and without it."""

import io

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from skimage.io import imread

import palpate as pp
from palpate.report.figures import curves, slice_table
from palpate.report.html_report import Section
from palpate.report.publish import publish
from palpate.volumes.notebook_figure import line_style

METHODS = ["M-MAP", "SART", "SIRT", "FBP", "backprojection", "RTK's SART", "mean of the neighbours"]


def seven_curves():
    """Like the errors of the head study: close to each other, and crossing."""
    x = np.arange(11)
    rng = np.random.default_rng(0)
    return curves(
        x, {name: np.exp(rng.normal(0, 0.4, 11) + 0.3 * k) for k, name in enumerate(METHODS)}, "view", "error"
    )


def lines_of(figure):
    return [line for line in figure.axes[0].lines if not line.get_label().startswith("_")]


def test_each_curve_of_a_published_figure_has_its_own_colour(tmp_path):
    figure = seven_curves()
    colours = [np.round(255 * np.array(to_rgb(line.get_color()))) for line in lines_of(figure)]
    section = Section("Scores", pictures=[(figure, "Error of each view.")])
    (tmp_path / "study" / "figures").mkdir(parents=True)
    publish(tmp_path / "study", "head", "A head", "palpate study head", [section], tmp_path / "docs")
    for file in ("study/figures/scores-1.png", "docs/images/head/scores-1.png"):
        picture = imread(tmp_path / file)[..., :3].reshape(-1, 3).astype(float)
        for name, colour in zip(METHODS, colours, strict=True):
            assert (np.abs(picture - colour).max(axis=1) <= 3).sum() > 40, f"{file}: {name} is not drawn in {colour}"


def test_curves_can_be_told_apart_without_colour():
    looks = [
        (line.get_linestyle(), line._unscaled_dash_pattern, line.get_marker()) for line in lines_of(seven_curves())
    ]
    assert len(set(map(str, looks))) == len(METHODS)
    many = [line_style(i) for i in range(28)]
    assert len({(str(style["ls"]), style["marker"]) for style in many}) == 28


def test_a_table_of_slices_names_its_rows_and_shows_the_slices_asked_for():
    grid = pp.Grid((6, 5, 8), (2, 1, 1), (-3.5, -2, 10))
    values = np.arange(240.0).reshape(grid.shape)
    volumes = {name: pp.Volume(factor * values, grid) for name, factor in (("one", 1), ("two", 2))}
    rows = {name: [(volume, z) for z in (10.1, 19.7)] for name, volume in volumes.items()}
    figure = slice_table(rows, [(0, 240), (0, 480)], ["low", "high"], y_up=True)
    shown = [np.asarray(axes.images[0].get_array()) for axes in figure.axes]
    for picture, (factor, k) in zip(shown, [(1, 0), (1, 5), (2, 0), (2, 5)], strict=True):
        np.testing.assert_array_equal(picture, factor * values[k, ::-1])
    words = [[text.get_text().strip() for text in axes.texts] for axes in figure.axes]
    assert "low" in words[0]
    assert "high" in words[1]
    assert "two" in words[2]
    for some in words:
        assert {"−x", "+x", "+y", "−y"} <= set(some)
    assert figure.axes[2].images[0].get_clim() == pytest.approx((0, 480))
    file = io.BytesIO()
    figure.savefig(file)
    assert imread(io.BytesIO(file.getvalue()))[..., :3].std() > 20
