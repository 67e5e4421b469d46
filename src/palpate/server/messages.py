"""Binary messages between page and server; `web/generate_messages.py` writes the TypeScript.

Binary messages are little-endian: a byte for the kind of message, the fields in order, then at most one array. A text
message from the server is shown to the user.
"""

import hashlib
import json
import struct
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from functools import cache
from typing import Annotated, Any, get_args, get_type_hints

from palpate.arrays import AnyArray, Float64
from palpate.server.json_messages import (
    NoteText,
    TimelineEvent,
    TimelineTrack,
)
from palpate.simulation.session_notes import SessionNote

# The second argument of each type is its format in Python's struct.
U8 = Annotated[int, "B"]
U32 = Annotated[int, "I"]
F32 = Annotated[float, "f"]
F64 = Annotated[float, "d"]
Vector = Annotated[tuple[float, float, float], "3f"]

DISPLACEMENT_STEPS = 32767  # of the 16-bit displacements in a `Frame`
DISTANCE_STEPS = 65535  # of the 16-bit distances in a `Difference`
SLOWEST, FASTEST = 0.25, 4.0  # speeds of a replay
GUIDANCE_LIMIT = 1.0  # N, of the force between a guiding hand and the guided one
AT_REST = 1e-4  # mm: smaller displacements are not sent


@dataclass(frozen=True)
class ToolCommand:
    """Page to server: the command of one tool. kind: a `CommandKind`; serial: the number of the command.

    away: the tool lets go. hold: the tissue at `point` (mm, on the surface at rest) is displaced by `displacement` mm.
    needle: it enters at `point` (mm, on the surface at rest); `displacement` leads from there to the demanded position
    of its tip. free: the tip of the tool is at `point` in space (mm); contact follows from that. carry: a piece that a cut
    has freed is held at `point` (mm, where it came free) and moved by `displacement` from there.
    """

    tool: U8
    kind: U8
    serial: U32
    point: Vector
    displacement: Vector


@dataclass(frozen=True)
class Selection:
    """Page to server: selects one of the scene's `models` or `organs` by index. kind: a `SelectionKind`."""

    kind: U8
    index: U8


@dataclass(frozen=True)
class Mark:
    """Page to server: the user found a lump under this tool, or takes a sample with it. kind: a `MarkKind`."""

    kind: U8
    tool: U8


@dataclass(frozen=True)
class Scalpel:
    """Page to server: the blade goes to `point` (mm, on the surface at rest), `depth` mm deep. step: a `CutStep`.

    The tissue is cut along the way from `begin` on while the blade moves. undo: takes the last cut back. direction: of the
    whole stroke's blade, as `begin` has it; (0, 0, 0): against the surface's mean normal.
    """

    step: U8
    depth: F32
    point: Vector
    direction: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Choice:
    """Page to server: shows an interval (1 or 2) of a trial, answers with it, or ends a break. kind: a `ChoiceKind`.

    trial: its number from 1 on; what is meant for another one is left undone.
    """

    kind: U8
    interval: U8
    trial: U32


@dataclass(frozen=True)
class TrialStatus:
    """Server to page: where a forced-choice experiment is. state: a `TrialState`; told: a `Feedback`.

    trial: its number from 1 on, of `trials`. shown: the interval that can be touched. touched: 1 and 2 (bits) for the
    intervals that were.
    """

    state: U8
    trial: U32
    trials: U32
    shown: U8
    touched: U8
    told: U8


@dataclass(frozen=True)
class Note:
    """Page to server: a note at `point` (mm, on the surface at rest). step: a `NoteStep`. index: of the one to be removed.

    Then its text in UTF-8: of one that is removed too, so that no other one is.
    """

    step: U8
    index: U8
    point: Vector


@dataclass(frozen=True)
class Notes:
    """Server to page, when it connects and at each change: then JSON, a list of `NoteText`, all that there are."""

    count: U32


@dataclass(frozen=True)
class Play:
    """Page to server: plays a replay, pauses it, sets its speed, goes to a tick. step: a `PlayStep`; value: speed or tick."""

    step: U8
    value: F64


@dataclass(frozen=True)
class Position:
    """Server to page: where a replay is. there: share of the way to `tick` that is computed; less than 1: not there yet.

    sought: how often pages have asked for a tick. A page that has asked knows by this count which message answers it.
    """

    playing: U8
    speed: F32
    tick: F64
    there: F32
    sought: U32


@dataclass(frozen=True)
class Timeline:
    """Server to page: then JSON, a list of `TimelineTrack`, one for each replay."""

    count: U32


@dataclass(frozen=True)
class Lead:
    """Page to server: what a teacher does in a room. step: a `LeadStep`; person: whom it is about, else 0.

    freeze: tools of all others stay where they are until resume. reset: cuts are taken back and all tools let go.
    take_over: the teacher holds the person's tools, release: these let go; the person begins anew. guide: the teacher's hand
    guides the person's from when both hold the organ until one lets go, or end_guidance.
    """

    step: U8
    person: U32


@dataclass(frozen=True)
class People:
    """Server to page, in a room, at each change: then JSON, a list of `Person`. you: the page's own number."""

    you: U32
    frozen: U8


@dataclass(frozen=True)
class Hands:
    """Server to page, in a room, before each `Frame`: the tools of all others.

    Then (count, 13) float32, a row a tool: the person's number, a `ContactState`, point (mm), displacement (mm), force (N),
    insertion (mm) and the tool's number for that person.
    """

    count: U32


@dataclass(frozen=True)
class Pieces:
    """Server to page, before each `Frame` while there are pieces that cuts have freed. body: of the `Scene` that has them.

    Then (count, 4) float32, a row a piece: a `PieceState`, and how far it is from where it came free (mm).
    """

    body: U32
    count: U32


@dataclass(frozen=True)
class Detail:
    """Page to server, in a room: 0 asks for frames without displacements, since it computes them, 1 for whole ones.

    A frame without them has count 0 and a step that is not 0.
    """

    whole: U8


@dataclass(frozen=True)
class Seen:
    """Page to server, some ten times a second: so many frames have come on this connection."""

    count: U32


@dataclass(frozen=True)
class Guidance:
    """Server to page, in a room, at each change, and before each `Frame` while a teacher guides: who guides whose hand.

    state: a `GuidanceState`. number: counts guidances. teacher, trainee: the persons' numbers, and their own ones of the two
    tools. at: mm, where the tool was commanded to be last. given: N mm, energy that its end of the coupling has given to
    the other one. force: N, of the coupling on the hand, as its page says.
    """

    state: U8
    number: U32
    teacher: U32
    trainee: U32
    teacher_tool: U8
    trainee_tool: U8
    teacher_at: Vector
    trainee_at: Vector
    teacher_given: F64
    trainee_given: F64
    teacher_force: Vector
    trainee_force: Vector


@dataclass(frozen=True)
class Guided:
    """Page to server, while its hand guides or is guided: what a `Guidance` tells of this end. number: of the guidance."""

    number: U32
    given: F64
    force: Vector


@dataclass(frozen=True)
class Frame:
    """Server to page: the state after one tick. Lengths in mm; force in N, of the tissue on the tool.

    contact: a `ContactState` for each tool. point, displacement, force: three numbers for each tool; the tool is drawn
    at point + displacement. insertion: mm of a needle in the tissue. serial: of the newest command obeyed. seconds: the
    loop's clock. busy: computing time of a tick in seconds, smoothed. late, faults: ticks that began late, answers of
    the model that were not finite. model, chosen: indices in the scene's models of the one that answers and of the one that
    was chosen last, which may still be built. energy: N mm that the tools have put into the
    tissue, stored or dissipated there. mesh_error: estimated error of the force that the mesh makes, relative to the
    force, positive if it is too large; NaN: not known. linearisation: that of linear strain, likewise. stiffness_spread:
    standard deviation of the force, relative to it, that follows from that of the stiffness. least_volume: of an element
    over its volume at rest, at least and by linear elasticity; negative: turned over. solution_age, solution_error: of a
    model at two rates, seconds since the contacts were those of its newest solution, and the estimated relative error of
    that one's force. body: of the `Scene` that was shown: after a cut it is fetched again.
    Then (count, 3) 16-bit integers: the displacements of the first `count` shown nodes (0 or all) in units of `step` mm.
    """

    model: U8
    tick: F64
    late: F64
    faults: U32
    serial: U32
    seconds: F64
    busy: F32
    energy: F32
    contact: Annotated[tuple[int, ...], "4B"]
    point: Annotated[tuple[float, ...], "12f"]
    displacement: Annotated[tuple[float, ...], "12f"]
    force: Annotated[tuple[float, ...], "12f"]
    insertion: Annotated[tuple[float, ...], "4f"]
    chosen: U8
    mesh_error: F32
    linearisation: F32
    stiffness_spread: F32
    least_volume: F32
    solution_age: F32
    solution_error: F32
    body: U32
    step: F32
    count: U32


@dataclass(frozen=True)
class Compare:
    """Page to server: 1 asks the server to send a `Difference` from time to time, 0 asks it to stop."""

    on: U8


@dataclass(frozen=True)
class Difference:
    """Server to page, on request: the distance of one tick's state from linear finite elements under the same contacts.

    state: a `ComparisonState`. force: N, of the tissue on each tool by the reference, three numbers for each tool.
    force_error: norm of the difference of all forces over the norm of the reference's. Then (count,) 16-bit integers:
    the distance of each shown node from its position by the reference, in units of `step` mm; count 0: zero everywhere.
    """

    state: U8
    tick: F64
    force: Annotated[tuple[float, ...], "12f"]
    force_error: F32
    step: F32
    count: U32


BINARY: list[type] = [
    ToolCommand,
    Frame,
    Selection,
    Mark,
    Compare,
    Difference,
    Scalpel,
    Choice,
    TrialStatus,
    Note,
    Notes,
    Play,
    Position,
    Timeline,
    Lead,
    People,
    Hands,
    Detail,
    Seen,
    Guidance,
    Guided,
    Pieces,
]
FROM_PAGE: list[type] = [ToolCommand, Selection, Mark, Compare, Scalpel, Choice, Note, Play, Lead, Detail, Seen, Guided]


def code(message: type) -> str:
    """Format of a binary message in Python's struct, its kind included, padded to a multiple of 4 bytes."""
    return layout(message).format


@cache
def layout(message: type) -> struct.Struct:
    """How a binary message is packed, its kind included, padded to a multiple of 4 bytes."""
    hints = get_type_hints(message, include_extras=True)
    exact = "<B" + "".join(get_args(hints[field.name])[1] for field in fields(message))
    return struct.Struct(exact + "x" * (-struct.calcsize(exact) % 4))


@cache
def kind_of(message: type) -> int:
    """The first byte of a binary message."""
    return BINARY.index(message) + 1


def protocol() -> str:
    """A digest of all binary messages: two ends understand each other if theirs agree."""
    text = "".join(f"{one.__name__} {[field.name for field in fields(one)]} {code(one)}\n" for one in BINARY)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


PROTOCOL = protocol()


def encode(message: Any, rest: AnyArray | None = None) -> bytes:
    """A binary message, followed by the array `rest`."""
    kind: type = type(message)
    packed: list[Any] = [kind_of(kind)]
    for value in vars(message).values():  # in the order of the fields
        packed.extend(value) if isinstance(value, tuple) else packed.append(value)
    return layout(kind).pack(*packed) + (b"" if rest is None else rest.tobytes())


def decode_told(one: type, data: bytes) -> Any:
    """A message that the server sent, without its array. Raises `struct.error` if it is too short."""
    _, *values = layout(one).unpack_from(data)
    hints, told = get_type_hints(one, include_extras=True), []
    for field in fields(one):
        count = int(get_args(hints[field.name])[1][:-1] or 0)
        told.append(tuple(values[:count]) if count else values[0])
        del values[: count or 1]
    return one(*told)


def flat(vectors: Any) -> tuple[float, ...]:
    """The numbers of several vectors, one vector after the other."""
    return tuple(x for vector in vectors for x in vector)


def notes_bytes(notes: tuple[SessionNote, ...]) -> bytes:
    """Notes as a message."""
    told = [asdict(NoteText(note.tick, list(note.point), note.text)) for note in notes]
    return encode(Notes(len(notes))) + json.dumps(told).encode()


def timeline_bytes(tracks: Sequence[tuple[str, int, int, Sequence[Any], Float64]]) -> bytes:
    """A timeline as a message. tracks: title, length, ticks of a bin, events and forces of each replay."""
    told = [
        TimelineTrack(
            title, length, width, [TimelineEvent(e.tick, e.kind, e.text) for e in events], forces.round(3).tolist()
        )
        for title, length, width, events, forces in tracks
    ]
    return encode(Timeline(len(told))) + json.dumps([asdict(track) for track in told]).encode()
