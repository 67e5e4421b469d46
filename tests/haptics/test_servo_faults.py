"""A device's own loop: every fault takes the force away in time, and what passes brings it back."""

import itertools

import numpy as np
import pytest
from support.fake_devices.servo_rig import MS, ORIGIN, Rig, settled

from palpate import _core


def touching_rig(**changes):
    rig = Rig(settled(**changes))
    assert rig.rest((0, 0, -2.0), 50)[2] > 0.4
    return rig


@pytest.mark.parametrize("period", [0.25, 0.5, 1.0, 2.0])
def test_solver_that_stalls_takes_the_force_away_within_ten_milliseconds(period):
    rig = touching_rig(period=period * 1e-3)
    for _ in range(60):
        rig.tick((0, 0, -2.0), ms=period)
    began, rig.wall.mode = rig.now, 1
    while rig.tick((0, 0, -2.0), ms=period).any():
        assert rig.now - began <= 10 * MS
    assert rig.now - began <= 10 * MS
    assert rig.now - began > 4 * MS  # nor at the first answer missed
    assert rig.servo.status().fault == "stalled"
    assert rig.servo.pose().present  # the device is well
    rig.wall.mode = 0
    rig.tick((0, 0, -2.0), ms=period)
    assert rig.rest((0, 0, -2.0), 50)[2] > 0.4


def test_a_late_tick_leaves_the_word_to_the_solver_that_does_not_answer():
    rig = touching_rig()  # settles in 20 ms
    rig.wall.mode = 1
    assert not rig.tick((0, 0, -2.0), ms=15).any()
    assert rig.servo.status().fault == "late"
    assert not rig.rest((0, 0, -2.0), 15).any()
    assert rig.servo.status().fault == "late"
    assert not rig.rest((0, 0, -2.0), 15).any()
    assert rig.servo.status().fault == "stalled"
    rig.wall.mode = 0
    assert rig.rest((0, 0, -2.0), 50)[2] > 0.4


@pytest.mark.parametrize("ticks_between", [1, 2])
def test_answer_that_is_no_number_takes_the_force_away_at_once(ticks_between):
    rig = touching_rig()
    rig.wall.mode = 2
    for _ in range(ticks_between):
        rig.tick((0, 0, -2.0))
    assert not rig.tick((0, 0, -2.0)).any()
    assert rig.servo.status().last == "answer"
    rig.wall.mode = 0
    assert not rig.rest((0, 0, -2.0), 10).any()  # it must settle first
    assert rig.rest((0, 0, -2.0), 60)[2] > 0.4


def test_stiffness_that_no_tissue_has_is_refused():
    rig = touching_rig()
    rig.servo.answer(True, ORIGIN, (0, 0, 1), [-9, 0, 0, 0, -9, 0, 0, 0, -9], ORIGIN, 10_000)
    assert not rig.tick((0, 0, -2.0)).any()
    assert rig.servo.status().fault == "answer"


@pytest.mark.parametrize(
    ("position", "fault"),
    [
        ((np.nan, 0, 0), "position"),
        ((0, np.inf, 0), "position"),
        ((0, 0, -101.0), "position"),
        ((0, 0, 1e300), "position"),
        ((0, 60.0, -2.0), "jump"),
    ],
)
def test_absurd_position_takes_the_force_away_at_once(position, fault):
    rig = touching_rig(lowest=(-100,) * 3, highest=(100,) * 3)
    assert not rig.tick(position).any()
    status, pose = rig.servo.status(), rig.servo.pose()
    assert (status.fault, status.zeroed, pose.present) == (fault, True, False)
    assert np.isfinite(pose.position).all()
    assert not rig.rest((0, 0, -2.0), 10).any()
    assert rig.rest((0, 0, -2.0), 60)[2] > 0.4  # and it comes back
    assert rig.servo.pose().present


def test_fast_hand_is_no_jump():
    rig = Rig(settled())
    for i in range(60):
        rig.tick((0, 4.0 * i, 1.0))  # 4 m/s
    assert rig.servo.status().faults == rig.servo.status().late == 0


def test_callback_that_stays_away_finds_no_force_when_it_comes():
    rig = touching_rig()
    before = rig.servo.status().late
    assert rig.tick((0, 0, -2.0), ms=2.0).any()  # late, but the answers are young
    assert rig.servo.status().late == before + 1
    assert not rig.tick((0, 0, -2.0), ms=9.0).any()
    status = rig.servo.status()
    assert (status.fault, status.late) == ("late", before + 2)
    assert status.worst == pytest.approx(9e-3)
    assert rig.rest((0, 0, -2.0), 60)[2] > 0.4


def test_bouncing_button_counts_once():
    rig = Rig(settled(debounce=0.02))
    rig.rest((0, 0, 1), 5)
    raw = [1, 0, 1, 1, 0, 1, 0, 0] * 2 + [1] * 100 + [0, 1, 0, 1] * 3 + [0] * 100
    seen = []
    for bits in raw:
        rig.tick((0, 0, 1), buttons=bits | 4)
        seen.append(rig.servo.pose().buttons)
    first = [bits & 1 for bits in seen]
    assert sum(a != b for a, b in itertools.pairwise(first)) == 2
    assert first.index(1) == 16 + 20  # 20 ms after the last bounce
    assert first[-1] == 0
    assert seen[19] & 4 == 0
    assert seen[20] & 4  # another button's bounces do not matter


def test_lost_device_gets_no_force_until_it_is_started_again():
    rig = touching_rig()
    rig.servo.lose()
    status = rig.servo.status()
    assert (status.fault, status.zeroed, rig.servo.pose().present) == ("lost", True, False)
    assert "plug" in status.text
    assert not rig.rest((0, 0, -2.0), 300).any()
    assert not rig.servo.pose().present
    rig.servo.restart()
    assert rig.rest((0, 0, -2.0), 60)[2] > 0.4


def test_before_the_first_answer_there_is_no_force():
    servo = _core.haptics.Servo(settled())
    assert not np.any([servo.tick((0, 0, -2), 0, (1 + i) * MS) for i in range(50)])
    assert servo.status().fault == "waiting"
    assert servo.status().faults == 0
