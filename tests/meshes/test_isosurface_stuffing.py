"""Isosurface stuffing: what a mesh of tetrahedra must be, whatever the label."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

import palpate as pp
from palpate.meshes.stuffing.isosurface_stuffing import stuff
from palpate.samples import sample

CORNERS = [(1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1)]  # faces of a positive tet, seen anticlockwise from outside


def angles(nodes, tets):
    """Six dihedral angles of each tet in degrees, from the outward normals of its faces."""
    normals = []
    for face in CORNERS:
        a, b, c = (nodes[tets[:, i]] for i in face)
        n = np.cross(b - a, c - a)
        normals.append(n / np.linalg.norm(n, axis=1)[:, None])
    cosines = [-(normals[i] * normals[j]).sum(axis=1) for i in range(4) for j in range(i)]
    return np.degrees(np.arccos(np.clip(cosines, -1, 1)))


def tet_volumes(nodes, tets):
    return np.linalg.det(nodes[tets[:, 1:]] - nodes[tets[:, :1]]) / 6


def skin(tets):
    """Faces that belong to one tet, outward; fails if three tets share one or two share it the same way round."""
    count, oriented = {}, {}
    for tet in np.asarray(tets).tolist():
        for face in CORNERS:
            nodes = tuple(tet[i] for i in face)
            first = nodes.index(min(nodes))
            cyclic = nodes[first:] + nodes[:first]
            assert cyclic not in oriented, "two tets lie on the same side of a face"
            oriented[cyclic] = nodes
            count[tuple(sorted(nodes))] = count.get(tuple(sorted(nodes)), 0) + 1
    assert max(count.values()) <= 2
    return np.array([nodes for nodes in oriented.values() if count[tuple(sorted(nodes))] == 1])


def check_solid(nodes, tets):
    """Positive tets, faces that fit, a closed oriented 2-manifold skin, Euler, and the volume inside the skin."""
    volume = tet_volumes(nodes, tets)
    assert volume.min() > 0
    surface = skin(tets)
    directed = surface[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    keys = set(map(tuple, directed.tolist()))
    assert len(keys) == len(directed), "an edge has two triangles on the same side"
    assert all((b, a) in keys for a, b in keys), "the skin is open"
    # One fan of triangles around each node: walking round it from any triangle meets them all.
    follow = {}
    for a, b, c in surface.tolist():
        for u, v, w in ((a, b, c), (b, c, a), (c, a, b)):
            follow.setdefault(u, {})[v] = w
    for steps in follow.values():
        start = next(iter(steps))
        at, walked = steps[start], 1
        while at != start:
            at, walked = steps[at], walked + 1
        assert walked == len(steps), "two fans of triangles meet at one node"
    # Euler: the characteristic of the skin is twice that of the solid.
    edges = {tuple(sorted((t[i], t[j]))) for t in tets.tolist() for i in range(4) for j in range(i)}
    faces = (4 * len(tets) + len(surface)) // 2
    solid = len(np.unique(tets)) - len(edges) + faces - len(tets)
    assert len(np.unique(surface)) - len(keys) // 2 + len(surface) == 2 * solid
    a, b, c = (nodes[surface[:, i]] for i in range(3))
    assert np.einsum("ij,ij->", np.cross(a, b), c) / 6 == pytest.approx(volume.sum(), rel=1e-9)
    return solid


def ball(grid, centre, radius):
    points = grid.points(np.argwhere(np.ones(grid.shape))) - centre
    return (np.linalg.norm(points / np.asarray(radius), axis=1) < 1).reshape(grid.shape)


@st.composite
def blobs(draw):
    """A sum of a few smooth bumps above a threshold: rounded, often lobed, sometimes in several parts."""
    grid = pp.Grid((22, 26, 24), (draw(st.sampled_from([1.0, 1.5])), 1.2, 1.0), (3.0, -20.0, 7.5))
    points = grid.points(np.argwhere(np.ones(grid.shape)))
    middle = grid.points([[10.5, 12.5, 11.5]])[0]
    total = np.zeros(len(points))
    for _ in range(draw(st.integers(1, 4))):
        offset = np.array([draw(st.floats(-3.5, 3.5)) for _ in range(3)])
        width = np.array([draw(st.floats(2.5, 5.0)) for _ in range(3)])
        total += np.exp(-0.5 * (((points - middle - offset) / width) ** 2).sum(axis=1))
    return pp.Labels((total > draw(st.floats(0.45, 0.8)) * total.max()).reshape(grid.shape), grid, {1: "blob"})


@settings(max_examples=20, deadline=None, derandomize=True)
@given(blobs(), st.sampled_from([1.3, 1.8, 2.4]))
def test_blobs_become_well_shaped_closed_solids_of_the_same_volume(labels, edge):
    part, _ = ndimage.label(labels.values)
    largest = np.bincount(part.ravel())[1:].max() * labels.grid.voxel_volume
    if largest < 150 * edge**3:  # fewer than some 1400 tets: no shape left to speak of
        edge = (largest / 150) ** (1 / 3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        mesh = pp.tetrahedralize(labels, "blob", edge)
    check_solid(mesh.nodes, mesh.tets)
    assert angles(mesh.nodes, mesh.tets).min() >= 10
    assert mesh.volumes.sum() == pytest.approx(largest, rel=0.03)


@pytest.mark.parametrize("seed", range(4))
def test_angles_hold_for_a_surface_as_rough_as_the_lattice(seed):
    """The promise of isosurface stuffing knows no smoothness: noise, and both sides of it, must keep 10 degrees."""
    rough = ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=(22, 22, 22)), 1.2)
    rough /= rough.std()

    def outer(points):
        return 9.5 - np.linalg.norm(points - 11, axis=1)

    def noise(points):
        value = ndimage.map_coordinates(rough, points.T, order=1, mode="nearest")
        return np.minimum(value, 6.0 - np.linalg.norm(points - 11, axis=1))

    nodes, tets, _ = stuff([noise], np.zeros(3), np.full(3, 22.0), 1.0)
    check_solid(nodes, tets)
    assert len(tets) > 1000
    assert angles(nodes, tets).min() >= 10
    nodes, tets, inside = stuff([outer, noise], np.zeros(3), np.full(3, 22.0), 1.0)
    check_solid(nodes, tets)
    check_solid(nodes, tets[inside[1]])
    # A tet with all four nodes on the inner surface cannot be left out; the paper promises nothing for it.
    shared = np.intersect1d(tets[inside[1]], tets[~inside[1]])
    assert angles(nodes, tets[~np.isin(tets, shared).all(axis=1)]).min() >= 10


def test_a_flat_tet_with_all_nodes_on_the_skin_is_left_out():
    """Found among rough surfaces: such a tet, inside by its middle, had 9.9 degrees."""
    rng = np.random.default_rng(10)
    rough = ndimage.gaussian_filter(rng.normal(size=(30, 30, 30)), rng.uniform(1.0, 3.0))
    rough = rough / rough.std() - 0.3
    field = [lambda points: ndimage.map_coordinates(rough, points.T, order=1, cval=-1)]
    nodes, tets, _ = stuff(field, np.array([3.0, 1.0, 4.0]), np.full(3, 9.0), 1.0)
    assert len(tets) > 1000
    assert angles(nodes, tets).min() >= 10


def test_volume_error_of_a_ball_falls_with_the_square_of_the_edge():
    error = []
    for cell in (2.0, 1.0, 0.5):
        nodes, tets, _ = stuff([lambda p: 6 - np.linalg.norm(p - 10.1, axis=1)], np.zeros(3), np.full(3, 20.0), cell)
        error.append(1 - tet_volumes(nodes, tets).sum() / (4 / 3 * np.pi * 6**3))
    assert 3 < error[0] / error[1] < 5
    assert 3 < error[1] / error[2] < 5


@pytest.mark.parametrize("height", [10.2, 10.25, 10.3, 10.5, 10.75])
@pytest.mark.parametrize("axis", range(3))
def test_a_flat_surface_anywhere_between_the_nodes_loses_no_tets(height, axis):
    """At quarters of a cell a plane cuts four edges of a tet in the middle, and its parts want different diagonals."""

    def outer(points):
        return 5 - np.abs(points - 10).max(axis=1)

    def upper(points):
        return np.minimum(points[:, axis] - height, outer(points) - 2)

    whole, tets, _ = stuff([outer], np.zeros(3), np.full(3, 20.0), 1.0)
    nodes, parted, inside = stuff([outer, upper], np.zeros(3), np.full(3, 20.0), 1.0)
    check_solid(nodes, parted)
    check_solid(nodes, parted[inside[1]])
    assert angles(nodes, parted).min() >= 10
    assert tet_volumes(nodes, parted).sum() == pytest.approx(tet_volumes(whole, tets).sum(), rel=1e-9)


def test_every_point_lies_in_exactly_one_tet():
    grid = pp.Grid((24, 24, 24), (1, 1, 1))
    mask = ball(grid, (11.3, 12.0, 11.7), (9.0, 7.0, 8.0))
    labels = pp.Labels(mask * 1 + ball(grid, (11.0, 12.5, 12.0), 3.5), grid)
    mesh = pp.tetrahedralize(labels, 1, 2.0, inclusions=[2])
    deep = np.argwhere(ndimage.binary_erosion(mask, iterations=2))
    points = grid.points(deep[::7] + np.random.default_rng(5).uniform(-0.5, 0.5, deep[::7].shape))
    a = mesh.nodes[mesh.tets]
    inverse = np.linalg.inv((a[:, 1:] - a[:, :1]).transpose(0, 2, 1))
    for point in points:
        weights = np.einsum("mij,mj->mi", inverse, point - a[:, 0])
        assert ((weights > 0).all(axis=1) & (weights.sum(axis=1) < 1)).sum() == 1


INCLUSIONS = {
    "concentric": ((20, 20, 20), 7.0, 3.0),
    "off centre": ((24, 18.5, 21), 6.0, 3.0),
    "small": ((17, 22, 20), 4.5, 3.0),
    "two edges deep": ((27.7, 20, 20), 4.5, 2.5),
    "one edge deep": ((20, 28.5, 22), 5.0, 3.0),
}


@pytest.mark.parametrize("case", INCLUSIONS, ids=str)
def test_boundary_of_an_inclusion_follows_element_faces(case):
    centre, radius, edge = INCLUSIONS[case]
    grid = pp.Grid((41, 41, 41), (1, 1, 1))
    organ, lump = ball(grid, (20, 20, 20), (17.0, 17.0, 16.0)), ball(grid, centre, radius)
    labels = pp.Labels(organ + lump * 4, grid, {1: "organ", 5: "lump"})
    mesh = pp.tetrahedralize(labels, "organ", edge, inclusions=["lump"])
    assert mesh.names == {1: "organ", 5: "lump"}
    check_solid(mesh.nodes, mesh.tets)
    check_solid(mesh.nodes, mesh.tets[mesh.region == 5])
    assert angles(mesh.nodes, mesh.tets).min() >= 10
    for value in (1, 5):
        of_label = np.count_nonzero(labels.values == value) * grid.voxel_volume
        assert mesh.volumes[mesh.region == value].sum() == pytest.approx(of_label, rel=0.03)
    inner = skin(mesh.tets[mesh.region == 5])
    outer = {tuple(sorted(face)) for face in skin(mesh.tets[mesh.region == 1]).tolist()}
    assert all(tuple(sorted(face)) in outer for face in inner.tolist())  # each face between lump and organ is shared
    away = np.linalg.norm(mesh.nodes[np.unique(inner)] - centre, axis=1) - radius
    assert np.abs(away).max() < 0.25 * edge


def test_lumps_side_by_side_and_a_core_within_a_lump():
    grid = pp.Grid((44, 40, 60), (1, 1, 1))
    values = ball(grid, (30, 20, 22), (26.0, 17.0, 18.0)).astype(int)
    values[ball(grid, (18, 20, 22), 9)] = 2
    values[ball(grid, (18, 20, 22), 4.5)] = 3
    values[ball(grid, (42, 21, 21), 6)] = 4
    mesh = pp.tetrahedralize(pp.Labels(values, grid), 1, 2.5, inclusions=[4, 3, 2])
    assert set(np.unique(mesh.region)) == {1, 2, 3, 4}
    check_solid(mesh.nodes, mesh.tets)
    assert angles(mesh.nodes, mesh.tets).min() >= 10
    for value in (1, 2, 3, 4):
        check_solid(mesh.nodes, mesh.tets[mesh.region == value])
        assert mesh.volumes[mesh.region == value].sum() == pytest.approx((values == value).sum(), rel=0.03)
    shell = skin(mesh.tets[mesh.region == 3])
    around = {tuple(sorted(face)) for face in skin(mesh.tets[mesh.region == 2]).tolist()}
    assert all(tuple(sorted(face)) in around for face in shell.tolist())  # the core touches its lump only


def turned(degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def test_the_mesh_moves_with_its_grid():
    grid = pp.Grid((20, 22, 24), (1.5, 1, 1))
    values = ball(grid, (11, 10, 14), (8.0, 7.0, 9.0)) * 1 + ball(grid, (11, 10, 14), 3.5)
    mesh = pp.tetrahedralize(pp.Labels(values, grid), 1, 2.0, inclusions=[2])
    again = pp.tetrahedralize(pp.Labels(values, grid), 1, 2.0, inclusions=[2])
    assert (again.nodes == mesh.nodes).all()
    assert (again.tets == mesh.tets).all()
    elsewhere = pp.Grid(grid.shape, grid.spacing, (-30.0, 55.5, 101.0), turned(30))
    moved = pp.tetrahedralize(pp.Labels(values, elsewhere), 1, 2.0, inclusions=[2])
    assert (moved.tets == mesh.tets).all()
    np.testing.assert_allclose(moved.nodes, mesh.nodes @ turned(30).T + [-30.0, 55.5, 101.0], atol=1e-9)
    padded = pp.Labels(np.pad(values, ((3, 1), (2, 2), (5, 0))), pp.Grid((24, 26, 29), grid.spacing))
    shifted = pp.tetrahedralize(padded, 1, 2.0, inclusions=[2])
    assert (shifted.tets == mesh.tets).all()
    np.testing.assert_allclose(shifted.nodes, mesh.nodes + np.array([5, 2, 4.5]), atol=1e-9)


@pytest.mark.parametrize("edge", [3.0, 4.0, 6.0])
def test_the_edge_asked_for_is_the_mean_edge(edge):
    labels = kidney()
    mesh = pp.tetrahedralize(labels, "kidney_left", edge, finer_where_thin=False)
    x = mesh.nodes[mesh.tets]
    lengths = [np.linalg.norm(x[:, i] - x[:, j], axis=1).mean() for i in range(4) for j in range(i)]
    assert np.mean(lengths) == pytest.approx(edge, rel=0.06)


def kidney():
    from palpate.volumes.label_names import with_names

    path = sample("abdomen") / "labels.nii.gz"
    return with_names(pp.read_labels(path), path)


def test_kidney_of_a_real_ct():
    labels = kidney()
    mesh = pp.tetrahedralize(labels, "kidney_left", 4)
    assert mesh.names == {3: "kidney_left"}
    assert check_solid(mesh.nodes, mesh.tets) == 1  # one solid without holes
    assert angles(mesh.nodes, mesh.tets).min() >= 10
    assert mesh.volumes.sum() == pytest.approx(np.count_nonzero(labels.values == 3) * 27.0, rel=0.01)
    # In patient space: the mesh's centre is the label's.
    centre = labels.grid.points(np.argwhere(labels.values == 3)).mean(axis=0)
    middle = (mesh.nodes[mesh.tets].mean(axis=1) * mesh.volumes[:, None]).sum(axis=0) / mesh.volumes.sum()
    np.testing.assert_allclose(middle, centre, atol=0.2)


def test_cubes_that_touch_at_an_edge_or_corner_come_apart():
    grid = pp.Grid((24, 24, 24), (1, 1, 1))
    values = np.zeros(grid.shape, dtype=int)
    values[3:12, 3:12, 3:12] = values[3:12, 12:21, 12:21] = values[12:21, 3:12, 12:21] = 1
    with pytest.warns(UserWarning, match="3 parts that do not touch; all are meshed"):
        mesh = pp.tetrahedralize(pp.Labels(values, grid), 1, 1.7, keep="all", smooth=0.2)
    check_solid(mesh.nodes, mesh.tets)
    assert mesh.volumes.sum() == pytest.approx(values.sum(), rel=0.03)


def test_a_noisy_mask_still_gives_a_manifold():
    grid = pp.Grid((22, 22, 22), (1, 1, 1))
    noise = np.random.default_rng(3).random(grid.shape) < 0.55
    values = noise & ball(grid, (10.5, 10.5, 10.5), 9)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        mesh = pp.tetrahedralize(pp.Labels(values, grid), 1, 1.4, smooth=0.6, fill_holes=False, most_lost=1)
    check_solid(mesh.nodes, mesh.tets)
    assert angles(mesh.nodes, mesh.tets).min() >= 10


def test_an_organ_cut_by_the_border_is_closed_flat_when_asked():
    grid = pp.Grid((15, 30, 30), (1, 1, 1))
    half = ball(grid, (14.5, 14.5, -0.5), 12)
    mesh = pp.tetrahedralize(pp.Labels(half, grid), 1, 2, closed_at_border=True)
    check_solid(mesh.nodes, mesh.tets)
    assert mesh.volumes.sum() == pytest.approx(half.sum(), rel=0.03)
    wall = mesh.nodes[mesh.nodes[:, 2] < 0.5]
    wall = wall[np.linalg.norm(wall[:, :2] - 14.5, axis=1) < 9]  # away from the rim, which smoothing rounds
    assert len(wall) > 50
    height = wall[wall[:, 2] < 0][:, 2]
    assert np.ptp(height) < 0.02
    assert abs(height.mean() + 0.5) < 0.25  # at the voxels' faces; what facets of the round side lose moves all of it


def test_voids_are_filled_unless_they_are_wanted():
    grid = pp.Grid((30, 30, 30), (1, 1, 1))
    hollow = ball(grid, (14.5, 14.5, 14.5), 12) & ~ball(grid, (14.5, 14.5, 14.5), 5)
    void = np.count_nonzero(ball(grid, (14.5, 14.5, 14.5), 5)) / 1000
    with pytest.warns(UserWarning, match=f"closed voids of {void:.3g} ml: filled"):
        mesh = pp.tetrahedralize(pp.Labels(hollow, grid), 1, 2)
    assert check_solid(mesh.nodes, mesh.tets) == 1
    mesh = pp.tetrahedralize(pp.Labels(hollow, grid), 1, 2, fill_holes=False)
    assert check_solid(mesh.nodes, mesh.tets) == 2  # a shell: two skins of characteristic 2 each
    assert mesh.volumes.sum() == pytest.approx(hollow.sum(), rel=0.03)
