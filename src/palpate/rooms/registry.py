"""Which host has which room, and what the room holds: told by Redis or NATS, so that another host can go on with it.

A host claims a room for `LEASE` seconds and renews that every `BEAT`. Once a host is silent for that long, whoever claims the
room next has it, and opens it as it was kept last.
"""

from typing import Protocol
from urllib.parse import urlsplit

LEASE = 2.0  # s for which a claim lasts
BEAT = 0.5  # s between renewals
PATIENCE = 1.5  # s that an answer may take
MOST_BYTES = 1_000_000  # of what is kept of a room: NATS takes 1 MiB in its default, its headers included


class RegistryLost(Exception):  # noqa: N818 - what has happened, not what was done wrong
    """The registry does not answer."""


class Registry(Protocol):
    """All raise `RegistryLost`. Used on one event loop."""

    async def secret(self, offered: str) -> str:
        """The secret of all hosts' invitations: what was offered first."""

    async def claim(self, room: str, host: str) -> str:
        """Claims a room, or renews the claim. Returns the host that has it now."""

    async def owner(self, room: str) -> str:
        """The host that has a room, or nothing."""

    async def hosts(self, host: str) -> int:
        """Says that this host is there, and returns how many are."""

    async def release(self, room: str, host: str) -> None:
        """Gives a room up, if this host has it."""

    async def keep(self, room: str, host: str, state: bytes) -> bool:
        """Keeps what a room holds, if this host has it. Returns whether it has."""

    async def kept(self, room: str) -> bytes:
        """What a room held last, or nothing."""

    async def close(self) -> None:
        """Ends the connection."""


def without_password(address: str) -> str:
    """An address to be shown."""
    parts = urlsplit(address)
    return parts._replace(netloc=parts.netloc.rpartition("@")[2]).geturl()
