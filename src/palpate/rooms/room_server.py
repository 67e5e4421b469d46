"""The process of one room: its session and the server of its pages, on loopback, for the gateway alone.

    python -m palpate.rooms.room_server

It reads one line of JSON from its standard input: what the room holds, and the gateway's token. Once pages can come it writes
a line with its port and with the cuts that it began with, which it is given again if it dies; or a line with what is wrong.
When its input ends, as it does when the gateway dies, it writes its record and ends.
"""

import contextlib
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from palpate.errors import DataError, PalpateError
from palpate.meshes.cutting.blade import Blade
from palpate.server.live_session import LiveSession
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import running_session, write_records
from palpate.simulation.pointer import Pointer
from palpate.simulation.recording import Record, recovered
from palpate.simulation.session import Session
from palpate.simulation.session_journal import journal_path
from palpate.simulation.session_notes import SessionNote
from palpate.simulation.starting_model import starting_model
from palpate.tissue.cutting import cut
from palpate.tissue.io import read_tissue
from palpate.tissue.models.registry import model as build
from palpate.tissue.tissue import Tissue


def main() -> None:
    """Serves until the input ends."""
    out = sys.stdout
    sys.stdout = sys.stderr  # lines are for the gateway
    room = json.loads(sys.stdin.readline())
    try:
        live, blades = opened(room)
        with contextlib.closing(loopback_socket(0)) as listener, running_session(live, listener, room["token"]):
            cuts = [[blade.points.tolist(), blade.triangles.tolist()] for blade in blades]
            print(json.dumps({"port": listener.getsockname()[1], "cuts": cuts}), file=out, flush=True)
            sys.stdin.read()
        if live.record is not None:
            write_records(live.record, [*live.finished, live.session])
    except PalpateError as problem:
        print(json.dumps({"problem": str(problem)}), file=out, flush=True)
        sys.exit(2)


def opened(room: dict[str, Any]) -> tuple[LiveSession, list[Blade]]:
    """The session of a room, with the cuts and notes of one that died; and these cuts. Raises what reading does."""
    organs = {Path(path).stem: read_tissue(path) for path in room["organs"]}
    first = next(iter(organs.values()))
    record = None if room["record"] is None else Path(room["record"])
    left = None if record is None or not journal_path(record).is_file() else recovered(journal_path(record))
    given = [Blade(np.array(points), np.array(triangles)) for points, triangles in room["cuts"]]
    cuts = given if left is None else [*given, *active_cuts(left)]
    tissue = with_cuts(first, cuts)
    options = {"radius": room["radius"], "tension": room["tension"]}
    reason = successor = ""
    if room["model"] or cuts:
        session = Session(build(tissue, room["model"] or "compliance"), **options)
    else:
        found = starting_model(tissue, room["radius"])
        session = Session(found.model, **options)
        reason, successor = found.reason, found.successor
    if cuts:
        organs = {**organs, next(iter(organs)): tissue}
    if left is not None:
        session.events.notes = tuple(SessionNote(0, note.point, note.text) for note in left.notes)
    named = {"reason": reason, "successor": successor, "room": room["name"]}
    return LiveSession(session, Pointer(), room["title"], organs, record=record, **named), cuts


def active_cuts(record: Record) -> list[Blade]:
    """The blades of a record's cuts that are there at its end."""
    blades: list[Blade] = []
    for one in record.cuts:
        if one.kind != "cut":
            blades.pop()
        if one.blade is not None:
            blades.append(one.blade)
    return blades


def with_cuts(tissue: Tissue, blades: list[Blade]) -> Tissue:
    """The tissue after all cuts. Raises `DataError` if it cannot be cut so: the journal is another tissue's."""
    try:
        for blade in blades:
            tissue = cut(tissue, blade)
    except PalpateError as problem:
        raise DataError(f"journal: its cuts do not fit this organ ({problem}); move it away to begin anew") from None
    return tissue


if __name__ == "__main__":
    main()
