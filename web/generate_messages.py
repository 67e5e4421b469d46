"""Writes src/protocol/server-messages.ts from palpate.server.messages: python web/generate_messages.py.

It holds the messages between page and server, the enumerations in them, and their constants. A test fails if it is stale.
"""

import struct
from dataclasses import fields
from pathlib import Path
from typing import get_args, get_origin, get_type_hints

from palpate.meshes.display_surfaces import Part
from palpate.server import messages
from palpate.server.json_messages import (
    Album,
    Image,
    NoteText,
    Person,
    PieceShape,
    Scene,
    Stack,
    TimelineEvent,
    TimelineTrack,
    Window,
)
from palpate.server.message_kinds import (
    ChoiceKind,
    CloseCode,
    ComparisonState,
    CutStep,
    Feedback,
    GuidanceState,
    LeadStep,
    MarkKind,
    NoteStep,
    PlayStep,
    Role,
    SelectionKind,
    TrialState,
)
from palpate.server.messages import AT_REST, DISPLACEMENT_STEPS, DISTANCE_STEPS, FASTEST, GUIDANCE_LIMIT, SLOWEST
from palpate.simulation.lesson import EXAM_FORCE, EXAM_LENGTH, EXAM_WORK
from palpate.simulation.pointer import TOOLS, CommandKind, ContactState, PieceState
from palpate.simulation.session import RATE
from palpate.simulation.session_notes import LONGEST_NOTE, MOST_NOTES

HERE = Path(__file__).parent
JSON = [Part, NoteText, TimelineEvent, TimelineTrack, Person, PieceShape, Scene, Window, Stack, Image, Album]
ENUMS = [
    CommandKind, ContactState, PieceState, SelectionKind, MarkKind, NoteStep, PlayStep, CutStep, ComparisonState, TrialState,
    Feedback, ChoiceKind, Role, LeadStep, GuidanceState, CloseCode,
]  # fmt: skip
CONSTANTS = {
    "TOOLS": TOOLS,
    "DISTANCE_STEPS": DISTANCE_STEPS,
    "DISPLACEMENT_STEPS": DISPLACEMENT_STEPS,
    "AT_REST": AT_REST,
    "GUIDANCE_LIMIT": GUIDANCE_LIMIT,
    "EXAM_LENGTH": EXAM_LENGTH,
    "EXAM_FORCE": EXAM_FORCE,
    "EXAM_WORK": EXAM_WORK,
    "LONGEST_NOTE": LONGEST_NOTE,
    "MOST_NOTES": MOST_NOTES,
    "RATE": RATE,
    "SLOWEST": SLOWEST,
    "FASTEST": FASTEST,
}
READ = {"B": ("getUint8", 1), "I": ("getUint32", 4), "f": ("getFloat32", 4), "d": ("getFloat64", 8)}
PLAIN = {str: "string", int: "number", float: "number", bool: "boolean"}


def plain(hint: object) -> str:
    """TypeScript's name of a Python type in a JSON message."""
    if get_origin(hint) is list:
        return f"{plain(get_args(hint)[0])}[]"
    return PLAIN.get(hint) or hint.__name__


def sentence(message: type) -> str:
    """The first line of the docstring."""
    return (message.__doc__ or "").split("\n")[0]


def interface(message: type, types: dict[str, str]) -> list[str]:
    """The message as a TypeScript interface."""
    body = [f"  {name}: {kind};" for name, kind in types.items()]
    return ["", f"/** {sentence(message)} */", f"export interface {message.__name__} {{", *body, "}"]


def kind_of(code: str) -> str:
    """TypeScript's name of a type in a binary message."""
    return "Vector" if code == "3f" else "number[]" if code[:-1] else "number"


def binary(message: type) -> list[str]:
    """Interface, size, encoder and decoder of a binary message."""
    hints = get_type_hints(message, include_extras=True)
    codes = {field.name: get_args(hints[field.name])[1] for field in fields(message)}
    types = {name: kind_of(code) for name, code in codes.items()}
    name, kind, at = message.__name__, messages.BINARY.index(message) + 1, 1
    put, get = [f"  view.setUint8(0, {kind});"], []
    for field, code in codes.items():
        call, size = READ[code[-1]]
        little = "" if size == 1 else ", true"
        if count := int(code[:-1] or 0):
            spot = f"{at} + {size} * i" if size > 1 else f"{at} + i"
            cast = " as Vector" if code == "3f" else ""
            get.append(f"    {field}: Array.from({{ length: {count} }}, (_, i) => view.{call}({spot}{little})){cast},")
            set_ = f"view.{call.replace('get', 'set')}({spot}, message.{field}[i]{little});"
            put.append(f"  for (let i = 0; i < {count}; i++) {set_}")
            at += size * count
        else:
            get.append(f"    {field}: view.{call}({at}{little}),")
            put.append(f"  view.{call.replace('get', 'set')}({at}, message.{field}{little});")
            at += size
    total = struct.calcsize(messages.code(message))
    return [
        *interface(message, types),
        f"export const {name.upper()}_KIND = {kind}, {name.upper()}_BYTES = {total};",
        f"export function encode{name}(message: {name}): ArrayBuffer {{",
        f"  const view = new DataView(new ArrayBuffer({name.upper()}_BYTES));",
        *put,
        "  return view.buffer;",
        "}",
        f"export function decode{name}(view: DataView): {name} {{",
        f"  if (view.getUint8(0) !== {kind}) throw new Error(`not a {name}: kind ${{view.getUint8(0)}}`);",
        "  return {",
        *get,
        "  };",
        "}",
    ]


def enumeration(enum: type) -> list[str]:
    """An IntEnum as a TypeScript object of constants."""
    members = ", ".join(f"{member.name}: {member.value}" for member in enum)
    comment = [] if enum.__doc__ is None else [f"/** {sentence(enum)} */"]
    return ["", *comment, f"export const {enum.__name__} = {{ {members} }} as const;"]


def source() -> str:
    """The whole of src/protocol/server-messages.ts."""
    lines = ["// Written by web/generate_messages.py from palpate.server.messages; do not edit.", ""]
    lines.append("export type Vector = [number, number, number];")
    lines += [f"export const {name} = {value};" for name, value in CONSTANTS.items()]
    for enum in ENUMS:
        lines += enumeration(enum)
    for message in messages.BINARY:
        lines += binary(message)
    for message in JSON:
        hints = get_type_hints(message)
        lines += interface(message, {field.name: plain(hints[field.name]) for field in fields(message)})
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    (HERE / "src" / "protocol" / "server-messages.ts").write_text(source())
