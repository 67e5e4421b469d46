"""Reads the sessions that an exported page saves, as JSON (web/src/engine/session-record.ts)."""

from pathlib import Path
from typing import Any

import numpy as np

from palpate.bounded_read import existing_file, parse_json
from palpate.errors import DataError, FileError
from palpate.simulation.session_cuts import cut_of
from palpate.simulation.session_notes import MOST_NOTES, checked_note

FORMAT, VERSION = "palpate page session", 1
LONGEST = 512 * 2**20  # bytes: a day of a hand that never rests


def read_page_record(path: str | Path) -> dict[str, Any]:
    """The fields of a `Record`. Raises `FileError` if the file is missing, damaged or of another kind."""
    path = existing_file(path)
    if path.stat().st_size > LONGEST:
        raise FileError(f"{path}: {path.stat().st_size} bytes, expected {LONGEST} at most; check the name")
    return parse_page_record(path.read_bytes(), path)


def parse_page_record(text: bytes, path: str | Path) -> dict[str, Any]:
    """The same, of a text; path: what messages call it."""
    try:
        saved = parse_json(text)
        found = (saved.get("format"), saved.get("version"))
        if found != (FORMAT, VERSION):
            raise FileError(
                f"{path}: format and version are {found}, expected {(FORMAT, VERSION)}; save the session in the page again"
            )
        commands = np.array(saved["commands"], dtype=np.float64).reshape(-1, 9)
        if not np.isfinite(commands).all():
            raise ValueError("a command is not finite")
        if (commands[:, :3] < 0).any() or (commands[:, 1:3] > 255).any():
            raise ValueError("a tick, tool or kind that there is not")
        switches = np.array(saved["switches"], dtype=np.int64).reshape(-1, 2)
        if (switches < 0).any() or (switches[:, 1] > 255).any():
            raise ValueError("a switch of tables that there is not")
        return {
            "ticks": commands[:, 0].astype(np.int64),
            "tools": commands[:, 1].astype(np.uint8),
            "kinds": commands[:, 2].astype(np.uint8),
            "points": np.ascontiguousarray(commands[:, 3:6]),
            "displacements": np.ascontiguousarray(commands[:, 6:9]),
            "length": int(saved["length"]),
            "digest_ticks": np.array([ticks for ticks, _ in saved["digests"]], dtype=np.int64),
            "digests": np.array([int(digits, 16) for _, digits in saved["digests"]], dtype=np.uint64),
            "switches": np.ascontiguousarray(switches[:, 0]),
            "lacking": switches[:, 1].astype(np.uint8),
            "model": str(saved["model"]),
            "tissue": str(saved["tissue"]),
            "settings": {str(name): float(value) for name, value in saved["settings"].items()},
            "instructions": str(saved["instructions"]),
            "lesson": str(saved.get("lesson", "")),
            "marks": tuple((int(tick), int(what), int(tool)) for tick, what, tool in saved["marks"]),
            "cuts": tuple(cut_of(one) for one in saved.get("cuts", ())),
            "notes": tuple(
                checked_note(int(tick), (float(x), float(y), float(z)), str(text))
                for tick, x, y, z, text in saved.get("notes", ())[:MOST_NOTES]
            ),
        }
    except (FileError, MemoryError):
        raise
    except (AttributeError, DataError, KeyError, OverflowError, TypeError, ValueError) as problem:
        raise FileError(f"{path}: no session that a page saved ({problem}); save it again") from None
