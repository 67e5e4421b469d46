"""The lips of a cut press on each other where they meet, and do not go through."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from support.brick_meshes import brick
from support.cut_stiffness import stiffness
from support.example_organs import organ

import palpate as pp
from palpate.errors import DataError
from palpate.meshes.cutting.cut_mesh import cut_mesh
from palpate.tissue.contact_patches import contacts
from palpate.tissue.gap_contact import complementarity
from palpate.tissue.lip_gaps import lip_gaps

SIZE, CUT = 50.0, 25.0  # mm
OVERLAP = 0.1  # mm
RADIUS = 9.0
PRESS = (45.0, 25.0, 50.0), (-2.0, 0.3, -1.0)  # on the top, towards the cut
PULL = (45.0, 25.0, 50.0), (2.0, 0.3, 0.5)


def plane(depth, x=CUT):
    """A blade in the plane x, from above the cube down to a depth."""
    return pp.Blade.swept([(x, -5, SIZE + 5), (x, SIZE + 5, SIZE + 5)], (0, 0, -1), 5 + depth)


@pytest.fixture(scope="module")
def cube():
    mesh = brick((5, 5, 5), warp=0.3)
    return pp.Tissue(mesh, 5.0, 0.45, mesh.nodes[:, 2] == 0)


@pytest.fixture(scope="module")
def slot(cube):
    return pp.cut(cube, plane(32.0, 23.0))


def lips(mesh):
    """Pairs of lip vertices at one place (p, 2), and unit normals (p, 3) out of the first."""
    skin = mesh.skin
    normal = np.zeros_like(mesh.places)
    a, b, c = mesh.places[skin.triangles[skin.lip]].swapaxes(0, 1)
    for corner in skin.triangles[skin.lip].T:
        np.add.at(normal, corner, np.cross(b - a, c - a))
    pair = cKDTree(mesh.places).query_pairs(1e-6, output_type="ndarray")
    out = normal[pair[:, 0]]
    opposite = np.einsum("pi,pi->p", out, normal[pair[:, 1]]) < -0.5 * (out**2).sum(axis=1)
    return pair[opposite], out[opposite] / np.linalg.norm(out[opposite], axis=1, keepdims=True)


def overlap(mesh, u):
    """mm, the deepest, over all vertices of the lips."""
    pair, out = lips(mesh)
    assert len(pair) > 20
    moved = mesh.skin.carried(mesh.tets, u)
    return np.einsum("pi,pi->p", moved[pair[:, 0]] - moved[pair[:, 1]], out).max()


def pushed_with_contact(tissue, point, way, radius):
    """Force on the tool: least energy such that no vertex of a lip enters the other, by ascent in the dual."""
    mesh = tissue.mesh
    K = stiffness(mesh, tissue.young, tissue.poisson, tissue.element).toarray()
    free = np.repeat(~tissue.held, 3)
    W = np.kron(contacts(tissue, point, way, radius).weights(len(mesh.nodes)), np.eye(3))
    pair, out = lips(mesh)
    B = np.zeros((len(pair), len(mesh.nodes), 3))
    for side, sign in ((0, -1.0), (1, 1.0)):
        at = pair[:, side]
        for k in range(4):
            nodes = mesh.tets[mesh.skin.tet[at], k]
            np.add.at(B, (np.arange(len(pair)), nodes), sign * mesh.skin.weight[at, k, None] * out)
    B = B.reshape(len(pair), -1)[:, free]
    C = np.linalg.inv(K[np.ix_(free, free)])
    tool = W[free]
    # The body with its tool held: forces p at the vertices against gaps B u.
    force = np.linalg.solve(tool.T @ C @ tool, np.array(way))
    held = C - C @ tool @ np.linalg.solve(tool.T @ C @ tool, tool.T @ C)
    M, q = B @ held @ B.T, B @ (C @ tool @ force)
    step, p, before, momentum = 1 / np.linalg.eigvalsh(M)[-1], np.zeros(len(B)), np.zeros(len(B)), 1.0
    for _ in range(20_000):  # Beck & Teboulle 2009
        ahead = p + (momentum - 1) / (momentum + 2) * (p - before)
        before, p = p, np.maximum(ahead - step * (q + M @ ahead), 0)
        momentum += 1
    assert (q + M @ p).min() > -2e-3
    return -(force - np.linalg.solve(tool.T @ C @ tool, tool.T @ C @ (B.T @ p)))


def test_lips_do_not_go_through_each_other(slot):
    free = pp.model(slot, "compliance", contact=False).push(*PRESS, RADIUS)
    closed = pp.model(slot, "compliance").push(*PRESS, RADIUS)
    assert overlap(slot.mesh, free.displacement) > 1
    assert overlap(slot.mesh, closed.displacement) < OVERLAP
    assert closed.force @ PRESS[1] < 0
    assert closed.force[0] > 1.1 * free.force[0]


def test_force_against_contact_at_every_vertex(slot):
    """The product's gaps are means about nodes; the test's are those of all vertices, solved by other code."""
    for point, way in (PRESS, ((25.0, 25.0, 50.0), (0.5, 0.5, -2.0)), ((5.0, 30.0, 45.0), (1.5, 0, 0))):
        closed = pp.model(slot, "compliance").push(point, way, RADIUS)
        expected = pushed_with_contact(slot, point, way, RADIUS)
        assert np.linalg.norm(closed.force - expected) < 0.02 * np.linalg.norm(expected)


def test_a_cut_that_is_pulled_open_feels_no_contact(slot):
    free, open_ = (pp.model(slot, "compliance", contact=c).push(*PULL, RADIUS) for c in (False, True))
    assert np.allclose(free.force, open_.force, rtol=1e-10)
    assert np.allclose(free.displacement, open_.displacement, atol=1e-12)


def test_a_cut_pressed_shut_is_as_stiff_as_whole_tissue():
    """Two tools press from both sides: by symmetry no shear is in the plane of the cut."""
    mesh = brick((8, 8, 8))
    mesh = pp.TetMesh(mesh.nodes, mesh.tets)
    whole = pp.Tissue(mesh, 5.0, 0.3, mesh.nodes[:, 2] == 0)
    opened = pp.cut(whole, plane(16.0))
    both = [(0, 25, 38), (50, 25, 38)], [(2, 0, 0), (-2, 0, 0)], 14.0
    held = pp.model(whole, "compliance").push(*both).force[:, 0]
    shut = pp.model(opened, "compliance").push(*both).force[:, 0]
    through = pp.model(opened, "compliance", contact=False).push(*both).force[:, 0]
    assert np.allclose(shut, held, rtol=0.02)
    assert (np.abs(through) < 0.9 * np.abs(held)).all()


def test_gaps_of_a_rigid_motion_are_none(slot):
    """So the forces in a gap are opposite, and their moments cancel."""
    N, x = lip_gaps(slot.mesh).N, slot.mesh.nodes
    assert N.shape[1] > 20
    for u in (*np.broadcast_to(np.eye(3)[:, None], (3, *x.shape)), *(np.cross(axis, x) for axis in np.eye(3))):
        assert np.abs(N.T @ u.ravel()).max() < 1e-10


def test_lips_apart_by_2_mm_have_gaps_of_2_mm(slot):
    """All copies on one side of the blade move along its normal, so the lips part but for the blade's tip."""
    mesh = slot.mesh
    moved = np.zeros_like(mesh.nodes)
    sides = [np.unique(mesh.tets[mesh.side == side]) for side in (1, -1)]
    moved[np.setdiff1d(*sides), 0] = 2
    gap = np.abs(lip_gaps(mesh).N.T @ moved.ravel())
    assert gap.max() == pytest.approx(2, rel=1e-9)
    assert (gap > 1.999).sum() > len(gap) / 2


@pytest.mark.parametrize("seed", range(6))
def test_where_the_blade_turns_each_gap_has_the_normal_of_one_side(seed):
    """However the body lies: a cut that turns by 70 degrees. A mean over both sides would be 35 degrees off."""
    turned = Rotation.random(random_state=seed)
    mesh = brick((6, 6, 6), warp=0.2)
    there = np.array([(22, -5, 55), (22, 24, 55), (22 + 31 * np.tan(np.radians(70)), 55, 55)])
    blade = pp.Blade.swept(turned.apply(there), turned.apply((0, 0, -1)), 40)
    cut = cut_mesh(pp.TetMesh(mesh.nodes @ turned.as_matrix().T, mesh.tets, mesh.region), [blade])
    N, moved = lip_gaps(cut).N, np.zeros(len(cut.nodes))
    moved[np.setdiff1d(*(np.unique(cut.tets[cut.side == side]) for side in (1, -1)))] = 1
    normals = turned.inv().apply(np.stack([N.T @ np.outer(moved, axis).ravel() for axis in np.eye(3)], axis=1))
    size = np.linalg.norm(normals, axis=1)  # less than 1 at the blade's tip, of which a part does not part
    ways = np.array([(1.0, 0, 0), (np.cos(np.radians(70)), -np.sin(np.radians(70)), 0)])
    along = np.abs(normals[size > 0.1] / size[size > 0.1, None] @ ways.T)
    assert (along.argmax(axis=1) == 0).sum() > 10
    assert (along.argmax(axis=1) == 1).sum() > 10
    assert along.max(axis=1).min() > 0.99


def test_a_blade_that_hardly_turns_has_as_many_gaps_as_a_plane_one():
    """A node of the cut has one gap, where two normals are 6 degrees apart."""
    mesh = brick((6, 6, 6), warp=0.2)

    def gaps(turn):
        there = [(22, -5, 55), (22, 24, 55), (22 + 31 * np.tan(np.radians(turn)), 55, 55)]
        cut = cut_mesh(mesh, [pp.Blade.swept(there, (0, 0, -1), 40)])
        copied = np.bincount(cut.origin) > 1
        return lip_gaps(cut).N.shape[1], copied.sum()

    for turn in (0, 6):
        found, nodes = gaps(turn)
        assert found == nodes > 40
    found, nodes = gaps(70)
    assert found > nodes


@pytest.mark.parametrize("tilt", [0.0, 0.3, -0.7])
def test_a_half_that_slides_slips_as_far_in_every_gap(tilt):
    """Of a cut all the way through, moved along it as a rigid body: the gaps stay closed, and all slips are its way."""
    tissue = organ(8)
    middle, along, down = tissue.mesh.nodes.mean(axis=0), np.array((0.0, 1.0, tilt)), np.array((0.4 * tilt, 0.0, -1.0))
    blade = pp.Blade.swept([middle - 100 * along - 90 * down, middle + 100 * along - 90 * down], down, 200)
    mesh = cut_mesh(tissue.mesh, [blade])
    found = lip_gaps(mesh, slips=True)
    side = np.cross(along, down)
    body = mesh.body[np.argmax((mesh.nodes[mesh.tets].mean(axis=1) - middle) @ side)]
    way = (0.6 * along / np.linalg.norm(along) + down) / 2
    u = np.zeros_like(mesh.nodes)
    u[np.unique(mesh.tets[mesh.body == body])] = way
    slips = (found.T.T @ u.ravel()).reshape(-1, 2)
    assert len(found.rest) > 30
    assert np.abs(found.N.T @ u.ravel()).max() < 1e-9
    assert np.linalg.norm(slips, axis=1) == pytest.approx(np.linalg.norm(way), rel=1e-9)


@settings(max_examples=12)
@given(
    x=st.floats(2, 48),
    y=st.floats(2, 48),
    way=st.tuples(st.floats(-2, 2), st.floats(-1, 1), st.floats(-2, 0.5)).filter(lambda w: np.linalg.norm(w) > 0.5),
)
def test_wherever_one_presses(slot, x, y, way):
    model = pp.model(slot, "compliance")
    answer = model.push((x, y, SIZE), way, RADIUS)
    assert overlap(slot.mesh, answer.displacement) < OVERLAP
    assert answer.error < 1e-8
    session = pp.Session(model, radius=RADIUS)
    at = slot.surface.closest(np.array([x, y, SIZE])).point
    felt = session.step([pp.Command(True, tuple(map(float, at)), way)] * 800)[-1]
    exact = model.push(at, way, RADIUS)
    assert np.linalg.norm(felt - exact.force) < 2e-3 * np.linalg.norm(exact.force)
    assert overlap(slot.mesh, session.loop.displacement()) < OVERLAP


@settings(max_examples=50)
@given(size=st.integers(1, 12), rank=st.integers(1, 12), seed=st.integers(0, 2**32 - 1))
def test_complementarity(size, rank, seed):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(min(rank, size), size))
    M = A.T @ A
    q = M @ rng.normal(size=size) + rng.uniform(0, 1, size) * (rng.random(size) < 0.5)  # so that there is a solution
    p = complementarity(M, q)
    gap = q + M @ p
    assert (p >= 0).all()
    small = 1e-6 * np.abs(q).max()  # it is regularised
    assert gap.min() > -small
    assert np.abs(p * gap).max() <= small * max(p.max(), 1)


def test_tools_that_slide_meet_lips_too(slot):
    glued, sliding = (pp.model(slot, "compliance").push(*PRESS, RADIUS, friction=mu) for mu in (np.inf, 0.1))
    assert overlap(slot.mesh, sliding.displacement) < OVERLAP
    assert np.linalg.norm(sliding.force) < np.linalg.norm(glued.force)


def test_a_cut_in_an_organ_pressed_by_two_tools():
    whole = organ(10)
    top = whole.mesh.nodes[np.argmax(whole.mesh.nodes[:, 2])]
    opened = pp.cut(whole, pp.incision(whole, [top - (15, 0, 0), top + (15, 0, 0)], depth=12))
    points = [whole.surface.closest(top + (0, y, 0)).point for y in (9.0, -9.0)]
    ways = [(0, -2.0, -0.5), (0, 2.0, -0.5)]
    answer = pp.model(opened, "compliance").push(points, ways, 7.0)
    free = pp.model(opened, "compliance", contact=False).push(points, ways, 7.0)
    assert overlap(opened.mesh, free.displacement) > 1
    assert overlap(opened.mesh, answer.displacement) < OVERLAP
    session = pp.Session(pp.model(opened, "compliance"), radius=7.0)
    felt = session.step([[pp.Command(True, tuple(map(float, p)), w) for p, w in zip(points, ways, strict=True)]] * 800)[
        -1
    ]
    assert np.allclose(felt[:2], answer.force, rtol=5e-3, atol=1e-5)


def test_stroking_over_a_pressed_cut_gives_no_work_and_replays(slot):
    session = pp.Session(pp.model(slot, "compliance"), radius=RADIUS)
    s = np.linspace(0, 2 * np.pi, 1500)
    way = [pp.Command(True, (25.0 + 12 * np.sin(a), 25.0, SIZE), (0.8 * np.sin(2 * a), 0, -1.5)) for a in s]
    session.step([*way, *way, *[None] * 300])
    assert session.frame().work > -1e-3
    record = session.record()
    again = pp.Session(pp.model(slot, "compliance"), radius=RADIUS, sweeps=int(record.settings["sweeps"]))
    assert again.replay(record) is None


def test_a_record_says_that_lips_did_not_meet(slot):
    free = pp.Session(pp.model(slot, "compliance", contact=False), radius=RADIUS)
    closed = pp.Session(pp.model(slot, "compliance"), radius=RADIUS)
    assert "contact" in str(free.description())
    assert "contact" not in str(closed.description())


def test_too_many_gaps_are_refused(monkeypatch, slot):
    monkeypatch.setattr("palpate.tissue.gap_contact.MOST_GAPS", 10)
    with pytest.raises(DataError, match="at most 10; take larger elements"):
        pp.model(slot, "compliance")
