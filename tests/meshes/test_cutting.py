"""Cuts of meshes: volume, the surface they leave, what hangs together, and where nodes are split."""

import numpy as np
import pytest
from fuzz import random_cuts
from support.brick_meshes import brick
from support.example_organs import organ

import palpate as pp
from palpate.meshes.cutting.cut_mesh import cut_mesh, touched_surface


def plane(x, depth, low=-5.0, high=55.0):
    """A blade in the plane x, from above the 50 mm cube down to z = 50 - depth."""
    return pp.Blade.swept([(x, low, 55), (x, high, 55)], (0, 0, -1), 5 + depth)


def test_a_sample_of_random_cuts():
    told, met, wrong = random_cuts.run(12, seed=2)
    assert not wrong, wrong[0]
    assert len(told) >= 4
    assert met > 8


def test_faults_of_a_cut_are_seen():
    """The judge of random cuts is itself judged: each fault that is planted is told."""
    mesh = brick((3, 3, 3))
    blades = [plane(21.0, 30.0)]
    cut = cut_mesh(mesh, blades)
    assert random_cuts.faults(mesh, blades, cut) == []
    assert "mm² , and the blade" in random_cuts.faults(mesh, [plane(21.0, 35.0)], cut)[0].replace("mm²,", "mm² ,")
    assert "off the blade" in random_cuts.faults(mesh, [plane(21.2, 30.0)], cut)[-1]
    object.__setattr__(cut.skin, "triangles", cut.skin.triangles[1:])
    object.__setattr__(cut.skin, "lip", cut.skin.lip[1:])
    assert any("gap" in fault for fault in random_cuts.faults(mesh, blades, cut))
    cut.share.flags.writeable = True
    cut.share[0] *= 0.9
    del cut.__dict__["volumes"]
    assert {"volume", "shares"} <= {fault.split()[0] for fault in random_cuts.faults(mesh, blades, cut)}


def test_a_blade_between_elements_splits_their_nodes():
    """Where the blade passes along faces, the cut mesh is the conforming one: the nodes of that plane, twice."""
    mesh = brick((4, 4, 4))
    cut = cut_mesh(mesh, [plane(25.0, 25.0)])
    assert cut.share.min() == 1
    assert np.array_equal(np.sort(cut.parent), np.arange(len(mesh.tets)))
    x, _, z = mesh.nodes.T
    split = (x == 25) & (z > 25)  # those at the tip, z = 25, stay whole
    assert np.array_equal(np.bincount(cut.origin), 1 + split)
    left = cut.nodes[cut.tets].mean(axis=1)[:, 0] < 25
    near = np.isin(cut.parent, np.flatnonzero(split[mesh.tets].any(axis=1)))
    faces = cut.side != 0
    assert np.array_equal(cut.side[faces] == 1, ~left[faces] if (cut.side[faces & left] == -1).all() else left[faces])
    shared = np.intersect1d(cut.tets[left & near], cut.tets[~left & near])
    assert not split[cut.origin[shared]].any()


def test_a_cut_all_the_way_leaves_two_bodies():
    mesh = brick((4, 4, 4), warp=0.3)
    cut = cut_mesh(mesh, [plane(21.0, 60.0)])
    assert cut.body.max() == 1
    first = cut.body == cut.body[np.argmin(cut.nodes[cut.tets].mean(axis=1)[:, 0])]
    assert np.intersect1d(cut.tets[first], cut.tets[~first]).size == 0
    assert cut.volumes[first].sum() == pytest.approx(21 * 50 * 50, rel=1e-9)
    lips = cut.places[cut.skin.triangles[cut.skin.lip]]
    normals = np.cross(lips[:, 1] - lips[:, 0], lips[:, 2] - lips[:, 0])
    assert np.abs(normals[:, 1:]).max() < 1e-9
    assert normals[normals[:, 0] > 0].sum() == pytest.approx(2 * 50 * 50)
    assert set(cut.side[first & (cut.side != 0)]) == {-cut.side[~first & (cut.side != 0)][0]}


def as_given(upper, lower):
    """A blade between two lines, in which parts that nearly lie in one plane are left so."""
    k, n = np.arange(len(upper) - 1), len(upper)
    return pp.Blade(np.concatenate([upper, lower]), np.r_[np.c_[k, k + 1, k + 1 + n], np.c_[k, k + 1 + n, k + n]])


def test_parts_of_a_blade_that_nearly_lie_in_one_plane_are_made_to():
    random = np.random.default_rng(3)
    path = np.linspace(0, 100, 30)[:, None] * (1, 0, 0) + random.normal(size=(30, 1)) * (0, 0, 1)
    path[15:] += np.linspace(0, 10, 15)[:, None] * (0, 1, 0)
    crooked = path + 1e-5 * random.uniform(-1, 1, (30, 1)) * (0, 1, 0)
    upper = pp.Blade.swept(crooked, (0, 0, -1), 5).points[:30]
    assert np.abs(upper - crooked).max() < 1e-6 * np.linalg.norm(np.diff(crooked, axis=0), axis=1).sum()
    slope = np.diff(upper[:, 1]) / np.diff(upper[:, 0])
    assert 1 <= np.count_nonzero(np.abs(np.diff(slope)) > 1e-9) <= 3


@pytest.mark.parametrize("kink", [0, 1e-12, 1e-9, 1e-8, 1e-7, 1e-6, 1e-3, 1])
def test_a_crooked_cut_all_the_way_leaves_two_bodies(kink):
    """As a hand draws it on a screen: nearly straight, so that parts of the blade lie nearly in one plane. kink: mm."""
    mesh = organ(9).mesh
    random = np.random.default_rng(5)
    for _ in range(20):
        down, along, across = np.linalg.qr(random.normal(size=(3, 3)))[0]
        way = np.r_[-80, np.sort(random.uniform(-40, 40, 9)), 80]
        path = np.outer(way, along) - 80 * down + random.uniform(-10, 10) * across
        path += random.normal(size=(11, 1)) * down
        crooked = path + kink * random.normal(size=(11, 1)) * across
        cut, flat = (cut_mesh(mesh, [as_given(x, x + 160 * down)]) for x in (crooked, path))
        assert cut.body.max() == flat.body.max() == 1
        volumes = [sorted(np.bincount(one.body, one.volumes)) for one in (cut, flat)]
        assert np.allclose(*volumes, rtol=0, atol=1e-3 + 12_000 * kink)  # mm³: 3 kinks over 4,000 mm²


@pytest.mark.parametrize("ends", [(-5.0, 55.0), (55.0, -5.0)])
def test_side_1_is_where_the_normal_points(ends):
    blade = plane(21.0, 60.0, *ends)
    a, b, c = blade.points[blade.triangles[0]]
    towards = np.sign(np.cross(b - a, c - a)[0])
    cut = cut_mesh(brick((4, 4, 4)), [blade])
    for body in (0, 1):
        mine = cut.body == body
        away = np.sign(cut.nodes[cut.tets[mine & (cut.side == 0)]].mean(axis=(0, 1))[0] - 21)
        assert set(cut.side[mine]) == {0, towards * away}


def test_the_tip_stays_whole():
    """A blade that ends inside an element does not split the nodes of the face beyond."""
    mesh = brick((4, 4, 4))
    cut = cut_mesh(mesh, [plane(21.0, 30.0)])  # the tip at z = 20, between the nodes' 12.5 and 25
    copies = np.bincount(cut.origin)
    z = mesh.nodes[:, 2]
    assert copies[z < 20].max() == 1
    assert copies[z > 25].max() == 2
    assert cut.body.max() == 0


def test_a_blade_that_meets_nothing_changes_nothing():
    mesh = brick((3, 3, 3), warp=0.2)
    cut = cut_mesh(mesh, [plane(60.0, 30.0)])
    assert np.array_equal(cut.nodes, mesh.nodes)
    assert np.array_equal(cut.tets, mesh.tets)
    assert (cut.share == 1).all()
    assert not cut.skin.lip.any()
    places, triangles, held = touched_surface(cut, mesh.nodes[:, 2] == 0)
    bare = {tuple(map(tuple, corners)) for corners in mesh.nodes[mesh.surface].tolist()}
    turned = {tuple(map(tuple, np.roll(c, k, axis=0))) for c in places[triangles].tolist() for k in range(3)}
    assert bare <= turned
    assert len(triangles) == len(mesh.surface)
    assert np.array_equal(held, places[:, 2] == 0)


@pytest.mark.parametrize("offset", [1e-3, 1e-6, 1e-9, 1e-12])
def test_slivers_are_merged(offset):
    mesh = brick((4, 4, 4), warp=0.3)
    cut = cut_mesh(mesh, [plane(25.0 + offset, 30.0)])
    assert cut.share.min() >= 1e-6
    assert cut.volumes.sum() == pytest.approx(50**3, rel=1e-12)
    assert random_cuts.gaps(cut.skin.triangles) == []


def test_two_cuts_are_one_after_the_other():
    mesh = brick((4, 4, 4), warp=0.3)
    first, second = plane(21.0, 30.0), pp.Blade.swept([(-5, 30, 55), (55, 24, 55)], (0.1, 0, -1), 25)
    both, later = cut_mesh(mesh, [first, second]), cut_mesh(cut_mesh(mesh, [first]), [second])
    assert np.array_equal(both.tets, later.tets)
    assert np.array_equal(both.share, later.share)
    assert np.array_equal(both.skin.weight, later.skin.weight)
    assert np.bincount(both.origin).max() >= 4  # where they cross


def test_what_is_no_blade_is_refused():
    with pytest.raises(pp.errors.DataError, match="flat"):
        pp.Blade([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 1, 2)])
    with pytest.raises(pp.errors.DataError, match="points are 0 to 2"):
        pp.Blade([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 3)])
    with pytest.raises(pp.errors.DataError, match="shape"):
        pp.Blade([(0, 0, 0), (1, 0, 0), (0, 1, 0)], np.empty((0, 3), int))
    with pytest.raises(pp.errors.DataError, match="finite"):
        pp.Blade([(0, 0, 0), (1, 0, 0), (0, np.nan, 0)], [(0, 1, 2)])
    for path, direction, depth, said in [
        ([(0, 0, 0)], (0, 0, 1), 5, "two or more"),
        ([(0, 0, 0), (1, 0, 0)], (0, 0, 0), 5, "points nowhere"),
        ([(0, 0, 0), (1, 0, 0)], (0, 0, 1), 0, "above 0"),
        ([(0, 0, 0), (0, 0, 1)], (0, 0, 1), 5, "flat"),
    ]:
        with pytest.raises(pp.errors.DataError, match=said):
            pp.Blade.swept(path, direction, depth)


def test_triangles_of_nodes_bound_no_cut_mesh(tmp_path):
    cut = cut_mesh(brick((3, 3, 3)), [plane(21.0, 30.0)])
    with pytest.raises(pp.errors.MeshError, match="goes through its tetrahedra"):
        _ = cut.surface
    with pytest.raises(pp.errors.MeshError, match="write_tissue"):
        pp.write_mesh(tmp_path / "cut.vtu", cut)
