"""The way into the rooms: who is let in and as what, messages both ways, and rooms that die."""

import asyncio
import contextlib
import json
import os
import socket
import struct
import sys
import time

import httpx
import pytest
from support.example_organs import organ
from support.open_rooms import SECRET, open_rooms, socket_of, until_message
from support.running_server import until
from support.several_hosts import cut_over_the_top
from websockets.exceptions import ConnectionClosed, InvalidStatus

import palpate as pp
from palpate.rooms.gateway import gateway
from palpate.rooms.invitation import Invitation, sign
from palpate.rooms.room_process import RoomProcess
from palpate.server import messages
from palpate.server.message_kinds import CloseCode, Role
from palpate.simulation.session_journal import journal_path

TOP = (0.0, 0.0, 25.0)
PRESS = messages.encode(messages.ToolCommand(0, 1, 1, TOP, (0.0, 0.0, -3.0)))
FRAME, PEOPLE, HANDS = 2, 16, 17


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rooms")
    pp.write_tissue(folder / "kidney.vtu", organ(9))
    return folder


@pytest.fixture(scope="module")
def rooms(folder):
    organs = (folder / "kidney.vtu",)
    listed = [pp.RoomFile("anatomy", organs, record=folder / "anatomy.h5"), pp.RoomFile("second", organs)]
    with open_rooms(listed, folder) as opened:
        yield opened


def written(record):
    """When the journal of a record was written last: the room does once a second."""
    return journal_path(record).stat().st_mtime


def people(page):
    data = until_message(page, lambda data: data[0] == PEOPLE)
    return json.loads(data[8:])


def in_contact(data):
    return data[0] == FRAME and struct.unpack_from("<BBddIIdff4B", data)[9] == 1


@pytest.mark.skipif(sys.platform != "linux", reason="the priority of a thread is Linux's")
def test_what_a_room_computes_ahead_stands_behind_what_its_hands_wait_for(rooms):
    process, ordinary = rooms.rooms["anatomy"]._process.pid, os.getpriority(os.PRIO_PROCESS, 0)
    threads = [int(name) for name in os.listdir(f"/proc/{process}/task")]
    niceness = [os.getpriority(os.PRIO_PROCESS, thread) for thread in threads]
    assert niceness.count(15) == 1
    assert set(niceness) == {ordinary, 15}


def test_a_role_a_name_and_a_room_are_those_of_the_invitation_alone(rooms):
    """Whatever the page adds to its address."""
    address = rooms.address("anatomy", "viewer", "Ada") + "&role=teacher&name=Mallory&room=second&token="
    with socket_of(address.replace("&token=", "")) as page:
        assert [(one["name"], one["role"]) for one in people(page)] == [("Ada", Role.viewer)]
        page.send(PRESS)
        assert until_message(page, lambda data: isinstance(data, str)) == "Only a trainee can do this here."
    assert httpx.get(address.replace("?", "scene?").replace("&token=", "")).status_code == 200


@pytest.mark.parametrize("path", ["scene", "solid", "engine", "album", "values/0/0", "socket"])
def test_nobody_enters_without_an_invitation_to_that_server(rooms, path):
    room_token = rooms.rooms["anatomy"].token
    later = time.time() + 3600
    tokens = [
        "",
        "x",
        room_token,
        SECRET.replace(" ", "+"),
        sign(Invitation("anatomy", Role.teacher, "", later), "guessed"),
        sign(Invitation("anatomy", Role.teacher, "", time.time() - 1), SECRET),
        sign(Invitation("elsewhere", Role.teacher, "", later), SECRET),
        sign(Invitation("anatomy", Role.teacher, "", later), SECRET)[:-1],
    ]
    for token in tokens:
        if path == "socket":
            with pytest.raises(InvalidStatus) as refusal, socket_of(f"{rooms.base}?token={token}"):
                pass
            assert refusal.value.response.status_code == 403
        else:
            assert httpx.get(f"{rooms.base}{path}", params={"token": token}).status_code == 403


def test_the_room_itself_lets_in_the_gateway_alone(rooms):
    port = rooms.rooms["anatomy"].port
    invited = rooms.address("anatomy", "teacher").split("token=")[1]
    assert httpx.get(f"http://127.0.0.1:{port}/scene", params={"token": invited}).status_code == 403


@pytest.mark.parametrize(("host", "status"), [("simulator.example.org", 403), ("127.0.0.1", 200), ("evil", 403)])
def test_only_names_that_the_server_goes_by_are_answered(rooms, host, status):
    address = rooms.address("anatomy", "viewer").replace("?", "scene?")
    assert httpx.get(address, headers={"host": host}).status_code == status


def test_a_name_that_was_given_is_answered(folder):
    app = gateway({}, SECRET, frozenset({"simulator.example.org"}))

    async def answers():
        transport = httpx.ASGITransport(app=app)
        async with httpx.AsyncClient(transport=transport, base_url="https://simulator.example.org") as client:
            given = ({}, {"host": "evil.example"}, {"origin": "https://evil.example"})
            return [(await client.get("/", headers=headers)).status_code for headers in given]

    assert asyncio.run(answers()) == [200, 403, 403]


def test_who_vanishes_without_a_word_leaves_and_lets_go(rooms):
    """As when a cable is pulled: nothing is read any more, and so no ping is answered."""
    gone = connect_raw(rooms.address("second", "trainee", "Ada"))
    with contextlib.closing(gone), socket_of(rooms.address("second", "viewer", "Bo")) as page:
        gone.send(b"\x82" + bytes([0x80 | len(PRESS)]) + bytes(4) + PRESS)  # a frame of RFC 6455, masked with zeros
        until_message(page, lambda data: data[0] == HANDS and data[1:5] != bytes(4))
        until_message(page, lambda data: data[0] == PEOPLE and len(json.loads(data[8:])) == 1)
        until_message(page, lambda data: data[0] == HANDS and data[1:5] == bytes(4))


def connect_raw(address):
    """A socket after its handshake."""
    base, query = address.split("/?")
    raw = socket.create_connection(("127.0.0.1", int(base.split(":")[2])))
    raw.sendall(
        f"GET /socket?{query} HTTP/1.1\r\nHost: {base.split('//')[1]}\r\nOrigin: {base}\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
    )
    assert raw.recv(12) == b"HTTP/1.1 101"
    return raw


def test_rooms_are_apart(rooms):
    with (
        socket_of(rooms.address("anatomy", "trainee", "Ada")) as one,
        socket_of(rooms.address("second", "trainee", "Bo")) as two,
    ):
        assert [each["name"] for each in people(one)] == ["Ada"]
        assert [each["name"] for each in people(two)] == ["Bo"]
        one.send(PRESS)
        until_message(one, in_contact)
        for _ in range(30):
            assert not in_contact(two.recv(timeout=20))


def test_a_wrong_message_closes_with_the_room_s_own_code_and_words(rooms):
    with socket_of(rooms.address("anatomy", "trainee")) as page:
        page.send(b"\x63nonsense")
        with pytest.raises(ConnectionClosed) as closed:
            until_message(page, lambda data: False)
    assert closed.value.rcvd.code == 1008
    assert "reload the page" in closed.value.rcvd.reason


def scene(address):
    data = httpx.get(address.replace("?", "scene?")).content
    (length,) = struct.unpack_from("<I", data)
    return json.loads(data[4 : 4 + length])


def test_a_room_that_dies_is_back_with_its_cuts_and_its_notes_each_time(rooms, folder):
    """A second death loses nothing either. What was recorded before is kept."""
    room, address = rooms.rooms["anatomy"], rooms.address("anatomy", "teacher")
    lips = []
    for time_ in (1, 2):
        with socket_of(address) as page:
            cut_over_the_top(page, 12.0 * (time_ - 1))
            until(lambda before=time_ - 1: scene(address)["made"] > 0)
            if time_ == 1:
                note = messages.encode(messages.Note(0, 0, TOP)) + b"hard here"
                page.send(note)
            page.send(PRESS)
            until_message(page, in_contact)
            for _ in range(2):  # the first one may have begun before
                before = written(folder / "anatomy.h5")
                until(lambda before=before: written(folder / "anatomy.h5") > before)
            lips.append(scene(address)["triangles"])
            room._process.kill()
            with pytest.raises(ConnectionClosed) as closed:
                until_message(page, lambda data: False)
            assert closed.value.rcvd.code == CloseCode.room_lost
        with socket_of(address) as page:
            notes = until_message(page, lambda data: data[0] == 11)
            assert [one["text"] for one in json.loads(notes[8:])] == ["hard here"]
            assert not in_contact(until_message(page, lambda data: data[0] == FRAME))  # no tool is held
        assert scene(address)["triangles"] == lips[-1]
    assert room.deaths == 2
    assert lips[1] > lips[0] > scene(rooms.address("second", "viewer"))["triangles"]
    records = [pp.read_record(folder / f"anatomy-recovered-{k}.h5") for k in (1, 2)]
    assert [len(record.cuts) > 0 for record in records] == [True, True]


def test_a_room_that_dies_in_its_first_second_is_back_too(folder):
    """Its journal holds nothing yet."""
    organs = (folder / "kidney.vtu",)
    with open_rooms([pp.RoomFile("young", organs, record=folder / "young.h5")], folder) as opened:
        room, address = opened.rooms["young"], opened.address("young", "trainee")
        for deaths in (1, 2, 3):
            with socket_of(address) as page:
                until_message(page, lambda data: data[0] == FRAME)
                room._process.kill()
                with pytest.raises(ConnectionClosed):
                    until_message(page, lambda data: False)
            until(lambda deaths=deaths: room.deaths == deaths and room.port != 0)
        assert room.problem == ""


def test_a_room_that_cannot_be_opened_says_why(folder):
    (folder / "broken.vtu").write_text("no mesh")
    bad = [pp.RoomFile("bad", (folder / "broken.vtu",))]
    with pytest.raises(pp.errors.DataError, match=r"room bad: .*broken\.vtu"), open_rooms(bad, folder):
        pass


def test_a_room_ends_with_its_gateway(folder):
    with open_rooms([pp.RoomFile("brief", (folder / "kidney.vtu",), record=folder / "brief.h5")], folder) as opened:
        process = opened.rooms["brief"]._process
        with socket_of(opened.address("brief", "trainee")) as page:
            page.send(PRESS)
            until_message(page, in_contact)
    assert process.returncode == 0
    assert pp.read_record(folder / "brief.h5").length > 0


def test_what_cannot_be_served_is_refused_before_anything_starts(folder, tmp_path):
    room = pp.RoomFile("anatomy", (folder / "kidney.vtu",))
    for rooms, options, said in [
        ([], {}, "none; give a tissue"),
        ([room, room], {}, "two are called anatomy"),
        ([pp.RoomFile("a", (tmp_path / "none.vtu",))], {}, "no such file"),
        ([pp.RoomFile("a", room.organs, record=tmp_path / "none" / "r.h5")], {}, "none"),
        ([room], {"host": "0.0.0.0"}, "give the name of this machine"),
        ([room], {"host": "203.0.113.9"}, "give an address of this machine"),
        ([room], {"address": "http://simulator.example.org"}, "anybody on the way can read"),
        ([room], {"address": "ftp://simulator.example.org"}, "expected https"),
        ([room], {"certificate": (tmp_path / "c.pem", tmp_path / "k.pem")}, "no such file"),
        ([room], {"hours": -1}, "hours"),
        ([room], {"port": 70000}, "expected 1 to 65535"),
    ]:
        with pytest.raises((pp.errors.DataError, pp.errors.FileError, pp.errors.PortError), match=said):
            pp.serve(rooms, **options)
    (tmp_path / "c.pem").write_text("no certificate")
    with pytest.raises(pp.errors.FileError, match="no certificate and its key"):
        pp.serve([room], certificate=(tmp_path / "c.pem", tmp_path / "c.pem"))
    assert RoomProcess(room, tmp_path / "r.h5").port == 0
