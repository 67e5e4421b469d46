"""Invitations to a room: signed texts that say which room, which role, until when."""

import base64
import binascii
import hashlib
import hmac
import json
import secrets
import time
from dataclasses import dataclass

from palpate.errors import DataError
from palpate.server.message_kinds import Role
from palpate.server.people import LONGEST_NAME, shown_name

HOURS = 12.0  # that an invitation lasts, unless said otherwise
MOST_HOURS = 24 * 366.0
LONGEST = 400  # characters of a signed invitation
SIGNATURE = 16  # bytes
REFUSED = "the invitation is not valid; ask the teacher for a new one"


@dataclass(frozen=True)
class Invitation:
    """What a signed invitation says. name: as all in the room see it, or empty. expires: Unix time, s; nobody enters later.

    Examples
    --------
    >>> secret = "a text that only the server knows"
    >>> signed = sign(Invitation("anatomy", Role.trainee, "Ada", 2e9), secret)
    >>> read_invitation(signed, secret, now=1.9e9).name
    'Ada'
    """

    room: str
    role: Role
    name: str
    expires: float


def invitation(room: str, role: str, name: str = "", hours: float = HOURS) -> Invitation:
    """An invitation from now on. Raises `DataError` for a role that there is not, a name or a time that cannot be."""
    if role not in Role.__members__:
        raise DataError(f"role: {role!r} is none; choose one of {', '.join(Role.__members__)}")
    if not 0 < hours <= MOST_HOURS:
        raise DataError(f"hours: {hours:g}, expected more than 0, at most {MOST_HOURS:g}")
    if name != shown_name(name):
        raise DataError(f"name: {name[:60]!r}; expected at most {LONGEST_NAME} characters in one line")
    return Invitation(room, Role[role], name, time.time() + 3600 * hours)


def sign(one: Invitation, secret: str) -> str:
    """The invitation as a text for an address. No two are the same."""
    told = [one.room, int(one.role), one.name, int(one.expires), secrets.token_hex(4)]
    text = _plain(json.dumps(told, separators=(",", ":"), ensure_ascii=False).encode())
    return f"{text}.{_signature(text, secret)}"


def read_invitation(signed: str, secret: str, now: float | None = None) -> Invitation:
    """What a signed invitation says. now: Unix time, s. Raises `DataError` if it was not signed so, or is over."""
    text, _, signature = signed.partition(".")
    whole = len(signed) <= LONGEST and signed.isascii()
    if not whole or not hmac.compare_digest(signature, _signature(text, secret)):
        raise DataError(REFUSED)
    try:
        room, role, name, expires, _ = json.loads(base64.urlsafe_b64decode(text + "=" * (-len(text) % 4)))
        one = Invitation(str(room), Role(role), str(name), float(expires))
    except (ValueError, TypeError, binascii.Error):  # signed by another version
        raise DataError(REFUSED) from None
    if (time.time() if now is None else now) >= one.expires:
        raise DataError("the invitation is over; ask the teacher for a new one")
    return one


def _signature(text: str, secret: str) -> str:
    """A message authentication code (HMAC, RFC 2104, of SHA-256, its first half)."""
    return _plain(hmac.new(secret.encode(), text.encode(), hashlib.sha256).digest()[:SIGNATURE])


def _plain(data: bytes) -> str:
    return base64.urlsafe_b64encode(data).decode().rstrip("=")
