"""Messages between page and server, and the enumerations in them; `web/generate_messages.py` writes the TypeScript.

Binary messages are little-endian: a byte for the kind of message, the fields in order, then at most one array. A text
message from the server is shown to the user.
"""

import struct
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Annotated, Any, get_args, get_type_hints

import numpy as np

from palpate.arrays import AnyArray, Float32
from palpate.errors import DataError
from palpate.meshes.display_surfaces import Part
from palpate.server.force_errors import ForceErrors
from palpate.simulation.lesson import EXAM_FORCE, EXAM_LENGTH, EXAM_WORK
from palpate.simulation.pointer import TOOLS, CommandKind, ContactState
from palpate.simulation.session import LUMP, SAMPLE

# The second argument of each type is its format in Python's struct.
U8 = Annotated[int, "B"]
U32 = Annotated[int, "I"]
F32 = Annotated[float, "f"]
F64 = Annotated[float, "d"]
Vector = Annotated[tuple[float, float, float], "3f"]

DISPLACEMENT_STEPS = 32767  # of the 16-bit displacements in a `Frame`
DISTANCE_STEPS = 65535  # of the 16-bit distances in a `Difference`
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


class CloseCode(IntEnum):
    """Codes with which the server closes a page's WebSocket (RFC 6455; from 4000 on they are the application's)."""

    refused = 1008
    too_many_pages = 1013
    scene_changed = 4001


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
    whether it is an exam, in which nothing is shown that tells what is inside.
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


BINARY: list[type] = [ToolCommand, Frame, Selection, Mark, Compare, Difference, Scalpel]
FROM_PAGE: list[type] = [ToolCommand, Selection, Mark, Compare, Scalpel]
JSON: list[type] = [Part, Scene, Window, Stack, Image, Album]
ENUMS: list[type[IntEnum]] = [
    CommandKind, ContactState, SelectionKind, MarkKind, CutStep, ComparisonState, CloseCode,
]  # fmt: skip
CONSTANTS = {
    "TOOLS": TOOLS,
    "DISTANCE_STEPS": DISTANCE_STEPS,
    "DISPLACEMENT_STEPS": DISPLACEMENT_STEPS,
    "AT_REST": AT_REST,
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


def decode(data: bytes) -> ToolCommand | Selection | Mark | Compare | Scalpel:
    """The message that a page sent. Raises `DataError` if its length, kind or a number in it is wrong."""
    sent: type = {BINARY.index(one) + 1: one for one in FROM_PAGE}.get(data[0] if data else 0, type(None))
    if sent is type(None):
        found = data[0] if data else "none"
        raise DataError(
            f"message: kind {found}, expected {[BINARY.index(one) + 1 for one in FROM_PAGE]}; reload the page"
        )
    name, wanted = sent.__name__, struct.calcsize(code(sent))
    if len(data) != wanted:
        raise DataError(f"{name}: {len(data)} bytes, expected {wanted}; reload the page")
    _, *values = struct.unpack(code(sent), data)
    if sent is Selection:
        if values[0] >= len(SelectionKind):
            raise DataError(f"Selection: kind {values[0]}, expected less than {len(SelectionKind)}; reload the page")
        return Selection(*values)
    if sent is Mark:
        if values[0] >= len(MarkKind) or values[1] >= TOOLS:
            raise DataError(
                f"Mark: kind {values[0]}, tool {values[1]}, expected less than {len(MarkKind)} and {TOOLS}; "
                f"reload the page"
            )
        return Mark(*values)
    if sent is Compare:
        if values[0] > 1:
            raise DataError(f"Compare: {values[0]}, expected 0 or 1; reload the page")
        return Compare(*values)
    if sent is Scalpel:
        step, depth, *place = values
        if step >= len(CutStep) or not np.isfinite([depth, *place]).all() or not (depth > 0 or step == CutStep.undo):
            raise DataError(
                f"Scalpel: step {step}, depth {depth} mm at {place}, expected less than {len(CutStep)}, "
                f"more than 0, finite numbers; reload the page"
            )
        return Scalpel(step, depth, (place[0], place[1], place[2]))
    tool, kind, serial, *numbers = values
    if tool >= TOOLS or kind >= len(CommandKind):
        raise DataError(
            f"ToolCommand: tool {tool}, kind {kind}, expected less than {TOOLS} and {len(CommandKind)}; reload the page"
        )
    if not np.isfinite(numbers).all():
        raise DataError(f"ToolCommand: {numbers} are not all finite; reload the page")
    x, y, z, dx, dy, dz = numbers
    return ToolCommand(tool, kind, serial, (x, y, z), (dx, dy, dz))


def flat(vectors: Any) -> tuple[float, ...]:
    """The numbers of several vectors, one vector after the other."""
    return tuple(x for vector in vectors for x in vector)


def _in_steps(values: Any, step: float) -> tuple[float, ...]:
    """Numbers rounded to a step; 0: as they are."""
    return tuple(values) if step == 0 else tuple((step * np.rint(np.asarray(values) / step)).tolist())


def frame_bytes(
    frame: Any,
    shown: Float32,
    model: int = 0,
    chosen: int = 0,
    errors: ForceErrors | None = None,
    exam: bool = False,
) -> bytes:
    """A frame of the loop as a message, with the displacements (S, 3) mm of what is drawn. At rest it has no array.

    exam: in the steps of a screen, so that no digit tells more than the trainee can see.

    The step is the largest displacement over 32767: 0.2 µm at 5 mm, less than a pixel, at half the size of float32.
    """
    errors = errors or ForceErrors()
    largest = float(np.abs(shown).max(initial=0))
    at_rest = largest < (EXAM_LENGTH / 2 if exam else AT_REST)
    step = 0.0 if at_rest else EXAM_LENGTH if exam else largest / DISPLACEMENT_STEPS
    length, force, work = (EXAM_LENGTH, EXAM_FORCE, EXAM_WORK) if exam else (0.0, 0.0, 0.0)
    message = Frame(
        model=model,
        tick=float(frame.tick),
        late=float(frame.late),
        faults=frame.faults,
        serial=frame.serial & 0xFFFFFFFF,
        seconds=frame.seconds,
        busy=frame.busy,
        energy=_in_steps([frame.work], work)[0],
        contact=tuple(frame.contact),
        point=_in_steps(flat(frame.point), length),
        displacement=_in_steps(flat(frame.displacement), length),
        force=_in_steps(flat(frame.force), force),
        insertion=_in_steps(frame.insertion, length),
        chosen=chosen,
        mesh_error=errors.mesh,
        linearisation=errors.linearisation,
        least_volume=errors.least_volume,
        solution_age=frame.solution_age,
        solution_error=frame.solution_error,
        body=frame.body,
        step=step,
        count=0 if at_rest else len(shown),
    )
    return encode(message, None if at_rest else np.rint(shown / step).astype("<i2"))
