"""The map of the mesh's error: what one push says at each place, larger where elements are larger."""

import io

import numpy as np
import pytest
from matplotlib.image import imread
from support.brick_meshes import block, brick

import palpate as pp
from palpate.errors import DataError, MaterialError
from palpate.tissue.force_error_map import spread_places


def test_it_is_what_one_push_says():
    tissue = block(6, poisson=0.4)
    found = pp.force_error_map(tissue, 15.0)
    model = pp.model(tissue, "compliance")
    for x, told in list(zip(found.points, found.estimate, strict=True))[::9]:
        normal = tissue.surface.normal(tissue.surface.closest(x))
        assert model.push(x, -2 * normal, 15.0).estimate.mesh == pytest.approx(told, abs=1e-6)


def test_finer_elements_have_less():
    """Half the edge under the same contact: about a quarter of the error, in median at least half."""
    coarse, fine = (pp.force_error_map(block(n, poisson=0.45), 15.0) for n in (6, 11))
    assert fine.share(0.5) < coarse.share(0.5) / 2
    assert fine.cautious < coarse.cautious / 2


def test_the_coarse_half_has_more():
    mesh = brick((12, 8, 8), (80.0, 40.0, 40.0))
    half = mesh.nodes.copy()
    half[:, 0] = np.interp(half[:, 0], [0, 20, 80], [0, 40, 80])  # cells of 13.3 mm to x = 40, then of 4.4 mm
    tissue = pp.Tissue(pp.TetMesh(half, mesh.tets), 5.0, 0.45, half[:, 2] == 0)
    found = pp.force_error_map(tissue, 12.0)
    left = found.points[:, 0] < 30
    right = found.points[:, 0] > 50
    assert min(left.sum(), right.sum()) > 5
    assert np.median(found.estimate[left]) > 2 * np.median(found.estimate[right])
    values = found.on_surface()
    held = tissue.held[tissue.mesh.surface].any(axis=1)
    np.testing.assert_array_equal(np.isnan(values), held)
    middle = tissue.mesh.nodes[tissue.mesh.surface].mean(axis=1)[:, 0]
    assert values[(middle < 30) & ~held].mean() > 2 * values[(middle > 50) & ~held].mean()
    assert found.estimate.min() <= np.nanmin(values)
    assert np.nanmax(values) <= found.estimate.max()


def test_places_are_spread_and_away_from_the_support():
    tissue = block(8)
    places = spread_places(tissue, 10.0)
    gaps = np.linalg.norm(places[:, None] - places, axis=2) + 100 * np.eye(len(places))
    assert gaps.min() > 5
    assert places[:, 2].min() > 9  # held are the nodes at z = 0, 7 mm apart
    assert len(spread_places(tissue, 200.0)) > 0  # nowhere so far away
    assert not np.array_equal(places, spread_places(tissue, 10.0, seed=1))


def test_the_text_tells_median_and_worst():
    found = pp.force_error_map(block(5), 20.0)
    worst = found.points[np.argmax(np.abs(found.estimate))]
    assert f"worst {np.abs(found.estimate).max():.1%} at {np.round(worst, 1).tolist()} mm" in found.text()
    assert f"median {np.median(np.abs(found.estimate)):.1%}" in found.text()


def test_the_picture_is_red_where_more_than_is_allowed():
    found = pp.force_error_map(block(5), 20.0)

    def reds(within):
        file = io.BytesIO()
        pp.plot_force_error(found, within).savefig(file, format="png")
        file.seek(0)
        red, green, _ = np.moveaxis(imread(file)[..., :3], 2, 0)
        return int(((red > 2.5 * green) & (red > 0.4)).sum())

    assert reds(1e-3) > 10 * max(reds(1.0), 1)


def test_what_cannot_be_is_refused():
    tissue = block(4)
    with pytest.raises(DataError, match="radius: 0"):
        pp.force_error_map(tissue, 0)
    with pytest.raises(DataError, match="points: no place"):
        pp.force_error_map(tissue, 20.0, np.zeros((0, 3)))
    with pytest.raises(DataError, match="off the surface"):
        pp.force_error_map(tissue, 20.0, [[0, 0, 500.0]])
    with pytest.raises(MaterialError, match='element: "P2"'):
        pp.force_error_map(block(3, element="P2"), 20.0)
