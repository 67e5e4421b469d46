"""`palpate join`: a haptic device at another site of a real room, against a stand-in of Haply's service."""

import asyncio
import contextlib
import shutil
import signal
import subprocess
import threading
from urllib.parse import urlsplit

import numpy as np
import pytest
from support.delayed_link import delayed_link
from support.device_sites import LEFT, RADIUS, RIGHT
from support.example_organs import organ
from support.fake_devices.fake_inverse_service import InverseService
from support.open_rooms import SECRET, open_rooms, socket_of
from support.running_server import interrupted, start, until

import palpate as pp
from palpate.haptics.python_device import PythonDevice
from palpate.rooms import room_hand, solid_reader
from palpate.rooms.gateway import GatewayConnection, gateway
from palpate.rooms.invitation import invitation, sign
from palpate.rooms.join import ENERGY
from palpate.rooms.room_site import RoomSite
from palpate.rooms.room_way import room_way
from palpate.server import messages
from palpate.server.loopback_server import loopback_socket, running
from palpate.server.message_kinds import CutStep
from palpate.server.touch_routes import MESSAGE_BYTES
from palpate.simulation.pointer import ContactState

HANDS = 17
HIGH, LOW = 40.0, 19.0  # mm, above the table; the organ's middle is at 0


@pytest.fixture(scope="module")
def tissue():
    return organ(7)


@pytest.fixture(scope="module")
def rooms(tissue, tmp_path_factory):
    folder = tmp_path_factory.mktemp("rooms")
    pp.write_tissue(folder / "kidney.vtu", tissue)
    room = pp.RoomFile("anatomy", (folder / "kidney.vtu",), model="compliance", radius=RADIUS)
    other = pp.RoomFile("other", (folder / "kidney.vtu",), model="springs", radius=RADIUS)
    with open_rooms([room, other], folder) as opened:
        yield opened


class Hand(InverseService):
    """The service, in mm."""

    def __init__(self, x=0.0):
        super().__init__()
        self.x = x
        self.position = [1e-3 * x, 0.0, 1e-3 * HIGH]
        self.target = list(self.position)

    def go(self, height):
        self.target = [1e-3 * self.x, 0.0, 1e-3 * height]

    def feels(self, least=0.1):
        return bool(self.pushes) and self.pushes[-1] > least


@pytest.fixture
def hand():
    hand = Hand(float(LEFT[0]))
    yield hand
    hand.close()


class OwnHand:
    """A device in Python, whose servo bears a busy machine."""

    rate, force, stiffness = 1000, 10.0, 2.0
    lowest, highest = (-200, -200, -200), (200, 200, 200)

    def __init__(self, where):
        self.x, self.height, self.target, self.forces = float(LEFT[0]), HIGH, HIGH, [np.zeros(3)]
        self.y, self.goes_to, self.buttons = 0.0, 0.0, 0

    def read(self):
        self.height += np.clip(self.target - self.height, -0.1, 0.1)
        self.y += np.clip(self.goes_to - self.y, -0.02, 0.02)  # 20 mm/s
        return (self.x, self.y, self.height), self.buttons

    def write(self, force):
        self.forces.append(force)

    def go(self, height):
        self.target = height

    def feels(self, least=0.1):
        return bool(np.linalg.norm(self.forces[-1]) > least)

    def until_force(self, wanted):
        until(lambda: np.linalg.norm(self.forces[-1] - wanted) < 0.02 * np.linalg.norm(wanted), 20)


@contextlib.contextmanager
def watching(address):
    """A viewer's socket."""
    with socket_of(address) as page:
        yield Watcher(page)


class Watcher:
    """Sees where all tools are, and the force on each (N)."""

    def __init__(self, page):
        self.page = page

    def hands(self):
        while True:
            data = self.page.recv(timeout=20)
            if data[0] == HANDS:
                return np.frombuffer(data, "<f4", offset=8).reshape(-1, 13)

    def until_still(self, count):
        """Rows of `Hands` once so many hands have stood still for 30 frames."""
        before, same = None, 0
        for _ in range(1500):
            now = self.hands()
            still = (
                before is not None and before.shape == now.shape == (count, 13) and np.allclose(before, now, atol=1e-4)
            )
            before, same = now, same + 1 if still else 0
            if same == 30:
                return now
        pytest.fail("hands do not come to rest")


def test_command_joins_and_ctrl_c_leaves_nothing(rooms, hand, tmp_path):
    run = start(
        f"join {rooms.address('anatomy', 'trainee', 'Ada')} --device haply:127.0.0.1:{hand.port} --no-browser", tmp_path
    )
    with watching(rooms.address("anatomy", "viewer")) as watcher:
        until(lambda: len(hand.pushes) > 100)
        hand.go(LOW)
        until(hand.feels)
        until(lambda: len(watcher.hands()) == 1)
        code, out, err = interrupted(run, lambda: True)
        assert (code, err) == (0, "")
        assert "in the room as Ada (trainee)" in out
        assert out.endswith("palpate: left\n")
        until(lambda: hand.closed)
        assert hand.pushes[-1] == 0
        until(lambda: len(watcher.hands()) == 0)  # its tool has let go


@pytest.mark.parametrize("delay", [0.0, 0.15])
def test_force_of_a_device_and_a_page_is_that_of_one_push(rooms, tissue, delay):
    """At the device and in the room."""
    address, hand = urlsplit(rooms.address("anatomy", "trainee")), OwnHand(None)
    with (
        delayed_link(address.port, delay, loss=0.02) as link,
        socket_of(rooms.address("anatomy", "trainee")) as page,
        watching(rooms.address("anatomy", "viewer")) as watcher,
        joined(address._replace(netloc=f"{address.hostname}:{link.port}").geturl(), hand),
    ):
        page.send(messages.encode(messages.ToolCommand(0, 1, 1, tuple(RIGHT), (-0.5, 0.3, -2.0))))
        hand.go(LOW)
        until(hand.feels)
        told = watcher.until_still(2)
        pushed = pp.model(tissue, "compliance").push(told[:, 2:5], told[:, 5:8], RADIUS)
        row = next(k for k in range(2) if told[k, 2] < 0)
        assert np.linalg.norm(pushed.force, axis=1).min() > 0.05
        np.testing.assert_allclose(told[:, 8:11], pushed.force, atol=0.02 * np.abs(pushed.force).max())
        hand.until_force(pushed.force[row])


class Joined:
    """A site in a thread of the test. lost: how many messages the service had got when the room was lost."""

    def __init__(self, address, hand):
        self.said, self.lost, self.problem, self.ended = [], [], None, False
        self.hand, self.address = hand, address
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self):
        site = RoomSite(room_way(self.address), self.said.append)
        try:
            asyncio.run(site.fetch())
            own = isinstance(self.hand, OwnHand)
            device = (
                PythonDevice("own", self.hand, energy=ENERGY)
                if own
                else pp.Haply(f"127.0.0.1:{self.hand.port}", energy=ENERGY)
            )
            site.start(device)
            lose = site.hand.lose

            def noted():
                self.lost.append(0 if own else len(self.hand.pushes))
                lose()

            site.hand.lose = noted
            self.site = site
            with device:
                asyncio.run(site.stay(lambda: self.ended))
            site.stop()
        except pp.errors.PalpateError as problem:
            self.problem = problem

    def end(self):
        self.ended = True
        self.thread.join(20)
        assert not self.thread.is_alive()
        assert self.problem is None


@contextlib.contextmanager
def joined(address, hand):
    one = Joined(address, hand)
    try:
        yield one
    finally:
        one.end()


def served(folder):
    """`palpate serve`, and a trainee's invitation."""
    run = start("serve kidney.vtu --no-browser", folder)
    for line in run.stdout:
        if "trainee" in line and "token=" in line:
            address = line.split()[1]
        if "Ctrl-C" in line:
            return run, address
    pytest.fail(run.stderr.read())


def test_killed_server_leaves_no_force(tissue, hand, tmp_path, monkeypatch):
    """kill -9: zero within ten ticks of the device, and never more than before."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    from support import running_server

    monkeypatch.setitem(running_server.HERE, "XDG_STATE_HOME", str(tmp_path / "state"))
    pp.write_tissue(tmp_path / "kidney.vtu", tissue)
    run, address = served(tmp_path)
    with joined(address, hand) as one:
        until(lambda: len(hand.pushes) > 100)
        hand.go(LOW)
        until(hand.feels)
        one.lost.clear()
        run.send_signal(signal.SIGKILL)
        run.wait()
        until(lambda: one.lost and len(hand.pushes) > one.lost[0] + 200)
        pushes = np.array(hand.pushes[one.lost[0] :])
        assert np.diff(pushes[2:]).max() <= 0  # one was on its way
        assert np.all(pushes[12:] == 0)
    run.stdout.close()
    run.stderr.close()


def test_silent_room_takes_the_force_away_and_the_hand_comes_back(rooms, hand):
    """The connection stays open and nothing passes; then it passes again, and the hand begins anew outside."""
    address = urlsplit(rooms.address("anatomy", "trainee"))
    with (
        delayed_link(address.port, 0.01, loss=0.0) as link,
        joined(address._replace(netloc=f"{address.hostname}:{link.port}").geturl(), hand) as one,
    ):
        until(lambda: len(hand.pushes) > 100)
        hand.go(LOW)
        until(hand.feels)
        until(lambda: one.site.hand.patience < 0.4)
        one.lost.clear()
        link.cut = True
        until(lambda: not any(hand.pushes[-300:]))
        assert not one.lost  # the loop has done it by itself: no connection was closed
        until(lambda: one.lost)
        link.cut = False
        until(lambda: sum("in the room" in line for line in one.said) == 2)
        heard = len(hand.pushes)
        until(lambda: len(hand.pushes) > heard + 500)
        assert not any(hand.pushes[heard:])
        hand.go(HIGH)
        until(lambda: hand.position[2] > 1e-3 * (HIGH - 1))
        hand.go(LOW)
        until(hand.feels)


def test_organ_that_is_cut_is_felt_on(tissue, tmp_path):
    """A teacher cuts beside the hand, which holds on and feels what `push` says of the cut organ; then takes it back."""
    pp.write_tissue(tmp_path / "kidney.vtu", tissue)
    room, hand = pp.RoomFile("theatre", (tmp_path / "kidney.vtu",), model="compliance", radius=RADIUS), OwnHand(None)
    with (
        open_rooms([room], tmp_path) as rooms,
        joined(rooms.address("theatre", "trainee"), hand) as one,
        socket_of(rooms.address("theatre", "teacher")) as teacher,
        watching(rooms.address("theatre", "viewer")) as watcher,
    ):
        hand.go(LOW)
        until(hand.feels)
        session, before = one.site.session, watcher.until_still(1)
        for step, y in ((CutStep.begin, -10.0), (CutStep.move, -4.0), (CutStep.move, 4.0), (CutStep.end, 10.0)):
            teacher.send(messages.encode(messages.Scalpel(step, 8.0, (-4.0, y, 24.0))))
        until(lambda: session.cuts == 1 and one.site._change is None)
        told = watcher.until_still(1)
        expected = pp.model(session.tissue, "compliance").push(told[0, 2:5], told[0, 5:8], RADIUS).force
        np.testing.assert_allclose(told[0, 8:11], expected, atol=0.02 * np.linalg.norm(expected))
        assert np.linalg.norm(before[0, 8:11] - expected) > 0.02 * np.linalg.norm(expected)
        hand.until_force(expected)
        assert one.site.session is session  # it held on
        teacher.send(messages.encode(messages.Scalpel(CutStep.undo, 0.0, (0.0, 0.0, 0.0))))
        until(lambda: session.cuts == 0 and one.site._change is None)
        hand.until_force(before[0, 8:11])


def test_a_device_cuts_at_its_site_and_the_room_follows(tissue, tmp_path):
    """The force is that of the blade in the organ here, at once; the cut is the room's, and everybody's."""
    pp.write_tissue(tmp_path / "kidney.vtu", tissue)
    room = pp.RoomFile(
        "theatre", (tmp_path / "kidney.vtu",), model="compliance", radius=RADIUS, toughness={"organ": 150, "lump": 150}
    )
    hand = OwnHand(None)
    hand.y = hand.goes_to = -10.0
    with (
        open_rooms([room], tmp_path) as rooms,
        joined(rooms.address("theatre", "trainee"), hand) as one,
        socket_of(rooms.address("theatre", "teacher")) as teacher,
    ):
        hand.go(LOW)
        until(hand.feels)
        session, depth = one.site.session, one.site.hand.depth
        assert depth > 5
        hand.buttons, hand.goes_to = 2, 12.0
        until(lambda: hand.y > 8)
        assert session.frame().contact[0] == ContactState.cutting
        assert np.linalg.norm(hand.forces[-1]) == pytest.approx(0.15 * depth, rel=0.1)
        assert hand.forces[-1][1] < 0, "against its way"
        until(lambda: hand.y == 12.0)
        hand.buttons = 0
        hand.go(HIGH)
        until(lambda: session.cuts == 1 and one.site._change is None)
        until(lambda: any(line.startswith("Cut of") for line in one.said))
        assert one.site.session is session
        blade = session.tissue.mesh.blades[0]
        assert 22 - session.tissue.edge < np.ptp(blade.points[:, 1]) < 23  # its way has a point each half edge
        until(lambda: not np.any(hand.forces[-1]))
        teacher.send(messages.encode(messages.Scalpel(CutStep.undo, 0.0, (0.0, 0.0, 0.0))))
        until(lambda: session.cuts == 0)


def signed(room, role="trainee", hours=1.0, secret=SECRET):
    return sign(invitation(room, role, "", hours), secret)


@pytest.mark.parametrize(
    ("token", "words"),
    [
        (lambda: signed("anatomy", secret="another"), "not let in: the invitation is not valid; ask the teacher"),
        (lambda: signed("anatomy", hours=1e-9), "not let in: the invitation is over; ask the teacher"),
        (lambda: signed("theatre"), "there is no room theatre here"),
        (lambda: signed("anatomy", "viewer"), "the invitation is a viewer's, who may not touch"),
    ],
)
def test_invitation_is_refused_by_name(rooms, hand, token, words):
    with pytest.raises(pp.errors.DataError, match=words):
        pp.join(f"{rooms.base}?token={token()}", f"haply:127.0.0.1:{hand.port}")
    assert not any(hand.pushes)


@pytest.mark.parametrize(
    ("address", "error", "words"),
    [
        ("http://127.0.0.1:1/?token=a.b", pp.errors.PortError, "no answer .* is the room being served"),
        ("http://simulator.example.org/?token=a.b", pp.errors.DataError, "over http anybody on the way"),
        ("http://127.0.0.1:8765/", pp.errors.DataError, "expected an invitation"),
        ("kidney", pp.errors.DataError, "expected an invitation"),
    ],
)
def test_address_that_is_no_invitation(address, error, words):
    with pytest.raises(error, match=words):
        pp.join(address)


def test_other_ends_that_do_not_fit(rooms, monkeypatch, tmp_path):
    """No device, another model, another version, a file that is no certificate, TLS where none is spoken."""
    address = rooms.address("anatomy", "trainee")
    with pytest.raises(pp.errors.DeviceError, match="Haply Hub"):
        pp.join(address, "haply:127.0.0.1:1")
    with pytest.raises(pp.errors.DataError, match="choose one of"):
        pp.join(address, "mouse")
    with pytest.raises(pp.errors.DataError, match=r"cannot be felt from another site: .* model compliance only"):
        pp.join(rooms.address("other", "trainee"))
    with pytest.raises(pp.errors.DataError, match="no TLS is spoken there"):
        pp.join(address.replace("http", "https"))
    (tmp_path / "cert.pem").write_text("none")
    with pytest.raises(pp.errors.FileError, match=r"cert\.pem"):
        pp.join(address.replace("http", "https"), certificate=tmp_path / "cert.pem")
    monkeypatch.setattr(solid_reader, "PROTOCOL", "of tomorrow")
    with pytest.raises(pp.errors.DataError, match="another version of palpate"):
        pp.join(address)


@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl makes the certificate")
def test_certificate_of_ones_own_is_trusted_by_its_file(tmp_path):
    pair = tmp_path / "cert.pem", tmp_path / "key.pem"
    made = "openssl req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=localhost -addext subjectAltName=IP:127.0.0.1"
    subprocess.run([*made.split(), "-out", pair[0], "-keyout", pair[1]], check=True, capture_output=True)
    with (
        contextlib.closing(loopback_socket(None)) as listener,
        running(gateway({}, SECRET), listener, MESSAGE_BYTES, GatewayConnection, pair) as base,
    ):
        address = f"{base}?token={signed('anatomy')}"
        with pytest.raises(pp.errors.DataError, match=r"its certificate is not trusted .*--certificate cert\.pem"):
            pp.join(address)
        with pytest.raises(pp.errors.DataError, match="not let in: there is no room anatomy here"):
            pp.join(address, certificate=pair[0])


def test_patience_is_three_times_the_way_and_some_more():
    way = room_hand.WayLength()
    assert way.patience == 1.5  # s, while nothing is known
    for _ in range(200):
        way.took(0.1)
    assert way.patience == pytest.approx(0.4, abs=1e-3)
    way.took(2.0)
    assert way.patience == 1.5
