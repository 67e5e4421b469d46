"""The process of one room: its session and the server of its pages, on loopback, for the gateway alone.

    python -m palpate.rooms.room_server

It reads one line of JSON from its standard input: what the room holds, and the gateway's token. Once pages can come it writes
a line with its port, or with what is wrong. Whenever a cut or a note is made or taken back it writes a line with all of
them, which it is given again if it dies. When its input ends, as it does when the gateway dies, it writes its record and
ends.
"""

import contextlib
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from threading import Event, Thread
from typing import Any, TextIO

import numpy as np

from palpate import _core
from palpate.errors import DataError, PalpateError
from palpate.meshes.cutting.blade import Blade
from palpate.server.exam import Exam
from palpate.server.lesson_server import exam_session
from palpate.server.live_session import LiveSession
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import replayed, running_session, write_records
from palpate.simulation.cut_bodies import blades_of
from palpate.simulation.lesson import read_lesson
from palpate.simulation.pointer import Pointer
from palpate.simulation.recording import read_record, recovered
from palpate.simulation.session import Session
from palpate.simulation.session_cuts import RecordedCut
from palpate.simulation.session_journal import journal_path
from palpate.simulation.session_notes import SessionNote
from palpate.simulation.starting_model import starting_model
from palpate.tissue.cutting import cut
from palpate.tissue.io import read_tissue
from palpate.tissue.models.registry import model as build
from palpate.tissue.tissue import Tissue

LOOK = 0.2  # s between looks whether a cut or a note has been made
BEHIND = (
    15  # niceness of threads that compute ahead: hands wait for the gateway, which has no more time than each of these
)


def main() -> None:
    """Serves until the input ends."""
    out = sys.stdout
    sys.stdout = sys.stderr  # lines are for the gateway
    room = json.loads(sys.stdin.readline())
    _core.base.set_background_niceness(BEHIND)
    try:
        live, own = opened(room)
        with contextlib.closing(loopback_socket(0)) as listener, running_session(live, listener, room["token"]):
            print(json.dumps({"port": listener.getsockname()[1]}), file=out, flush=True)
            ended = Event()
            teller = Thread(target=tell_states, args=(live, own, out, ended))
            teller.start()
            sys.stdin.read()
            ended.set()
            teller.join()
        if live.record is not None:
            write_records(live.record, [*live.finished, live.session])
    except PalpateError as problem:
        print(json.dumps({"problem": str(problem)}), file=out, flush=True)
        sys.exit(2)


def tell_states(live: LiveSession, own: int, out: TextIO, ended: Event) -> None:
    """Writes a line whenever a cut or a note has been made or taken back, and a last one at the end, if need be."""
    told, last = "", False
    while not last:
        last = ended.wait(LOOK)
        if (state := json.dumps({"state": state_of(live, own)})) != told:
            print(state, file=out, flush=True)
            told = state


def opened(room: dict[str, Any]) -> tuple[LiveSession, int]:
    """The session of a room, with the cuts and notes of one that died, and how many cuts its file has."""
    if room["lesson"]:
        return exam_room(room), 0
    organs = {Path(path).stem: read_tissue(path) for path in room["organs"]}
    if room["replay"]:
        records = {f"{room['title']}: {Path(path).stem}": read_record(path) for path in room["replay"]}
        return replayed(records, organs, room["tension"], [], room["name"]), 0
    first = next(iter(organs.values()))
    record = None if room["record"] is None else Path(room["record"])
    state = room["state"] or state_before(record)
    cuts = [Blade(np.array(points), np.array(triangles)) for points, triangles in state["cuts"]]
    tissue = with_cuts(first, cuts)
    options = {name: room[name] for name in ("radius", "tension", "toughness")}
    reason = successor = ""
    if room["model"] or cuts:
        session = Session(build(tissue, room["model"] or "compliance"), **options)
    else:
        found = starting_model(tissue, room["radius"])
        session = Session(found.model, **options)
        reason, successor = found.reason, found.successor
    if cuts:
        organs = {**organs, next(iter(organs)): tissue}
    session.events.notes = tuple(SessionNote(0, tuple(point), text) for point, text in state["notes"])
    named = {"reason": reason, "successor": successor, "room": room["name"]}
    return LiveSession(session, Pointer(), room["title"], organs, record=record, **named), len(blades_of(first))


def exam_room(room: dict[str, Any]) -> LiveSession:
    """A case of a lesson, which all in the room take together. One that died begins anew, but for the claims."""
    exam = Exam(read_lesson(room["lesson"]), room["seed"])
    exam.claims = (room["state"] or {}).get("claims", 0)
    record = None if room["record"] is None else Path(room["record"])
    asked, title = exam.lesson.asked, exam.lesson.title
    return LiveSession(exam_session(exam), Pointer(), title, task=asked, record=record, exam=exam, room=room["name"])


def state_of(live: LiveSession, own: int) -> dict[str, Any]:
    """The cuts of the room's first organ but for its file's `own`, and the notes, as JSON can hold them; none of a replay.

    Of an exam how many claims were made.
    """
    if live.is_replay or live.exam:
        return described([], ()) | ({"claims": live.exam.claims} if isinstance(live.exam, Exam) else {})
    first = (*live.finished, live.session)[0]
    return described(blades_of(first.tissue)[own:], live.notes)


def state_before(record: Path | None) -> dict[str, Any]:
    """That of a session whose server died with all that it knew: from its journal, if there is one."""
    left = None if record is None or not journal_path(record).is_file() else recovered(journal_path(record))
    return described([], ()) if left is None else described(active_cuts(left.cuts), left.notes)


def described(cuts: Sequence[Blade], notes: Sequence[SessionNote]) -> dict[str, Any]:
    """Cuts and notes, as JSON can hold them."""
    return {
        "cuts": [[blade.points.tolist(), blade.triangles.tolist()] for blade in cuts],
        "notes": [[note.point, note.text] for note in notes],
    }


def active_cuts(cuts: Sequence[RecordedCut]) -> list[Blade]:
    """The blades of the cuts that are there at the end of a session."""
    blades: list[Blade] = []
    for one in cuts:
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
        raise DataError(
            f"the cuts that were kept do not fit this organ ({problem}); give the room another name"
        ) from None
    return tissue


if __name__ == "__main__":
    main()
