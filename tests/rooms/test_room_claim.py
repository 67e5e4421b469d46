"""Which of several hosts has a room, by a clock of its own: what two hosts do at any moment of each other's beats."""

import asyncio
import contextlib

import numpy as np
import pytest
from support.virtual_clock import run_at_once

import palpate as pp
from palpate.rooms.registry import BEAT, LEASE, RegistryLost
from palpate.rooms.room_claim import LEFT, Host, Share, count_hosts, hold
from palpate.rooms.room_process import RoomProcess


class Memory:
    """A registry as Redis is one: claims and hosts that run out. slow: s, the longest way to it."""

    def __init__(self, slow=0.0):
        self.claims, self.seen, self.answers = {}, {}, True
        self.slow, self.rng = slow, np.random.default_rng(5)

    async def _asked(self):
        """When a question arrives, s."""
        await asyncio.sleep(self.slow * self.rng.random())
        if not self.answers:
            raise RegistryLost
        return asyncio.get_running_loop().time()

    async def claim(self, room, host):
        now = await self._asked()
        owner, until = self.claims.get(room, (host, 0.0))
        if owner == host or until <= now:
            self.claims[room] = (host, now + LEASE)
        return self.claims[room][0]

    async def owner(self, room):
        now = await self._asked()
        owner, until = self.claims.get(room, ("", 0.0))
        return owner if until > now else ""

    async def hosts(self, host):
        now = await self._asked()
        self.seen[host] = now + LEASE
        return sum(until > now for until in self.seen.values())

    async def release(self, room, host):
        await self._asked()
        if self.claims.get(room, ("", 0.0))[0] == host:
            del self.claims[room]

    async def keep(self, room, host, state):
        await self._asked()
        return True

    async def kept(self, room):
        await self._asked()
        return b""


class Opened(RoomProcess):
    """A room whose process is only told of."""

    opened = 0

    async def open(self):
        await asyncio.sleep(0.3)
        self.port, self.opened = 1, self.opened + 1

    async def keep(self):
        await asyncio.Event().wait()

    async def close(self):
        self.port = 0


class Place:
    """A host with its rooms."""

    def __init__(self, registry, name, rooms, folder):
        self.host, self.share = Host(registry, f"http://{name}", name), Share(len(rooms))
        self.rooms = [Opened(pp.RoomFile(room, (folder / "organ.vtu",)), folder / room) for room in rooms]
        keeping = [hold(room, self.host, self.share) for room in self.rooms]
        self.tasks = [asyncio.create_task(each) for each in [count_hosts(self.host, self.share), *keeping]]

    @property
    def has(self):
        return {room.room.name for room in self.rooms if room.port}

    async def end(self, tells):
        """It is stopped, or loses its power and so gives nothing up."""
        claims = dict(self.host.registry.claims)
        for task in self.tasks:
            task.cancel()
        await asyncio.gather(*self.tasks, return_exceptions=True)
        if not tells:
            self.host.registry.claims = claims


@contextlib.asynccontextmanager
async def places(tmp_path, rooms, *phases, slow=0.0):
    """Hosts of one registry; each begins so long after the one before, s."""
    registry, several = Memory(slow), []
    try:
        for number, phase in enumerate(phases):
            await asyncio.sleep(phase)
            several.append(Place(registry, f"host{number}", rooms, tmp_path))
        yield registry, several
    finally:
        for place in several:
            await place.end(tells=True)


PHASES = [0.02 + BEAT * k / 6 for k in range(6)]  # of the second host's beats after the first one's


@pytest.mark.parametrize("phase", PHASES)
def test_a_claim_that_ran_out_is_left_to_the_host_that_had_it(phase, tmp_path):
    """As after a moment in which the registry stood still. The second host has no room, and would like this one."""

    async def use():
        async with places(tmp_path, ["kidney"], 0.0, 2 + phase, slow=0.4) as (registry, (first, second)):
            for k in range(60):
                await asyncio.sleep(2 + BEAT * k / 60)
                registry.claims.clear()
                await asyncio.sleep(2)
                assert (first.has, second.has) == ({"kidney"}, set())
            assert first.rooms[0].opened == 1

    run_at_once(use())


@pytest.mark.parametrize("phase", PHASES)
def test_a_lost_hosts_room_is_on_the_other_one_in_time(phase, tmp_path):
    """Within 5 s of its last beat, as page and host are asked to."""

    async def use():
        async with places(tmp_path, ["kidney"], 0.0, 2 + phase) as (_registry, (first, second)):
            await asyncio.sleep(2)
            assert first.has == {"kidney"}
            await first.end(tells=False)
            began = asyncio.get_running_loop().time()
            while not second.has:
                await asyncio.sleep(0.01)
            took = asyncio.get_running_loop().time() - began
            assert LEASE - BEAT < took < 4.6  # s; the room's process then opens

    run_at_once(use())


@pytest.mark.parametrize("phase", PHASES)
def test_rooms_are_shared_among_hosts(phase, tmp_path):
    """One that has all gives two of four up when another comes, and has them back once that one is lost."""

    async def use():
        async with places(tmp_path, ["a", "b", "c", "d"], 0.0, 2 + phase) as (_registry, (first, second)):
            await asyncio.sleep(20)
            assert len(first.has) == len(second.has) == 2
            assert first.has | second.has == {"a", "b", "c", "d"}
            await second.end(tells=False)
            await asyncio.sleep(LEASE + LEFT + 2 * BEAT + 0.5)
            assert first.has == {"a", "b", "c", "d"}

    run_at_once(use())


def test_while_the_registry_is_silent_all_stays_as_it_is(tmp_path):
    async def use():
        async with places(tmp_path, ["a", "b"], 0.0, 0.3) as (registry, several):
            await asyncio.sleep(20)
            before = [place.has for place in several]
            assert sorted(map(len, before)) == [1, 1]
            registry.answers = False
            await asyncio.sleep(60)
            assert [place.has for place in several] == before
            registry.claims.clear()
            registry.answers = True
            await asyncio.sleep(10)
            assert [place.has for place in several] == before
            assert all(room.opened <= 1 for place in several for room in place.rooms)

    run_at_once(use())
