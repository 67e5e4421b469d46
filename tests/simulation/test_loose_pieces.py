"""Pieces that the cuts of a session free, as bodies of their own: they lie, are carried, and fall, as physics asks.

The weights and falls that are expected follow from the constants here, not from the code's.
"""

from dataclasses import replace

import numpy as np
import pytest
from support.example_organs import organ

import palpate as pp
from palpate.simulation.loose_pieces import MOST, carried_to, down
from palpate.simulation.pointer import ContactState, PieceState
from palpate.tissue.cutting import cut_apart

RADIUS = 8.0
G = 9.81  # m/s²
LIVER = 1060.0  # kg/m³, of the table of tissues
LYING, CARRIED, FALLING, GONE = PieceState.lying, PieceState.carried, PieceState.falling, PieceState.gone


@pytest.fixture(scope="module")
def whole():
    tissue = organ(10)
    return tissue.replace(materials=dict.fromkeys(tissue.mesh.names, "liver"))


@pytest.fixture(scope="module")
def model(whole):
    return pp.model(whole, "compliance")


@pytest.fixture
def session(model):
    return pp.Session(model, radius=RADIUS, sweeps=4)


def plane(z):
    """A flat blade through everything at a height: what is above has tissue below it."""
    return pp.Blade.swept([(-200, -200, z), (200, -200, z)], (0, 1, 0), 400)


def pole(x=30.0):
    """A flat blade through everything that takes the end at larger x: below it is nothing."""
    return pp.Blade.swept([(x, -200, 100), (x, 200, 100)], (0, 0, -1), 400)


def carry(point, way=(0.0, 0.0, 0.0)):
    return pp.Command(True, tuple(point), tuple(way), "carry")


def state(session):
    return list(session.frame().piece_state)


def offset(session, piece=0):
    return np.array(session.frame().piece_offset[piece])


def top(session, piece=0):
    """The highest point of a piece."""
    places = session.pieces[piece].drawn.places
    return places[np.argmax(places[:, 2])]


def mass(volume):
    """kg of so many mm³ of liver."""
    return LIVER * 1e-9 * volume


def test_a_piece_without_tissue_below_it_falls_freely_until_it_is_gone(whole, session):
    session.cut(pole())
    ways = []
    for _ in range(120):
        session.step([None])
        ways.append(offset(session))
    seconds = np.arange(120) / 1000
    assert np.array(ways)[:, 2] == pytest.approx(-1000 * G * seconds**2 / 2, rel=1e-12, abs=1e-15)
    assert np.abs(np.array(ways)[:, :2]).max() < 1e-12
    assert state(session) == [FALLING]
    far = 3 * np.linalg.norm(np.ptp(whole.mesh.nodes, axis=0))
    left = int(1000 * np.sqrt(2 * far / 1000 / G)) - 120
    session.step([None] * left)
    assert state(session) == [FALLING]
    session.step([None] * 3)
    assert state(session) == [GONE]
    session.step([carry(top(session))])
    assert session.frame().contact[0] == ContactState.refused


def test_a_piece_with_tissue_below_it_lies_until_it_is_taken(session):
    session.cut(plane(12.0))
    session.step([None] * 500)
    assert state(session) == [LYING]
    assert not offset(session).any()


@pytest.mark.parametrize(("side", "lies"), [((0, 0, -1), False), ((-1, 0, 0), True)])
def test_down_is_where_the_organ_is_held(whole, side, lies):
    """The end at large x lies on an organ that is held at small x."""
    held = whole.replace(fixed=pp.resting_on(whole.mesh, side, depth=8.0))
    assert down(held) == pytest.approx(side, abs=0.2)
    session = pp.Session(pp.model(held, "compliance"), radius=RADIUS, sweeps=4)
    session.cut(pole())
    assert session.pieces[0].bedded == lies


def test_an_organ_that_is_held_all_around_lies_on_the_back_of_the_patient(whole):
    assert down(whole.replace(fixed=whole.mesh.surface_nodes)).tolist() == [0, 1, 0]


def test_a_carried_piece_follows_its_tool_rigidly(session):
    session.cut(plane(12.0))
    session.step([None])
    at, rng, apart = top(session), np.random.default_rng(3), []
    session.step([carry(at)])
    for _ in range(30):
        way = rng.uniform(-20, 20, 3)
        session.step([carry(at, way)] * 7)
        apart.append(np.array(session.frame().tip[0]) - offset(session))
    assert np.abs(np.array(apart) - at).max() < 1e-12
    session.step([carry(at, (5, -4, 30))] * 600)
    assert offset(session) == pytest.approx([5, -4, 30], abs=1e-12)
    assert state(session) == [CARRIED]
    assert session.frame().contact[0] == ContactState.carrying


def test_two_tools_carry_it_between_them_and_it_stays_when_one_comes_or_goes(session):
    session.cut(plane(12.0))
    session.step([None])
    places = session.pieces[0].drawn.places
    one, other = places[np.argmin(places[:, 0])], places[np.argmax(places[:, 0])]
    session.step([[carry(one, (0, 0, 20)), None]] * 500)
    before = offset(session)
    session.step([[carry(one, (0, 0, 20)), carry(other)]])
    assert offset(session) == pytest.approx(before, abs=0.9), "the other one sets out for where it was"
    session.step([[carry(one, (0, 0, 20)), carry(other, (8, 0, 20))]] * 500)
    assert offset(session) == pytest.approx(before + (4, 0, 0), abs=1e-9)
    force = session.step([[carry(one, (0, 0, 20)), carry(other, (8, 0, 20))]])[-1]
    assert force[0] == pytest.approx(force[1])
    assert force.sum(axis=0)[2] == pytest.approx(-G * mass(sum(session.taken.values())), rel=1e-9)
    session.step([[None, carry(other, (8, 0, 20))]])
    assert offset(session) == pytest.approx(before + (4, 0, 0), abs=1e-9)


def test_the_hand_bears_its_weight(session):
    session.cut(plane(12.0))
    session.step([None])
    at = top(session)
    force = session.step([carry(at, (0, 0, 15))] * 400)
    weight = G * mass(sum(session.taken.values()))
    assert weight > 0.1
    assert force[-1] == pytest.approx([0, 0, -weight], rel=1e-9)
    assert np.array(session.frame().device_force[0]) == pytest.approx([0, 0, -weight], rel=1e-9)


def test_what_has_no_known_density_weighs_nothing(whole):
    light = pp.Session(pp.model(whole.replace(materials={}), "compliance"), radius=RADIUS, sweeps=4)
    light.cut(plane(12.0))
    light.step([None])
    assert not light.step([carry(top(light), (0, 0, 15))] * 50).any()
    only = {number: "liver" for number, name in whole.mesh.names.items() if name == "lump"}
    part = pp.Session(pp.model(whole.replace(materials=only), "compliance"), radius=RADIUS, sweeps=4)
    part.cut(plane(12.0))
    assert part.pieces[0].weight == pytest.approx(G * mass(part.taken["lump"]), rel=1e-9)
    assert part.taken["organ"] > part.taken["lump"]


def test_raising_it_costs_its_weight_times_the_height_and_a_loop_costs_nothing(session):
    session.cut(plane(12.0))
    session.step([None])
    at, rng = top(session), np.random.default_rng(4)
    session.step([carry(at)])
    begun = session.frame().work

    def go_to(way):
        """Tick by tick; the work of the hand, mJ, by the trapezoidal rule."""
        done = 0.0
        for _ in range(400):
            tip = np.array(session.frame().tip[0])
            force = session.step([carry(at, way)])[0]
            done -= force @ (np.array(session.frame().tip[0]) - tip)
        return done

    height = 25.0
    up = go_to((0.0, 0.0, height))
    assert up == pytest.approx(G * mass(sum(session.taken.values())) * height, rel=1e-9)
    around = sum(go_to(rng.uniform(-15, 15, 3)) for _ in range(3)) + go_to((0.0, 0.0, height))
    assert abs(around) < 1e-9 * up
    assert session.frame().work - begun == pytest.approx(up, rel=1e-9), "as the loop counts it"
    assert go_to((0.0, 0.0, 0.0)) == pytest.approx(-up, rel=1e-9)


def test_let_go_it_falls_from_where_it_was_unless_it_is_back_in_its_bed(session):
    session.cut(plane(12.0))
    session.step([None])
    at = top(session)
    session.step([carry(at, (0, 0, 15))] * 600)
    session.step([carry(at, (0.3, 0, 0.2))] * 600 + [None])
    assert state(session) == [LYING]
    session.step([carry(at, (12, 0, 15))] * 600 + [None] * 101)
    assert state(session) == [FALLING]
    assert offset(session) == pytest.approx([12, 0, 15 - 1000 * G * 0.1**2 / 2], abs=1e-9)
    before = offset(session)
    session.step([carry(at, before)])
    assert state(session) == [CARRIED], "it is caught"


def test_a_hand_that_pulls_at_what_comes_free_carries_it(whole, session):
    at = whole.mesh.nodes[np.argmax(whole.mesh.nodes[:, 2])]
    pull = pp.Command(True, tuple(at), (1.0, 0.0, 3.0))
    session.step([pull] * 600)
    assert session.cut(plane(9.0))
    tip = np.array(session.frame().tip[0])
    session.step([pull])
    assert state(session) == [CARRIED]
    assert np.abs(offset(session)).max() < 1e-6, "it starts where it was"
    assert np.array(session.frame().tip[0]) == pytest.approx(tip, abs=1e-6)
    higher = pp.Command(True, tuple(at), (1.0, 0.0, 13.0))
    force = session.step([higher] * 600)[-1]
    assert offset(session) == pytest.approx([0, 0, 10], abs=1e-6)
    assert force == pytest.approx([0, 0, -session.pieces[0].weight], rel=1e-9)
    session.step([None])
    assert state(session) == [FALLING]


def test_a_hand_that_presses_on_what_comes_free_has_nothing_under_it(whole, session):
    at = whole.mesh.nodes[np.argmax(whole.mesh.nodes[:, 2])]
    press = pp.Command(True, tuple(at), (0.0, 0.0, -2.0))
    session.step([press] * 300)
    session.cut(plane(12.0))
    force = session.step([press] * 20)
    assert not force.any()
    assert session.frame().contact[0] == ContactState.refused
    assert state(session) == [LYING]


def test_it_has_the_shape_that_it_had_in_the_body(whole, session):
    """Its outer surface is where the body's was drawn in that moment, and so is the bed under it."""
    at = whole.mesh.nodes[np.argmax(whole.mesh.nodes[:, 2])]
    session.step([pp.Command(True, tuple(at), (2.0, 0.0, 6.0))] * 600)
    frame, drawn = session.frame(), session.displayed
    before = dict(zip(map(tuple, drawn.places.round(6)), session.drawn(frame), strict=True))
    field = session.displacement
    session.cut(plane(9.0))
    piece = session.pieces[0]
    moved = piece.places - piece.drawn.places
    alike = [(k, before[key]) for k, key in enumerate(map(tuple, piece.drawn.places.round(6))) if key in before]
    assert len(alike) > 50
    index, expected = [k for k, _ in alike], np.array([u for _, u in alike])
    assert np.abs(expected).max() > 2
    assert np.abs(moved[index] - expected).max() < 2e-3 * np.abs(expected).max()
    lips = moved[piece.drawn.lips[0] :]  # inside the body: bounded by its field, and moved with it
    assert np.abs(lips).max() > 0.2
    assert np.abs(lips).max() < np.abs(field).max()


def test_of_a_body_that_was_cut_before_it_takes_the_side_that_it_was_on(whole):
    """Of the copies of a tetrahedron that an earlier cut has made, those above it."""
    above = np.flatnonzero(whole.mesh.nodes[:, 2] > 20)
    before = pp.cut(whole.replace(fixed=np.union1d(whole.fixed, above)), plane(9.0)).mesh  # held on both sides
    upper = before.body[np.argmax(before.nodes[before.tets].mean(axis=1)[:, 2])]
    value = np.full((len(before.nodes), 3), -1.0)
    value[before.tets[before.body == upper]] = 1.0
    piece = cut_apart(whole, (plane(9.0),))[1][0]
    copied = np.bincount(before.parent)[piece.parent] > 1
    assert np.count_nonzero(copied) > 100
    assert (carried_to(piece, before, value) == 1.0).all()


def test_pieces_go_on_through_later_cuts(session):
    session.cut(plane(16.0))
    session.step([None])
    at = top(session)
    session.step([carry(at, (0, 0, 30))] * 600)
    volume = session.pieces[0].volume
    session.cut(pole())
    session.step([carry(at, (0, 0, 30))] * 5)
    sizes = [one.volume for one in session.pieces]
    upper = int(np.argmin(np.abs(np.array(sizes) - volume)))
    assert sizes[upper] == pytest.approx(volume)
    assert len(sizes) == 2
    assert state(session)[upper] == CARRIED
    assert state(session)[1 - upper] == FALLING
    assert offset(session, upper) == pytest.approx([0, 0, 30], abs=1e-9)
    session.undo()
    session.step([carry(at, (0, 0, 30))] * 5)
    assert state(session) == [CARRIED]
    assert offset(session) == pytest.approx([0, 0, 30], abs=1e-9)
    session.undo()
    session.step([carry(at, (0, 0, 30))] * 5)
    assert (session.pieces, state(session)) == ((), [])
    assert session.frame().contact[0] == ContactState.refused, "until the tool is taken away"


def test_undo_puts_it_back_into_the_body_and_forces_are_those_of_before_to_the_bit(whole, session, model):
    at = whole.mesh.nodes[np.argmax(whole.mesh.nodes[:, 2])]
    session.cut(plane(12.0))
    session.step([None])
    session.step([carry(top(session), (0, 9, 15))] * 300)
    session.undo()
    session.step([None] * 3)
    assert (session.pieces, session.taken) == ((), {})
    assert session.mesh.volumes.sum() == whole.mesh.volumes.sum()
    press = [pp.Command(True, tuple(at), (0.0, 0.0, -2.0))] * 300
    assert np.array_equal(session.step(press), pp.Session(model, radius=RADIUS, sweeps=4).step(press))


def test_a_record_replays_them_to_the_bit(session, model, tmp_path):
    session.step([None] * 10)
    session.cut(plane(14.0))
    session.step([None])
    at = top(session)
    session.step([carry(at, (3, 2, 25))] * 240)
    session.cut(pole())
    session.step([carry(at, (3, 2, 25))] * 60 + [None] * 120)
    pp.write_record(tmp_path / "session.h5", session.record())
    record = pp.read_record(tmp_path / "session.h5")
    again = pp.Session(model, radius=RADIUS, sweeps=4)
    assert again.replay(record) is None
    assert np.array_equal(again.frame().piece_offset, session.frame().piece_offset)
    assert state(again) == state(session)
    assert again.frame().work == session.frame().work
    ways = record.displacements.copy()
    ways[record.kinds == 5] += 1.0  # the hand feels the same weight elsewhere
    another = pp.Session(model, radius=RADIUS, sweeps=4)
    assert another.replay(replace(record, displacements=ways)) is not None, "the digests know of places"


@pytest.mark.parametrize("seed", range(6))
def test_volume_is_kept_by_whatever_cuts(whole, seed):
    """Of the body and its pieces together."""
    rng = np.random.default_rng(seed)
    blades = []
    for _ in range(3):
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        along = np.cross(normal, rng.normal(size=3))
        along *= 200 / np.linalg.norm(along)
        middle = rng.uniform(-0.6, 0.6, 3) * (40, 30, 25) * (1, 1, 0.5) + (0, 0, 6)
        across = np.cross(normal, along)
        size = rng.choice([1.0, 0.06])  # some end inside the organ
        corners = [middle + size * (a * along + b * across) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        blades.append(pp.Blade(np.array(corners), [(0, 1, 2), (0, 2, 3)]))
    left, pieces = cut_apart(whole, blades)
    together = left.mesh.volumes.sum() + sum(piece.volumes.sum() for piece in pieces)
    assert together == pytest.approx(whole.mesh.volumes.sum(), rel=1e-9)
    for piece in pieces:
        inside = np.linalg.det(piece.places[piece.skin.triangles]).sum() / 6
        assert inside == pytest.approx(piece.volumes.sum(), rel=1e-6), "its skin is closed around its volume"


def test_of_very_many_pieces_the_largest_stay(whole, session):
    walls = [pp.Blade.swept([(a, -200, 40), (a, 200, 40)], (0, 0, -1), 400) for a in np.linspace(-30, 30, 7)]
    walls += [pp.Blade.swept([(-200, b, 40), (200, b, 40)], (0, 0, -1), 400) for b in np.linspace(-20, 20, 5)]
    walls.append(plane(10.0))
    first = np.cumsum([0, *(len(one.points) for one in walls)])
    triangles = np.concatenate([one.triangles + n for one, n in zip(walls, first, strict=False)])
    blade = pp.Blade(np.concatenate([one.points for one in walls]), triangles)
    assert session.cut(blade)
    session.step([None])
    assert len(state(session)) == len(session.pieces) == MOST
    freed = [piece.volumes.sum() for piece in cut_apart(whole, (blade,))[1]]
    assert len(freed) > MOST
    assert [one.volume for one in session.pieces] == pytest.approx(sorted(freed, reverse=True)[:MOST], rel=1e-6)
    assert sum(session.taken.values()) == pytest.approx(sum(freed), rel=1e-6)
