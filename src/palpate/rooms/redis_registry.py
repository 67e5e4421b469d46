"""Rooms of several hosts, told by Redis. A claim is a key that expires; scripts make each step one."""

import asyncio
from collections.abc import Awaitable
from typing import Any, TypeVar

from palpate.errors import DataError, ExtraError
from palpate.rooms.registry import LEASE, PATIENCE, RegistryLost

try:
    from redis.asyncio import Redis
    from redis.exceptions import RedisError
except ImportError as error:
    raise ExtraError("a registry on Redis needs the package redis: pip install 'palpate[redis]'") from error

Answer = TypeVar("Answer")
HOST, STATE, SECRET, HOSTS = "palpate:host:", "palpate:room:", "palpate:secret", "palpate:hosts"
CLAIM = """
local host = redis.call('get', KEYS[1])
if host and host ~= ARGV[1] then return host end
redis.call('set', KEYS[1], ARGV[1], 'PX', ARGV[2])
return ARGV[1]
"""
RELEASE = "if redis.call('get', KEYS[1]) == ARGV[1] then redis.call('del', KEYS[1]) end"
THERE = """
local now = redis.call('time')
local seconds = now[1] + now[2] / 1000000
redis.call('zremrangebyscore', KEYS[1], '-inf', seconds - ARGV[2])
redis.call('zadd', KEYS[1], seconds, ARGV[1])
return redis.call('zcard', KEYS[1])
"""
KEEP = """
if redis.call('get', KEYS[1]) ~= ARGV[1] then return 0 end
redis.call('set', KEYS[2], ARGV[2])
return 1
"""


class RedisRegistry:
    """A `Registry` at an address such as redis://:password@host:6379/0."""

    def __init__(self, address: str) -> None:
        try:
            self._redis: Any = Redis.from_url(address, socket_connect_timeout=PATIENCE, socket_timeout=PATIENCE)
        except ValueError as problem:
            raise DataError(f"registry: {problem}; expected redis://HOST:6379") from None

    async def secret(self, offered: str) -> str:
        """The secret that was offered first."""
        await answered(self._redis.set(SECRET, offered, nx=True))
        return text(await answered(self._redis.get(SECRET)))

    async def claim(self, room: str, host: str) -> str:
        """The host that has the room now."""
        return text(await answered(self._redis.eval(CLAIM, 1, HOST + room, host, int(1000 * LEASE))))

    async def owner(self, room: str) -> str:
        """The host that has a room."""
        return (await answered(self._redis.get(HOST + room)) or b"").decode()

    async def hosts(self, host: str) -> int:
        """How many hosts there are."""
        return int(await answered(self._redis.eval(THERE, 1, HOSTS, host, LEASE)))

    async def release(self, room: str, host: str) -> None:
        """Gives a room up."""
        await answered(self._redis.eval(RELEASE, 1, HOST + room, host))

    async def keep(self, room: str, host: str, state: bytes) -> bool:
        """Keeps what a room holds. Returns whether this host has it."""
        return bool(await answered(self._redis.eval(KEEP, 2, HOST + room, STATE + room, host, state)))

    async def kept(self, room: str) -> bytes:
        """What a room held last."""
        return await answered(self._redis.get(STATE + room)) or b""

    async def close(self) -> None:
        """Ends the connection."""
        await self._redis.aclose()


async def answered(asked: Awaitable[Answer]) -> Answer:
    """An answer of Redis, or `RegistryLost`."""
    try:
        return await asyncio.wait_for(asked, PATIENCE)
    except (RedisError, OSError, TimeoutError) as problem:
        raise RegistryLost(str(problem) or "no answer") from None


def text(value: bytes | None) -> str:
    """What was set by this module. It is gone if Redis was emptied in between."""
    if value is None:
        raise RegistryLost("what was set is gone")
    return value.decode()
