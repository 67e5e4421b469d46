"""Devices of makers whose libraries are found at run time, against stand-ins, from start to fault."""

import ctypes
import itertools
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from support.example_organs import organ
from support.fake_devices.bench import MAKERS, Bench, built, library_with, until

import palpate as pp
from palpate.errors import DataError, DeviceError
from palpate.haptics.discovery import look_for_devices


@pytest.fixture(scope="module")
def libraries(tmp_path_factory):
    folder = tmp_path_factory.mktemp("libraries")
    return {name: built(folder, name) for name in MAKERS}


@pytest.fixture(params=sorted(MAKERS))
def bench(request, libraries):
    bench = Bench(request.param, libraries[request.param])
    yield bench
    bench.stop()
    assert bench.get("misuse") == 0  # no call that the real library forbids
    assert bench.get("force") == 0  # whatever happened, no force is left behind


def test_hand_feels_the_wall_and_nothing_is_left_after(bench):
    bench.touch()
    K = bench.device.driver.limits().stiffness
    felt = np.array([0, 0, 4.0 * K * 0.3 / (K + 0.3)])
    until(lambda: np.allclose(bench.device.status().force, felt, atol=1e-3))  # up in the world
    own = bench.device.axes.T @ felt  # and in the device's own axes
    until(lambda: np.allclose([bench.get(axis) for axis in ("fx", "fy", "fz")], own, atol=1e-3))
    assert bench.device.status().position == pytest.approx([0, 0, -4.0], abs=1e-6)
    assert bench.device.found.model in ("Stand-in Touch", "omega.3")
    assert bench.get("enabled")
    bench.device.stop()
    assert (bench.get("force"), bench.get("closed")) == (0, 1)
    assert bench.device.status().fault == "off"
    bench.device.stop()  # twice is once
    assert bench.get("closed") == 1


PROGRAM = """
import atexit, sys
sys.path.insert(0, {tests!r})
from support.fake_devices.bench import Bench
bench = Bench("libHD", {library!r})
atexit.register(lambda: print("at the end", bench.get("closed"), bench.get("force")))  # after what is registered later
bench.touch()
print("touched", bench.get("force") > 0)
if {raises}:
    raise ValueError("a bug")
"""


@pytest.mark.parametrize("raises", [False, True])
def test_program_that_ends_leaves_no_force(libraries, raises):
    text = PROGRAM.format(tests=str(Path(__file__).parents[1]), library=str(libraries["libHD"]), raises=raises)
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True)
    assert done.stdout.splitlines() == ["touched True", "at the end 1.0 0.0"]
    assert ("a bug" in done.stderr) == raises


@pytest.mark.parametrize("name", sorted(MAKERS))
def test_missing_library_says_what_to_install(name, tmp_path):
    with pytest.raises(DeviceError, match="install") as caught:
        MAKERS[name](str(tmp_path / "nowhere.so"))
    assert caught.value.fault == "library-missing"
    assert "nowhere.so" in str(caught.value)


@pytest.mark.parametrize(("name", "first"), [("libHD", "hdInitDevice"), ("libdhd", "dhdOpen")])
def test_library_of_another_version_says_what_it_lacks(name, first, tmp_path):
    with pytest.raises(DeviceError, match=f"no function d?hd(?!.*{first})") as caught:
        MAKERS[name](str(library_with(first, tmp_path)))
    assert caught.value.fault == "wrong-version"


def test_device_that_is_not_there(bench):
    bench.set("absent", 1)
    with pytest.raises(DeviceError, match="connect it") as caught:
        bench.make()
    assert caught.value.fault == "no-device"


def test_device_that_refuses_to_start(bench):
    bench.set("refuses", 1)
    with pytest.raises(DeviceError) as caught:
        bench.start()
    assert caught.value.fault == "device-fault"


def test_what_went_wrong_before_the_start_does_not_hinder_it(libraries):
    """OpenHaptics keeps errors on a stack until somebody asks."""
    bench = Bench("libHD", libraries["libHD"])
    try:
        bench.device = bench.make()
        bench.library.hdGetDoublev(ctypes.c_uint(0x9999), (ctypes.c_double * 16)())  # it knows of no such value
        bench.device.start()
        until(lambda: bench.device.status().fault == "waiting")  # for a solver, and for nothing else
    finally:
        bench.stop()


def test_device_unplugged_in_contact(bench):
    bench.touch()
    bench.set("unplugged", 1)
    until(lambda: bench.device.status().fault == "lost")
    assert bench.device.status().zeroed
    bench.device.stop()
    assert bench.ticks_since_fault() <= 2


def test_device_lost_as_the_force_is_given(libraries):
    bench = Bench("libHD", libraries["libHD"])
    try:
        bench.touch()
        bench.set("snaps", 1)  # said once, at the end of a frame whose force has been given
        until(lambda: bench.device.status().fault == "lost")
        assert bench.ticks_since_fault() <= 1
        assert bench.get("force") == 0
    finally:
        bench.stop()


def test_callback_that_comes_late(bench):
    bench.touch()
    before = bench.device.status()
    bench.set("late", 30)
    until(lambda: bench.device.status().worst > 0.03)
    assert bench.ticks_since_fault() == 0  # it finds no force when it comes
    assert bench.device.status().late > before.late
    until(bench.felt_again)


def test_buttons_that_bounce(bench):
    bench.start(solve=False)
    until(lambda: bench.device.servo.pose().present)
    bench.set("bounces", 7)  # on, off, on, off, ... on
    seen, changed, end = [0], np.inf, time.monotonic() + 20
    while bench.get("ticks") < changed + 40 and time.monotonic() < end:
        if (bit := bench.device.servo.pose().buttons & 1) != seen[-1]:
            seen.append(bit)
            changed = bench.get("ticks")
    assert seen == [0, 1]


def test_positions_that_cannot_be(bench):
    bench.touch()
    bench.set("absurd", 1)
    until(lambda: bench.device.status().fault == "position")
    assert bench.ticks_since_fault() <= 1
    assert np.isfinite(bench.device.status().position).all()
    bench.set("absurd", 0)
    until(bench.felt_again)


def test_solver_that_stalls(bench):
    bench.touch()
    bench.wall.mode = 1
    until(lambda: bench.device.status().fault == "stalled")
    assert bench.ticks_since_answer() <= 9
    bench.wall.mode = 0
    until(bench.felt_again)


def test_solver_that_answers_no_number(bench):
    bench.touch()
    bench.wall.mode = 2
    until(lambda: bench.device.status().fault == "answer")
    assert bench.device.status().zeroed
    bench.wall.mode = 0
    until(bench.felt_again)


def test_servo_overrun(libraries):
    bench = Bench("libHD", libraries["libHD"])
    try:
        bench.touch()
        bench.set("overrun", 1)
        until(lambda: bench.device.status().fault == "overrun")
        assert bench.ticks_since_fault() <= 2
        bench.set("overrun", 0)
        until(bench.felt_again)
        bench.set("warm", 1)
        until(lambda: bench.device.status().fault == "force")
        assert bench.get("force") == 0
    finally:
        bench.stop()


def test_device_that_reports_a_fault(libraries):
    bench = Bench("libdhd", libraries["libdhd"])
    try:
        bench.touch()
        bench.set("warm", 1)  # a motor at its limit is no fault
        time.sleep(0.01)
        assert bench.device.status().fault in ("none", "late", "stalled")
        bench.set("overrun", 1)
        until(lambda: bench.device.status().fault == "device")
        bench.device.stop()
        assert bench.ticks_since_fault() <= 2
    finally:
        bench.stop()


@pytest.mark.parametrize(
    "settings",
    [
        {"force": 1000},
        {"force": -1},
        {"stiffness": 0},
        {"scale": 0},
        {"rotation": -np.eye(3)},
        {"rotation": np.ones((3, 3))},
        {"offset": (np.nan, 0, 0)},
    ],
)
def test_settings_that_cannot_be_leave_the_device_closed(bench, settings):
    with pytest.raises(DataError):
        bench.make(**settings)
    assert bench.get("closed") == 1


def test_turned_and_scaled_workspace(bench):
    turn = np.array([[0, -1.0, 0], [1.0, 0, 0], [0, 0, 1.0]])
    bench.start(rotation=turn, scale=2.0, offset=(100, 200, 300))
    bench.set(" ", 0)
    at = np.zeros(3)
    at[2] = 5.0  # where the stand-in's hand starts, in the device's own axes
    wanted = np.array([100, 200, 300]) + 2 * turn @ bench.device.axes @ at
    until(lambda: np.allclose(bench.device.status().position, wanted))


def test_doctor_finds_what_answers(libraries, monkeypatch, capsys):
    for library, variable in (("libHD", "PALPATE_LIBHD"), ("libdhd", "PALPATE_LIBDHD")):
        monkeypatch.setenv(variable, str(libraries[library]))
        Bench(library, libraries[library])
    monkeypatch.setenv("PALPATE_HAPLY", "localhost:1")
    found = pp.find_devices()
    assert [(f.driver, f.serial) for f in found] == [("OpenHaptics", "SN-0001"), ("Force Dimension", "4711")]
    sightings = {s.driver: s for s in look_for_devices()}
    assert sightings["Haply"].fault == "service-missing"

    from palpate.commands import doctor

    doctor._devices()
    said = capsys.readouterr().out
    for words in ("Stand-in Touch", "omega.3", "Haply Hub", "version 3.17.1"):
        assert words in said


def test_doctor_says_what_to_install(monkeypatch, capsys, tmp_path):
    for variable in ("PALPATE_LIBHD", "PALPATE_LIBDHD"):
        monkeypatch.setenv(variable, str(tmp_path / "none.so"))
    monkeypatch.setenv("PALPATE_HAPLY", "nonsense")
    assert pp.find_devices() == []

    from palpate.commands import doctor

    doctor._devices()
    said = capsys.readouterr().out
    assert said.count("library-missing") == 2
    assert "expected host:port" in said


def test_faults_have_names_of_their_own():
    from palpate import _core

    names = [_core.haptics.fault_name(i) for i in range(_core.haptics.FAULTS)]
    assert len(set(names)) == len(names)
    texts = [_core.haptics.fault_text(i) for i in range(_core.haptics.FAULTS)]
    assert all(a != b for a, b in itertools.combinations(texts, 2))


def test_a_session_is_felt_by_the_device_and_faults_leave_no_force(bench):
    """The whole way: the library's position, the loop's tool in space, the tissue, the library's force."""
    tissue = organ(9)
    top = np.array(tissue.surface.closest(np.array([0.0, 0.0, 25.0])).point)
    model = pp.model(tissue, "compliance")
    bench.device = bench.make(offset=tuple(top))
    bench.lower(5.0)
    with pp.Session(model, radius=9.0) as session:
        session.start(bench.device)
        bench.device.start()
        until(lambda: session.frame().contact[0] == 3)  # in space
        for height in np.linspace(5.0, -4.0, 60):
            bench.lower(float(height))
            time.sleep(0.005)
        until(lambda: bench.device.status().force[2] > 0.1)
        until(lambda: session.frame().contact[0] == 1)

        def settled():
            frame = session.frame()
            expected = model.push(frame.point[0], frame.displacement[0], 9.0).force
            return np.linalg.norm(np.subtract(frame.force[0], expected)) < 0.02 * np.linalg.norm(expected)

        until(settled)
        K, hand = bench.device.driver.limits().stiffness, np.array(bench.device.status().position)
        coupling = K * (np.array(session.frame().tip[0]) - hand)  # what holds the tool on the surface pulls the hand
        until(lambda: np.allclose(bench.device.status().force, coupling, atol=0.05 * np.linalg.norm(coupling)))
        session.stop()  # the solver stalls
        until(lambda: bench.get("force") == 0)
        assert bench.device.status().zeroed
