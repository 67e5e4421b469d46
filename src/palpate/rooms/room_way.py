"""The way from another site into a room, by its invitation: what is fetched, and the messages of its WebSocket."""

import asyncio
import contextlib
import http.client
import json
import ssl
import struct
import urllib.error
import urllib.request
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlencode, urlsplit

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import InvalidHandshake, InvalidStatus

from palpate.errors import DataError, FileError, PortError

EXPECTED = "an invitation, as in https://simulator.example.org/?token=..."
NO_ANSWER = 8.0  # s
FAREWELL = 1.0  # s that the room may take to answer a close
ALIVE = 4.0  # s of silence after which the connection is given up
MOST_BYTES = 1 << 30  # of an organ
LOOPBACK = ("localhost", "127.0.0.1", "::1")


class RoomAway(PortError):  # noqa: N818 - what has happened, not what was done wrong
    """The room, or the way to it, is not there now; it may be in a while."""


class NotComputed(DataError):  # noqa: N818 - what has happened, not what was done wrong
    """The room's organ, or its model now, is none that a site computes."""


@dataclass(frozen=True)
class RoomWay:
    """base: the server's address, without a slash at its end. token: of the invitation. trust: None without TLS."""

    base: str
    token: str
    trust: ssl.SSLContext | None

    async def scene(self) -> dict[str, Any]:
        """What the room says of its organ and itself: `Scene` without its arrays."""
        data = await asyncio.to_thread(self._get, "/scene")
        try:
            (length,) = struct.unpack_from("<I", data)
            return dict(json.loads(data[4 : 4 + length]))
        except (struct.error, ValueError):
            raise DataError(f"{self.base}: no room of palpate answers there") from None

    async def solid(self) -> bytes:
        """The organ. Raises `DataError` with the room's reason if a site cannot predict it."""
        return await asyncio.to_thread(self._get, "/solid")

    def _get(self, path: str) -> bytes:
        request = f"{self.base}{path}?{urlencode({'token': self.token})}"
        handlers: list[Any] = [urllib.request.ProxyHandler({})]
        if self.trust:
            handlers.append(urllib.request.HTTPSHandler(context=self.trust))
        try:
            with urllib.request.build_opener(*handlers).open(request, timeout=NO_ANSWER) as answer:
                data: bytes = answer.read(MOST_BYTES)
                return data
        except urllib.error.HTTPError as problem:
            raise self._refusal(problem.code, problem.read(1000).decode(errors="replace")) from None
        except (OSError, http.client.HTTPException) as problem:
            raise self._lost(problem) from None

    @contextlib.asynccontextmanager
    async def messages(self) -> AsyncIterator[ClientConnection]:
        """The room's WebSocket during the block."""
        address = f"{self.base.replace('http', 'ws', 1)}/socket?{urlencode({'token': self.token})}"
        options: dict[str, Any] = {"ssl": self.trust} if self.trust else {}
        way = connect(
            address,
            origin=self.base,  # type: ignore[arg-type]
            compression=None,
            max_size=None,
            open_timeout=NO_ANSWER,
            close_timeout=FAREWELL,
            ping_interval=None,
            proxy=None,
            **options,
        )
        try:
            socket = await way
        except InvalidStatus as problem:
            raise self._refusal(
                problem.response.status_code, (problem.response.body or b"").decode(errors="replace")
            ) from None
        except (OSError, InvalidHandshake, TimeoutError) as problem:
            raise self._lost(problem) from None
        try:
            yield socket
        finally:
            await socket.close()

    def _refusal(self, status: int, text: str) -> Exception:
        if status == 503:
            return RoomAway(f"{self.base}: {text}")
        if status in (400, 403):
            return DataError(f"not let in: {text.removeprefix('refused: ')}")
        if status == 409:
            reason = text.removeprefix("prediction: ").split(";")[0]
            return NotComputed(
                f"the room cannot be felt from another site: {reason}; touch it in a page, or ask the teacher"
            )
        return DataError(f"{self.base}: no room of palpate answers there (status {status}); expected {EXPECTED}")

    def _lost(self, problem: Exception) -> Exception:
        reason = getattr(problem, "reason", problem)
        if isinstance(reason, ssl.SSLCertVerificationError):
            return DataError(
                f"{self.base}: its certificate is not trusted ({reason.verify_message}); if it is your own, give its file: "
                "--certificate cert.pem"
            )
        if isinstance(reason, ssl.SSLError):
            return DataError(f"{self.base}: no TLS is spoken there; is it http, or another port?")
        return RoomAway(f"{self.base}: no answer ({reason}); is the room being served?")


def room_way(address: str, certificate: str | Path | None = None) -> RoomWay:
    """The way of an invitation. certificate: a file of certificates to trust (PEM). Raises `DataError`, `FileError`."""
    parts = urlsplit(address.strip())
    tokens = parse_qs(parts.query).get("token", [])
    if parts.scheme not in ("http", "https") or not parts.hostname or len(tokens) != 1:
        raise DataError(f"address: {address[:80]!r}, expected {EXPECTED}")
    if parts.scheme == "http" and parts.hostname not in LOOPBACK:
        raise DataError(
            f"address: over http anybody on the way to {parts.hostname} can read the invitation; use the https address"
        )
    trust = None
    if parts.scheme == "https":
        try:
            trust = ssl.create_default_context(cafile=None if certificate is None else str(certificate))
        except (OSError, ssl.SSLError) as problem:
            raise FileError(f"{certificate}: no file of certificates (PEM): {problem}") from None
    elif certificate is not None:
        raise DataError("certificate: the address is http, which has none; leave it out")
    return RoomWay(f"{parts.scheme}://{parts.netloc}", tokens[0], trust)
