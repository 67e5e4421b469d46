"""The figures of a mesh: known shapes have known angles, handles, distances."""

import numpy as np
import pytest

import palpate as pp
from palpate.errors import DataError
from palpate.meshes.element_quality import dihedrals, radius_ratios
from palpate.meshes.stuffing.isosurface_stuffing import stuff
from palpate.meshes.tet_mesh import boundary_faces
from palpate.meshes.triangle_surface import distance_to_surface, non_manifold_parts, shells_and_genus

REGULAR = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1.0]])
CORNER = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
ONE = np.array([[0, 1, 2, 3]])


def test_regular_tetrahedron():
    np.testing.assert_allclose(dihedrals(REGULAR, ONE), np.degrees(np.arccos(1 / 3)))
    assert radius_ratios(REGULAR, ONE) == pytest.approx([1])


def test_corner_of_a_cube():
    leaning = np.degrees(np.arctan(np.sqrt(2)))
    np.testing.assert_allclose(dihedrals(CORNER, ONE)[0], [90, 90, 90, leaning, leaning, leaning])
    # Inscribed 1 / (3 + √3), circumscribed √3 / 2.
    assert radius_ratios(CORNER, ONE) == pytest.approx([3 / (3 + np.sqrt(3)) / (np.sqrt(3) / 2)])


@pytest.mark.parametrize("height", [1e-1, 1e-3, 1e-6])
def test_a_flattened_tetrahedron_scores_towards_nothing(height):
    flat = CORNER * [1, 1, height] + [[0, 0, 0], [0, 0, 0], [0, 0, 0], [0.3, 0.3, 0]]
    assert dihedrals(flat, ONE).min() < 300 * height
    assert dihedrals(flat, ONE).max() > 180 - 600 * height
    assert radius_ratios(flat, ONE)[0] < 5 * height


def test_shape_does_not_depend_on_size_place_or_order():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(4, 3))
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    moved = 7.5 * x @ turn + [10, -3, 2]
    order = np.array([[2, 0, 3, 1]])
    assert radius_ratios(moved, order) == pytest.approx(radius_ratios(x, ONE))
    assert np.sort(dihedrals(moved, order)) == pytest.approx(np.sort(dihedrals(x, ONE)))


def made(field, cell=0.7, reach=8.0):
    nodes, tets, _ = stuff([field], np.full(3, -reach), np.full(3, 2 * reach), cell)
    used, index = np.unique(tets, return_inverse=True)
    return pp.TetMesh(nodes[used], index.reshape(tets.shape))


def torus(points):
    around = np.hypot(points[:, 0], points[:, 1]) - 4.5
    return 1.8 - np.hypot(around, points[:, 2])


def shell(points):
    radius = np.linalg.norm(points, axis=1)
    return np.minimum(6 - radius, radius - 3)


def pair(points):
    return 2.7 - np.minimum(np.linalg.norm(points - [3, 0, 0], axis=1), np.linalg.norm(points - [-3, 0, 0], axis=1))


@pytest.mark.parametrize(
    ("field", "parts", "skins", "handles"),
    [(torus, 1, 1, 1), (shell, 1, 2, 0), (pair, 2, 2, 0)],
    ids=["torus", "shell", "pair"],
)
def test_parts_skins_and_handles(field, parts, skins, handles):
    quality = pp.mesh_quality(made(field))
    region = quality.regions[0]
    assert (region.parts, region.skins, region.handles, region.pinched) == (parts, skins, handles, 0)
    assert quality.manifold


def test_two_tets_that_share_an_edge_or_a_corner_are_pinched():
    edge = np.array([[0, 1, 2, 3], [0, 1, 5, 4]])
    edges, nodes = non_manifold_parts(boundary_faces(edge.astype(np.int32)))
    assert edges.tolist() == [[0, 1]]
    corner = np.array([[0, 1, 2, 3], [0, 4, 5, 6]])
    edges, nodes = non_manifold_parts(boundary_faces(corner.astype(np.int32)))
    assert len(edges) == 0
    assert nodes.tolist() == [0]
    assert shells_and_genus(boundary_faces(ONE.astype(np.int32))) == (1, 0)


def test_distance_to_triangles_against_points_spread_over_them():
    rng = np.random.default_rng(1)
    nodes = rng.normal(size=(12, 3)) * 3
    triangles = rng.permuted(np.tile(np.arange(12), (20, 1)), axis=1)[:, :3]
    u, v = np.meshgrid(np.linspace(0, 1, 200), np.linspace(0, 1, 200))
    inside = u + v <= 1
    weights = np.stack([1 - u[inside] - v[inside], u[inside], v[inside]], axis=1)
    spread = np.concatenate([weights @ nodes[t] for t in triangles])
    points = rng.normal(size=(40, 3)) * 4
    brute = np.array([np.linalg.norm(spread - p, axis=1).min() for p in points])
    found = distance_to_surface(points, nodes, triangles, candidates=20)
    assert (found <= brute + 1e-9).all()
    np.testing.assert_allclose(found, brute, atol=0.05)


def ball_labels(radius):
    grid = pp.Grid((34, 34, 34), (1, 1, 1), (5, -7, 100))
    points = grid.points(np.argwhere(np.ones(grid.shape))) - grid.points([[16.5] * 3])
    return pp.Labels((np.linalg.norm(points, axis=1) < radius).reshape(grid.shape) * 3, grid, {3: "ball"})


def test_a_mesh_that_is_too_big_is_told_by_how_much():
    labels = ball_labels(11)
    mesh = pp.tetrahedralize(labels, "ball", 2)
    good = pp.mesh_quality(mesh, labels).regions[0]
    assert abs(good.volume_error) < 0.01
    assert good.distance_mean < 0.1
    middle = labels.grid.points([[16.5] * 3])
    grown = pp.TetMesh(middle + 1.1 * (mesh.nodes - middle), mesh.tets, mesh.region, mesh.names)
    bad = pp.mesh_quality(grown, labels).regions[0]
    assert bad.volume_error == pytest.approx(1.1**3 * (1 + good.volume_error) - 1)
    assert bad.distance_mean == pytest.approx(1.1, abs=0.1)
    assert bad.distance_max == pytest.approx(1.1, abs=0.4)


def hollow_labels(inside):
    """A ball with a smaller one in its middle, of another label or of none."""
    labels = ball_labels(13)
    return pp.Labels(np.where(ball_labels(6).values > 0, inside, labels.values), labels.grid, {3: "ball"})


@pytest.mark.parametrize("inside", [0, 7], ids=["void", "other label"])
@pytest.mark.filterwarnings("ignore:.*closed voids")
def test_a_mesh_that_fills_a_void_is_held_against_the_filled_label(inside):
    labels = hollow_labels(inside)
    filled = pp.mesh_quality(pp.tetrahedralize(labels, "ball", 2.5), labels).regions[0]
    whole = pp.mesh_quality(pp.tetrahedralize(ball_labels(13), "ball", 2.5), ball_labels(13)).regions[0]
    assert filled.label_volume == whole.label_volume
    assert filled.distance_max == pytest.approx(whole.distance_max)  # the void's wall, 6 mm deep, is no surface of it
    hollow = pp.mesh_quality(pp.tetrahedralize(labels, "ball", 2, fill_holes=False), labels).regions[0]
    assert hollow.label_volume == np.count_nonzero(labels.values == 3)
    assert hollow.distance_max < 1
    wrong = pp.mesh_quality(pp.tetrahedralize(ball_labels(13), "ball", 2.5), ball_labels(6)).regions[0]
    assert wrong.distance_max == pytest.approx(7, abs=0.7)  # what is no void of the label is still told


def test_the_report_reads_as_text():
    labels = ball_labels(9)
    quality = pp.mesh_quality(pp.tetrahedralize(labels, 3, 2.5), labels)
    text = str(quality)
    assert "closed, 2-manifold" in text
    assert "region 3 (ball)" in text
    assert f"dihedral angles {quality.dihedral_min:.1f}°" in text
    assert quality.edge_min <= quality.edge_mean <= quality.edge_max


def test_labels_that_do_not_belong_to_the_mesh_are_refused():
    mesh = pp.tetrahedralize(ball_labels(9), 3, 2.5)
    other = pp.Labels((ball_labels(9).values > 0) * 8, ball_labels(9).grid)
    with pytest.raises(DataError, match=r"region 3 of the mesh is not among the labels \[8\]; give the labels"):
        pp.mesh_quality(mesh, other)
