"""The force on a blade: what new surface and its flanks take, and no loop of the hand that gives energy."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.brick_meshes import block
from support.example_organs import organ

import palpate as pp
from palpate import _core

TOUGH, RUBS, DEPTH = 164.0, 0.05, 12.0  # J/m², N/mm, mm
HOLDS = (1e-3 * TOUGH + RUBS) * DEPTH  # N


@pytest.fixture(scope="module")
def whole():
    """A cube, so that a way along its top has the length of the cut at any depth."""
    return block(7)


@pytest.fixture(scope="module")
def model(whole):
    return pp.model(whole, "compliance")


def session_of(model, toughness=TOUGH, friction=RUBS):
    return pp.Session(model, radius=9.0, sweeps=4, toughness=toughness, blade_friction=friction)


def over(x, y=0.0):
    """A point of the cube's top, from its middle."""
    return (25.0 + float(x), 25.3 + float(y), 50.0)


def blade(point, depth=DEPTH):
    return pp.Command(True, point, (0.0, 0.0, -depth), "blade")


def ways(session, commands):
    """Places (t, 3) of the blade and of the end of its cut, mm, and the forces on the hand, N, tick by tick."""
    found = []
    for command in commands:
        force = session.step([command])[0]
        frame = session.frame()
        assert frame.contact[0] == 4
        end = np.array(frame.point[0])
        found.append((end + frame.displacement[0], end, force))
    return [np.array(each) for each in zip(*found, strict=True)]


def work(places, forces):
    """mJ that a hand puts in along a way: the force acts on the hand."""
    return -float(((forces[1:] + forces[:-1]) / 2 * np.diff(places, axis=0)).sum())


def test_a_blade_that_goes_on_feels_what_its_cut_takes(model):
    session = session_of(model)
    places, ends, forces = ways(session, [blade(over(x)) for x in np.linspace(-15, 15, 600)])  # 50 mm/s
    steady = np.linalg.norm(forces[100:], axis=1)
    assert np.allclose(steady, HOLDS, rtol=1e-6)
    along = np.diff(places, axis=0)[100:]
    cosine = (forces[101:] * along).sum(axis=1) / np.linalg.norm(along, axis=1) / HOLDS
    assert cosine.max() < -0.99, "against the way"
    assert np.linalg.norm(forces[0]) == 0, "it begins without a force"
    assert np.linalg.norm(np.diff(forces, axis=0), axis=1).max() < 0.1 * HOLDS, "and without a step"
    way = np.linalg.norm(np.diff(ends, axis=0), axis=1).sum()
    stored = HOLDS * session.settings.give / 2
    assert work(places, forces) == pytest.approx(HOLDS * way + stored, rel=0.01)
    assert session.frame().work == pytest.approx(work(places, forces), rel=1e-6), "the session counts it"


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31))
def test_no_way_of_the_hand_gains_energy(model, seed):
    """Whatever it does, what it gets back is what it has stored."""
    random = np.random.default_rng(seed)
    session = session_of(model)
    xy = np.cumsum(random.normal(0, random.choice([0.2, 1.0, 4.0]), (150, 2)), axis=0)
    xy = 20 * np.tanh(xy / 20)
    places, ends, forces = ways(session, [blade(over(x, 0.8 * y)) for x, y in xy])
    put_in = -np.cumsum(((forces[1:] + forces[:-1]) / 2 * np.diff(places, axis=0)).sum(axis=1))
    cut = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(ends, axis=0), axis=1))])
    ahead = np.linalg.norm(places - ends, axis=1)
    most = HOLDS * session.settings.give / 2
    assert put_in.min() > -0.02 * most
    # Where the hand turns, the force turns within a tick: by the greater of its two forces the work is not too small.
    by_tick = [-(force * np.diff(places, axis=0)).sum(axis=1) for force in (forces[1:], forces[:-1])]
    spent = HOLDS * cut[1:]
    assert (np.cumsum(np.maximum(*by_tick)) >= 0.999 * spent - 0.02 * most).all(), (
        "a cut is never cheaper than its surface"
    )
    assert (np.linalg.norm(forces, axis=1) <= HOLDS * (1 + 1e-9)).all()
    assert np.isfinite(ahead).all()


def test_the_hand_does_the_work_of_the_cut(model, whole):
    """The loop's forces against the area of the cut mesh, two ways that share nothing."""
    session = session_of(model)
    x = np.linspace(-14, 14, 700)
    places, _, forces = ways(session, [blade(over(each)) for each in x])
    assert session.cut(pp.incision(whole, [over(each) for each in (-14, 0, 14)], depth=DEPTH))
    session.step([None] * 5)
    assert work(places, forces) == pytest.approx(session.cutting_work[-1].total, rel=0.04)


def test_tissue_of_unknown_toughness_holds_no_blade(model):
    session = session_of(model, None, 0.0)
    places, ends, forces = ways(session, [blade(over(x)) for x in np.linspace(-10, 10, 100)])
    assert not forces.any()
    assert np.allclose(places, ends)


def test_a_blade_moves_no_tissue_and_no_other_hand_feels_it(model):
    alone, beside = session_of(model), session_of(model)
    hold = pp.Command(True, over(0, 14), (0, 0, -2))
    forces = [s.step([[None, hold]] * 150)[:, 1] for s in (alone, beside)]
    with_blade = beside.step([[blade(over(x)), hold] for x in np.linspace(-12, 12, 300)])
    without = alone.step([[None, hold]] * 300)
    assert np.array_equal(forces[0], forces[1])
    assert np.array_equal(with_blade[:, 1], without[:, 1])
    assert np.linalg.norm(with_blade[-1, 0]) > 0.5
    assert np.array_equal(alone.displacement, beside.displacement)


def test_it_goes_on_when_the_body_is_cut_behind_it(model, whole):
    session = session_of(model)
    before = session.step([blade(over(x)) for x in np.linspace(-14, 0, 300)])
    assert session.cut(pp.incision(whole, [over(x) for x in (-14, -7, 0)], depth=DEPTH))
    after = session.step([blade(over(x)) for x in np.linspace(0, 14, 300)])
    assert np.linalg.norm(after[0] - before[-1]) < 0.05 * HOLDS
    assert np.linalg.norm(after[-1]) == pytest.approx(HOLDS, rel=0.01)
    assert not session.step([None] * 2)[-1].any()


BY_NAME = {"organ": 100.0, "lump": 900.0}  # J/m²


def region_at(mesh, points):
    """The region of the tetrahedron at each point, by barycentric coordinates; 0 where there is none."""
    corner = mesh.nodes[mesh.tets]
    inverse = np.linalg.inv((corner[:, 1:] - corner[:, :1]).transpose(0, 2, 1))
    near = (corner.min(axis=1) <= points.max(axis=0)).all(axis=1) & (corner.max(axis=1) >= points.min(axis=0)).all(
        axis=1
    )
    found = np.zeros(len(points), int)
    for tet in np.flatnonzero(near):
        weight = (points - corner[tet, 0]) @ inverse[tet].T
        found[(weight >= 0).all(axis=1) & (weight.sum(axis=1) <= 1)] = mesh.region[tet]
    return found


def sampled(mesh, start, way, count=2000):
    """mm of an edge that lie in the body, and J/m² mm, by points along it."""
    region = region_at(mesh, np.asarray(start) + (np.arange(count)[:, None] + 0.5) / count * np.asarray(way))
    step = np.linalg.norm(way) / count
    return step * (region > 0).sum(), step * (100 * (region == 1).sum() + 900 * (region == 2).sum())


@pytest.fixture(scope="module")
def cased():
    """An ellipsoid with a lump near its top."""
    return organ(9)


def test_a_blade_feels_the_tissue_that_its_edge_is_in(cased):
    session, depth, found, expected = session_of(pp.model(cased, "compliance"), BY_NAME, 0.0), 22.0, [], []
    for x in (-24.0, -12.0, -6.0, 1.0, 5.0, 11.0):
        top = np.array(cased.surface.closest(np.array((x, 3.3, 25.0))).point)
        held = session.step([blade(tuple(top + (dx, 0, 0)), depth) for dx in np.linspace(-3, 0, 150)])[-1]
        end = np.array(session.frame().point[0])
        found.append(np.linalg.norm(held))
        expected.append(1e-3 * sampled(cased.mesh, end, (0, 0, -depth))[1])
        assert not session.step([None] * 2)[-1].any()
    np.testing.assert_allclose(found, expected, rtol=0.02)
    assert found[0] == pytest.approx(0.1 * depth, rel=0.01), "beside the lump"
    assert max(found) > 4 * found[0], "through it"


def test_a_blade_feels_what_it_meets_in_a_tissue_that_was_cut_before(cased):
    """A session may begin with a cut tissue, as a room does that was lost: what holds a blade is the body before."""
    top = cased.mesh.nodes[np.argmax(cased.mesh.nodes[:, 2])]
    opened = pp.cut(cased, pp.incision(cased, [top - (0, 9, 0), top + (0, 9, 0)], depth=9))
    way = [blade((float(x), 3.0, 24.5), 20.0) for x in np.linspace(-14, -4, 200)]
    whole, cut = (session_of(pp.model(tissue, "compliance"), BY_NAME, 0.0).step(way) for tissue in (cased, opened))
    np.testing.assert_allclose(cut, whole, atol=1e-3 * np.abs(whole).max())
    assert np.linalg.norm(whole[-1]) > 1.5 * 0.1 * 20


def test_the_hand_does_the_work_of_a_cut_through_a_lump(cased):
    """The loop's forces against the areas of the cut mesh by region, two ways that share nothing."""
    session = session_of(pp.model(cased, "compliance"), BY_NAME, 0.02)
    x, depth = np.linspace(-22, 22, 1500), 28.0
    way = np.array([cased.surface.closest(np.array((each, 1.3, 25.0))).point for each in x])
    places, _, forces = ways(session, [blade(tuple(p), depth) for p in way])
    assert session.cut(pp.incision(cased, way[::60], depth=depth))
    session.step([None] * 5)
    done = session.cutting_work[-1]
    assert done.fracture > 2 * 0.1 * done.area, "much of it is lump"
    assert work(places, forces) == pytest.approx(done.total, rel=0.05)


def test_an_edge_that_comes_out_below_feels_no_more(model):
    """A cube of 50 mm under a blade of 80 mm: 50 of them hold it."""
    session = session_of(model)
    force = session.step([blade(over(x), 80.0) for x in np.linspace(-10, 10, 300)])
    assert np.linalg.norm(force[-1]) == pytest.approx(50 * (1e-3 * TOUGH + RUBS), rel=1e-6)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31))
def test_no_cut_is_cheaper_than_its_surface_however_tough_what_comes_next_is(cased, seed):
    """Also where the depth changes. A spring that were stiffer in tougher tissue would give the hand energy there."""
    random = np.random.default_rng(seed)
    names = {name: float(random.choice([0.0, 20.0, 900.0])) for name in BY_NAME}
    session = session_of(pp.model(cased, "compliance"), names, float(random.choice([0.0, 0.05])))
    walk = np.cumsum(random.normal(0, 0.08, (1500, 3)), axis=0)
    walk = np.stack([np.convolve(np.pad(each, 7, mode="edge"), np.full(15, 1 / 15), "valid") for each in walk.T])
    xy, depth = (14 * np.tanh(walk[:2] / 14)).T + random.normal(0, 5, 2), 14 + 10 * np.tanh(walk[2])
    places, ends, forces = ways(session, [blade((x, y, 25.0), d) for (x, y), d in zip(xy, depth, strict=True)])
    along = session.settings.resistance.along
    met = np.array([along(tuple(end), (0.0, 0.0, -d)) for end, d in zip(ends, depth, strict=True)])
    holds = 1e-3 * met[:, 1] + session.settings.blade_friction * met[:, 0]  # N
    cut = np.linalg.norm(np.diff(ends, axis=0), axis=1)
    spent = np.cumsum(np.minimum(holds[1:], holds[:-1]) * cut)
    # Where the force turns within a tick, by the greater of its two values the work is not too small.
    by_tick = [-(force * np.diff(places, axis=0)).sum(axis=1) for force in (forces[1:], forces[:-1])]
    put_in = np.cumsum(np.maximum(*by_tick))
    assert (put_in >= 0.999 * spent - 1e-3).all()


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**31))
def test_the_toughness_along_an_edge_is_that_of_its_parts(cased, seed):
    """Against points along the edge, and the tetrahedra that they lie in by their barycentric coordinates."""
    random = np.random.default_rng(seed)
    mesh = cased.mesh
    start, way = random.uniform(-45, 45, 3), random.normal(0, 25, 3)
    resistance = _core.simulation.CutResistance(mesh.nodes, mesh.tets, mesh.region, {1: 100.0, 2: 900.0})
    found = resistance.along(tuple(start), tuple(way))
    ends = 12 * np.linalg.norm(way) / 2000  # each of some crossings may be half a point off
    np.testing.assert_allclose(found, sampled(mesh, start, way), atol=900 * ends)
    assert found[0] == pytest.approx(sampled(mesh, start, way)[0], abs=ends)
    parts = [resistance.along(tuple(start + a * way), tuple(way / 2)) for a in (0, 0.5)]
    np.testing.assert_allclose(np.sum(parts, axis=0), found, rtol=1e-6, atol=1e-4)


def test_an_edge_in_faces_that_are_shared_is_counted_once(whole):
    """A lattice of bricks: the edge lies in faces and edges of its tetrahedra."""
    mesh = whole.mesh
    resistance = _core.simulation.CutResistance(
        mesh.nodes, mesh.tets, mesh.region, dict.fromkeys(np.unique(mesh.region).tolist(), 7.0)
    )
    low, high = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
    middle = mesh.nodes[np.argmin(np.linalg.norm(mesh.nodes - (low + high) / 2, axis=1))]
    for axis in range(3):
        for start in (middle, (low + high) / 2):
            begin, way = start.copy(), np.zeros(3)
            begin[axis], way[axis] = low[axis] - 3, high[axis] - low[axis] + 6
            inside, tough = resistance.along(tuple(begin), tuple(way))
            assert inside == pytest.approx(high[axis] - low[axis], rel=1e-9)
            assert tough == pytest.approx(7 * inside, rel=1e-12)


def test_a_record_of_a_blade_replays_to_the_bit(model):
    session = session_of(model)
    session.step([*[blade(over(x)) for x in np.linspace(-14, 14, 500)], *[None] * 20])
    record = session.record()
    assert set(record.kinds) == {0, 4}
    assert session_of(model).replay(record) is None
    with pytest.raises(pp.errors.DataError, match="toughness"):
        session_of(model, 500.0).replay(record)
    touched = pp.Session(model, radius=9.0, sweeps=4)
    touched.step([pp.Command(True, over(0), (0, 0, -2))] * 200)
    older = dataclasses.replace(
        touched.record(),
        settings={
            k: v
            for k, v in touched.record().settings.items()
            if not k.startswith("toughness") and k not in ("blade_friction", "give")
        },
    )
    assert session_of(model).replay(older) is None, "a record from before blades were felt"


def test_a_blade_that_is_nowhere_is_refused(model):
    session = session_of(model)
    force = session.step([blade(over(0)), blade((np.nan, 25.0, 50.0)), blade(over(1))])
    assert not force.any()
    assert session.frame().contact[0] == 2
