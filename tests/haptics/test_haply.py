"""Haply's devices against a stand-in of their service, from start to fault; and the reading of its JSON."""

import contextlib
import itertools
import json
import socket
import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.fake_devices.bench import UP, WALL, until
from support.fake_devices.fake_inverse_service import InverseService

from palpate import _core
from palpate.errors import DataError, DeviceError
from palpate.haptics.haply import Haply


@pytest.fixture
def service():
    service = InverseService()
    yield service
    service.close()


@pytest.fixture
def start(service):
    """Starts the device over a wall of 0.3 N/mm, and leaves it without force whatever happened."""
    with contextlib.ExitStack() as after:

        def started(solve=True):
            device = Haply(f"127.0.0.1:{service.port}")
            wall = _core.haptics.VirtualWall(device.servo, 0.3, WALL, UP)
            after.callback(wall.stop)
            after.callback(device.stop)
            if solve:
                wall.start(1000)
            device.start()
            return device, wall

        yield started
    until(lambda: service.closed)
    assert not service.pushes or service.pushes[-1] == 0  # the last message takes the force away


def touch(service, start):
    device, wall = start()
    service.target = [0.0, 0.0, -0.004]
    until(lambda: felt_again(service, device))
    return device, wall


def felt_again(service, device):
    return device.status().fault == "none" and service.pushes[-1] > 0.1


def test_hand_feels_the_wall_and_nothing_is_left_after(service, start):
    device, _ = touch(service, start)
    K = device.driver.limits().stiffness
    felt = [0, 0, 4.0 * K * 0.3 / (K + 0.3)]
    until(lambda: np.isclose(service.forces[-50:], felt, atol=1e-3).all(axis=1).any())
    assert device.status().position == pytest.approx([0, 0, -4.0], abs=1e-6)
    assert (device.found.model, device.found.serial, device.found.version) == ("inverse3", "049D", "7.4")
    assert service.sessions == ["palpate"]
    device.stop()
    until(lambda: service.closed)
    assert service.pushes[-1] == 0
    assert device.status().fault == "off"


def test_missing_service_says_what_to_install():
    with pytest.raises(DeviceError, match="Haply Hub") as caught:
        Haply("127.0.0.1:1")
    assert caught.value.fault == "service-missing"


def test_service_of_another_kind():
    with socket.create_server(("127.0.0.1", 0)) as server:

        def greet():
            line, _ = server.accept()
            with line:
                line.recv(1000)
                line.sendall(b"HTTP/1.1 404 Not Found\r\n\r\n")

        thread = threading.Thread(target=greet)
        thread.start()
        with pytest.raises(DeviceError, match="is no WebSocket server") as caught:
            Haply(f"127.0.0.1:{server.getsockname()[1]}")
        thread.join()
    assert caught.value.fault == "service-missing"


@pytest.mark.parametrize(
    ("fault", "name", "words"),
    [
        ("old", "wrong-version", "JSON 3.1"),
        ("unplugged", "no-device", "connect"),
        ("silent", "wrong-version", "update"),
    ],
)
def test_service_without_a_device_we_know(service, fault, name, words):
    service.fail(fault)
    with pytest.raises(DeviceError, match=words) as caught:
        Haply(f"127.0.0.1:{service.port}")
    assert caught.value.fault == name


@pytest.mark.parametrize("fault", ["unplugged", "hang up", "garbage", "endless"])
def test_device_or_service_gone_in_contact(service, start, fault):
    device, _ = touch(service, start)
    service.fail(fault)
    until(lambda: device.status().fault == "lost")
    assert device.status().zeroed
    device.stop()
    until(lambda: service.closed)
    since = service.pushes_since_fault()
    assert sum(push > 0 for push in since) <= 2
    if fault != "hang up":  # then it hears nothing more
        assert since[-1] == 0


@pytest.mark.parametrize("fault", ["absurd", "no number"])
def test_positions_that_cannot_be(service, start, fault):
    device, _ = touch(service, start)
    service.fail(fault)
    until(lambda: device.status().fault == "position")
    until(lambda: service.pushes[-1] == 0)
    assert sum(push > 0 for push in service.pushes_since_fault()) <= 2
    service.fault = None
    until(lambda: felt_again(service, device))


def test_service_that_falls_silent(service, start):
    device, _ = touch(service, start)
    service.fail("stall")
    until(lambda: len(service.pushes_since_fault()) >= 3)
    assert sum(push > 0 for push in service.pushes_since_fault()) <= 2  # those under way: the next took it back
    service.fault = None
    until(lambda: felt_again(service, device))
    service.fail("stall")
    until(lambda: device.status().fault == "lost")  # for good


def test_messages_in_pieces_are_whole(service, start):
    device, _ = touch(service, start)
    service.fail("in pieces")
    heard = device.status().ticks
    until(lambda: device.status().ticks > heard + 50)
    assert device.status().fault in ("none", "late", "stalled")  # on a busy machine


def test_solver_that_stalls(service, start):
    device, wall = touch(service, start)
    wall.mode = 1
    until(lambda: device.status().fault == "stalled" and service.pushes[-1] == 0)
    wall.mode = 0
    until(lambda: felt_again(service, device))


def test_buttons_that_bounce(service, start):
    device, _ = start(solve=False)
    until(lambda: device.servo.pose().present)
    service.bounces, seen, changed = 7, [0], np.inf
    while len(service.pushes) < changed + 40:
        if (bit := device.servo.pose().buttons & 1) != seen[-1]:
            seen.append(bit)
            changed = len(service.pushes)
    assert seen == [0, 1]


@pytest.mark.parametrize("address", ["nonsense", "host:port", "localhost:99999", ":10001"])
def test_address_that_cannot_be(address):
    with pytest.raises(DataError):
        Haply(address)


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=8,
)


def paths(value):
    """Every path into `value`, as json_at takes it, and what is there. Keys that JSON escapes are left out."""
    yield [], value
    if isinstance(value, dict):
        inside = [(key, v) for key, v in value.items() if key and key[0] != "#" and json.dumps(key) == f'"{key}"']
    elif isinstance(value, list):
        inside = [(f"#{i}", v) for i, v in enumerate(value)]
    else:
        inside = []
    for step, v in inside:
        for path, end in paths(v):
            yield [step, *path], end


@given(value=VALUES, indent=st.sampled_from([None, 1]))
@settings(max_examples=25)
def test_json_reads_as_pythons_own(value, indent):
    text = json.dumps(value, indent=indent)
    for path, end in itertools.islice(paths(value), 30):
        exists, number, string = _core.haptics.json_at(text, path)
        assert exists
        if isinstance(end, (int, float)) and not isinstance(end, bool):
            assert number == pytest.approx(end, rel=1e-12, abs=1e-300)
        else:
            assert np.isnan(number)
        if isinstance(end, str):
            assert f'"{string}"' == json.dumps(end)


@given(value=VALUES, cut=st.integers(0, 200), noise=st.text(max_size=4))
@settings(max_examples=25)
def test_json_survives_what_is_none(value, cut, noise):
    text = json.dumps({"inverse3": [value], "x": value})
    damaged = text[:cut] + noise + text[cut + 1 :]
    for path in (["inverse3", "#0", "state"], ["x"], ["#3"], ["inverse3", "#0", "#1"]):
        _core.haptics.json_at(damaged, path)
    assert _core.haptics.json_at(text[:-1], ["x"]) == (False, pytest.approx(np.nan, nan_ok=True), "")
    assert not _core.haptics.json_at("[" * 100_000, ["x"])[0]
