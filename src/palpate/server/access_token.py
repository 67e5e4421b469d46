"""The token in the printed address. It outlives a restart, so that an open page finds its server again."""

import contextlib
import os
import secrets
import time
from pathlib import Path

from palpate.atomic_write import replacing

LIFETIME = 12 * 3600  # s


def access_token() -> str:
    """A random token. One user's servers have the same for `LIFETIME`, from a file that only this user can read."""
    path = Path(os.environ.get("XDG_STATE_HOME") or "~/.local/state").expanduser() / "palpate" / "token"
    with contextlib.suppress(OSError, UnicodeDecodeError):
        found, text = path.stat(), path.read_text(encoding="ascii").strip()
        if len(text) >= 22 and time.time() - found.st_mtime < LIFETIME and private(found):
            return text
    token = secrets.token_urlsafe(16)
    with contextlib.suppress(OSError):  # without such a file a page must be opened anew after a restart, no more
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        with replacing(path) as temporary:
            temporary.touch(0o600)
            temporary.write_text(token, encoding="ascii")
    return token


def private(found: os.stat_result) -> bool:
    """Whether a file belongs to this user, and others cannot read it."""
    return os.name == "nt" or (found.st_uid == os.getuid() and not found.st_mode & 0o077)
