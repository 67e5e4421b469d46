"""What Redis and NATS tell of rooms: real servers, and what several hosts may rely on."""

import asyncio
import contextlib

import pytest
from support.registries import registry_server

import palpate as pp
from palpate.rooms.open_registry import open_registry
from palpate.rooms.registry import LEASE, RegistryLost, without_password


@pytest.fixture(scope="module", params=["redis", "nats"])
def server(request, tmp_path_factory):
    with registry_server(request.param, tmp_path_factory.mktemp(request.param)) as one:
        yield one


def with_registries(server, use, count=1):
    """Runs a coroutine function with so many connections, as of so many hosts."""

    async def run():
        several = [open_registry(server.address) for _ in range(count)]
        try:
            return await use(*several)
        finally:
            for one in several:
                await one.close()

    return asyncio.run(run())


def test_of_many_hosts_that_claim_at_once_one_has_the_room(server):
    async def use(*hosts):
        for room in ("anatomy", "Übung", "third-1"):
            owners = await asyncio.gather(*(host.claim(room, f"host {i}") for i, host in enumerate(hosts)))
            assert len(set(owners)) == 1
            assert owners[0] in {f"host {i}" for i in range(len(hosts))}
            again = await asyncio.gather(*(host.claim(room, f"host {i}") for i, host in enumerate(hosts)))
            assert again == owners

    with_registries(server, use, 6)


def test_a_claim_that_is_renewed_stays_and_one_that_is_not_goes(server):
    async def use(one, two):
        assert await one.claim("renewed", "a") == "a"
        for _ in range(8):
            await asyncio.sleep(0.4)
            assert await one.claim("renewed", "a") == "a"
            assert await two.claim("renewed", "b") == "a"
        began = asyncio.get_running_loop().time()
        while await two.claim("renewed", "b") != "b":
            await asyncio.sleep(0.05)
            assert asyncio.get_running_loop().time() - began < LEASE + 5
        assert asyncio.get_running_loop().time() - began > 0.5 * LEASE
        assert await one.claim("renewed", "a") == "b"

    with_registries(server, use, 2)


def test_a_room_that_is_given_up_is_free_at_once_and_only_its_host_gives_it_up(server):
    async def use(one, two):
        assert await one.claim("given", "a") == "a"
        await two.release("given", "b")
        assert await two.claim("given", "b") == "a"
        await one.release("given", "a")
        assert await two.claim("given", "b") == "b"
        await two.release("given", "b")
        assert await one.claim("given", "a") == "a"

    with_registries(server, use, 2)


def test_hosts_are_counted_while_they_say_that_they_are_there(server):
    async def use(one, two):
        assert await one.owner("seen") == ""
        await one.claim("seen", "a")
        assert await two.owner("seen") == "a"
        await one.hosts("a 1")
        assert await two.hosts("b 2") >= 2
        before = await one.hosts("a 1")
        for _ in range(10):
            await asyncio.sleep(0.4)
            assert await one.hosts("a 1") <= before
        assert await one.hosts("a 1") == before - 1

    with_registries(server, use, 2)


def test_what_a_room_holds_is_kept_by_its_host_alone_and_outlives_the_claim(server):
    state = bytes(range(256)) * 2000

    async def use(one, two):
        assert await one.kept("held") == b""
        assert not await one.keep("held", "a", state)
        await one.claim("held", "a")
        assert await one.keep("held", "a", state)
        assert not await two.keep("held", "b", b"another's")
        await one.release("held", "a")
        assert await two.kept("held") == state
        assert await two.kept("other") == b""

    with_registries(server, use, 2)


def test_all_hosts_have_the_first_one_s_secret(server):
    async def use(*hosts):
        told = await asyncio.gather(*(host.secret(f"offered by {i}") for i, host in enumerate(hosts)))
        assert len(set(told)) == 1
        assert told[0].startswith("offered by ")
        assert await hosts[0].secret("later") == told[0]

    with_registries(server, use, 4)


@pytest.mark.parametrize("kind", ["redis", "nats"])
def test_a_server_that_is_gone_is_said_in_time_and_found_again(kind, tmp_path):
    with registry_server(kind, tmp_path) as server:

        async def use(one):
            assert await one.claim("room", "a") == "a"
            server.kill()
            for ask in (one.claim("room", "a"), one.keep("room", "a", b""), one.kept("room"), one.release("room", "a")):
                with pytest.raises(RegistryLost):
                    await asyncio.wait_for(ask, 6)
            server.start()
            for _ in range(100):
                with contextlib.suppress(RegistryLost):
                    return await one.claim("room", "a")
                await asyncio.sleep(0.1)

        assert with_registries(server, use) == "a"


@pytest.mark.parametrize("address", ["http://127.0.0.1", "somewhere", "", "redis", "etcd://host"])
def test_an_address_of_no_registry_is_refused(address):
    with pytest.raises(pp.errors.DataError, match="expected redis"):
        open_registry(address)


def test_no_password_is_shown():
    assert without_password("redis://:secret@host:6379/0") == "redis://host:6379/0"
    with pytest.raises(pp.errors.DataError) as said:
        open_registry("etcd://ada:secret@host")
    assert "secret" not in str(said.value)
