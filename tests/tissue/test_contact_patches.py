"""The contact patch is smooth, stays on its side of the wall, and refuses what cannot be touched."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.brick_meshes import block, brick
from support.example_organs import organ

import palpate as pp
from palpate import _core
from palpate.meshes.cutting.cut_mesh import touched_surface
from palpate.tissue.contact_patches import patch

TISSUE = block(11)


def integrals(mesh, point, radius, pieces=40):
    """(N,) ∫N_a φ over the surface by the middles of pieces² parts of each triangle, for a patch on a plane."""
    up = [((i + 1 / 3) / pieces, (j + 1 / 3) / pieces) for i in range(pieces) for j in range(pieces - i)]
    down = [((i + 2 / 3) / pieces, (j + 2 / 3) / pieces) for i in range(pieces - 1) for j in range(pieces - 1 - i)]
    part = np.array(up + down)
    part = np.column_stack([part, 1 - part.sum(axis=1)])
    found = np.zeros(len(mesh.nodes))
    for triangle in mesh.surface:
        x = mesh.nodes[triangle]
        if np.linalg.norm(x - point, axis=1).min() > radius + np.ptp(x, axis=0).max():
            continue
        phi = np.clip(1 - ((part @ x - point) ** 2).sum(axis=1) / radius**2, 0, None) ** 2
        area = np.linalg.norm(np.cross(x[1] - x[0], x[2] - x[0])) / 2
        found[triangle] += area * (phi[:, None] * part).mean(axis=0)
    return found


@pytest.mark.parametrize("radius", [4.0, 7.5, 11.0, 15.0])
def test_the_weights_are_integrals_of_the_shape_functions(radius):
    for point in ([23.7, 26.1, 50.0], [25.0, 25.0, 50.0], [22.0, 28.5, 50.0]):
        found, expected = patch(TISSUE, point, radius), integrals(TISSUE.mesh, np.array(point), radius)
        weights = np.zeros(len(expected))
        weights[found.nodes] = found.weights
        assert found.weights.sum() == pytest.approx(1, abs=1e-14)
        assert found.weights.min() > 0
        assert np.abs(weights - expected / expected.sum()).max() < 3e-4 * weights.max()


def test_the_weighted_mean_of_nodal_values_is_the_mean_of_the_field():
    """For linear fields: the patch's middle; for the whole of φ on a plane: ∫φ = π r²/3."""
    point, radius = np.array([23.7, 26.1, 50.0]), 11.0
    found = patch(TISSUE, point, radius)
    np.testing.assert_allclose(found.weights @ TISSUE.mesh.nodes[found.nodes], point, atol=1e-4 * radius)
    assert integrals(TISSUE.mesh, point, radius).sum() == pytest.approx(np.pi * radius**2 / 3, rel=1e-3)


def test_inside_the_radius_the_integrals_are_exact():
    """Seven points are exact to degree five, the degree of N_a φ: one coarse triangle wholly inside a large patch."""
    corners = np.array([[0.0, 0, 0], [4.0, 0, 0], [1.0, 3.0, 0]])
    surface = _core.tissue.ContactSurface(corners, np.array([[0, 1, 2]], np.int32), np.zeros(3, np.uint8))
    found = surface.patch(surface.closest(np.array([1.0, 1.0, 0.0])), 5.0)
    rule, weight = np.polynomial.legendre.leggauss(8)  # on the square that collapses onto the triangle
    s, t = (g.ravel() for g in np.meshgrid((rule + 1) / 2, (rule + 1) / 2))
    w = np.outer(weight, weight).ravel() * (1 - s)
    part = np.column_stack([s, (1 - s) * t, (1 - s) * (1 - t)])
    phi = (1 - ((part @ corners - [1.0, 1.0, 0.0]) ** 2).sum(axis=1) / 25) ** 2
    expected = (w * phi) @ part / (w @ phi)
    np.testing.assert_allclose(found.weights[np.argsort(found.nodes)], expected, rtol=1e-13)


def test_a_sliding_contact_changes_its_weights_without_a_step():
    before = None
    for x in np.linspace(20, 30, 400):
        found, weights = patch(TISSUE, [x, 24.0, 50.0], 9.0), np.zeros(len(TISSUE.mesh.nodes))
        weights[found.nodes] = found.weights
        assert before is None or np.abs(weights - before).max() < 2e-3  # 0.025 mm of a 9 mm patch
        before = weights


def test_areas_share_out_the_whole_surface():
    assert TISSUE.surface.areas.sum() == pytest.approx(6 * 50**2)


def test_no_node_inside_gives_the_barycentric_weights():
    point = np.array([22.0, 26.5, 50.0])
    found = patch(TISSUE, point, 0.5)
    assert len(found.nodes) == 3
    np.testing.assert_allclose(found.weights @ TISSUE.mesh.nodes[found.nodes], point, atol=1e-12)
    assert found.weights.sum() == pytest.approx(1)


def test_a_thin_wall_is_touched_on_one_side_only():
    plate = brick((20, 20, 1), (40.0, 40.0, 2.0))
    tissue = pp.Tissue(plate, 5, 0.3, plate.nodes[:, 0] == 0)
    found = patch(tissue, [20.0, 21.0, 2.0], 8.0)
    assert len(found.nodes) > 20
    assert (plate.nodes[found.nodes, 2] == 2.0).all()


def test_facing_walls_of_a_slit_are_not_joined():
    # A U: two arms, 2 mm apart; a patch on the inner wall of one must not reach the other arm, nor jump to its top.
    whole = brick((11, 4, 10), (22.0, 8.0, 40.0))
    centre = whole.nodes[whole.tets].mean(axis=1)
    keep = ~((centre[:, 0] > 10) & (centre[:, 0] < 12) & (centre[:, 2] > 8))
    used, tets = np.unique(whole.tets[keep], return_inverse=True)
    mesh = pp.TetMesh(whole.nodes[used], tets.reshape(-1, 4))
    tissue = pp.Tissue(mesh, 5, 0.3, mesh.nodes[:, 2] == 0)
    found = patch(tissue, [10.0, 4.0, 28.0], 6.0)
    assert len(found.nodes) > 3
    assert (mesh.nodes[found.nodes, 0] <= 10).all()  # none of the other arm; some round this arm's own edges
    assert found.weights[mesh.nodes[found.nodes, 0] == 10].sum() > 0.9


def test_a_shelf_below_that_faces_the_same_way_is_not_joined():
    # A C: two shelves 2 mm apart that meet in a wall; from the upper one's top, the lower one's top is 4 mm away.
    whole = brick((10, 5, 3), (20.0, 10.0, 6.0))
    centre = whole.nodes[whole.tets].mean(axis=1)
    keep = ~((centre[:, 0] > 4) & (centre[:, 2] > 2) & (centre[:, 2] < 4))
    used, tets = np.unique(whole.tets[keep], return_inverse=True)
    mesh = pp.TetMesh(whole.nodes[used], tets.reshape(-1, 4))
    tissue = pp.Tissue(mesh, 5, 0.3, mesh.nodes[:, 0] == 0)
    found = patch(tissue, [15.0, 5.0, 6.0], 6.0)
    assert len(found.nodes) > 10
    assert (mesh.nodes[found.nodes, 2] >= 4).all()  # none of the lower shelf; some round the upper one's own edges
    assert found.weights[mesh.nodes[found.nodes, 2] == 6].sum() > 0.9


def test_held_nodes_carry_no_weight():
    found = patch(TISSUE, [25.0, 0.0, 6.0], 12.0)
    assert (TISSUE.mesh.nodes[found.nodes, 2] > 0).all()
    assert found.weights.sum() == pytest.approx(1)


@settings(max_examples=60, deadline=None)
@given(st.tuples(*[st.floats(-20, 70)] * 3))
def test_the_nearest_surface_point_is_nearest(point):
    p = np.array(point)
    hit = TISSUE.surface.closest(p)
    # On a cube: clamp from outside; from inside, the nearest face.
    outside = np.linalg.norm(p - p.clip(0, 50))
    expected = outside if outside > 0 else min(p.min(), (50 - p).min())
    assert hit.distance == pytest.approx(expected, abs=1e-9)
    assert np.linalg.norm(hit.point - p) == pytest.approx(hit.distance, abs=1e-9)
    assert hit.weights.min() >= 0
    assert hit.weights.sum() == pytest.approx(1)


def test_a_point_whose_distance_overflows_has_a_nearest_point():
    """A command is finite, and no more is known of it: a triangle -1 would be read from before the arrays."""
    for point in ((1e300, 0.0, 25.0), (-1e200, 1e200, 1e300)):
        assert TISSUE.surface.closest(np.array(point)).triangle >= 0


def test_the_nearest_point_on_an_irregular_surface_agrees_with_a_search_of_all_triangles():
    rng = np.random.default_rng(3)
    mesh = brick((4, 4, 4))
    bent = pp.TetMesh(mesh.nodes + 3 * np.sin(mesh.nodes[:, [1, 2, 0]] / 9), mesh.tets)
    tissue = pp.Tissue(bent, 5, 0.3, mesh.nodes[:, 2] == 0)
    corners = bent.nodes[bent.surface]
    grid = np.array([(i, j, 40 - i - j) for i in range(41) for j in range(41 - i)]) / 40
    cloud = np.einsum("kc,tcd->tkd", grid, corners).reshape(-1, 3)  # at most a fortieth of an edge apart
    for p in rng.uniform(-30, 80, (25, 3)):
        sampled = np.linalg.norm(cloud - p, axis=1).min()
        found = tissue.surface.closest(p).distance
        assert found <= sampled + 1e-9
        assert found >= sampled - 0.6  # the cloud's own coarseness


@pytest.mark.parametrize(
    ("point", "radius", "words"),
    [
        ([25, 25, 70], 5.0, ["point", "20 mm off", "50.0"]),
        ([25, 25, 50], -1.0, ["radius", "-1", "edges"]),
        ([25, 25, 50], np.nan, ["radius", "nan"]),
        ([25, 25, np.inf], 5.0, ["point", "finite"]),
        ([25, 25], 5.0, ["point", "(3)", "(2,)"]),
        ([25, 25, 0], 4.0, ["[25.0, 25.0, 0.0]", "held still", "elsewhere"]),
        ([25, 25, 50], 100.0, ["radius", "256 nodes", "smaller"]),
    ],
)
def test_what_cannot_be_touched_is_refused(point, radius, words):
    with pytest.raises(ValueError) as refusal:
        patch(block(21) if radius == 100 else TISSUE, point, radius)
    for word in words:
        assert word in str(refusal.value)


@pytest.mark.parametrize("name", ["finite elements", "springs", "blocks"])
def test_pushes_that_cannot_be_are_refused_by_every_model(name):
    tissue = block(6)
    push = pp.finite_elements(tissue).push if name == "finite elements" else pp.model(tissue, name).push
    for arguments, words in [
        (
            {"points": [25, 25, 50], "displacements": [0, 0, -1], "radii": 9, "friction": -0.5},
            ["friction", "-0.5", "inf"],
        ),
        ({"points": [25, 25, 50], "displacements": [0, 0, np.nan], "radii": 9}, ["displacements", "finite"]),
        ({"points": [[25, 25, 50]] * 2, "displacements": [[0, 0, -1]] * 3, "radii": 9}, ["displacements", "(3, 3)"]),
        ({"points": [[25, 25, 50]] * 2, "displacements": [[0, 0, -1]] * 2, "radii": 9}, ["overlap", "apart"]),
        ({"points": [[25, 25, 50]], "displacements": [[0, 0, -1]], "radii": [9, 9]}, ["radii", "(2,)"]),
        ({"points": np.zeros((0, 3)), "displacements": np.zeros((0, 3)), "radii": 9}, ["points", "no contact"]),
    ]:
        with pytest.raises(ValueError) as refusal:
            push(**arguments)
        for word in words:
            assert word in str(refusal.value)


def test_a_patch_holds_what_the_native_model_says():
    with pytest.raises(ValueError, match="256"):
        _core.tissue.ContactPatch(np.zeros(257, dtype=np.int32), np.zeros(257))
    assert _core.tissue.ContactPatch.capacity == 256


@pytest.mark.parametrize("name", ["springs", "blocks"])
def test_felt_stiffness_does_not_ripple_as_the_contact_slides(name):
    # 56 points over 23 mm, more than four edges of 5 mm, past nodes, edges and faces; patch of two lattice edges.
    model, s = pp.model(block(11, element="P1"), name), np.linspace(0, 1, 56)  # the weights are what is tried
    path = np.stack([14 + 22 * s, 21 + 8 * s, np.full(56, 50.0)], axis=1)
    stiffness = np.array([model.push(p, [0, 0, -1.0], 10.0, tolerance=0.01).force[2] for p in path])
    smooth = np.polyval(np.polyfit(s, stiffness, 2), s)  # the cube itself is softer near its rim
    assert np.ptp(stiffness - smooth) / stiffness.mean() < 0.05
    assert np.ptp(stiffness) / stiffness.mean() < 0.10


@pytest.mark.parametrize("name", ["springs", "blocks"])
def test_nor_does_it_on_a_mesh_by_stuffing(name):
    """Irregular elements of 5 mm below a flat face; what is left when the slow change towards the rim is taken out."""
    grid = pp.Grid((28, 28, 28), (2, 2, 2))
    values = np.zeros(grid.shape, dtype=int)
    values[3:25, 2:26, 2:26] = 1
    mesh = pp.tetrahedralize(pp.Labels(values, grid), 1, 5.0)
    tissue = pp.Tissue(mesh, 5.0, 0.45, pp.resting_on(mesh, (0, 0, -1), depth=2.0), element="P1")  # the weights' test
    s = np.linspace(0, 1, 60)
    path = np.stack([14 + 23 * s, 21 + 9 * s, np.full(60, mesh.nodes[:, 2].max())], axis=1)
    model = pp.model(tissue, name)
    stiffness = np.array([model.push(p, [0, 0, -1.0], 10.0, tolerance=0.01).force[2] for p in path])
    smooth = np.polyval(np.polyfit(s, stiffness, 2), s)
    assert stiffness.min() > 0.05
    assert np.ptp(stiffness - smooth) / stiffness.mean() < 0.10


@pytest.mark.parametrize("offset", [2.0, 5.0, 9.0])
def test_weights_beside_a_cut_do_not_hang_on_rounding(offset):
    """Where the lips end, they share vertices, and the normals of their faces cancel but for rounding."""
    tissue = organ(6)
    top = tissue.mesh.nodes[np.argmax(tissue.mesh.nodes[:, 2])] + (0.37, 0, 0)
    way = [tissue.surface.closest(top + (0, y, 0)).point for y in (-15.7, 0.23, 16.4)]
    cut = pp.cut(tissue, pp.incision(tissue, way, 16.0))
    places, triangles, held = touched_surface(cut.mesh, cut.held)
    point = tissue.surface.closest(np.array(way[1]) - (offset, 0, 0)).point

    def weights(moved):
        surface = _core.tissue.ContactSurface(moved, np.ascontiguousarray(triangles), held.view(np.uint8))
        found = surface.patch(surface.closest(point), 20.0)
        out = np.zeros(len(places))
        out[found.nodes] = found.weights
        return out

    expected = weights(places)
    random = np.random.default_rng(3)
    for _ in range(5):
        moved = places + 1e-12 * random.normal(size=places.shape)
        np.testing.assert_allclose(weights(moved), expected, atol=1e-9)
