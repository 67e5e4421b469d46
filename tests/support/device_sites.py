"""Two haptic devices at two sites of one room, in virtual time: the servo and the loop of each site as they run there, the
room's session with its tools and people, and a network that delays, jitters and loses.
"""

from dataclasses import dataclass, field

import numpy as np

from palpate import _core
from palpate.rooms.join import ENERGY
from palpate.rooms.room_hand import RoomHand
from palpate.rooms.solid_reader import read_organ
from palpate.server.frame_message import frame_bytes
from palpate.server.held_tools import HeldTools
from palpate.server.message_kinds import Role
from palpate.server.messages import BINARY, Frame, Hands, decode_told
from palpate.server.people import Room
from palpate.server.solid_message import solid_bytes
from palpate.simulation.pointer import KINDS, Command, Pointer
from palpate.simulation.session import Session
from palpate.tissue.models.compliance import ComplianceModel

RADIUS = 8.0  # mm
LEFT, RIGHT = np.array([-10.0, 0.0, 24.2]), np.array([10.0, 0.0, 24.2])  # mm, on the organ of the tests
EVERY = 16  # ms between commands, and between frames
LEAST_HOLD, ROUND_TRIPS, PACKET = 200, 1.5, 1400  # ms; bytes: as of DelayedLink
LETTING_GO = 50  # ms after a button has changed
MASS, STIFFNESS = 0.1, 0.5  # kg, N/mm: of a hand, and of the spring that draws it where it wants to be


class Way:
    """One way of the network: a stream that keeps the order. delay: ms."""

    def __init__(self, rng, delay, loss=0.05):
        self.rng, self.delay, self.loss, self.before, self.waiting = rng, delay, loss, 0.0, []

    def send(self, now, size, message):
        for _ in range(-(-size // PACKET)):
            held = max(LEAST_HOLD, ROUND_TRIPS * 2 * self.delay) if self.rng.random() < self.loss else 0
            self.before = max(self.before, now + self.delay * self.rng.uniform(0.8, 1.2) + held)
        self.waiting.append((self.before, message))

    def arrived(self, now):
        while self.waiting and self.waiting[0][0] <= now:
            yield self.waiting.pop(0)[1]


def settings(**changes):
    """Of a device of 10 N and 2 N/mm."""
    s = _core.haptics.ServoSettings()
    s.force, s.stiffness, s.damping, s.energy_limit, s.max_damping = 10.0, 2.0, 2e-3, ENERGY, 1e-9
    for name, value in changes.items():
        setattr(s, name, value)
    return s


@dataclass
class Contact:
    """What a hand got in one: energy N mm, its greatest force N, the greatest change of it in a tick N.

    A hand that has let go of what it held by its button makes a step of its own, which is not counted.
    """

    energy: float = 0.0
    most_energy: float = 0.0
    largest: float = 0.0
    step: float = 0.0


@dataclass(eq=False)
class Site:
    """A hand and its device. wish(ms): where the hand wants to be, mm, and its buttons."""

    solid: bytes
    start: np.ndarray
    account: float = ENERGY  # mJ
    stiffness: float = STIFFNESS
    wish: object = None
    contacts: list = field(default_factory=list)
    force: np.ndarray = field(default_factory=lambda: np.zeros(3))
    v: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self):
        self.session = read_organ(self.solid).session()
        self.servo = _core.haptics.Servo(settings(energy_limit=self.account))
        self.core = _core.haptics.RoomDevice(self.servo)
        self.hand = RoomHand(self.session, self.core)
        self.x = np.array(self.start, float)
        self.touching, self.buttons, self.changed = False, 0, -LETTING_GO

    def tick(self, now):
        wanted, buttons = self.wish(now)
        if buttons != self.buttons:
            self.buttons, self.changed = buttons, now
        damping = 1.4 * np.sqrt(MASS * self.stiffness * 1000) / 1000  # N s/mm
        pull = self.stiffness * (wanted - self.x) - damping * self.v + self.force
        self.v = self.v + pull / MASS  # N / kg over 1 ms, in mm/s
        moved = 1e-3 * self.v
        self.x = self.x + moved
        before = self.force
        touching = self.session.frame().contact[0] == 1
        if touching and not self.touching:
            self.contacts.append(Contact())
        self.touching = touching
        if self.contacts:
            one = self.contacts[-1]
            one.energy += float(before @ moved)
            one.most_energy = max(one.most_energy, one.energy)
        self.force = np.array(self.servo.tick(self.x, buttons, 1_000_000 * (now + 1000)))
        self.session.loop.step(self.core, 1)
        if self.contacts:
            one.largest = max(one.largest, float(np.linalg.norm(self.force)))
            if now - self.changed > LETTING_GO:
                one.step = max(one.step, float(np.linalg.norm(self.force - before)))
        if now % 1000 == 0:
            self.session.events.collect(self.session.loop)


class World:
    """The room and its sites."""

    def __init__(self, tissue, starts, *, delay=0, loss=0.05, seed=1, roles=None, energy=ENERGY):
        self.session = Session(ComplianceModel(tissue), radius=RADIUS, sweeps=1)
        self.pointer = Pointer()
        self.tools = HeldTools(self.pointer, shared=True)
        self.room = Room(self.tools)
        solid = solid_bytes(self.session)
        self.sites = [Site(solid, start, energy) for start in starts]
        rng = np.random.default_rng(seed)
        self.up = [Way(rng, delay, loss) for _ in self.sites]
        self.down = [Way(rng, delay, loss) for _ in self.sites]
        self.now = 0
        self.cut = False  # nothing comes any more
        for site, role in zip(self.sites, roles or [Role.trainee] * len(starts), strict=True):
            self.room.enter(site, "", role)
            site.hand.patience = max(0.1, min(1.5, 0.1 + 3 * (2.8e-3 * delay + 0.2 * (loss > 0))))

    def freeze(self, frozen):
        self.room._freeze(frozen)
        for site in self.sites:
            site.hand.people(frozen, self.room.people[site].role)

    def run(self, ticks):
        for _ in range(ticks):
            self.tick()

    def tick(self):
        now = self.now
        for site, up in zip(self.sites, self.up, strict=True):
            site.tick(now)
            if now % EVERY == 0 and (command := site.hand.command()):
                up.send(now, 40, command)
            for told in up.arrived(now):
                command = Command(True, told.point, told.displacement, KINDS[told.kind]) if told.kind else Command()
                self.tools.command(site, told.tool, command, told.serial, self.room.stops(site))
        self.session.loop.step(self.pointer.core, 1)
        frame = None
        if now % EVERY == 0:
            here = self.session.frame()
            frame = frame_bytes(here, self.session.drawn(here)[:0])
        for site, down in zip(self.sites, self.down, strict=True):
            if frame is not None and not self.cut:
                down.send(now, 400, self.room.messages(site, frame))
            hands = np.empty((0, 13), np.float32)
            for messages in down.arrived(now):
                for data in messages:
                    if BINARY[data[0] - 1] is Hands:
                        hands = np.frombuffer(data, "<f4", offset=8).reshape(-1, 13)
                    else:
                        site.hand.hear(decode_told(Frame, data), hands)
        if now % 1000 == 0:
            self.session.events.collect(self.session.loop)
        self.now += 1


def pressing(place, inwards, depth, *, tug=1.0, phase=0.0, still=3.0, back=4.0, swing=0.4, button=0):
    """A wish: from 5 mm outside it goes in, to and fro, stands still, and goes back (s)."""
    out = -np.asarray(inwards, float)

    def wish(now):
        s = now / 1000
        ramp = max(0.0, min(1.0, s / 0.7, (back - s) / 0.7))
        way = depth * (1 + swing * np.sin(2 * np.pi * tug * min(s, still - 0.5) + phase))
        return place + out * (5 - ramp * (5 + way)), button if 0.5 < s < back - 0.2 else 0

    return wish


def pulling(place, direction, size, *, tug=1.0, phase=0.0, still=3.0, back=4.0, swing=0.4):
    """A wish: it touches, holds by the button, pulls to and fro, stands still, comes back, and lets go (s)."""
    direction = np.asarray(direction, float)

    def wish(now):
        s = now / 1000
        if s < 0.5:
            return place + [0, 0, 5 - 7 * min(1.0, s / 0.3)], 0
        ramp = max(0.0, min(1.0, (s - 0.6) / 0.7, (back - s) / 0.7))
        way = size * ramp * (1 + swing * np.sin(2 * np.pi * tug * min(s, still - 0.5) + phase))
        out = max(0.0, min(1.0, (s - back - 0.2) / 0.3))
        return place + way * direction + np.array([0, 0, -2 + 7 * out]), int(s < back)

    return wish
