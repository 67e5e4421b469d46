"""Messages between page and server, and the enumerations in them; `web/generate_messages.py` writes the TypeScript.

Binary messages are little-endian: a byte for the kind of message, the fields in order, then at most one array. A text
message from the server is shown to the user.
"""

import json
import struct
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from enum import IntEnum
from typing import Annotated, Any, get_args, get_type_hints

from palpate.arrays import AnyArray, Float64
from palpate.meshes.display_surfaces import Part
from palpate.simulation.lesson import EXAM_FORCE, EXAM_LENGTH, EXAM_WORK
from palpate.simulation.pointer import TOOLS, CommandKind, ContactState
from palpate.simulation.session import LUMP, RATE, SAMPLE
from palpate.simulation.session_notes import LONGEST_NOTE, MOST_NOTES, SessionNote

# The second argument of each type is its format in Python's struct.
U8 = Annotated[int, "B"]
U32 = Annotated[int, "I"]
F32 = Annotated[float, "f"]
F64 = Annotated[float, "d"]
Vector = Annotated[tuple[float, float, float], "3f"]

DISPLACEMENT_STEPS = 32767  # of the 16-bit displacements in a `Frame`
DISTANCE_STEPS = 65535  # of the 16-bit distances in a `Difference`
SLOWEST, FASTEST = 0.25, 4.0  # speeds of a replay
AT_REST = 1e-4  # mm: smaller displacements are not sent


class SelectionKind(IntEnum):
    """What a `Selection` selects."""

    model = 0
    organ = 1


class CutStep(IntEnum):
    """What a `Scalpel` does."""

    begin = 0
    move = 1
    end = 2
    undo = 3


class NoteStep(IntEnum):
    """What a `Note` does."""

    add = 0
    remove = 1


class PlayStep(IntEnum):
    """What a `Play` does."""

    pause = 0
    play = 1
    speed = 2
    seek = 3


class MarkKind(IntEnum):
    """What a `Mark` says."""

    lump = LUMP
    sample = SAMPLE


class ComparisonState(IntEnum):
    """What a `Difference` holds."""

    preparing = 0
    compared = 1
    no_reference = 2
    contacts_overlap = 3


class TrialState(IntEnum):
    """What a forced-choice trial waits for: palpate, the answer, the end of a break, nothing any more."""

    preparing = 0
    asking = 1
    pause = 2
    ended = 3


class Feedback(IntEnum):
    """What is told of the last answer."""

    none = 0
    right = 1
    wrong = 2


class ChoiceKind(IntEnum):
    """What a `Choice` does."""

    show = 0
    answer = 1
    go_on = 2


class Role(IntEnum):
    """What a person may do in a room: watch, touch, or lead as well."""

    viewer = 0
    trainee = 1
    teacher = 2


class LeadStep(IntEnum):
    """What a `Lead` does."""

    freeze = 0
    resume = 1
    reset = 2
    take_over = 3
    release = 4


class CloseCode(IntEnum):
    """Codes with which the server closes a page's WebSocket (RFC 6455; from 4000 on they are the application's)."""

    refused = 1008
    too_many_pages = 1013
    scene_changed = 4001
    room_lost = 4002


@dataclass(frozen=True)
class ToolCommand:
    """Page to server: the command of one tool. kind: a `CommandKind`; serial: the number of the command.

    away: the tool lets go. hold: the tissue at `point` (mm, on the surface at rest) is displaced by `displacement` mm.
    needle: it enters at `point` (mm, on the surface at rest); `displacement` leads from there to the demanded position
    of its tip. free: the tip of the tool is at `point` in space (mm); contact follows from that.
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

    The tissue is cut along the way from `begin` on while the blade moves. undo: takes the last cut back.
    """

    step: U8
    depth: F32
    point: Vector


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
    """Server to page: where a replay is. there: share of the way to `tick` that is computed; less than 1: not there yet."""

    playing: U8
    speed: F32
    tick: F64
    there: F32


@dataclass(frozen=True)
class Timeline:
    """Server to page: then JSON, a list of `TimelineTrack`, one for each replay."""

    count: U32


@dataclass(frozen=True)
class TimelineEvent:
    """An event of a recorded session. kind: touch, release, cut, undo, model, claim, note or limit."""

    tick: int
    kind: str
    text: str


@dataclass(frozen=True)
class TimelineTrack:
    """A recorded session. length: ticks. forces: N, the greatest in each `bin` ticks, as far as they are computed."""

    title: str
    length: int
    bin: int
    events: list[TimelineEvent]
    forces: list[float]


@dataclass(frozen=True)
class NoteText:
    """A note: the tick at which it was made, its place on the surface at rest (mm), its text."""

    tick: int
    point: list[float]
    text: str


@dataclass(frozen=True)
class Lead:
    """Page to server: what a teacher does in a room. step: a `LeadStep`; person: whom it is about, else 0.

    freeze: tools of all others stay where they are until resume. reset: cuts are taken back and all tools let go.
    take_over: the teacher holds the person's tools, release: these let go; the person begins anew.
    """

    step: U8
    person: U32


@dataclass(frozen=True)
class People:
    """Server to page, in a room, at each change: then JSON, a list of `Person`. you: the page's own number."""

    you: U32
    frozen: U8


@dataclass(frozen=True)
class Person:
    """Somebody in a room. role: a `Role`."""

    number: int
    name: str
    role: int


@dataclass(frozen=True)
class Hands:
    """Server to page, in a room, before each `Frame`: the tools of all others.

    Then (count, 13) float32, a row a tool: the person's number, a `ContactState`, point (mm), displacement (mm), force (N),
    insertion (mm) and the tool's number for that person.
    """

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
class Frame:
    """Server to page: the state after one tick. Lengths in mm; force in N, of the tissue on the tool.

    contact: a `ContactState` for each tool. point, displacement, force: three numbers for each tool; the tool is drawn
    at point + displacement. insertion: mm of a needle in the tissue. serial: of the newest command obeyed. seconds: the
    loop's clock. busy: computing time of a tick in seconds, smoothed. late, faults: ticks that began late, answers of
    the model that were not finite. model, chosen: indices in the scene's models of the one that answers and of the one that
    was chosen last, which may still be built. energy: N mm that the tools have put into the
    tissue, stored or dissipated there. mesh_error: estimated error of the force that the mesh makes, relative to the
    force, positive if it is too large; NaN: not known. linearisation: that of linear strain, likewise. least_volume: of
    an element over its volume at rest, at least and by linear elasticity; negative: turned over. solution_age,
    solution_error: of a model at two rates, seconds since the contacts were those of its newest solution, and the
    estimated relative error of that one's force. body: of the `Scene` that was shown: after a cut it is fetched again.
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


@dataclass(frozen=True)
class Scene:
    """Server to page, once: a 32-bit length, then JSON of that length, padded with blanks to a multiple of 4 bytes.

    Then (nodes, 3) float32 mm at rest, then, if it gapes, (nodes, 3) float32 mm from there to where tension at rest has
    opened the cuts, then (triangles, 3) 32-bit integers, normals outwards, then, if organs lie beside each other, (nodes)
    32-bit integers, to which of them each node belongs. beside: their names, else empty. reach: mm, the longest
    displacement that a tool may ask for. limit: N, the largest force on a device. front: radians about z from -y
    towards +x, the direction from which the organ is first seen. models, organs: what can be selected while the session
    runs; organ: the index of this one. task: the trainee's task, or empty. reason: why the session begins with its model,
    or empty. images: whether there are slices to show (an `Album` at /album, its values as `palpate view` serves them).
    lips: numbers of the first node on the lips of cuts, in the organ and in each region inside. body: how often it was cut
    or a cut taken back; made: cuts that are there. depth: mm, of a cut at first. tools, views: what the page may offer; exam:
    whether it is an exam, in which nothing is shown that tells what is inside. question: of a forced-choice experiment, or
    empty. channel: how the force comes to the person in it. place: (x, y, z) mm, on the surface above where a lump may
    be, or empty. recorded: whether a record keeps notes. lumen: of a hollow organ, rows of x, y, z and radius (mm) and branch
    along its centre line; openings: rows of a point (mm) and the unit vector out of the lumen there. room: the name of the
    room, in which several people touch the organ, or empty.
    """

    title: str
    model: str
    nodes: int
    triangles: int
    parts: list[Part]
    gapes: bool
    lips: list[int]
    beside: list[str]
    body: int
    made: int
    depth: float
    tools: list[str]
    views: list[str]
    exam: bool
    question: str
    channel: str
    place: list[float]
    recorded: bool
    lumen: list[float]
    openings: list[float]
    elements: int
    radius: float
    reach: float
    limit: float
    rate: int
    replay: bool
    front: float
    models: list[str]
    organs: list[str]
    organ: int
    task: str
    reason: str
    images: bool
    room: str


@dataclass(frozen=True)
class Window:
    """A display window: values from low (black) to high (white). hint: how they were chosen."""

    name: str
    low: float
    high: float
    hint: str


@dataclass(frozen=True)
class Stack:
    """An array (z, y, x) or (view, row, column), little-endian, fetched separately; NaN: not measured."""

    name: str
    unit: str
    kind: str
    windows: list[Window]


@dataclass(frozen=True)
class Image:
    """A volume or a scan for `palpate view`. spacing: (z, y, x) mm, of a scan (1, row, column). origin: (x, y, z) mm.

    direction: 3x3 row by row; its columns are the axes x, y, z. patient: these axes point left, posterior, superior;
    otherwise they are those of a reconstruction. file: 3x4 row by row, the affine map from an index here to an index of
    the given array. water: attenuation of water, 1/mm, or 0 if unknown. note: text that the page shows about the data.
    captions: of each view of a scan.
    """

    title: str
    scan: bool
    shape: list[int]
    spacing: list[float]
    origin: list[float]
    direction: list[float]
    patient: bool
    file: list[float]
    water: float
    note: str
    captions: list[str]
    stacks: list[Stack]


@dataclass(frozen=True)
class Album:
    """Server to page, once, as JSON: the images to view, one or two."""

    images: list[Image]


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
]
FROM_PAGE: list[type] = [ToolCommand, Selection, Mark, Compare, Scalpel, Choice, Note, Play, Lead, Detail, Seen]
JSON: list[type] = [Part, NoteText, TimelineEvent, TimelineTrack, Person, Scene, Window, Stack, Image, Album]
ENUMS: list[type[IntEnum]] = [
    CommandKind, ContactState, SelectionKind, MarkKind, NoteStep, PlayStep, CutStep, ComparisonState, TrialState, Feedback,
    ChoiceKind, Role, LeadStep, CloseCode,
]  # fmt: skip
CONSTANTS = {
    "TOOLS": TOOLS,
    "DISTANCE_STEPS": DISTANCE_STEPS,
    "DISPLACEMENT_STEPS": DISPLACEMENT_STEPS,
    "AT_REST": AT_REST,
    "EXAM_LENGTH": EXAM_LENGTH,
    "EXAM_FORCE": EXAM_FORCE,
    "EXAM_WORK": EXAM_WORK,
    "LONGEST_NOTE": LONGEST_NOTE,
    "MOST_NOTES": MOST_NOTES,
    "RATE": RATE,
    "SLOWEST": SLOWEST,
    "FASTEST": FASTEST,
}


def code(message: type) -> str:
    """Format of a binary message in Python's struct, its kind included, padded to a multiple of 4 bytes."""
    hints = get_type_hints(message, include_extras=True)
    exact = "<B" + "".join(get_args(hints[field.name])[1] for field in fields(message))
    return exact + "x" * (-struct.calcsize(exact) % 4)


def encode(message: Any, rest: AnyArray | None = None) -> bytes:
    """A binary message, followed by the array `rest`."""
    flat = [BINARY.index(type(message)) + 1]
    for field in fields(message):
        value = getattr(message, field.name)
        flat.extend(value) if isinstance(value, tuple) else flat.append(value)
    return struct.pack(code(type(message)), *flat) + (b"" if rest is None else rest.tobytes())


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
