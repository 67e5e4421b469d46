"""A device's own loop: what the hand feels, and that it is given no energy."""

import copy
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation
from support.fake_devices.servo_rig import NONE, ORIGIN, UP, Rig, settled

from palpate import _core


@pytest.mark.parametrize(
    ("tissue", "told"), [(0.05, 1.0), (0.5, 1.0), (5.0, 1.0), (500.0, 1.0), (0.05, 0.0), (0.5, 0.0)]
)
def test_hand_feels_tissue_and_coupling_in_series(tissue, told):
    rig = Rig(settled(), tissue, reported=told)
    force = rig.rest((1, 2, -2.0), 400)
    assert force == pytest.approx([0, 0, 2.0 * 0.5 * tissue / (0.5 + tissue)], rel=1e-3, abs=1e-9)
    assert np.linalg.norm(force) < 0.5 * 2.0  # never stiffer than the device bears


def test_tool_stays_behind_at_the_depth_that_its_force_says():
    rig = Rig(settled(), 0.7)
    force = rig.rest((0, 0, -3.0), 400)
    pose = rig.servo.pose()
    assert pose.hand == pytest.approx([0, 0, -3.0])
    assert force[2] == pytest.approx(-0.7 * pose.position[2], rel=1e-6)


def test_nothing_is_felt_in_free_space():
    rig = Rig(settled())
    forces = [rig.tick((0, 0, 5 + 3 * np.sin(0.1 * i))) for i in range(500)]
    assert not np.any(forces)
    assert rig.servo.status().fault == "none"


def test_force_keeps_its_direction_and_its_limit():
    rig = Rig(settled(force=1.5))
    rig.rest((0, 0, 1), 5)
    s = np.sqrt(0.5)
    for i in range(200):
        rig.servo.answer(True, ORIGIN, (5.0 * s, 0, 5.0 * s), NONE, ORIGIN, 10_000 + i)
        force = rig.tick((0, 0, 0), solve=False)
    assert np.linalg.norm(force) == pytest.approx(1.5)
    assert force / 1.5 == pytest.approx([s, 0, s], abs=1e-6)


def test_force_rises_from_nothing_over_the_ramp():
    rig = Rig(settled(ramp=0.2))
    forces = np.array([rig.tick((0, 0, -2.0)) for _ in range(400)])[:, 2]
    final = forces[-1]
    assert final == pytest.approx(0.5, rel=1e-3)
    assert forces[0] == 0
    assert np.diff(forces).max() < 1.5 * final / 200
    assert forces[100] == pytest.approx(final / 2, rel=0.05)


def test_new_answers_make_no_steps():
    rig = Rig(settled())
    rig.rest((0, 0, 1), 5)
    forces = []
    for i in range(200):  # a solver that changes its mind every 6 ms
        if i % 6 == 0:
            push = 2.0 * (i // 6 % 2)
            serial = 10_000 + i
        rig.servo.answer(True, ORIGIN, (0, 0, push), NONE, ORIGIN, serial)
        forces.append(rig.tick((0, 0, 0), solve=False)[2])
    assert max(forces) > 1.99
    assert min(forces[50:]) < 0.01
    assert np.abs(np.diff(forces)).max() <= 2.0 / 3 + 1e-9  # the blend lasts 3 ms


def test_tissue_that_is_only_touched_does_not_pull_but_one_that_is_held_does():
    K = [0, 0, 0, 0, 0, 0, 0, 0, 0.3]
    pulls = []
    for normal in (UP, ORIGIN):
        rig = Rig(settled())
        rig.rest((0, 0, 1), 5)
        for i in range(100):  # the solver still speaks of a contact at z = 0, the hand is gone to z = 1
            rig.servo.answer(True, ORIGIN, ORIGIN, K, normal, 10_000 + i)
            force = rig.tick((0, 0, 1.0), solve=False)
        pulls.append(force[2])
    assert pulls[0] == 0
    assert pulls[1] == pytest.approx(-0.3 * 0.5 / 0.8, rel=1e-3)


def test_force_that_is_withdrawn_goes_in_its_time_and_never_grows():
    K = [0, 0, 0, 0, 0, 0, 0, 0, 0.3]
    rig = Rig(settled(withdrawal=5e-3, ramp=0.1))
    rig.rest((0, 0, 1), 5)
    forces = []
    for i in range(400):  # the hand presses on; from 200 to 240 the solver withdraws the force
        rig.servo.answer(True, ORIGIN, ORIGIN, K, UP, 10_000 + i, 200 <= i < 240)
        forces.append(rig.tick((0, 0, -0.01 * i), solve=False)[2])
    before, gone, back = forces[199], np.array(forces[200:206]), np.array(forces[240:])
    assert before == pytest.approx(2.0 * 0.3 * 0.5 / 0.8, rel=0.05)
    assert np.all(np.diff([before, *gone]) <= 0)
    assert gone[1] > 0.5 * before  # a ramp, not a step
    assert not any(forces[206:240])
    assert back.max() > before
    assert np.diff(back).max() < 0.05 * back.max()  # it returns by the ramp


def random_path(seed, ticks=3000):
    """mm; a hand that dips in and out of the wall, some 10 Hz, up to 0.3 m/s."""
    noise = np.random.default_rng(seed).standard_normal((ticks, 3))
    path = gaussian_filter1d(noise, 15, axis=0)
    return path * 2.5 / path.std(axis=0) - [0, 0, 0.5]


def given_out(path, rig):
    """mJ, the running sum of what the held force does on the hand."""
    given_out, total, force, most = [], 0.0, np.zeros(3), 0.0
    for before, x in itertools.pairwise(path):
        total += force @ (x - before)
        most = max(most, np.linalg.norm(force) * np.linalg.norm(x - before))
        force = rig.tick(x)
        given_out.append(total)
    return np.array(given_out), most


@given(seed=st.integers(0, 2**32 - 1), lag=st.integers(0, 12), stiffness=st.floats(0.1, 3.0))
@settings(max_examples=12)
def test_hand_is_given_no_net_energy_whatever_it_does(seed, lag, stiffness):
    rig = Rig(settled(), stiffness, reported=0.0, delay=lag)
    debt = 1.0
    energy, most = given_out(random_path(seed), rig)
    assert most > 0  # the wall was met
    # Within a contact: two debts and a tick's work. Over all of them: what is forgiven between (a debt in half a second).
    forgiven = 2 * debt * len(energy) * 1e-3 / 0.5
    assert energy.max() < 2 * debt + most + forgiven
    status = rig.servo.status()
    assert status.energy >= -(2 * debt + most)


def test_without_the_controller_a_lagging_wall_gives_energy_out():
    energy, _ = given_out(random_path(1), Rig(settled(energy_limit=1e9, max_damping=1e-12), 3.0, reported=0.0, delay=8))
    kept, most = given_out(random_path(1), Rig(settled(energy_limit=1.0), 3.0, reported=0.0, delay=8))
    assert kept.max() < 2 + most  # mJ
    assert energy[-1] > 10 * (2 + most)


def bounce(servo_settings):
    """mm/s, the speeds of a 50 g handle that fell onto a lagging wall and is held by nobody but a light spring."""
    rig = Rig(servo_settings, 1.0, reported=0.0, delay=6)
    x, v, speeds = 0.5, -20.0, []
    for _ in range(3000):
        force = rig.tick((0, 0, x))[2] - 0.05 * (x + 2)  # N; the hand rests 2 mm inside
        v += force / 0.05  # N / kg over 1 ms, in mm/s
        x += v * 1e-3
        speeds.append(abs(v))
    return np.array(speeds)


def test_passivity_controller_calms_a_wall_that_buzzes():
    loose = bounce(settled(energy_limit=1e9, max_damping=1e-12, damping=1e-5))
    calm = bounce(settled(damping=1e-5))
    assert loose[-500:].max() > 60  # it buzzes faster than it fell
    assert calm[-500:].max() < 0.25 * loose[-500:].max()
    assert calm[-500:].max() < 20


@given(angles=st.tuples(*[st.floats(-3, 3)] * 3), scale=st.floats(0.3, 3))
@settings(max_examples=15)
def test_turned_device_feels_the_same_force_turned_back(angles, scale):
    R = Rotation.from_euler("xyz", angles).as_matrix()
    offset = np.array([10.0, -20.0, 30.0])
    frame = {"rotation": R.ravel().tolist(), "offset": offset.tolist(), "scale": scale}
    turned = Rig(settled(max_damping=1e-12, **frame))  # damping would add a little along the way
    rng = np.random.default_rng(3)
    path = gaussian_filter1d(rng.standard_normal((80, 3)), 10, axis=0) * 5 - [0, 0, 1.5]
    for x in path:
        device = R.T @ (x - offset) / scale
        force = turned.tick(device.tolist())
        status = turned.servo.status()
        assert turned.servo.pose().hand == pytest.approx(x, abs=1e-9)
        assert R @ force == pytest.approx(status.force, abs=1e-12)
        assert status.force[:2] == pytest.approx([0, 0], abs=1e-9)  # the wall pushes up alone
    assert force.any()


def test_scaled_device_is_no_stiffer_than_it_bears():
    for scale in (0.2, 1.0, 5.0):
        rig = Rig(settled(scale=scale, force=100), 1e4)
        a, b = rig.rest((0, 0, -1.0), 300)[2], rig.rest((0, 0, -2.0), 300)[2]
        assert b - a == pytest.approx(0.5, rel=1e-2)  # N a device mm


@pytest.mark.parametrize(
    "changes",
    [
        {"force": 0},
        {"stiffness": -1},
        {"damping": np.nan},
        {"scale": np.inf},
        {"period": 0.1},
        {"rotation": [1, 0, 0, 0, 1, 0, 0, 0, 2]},
        {"offset": (np.nan, 0, 0)},
        {"lowest": (0, 0, 5), "highest": (1, 1, 1)},
    ],
)
def test_settings_that_cannot_be_are_refused(changes):
    with pytest.raises(ValueError):
        _core.haptics.Servo(settled(**changes))


def test_settings_are_copied():
    s = settled()
    t = copy.copy(s)
    t.force = 9.0
    assert s.force == 3.0
