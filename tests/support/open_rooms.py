"""Rooms that are really open: their processes, and the gateway in a thread of the test."""

import contextlib

import pytest
from websockets.sync.client import connect

from palpate.rooms.gateway import GatewayConnection, gateway
from palpate.rooms.invitation import invitation, sign
from palpate.rooms.serve import PING, checked_rooms, wait_for
from palpate.server.loopback_server import loopback_socket, running
from palpate.server.touch_routes import MESSAGE_BYTES

SECRET = "a secret of the tests"


class OpenRooms:
    """The rooms by name, and the gateway's address."""

    def __init__(self, rooms, base):
        self.rooms, self.base = rooms, base

    def address(self, room, role, name="", hours=1.0):
        return f"{self.base}?token={sign(invitation(room, role, name, hours), SECRET)}"


@contextlib.contextmanager
def open_rooms(rooms, folder):
    """Opens them; folder: for journals of rooms that are not recorded."""
    processes = checked_rooms(rooms, folder)
    with (
        contextlib.closing(loopback_socket(None)) as listener,
        running(gateway(processes, SECRET), listener, MESSAGE_BYTES, GatewayConnection, ping=PING) as base,
    ):
        wait_for(processes)
        yield OpenRooms(processes, base)


def socket_of(address, **options):
    """A page's socket into a room, by its invitation."""
    base, token = address.split("?")
    return connect(f"{base.replace('http', 'ws')}socket?{token}", origin=base.rstrip("/"), max_queue=None, **options)


def until_message(page, true):
    """The first message that is as wanted."""
    for _ in range(3000):
        data = page.recv(timeout=20)
        if true(data):
            return data
    pytest.fail("never came")
