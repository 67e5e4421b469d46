"""Organs beside each other: they press on each other where they meet, and nothing goes through."""

import numpy as np
import pytest
from support.brick_meshes import brick, dome

import palpate as pp
from palpate.errors import DataError, FileError, MaterialError, MeshError
from palpate.meshes.display_surfaces import displayed_surface
from palpate.meshes.separate_organs import organs
from palpate.tissue.contact_patches import patch
from palpate.tissue.gap_contact import complementarity
from palpate.tissue.organ_gaps import organ_gaps
from palpate.tissue.reference.linear_elasticity import FiniteElements

RADIUS = 10.0
OVERLAP = 0.1  # mm


def slab(cells, size, at=(0.0, 0.0, 0.0), name="organ", region=1):
    made = brick(cells, size)
    return pp.TetMesh(made.nodes + at, made.tets, np.full(len(made.tets), region), {region: name})


def held_at(mesh, z, young=5.0, poisson=0.3):
    return pp.Tissue(mesh, young, poisson, np.abs(mesh.nodes[:, 2] - z) < 1e-9)


@pytest.fixture(scope="module")
def stacked():
    """A slab hangs by its top above another one that rests, 0.5 mm apart, with other elements."""
    lower = held_at(slab((6, 6, 3), (50, 50, 24), name="lower"), 0)
    upper = held_at(slab((7, 7, 3), (50, 50, 24), (0, 0, 24.5), name="upper"), 48.5)
    return pp.join_tissues([lower, upper])


@pytest.fixture(scope="module")
def beside():
    """Two blocks that stand beside each other, 0.3 mm apart, with other elements."""
    left = held_at(slab((5, 5, 6), (30, 40, 40), name="left"), 0)
    right = held_at(slab((4, 6, 5), (30, 40, 40), (30.3, 0, 0), name="right"), 0)
    return pp.join_tissues([left, right])


def pressures(tissue, reach=8.0):
    """Forces (g,) N in the gaps of a body that nothing else touches, its displacement (N, 3) mm, and the gaps as matrix."""
    found = organ_gaps(tissue.mesh, reach)
    N, rest = found.N, found.rest
    free = np.repeat(~tissue.held, 3)
    moved = FiniteElements(tissue).factors.solve(N[np.flatnonzero(free)].toarray())
    p = complementarity(N[np.flatnonzero(free)].T @ moved, rest)
    u = np.zeros(free.shape)
    u[free] = moved @ p
    return p, u.reshape(-1, 3), N


def depth_inside(tissue, u):
    """mm: how deep displaced vertices of one of two bodies lie below the displaced other one's flat side."""
    x = tissue.mesh.nodes + u
    first = organs(tissue.mesh) == 0
    surface = tissue.mesh.surface
    worst = 0.0
    for mine in (first, ~first):
        faces = x[surface[(~mine)[surface].all(axis=1)]]
        normal = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
        for point in x[np.unique(surface[mine[surface].all(axis=1)])]:
            inside = np.einsum("fc,fc->f", point - faces[:, 0], normal) < 0
            edges = np.stack([np.cross(normal, faces[:, (k + 1) % 3] - faces[:, k]) for k in range(3)], axis=1)
            over = (np.einsum("fkc,fkc->fk", point - faces, edges) > 0).all(axis=1) & inside
            if over.any() and inside.mean() > 0.99:
                height = np.abs(np.einsum("fc,fc->f", point - faces[:, 0], normal)) / np.linalg.norm(normal, axis=1)
                worst = max(worst, height[over].min())
    return worst


def test_hertz_contact_of_two_spheres():
    """Half spaces, as far as a base at 120 mm is far from a contact of 7.7 mm radius."""
    young, poisson, bend, half, approach = 15.0, 0.3, 120.0, 120.0, 1.0
    parts = [dome(18, 10, half, bend, 1), dome(20, 10, half, bend, -1)]
    nodes = np.concatenate([parts[0][0], parts[1][0] - (0, 0, approach)])
    tets = np.concatenate([parts[0][1], parts[1][1] + len(parts[0][0])])
    base = np.isclose(nodes[:, 2], -half) | np.isclose(nodes[:, 2], half - approach)
    force = pressures(pp.Tissue(pp.TetMesh(nodes, tets), young, poisson, base))[0].sum()
    modulus = young * 1e-3 / (1 - poisson**2) / 2  # N/mm²: 1/E* of two bodies alike
    assert force == pytest.approx(4 / 3 * modulus * np.sqrt(bend / 2) * approach**1.5, rel=0.03)


def test_pressed_together_evenly_two_slabs_are_one():
    """ν = 0, elements that do not match, 1 mm too near: the stress is the same everywhere."""
    lower = slab((6, 6, 3), (50, 50, 24))
    upper = slab((7, 7, 3), (50, 50, 24), (0, 0, 23.0))
    nodes = np.concatenate([lower.nodes, upper.nodes])
    mesh = pp.TetMesh(nodes, np.concatenate([lower.tets, upper.tets + len(lower.nodes)]))
    tissue = pp.Tissue(mesh, 5.0, 0.0, np.isin(mesh.nodes[:, 2], (0.0, 47.0)))
    p, u, _ = pressures(tissue)
    assert p.sum() == pytest.approx(5e-3 / 48 * 1.0 * 50 * 50, rel=5e-3)
    at = np.concatenate([lower.nodes[:, 2] / 24, -(1 - (upper.nodes[:, 2] - 23) / 24)]) * -0.5
    assert np.abs(u[:, 2] - at).max() < 0.05
    assert np.abs(u[:, :2]).max() < 0.02


def test_forces_are_opposite_and_their_moments_cancel(stacked, beside):
    for tissue in (stacked, beside):
        N, x = organ_gaps(tissue.mesh).N, tissue.mesh.nodes
        first = (organs(tissue.mesh) == 0)[:, None]
        for u in (*np.broadcast_to(np.eye(3)[:, None], (3, *x.shape)), *(np.cross(axis, x) for axis in np.eye(3))):
            one, other = N.T @ (u * first).ravel(), N.T @ (u * ~first).ravel()
            assert np.abs(one + other).max() < 1e-10 * max(1, np.abs(one).max())


def test_an_organ_is_pushed_onto_the_other(beside):
    push = (0.0, 20.0, 34.0), (2.5, 0, 0), RADIUS
    right = organs(beside.mesh) == 1
    through = pp.model(beside, "compliance", contact=False).push(*push)
    answer = pp.model(beside, "compliance").push(*push)
    assert np.abs(through.displacement[right]).max() == 0
    assert depth_inside(beside, through.displacement) > 0.5
    assert np.abs(answer.displacement[right]).max() > 0.5
    assert depth_inside(beside, answer.displacement) < OVERLAP
    assert -answer.force[0] > -1.05 * through.force[0]
    assert answer.estimate is None
    away = pp.model(beside, "compliance").push(push[0], (-2.5, 0, 0), RADIUS)
    assert np.abs(away.displacement[right]).max() == 0


def test_supports_and_tools_are_in_balance(beside):
    push = (0.0, 20.0, 34.0), (4.0, 0.5, -1.0), RADIUS
    answer = pp.model(beside, "compliance").push(*push)
    load = FiniteElements(beside).K @ answer.displacement.ravel()
    load = load.reshape(-1, 3)
    assert np.allclose(load[beside.held].sum(axis=0), answer.force, atol=1e-9)
    right = organs(beside.mesh) == 1
    contact = load[right & ~beside.held].sum(axis=0)  # of the left organ on the right one
    assert contact[0] > 0.01
    assert np.allclose(load[right & beside.held].sum(axis=0), -contact, atol=1e-9)


def test_a_session_feels_what_a_push_does_and_replays(beside):
    model = pp.model(beside, "compliance")
    session = pp.Session(model, radius=RADIUS)
    point, way = (0.0, 20.0, 34.0), (2.5, 0.0, -0.5)
    at = tuple(np.array(beside.surface.closest(np.array(point)).point).tolist())
    felt = session.step([pp.Command(True, at, way)] * 1000)[-1]
    exact = model.push(at, way, RADIUS)
    assert np.linalg.norm(felt - exact.force) < 1e-3 * np.linalg.norm(exact.force)
    assert depth_inside(beside, session.loop.displacement()) < OVERLAP
    stroke = [pp.Command(True, at, (4 * np.sin(s) ** 2, 1.5 * np.sin(2 * s), -1.0)) for s in np.linspace(0, 6, 1500)]
    session.step([*stroke, *[None] * 300])
    assert session.frame().work > -1e-3
    record = session.record()
    again = pp.Session(pp.model(beside, "compliance"), radius=RADIUS, sweeps=int(record.settings["sweeps"]))
    assert again.replay(record) is None


def test_two_tools_squeeze_two_organs(beside):
    points, ways = [(0.0, 20.0, 34.0), (60.3, 20.0, 34.0)], [(3.0, 0, 0), (-3.0, 0, 0)]
    model = pp.model(beside, "compliance")
    answer = model.push(points, ways, RADIUS)
    assert depth_inside(beside, answer.displacement) < OVERLAP
    sliding = model.push(points, ways, RADIUS, friction=0.2)
    assert depth_inside(beside, sliding.displacement) < OVERLAP


def test_a_bone_does_not_move():
    organ = held_at(slab((5, 5, 6), (30, 40, 40)), 0)
    bone = slab((2, 4, 4), (10, 40, 40), (30.2, 0, 0), "bone")
    joined = pp.join_tissues([organ], [bone])
    answer = pp.model(joined, "compliance").push((0, 20, 34), (4, 0, 0), RADIUS)
    alone = pp.model(organ, "compliance").push((0, 20, 34), (4, 0, 0), RADIUS)
    rigid = organs(joined.mesh) == 1
    assert (answer.displacement[rigid] == 0).all()
    assert (joined.mesh.nodes + answer.displacement)[~rigid, 0].max() < 30.2 + OVERLAP
    assert -answer.force[0] > 1.1 * -alone.force[0]
    assert joined.mesh.names == {1: "organ", 2: "bone"}


def test_organs_that_overlap_are_moved_apart():
    meshes = slab((5, 5, 6), (30, 40, 40)), slab((4, 6, 5), (30, 40, 40), (29.0, 0, 0))
    left, right = (pp.Tissue(m, 5.0, 0.3, m.nodes[:, 0] == far) for m, far in zip(meshes, (0.0, 59.0), strict=True))
    both = pp.join_tissues([left, right])
    rest = organ_gaps(both.mesh).rest
    assert rest.min() > -0.1
    assert np.abs(both.mesh.nodes - np.concatenate([left.mesh.nodes, right.mesh.nodes])).max() < 1.5
    assert both.mesh.volumes.sum() > 0.97 * 2 * 30 * 40 * 40


def test_regions_and_names_stay_apart():
    inner = brick((4, 4, 4), region=lambda x: np.where(np.linalg.norm(x - 25, axis=1) < 15, 2, 1))
    mesh = pp.TetMesh(inner.nodes, inner.tets, inner.region, {1: "organ", 2: "lump"})
    moved = pp.TetMesh(mesh.nodes + (52, 0, 0), mesh.tets, mesh.region, mesh.names)
    both = pp.join_tissues([held_at(mesh, 0), held_at(moved, 0, young=9.0)])
    assert both.mesh.names == {1: "organ", 2: "lump", 3: "organ 2", 4: "lump 2"}
    assert set(both.young[both.mesh.region >= 3]) == {9.0}
    drawn = displayed_surface(both.mesh)
    assert drawn.beside == ("organ", "organ 2")
    assert [part.name for part in drawn.parts] == ["organ", "lump", "lump 2"]
    assert np.array_equal(drawn.places[:, 0] > 51, drawn.organ == 1)
    opened = pp.cut(both, pp.Blade.swept([(25, -5, 55), (25, 55, 55)], (0, 0, -1), 20))
    cut = displayed_surface(opened.mesh)
    assert cut.beside == ("organ", "organ 2")
    assert np.array_equal(cut.places[:, 0] > 51, cut.organ == 1)
    pressed = pp.model(opened, "compliance").push((40, 25, 50), (3, 0, -1), RADIUS)
    assert np.abs(pressed.displacement[organs(opened.mesh) == 1]).max() > 0.2


def test_a_scene_is_read_and_kept(tmp_path, beside):
    left = held_at(slab((5, 5, 6), (30, 40, 40), name="left"), 0)
    right = held_at(slab((4, 6, 5), (30, 40, 40), (30.3, 0, 0), name="right"), 0)
    touching = pp.join_tissues([left, held_at(slab((5, 5, 6), (30, 40, 40), (30, 0, 0)), 0)])
    pp.write_tissue(tmp_path / "touching.vtu", touching)
    assert organs(pp.read_tissue(tmp_path / "touching.vtu").mesh).max() == 1, "nodes at one place stay apart"
    pp.write_tissue(tmp_path / "left.vtu", left)
    pp.write_tissue(tmp_path / "right.vtu", right)
    (tmp_path / "scene.yaml").write_text("palpate scene: 1\norgans: [left.vtu, right.vtu]\n")
    scene = pp.read_scene(tmp_path / "scene.yaml")
    assert np.allclose(scene.mesh.nodes, beside.mesh.nodes)
    pp.write_tissue(tmp_path / "scene.vtu", scene)
    back = pp.read_tissue(tmp_path / "scene.vtu")
    push = (0.0, 20.0, 34.0), (4.0, 0, 0), RADIUS
    forces = [pp.model(t, "compliance").push(*push).force for t in (beside, back)]
    assert np.allclose(*forces, rtol=1e-9)


def test_a_scene_of_a_label_map(tmp_path):
    values = np.zeros((20, 20, 40), dtype=np.uint8)
    values[2:18, 2:18, 2:20], values[2:18, 2:18, 20:38] = 1, 2
    values[2:18, 2:18, 38:39] = 3
    labels = pp.Labels(values, pp.Grid((20, 20, 40), (2.0, 2.0, 2.0)), {1: "one", 2: "two", 3: "wall"})
    pp.write_labels(tmp_path / "labels.nii.gz", labels)
    (tmp_path / "label_names.json").write_text('{"1": "one", "2": "two", "3": "wall"}')
    (tmp_path / "scene.yaml").write_text(
        "palpate scene: 1\nlabels: labels.nii.gz\norgans:\n  one: {young: 5, towards: [0, 0, -1]}\n"
        "  two: {tissue: liver, edge: 5, towards: [0, 0, -1], depth: 0.1}\n"
    )
    scene = pp.read_scene(tmp_path / "scene.yaml")
    assert scene.mesh.names == {1: "one", 2: "two"}
    assert organ_gaps(scene.mesh).rest.min() > -0.1
    assert (organ_gaps(scene.mesh).rest < 0.5).sum() > 20


@pytest.mark.parametrize(
    ("text", "error", "complaint"),
    [
        ("palpate scene: 1\norgans: [a.vtu", FileError, "not a YAML text"),
        ("organs: [a.vtu]", DataError, "expected `palpate scene: 1`"),
        ("palpate scene: 1\norgan: [a.vtu]", DataError, "organ: no such key"),
        ("palpate scene: 1\norgans: [a.vtu]", FileError, "a.vtu"),
        ("palpate scene: 1\norgans: [liver]", DataError, "liver: give its stiffness"),
        ("palpate scene: 1\norgans: {liver: {young: 5}}", DataError, "liver: no tissue's file"),
        ("palpate scene: 1\norgans: {liver: {yung: 5}}", DataError, "liver: yung: no such key"),
        ("palpate scene: 1\norgans: {liver: 5}", DataError, "liver: expected {young: 5, edge: 6}"),
        ("palpate scene: 1\norgans: 3", DataError, "organs: expected names"),
        ("palpate scene: 1\norgans: {a.vtu: {young: 5}}", DataError, "is a tissue, of which nothing else"),
        ("palpate scene: 1\nlabels: [1]", DataError, "labels: expected the name of a file"),
        ("palpate scene: 1", DataError, "0 given, and 0 bones"),
        ("palpate scene: 1\nattachments: 3", DataError, "attachments: expected a list"),
    ],
)
def test_a_scene_that_cannot_be_is_refused(tmp_path, text, error, complaint):
    (tmp_path / "scene.yaml").write_text(text)
    with pytest.raises(error, match=complaint) as caught:
        pp.read_scene(tmp_path / "scene.yaml")
    assert "\n" not in str(caught.value)


@pytest.fixture(scope="module")
def attached():
    """Two blocks 12 mm apart, with a spring between the sides that face each other."""
    left = held_at(slab((5, 5, 6), (30, 40, 40)), 0)
    right = held_at(slab((4, 6, 5), (30, 40, 40), (42, 0, 0)), 0)
    spring = pp.Attachment((30, 20, 30), (42, 20, 32), stiffness=0.05, radius=7.0)
    return pp.join_tissues([left, right], attachments=[spring])


def test_an_attachment_pulls_as_its_closed_form(attached):
    """Two tools hold the very patches of a spring: besides the organs they feel k times the way apart."""
    spring = attached.attachments[0]
    points, ways = [spring.first, spring.second], np.array([(-2.0, 0.5, 0.3), (1.0, -0.4, 0.6)])
    with_it = pp.model(attached, "compliance").push(points, ways, spring.radius).force
    without = pp.model(attached.replace(attachments=()), "compliance").push(points, ways, spring.radius).force
    pull = spring.stiffness * (ways[1] - ways[0])
    assert np.allclose(with_it - without, [pull, -pull], rtol=1e-7)


def test_attached_organs_against_springs_in_the_stiffness(attached):
    """Against a factorisation of the stiffness with the spring in it."""
    spring = attached.attachments[0]
    way = np.zeros(len(attached.mesh.nodes))
    for place, sign in ((spring.first, -1.0), (spring.second, 1.0)):
        found = patch(attached, place, spring.radius)
        way[found.nodes] += sign * found.weights
    B = np.kron(way[:, None], np.eye(3))
    K = FiniteElements(attached).K.toarray() + spring.stiffness * B @ B.T
    free = np.flatnonzero(np.repeat(~attached.held, 3))
    push = (0.0, 20.0, 34.0), (-3.0, 1.0, -0.5), RADIUS
    found = patch(attached, push[0], RADIUS)
    W = np.zeros((len(attached.mesh.nodes), 1))
    W[found.nodes, 0] = found.weights
    load = np.kron(W, np.eye(3))[free]
    C = load.T @ np.linalg.solve(K[np.ix_(free, free)], load)
    expected = -np.linalg.solve(C, push[1])
    model = pp.model(attached, "compliance")
    answer = model.push(*push)
    assert np.allclose(answer.force, expected, rtol=1e-8)
    alone = pp.model(attached.replace(attachments=()), "compliance").push(*push)
    assert np.linalg.norm(answer.force - alone.force) > 0.01 * np.linalg.norm(alone.force)
    pulled = (B.T @ answer.displacement.ravel()) * spring.stiffness
    load = (FiniteElements(attached).K @ answer.displacement.ravel()).reshape(-1, 3)
    right = (organs(attached.mesh) == 1) & ~attached.held
    assert np.allclose(load[right].sum(axis=0), -pulled, atol=1e-9), (
        "the pull on the other organ is k times the way apart"
    )
    session = pp.Session(model, radius=RADIUS)
    at = tuple(np.array(attached.surface.closest(np.array(push[0])).point).tolist())
    felt = session.step([pp.Command(True, at, push[1])] * 800)[-1]
    assert np.allclose(felt, model.push(at, push[1], RADIUS).force, rtol=1e-3, atol=1e-6)
    assert session.frame().work > 0


def test_attachments_are_kept_in_files(tmp_path, attached):
    pp.write_tissue(tmp_path / "attached.vtu", attached)
    assert pp.read_tissue(tmp_path / "attached.vtu").attachments == attached.attachments
    for name, z in (("left", 0), ("right", 0)):
        pp.write_tissue(
            tmp_path / f"{name}.vtu", held_at(slab((3, 3, 3), (30, 40, 40), (0 if name == "left" else 42, 0, 0)), z)
        )
    (tmp_path / "scene.yaml").write_text(
        "palpate scene: 1\norgans: [left.vtu, right.vtu]\n"
        "attachments:\n  - {first: [30, 20, 30], second: [42, 20, 32], stiffness: 0.05}\n"
    )
    assert pp.read_scene(tmp_path / "scene.yaml").attachments == (pp.Attachment((30, 20, 30), (42, 20, 32), 0.05),)


@pytest.mark.parametrize("name", ["blocks", "multigrid", "springs", "neo-hookean"])
def test_other_models_refuse_attachments(attached, name):
    with pytest.raises(MaterialError, match="only the model `compliance`"):
        pp.model(attached, name)
    with pytest.raises(MaterialError, match="only the model `compliance`"):
        pp.finite_elements(attached)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"stiffness": 0}, "stiffness: 0 N/mm, expected more than 0"),
        ({"stiffness": float("nan")}, "stiffness: nan"),
        ({"radius": -1}, "radius: -1 mm"),
        ({"first": (0, 0, float("inf"))}, "first"),
        ({"second": (0, 0)}, "second"),
    ],
)
def test_an_attachment_that_cannot_be(change, complaint):
    with pytest.raises(MaterialError, match=complaint):
        pp.Attachment(**{"first": (0, 0, 0), "second": (1, 0, 0), "stiffness": 1.0, **change})


def test_an_attachment_off_the_surface_is_refused(attached):
    away = attached.replace(attachments=[pp.Attachment((30, 20, 30), (90, 20, 200), 0.1)])
    with pytest.raises(MaterialError, match=r"attachment 1: point .* off the surface"):
        pp.model(away, "compliance")


def test_an_export_says_that_it_does_not_follow(tmp_path, beside):
    with pytest.raises(MaterialError, match="organs that touch"):
        pp.export(beside, tmp_path / "organs.html")
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_joined_says_so():
    one = held_at(slab((3, 3, 3), (30, 40, 40)), 0)
    with pytest.raises(DataError, match="1 given, and 0 bones"):
        pp.join_tissues([one])
    with pytest.raises(DataError, match='number 2 has the element "P1"'):
        pp.join_tissues([one, one.replace(element="P1")])
    with pytest.raises(DataError, match="number 1 relaxes"):
        pp.join_tissues([one.replace(relaxation=pp.Relaxation((0.3,), (1.0,))), one])
    with pytest.raises(DataError, match="number 1 has been cut"):
        pp.join_tissues([pp.cut(one, pp.Blade.swept([(15, -5, 45), (15, 45, 45)], (0, 0, -1), 20)), one])
    with pytest.raises(MeshError, match=r"overlap by .* mm, more than an element"):
        pp.join_tissues([held_at(slab((6, 8, 8), (30, 40, 40), at), 0) for at in ((0, 0, 0), (15, 18, 0))])
    with pytest.raises(MaterialError):
        pp.join_tissues([one, one.replace(young=-1.0)])
