"""The journal of a session: a file to which its events are appended as they come, so that a death loses a second at most.

Lines of text, each behind its checksum. The first says what is recorded, every other one what came since the one before.
What a death leaves of the last line does not fit its checksum. `recording` turns a journal into a record.
"""

import base64
import json
import os
import sys
import warnings
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.bounded_read import existing_file, parse_json
from palpate.errors import FileError
from palpate.simulation.event_log import COLUMNS
from palpate.simulation.session_cuts import RecordedCut, cut_of, plain_cut
from palpate.simulation.session_notes import SessionNote, checked_note

KIND = "palpate session journal 1"
SUFFIX = ".journal"
LONGEST = 2**26  # bytes of a line; half a second of four tools takes 0.2 MB
FLAGS = os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0)


def journal_path(record: str | Path) -> Path:
    """The journal of the session that will be written to `record`."""
    record = Path(record)
    return record if record.name.endswith(SUFFIX) else record.with_name(record.name + SUFFIX)


class SessionJournal:
    """A journal that is being written; no other process can write it meanwhile.

    A disk that is full is noted once. What it did not take is kept and tried again with the next events.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._end = 0  # of the last whole line in the file
        self._waiting = b""
        self._told = [0, 0, 0]  # changes, marks and cuts that are written
        self._notes: tuple[SessionNote, ...] = ()  # that are written
        self._warned = False
        self._last: tuple[Any, ...] | None = None  # its columns, once it is closed
        try:
            self._file = _locked(path)
        except OSError as problem:
            raise FileError(
                f"{path}: cannot be written ({problem.strerror}); if another session records there, choose another name"
            ) from None

    def begin(self, head: dict[str, Any]) -> None:
        """Empties the file and writes the first line. Raises `FileError`."""
        os.ftruncate(self._file, 0)
        if problem := self._write({"kind": KIND, **head}):
            self.path.unlink()
            raise FileError(f"{self.path}: cannot be written ({problem.strerror}); choose another place for the record")

    def append(
        self,
        columns: Sequence[Any],
        changes: Sequence[Any],
        marks: Sequence[Any],
        cuts: Sequence[RecordedCut] = (),
        notes: tuple[SessionNote, ...] = (),
    ) -> None:
        """Adds events that came since the last call, all at once. changes, marks, cuts, notes: all of the session."""
        packed = {
            name: base64.b64encode(np.asarray(column).tobytes()).decode()
            for name, column in zip(COLUMNS, columns, strict=True)
            if len(column)
        }
        line = {**packed, "changes": changes[self._told[0] :], "marks": marks[self._told[1] :]}
        if len(cuts) > self._told[2]:
            line["cuts"] = [plain_cut(one) for one in cuts[self._told[2] :]]
        if notes != self._notes:  # all of them: one may have been removed
            line["notes"] = [(note.tick, note.point, note.text) for note in notes]
        self._told, self._notes = [len(changes), len(marks), len(cuts)], notes
        problem = self._write(line)
        if problem and not self._warned:
            self._warned = True
            warnings.warn(
                f"{self.path}: {problem.strerror}; the session goes on and is kept in memory: make room before it ends",
                stacklevel=2,
            )

    def remove(self) -> None:
        """Closes and removes the file."""
        self.close()
        self.path.unlink(missing_ok=True)

    def close(self) -> None:
        """Closes the file and leaves it."""
        self._last = self.columns()
        os.close(self._file)

    def columns(self) -> tuple[Any, ...]:
        """All of the loop's events that it was given, also those that the disk has not taken yet, as `COLUMNS`."""
        if self._last is not None:
            return self._last
        os.lseek(self._file, 0, os.SEEK_SET)
        written = bytearray()
        while len(written) < self._end and (part := os.read(self._file, self._end - len(written))):
            written += part
        lines = (bytes(written) + self._waiting).splitlines()[1:]
        return tuple(event_columns([json.loads(line.partition(b" ")[2]) for line in lines]).values())

    def _write(self, content: dict[str, Any]) -> OSError | None:
        text = json.dumps(content).encode()
        self._waiting += b"%08x %s\n" % (zlib.crc32(text), text)
        try:
            os.lseek(self._file, self._end, os.SEEK_SET)
            rest = memoryview(self._waiting)
            while rest:
                rest = rest[os.write(self._file, rest) :]
            os.fsync(self._file)
        except OSError as problem:
            return problem
        self._end += len(self._waiting)
        self._waiting = b""
        return None


def event_columns(pieces: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The loop's events in the lines of a journal, by name."""
    columns: dict[str, Any] = {
        name: np.frombuffer(b"".join(base64.b64decode(piece.get(name, "")) for piece in pieces), dtype)
        for name, (dtype, _) in COLUMNS.items()
    }
    for name in ("points", "displacements"):
        columns[name] = columns[name].reshape(-1, 3)
    return columns


def read_journal(path: Path) -> dict[str, Any] | None:
    """What `Record` is made of, up to the last digest; None if the session died before its first.

    All events before a digest are in its line or an earlier one. Of later ones some may be missing, so they are left out.
    Raises `FileError` for what is no file, and an error of Python's own if the checksums fit what no session wrote.
    """
    lines = _whole_lines(path)
    if not lines or lines[0].pop("kind", None) != KIND:
        return None
    head, *pieces = lines
    record = event_columns(pieces)
    if not record["digest_ticks"].size:
        return None
    length = int(record["digest_ticks"][-1])
    obeyed, switched = record["ticks"] < length, record["switches"] < length
    for name in ("ticks", "tools", "kinds", "points", "displacements"):
        record[name] = record[name][obeyed]
    for name in ("switches", "lacking"):
        record[name] = record[name][switched]
    changes = tuple(tuple(change) for piece in pieces for change in piece["changes"] if change[0] < length)
    marks = tuple(tuple(mark) for piece in pieces for mark in piece["marks"] if mark[0] <= length)
    cuts = tuple(cut_of(one) for piece in pieces for one in piece.get("cuts", ()) if one[0] < length)
    noted: Sequence[Any] = next((piece["notes"] for piece in reversed(pieces) if "notes" in piece), ())
    notes = tuple(checked_note(tick, tuple(point), text) for tick, point, text in noted if tick <= length)
    return {**head, **record, "length": length, "changes": changes, "marks": marks, "cuts": cuts, "notes": notes}


def _whole_lines(path: Path) -> list[dict[str, Any]]:
    found = []
    with existing_file(path).open("rb") as file:
        while (line := file.readline(LONGEST)).endswith(b"\n"):
            checksum, _, text = line.removesuffix(b"\n").partition(b" ")
            if checksum != b"%08x" % zlib.crc32(text):
                break
            found.append(dict(parse_json(text)))
    return found


def _locked(path: Path) -> int:
    """The file, made if need be, open and locked. Raises `OSError`."""
    while True:
        file = os.open(path, FLAGS, 0o666)
        if sys.platform == "win32":
            return file
        import fcntl

        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if path.exists() and os.path.samestat(os.fstat(file), path.stat()):
                return file
        except OSError:
            os.close(file)
            raise
        os.close(file)  # its writer has just removed it
