"""Graded meshes: small elements at an inclusion, large ones far away, and all that a mesh must be in between."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes.test_isosurface_stuffing import angles, check_solid, skin, tet_volumes

import palpate as pp
from palpate.errors import MeshError
from palpate.meshes.stuffing.graded_bcc_lattice import octree
from palpate.meshes.stuffing.nested_solids import solids


def far_and_near(mesh, centre, radius, reach):
    """Mean edge further than `reach` mm from the ball, and inside region 2."""
    x = mesh.nodes[mesh.tets]
    edge = np.mean([np.linalg.norm(x[:, i] - x[:, j], axis=1) for i in range(4) for j in range(i)], axis=0)
    away = np.linalg.norm(x.mean(axis=1) - centre, axis=1) > radius + reach
    return edge[away].mean() if np.count_nonzero(away) > 100 else np.nan, edge[mesh.region == 2].mean()


def check_mesh(mesh, labels, names=(1, 2)):
    check_solid(mesh.nodes, mesh.tets)
    check_solid(mesh.nodes, mesh.tets[mesh.region == 2])
    assert angles(mesh.nodes, mesh.tets).min() >= 10
    for value in names:
        of_label = np.count_nonzero(labels.values == value) * labels.grid.voxel_volume
        assert mesh.volumes[mesh.region == value].sum() == pytest.approx(of_label, rel=0.03)
    outer = {tuple(sorted(face)) for face in skin(mesh.tets[mesh.region == 1]).tolist()}
    assert all(tuple(sorted(face)) in outer for face in skin(mesh.tets[mesh.region == 2]).tolist())


def organ_with_ball(kind, half, centre, radius, spacing=(0.8, 0.6, 0.6)):
    """A block or an ellipsoid of half-widths `half` about the origin, in it a ball: labels 1 and 2, x, y, z in mm."""
    half = np.asarray(half, dtype=float)
    shape = [int(2 * half[2 - i] / spacing[i]) + 7 for i in range(3)]
    first = [-(shape[2 - i] - 1) / 2 * spacing[2 - i] for i in range(3)]
    grid = pp.Grid(tuple(shape), spacing, tuple(first))
    points = grid.points(np.argwhere(np.ones(shape)))
    apart = np.abs(points / half).max(axis=1) if kind == "block" else np.linalg.norm(points / half, axis=1)
    organ = apart < 1
    lump = np.linalg.norm(points - centre, axis=1) < radius
    assert organ[lump].all()
    return pp.Labels((organ + lump * 1).reshape(shape), grid, {1: "organ", 2: "lump"})


@st.composite
def cases(draw):
    kind = draw(st.sampled_from(["block", "ellipsoid"]))
    half = np.array([draw(st.floats(13, 18)) for _ in range(3)])
    radius = draw(st.floats(2.0, 4.0))
    fine = draw(st.floats(radius / 2.6, radius / 1.8))
    edge = min(fine * draw(st.floats(1.6, 4.5)), 7.0)
    # Anywhere, down to two fine edges below the surface.
    room = half - radius - 2 * fine - 1
    if kind == "block":
        centre = room * [draw(st.floats(-1, 1)) for _ in range(3)]
    else:
        toward = np.array([draw(st.floats(-1, 1)) for _ in range(3)])
        centre = room.min() / half.min() * half * toward / max(1.0, float(np.linalg.norm(toward)))
        if 1 - np.linalg.norm(centre / half) < (radius + 2 * fine) / half.min():
            centre = centre * 0.9
    return kind, half, centre, radius, fine, edge


@settings(max_examples=8, deadline=None, derandomize=True)
@given(cases())
def test_a_ball_anywhere_in_a_block_or_ellipsoid(case):
    kind, half, centre, radius, fine, edge = case
    labels = organ_with_ball(kind, half, centre, radius)
    mesh = pp.tetrahedralize(labels, "organ", edge, inclusions=["lump"], fine={"lump": fine})
    check_mesh(mesh, labels)
    far, near = far_and_near(mesh, centre, radius, 3 * edge)
    assert near == pytest.approx(fine, rel=0.3)
    assert np.isnan(far) or far == pytest.approx(edge, rel=0.3)


def breast():
    """200 x 62 x 51 mm, flat at the chest wall and between two plates, as large voxels as its lesion of 2.8 mm bears."""
    grid = pp.Grid((64, 250, 78), (0.8, 0.8, 0.8), (0.0, -100.0, 0.0))
    points = grid.points(np.argwhere(np.ones(grid.shape)))
    rounded = 1 - 0.12 * ((points[:, 2] - 25) / 25) ** 4
    organ = np.hypot(points[:, 0] / 62, points[:, 1] / 100) < rounded
    return grid, points, organ


@pytest.mark.parametrize(
    ("centre", "radius", "edge", "fine", "most"),
    [((31, 12, 22), 2.8, 7.0, 1.5, 40_000), ((30, 5, 41), 7.0, 7.0, 3.0, 40_000)],
    ids=["lesion of 2.8 mm", "training lump of 7 mm, 2 mm below the plate"],
)
def test_breast_with_a_small_lesion_or_a_shallow_lump(centre, radius, edge, fine, most):
    grid, points, organ = breast()
    lump = np.linalg.norm(points - centre, axis=1) < radius
    labels = pp.Labels((organ + lump * 1).reshape(grid.shape), grid, {1: "breast", 2: "lump"})
    mesh = pp.tetrahedralize(labels, 1, edge, inclusions=[2], fine={2: fine}, closed_at_border=True)
    again = pp.tetrahedralize(labels, 1, edge, inclusions=[2], fine={2: fine}, closed_at_border=True)
    assert (mesh.tets == again.tets).all()
    assert (mesh.nodes == again.nodes).all()
    check_mesh(mesh, labels)
    assert len(mesh.tets) <= most
    far, near = far_and_near(mesh, centre, radius, 3 * edge)
    assert far == pytest.approx(edge, rel=0.3)
    assert near == pytest.approx(fine, rel=0.3)
    inner = mesh.nodes[np.unique(skin(mesh.tets[mesh.region == 2]))]
    assert np.abs(np.linalg.norm(inner - centre, axis=1) - radius).max() < 0.35 * fine


def test_two_lumps_of_different_fineness_and_one_of_none():
    labels = organ_with_ball("block", (22, 16, 15), (-12, 2, 0), 3.0)
    points = labels.grid.points(np.argwhere(np.ones(labels.grid.shape)))
    values = labels.values.copy().ravel()
    values[np.linalg.norm(points - [9, 0, 2], axis=1) < 4.5] = 3
    values[np.linalg.norm(points - [-1, -7, -5], axis=1) < 5] = 4
    labels = pp.Labels(values.reshape(labels.grid.shape), labels.grid)
    mesh = pp.tetrahedralize(labels, 1, 5.0, inclusions=[4, 2, 3], fine={2: 1.25, 3: 2.5})
    check_mesh(mesh, labels, names=(1, 2, 3, 4))
    count = {value: np.count_nonzero(mesh.region == value) / np.count_nonzero(values == value) for value in (2, 3, 4)}
    assert count[2] > 3 * count[3] > 3 * count[4]


def test_the_number_of_tets_is_foretold():
    from palpate.meshes.stuffing.sizing_field import grading

    for fine, edge in ((1.2, 3.0), (0.8, 4.0), (1.5, 6.0)):
        labels = organ_with_ball("block", (18, 17, 16), (2, -3, 4), 3.0)
        mesh = pp.tetrahedralize(labels, 1, edge, inclusions=[2], fine={2: fine})
        bodies = solids(labels, 1, [2], keep="largest", fill_holes=True, closed_at_border=False)
        sizes = grading(bodies, [edge, fine])
        assert 2 / 3 < sizes.tets(bodies, 1.1 * edge * sizes.scale) / len(mesh.tets) < 3 / 2


@settings(max_examples=10, deadline=None, derandomize=True)
@given(st.integers(0, 2**32 - 1), st.integers(1, 3))
def test_octree_of_random_cells_fills_space_without_gaps(seed, depth):
    rng = np.random.default_rng(seed)
    grid = octree([5, 4, 6], depth, lambda level, cells: rng.random(len(cells)) < 0.15)
    x = grid.place.astype(float)
    tets = grid.tets.copy()
    flip = tet_volumes(x, tets) < 0
    tets[flip] = tets[flip][:, [0, 2, 1, 3]]
    assert angles(x, tets).min() == pytest.approx(45)
    # Faces in one tet only lie in the outermost layer of cells, so there is no gap inside; nor do tets overlap.
    side = 2 ** (depth + 1)
    middle = x[skin(tets)].mean(axis=1)
    box = np.array([5, 4, 6]) * side
    assert ((middle < side) | (middle > box - side)).any(axis=1).all()
    points = rng.uniform(side, box - side, (50, 3))
    a = x[tets]
    inverse = np.linalg.inv((a[:, 1:] - a[:, :1]).transpose(0, 2, 1))
    for point in points:
        weights = np.einsum("mij,mj->mi", inverse, point - a[:, 0])
        assert ((weights > 0).all(axis=1) & (weights.sum(axis=1) < 1)).sum() == 1


BAD = {
    "not an inclusion": ({1: 1.0}, r"fine: label 1 is not among the inclusions \[2\]; name it there too"),
    "longer than the organ's": (
        {2: 9.0},
        r"fine: expected an edge for 'lump' above 0 and up to the organ's 4 mm, got 9",
    ),
    "negative": ({2: -1.0}, r"fine: expected an edge for 'lump' above 0 .* got -1"),
    "not a number": ({"lump": float("nan")}, r"fine: expected an edge for 'lump' .* got nan"),
    "too small by far": ({2: 0.05}, r"fine: 0.05 mm for 'lump' is less than 1/32 of .* 4 mm; use 0.12 mm or more"),
}


@pytest.mark.parametrize("case", BAD, ids=str)
def test_fine_edges_that_make_no_sense_are_refused(case):
    fine, message = BAD[case]
    labels = organ_with_ball("block", (14, 13, 12), (0, 0, 0), 3.0)
    with pytest.raises(MeshError, match=message):
        pp.tetrahedralize(labels, 1, 4.0, inclusions=[2], fine=fine)


def test_too_many_tets_at_an_inclusion_are_refused_before_work_starts():
    labels = organ_with_ball("block", (18, 18, 18), (0, 0, 0), 14.0)
    with pytest.raises(MeshError, match=r"fine: 0.25 mm at 'lump' .* million tets, at most 5 million .* use 0\.\d+ mm"):
        pp.tetrahedralize(labels, 1, 6.0, inclusions=[2], fine={2: 0.25})


def test_a_fine_edge_equal_to_the_organs_changes_nothing():
    labels = organ_with_ball("block", (14, 13, 12), (0, 0, 0), 4.0)
    plain = pp.tetrahedralize(labels, 1, 3.0, inclusions=[2])
    same = pp.tetrahedralize(labels, 1, 3.0, inclusions=[2], fine={2: 3.0})
    assert (plain.tets == same.tets).all()
    assert (plain.nodes == same.nodes).all()


def test_a_fine_edge_a_little_below_the_organs_is_met_by_one_size():
    labels = organ_with_ball("block", (20, 20, 20), (0, 0, 0), 10.0, (2.0, 2.0, 2.0))
    mesh = pp.tetrahedralize(labels, "organ", edge=8.0, inclusions=["lump"], fine={"lump": 7.0})
    away, near = far_and_near(mesh, (0, 0, 0), 10.0, 2.0)
    assert near == pytest.approx(away, rel=0.15)
    assert 7.0 * 0.8 < near < 8.0 * 1.2


def test_command(tmp_path):
    from typer.testing import CliRunner

    from palpate.commands import app

    labels = organ_with_ball("block", (14, 13, 12), (0, 0, 0), 3.0)
    pp.write_labels(tmp_path / "l.nii.gz", labels)
    command = ["mesh", str(tmp_path / "l.nii.gz"), "--label", "1", "--inclusion", "2", "--edge", "4"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        done = CliRunner().invoke(app, [*command, "--fine", "2=1.5", "-o", str(tmp_path / "m.vtu")])
    assert done.exit_code == 0, done.output
    mesh = pp.read_mesh(tmp_path / "m.vtu")
    count = np.bincount(mesh.region)
    assert count[2] > 100
    assert len(mesh.tets) < 20_000
    wrong = CliRunner().invoke(app, [*command, "--fine", "2:1.5", "-o", str(tmp_path / "n.vtu")])
    assert wrong.exit_code != 0
    assert "2:1.5: expected a label and a length in mm" in " ".join(wrong.output.replace("│", " ").split())
    assert not (tmp_path / "n.vtu").exists()


def test_elements_are_shorter_at_the_points_alone():
    """Points in the patient's axes, of a mesh whose labels do not begin at the origin."""
    labels = organ_with_ball("ellipsoid", (20, 16, 14), (0, 0, 0), 3.0, (1.0, 0.8, 0.8))
    line = np.stack(np.meshgrid(np.arange(10, 20, 1.0), np.arange(-16, 17, 1.0), np.arange(-14, 15, 1.0)), axis=-1)
    mesh = pp.tetrahedralize(labels, "organ", 5, finer_at={2.5: line.reshape(-1, 3)})
    assert angles(mesh.nodes, mesh.tets).min() >= 10
    x = mesh.nodes[mesh.tets]
    edge = np.mean([np.linalg.norm(x[:, i] - x[:, j], axis=1) for i in range(4) for j in range(i)], axis=0)
    middle = x.mean(axis=1)[:, 0]
    assert edge[middle > 10].mean() == pytest.approx(2.5, rel=0.2)
    assert edge[middle < 2].mean() == pytest.approx(5, rel=0.2)
    same = pp.tetrahedralize(labels, "organ", 5, finer_at={})
    np.testing.assert_array_equal(same.nodes, pp.tetrahedralize(labels, "organ", 5).nodes)


@pytest.mark.parametrize(
    "wrong", [{6.0: [[0, 0, 0]]}, {0.1: [[0, 0, 0]]}, {float("nan"): [[0, 0, 0]]}, {2.5: [[0, 0]]}]
)
def test_points_and_lengths_that_cannot_be_are_refused(wrong):
    labels = organ_with_ball("block", (12, 12, 12), (0, 0, 0), 3.0)
    with pytest.raises(ValueError, match="finer_at"):
        pp.tetrahedralize(labels, "organ", 5, finer_at=wrong)
