"""Reads no more than a file can rightly hold: regular files, headers of some length, streams as long as they are said."""

import contextlib
import json
import zlib
from pathlib import Path
from typing import Any

from palpate.errors import FileError

INFLATION = 2000  # times its stored size: no compression that is read here gains more
SLACK = 65536  # bytes that may be claimed of nothing
TEXT = 16 * 2**20  # bytes of a text that people write
NEST = 100  # brackets in each other in a text that people write


def existing_path(path: str | Path) -> Path:
    """`path`, once it is sure that a file or a folder is there. Raises `FileError`."""
    path = Path(path)
    if not path.exists():
        raise FileError(f"{path}: no such file; check the name (looked from {Path.cwd()})")
    return path


def existing_file(path: str | Path) -> Path:
    """`path`, once it is sure that a file is there, and no folder, pipe or device. Raises `FileError`."""
    path = existing_path(path)
    if path.is_dir():
        raise FileError(f"{path}: is a folder; name a file")
    if not path.is_file():
        raise FileError(f"{path}: is a pipe or a device, not a file; copy what it gives into a file")
    return path


def read_text(path: str | Path) -> str:
    """The text of a file, UTF-8. Raises `FileError` if there is none, or far too much."""
    path = existing_file(path)
    if path.stat().st_size > TEXT:
        raise FileError(f"{path}: {path.stat().st_size} bytes, expected a text of {TEXT} at most; check the name")
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as problem:
        raise FileError(f"{path}: not a text in UTF-8 ({problem.reason} at byte {problem.start})") from None


def parse_json(text: str | bytes) -> Any:
    """The value of a JSON text. Raises `ValueError`, of a text that is nested too deep too."""
    with contextlib.suppress(RecursionError):
        return json.loads(text)
    raise ValueError("nested too deep")


def check_claim(path: Path, what: str, claimed: int, there: int) -> None:
    """Raises a `FileError` if `claimed` bytes cannot come out of `there` stored ones."""
    if claimed > INFLATION * there + SLACK:
        raise FileError(f"{path}: says {what}, {claimed} bytes, and holds {there} for them; copy or export it again")


def inflate(packed: bytes, size: int, wbits: int) -> bytes:
    """`size` bytes out of deflate streams that follow each other. Raises `ValueError` if they hold less, or more.

    wbits: as in `zlib`, 15 zlib's own, 31 gzip, -15 raw.
    """
    parts: list[bytes] = []
    left = size + 1
    while packed and left > 0:
        stream = zlib.decompressobj(wbits)
        try:
            parts.append(stream.decompress(packed, left))
        except zlib.error as problem:
            raise ValueError(f"compressed data are damaged: {problem}") from None
        left -= len(parts[-1])
        if left > 0 and not stream.eof:
            raise ValueError("compressed data are cut short")
        packed = stream.unused_data.lstrip(b"\0")
    if left <= 0:
        raise ValueError(f"compressed data go on after the {size} bytes that are said to be in them")
    if left > 1:
        raise ValueError(f"truncated: {size + 1 - left} bytes, {size} expected")
    return parts[0] if len(parts) == 1 else b"".join(parts)
