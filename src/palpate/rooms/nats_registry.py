"""Rooms of several hosts, told by NATS: two key-value buckets of JetStream, of which that with the claims forgets."""

import asyncio
import contextlib
from collections.abc import Awaitable
from typing import Any, TypeVar

from palpate.errors import ExtraError
from palpate.rooms.registry import LEASE, PATIENCE, RegistryLost

try:
    import nats
    from nats.errors import Error as NatsError
    from nats.js.errors import BucketNotFoundError, KeyNotFoundError, KeyWrongLastSequenceError, NotFoundError
except ImportError as error:
    raise ExtraError("a registry on NATS needs the package nats-py: pip install 'palpate[nats]'") from error

Answer = TypeVar("Answer")
CLAIMS, ROOMS, SECRET = "palpate-claims", "palpate-rooms", "secret"
THERE = "host-"  # before the keys of hosts


class NatsRegistry:
    """A `Registry` at an address such as nats://user:password@host:4222, of a server with JetStream."""

    def __init__(self, address: str) -> None:
        self._address = address
        self._client: Any = None
        self._claims: Any = None
        self._rooms: Any = None
        self._opening = asyncio.Lock()

    async def secret(self, offered: str) -> str:
        """The secret that was offered first."""
        await self._open()
        with contextlib.suppress(KeyWrongLastSequenceError):
            await answered(self._rooms.create(SECRET, offered.encode()))
        return str((await answered(self._rooms.get(SECRET))).value.decode())

    async def claim(self, room: str, host: str) -> str:
        """The host that has the room now."""
        await self._open()
        key = key_of(room)
        try:
            found = await value_of(self._claims, key)
            if found is None:
                await answered(self._claims.create(key, host.encode()))
            elif found.value.decode() != host:
                return str(found.value.decode())
            else:  # not if another host has claimed it since
                await answered(self._claims.update(key, host.encode(), last=found.revision))
        except (KeyWrongLastSequenceError, KeyNotFoundError):  # another host was faster, or the claim has just expired
            found = await value_of(self._claims, key)
            if found is None:
                raise RegistryLost("a claim expired as it was renewed") from None
            return str(found.value.decode())
        return host

    async def owner(self, room: str) -> str:
        """The host that has a room."""
        await self._open()
        found = await value_of(self._claims, key_of(room))
        return "" if found is None else str(found.value.decode())

    async def hosts(self, host: str) -> int:
        """How many hosts there are."""
        await self._open()
        await answered(self._claims.put(THERE + host.encode().hex(), b""))
        keys = await answered(self._claims.keys())
        return sum(key.startswith(THERE) for key in keys)

    async def release(self, room: str, host: str) -> None:
        """Gives a room up."""
        await self._open()
        found = await value_of(self._claims, key_of(room))
        if found is not None and found.value.decode() == host:
            await answered(self._claims.purge(key_of(room)))

    async def keep(self, room: str, host: str, state: bytes) -> bool:
        """Keeps what a room holds. Returns whether this host has it."""
        await self._open()
        found = await value_of(self._claims, key_of(room))
        if found is None or found.value.decode() != host:
            return False
        await answered(self._rooms.put(key_of(room), state))
        return True

    async def kept(self, room: str) -> bytes:
        """What a room held last."""
        await self._open()
        found = await value_of(self._rooms, key_of(room))
        return b"" if found is None else bytes(found.value)

    async def close(self) -> None:
        """Ends the connection."""
        if self._client is not None:
            with contextlib.suppress(NatsError, OSError, TimeoutError):
                await self._client.close()

    async def _open(self) -> None:
        """Connects, unless that was done. The client connects again by itself."""
        async with self._opening:
            if self._rooms is not None:
                return
            if self._client is None:
                self._client = await answered(
                    nats.connect(
                        self._address,
                        connect_timeout=PATIENCE,
                        max_reconnect_attempts=-1,
                        allow_reconnect=True,
                        reconnect_time_wait=0.2,
                        error_cb=silent,
                    ),
                    2 * PATIENCE,
                )
            stream = self._client.jetstream(timeout=PATIENCE)
            self._claims = await bucket(stream, CLAIMS, LEASE)
            self._rooms = await bucket(stream, ROOMS, None)


async def bucket(stream: Any, name: str, seconds: float | None) -> Any:
    """A bucket, made if it is not there. seconds: after which it forgets."""
    try:
        return await answered(stream.key_value(name))
    except BucketNotFoundError:
        return await answered(stream.create_key_value(bucket=name, ttl=seconds, history=1))


async def value_of(store: Any, key: str) -> Any:
    """An entry, or None."""
    try:
        return await answered(store.get(key))
    except KeyNotFoundError:  # also if it was deleted
        return None


def key_of(room: str) -> str:
    """A key: they take few characters, and names of rooms may have any letters."""
    return "room-" + room.encode().hex()


async def silent(_: Exception) -> None:
    """The client would print that it connects again; who calls is told."""


async def answered(asked: Awaitable[Answer], seconds: float = PATIENCE) -> Answer:
    """An answer of NATS, or `RegistryLost`."""
    try:
        return await asyncio.wait_for(asked, seconds)
    except (KeyNotFoundError, KeyWrongLastSequenceError, BucketNotFoundError):
        raise
    except NotFoundError as problem:
        raise RegistryLost(f"a bucket is gone ({problem})") from None
    except (NatsError, OSError, TimeoutError) as problem:
        raise RegistryLost(str(problem) or "no answer") from None
