"""Haptic devices at sites of one room, tick by tick: servo, loop, room and network in virtual time."""

import numpy as np
import pytest
from support.device_sites import LEFT, RADIUS, RIGHT, World, pressing, pulling
from support.example_organs import organ

import palpate as pp
from palpate.rooms.join import ENERGY
from palpate.server.message_kinds import LeadStep, Role
from palpate.server.messages import Lead

ABOVE = np.array([0.0, 0.0, 5.0])
DOWN = (0.0, 0.0, -1.0)
NOTHING = 1e-9  # N


@pytest.fixture(scope="module")
def tissue():
    return organ(6)


def still(place, depth, button=0):
    """A wish: in within 0.5 s, and there it stays."""
    return pressing(place, DOWN, depth, still=0.5, back=1e9, swing=0, button=button)


def size(site):
    return float(np.linalg.norm(site.force))


@pytest.mark.parametrize(("delay", "loss"), [(0, 0.0), (150, 0.05)])
def test_force_of_both_hands_is_that_of_one_push(tissue, delay, loss):
    """At both sites and in the room, once all has arrived."""
    world = World(tissue, [LEFT + ABOVE, RIGHT + ABOVE], delay=delay, loss=loss)
    for site, place in zip(world.sites, (LEFT, RIGHT), strict=True):
        site.wish = still(place, 5)
    world.run(3000 + 6 * delay)
    frames = [site.session.frame() for site in world.sites]
    pushed = pp.model(tissue, "compliance").push(
        [frame.point[0] for frame in frames], [frame.displacement[0] for frame in frames], RADIUS
    )
    room = world.session.frame()
    for k, (site, frame) in enumerate(zip(world.sites, frames, strict=True)):
        expected, tool = pushed.force[k], world.tools.tool(site, 0)
        assert np.linalg.norm(expected) > 0.1
        for force in (frame.force[0], site.force, room.force[tool]):
            assert np.linalg.norm(force - expected) < 0.02 * np.linalg.norm(expected)
        np.testing.assert_allclose(room.displacement[tool], frame.displacement[0], atol=1e-3)


@pytest.mark.parametrize("delay", [0, 150])
@pytest.mark.parametrize("wish", [pressing, pulling])
def test_hands_get_no_energy_and_feel_no_steps(tissue, delay, wish):
    """Two hands that work against each other, with jitter and lost packets."""
    rng = np.random.default_rng(delay)
    world = World(tissue, [LEFT + ABOVE, RIGHT + ABOVE], delay=delay, seed=delay)
    for site, place, side in zip(world.sites, (LEFT, RIGHT), (1, -1), strict=True):
        towards = (0.3 * side, 0, -0.95) if wish is pressing else (-0.8 * side, 0, 0.6)
        site.wish = wish(place, towards, 7, tug=rng.uniform(0.5, 1.5), phase=rng.uniform(0, 6))
    world.run(5000 + 4 * delay)
    contacts = [one for site in world.sites for one in site.contacts]
    assert len(contacts) >= 2
    assert max(one.largest for one in contacts) > 0.4
    assert max(one.most_energy for one in contacts) < 2  # mJ
    felt = [one for one in contacts if one.largest > 0.05]  # others graze the tissue at their end
    assert max(one.step / one.largest for one in felt) < 0.05


@pytest.mark.parametrize("delay", [0, 150])
def test_soft_hand_that_is_pulled_about_gets_what_its_account_allows(tissue, delay):
    """And several times that without the account: what the other one puts in."""
    got = []
    for energy in (ENERGY, 1e9):
        world = World(tissue, [LEFT + ABOVE, RIGHT + ABOVE], delay=delay, seed=3, energy=energy)
        soft, strong = world.sites
        soft.stiffness = 0.05  # N/mm
        soft.wish = pulling(LEFT, (0, 0, 1.0), 0, back=1e9)
        strong.wish = pulling(RIGHT, (-0.8, 0, 0.6), 15, still=5.5, back=6, swing=0.9)
        world.run(5500)
        (one,) = soft.contacts
        got.append(one.most_energy)
        assert one.step < 0.05 * one.largest
        assert one.largest > 0.2
    assert got[0] < 2  # mJ
    assert got[1] > 3


def far_push(world, ticks=1500):
    """One hand rests 5 mm deep, the other far away in the air."""
    world.sites[0].wish = still(LEFT, 5)
    for site in world.sites[1:]:
        site.wish = lambda _, at=site.start: (at, 0)
    world.run(ticks)
    assert size(world.sites[0]) > 0.1


def withdrawn(world, ticks):
    """Forces of the first hand, which goes on pressing deeper."""
    site = world.sites[0]
    deeper, began = site.wish, world.now
    site.wish = lambda now: (deeper(now)[0] + 0.05 * (now - began) * np.array(DOWN), 0)
    forces = [size(site)]
    for _ in range(ticks):
        world.tick()
        forces.append(size(site))
    return np.array(forces)


def test_lost_room_takes_the_force_away_within_ten_ticks(tissue):
    world = World(tissue, [LEFT + ABOVE, RIGHT + ABOVE], loss=0.0)
    far_push(world)
    world.cut = True
    world.sites[0].hand.lose()
    forces = withdrawn(world, 60)
    assert forces[0] > 0.1
    assert forces[1] > 0.5 * forces[0]  # it fades
    assert np.diff(forces[1:]).max() <= 0
    assert np.all(forces[10:] == 0)


def test_silent_room_takes_the_force_away_in_time(tissue):
    world = World(tissue, [LEFT + ABOVE, RIGHT + ABOVE], delay=20, loss=0.0)
    far_push(world)
    patience = int(1000 * world.sites[0].hand.patience)
    assert 100 < patience < 1500
    world.cut = True
    on_its_way = max((at for at, _ in world.down[0].waiting), default=world.now) - world.now  # ms
    forces = withdrawn(world, int(on_its_way) + patience + 40)
    gone = int(np.argmax(forces == 0))
    assert patience - 30 < gone <= on_its_way + patience + 10
    assert np.all(forces[gone:] == 0)
    falling = forces[gone - 5 : gone + 1]
    assert np.diff(falling).max() < 0
    world.cut = False
    world.run(30)
    back = withdrawn(world, 400)
    assert back[-1] > 0.1  # it has waited in the tissue, and the force rises by the ramp
    assert np.diff(back).max() < 0.02 * back.max()


def test_stopped_hand_feels_nothing_and_goes_on(tissue):
    world = World(tissue, [LEFT + ABOVE, RIGHT + ABOVE], loss=0.0, roles=[Role.trainee, Role.teacher])
    far_push(world)
    before = np.array(world.session.frame().displacement[0])
    world.freeze(True)
    world.run(50)
    assert size(world.sites[0]) == 0
    world.sites[0].wish = still(LEFT, 2)
    world.run(600)
    np.testing.assert_allclose(world.session.frame().displacement[0], before, atol=1e-3)
    np.testing.assert_allclose(world.sites[0].session.frame().displacement[0], before, atol=0.02)
    assert size(world.sites[0]) == 0
    world.freeze(False)
    world.run(1500)
    after = world.session.frame().displacement[0]
    assert 0 > after[2] > 0.7 * before[2]
    expected = pp.model(tissue, "compliance").push(world.session.frame().point[0], after, RADIUS).force
    np.testing.assert_allclose(world.sites[0].force, expected, rtol=0.02, atol=2e-3)


@pytest.mark.parametrize("step", [LeadStep.release, LeadStep.take_over])
def test_hand_whose_tool_is_taken_begins_anew_outside(tissue, step):
    world = World(tissue, [LEFT + ABOVE, RIGHT + ABOVE], delay=20, loss=0.0, roles=[Role.trainee, Role.teacher])
    far_push(world)
    trainee, teacher = world.sites
    world.room.lead(teacher, Lead(step, world.room.people[trainee].number))
    world.run(400)
    assert size(trainee) < NOTHING
    held = {page for page, _ in world.tools.holders.values()}
    assert held == ({teacher} if step == LeadStep.take_over else set())
    world.run(400)
    assert size(trainee) < NOTHING  # still inside
    trainee.wish = lambda _: (LEFT + ABOVE, 0)
    world.run(600)
    trainee.wish = lambda _: (LEFT + 5 * np.array(DOWN), 0)
    world.run(1500)
    assert size(trainee) > 0.1
    assert trainee in {page for page, _ in world.tools.holders.values()}


def test_hand_beside_four_others_has_no_tool_and_no_force(tissue):
    places = [(x, y, 24.0) for x, y in ((-25.0, 0.0), (25.0, 0.0), (0.0, 18.0), (0.0, -18.0))]
    world = World(tissue, [LEFT + ABOVE], loss=0.0)
    others = [object() for _ in places]
    for other, place in zip(others, places, strict=True):
        world.room.enter(other, "", Role.trainee)
        world.tools.command(other, 0, pp.Command(True, place, (0, 0, -0.5)), 1)
    site = world.sites[0]
    site.wish = still(LEFT, 5)
    world.run(1500)
    assert size(site) < NOTHING
    assert len(world.tools.holders) == 4
    world.tools.command(others[0], 0, pp.Command(), 2)
    site.wish = lambda _: (LEFT + ABOVE, 0)
    world.run(600)
    site.wish = lambda _: (LEFT + 5 * np.array(DOWN), 0)
    world.run(1500)
    assert size(site) > 0.1
