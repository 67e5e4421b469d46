"""Surfaces that rub on each other: organs side by side, and the lips of cuts."""

import numpy as np
import pytest
from support.brick_meshes import brick, dome

import palpate as pp
from palpate.errors import DataError, MaterialError
from palpate.meshes.separate_organs import organs
from palpate.tissue.gap_contact import complementarity, rubbing
from palpate.tissue.organ_gaps import organ_gaps
from palpate.tissue.reference.linear_elasticity import FiniteElements

RADIUS = 10.0
FRICTION = 0.3
PLACE = (0.0, 20.0, 30.0)


def block(cells, size, at=(0.0, 0.0, 0.0)):
    made = brick(cells, size)
    mesh = pp.TetMesh(made.nodes + at, made.tets)
    return pp.Tissue(mesh, 5.0, 0.3, mesh.nodes[:, 2] == 0)


@pytest.fixture(scope="module")
def beside():
    """Two blocks that stand beside each other, 0.1 mm apart, with other elements."""
    return pp.join_tissues([block((5, 5, 6), (30, 40, 40)), block((4, 6, 5), (30, 40, 40), (30.1, 0, 0))])


def rubbed(tissue, friction=FRICTION):
    return pp.model(tissue.replace(surface_friction=friction), "compliance")


def on_the_right(tissue, answer):
    """(3,) N with which the left block presses and rubs on the right one: what its supports bear."""
    load = (FiniteElements(tissue).K @ answer.displacement.ravel()).reshape(-1, 3)
    right = organs(tissue.mesh) == 1
    return -load[right & tissue.held].sum(axis=0)


def test_where_all_slips_the_whole_friction_acts(beside):
    """The near block's face goes up and away as it is pressed: it slips everywhere, not quite in one direction."""
    for friction in (0.1, 0.3):
        model = rubbed(beside, friction)
        for across in (0.1, 2.0, 9.0):
            force = on_the_right(beside, model.push(PLACE, (3.0, across, 0), RADIUS))
            assert 0.97 < np.hypot(force[1], force[2]) / (friction * force[0]) < 1 + 1e-9
    much = on_the_right(beside, rubbed(beside, 3.0).push(PLACE, (3.0, 2.0, 0), RADIUS))
    assert np.hypot(much[1], much[2]) < 0.5 * 3.0 * much[0]  # it sticks
    plain = on_the_right(beside, pp.model(beside, "compliance").push(PLACE, (3.0, 9.0, 0), RADIUS))
    assert np.hypot(plain[1], plain[2]) < 1e-9 * plain[0]


def test_the_laws_hold_in_every_gap(beside):
    """Signorini's and Coulomb's, by the displacement of the answer and the loads that it needs."""
    friction = 0.8
    model = rubbed(beside, friction)
    answer = model.push(PLACE, (3.0, 2.0, 0.5), RADIUS)
    free = ~beside.held
    load = (FiniteElements(beside).K @ answer.displacement.ravel()).reshape(-1, 3)[free]
    load[model._free[np.flatnonzero(np.linalg.norm(beside.mesh.nodes - PLACE, axis=1) < RADIUS)]] = 0
    A = model.gaps.A.toarray()
    far = ~np.isclose(load, 0, atol=1e-12).ravel()  # what is left is the gaps': solved for, in the least squares
    force = np.linalg.lstsq(A[far], load.ravel()[far], rcond=None)[0]
    moved = A.T @ answer.displacement[free].ravel()
    count = len(model.gaps.rest)
    p, q = force[:count], force[count:].reshape(-1, 2)
    gap, slip = model.gaps.rest + moved[:count], moved[count:].reshape(-1, 2)
    most = p.max()
    assert p.min() > -1e-6 * most
    assert gap.min() > -1e-6
    assert (np.minimum(p / most, np.abs(gap)) < 1e-6).all()
    assert (np.linalg.norm(q, axis=1) <= friction * p + 1e-6 * most).all()
    slips = np.linalg.norm(slip, axis=1) > 1e-3
    pressed = p > 0.01 * most
    assert (slips & pressed).any()
    assert (~slips & pressed).any()
    against = -friction * p[:, None] * slip / np.maximum(np.linalg.norm(slip, axis=1), 1e-12)[:, None]
    assert np.abs(q - against)[slips & pressed].max() < 1e-3 * most


def test_what_does_not_slip_is_one_body():
    """Two halves whose elements match, pressed hard enough that they hardly part, against the block in one piece."""
    whole = brick((6, 6, 6), (60, 60, 60))
    below = brick((6, 6, 3), (60, 60, 30))
    halves = pp.TetMesh(
        np.concatenate([below.nodes, below.nodes + (0, 0, 30.002)]),
        np.concatenate([below.tets, below.tets + len(below.nodes)]),
    )
    push = (45.0, 30.0, 60.0), (0.5, 0, -3.0), 20.0
    one, two = (pp.Tissue(m, 5.0, 0.0, (m.nodes[:, 2] == 0) | (m.nodes[:, 0] == 0)) for m in (whole, halves))
    stiff = pp.model(one, "compliance").push(*push).force
    stuck, smooth = (rubbed(two, friction).push(*push).force for friction in (10.0, 0.0))
    assert np.linalg.norm(stuck - stiff) < 0.01 * np.linalg.norm(stiff)
    assert np.linalg.norm(smooth - stiff) > 0.05 * np.linalg.norm(stiff)


def test_spheres_pressed_together_and_moved_along_each_other():
    """Cattaneo and Mindlin (K. L. Johnson, Contact Mechanics, 1985, eq. 7.42): a ring slips that grows inwards, till all
    does. By the stiffness without slip: these bodies have sides, so they give more than half spaces."""
    young, poisson, bend, half, approach, friction = 15.0, 0.3, 120.0, 120.0, 1.0, 0.4
    parts = [dome(18, 10, half, bend, 1), dome(20, 10, half, bend, -1)]
    nodes = np.concatenate([parts[0][0], parts[1][0] - (0, 0, approach)])
    tets = np.concatenate([parts[0][1], parts[1][1] + len(parts[0][0])])
    base = np.isclose(nodes[:, 2], -half) | np.isclose(nodes[:, 2], half - approach)
    tissue = pp.Tissue(pp.TetMesh(nodes, tets), young, poisson, base)
    found = organ_gaps(tissue.mesh, 8.0, slips=True)
    near = np.flatnonzero(found.rest < 0.3)
    N, T = found.N.tocsc()[:, near], found.T.tocsc()[:, (2 * near[:, None] + [0, 1]).ravel()]
    A, count = np.hstack([N.toarray(), T.toarray()]), len(near)
    free = np.repeat(~tissue.held, 3)
    W = A[free].T @ FiniteElements(tissue).factors.solve(A[free])
    M, G = young * 1e-3 / (1 - poisson**2) / 2, young * 1e-3 / 2 / (1 + poisson)  # N/mm²: 1/M of two bodies alike
    radius, normal = np.sqrt(bend / 2 * approach), 4 / 3 * M * np.sqrt(bend / 2) * approach**1.5
    pressed = np.repeat(complementarity(W[:count, :count], found.rest[near]) > 0, 2)
    unit = np.zeros_like(nodes)
    unit[organs(tissue.mesh) == 1, 0] = 1  # the upper body and its base
    slip, ratio = T.T @ unit.ravel(), []
    stick = slip[pressed] @ np.linalg.solve(W[count:, count:][np.ix_(pressed, pressed)], slip[pressed])  # N/mm
    assert stick < 4 * G * radius / (2 - poisson)  # of half spaces
    for way in (0.1, 0.3, 0.8):
        p, q = np.zeros(count), np.zeros(2 * count)
        for _ in range(30):
            p = complementarity(W[:count, :count], found.rest[near] + W[:count, count:] @ q)
            q = rubbing(W[count:, count:], way * slip + W[count:, :count] @ p, friction * p, q)
        ratio.append(-(q @ slip) / (friction * p.sum()))
        assert p.sum() == pytest.approx(normal, rel=0.01)
    slips_at = 1.5 * friction * normal / stick  # mm, from where on all slips
    expected = [1 - max(1 - way / slips_at, 0) ** 1.5 for way in (0.1, 0.3, 0.8)]
    assert ratio == pytest.approx(expected, rel=0.1)  # five elements across the contact's radius
    assert ratio[2] == pytest.approx(1, rel=1e-3)


def test_a_hand_that_rubs_to_and_fro_loses_energy(beside):
    session = pp.Session(rubbed(beside), radius=RADIUS)
    point, way = PLACE, lambda s: (3.0, 6.0 * np.sin(s), 0.0)
    session.step([pp.Command(True, point, (3.0 * t, 0, 0)) for t in np.linspace(0, 1, 400)])
    lost, force = [], []
    for _ in range(3):
        before = float(session.frame().work)
        force.append(session.step([pp.Command(True, point, way(s)) for s in np.linspace(0, 2 * np.pi, 2000)]))
        lost.append(float(session.frame().work) - before)
    assert lost[2] > 0.02
    assert lost[2] == pytest.approx(lost[1], rel=0.02)
    steps = np.linalg.norm(np.diff(force[2], axis=0), axis=1)
    assert steps.max() < 0.02 * np.linalg.norm(force[2], axis=1).max()
    plain = pp.Session(pp.model(beside, "compliance"), radius=RADIUS)
    plain.step([pp.Command(True, point, (3.0 * t, 0, 0)) for t in np.linspace(0, 1, 400)])
    for _ in range(2):
        before = float(plain.frame().work)
        plain.step([pp.Command(True, point, way(s)) for s in np.linspace(0, 2 * np.pi, 2000)])
    assert abs(float(plain.frame().work) - before) < 0.05 * lost[2]


def test_a_session_that_goes_straight_in_feels_what_a_push_does_and_replays(beside):
    model = rubbed(beside)
    session = pp.Session(model, radius=RADIUS)
    way = np.array((3.0, 1.5, 0.0))
    commands = [pp.Command(True, PLACE, tuple((t * way).tolist())) for t in np.linspace(0, 1, 1500)]
    felt = session.step([*commands, *[commands[-1]] * 300])[-1]
    exact = model.push(PLACE, way, RADIUS).force
    assert np.linalg.norm(felt - exact) < 0.01 * np.linalg.norm(exact)
    session.step([*commands[::-1], *[None] * 50])
    assert session.frame().work > 0
    again = pp.Session(rubbed(beside), radius=RADIUS, sweeps=int(session.record().settings["sweeps"]))
    assert again.replay(session.record()) is None
    smooth = pp.Session(pp.model(beside, "compliance"), radius=RADIUS)
    with pytest.raises(DataError, match="tissue"):
        smooth.replay(session.record())


def test_a_second_tool_leaves_the_surfaces_stuck(beside):
    session = pp.Session(rubbed(beside), radius=RADIUS)
    first = [pp.Command(True, PLACE, (3.0 * t, 1.5 * t, 0)) for t in np.linspace(0, 1, 800)]
    before = session.step(first)[-1]
    other = (15.0, 40.0, 2.0)
    both = [(first[-1], pp.Command(True, other, (-1e-4 * t, 0, 0)), None, None) for t in range(20)]
    after = np.concatenate([[before], session.step(both)[:, 0]])
    assert np.linalg.norm(np.diff(after, axis=0), axis=1).max() < 0.01 * np.linalg.norm(before)


def test_lips_of_a_cut_rub(beside):
    """A cut down the middle of a block: the near lip drags the far one along the cut."""
    mesh = brick((6, 6, 6), (60, 60, 60), warp=0.2)
    tissue = pp.Tissue(mesh, 5.0, 0.3, mesh.nodes[:, 2] == 0)
    opened = pp.cut(tissue, pp.Blade.swept([(31, -1, 61), (31, 61, 61)], (0, 0, -1), 50))
    push = (0.0, 30.0, 45.0), (6.0, 6.0, 0.0), 15.0
    beyond = opened.mesh.nodes[:, 0] > 45
    moved = {f: rubbed(opened, f).push(*push).displacement[beyond, 1].mean() for f in (0.0, 0.2, 0.6)}
    assert moved[0.0] < moved[0.2] < moved[0.6]
    assert moved[0.6] > moved[0.0] + 0.05


def test_friction_is_kept_with_the_tissue(beside, tmp_path):
    rough = beside.replace(surface_friction=0.25)
    pp.write_tissue(tmp_path / "rough.vtu", rough)
    assert pp.read_tissue(tmp_path / "rough.vtu").surface_friction == 0.25
    one = block((3, 3, 3), (30, 30, 30))
    other = block((3, 3, 3), (30, 30, 30), (31.0, 0, 0))
    assert pp.join_tissues([one, other.replace(surface_friction=0.1)]).surface_friction == 0.1
    assert pp.join_tissues([one, other], surface_friction=0.4).surface_friction == 0.4
    pp.write_tissue(tmp_path / "one.vtu", one)
    pp.write_tissue(tmp_path / "other.vtu", other)
    scene = tmp_path / "scene.yaml"
    scene.write_text("palpate scene: 1\norgans: [one.vtu, other.vtu]\nsurface_friction: 0.15\n")
    assert pp.read_scene(scene).surface_friction == 0.15
    scene.write_text("palpate scene: 1\norgans: [one.vtu, other.vtu]\nsurface_friction: rough\n")
    with pytest.raises(DataError, match="surface_friction: 'rough'"):
        pp.read_scene(scene)
    for wrong in (-0.1, np.nan, 11.0):
        with pytest.raises(MaterialError, match="surface_friction"):
            beside.replace(surface_friction=wrong)


def test_rubbing_dissipates_as_much_as_it_can():
    """A pair of unit compliance in closed form, and random ones against the condition of their solution."""
    assert rubbing(np.eye(2), np.array([0.3, 0.0]), np.array([1.0]), np.zeros(2)) == pytest.approx([-0.3, 0])
    assert rubbing(np.eye(2), np.array([3.0, 4.0]), np.array([0.5]), np.zeros(2)) == pytest.approx([-0.3, -0.4])
    rng = np.random.default_rng(3)
    for pairs in (1, 4, 12):
        root = rng.normal(size=(2 * pairs, 2 * pairs))
        M, slip, cone = root @ root.T, rng.normal(size=2 * pairs), rng.uniform(0, 0.3, pairs)
        q = rubbing(M, slip, cone, np.zeros(2 * pairs))
        back = (q - 0.1 * (slip + M @ q)).reshape(-1, 2)  # a step down and back into the cone leads nowhere
        size = np.maximum(np.linalg.norm(back, axis=1), 1e-300)
        assert (back * np.minimum(1, cone / size)[:, None]).ravel() == pytest.approx(q, abs=1e-8)
