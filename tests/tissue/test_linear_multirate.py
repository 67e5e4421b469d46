"""Multigrid beside the loop: a session feels the force of a push, whatever the mesh, and replays to the bit."""

import numpy as np
import pytest
from support.brick_meshes import block
from support.running_server import until

import palpate as pp
from palpate.simulation.scripted_device import ScriptedDevice

RADIUS, TOP, SIDE = 12.0, (25.0, 25.0, 50.0), (10.0, 12.0, 50.0)
TISSUE = block(7, poisson=0.45)
MODEL = pp.model(TISSUE, "multigrid", interval=8)


def hold(point, displacement):
    return pp.Command(True, point, tuple(map(float, displacement)))


def session():
    return pp.Session(MODEL, radius=RADIUS, sweeps=1)


def test_a_held_contact_settles_on_the_force_and_the_field_of_a_push():
    one, push = session(), np.array([1.0, -0.5, -4.0])
    force = one.step([hold(TOP, push)] * 600)[-1]
    truth = pp.finite_elements(TISSUE).push(TOP, push, RADIUS)
    np.testing.assert_allclose(force, truth.force, atol=1e-3 * np.linalg.norm(truth.force))
    np.testing.assert_allclose(one.displacement, truth.displacement, atol=5e-3 * np.linalg.norm(push))
    shown = one.shown
    np.testing.assert_allclose(one.frame().shown, truth.displacement[shown], atol=5e-3 * np.linalg.norm(push))


def test_a_slide_feels_the_force_of_each_place():
    """30 mm at 30 mm/s, with solutions that are 8 ticks old."""
    x = np.linspace(10, 40, 1000)
    commands = [hold((10.0, 25.0, 50.0), (0, 0, -3.0))] * 400 + [hold((at, 25.0, 50.0), (0, 0, -3.0)) for at in x]
    one, truth, off = session(), pp.finite_elements(TISSUE), []
    for first in range(0, len(commands), 50):
        one.step(commands[first : first + 50])
        frame = one.frame()
        if first >= 400:
            exact = truth.push(frame.point[0], frame.displacement[0], RADIUS).force
            off.append(np.linalg.norm(frame.model_force[0] - exact) / np.linalg.norm(exact))
    assert max(off) < 0.03


def test_two_tools_come_and_go_without_a_step_and_feel_each_other():
    a, b = hold(TOP, (0, 0, -3.0)), hold(SIDE, (0, 0, -2.0))
    one = session()
    alone = one.step([[a, None]] * 500)
    before = np.array(one.frame().shown)
    for _ in range(8):  # nor is the picture of the first one lost until the second's stiffness is known
        one.step([[a, b]])
        assert np.abs(one.frame().shown - before).max() < 0.1 * np.abs(before).max()
    both = one.step([[a, b]] * 792)
    left = one.step([[None, b]] * 500)
    fe = pp.finite_elements(TISSUE)
    expected = fe.push([TOP, SIDE], [(0, 0, -3.0), (0, 0, -2.0)], [RADIUS] * 2).force
    np.testing.assert_allclose(both[-1, :2], expected, atol=2e-3 * np.abs(expected).max())
    np.testing.assert_allclose(left[-1, 1], fe.push(SIDE, (0, 0, -2.0), RADIUS).force, atol=2e-3)
    force = np.concatenate([alone[300:, 0], both[:, 0]])
    assert np.linalg.norm(np.diff(force, axis=0), axis=1).max() < 0.02 * np.linalg.norm(expected[0])
    second = np.concatenate([both[300:, 1], left[:, 1]])
    released = np.linalg.norm(np.diff(second, axis=0), axis=1)
    assert np.delete(released, np.argmax(released)).max() < 0.02 * np.linalg.norm(expected[1])


def test_tools_in_one_place_cannot_both_hold():
    one, before = session(), hold(TOP, (0, 0, -2.0))
    alone = one.step([[before]] * 400)[-1, 0]
    after = one.step([[before, hold(TOP, (0, 0, -1.0))]] * 200)
    assert one.frame().contact[:2] == [1, 2]
    np.testing.assert_allclose(after[-1, 0], alone, atol=0.02 * np.abs(alone).max())


def test_let_go_it_is_at_rest():
    one = session()
    one.step([hold(TOP, (0, 0, -4.0))] * 100 + [None] * 3)
    assert not one.displacement.any()


def test_a_session_by_the_clock_replays_to_the_bit():
    """Solutions come when the thread has them; the record says at which ticks. One contact is refused on the way."""
    first = [hold((10.0 + 0.05 * min(i, 400), 25.0, 50.0), (0, 0, -min(i, 200) / 50)) for i in range(500)]
    second = [hold(SIDE, (0, 0, -1.0)) if 150 < i < 300 else pp.Command() for i in range(500)]
    third = [first[i] if 350 < i < 420 else pp.Command() for i in range(500)]
    commands = [command for tick in zip(first, second, third, strict=True) for command in tick]
    device = ScriptedDevice([i // 3 for i in range(1500)], commands, [0, 1, 2] * 500)
    one = session()
    with one:
        one.start(device)
        until(lambda: one.frame().tick > 550)
    record = one.record()
    assert (record.lacking & 8).any()  # a solution was taken
    assert session().replay(record) is None


def test_a_large_mesh_has_it_by_default_and_a_push_does_not_care():
    assert MODEL.settings["interval"] == 8
    assert pp.model(TISSUE, "multigrid").settings["interval"] == 0
    answers = [
        model.push(TOP, (0, 0, -1.0), RADIUS, tolerance=1e-6) for model in (MODEL, pp.model(TISSUE, "multigrid"))
    ]
    assert (answers[0].force == answers[1].force).all()
    with pytest.raises(pp.errors.DataError, match="interval"):
        pp.model(TISSUE, "multigrid", interval=-1)
