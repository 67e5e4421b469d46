"""A page of a room as the server sees it: a WebSocket that sends messages and reads frames."""

import json
import struct
from contextlib import ExitStack, contextmanager

import numpy as np
import pytest
from websockets.sync.client import connect

import palpate as pp
from palpate.server import messages
from palpate.server.frame_message import PLACES
from palpate.server.live_session import LiveSession
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import running_session
from palpate.simulation.pointer import Pointer
from support.example_organs import organ

TOP, SIDE = (0.0, 0.0, 25.0), (40.0, 0.0, 0.0)
FRAME = struct.Struct("<BBddIIdff4B12f12f12f4f")  # the first fields of a frame, as `messages.Frame` documents them
HANDS, PEOPLE, GUIDANCE = 17, 16, 20
TOLD = struct.Struct("<BBIIIBB3f3fdd3f3f")  # a guidance, as `messages.Guidance` documents it


def shared_session():
    """A session of an organ in a room."""
    session = pp.Session(pp.model(organ(9), "compliance"), radius=9.0, sweeps=8)
    return LiveSession(session, Pointer(), room="anatomy")


@contextmanager
def open_to_all(live):
    """The server of a session in a room; gives come(role, name), which lets somebody in."""
    with running_session(live, loopback_socket(None)) as address, ExitStack() as closing:
        yield lambda role, name="": Somebody(closing, address, role, name)


class Somebody:
    """A page of a room."""

    def __init__(self, closing, address, role, name=""):
        base, token = address.split("/?")
        query = f"{token}&role={role}&name={name}"
        socket = connect(f"{base.replace('http', 'ws')}/socket?{query}", origin=base, max_queue=None)
        self.socket = closing.enter_context(socket)
        self.serial = 0
        self.told = []
        self.people = self.hands = self.you = self.frozen = self.displaced = self.guidance = None

    def send(self, message):
        self.socket.send(messages.encode(message))

    def press(self, tool=0, point=TOP, depth=(0.0, 0.0, -2.0), kind=1):
        self.serial += 1
        self.send(messages.ToolCommand(tool, kind, self.serial, point, depth))

    def away(self, tool=0):
        self.press(tool, (0.0,) * 3, (0.0,) * 3, 0)

    def frame(self):
        """The next frame: serial, contact, displacement (tool, 3), force (tool, 3)."""
        while True:
            data = self.socket.recv(timeout=20)
            if isinstance(data, str):
                self.told.append(data)
            elif data[0] == PEOPLE:
                _, self.you, self.frozen = struct.unpack_from("<BIB", data)
                self.people = json.loads(data[8:])
            elif data[0] == GUIDANCE:
                _, state, number, teacher, trainee, *told = TOLD.unpack_from(data)
                at, given, force = (told[2:5], told[5:8]), told[8:10], (told[10:13], told[13:16])
                self.guidance = {"state": state, "number": number, "hands": (teacher, trainee), "tools": told[:2]}
                self.guidance |= {"at": at, "given": given, "force": force}
            elif data[0] == HANDS:
                (count,) = struct.unpack_from("<I", data, 1)
                self.hands = np.frombuffer(data, "<f4", 13 * count, 8).reshape(count, 13)
            elif data[0] == 2:
                values = FRAME.unpack_from(data)
                self.length, (step, count) = len(data), struct.unpack_from("<fI", data, PLACES["step"][0])
                self.displaced = step, count
                three = [np.array(values[13 + 12 * k : 25 + 12 * k]).reshape(4, 3) for k in range(3)]
                return values[5], values[9:13], three[1], three[2]

    def until(self, true, count=600):
        for _ in range(count):
            frame = self.frame()
            if true(*frame):
                return frame
        pytest.fail("never came")

    def settled(self):
        """Until the serial is the newest and the force has stood still for 20 frames."""
        still, before = 0, None
        for _ in range(900):
            serial, contact, displacement, force = self.frame()
            same = before is not None and np.abs(force - before).max() < 1e-4
            still = still + 1 if same and serial == self.serial else 0
            before = force
            if still == 20:
                return serial, contact, displacement, force
        pytest.fail("the force does not settle")
