"""The two ends of a guidance, as the pages have them, over a network that is slow: energy, balance, and no steps."""

import numpy as np
import pytest
from support.guided_hands import a_hand, at_random, guided_hands, pulling

STIFFNESS, LIMIT = 0.1, 1.0  # N/mm, N: as documented
MOST_ENERGY = 2.0  # mJ
STEP = 0.035  # N, in a tick
STILL = {"loss": 0.0, "jitter": 0.0}


def of_all(told, name):
    return [hand[name] for contact in told for hand in contact["hands"]]


@pytest.mark.parametrize("hands", [pulling, at_random], ids=["pull against each other", "at random"])
@pytest.mark.parametrize("delay", [0, 50, 150, 300])
def test_hands_get_no_energy_from_the_coupling_however_late_it_is(tmp_path, delay, hands):
    """What one gets the other has put in. Of twenty contacts; without the tanks the same hands get many times as much."""
    rng = np.random.default_rng(delay)
    contacts = [hands(rng) for _ in range(20)]
    told = guided_hands(tmp_path, contacts, delay=delay)
    assert len(told) == 20
    assert max(of_all(told, "largest")) > 0.8 * LIMIT
    assert max(contact["together"] for contact in told) < MOST_ENERGY, "at any time"
    for contact in told:
        one, other = (hand["energy"] for hand in contact["hands"])
        assert one < MOST_ENERGY + max(0, -other)
        assert other < MOST_ENERGY + max(0, -one)
    assert max(of_all(told, "step")) < STEP
    without = guided_hands(tmp_path, contacts[:10], delay=delay, first=1e9)
    assert max(contact["together"] for contact in without) > 4 * MOST_ENERGY


@pytest.mark.parametrize("delay", [0, 50, 150, 300])
def test_a_hand_that_works_against_one_at_rest_gets_nothing(tmp_path, delay):
    """The other one is firm, and puts nothing in."""
    rng = np.random.default_rng(delay)
    for moves in (0, 1):
        contacts = []
        for _ in range(20):
            hands = pulling(rng)
            hands[1 - moves] |= {"size": 0, "stiffness": 30.0}
            contacts.append(hands)
        told = guided_hands(tmp_path, contacts, delay=delay)
        assert max(hand["most"] for contact in told for hand in contact["hands"]) < MOST_ENERGY
        assert min(contact["hands"][moves]["largest"] for contact in told) > 0.05


@pytest.mark.parametrize("compliance", [0.0, 5.0])
@pytest.mark.parametrize("apart", [3.0, 8.0, 40.0])
def test_at_rest_both_feel_the_spring_equal_and_opposite(tmp_path, apart, compliance):
    """A hand that the force moves, and one whose tool gives way in its place; beyond its limit the force is that."""
    firm = {"stiffness": 30.0}
    hands = [a_hand([0.0] * 3, [1.0, 0, 0], 0, **firm), a_hand([0.0, apart, 0.0], [1.0, 0, 0], 0, **firm)]
    ((one, other),) = (
        contact["hands"] for contact in guided_hands(tmp_path, [hands], delay=0, compliance=compliance, **STILL)
    )
    force, back = np.array(one["last"]["felt"]), np.array(other["last"]["felt"])
    tools = [np.add(hand["last"]["x"], hand["last"]["offset"]) for hand in (one, other)]
    spring = STIFFNESS * (tools[1] - tools[0])
    expected = spring * min(1, LIMIT / np.linalg.norm(spring))
    np.testing.assert_allclose(force, expected, atol=1e-3 * LIMIT)
    np.testing.assert_allclose(force, -back, atol=1e-3 * LIMIT)
    assert np.linalg.norm(force) > 0.1
    np.testing.assert_allclose(other["last"]["offset"], compliance * back, atol=1e-2)


@pytest.mark.parametrize("delay", [0, 50, 150, 300])
def test_a_loose_hand_is_led_and_gets_what_the_teacher_puts_in(tmp_path, delay):
    speed, length = 10.0, 4000  # mm/s, ms
    hands = [a_hand([0.0] * 3, [1.0, 0, 0], speed), a_hand([0.0] * 3, [1.0, 0, 0], 0, stiffness=0.0)]
    ((teacher, led),) = (c["hands"] for c in guided_hands(tmp_path, [hands], delay=delay, way="on", length=length))
    way = teacher["last"]["x"][0]
    assert way > 0.9 * speed * length / 1000
    assert led["last"]["x"][0] > 0.4 * way, "late by the way there, and by how soft the coupling is"
    assert teacher["energy"] < -1
    assert 1 < led["energy"] < -teacher["energy"]


@pytest.mark.parametrize("delay", [0, 150])
@pytest.mark.parametrize("who", [0, 1, None], ids=["the teacher lets go", "the trainee lets go", "the teacher ends it"])
def test_it_begins_and_ends_without_a_step(tmp_path, who, delay):
    """For whoever lets go the force ends with the contact, as the tissue's does."""
    hands = [a_hand([0.0] * 3, [1.0, 0, 0], 0), a_hand([9.0, 0.0, 0.0], [1.0, 0, 0], 0)]
    if who is not None:
        hands[who]["lets_go"] = 2000
    (contact,) = guided_hands(tmp_path, [hands], delay=delay)
    assert max(of_all([contact], "step")) < STEP
    assert min(of_all([contact], "largest")) > 0.3
    assert of_all([contact], "after") == [0, 0], "nothing is left of it"
    assert max(of_all([contact], "energy")) < MOST_ENERGY
