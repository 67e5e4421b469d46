"""What the messages between page and server hold as JSON, or are as a whole."""

from dataclasses import dataclass

from palpate.meshes.display_surfaces import Part


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
class Person:
    """Somebody in a room. role: a `Role`."""

    number: int
    name: str
    role: int


@dataclass(frozen=True)
class PieceShape:
    """A piece that a cut has freed. lips: numbers of the first vertex on its cut faces, as in a `Scene`."""

    nodes: int
    triangles: int
    lips: list[int]


@dataclass(frozen=True)
class Scene:
    """Server to page, once: a 32-bit length, then JSON of that length, padded with blanks to a multiple of 4 bytes.

    Then (nodes, 3) float32 mm at rest, then, if it gapes, (nodes, 3) float32 mm from there to where tension at rest has
    opened the cuts, then (triangles, 3) 32-bit integers, normals outwards, then, if organs lie beside each other, (nodes)
    32-bit integers, to which of them each node belongs. Then, of each piece that a cut has freed, (nodes, 3) float32 mm at
    rest in the organ, (nodes, 3) float32 mm as it came free, and (triangles, 3) 32-bit integers; where they are now, a
    `Pieces` message says. beside: names of the organs, else empty. reach: mm, the longest
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
    pieces: list[PieceShape]


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
