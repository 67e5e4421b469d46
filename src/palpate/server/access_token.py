"""The token in the printed address. It outlives a restart, so that an open page finds its server again."""

import contextlib
import math
import os
import secrets
import time
from pathlib import Path

from palpate.atomic_write import replacing

LIFETIME = 12 * 3600  # s


def access_token() -> str:
    """A random token. One user's servers have the same for `LIFETIME`, from a file that only this user can read."""
    return kept_secret("token", LIFETIME)


def kept_secret(name: str, lifetime: float = math.inf) -> str:
    """A random text that is kept for so many seconds, from a file of that name that only this user can read."""
    path = state_folder() / name
    with contextlib.suppress(OSError, UnicodeDecodeError):
        found, text = path.stat(), path.read_text(encoding="ascii").strip()
        if len(text) >= 22 and time.time() - found.st_mtime < lifetime and private(found):
            return text
    token = secrets.token_urlsafe(16)
    with contextlib.suppress(OSError):  # without such a file a page must be opened anew after a restart, no more
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        with replacing(path) as temporary:
            temporary.touch(0o600)
            temporary.write_text(token, encoding="ascii")
    return token


def state_folder() -> Path:
    """Where this user's servers keep what outlives them."""
    return Path(os.environ.get("XDG_STATE_HOME") or "~/.local/state").expanduser() / "palpate"


def private(found: os.stat_result) -> bool:
    """Whether a file belongs to this user, and others cannot read it."""
    return os.name == "nt" or (found.st_uid == os.getuid() and not found.st_mode & 0o077)
