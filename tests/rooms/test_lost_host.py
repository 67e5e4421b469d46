"""Several hosts serve one room. Any of them may be lost, with its disk."""

import asyncio
import contextlib
import json
import zlib

import pytest
from support.example_organs import organ
from support.registries import registry_server
from support.running_server import until
from support.several_hosts import TOP, ServingHost, back, cut_over_the_top, page_of, scene_of
from websockets.exceptions import ConnectionClosed

import palpate as pp
from palpate.rooms.open_registry import open_registry
from palpate.server import messages
from palpate.server.message_kinds import CloseCode

NOTE = messages.encode(messages.Note(0, 0, TOP)) + b"hard here"


@pytest.fixture(scope="module")
def kidney(tmp_path_factory):
    path = tmp_path_factory.mktemp("organ") / "kidney.vtu"
    pp.write_tissue(path, organ(9))
    return path


@contextlib.contextmanager
def hosts(kind, kidney, folder, count=2):
    """The server of a registry, and hosts: the first has the room."""
    (folder / "registry").mkdir()
    with registry_server(kind, folder / "registry") as server, contextlib.ExitStack() as after:
        several = []
        for number in range(count):
            several.append(ServingHost(folder / f"host{number}", kidney, server.address))
            after.callback(several[-1].end)
        yield server, several


def kept(server, room="kidney"):
    """What the registry keeps of a room."""

    async def ask():
        one = open_registry(server.address)
        try:
            return await one.kept(room)
        finally:
            await one.close()

    packed = asyncio.run(ask())
    return json.loads(zlib.decompress(packed)) if packed else {"cuts": [], "notes": []}


def closed(page):
    """Until a page's socket is closed; why."""
    try:
        while True:
            page.recv(timeout=30)
    except ConnectionClosed as end:
        return end.rcvd.code


@pytest.mark.parametrize("kind", ["redis", "nats"])
def test_the_room_of_a_lost_host_goes_on_elsewhere_with_its_cuts_and_notes(kind, kidney, tmp_path):
    with hosts(kind, kidney, tmp_path) as (server, (first, second)):
        assert first.rooms()
        assert not second.rooms()
        token = first.tokens["teacher"]  # one host's invitation lets in at the other
        whole = scene_of(second, token)["triangles"]
        with page_of(second, token) as page:
            cut_over_the_top(page)
            while not str(page.recv(timeout=60)).startswith("Cut of"):  # the stroke has ended
                pass
            page.send(NOTE)
            until(lambda: len(kept(server)["cuts"]) == 1 and len(kept(server)["notes"]) == 1, 60)
            cut = scene_of(second, token)["triangles"]
            first.lose()
            assert closed(page) == CloseCode.room_lost
        scene, notes, _ = back(second, token)
        assert scene["triangles"] == cut > whole
        assert notes == ["hard here"]
        assert second.rooms()


def test_a_host_that_is_silent_loses_its_room_and_does_not_get_it_back(kidney, tmp_path):
    """Nothing is closed, as when a cable is pulled. When it can be reached again it passes pages on to the new one."""
    with hosts("redis", kidney, tmp_path) as (_, (first, second)):
        token = second.tokens["teacher"]
        first.silence()
        back(second, token)
        assert second.rooms()
        first.resume()
        until(lambda: not first.rooms(), 60)
        with page_of(second, token) as page:
            page.send(NOTE)
            until(lambda: back(first, token)[1] == ["hard here"], 60)


def test_a_host_that_ends_gives_its_rooms_away_as_they_are(kidney, tmp_path):
    with hosts("redis", kidney, tmp_path) as (_, (first, second)):
        token = second.tokens["teacher"]
        with page_of(first, token) as page:
            page.send(NOTE)
            while page.recv(timeout=30)[0] != 11:
                pass
        first.end()
        assert first.process.returncode == 0
        _, notes, _ = back(second, token)
        assert notes == ["hard here"]


def test_rooms_go_on_while_the_registry_is_away(kidney, tmp_path):
    """Also if it has forgotten all when it is back."""
    with hosts("redis", kidney, tmp_path, 1) as (server, (host,)):
        token = host.tokens["teacher"]
        room = host.rooms()
        server.kill()
        with page_of(host, token) as page:
            page.send(NOTE)
            while page.recv(timeout=30)[0] != 11:
                pass
        server.start()
        until(lambda: [text for _, text in kept(server)["notes"]] == ["hard here"], 60)
        assert host.rooms() == room


@pytest.mark.parametrize("kind", ["redis", "nats"])
def test_hosts_share_the_rooms_and_none_moves_while_somebody_is_in_it(kind, kidney, tmp_path):
    """The first host has them all until another one comes, and again when that is lost."""
    (tmp_path / "registry").mkdir()
    names = ("anatomy", "surgery", "pathology")
    with registry_server(kind, tmp_path / "registry") as server, contextlib.ExitStack() as after:
        first = ServingHost(tmp_path / "first", kidney, server.address, *names)
        after.callback(first.end)
        assert len(first.rooms()) == 3
        with page_of(first, first.tokens["teacher"]) as page:  # of the last room
            page.send(NOTE)
            second = ServingHost(tmp_path / "second", kidney, server.address, *names)
            after.callback(second.end)
            until(lambda: (len(first.rooms()), len(second.rooms())) == (2, 1), 60)
            for _ in range(150):  # three seconds: it stays so
                page.recv(timeout=5)
                assert (len(first.rooms()), len(second.rooms())) == (2, 1)
            assert back(second, second.tokens["teacher"])[1] == ["hard here"], "each lets in to rooms of the other"
        assert len(list((tmp_path / "first").glob("*.h5"))) == 1, "the record of the room that has gone"
        second.lose()
        until(lambda: len(first.rooms()) == 3, 60)
        first.end()
        written = {path.name for path in (tmp_path / "first").glob("*.h5")}
        moved = next(name for name in names if f"{name}-2.h5" in written)
        assert written == {f"{name}.h5" for name in names} | {f"{moved}-2.h5"}, "no record is written over another"


def test_a_registry_that_does_not_answer_is_said_before_anything_starts(kidney, tmp_path):
    room = pp.RoomFile("kidney", (kidney,))
    with pytest.raises(pp.errors.PortError, match=r"registry redis://127.0.0.1:1: no answer"):
        pp.serve([room], registry="redis://:secret@127.0.0.1:1")
    for options, said in [
        ({"registry": "etcd://host"}, "expected redis://HOST:6379 or nats://HOST:4222"),
        ({"registry": "redis://elsewhere.example"}, "give this one's address: --peer"),
        ({"registry": "redis://127.0.0.1:1", "peer": "10.0.0.7"}, "expected http://HOST:PORT"),
    ]:
        with pytest.raises(pp.errors.DataError, match=said):
            pp.serve([room], **options)
