"""Walls around lumens: their volume, topology and thickness."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from support.lumens import R, bent, blind, forked, labels_of, straight

import palpate as pp


def euler(mesh):
    """Vertices - edges + triangles of the surface: 2 for each closed part, less 2 for each handle."""
    faces = mesh.surface
    edges = np.unique(np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1), axis=0)
    return len(np.unique(faces)) - len(edges) + len(faces)


def watertight(mesh):
    """Whether each edge of the surface has exactly two triangles."""
    faces = mesh.surface
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


@pytest.mark.parametrize(("wall", "layers"), [(1.5, 1), (2.0, 2), (3.0, 3)])
def test_a_straight_tube_has_the_wall_that_was_asked_for(wall, layers):
    labels, middle, axis = straight((1, 1, 1))
    mesh = pp.hollow_mesh(labels, "tube", wall, 3, layers=layers)
    apart = mesh.nodes - middle
    along = apart @ axis
    away = np.linalg.norm(apart - along[:, None] * axis, axis=1)
    count = len(mesh.nodes) // (layers + 1)
    inner, outer = away[:count], away[-count:]
    assert inner.mean() == pytest.approx(R, abs=0.25)
    np.testing.assert_allclose(inner, R, atol=0.5)
    np.testing.assert_allclose(outer - inner, wall, atol=0.06 * wall)
    assert mesh.volumes.sum() == pytest.approx(np.pi * ((R + wall) ** 2 - R**2) * 45, rel=0.04)
    assert along.max() == pytest.approx(22.5, abs=0.2)
    assert along.min() == pytest.approx(-22.5, abs=0.2)
    assert watertight(mesh)
    assert euler(mesh) == 0
    assert mesh.names == {1: "tube wall"}


@pytest.mark.parametrize(("labels", "expected"), [(bent()[0], 0), (forked(), -2), (blind()[0], 4)])
def test_it_is_open_where_the_volume_ends_and_closed_elsewhere(labels, expected):
    """A bend has one handle, a fork with three openings two; around a closed lumen there are two surfaces."""
    mesh = pp.hollow_mesh(labels, 1, 2, 3)
    assert watertight(mesh)
    assert euler(mesh) == expected


def test_nothing_of_the_wall_is_in_the_lumen():
    labels = forked()
    mesh = pp.hollow_mesh(labels, 1, 2, 3)
    middles = mesh.nodes[mesh.tets].mean(axis=1)
    at = np.round(labels.grid.indices(middles)).astype(int)
    kept = ((at >= 0) & (at < labels.grid.shape)).all(axis=1)
    inside = labels.values[tuple(at[kept].T)] == 1
    assert inside.mean() < 0.04  # next to the staircase of the voxels


def test_walls_of_two_loops_do_not_meet():
    """Two tubes of one lumen that run 2 mm apart get walls of half of that, and a warning."""

    def inside(x):
        x = x - np.array([12.0, 20.0, 36.0])
        legs = np.minimum(np.hypot(x[..., 1] - 6, x[..., 0]), np.hypot(x[..., 1] + 6, x[..., 0]))
        turn = np.hypot(np.hypot(x[..., 1], x[..., 2] + 8) - 6, x[..., 0])
        return np.where(x[..., 2] > -8, legs, turn) < 5

    labels = labels_of(inside, (55, 32, 30), (1, 1, 1))
    with pytest.warns(UserWarning, match="thinner than 80%"):
        mesh = pp.hollow_mesh(labels, 1, 3, 2.5)
    count = len(mesh.nodes) // 3
    outer = mesh.nodes[-count:]
    upper = outer[:, 2] > 36
    left, right = (outer[upper & (sign * (outer[:, 1] - 20) > 0)] for sign in (-1, 1))
    assert left[:, 1].max() < right[:, 1].min() + 0.6
    assert watertight(mesh)


@settings(max_examples=8, deadline=None)
@given(
    st.lists(st.tuples(*[st.floats(-1, 1)] * 3), min_size=2, max_size=3),
    st.floats(4.5, 7),
    st.floats(1.5, 3),
)
def test_any_smooth_tube_gets_a_closed_wall(bends, radius, wall):
    """Tubes around sums of sines. None may fold (a TetMesh refuses inverted tets), leak, or lose its volume."""
    amounts = np.array(bends) * 5

    def axis(t):
        waves = np.array([np.sin((k + 1) * np.pi * t) for k in range(len(amounts))])
        return np.stack([24 + (amounts[:, 0] @ waves), 30 + (amounts[:, 1] @ waves), 11 + 50 * t], axis=-1)

    tree = cKDTree(axis(np.linspace(-0.2, 1.2, 400)))

    def inside(x):
        return tree.query(x, distance_upper_bound=radius)[0] < radius

    labels = labels_of(inside, (50, 60, 60), (1, 1, 1))
    mesh = pp.hollow_mesh(labels, 1, wall, 3)
    assert watertight(mesh)
    assert euler(mesh) == 0
    count = len(mesh.nodes) // 3
    thickness = np.linalg.norm(mesh.nodes[-count:] - mesh.nodes[:count], axis=1)
    assert np.median(thickness) == pytest.approx(wall, rel=1e-6)


def test_the_centre_line_stays_with_mesh_tissue_and_cut_tissue(tmp_path):
    labels = forked()
    mesh = pp.hollow_mesh(labels, 1, 2, 4)
    pp.write_mesh(tmp_path / "mesh.vtu", mesh)
    held = np.abs((mesh.nodes - mesh.centerline.openings[0, :3]) @ mesh.centerline.openings[0, 3:]) < 1
    tissue = pp.Tissue(pp.read_mesh(tmp_path / "mesh.vtu"), young=100, poisson=0.45, fixed=held)
    pp.write_tissue(tmp_path / "tissue.vtu", tissue)
    point = mesh.nodes[mesh.surface[0]].mean(axis=0)
    blade = pp.Blade(
        [point - (4, 4, 0), point + (4, -4, 0), point + (4, 4, 1), point + (-4, 4, 1)], [(0, 1, 2), (0, 2, 3)]
    )
    cut = pp.cut(pp.read_tissue(tmp_path / "tissue.vtu"), blade, loose="remove")
    pp.write_tissue(tmp_path / "cut.vtu", cut)
    for again in (tissue, pp.read_tissue(tmp_path / "tissue.vtu"), cut, pp.read_tissue(tmp_path / "cut.vtu")):
        line = again.mesh.centerline
        np.testing.assert_allclose(line.points, mesh.centerline.points, rtol=1e-7)
        np.testing.assert_array_equal(line.branch, mesh.centerline.branch)
        np.testing.assert_allclose(line.openings, mesh.centerline.openings, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"wall": 0.0}, "positive thickness"),
        ({"wall": np.nan}, "positive thickness"),
        ({"layers": 0}, "layers"),
        ({"label": "colon"}, "absent"),
        ({"edge": 40.0}, "edge"),
    ],
)
def test_what_cannot_be_is_refused(change, said):
    given = {"label": "tube", "wall": 2.0} | change
    with pytest.raises(pp.errors.PalpateError, match=said):
        pp.hollow_mesh(straight()[0], **given)


def test_what_counts_as_no_opening_is_closed_at_the_side(monkeypatch):
    """A lumen that touches a side in too few voxels is not continued beyond it; here a whole tube counts as such."""
    monkeypatch.setattr("palpate.volumes.centerline.FEWEST_OPEN", 10**6)
    labels, middle, axis = straight((1, 1, 1))
    mesh = pp.hollow_mesh(labels, "tube", 2, 3)
    assert watertight(mesh)
    assert euler(mesh) == 4
    assert np.abs((mesh.nodes - middle) @ axis).max() < 22.5 + 2.2
