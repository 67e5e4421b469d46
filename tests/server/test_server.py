"""The server: who is let in, what is refused, what goes over the wire."""

import contextlib
import importlib.util
import json
import signal
import socket
import struct
import subprocess
import sys
from pathlib import Path

import httpx
import numpy as np
import pytest
from fuzz import server_messages
from support.example_organs import organ
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

import palpate as pp
from palpate.server import messages
from palpate.server.frame_message import PLACES, frame_bytes
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import serving
from palpate.server.touch_routes import MOST_PAGES

ROOT = Path(__file__).parents[2]
TOP = (0.0, 0.0, 25.0)
PRESS = messages.ToolCommand(0, 1, 1, TOP, (0.0, 0.0, -3.0))
RELEASE = messages.ToolCommand(0, 0, 2, (0.0,) * 3, (0.0,) * 3)


@pytest.fixture(scope="module")
def served():
    """A running session and its address."""
    session = pp.Session(pp.model(organ(), "blocks"), radius=10.0, sweeps=4)
    with serving(session, loopback_socket(None), title="test organ") as address:
        yield session, address


@pytest.fixture
def address(served):
    return served[1]


def socket_of(address, **changes):
    """The page's socket, opened as a browser would."""
    base, token = address.split("/?")
    token = changes.pop("token", token)
    return connect(f"{base.replace('http', 'ws')}/socket?{token}", origin=changes.pop("origin", base), **changes)


FRAME = 2


def frames(page):
    """The socket's frames, decoded by their documented layout."""
    layout = messages.code(messages.Frame)
    while True:
        data = page.recv(timeout=10)
        if data[0] != FRAME:  # a replay tells where it is, too
            continue
        values = struct.unpack_from(layout, data)
        tick, serial, contact = values[2], values[5], values[9]
        displacement, force = values[25:28], values[37:40]
        step, count = values[-2:]
        assert len(data) == struct.calcsize(layout) + 6 * count
        moved = step * np.frombuffer(data, "<i2", offset=struct.calcsize(layout)).reshape(count, 3)
        yield {
            "contact": contact,
            "tick": tick,
            "serial": serial,
            "force": force,
            "displacement": displacement,
            "u": moved,
        }


def until(page, wanted):
    """The first frame that is as wanted; some ten seconds of frames without one are a failure."""
    for frame, _ in zip(frames(page), range(600), strict=False):
        if wanted(frame):
            return frame
    return pytest.fail(f"never came; the last frame: {frame}")


def test_page_is_served_to_who_has_the_token(address):
    page = httpx.get(address)
    assert page.status_code == 200
    assert 'src="static/main.js"' in page.text
    base = address.split("/?")[0]
    for file in ("main.js", "worker.js", "style.css", "LICENSES.txt"):
        assert httpx.get(f"{base}/static/{file}").status_code == 200
    assert "three.js" in httpx.get(f"{base}/static/LICENSES.txt").text
    assert httpx.get(address.replace("/?", "/static/..%2Fapp.py?")).status_code == 404
    policy = page.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy


@pytest.mark.parametrize("path", ["/", "/scene"])
@pytest.mark.parametrize(
    ("token", "headers", "why"),
    [
        ("token=wrong", {}, "token is wrong; open the address"),
        (None, {"Origin": "http://evil.example"}, "origin 'http://evil.example'"),
        (None, {"Host": "evil.example"}, "host 'evil.example'"),
    ],
)
def test_strangers_are_refused(address, path, token, headers, why):
    base, right = address.split("/?")
    answer = httpx.get(f"{base}{path}?{right if token is None else token}", headers=headers)
    assert answer.status_code == 403
    assert why in answer.text


@pytest.mark.parametrize(
    "changes", [{"token": "token=wrong"}, {"token": "token=%C3%A9"}, {"origin": "http://evil.example"}]
)
def test_strangers_get_no_socket(address, changes):
    with pytest.raises(InvalidStatus) as refusal:
        socket_of(address, **changes)
    assert refusal.value.response.status_code == 403


@pytest.mark.parametrize(
    ("message", "closing"),
    [
        (b"\1" * 2000, 1009),  # too big for any message there is
        (b"", 1008),
        (messages.encode(PRESS)[:-1], 1008),
        (b"\2" + messages.encode(PRESS)[1:], 1008),
        (messages.encode(messages.ToolCommand(0, 1, 1, (float("nan"), 0, 0), (0, 0, 0))), 1008),
        (messages.encode(messages.ToolCommand(0, 1, 1, TOP, (0, float("inf"), 0))), 1008),
        (messages.encode(messages.ToolCommand(0, 1, 1, TOP, (0, 0, 1e6))), 1008),
        ("text", 1008),
    ],
)
def test_malformed_messages_close_the_socket_and_let_go(address, message, closing):
    with socket_of(address) as page:
        page.send(messages.encode(PRESS))
        until(page, lambda frame: frame["contact"] == 1)
        page.send(message)
        with pytest.raises(ConnectionClosed):
            until(page, lambda frame: False)
        assert page.close_code == closing
    with socket_of(address) as page:
        until(page, lambda frame: frame["contact"] == 0)


def test_press_moves_the_surface_and_release_ends_the_force(served):
    session, address = served
    expected = session.model.push(TOP, (0, 0, -3.0), 10.0)
    with socket_of(address) as page:
        page.send(messages.encode(PRESS))
        settled = until(page, lambda f: f["serial"] == 1 and abs(f["force"][2] - expected.force[2]) < 2e-3)
        page.send(messages.encode(RELEASE))
        loose = until(page, lambda f: f["serial"] == 2)
    assert expected.force[2] > 0.1
    np.testing.assert_allclose(settled["u"], expected.displacement[session.shown], atol=0.05)
    assert loose["contact"] == 0
    assert loose["force"] == (0, 0, 0)


def test_random_messages_harm_nothing():
    """More of them: python tests/fuzz/server_messages.py 100000."""
    told, (early, late), wrong = server_messages.run(2000, seed=5)
    assert wrong == []
    assert told["taken"] > 1200
    assert told["refused with 1008"] > 200
    assert told["refused with 1009"] > 5
    # MB. Frames that pile up for the page that reads all along would be more: 20 kB each, in 10 s and longer. The
    # allocator's own arenas have taken 16 on a busy machine.
    assert late < early + 32


def test_no_more_pages_than_the_limit(address):
    with contextlib.ExitStack() as pages:
        held = [pages.enter_context(socket_of(address)) for _ in range(MOST_PAGES)]
        for page in held:
            next(frames(page))  # it is in
        with socket_of(address) as page:
            with pytest.raises(ConnectionClosed):
                next(frames(page))
            assert page.close_code == 1013
            assert f"{MOST_PAGES} pages" in page.close_reason
        held[0].close()
        for _ in range(100):  # the server hears of it a moment later
            with socket_of(address) as page, contextlib.suppress(ConnectionClosed):
                next(frames(page))
                break
        else:
            pytest.fail("a page that has gone still counts")


def test_closing_the_page_lets_go(address):
    with socket_of(address) as page:
        page.send(messages.encode(PRESS))
        until(page, lambda frame: frame["contact"] == 1)
    with socket_of(address) as page:
        assert until(page, lambda frame: frame["contact"] == 0)["force"] == (0, 0, 0)


def test_who_holds_keeps_hold_until_letting_go(address):
    other = messages.ToolCommand(0, 1, 77, (40.0, 0.0, 0.0), (5.0, 0.0, 0.0))
    with socket_of(address) as first, socket_of(address) as second:
        first.send(messages.encode(PRESS))
        for page in (first, second):
            until(page, lambda frame: frame["serial"] == 1 and frame["contact"] == 1)
        second.send(messages.encode(other))
        second.send(messages.encode(RELEASE))  # not theirs to let go
        for frame, _ in zip(frames(second), range(40), strict=False):
            assert (frame["serial"], frame["contact"]) == (1, 1)
        first.send(messages.encode(messages.ToolCommand(0, 1, 3, TOP, (0, 0, -2.0))))
        assert until(second, lambda frame: frame["serial"] == 3)["contact"] == 1
        first.send(messages.encode(messages.ToolCommand(0, 0, 4, TOP, TOP)))
        until(first, lambda frame: frame["contact"] == 0)
        second.send(messages.encode(other))
        until(second, lambda frame: frame["serial"] == 77 and frame["contact"] == 1)


def test_a_page_that_does_not_read_gets_the_newest_frame_next(address):
    with socket_of(address, max_queue=1) as slow, socket_of(address) as quick:
        slow.send(messages.encode(PRESS))
        until(quick, lambda frame: frame["serial"] == 1)
        before = next(frames(slow))["tick"]
        while (now := next(frames(quick))["tick"]) < before + 1500:
            pass
        for _ in range(200):  # what the system's buffers hold, then the newest
            if next(frames(slow))["tick"] >= now:
                break
        else:
            pytest.fail("frames pile up")


def test_scene_holds_surface_and_lump(served):
    session, address = served
    data = httpx.get(address.replace("/?", "/scene?")).content
    size = struct.unpack_from("<I", data)[0]
    scene = json.loads(data[4 : 4 + size])
    nodes = np.frombuffer(data, "<f4", 3 * scene["nodes"], 4 + size).reshape(-1, 3)
    triangles = np.frombuffer(data, "<u4", -1, 4 + size + nodes.nbytes).reshape(-1, 3)
    mesh = session.mesh
    assert scene["title"] == "test organ"
    assert [part["name"] for part in scene["parts"]] == ["organ", "lump"]
    assert len(triangles) == scene["triangles"] == sum(part["count"] for part in scene["parts"])
    np.testing.assert_allclose(nodes, mesh.nodes[session.shown], atol=1e-5)

    def enclosed(part):
        a, b, c = (nodes[triangles[part["first"] : part["first"] + part["count"], k]].astype(float) for k in range(3))
        return float(np.einsum("ij,ij->", np.cross(a, b), c) / 6)

    assert enclosed(scene["parts"][0]) == pytest.approx(mesh.volumes.sum(), rel=1e-4)
    assert enclosed(scene["parts"][1]) == pytest.approx(mesh.volumes[mesh.region == 2].sum(), rel=1e-4)


def test_wire_displacements_are_within_half_a_step():
    class Frame:
        tick, late, faults, serial, seconds, busy, work = 2**40, 3, 0, 9, 1.5, 1e-4, 2.0
        solution_age, solution_error = 0.05, 0.02
        contact, insertion, body = [1, 0, 0, 0], [0.0] * 4, 7
        point = displacement = force = [(1.0, 2.0, 3.0)] * 4
        shown = np.random.default_rng(0).uniform(-9, 9, (50, 3)).astype(np.float32)

    data = frame_bytes(Frame, Frame.shown)
    size = struct.calcsize(messages.code(messages.Frame))
    body, step = (struct.unpack_from(kind, data, PLACES[name][0])[0] for name, kind in (("body", "<I"), ("step", "<f")))
    assert body == 7
    assert size % 4 == 0
    moved = step * np.frombuffer(data, "<i2", offset=size).reshape(-1, 3)
    np.testing.assert_allclose(moved, Frame.shown, atol=0.51 * 9 / 32767)


def test_generated_typescript_is_fresh():
    spec = importlib.util.spec_from_file_location("page_messages", ROOT / "web" / "generate_messages.py")
    generator = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(generator)
    committed = (ROOT / "web" / "src" / "protocol" / "server-messages.ts").read_text()
    assert generator.source() == committed, "stale; run: python web/generate_messages.py"


def test_lock_file_names_no_registry():
    lock = json.loads((ROOT / "web" / "package-lock.json").read_text())
    assert lock["packages"]["node_modules/three"]["integrity"]
    assert not [name for name, package in lock["packages"].items() if "resolved" in package]


def test_port_in_use_is_named_before_any_work():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(pp.errors.PortError) as refusal:
            pp.touch(organ(), port=port, open_browser=False)
    assert f"port {port}" in str(refusal.value)
    assert f"--port {port + 1}" in str(refusal.value)


def test_impossible_port():
    with pytest.raises(pp.errors.PortError, match=r"port 70000.*1 to 65535"):
        pp.touch(organ(), port=70000, open_browser=False)


def test_record_that_cannot_be_written_is_refused_before_any_work(tmp_path):
    with pytest.raises(pp.errors.FileError, match="mkdir"):
        pp.touch(organ(), record=tmp_path / "no" / "session.h5", open_browser=False)


def test_two_sessions_take_two_ports():
    with loopback_socket(None) as first, loopback_socket(None) as second:
        assert first.getsockname()[1] != second.getsockname()[1]


def test_server_listens_on_loopback_only():
    with loopback_socket(None) as listener:
        assert listener.getsockname()[0] == "127.0.0.1"


@contextlib.contextmanager
def command(*arguments):
    """`palpate touch` as a user runs it, and the address that it prints."""
    process = subprocess.Popen(
        [sys.executable, "-m", "palpate", "touch", *map(str, arguments), "--no-browser"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        line = process.stdout.readline()
        assert "http://127.0.0.1:" in line, line + process.stdout.read()
        assert "ssh -N -L" in process.stdout.readline()
        yield process, line.split()[-1]
    finally:
        process.kill()
        process.wait()


@pytest.fixture(scope="module")
def tissue_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("tissue") / "tissue.vtu"
    pp.write_tissue(path, organ())
    return path


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_interrupt_closes_cleanly_and_keeps_the_record(tmp_path, tissue_file, how):
    """Ctrl-C (or the system's wish to end) with a page open and pressing: exit code 0, a whole record that replays."""
    record = tmp_path / "session.h5"
    with command(tissue_file, "--record", record, "--radius", 10) as (process, address):
        with socket_of(address) as page:
            page.send(messages.encode(PRESS))
            until(page, lambda frame: frame["contact"] == 1)
            process.send_signal(how)
            with pytest.raises(ConnectionClosed):
                until(page, lambda frame: False)
        rest = process.communicate(timeout=20)[0]
    assert process.returncode == 0, rest
    assert "Traceback" not in rest
    saved = pp.read_record(record)
    assert saved.kinds.tolist() == [1, 0]
    assert saved.settings["radius"] == 10.0
    model = pp.model(pp.read_tissue(tissue_file), saved.model)
    again = pp.Session(model, radius=10.0, sweeps=int(saved.settings["sweeps"]))
    assert again.replay(saved) is None
    with command(tissue_file, "--replay", record) as (process, address), socket_of(address) as page:
        page.send(
            messages.encode(messages.ToolCommand(0, 1, 9, (40.0, 0.0, 0.0), (5.0, 0.0, 0.0)))
        )  # a replay is only looked at
        pressed = until(page, lambda frame: frame["contact"] == 1)
        assert pressed["displacement"][0] == pytest.approx(0, abs=1e-6)
        until(page, lambda frame: frame["contact"] == 0 and frame["tick"] >= saved.length)


def stroke(page, frames):
    """Presses here and there; gives the last tick that was shown."""
    for k in range(frames):
        page.send(messages.encode(messages.ToolCommand(0, 1, k, TOP, (0.1 * k, 0.0, -0.2 * (k % 15)))))
        tick = until(page, lambda frame: True)["tick"]
    return tick


def replays(record, tissue_file):
    """Whether every state of a record is made again, to the bit."""
    model = pp.model(pp.read_tissue(tissue_file), record.model)
    session = pp.Session(model, radius=10.0, sweeps=int(record.settings["sweeps"]))
    return session.replay(record) is None


def test_a_session_that_is_killed_leaves_a_record_to_its_last_second(tmp_path, tissue_file):
    record = tmp_path / "session.h5"
    with command(tissue_file, "--record", record, "--radius", 10) as (process, address), socket_of(address) as page:
        tick = stroke(page, 120)
        process.kill()
    with pytest.warns(UserWarning, match=r"session\.h5\.journal: a session that was cut short"):
        left = pp.read_record(record)
    assert left.length > tick - 1000
    assert len(left.ticks) > 10
    assert replays(left, tissue_file)
    scored = [sys.executable, "-m", "palpate", "score", record, tissue_file, "-o", tmp_path / "score.html"]
    said = subprocess.run(scored, capture_output=True, text=True, timeout=60)
    assert said.returncode == 0
    assert "note:" in said.stderr
    assert "cut short" in said.stderr
    # The next session of this name puts the other away.
    next_one = [sys.executable, "-m", "palpate", "touch", tissue_file, "--record", record, "--no-browser"]
    process = subprocess.Popen(next_one, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert "http://127.0.0.1:" in process.stdout.readline()
    process.send_signal(signal.SIGINT)
    said = process.communicate(timeout=20)[1]
    assert process.returncode == 0, said
    assert "it is now in" in said
    assert pp.read_record(tmp_path / "session-recovered-1.h5").length == left.length
    assert pp.read_record(record).length < left.length
    assert not (tmp_path / "session.h5.journal").exists()


@pytest.mark.parametrize("bytes_left", [0, 600, 6000])
def test_a_full_disk_while_recording_loses_only_what_found_no_room(tmp_path, tissue_file, bytes_left):
    """A limit of the size of files is a full disk that needs no root."""
    resource = pytest.importorskip("resource")
    record = tmp_path / "session.h5"
    with command(tissue_file, "--record", record, "--radius", 10) as (process, address):
        with socket_of(address) as page:
            stroke(page, 100)
            taken = (tmp_path / "session.h5.journal").stat().st_size
            resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (taken + bytes_left, resource.RLIM_INFINITY))
            stroke(page, 120)
        process.send_signal(signal.SIGINT)
        said = process.communicate(timeout=20)[0]
    assert "File too large" in said
    assert "session.h5" in said
    assert "Traceback" not in said
    if process.returncode == 0:  # packed, it found room at the end
        assert not (tmp_path / "session.h5.journal").exists()
        assert replays(pp.read_record(record), tissue_file)
        return
    assert process.returncode == 2, said
    assert not record.exists()
    assert "session.h5.journal holds what there was room for" in said
    with pytest.warns(UserWarning, match="cut short"):
        assert replays(pp.read_record(record), tissue_file)


def test_record_of_another_tissue_is_refused_by_the_command(tmp_path, tissue_file):
    session = pp.Session(pp.model(organ(7)), radius=14.0, sweeps=2)
    session.step([None])
    pp.write_record(tmp_path / "other.h5", session.record())
    refused = subprocess.run(
        [sys.executable, "-m", "palpate", "touch", tissue_file, "--replay", tmp_path / "other.h5", "--no-browser"],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert refused.returncode == 2
    assert "open the tissue it was recorded with" in refused.stderr
    assert "Traceback" not in refused.stderr


def test_missing_tissue_is_named(tmp_path):
    refused = subprocess.run(
        [sys.executable, "-m", "palpate", "touch", tmp_path / "none.vtu", "--no-browser"],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert refused.returncode == 2
    assert "none.vtu" in refused.stderr
    assert "Traceback" not in refused.stderr
