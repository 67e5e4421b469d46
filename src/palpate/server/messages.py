"""What page and server say to each other, defined once; `web/messages.py` writes the page's half from this.

Binary messages are little-endian: a byte that says which it is, then the fields in order, then nothing or one array.
"""

import struct
from dataclasses import dataclass, fields
from typing import Annotated, Any, get_args, get_type_hints

import numpy as np

from palpate.arrays import AnyArray, Float32
from palpate.errors import DataError
from palpate.simulation.devices.pointer import KINDS, TOOLS

# Each type's second part is its code in Python's struct.
U8 = Annotated[int, "B"]
U32 = Annotated[int, "I"]
F32 = Annotated[float, "f"]
F64 = Annotated[float, "d"]
Vector = Annotated[tuple[float, float, float], "3f"]

STEPS = 32767  # of the 16-bit displacements


@dataclass(frozen=True)
class Tool:
    """Page to server: what one hand wants. kind: `KINDS`' number; 0 lets go.

    hold: the tissue at `point` (mm, on the surface at rest) is displaced by `displacement` mm. needle: `point` is where
    it enters (mm, on the surface at rest), `displacement` leads from there to where its tip is to be. free: `point` is
    where the tool's tip is in space (mm); what it touches follows from that.
    """

    tool: U8
    kind: U8
    serial: U32
    point: Vector
    displacement: Vector


@dataclass(frozen=True)
class Choose:
    """Page to server: what 0 is a model of the scene's `models`, 1 an organ (a resolution) of its `organs`, by index."""

    what: U8
    index: U8


@dataclass(frozen=True)
class Mark:
    """Page to server: what 0 says that a lump was found under a tool, 1 that its needle takes a sample here."""

    what: U8
    tool: U8


@dataclass(frozen=True)
class Frame:
    """Server to page: one tick, for each of four tools. mm; force in N, of the tissue on the tool.

    grip: 0 idle, 1 holding, 2 refused, 3 in space and not touching. point, displacement, force: three numbers a tool,
    one tool after the other; the tool is drawn at point + displacement. inside: mm of a needle in the tissue. serial: of
    the newest command obeyed. seconds: the loop's clock. busy: seconds of work in a tick, smoothed. model: index in the
    scene's models. energy: N mm that the tools have put into the tissue and it holds or has used up. Then (count, 3)
    16-bit whole numbers: the displacements of the first count shown nodes (0 or all) in units of `step` mm.
    """

    model: U8
    tick: F64
    late: F64
    faults: U32
    serial: U32
    seconds: F64
    busy: F32
    energy: F32
    grip: Annotated[tuple[int, ...], "4B"]
    point: Annotated[tuple[float, ...], "12f"]
    displacement: Annotated[tuple[float, ...], "12f"]
    force: Annotated[tuple[float, ...], "12f"]
    inside: Annotated[tuple[float, ...], "4f"]
    step: F32
    count: U32


@dataclass(frozen=True)
class Compare:
    """Page to server: on 1 asks for a `Difference` now and then from here on, 0 for no more."""

    on: U8


@dataclass(frozen=True)
class Difference:
    """Server to page, if it asks: how far what one tick shows is from linear finite elements under the same contacts.

    state: 0 the reference is being prepared, 1 compared, 2 this mesh has no reference, 3 it cannot tell contacts apart
    that press the same nodes. force: N, the reference's, of the tissue on each tool, three numbers a tool. off: how far
    the model's forces are from it, all tools together, over its size. Then (count,) 16-bit whole numbers: of each shown
    node the distance from where the reference has it, in units of `step` mm; count 0: it is zero everywhere.
    """

    state: U8
    tick: F64
    force: Annotated[tuple[float, ...], "12f"]
    off: F32
    step: F32
    count: U32


@dataclass(frozen=True)
class Part:
    """Triangles first..first + count of the scene: the organ, or a region inside it."""

    name: str
    first: int
    count: int
    inside: bool


@dataclass(frozen=True)
class Scene:
    """Server to page, once, as JSON of `header` bytes (a 32-bit number before it), padded with blanks to 4 bytes.

    Then (nodes, 3) float32 mm at rest, then (triangles, 3) 32-bit whole numbers, normals outwards. reach: mm, the
    longest displacement that a tool may ask for. limit: N, what a device is pushed with at most. front: radians about z
    from -y towards +x, the side from which to look first. models, organs: what may be chosen while it runs; organ: the
    index of this one. task: what a trainee is asked to do, or empty. images: whether there are slices to show beside it
    (an `Album` at /album, its values as `palpate view` serves them).
    """

    title: str
    model: str
    nodes: int
    triangles: int
    parts: list[Part]
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
    images: bool


@dataclass(frozen=True)
class Window:
    """Values from low (black) to high (white), and what the choice rests on."""

    name: str
    low: float
    high: float
    hint: str


@dataclass(frozen=True)
class Stack:
    """Values of one kind, (z, y, x) or (view, row, column), little-endian, fetched on their own; NaN is not measured."""

    name: str
    unit: str
    kind: str
    windows: list[Window]


@dataclass(frozen=True)
class Image:
    """A volume or a scan for `palpate view`. spacing: (z, y, x) mm, of a scan (1, row, column). origin: (x, y, z) mm.

    direction: 3x3 row by row, columns are the axes x, y, z. patient: they are left, posterior, superior; else the axes
    of a reconstruction. file: 3x4 row by row, from an index here, with a 1 after it, to that of the array which was
    given. water: its attenuation, 1/mm, or 0 if unknown. note: what the page must say about the data. captions: of
    each view of a scan.
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
    """Server to page, once, as JSON: what is viewed, one image or two to compare."""

    images: list[Image]


BINARY: list[type] = [Tool, Frame, Choose, Mark, Compare, Difference]
SAID: list[type] = [Tool, Choose, Mark, Compare]  # by pages
JSON: list[type] = [Part, Scene, Window, Stack, Image, Album]


def code(message: type) -> str:
    """Python's struct code of a binary message, kind included, padded so that an array may follow."""
    hints = get_type_hints(message, include_extras=True)
    exact = "<B" + "".join(get_args(hints[field.name])[1] for field in fields(message))
    return exact + "x" * (-struct.calcsize(exact) % 4)


def encode(message: Any, rest: AnyArray | None = None) -> bytes:
    """A binary message and the array behind it."""
    flat = [BINARY.index(type(message)) + 1]
    for field in fields(message):
        value = getattr(message, field.name)
        flat.extend(value) if isinstance(value, tuple) else flat.append(value)
    return struct.pack(code(type(message)), *flat) + (b"" if rest is None else rest.tobytes())


def decode(data: bytes) -> Tool | Choose | Mark | Compare:
    """What a page says. Raises `DataError` on any other length, kind or number."""
    said: type = {BINARY.index(one) + 1: one for one in SAID}.get(data[0] if data else 0, type(None))
    if said is type(None):
        raise DataError(f"message: kind {data[0] if data else 'none'}, expected what a page may say; reload it")
    name, wanted = said.__name__, struct.calcsize(code(said))
    if len(data) != wanted:
        raise DataError(f"{name}: {len(data)} bytes, expected {wanted}; reload the page")
    _, *values = struct.unpack(code(said), data)
    if said is Choose:
        return Choose(*values)
    if said is Mark:
        if values[0] > 1 or values[1] >= TOOLS:
            raise DataError(f"Mark: {values[0]} of tool {values[1]}: there is no such thing; reload the page")
        return Mark(*values)
    if said is Compare:
        if values[0] > 1:
            raise DataError(f"Compare: {values[0]}, expected 0 or 1; reload the page")
        return Compare(*values)
    tool, kind, serial, *numbers = values
    if tool >= TOOLS or kind >= len(KINDS):
        raise DataError(f"Tool: number {tool}, kind {kind}, expected less than {TOOLS} and {len(KINDS)}")
    if not np.isfinite(numbers).all():
        raise DataError(f"Tool: {numbers} are not all finite; reload the page")
    x, y, z, dx, dy, dz = numbers
    return Tool(tool, kind, serial, (x, y, z), (dx, dy, dz))


def flat(vectors: Any) -> tuple[float, ...]:
    """Tool by tool, three numbers each."""
    return tuple(x for vector in vectors for x in vector)


def frame_bytes(frame: Any, model: int = 0) -> bytes:
    """A frame of the loop as a message. At rest there is no array; else the step follows the biggest displacement.

    16 bits of the biggest displacement are 0.2 µm at 5 mm: finer than a pixel, and half the bytes of float32.
    """
    shown: Float32 = frame.shown
    most = float(np.abs(shown).max(initial=0))
    still = most < 1e-4
    step = most / STEPS if not still else 0.0
    message = Frame(
        model=model,
        tick=float(frame.tick),
        late=float(frame.late),
        faults=frame.faults,
        serial=frame.serial & 0xFFFFFFFF,
        seconds=frame.seconds,
        busy=frame.busy,
        energy=frame.work,
        grip=tuple(frame.grip),
        point=flat(frame.point),
        displacement=flat(frame.displacement),
        force=flat(frame.force),
        inside=tuple(frame.inside),
        step=step,
        count=0 if still else len(shown),
    )
    return encode(message, None if still else np.rint(shown / step).astype("<i2"))
