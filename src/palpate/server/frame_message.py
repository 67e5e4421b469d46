"""A frame of the loop as a message, and what one hand of several gets of it."""

import struct
from collections.abc import Sequence
from dataclasses import fields
from typing import Any, get_args, get_type_hints

import numpy as np

from palpate.arrays import Float32
from palpate.server.force_errors import ForceErrors
from palpate.server.messages import AT_REST, DISPLACEMENT_STEPS, Frame, Hands, Pieces, encode, flat
from palpate.simulation.lesson import EXAM_FORCE, EXAM_LENGTH, EXAM_WORK
from palpate.simulation.pointer import TOOLS
from palpate.simulation.session import RATE


def _places() -> dict[str, tuple[int, int]]:
    """Where each field of a `Frame` begins in the message, and how many bytes it has."""
    found, at = {}, 1
    hints = get_type_hints(Frame, include_extras=True)
    for one in fields(Frame):
        size = struct.calcsize("<" + get_args(hints[one.name])[1])
        found[one.name] = at, size
        at += size
    return found


PLACES = _places()
OF_A_HAND = ("point", "displacement", "force")  # three numbers each
OF_A_TOOL = ("contact", *OF_A_HAND, "insertion")
ONE, THREE, HAND = (struct.Struct(f"<{count}f") for count in (1, 3, 13))


def hand_frame(frame: bytes, tools: Sequence[int | None], serial: int) -> bytes:
    """The frame of one of several hands: with its own tools only, by its own numbers.

    tools: for each of its numbers the session's tool, or None. serial: of its newest command that the frame obeys.
    """
    own = bytearray(frame)
    for name in OF_A_TOOL:
        at, size = PLACES[name][0], PLACES[name][1] // TOOLS
        for number, tool in enumerate(tools):
            part = bytes(size) if tool is None else frame[at + tool * size : at + (tool + 1) * size]
            own[at + number * size : at + (number + 1) * size] = part
    struct.pack_into("<I", own, PLACES["serial"][0], serial & 0xFFFFFFFF)
    return bytes(own)


def without_displacements(frame: bytes) -> bytes:
    """A frame's head, for a page that computes displacements by itself: count 0, and a step that is not 0."""
    head = bytearray(frame[: PLACES["count"][0] + PLACES["count"][1]])
    head += bytes(-len(head) % 4)
    struct.pack_into("<f", head, PLACES["step"][0], 1.0)
    struct.pack_into("<I", head, PLACES["count"][0], 0)
    return bytes(head)


def serial_in(frame: bytes) -> int:
    """Of the newest command that a frame obeys."""
    return int(struct.unpack_from("<I", frame, PLACES["serial"][0])[0])


def hands_bytes(frame: bytes, held: Sequence[tuple[int, int, int]]) -> bytes:
    """The tools of a frame as hands: of each the session's tool, the person's number and its number for that person."""
    rows = b""
    for tool, person, number in held:
        state = frame[PLACES["contact"][0] + tool]
        vectors = (x for name in OF_A_HAND for x in THREE.unpack_from(frame, PLACES[name][0] + tool * THREE.size))
        (insertion,) = ONE.unpack_from(frame, PLACES["insertion"][0] + tool * ONE.size)
        rows += HAND.pack(person, state, *vectors, insertion, number)
    return encode(Hands(len(held))) + rows


def pieces_bytes(frame: Any) -> bytes:
    """Where the pieces are that cuts have freed, as a message; empty if there are none."""
    state = np.array(frame.piece_state, dtype="<f4")
    if not len(state):
        return b""
    return encode(Pieces(frame.body, len(state)), np.column_stack([state, frame.piece_offset]).astype("<f4"))


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
    offset: int = 0,
    seconds: float | None = None,
) -> bytes:
    """A frame of the loop as a message, with the displacements (S, 3) mm of what is drawn. At rest it has no array.

    exam: in the steps of a screen, so that no digit tells more than the trainee can see, and without what the loop says of
    its own timing. offset: ticks before this session began. seconds: of the clock, in place of the loop's.

    The step is the largest displacement over 32767: 0.2 µm at 5 mm, less than a pixel, at half the size of float32.
    """
    errors = errors or ForceErrors()
    largest = float(np.abs(shown).max(initial=0))
    at_rest = largest < (EXAM_LENGTH / 2 if exam else AT_REST)
    step = 0.0 if at_rest else EXAM_LENGTH if exam else largest / DISPLACEMENT_STEPS
    length, force, work = (EXAM_LENGTH, EXAM_FORCE, EXAM_WORK) if exam else (0.0, 0.0, 0.0)
    message = Frame(
        model=model,
        tick=float(frame.tick + offset),
        late=0.0 if exam else float(frame.late),
        faults=frame.faults,
        serial=frame.serial & 0xFFFFFFFF,
        seconds=(frame.tick + offset) / RATE if exam else frame.seconds if seconds is None else seconds,
        busy=0.0 if exam else frame.busy,
        energy=_in_steps([frame.work], work)[0],
        contact=tuple(frame.contact),
        point=_in_steps(flat(frame.point), length),
        displacement=_in_steps(flat(frame.displacement), length),
        force=_in_steps(flat(frame.force), force),
        insertion=_in_steps(frame.insertion, length),
        chosen=chosen,
        mesh_error=errors.mesh,
        linearisation=errors.linearisation,
        stiffness_spread=errors.stiffness,
        least_volume=errors.least_volume,
        solution_age=frame.solution_age,
        solution_error=frame.solution_error,
        body=frame.body,
        step=step,
        count=0 if at_rest else len(shown),
    )
    return encode(message, None if at_rest else np.rint(shown / step).astype("<i2"))
