"""Widgets from Python: what they take, and what follows from what the page reports. The page itself: tests/page."""

import base64
import io
import re
import sys

import matplotlib.image
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.example_organs import organ

import palpate as pp
from palpate.display import notebook
from palpate.display.touch_widget import TouchWidget
from palpate.display.view_widget import ViewWidget

TISSUE = organ(7)


@pytest.fixture(scope="module")
def widget():
    made = TouchWidget(TISSUE, title="organ")
    yield made
    made.close()


@pytest.mark.parametrize(
    ("name", "wrong", "said"),
    [
        ("tool", "hammer", "choose one of press, pull, grasp, needle"),
        ("color", "red", "choose one of plain, displacement, strain, stiffness"),
        ("depth", "deep", "mm, such as 5"),
        ("depth", np.nan, "mm, such as 5"),
        ("depth", [1, 2], "mm, such as 5"),
        ("view", 30, "azimuth and elevation"),
        ("view", (np.inf, 0), "azimuth and elevation"),
    ],
)
def test_what_cannot_be_is_refused_and_changes_nothing(widget, name, wrong, said):
    before = getattr(widget, name)
    with pytest.raises(pp.errors.DataError, match=said):
        setattr(widget, name, wrong)
    assert getattr(widget, name) == before


def test_what_the_hand_does_cannot_be_set(widget):
    for name in ("force", "position", "point", "displacement", "picked", "session"):
        with pytest.raises(Exception, match="read-only"):
            setattr(widget, name, None)


def test_a_touch_is_told_as_arrays_and_ends(widget):
    seen = []
    widget.observe(lambda change: seen.append((change["new"], widget.point)), "force")
    widget._touched = {"force": [0, 1, 2], "position": [1, 2, 3], "point": [4, 5, 6], "displacement": [7, 8, 9]}
    assert [each.tolist() for each in seen[-1]] == [[0, 1, 2], [4, 5, 6]]  # told together
    assert widget.position.tolist() == [1, 2, 3]
    assert widget.displacement.tolist() == [7, 8, 9]
    widget._touched = None
    assert widget.force.tolist() == [0, 0, 0]
    assert widget.point is None
    assert widget.position is None


def test_a_pick_names_the_region_of_the_surface(widget):
    corner = TISSUE.mesh.nodes[TISSUE.mesh.surface[0]].mean(axis=0)
    widget._picked = {"point": corner.tolist(), "count": 1}
    assert widget.picked.region == "organ"
    np.testing.assert_array_equal(widget.picked.point, corner)


@given(st.sampled_from(["depth", "view"]), st.recursive(st.none() | st.text() | st.floats(), st.lists, max_leaves=3))
def test_anything_is_taken_or_refused(widget, name, value):
    refused = None
    try:
        setattr(widget, name, value)
    except pp.errors.DataError as problem:
        refused = str(problem)
    assert refused is None or refused.startswith(name)


def test_windows_and_places_of_images_are_checked():
    volume = pp.Volume(np.arange(24.0).reshape(2, 3, 4), pp.Grid((2, 3, 4), (1, 1, 1)))
    widget = ViewWidget([volume])
    widget.window, widget.position = (0, 3), (1, 1, 1)
    for wrong in ((3, 3), (5, 1), (0, np.nan), 7):
        with pytest.raises(pp.errors.DataError, match="window"):
            widget.window = wrong
    with pytest.raises(pp.errors.DataError, match="position"):
        widget.position = (1, 2)
    assert widget.window == (0, 3)
    assert widget.position == (1, 1, 1)
    widget.close()


def test_a_script_has_no_widget_and_a_kernel_needs_the_extra(monkeypatch):
    assert not notebook.in_notebook()

    class Shell:
        kernel = object()

    class IPython:
        get_ipython = Shell

    monkeypatch.setitem(sys.modules, "IPython", IPython)
    assert notebook.in_notebook()
    monkeypatch.setattr(notebook, "find_spec", lambda name: None)
    for call in (
        lambda: pp.touch(TISSUE),
        lambda: pp.view(pp.Volume(np.zeros((2, 2, 2)), pp.Grid((2, 2, 2), (1, 1, 1)))),
    ):
        with pytest.raises(pp.errors.ExtraError, match=r"pip install 'palpate\[notebook\]'.*port=8765"):
            call()


def test_a_tissue_that_the_page_cannot_follow_is_refused_with_a_way_out(monkeypatch):
    relaxing = pp.Tissue(TISSUE.mesh, young=5, poisson=0.45, fixed=TISSUE.fixed, element="P1")
    monkeypatch.setattr("palpate.display.touch.in_notebook", lambda: True)
    with pytest.raises(pp.errors.MaterialError, match="port=8765"):
        pp.touch(relaxing)


def picture(html):
    """The picture of a card, as (rows, columns, 4)."""
    return matplotlib.image.imread(io.BytesIO(base64.b64decode(re.search("base64,([^'\"]+)", html)[1])))


def cells(html):
    """The rows of a card, by name."""
    return dict(re.findall(r"<tr><th[^>]*>(.*?)</th><td[^>]*>(.*?)</td></tr>", html))


def test_cards_hold_the_figures_of_what_they_show():
    mesh = TISSUE.mesh
    model = pp.model(TISSUE, "compliance")
    session = pp.Session(model, radius=8)
    for shown in (TISSUE, model, session):
        rows = cells(shown._repr_html_())
        assert rows["Mesh"] == f"{len(mesh.nodes):,} nodes, {len(mesh.tets):,} tetrahedra"
        assert f"volume {mesh.volumes.sum() / 1000:.4g} mL" in rows["Size"]
        assert rows["organ"].startswith("E 5 kPa, ν 0.45")
        assert rows["lump"].startswith("E 50 kPa")
        assert rows["Supports"].startswith(f"{len(TISSUE.fixed):,} of {len(mesh.nodes):,}")
    assert "radius 8 mm" in cells(session._repr_html_())["Contact"]
    assert "E" not in cells(mesh._repr_html_())["organ"]


def test_a_card_draws_the_outline_of_the_mesh_and_what_is_inside():
    """On no ground: how much is painted is the area of the ellipsoid's projection; the lump's color shows."""
    drawn = picture(TISSUE.mesh._repr_html_())
    painted = (drawn[..., 3] > 0.2).mean()
    assert 0.3 < painted < 0.75
    assert drawn[0, 0, 3] == 0
    inside = drawn[..., 2] - drawn[..., 1] > 0.1  # violet: more blue than green
    assert 0.005 < inside.mean() < 0.2
    plain = pp.TetMesh(TISSUE.mesh.nodes, TISSUE.mesh.tets)
    drawn = picture(plain._repr_html_())
    assert not (drawn[..., 2] - drawn[..., 1] > 0.1).any()


def test_a_name_is_text_in_a_card():
    mesh = pp.TetMesh(TISSUE.mesh.nodes, TISSUE.mesh.tets, TISSUE.mesh.region, {0: "<script>x</script>", 1: "a&b"})
    html = mesh._repr_html_()
    assert "<script" not in html
    assert "a&amp;b" in html


def test_labels_and_records_show_themselves():
    values = np.zeros((6, 7, 8), np.uint8)
    values[1:4, 2:5, 2:6] = 1
    values[2, 3, 3] = 2
    labels = pp.Labels(values, pp.Grid((6, 7, 8), (2, 1, 1)), {1: "liver"})
    rows = cells(labels._repr_html_())
    assert rows == {"liver": "35 voxels, 0.07 mL", "label 2": "1 voxels, 0.002 mL"}
    empty = pp.Labels(np.zeros((2, 2, 2), np.uint8), pp.Grid((2, 2, 2), (1, 1, 1)))
    assert "none" in cells(empty._repr_html_())["Labels"]
    session = pp.Session(pp.model(TISSUE, "compliance"), radius=8)
    session.step([pp.Command(True, tuple(TISSUE.mesh.nodes[TISSUE.mesh.surface[0, 0]]), (0, 0, -3))] * 500)
    rows = cells(session.record()._repr_html_())
    assert rows["Length"].startswith("0.5 s")
    assert "up to 3 mm" in rows["Commands"]
    assert rows["Model"] == "compliance"


def test_what_has_been_cut_shows_itself_with_its_whole_volume():
    top = TISSUE.mesh.nodes[np.argmax(TISSUE.mesh.nodes[:, 2])]
    cut = pp.cut(TISSUE, pp.Blade.swept([top - (8, 0, -5), top + (8, 0, 5)], direction=(0, 0, -1), depth=15))
    model = pp.model(cut, "compliance")
    for shown in (cut, cut.mesh, model, pp.Session(model, radius=8)):
        html = shown._repr_html_()
        assert f"volume {TISSUE.mesh.volumes.sum() / 1000:.4g} mL" in cells(html)["Size"]
        assert 0.3 < (picture(html)[..., 3] > 0.2).mean() < 0.75
