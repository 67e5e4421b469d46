"""What pages send, checked: length, kind and every number."""

import numpy as np

from palpate.errors import DataError
from palpate.server.message_kinds import ChoiceKind, CutStep, LeadStep, MarkKind, NoteStep, PlayStep, SelectionKind
from palpate.server.messages import (
    FASTEST,
    FROM_PAGE,
    GUIDANCE_LIMIT,
    SLOWEST,
    Choice,
    Compare,
    Detail,
    Guided,
    Lead,
    Mark,
    Note,
    Play,
    Scalpel,
    Seen,
    Selection,
    ToolCommand,
    kind_of,
    layout,
)
from palpate.simulation.pointer import TOOLS, CommandKind
from palpate.simulation.session_notes import LONGEST_NOTE

FromPage = (
    ToolCommand
    | Selection
    | Mark
    | Compare
    | Scalpel
    | Choice
    | Play
    | Lead
    | Detail
    | Seen
    | Guided
    | tuple[Note, str]
)
ROUNDED = 1e-3  # of a force's limit: the page sends it as float32

OF_PAGES: dict[int, type] = {kind_of(one): one for one in FROM_PAGE}
OF_TOOLS = tuple(int(kind) for kind in CommandKind if kind != CommandKind.blade)  # a blade is a `Scalpel`'s


def decode_note(data: bytes) -> tuple[Note, str]:
    """A page's note and its text. Raises `DataError`."""
    size = layout(Note).size
    if not size < len(data) <= size + 4 * LONGEST_NOTE:
        raise DataError(f"Note: {len(data)} bytes, expected up to {size + 4 * LONGEST_NOTE}; reload the page")
    _, step, index, *place = layout(Note).unpack(data[:size])
    if step >= len(NoteStep) or not np.isfinite(place).all():
        raise DataError(f"Note: step {step} at {place}, expected less than {len(NoteStep)}, finite; reload the page")
    try:
        return Note(step, index, (place[0], place[1], place[2])), data[size:].decode()
    except UnicodeDecodeError:
        raise DataError("Note: its text is not UTF-8; reload the page") from None


def decode(data: bytes) -> FromPage:
    """The message that a page sent. Raises `DataError` if its length, kind or a number in it is wrong."""
    sent: type = OF_PAGES.get(data[0] if data else 0, type(None))
    if sent is type(None):
        found = data[0] if data else "none"
        raise DataError(f"message: kind {found}, expected {list(OF_PAGES)}; reload the page")
    if sent is Note:
        return decode_note(data)
    name, wanted = sent.__name__, layout(sent).size
    if len(data) != wanted:
        raise DataError(f"{name}: {len(data)} bytes, expected {wanted}; reload the page")
    _, *values = layout(sent).unpack(data)
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
    if sent is Play:
        step, value = values
        allowed = {PlayStep.speed: (SLOWEST, FASTEST), PlayStep.seek: (0.0, 1e15)}.get(step, (-np.inf, np.inf))
        if step >= len(PlayStep) or not np.isfinite(value) or not allowed[0] <= value <= allowed[1]:
            raise DataError(f"Play: step {step}, value {value:g}, expected less than {len(PlayStep)}; reload the page")
        return Play(step, value)
    if sent is Compare:
        if values[0] > 1:
            raise DataError(f"Compare: {values[0]}, expected 0 or 1; reload the page")
        return Compare(*values)
    if sent is Detail:
        if values[0] > 1:
            raise DataError(f"Detail: {values[0]}, expected 0 or 1; reload the page")
        return Detail(*values)
    if sent is Seen:
        return Seen(*values)
    if sent is Guided:
        number, given, *force = values
        if not 0 <= given < np.inf or not np.linalg.norm(force) <= (1 + ROUNDED) * GUIDANCE_LIMIT:
            raise DataError(
                f"Guided: {given:g} N mm given, force {force} N, expected 0 or more, finite, and at most "
                f"{GUIDANCE_LIMIT:g} N; reload the page"
            )
        return Guided(number, given, (force[0], force[1], force[2]))
    if sent is Choice:
        if values[0] >= len(ChoiceKind) or values[1] not in (1, 2):
            raise DataError(
                f"Choice: kind {values[0]}, interval {values[1]}, expected less than {len(ChoiceKind)}, and 1 or 2; "
                "reload the page"
            )
        return Choice(*values)
    if sent is Lead:
        if values[0] >= len(LeadStep):
            raise DataError(f"Lead: step {values[0]}, expected less than {len(LeadStep)}; reload the page")
        return Lead(*values)
    if sent is Scalpel:
        step, depth, x, y, z, *way = values
        if step >= len(CutStep) or not np.isfinite(values).all() or not (depth > 0 or step == CutStep.undo):
            raise DataError(
                f"Scalpel: step {step}, depth {depth} mm at {[x, y, z]} along {way}, expected less than {len(CutStep)}, "
                f"more than 0, finite numbers; reload the page"
            )
        return Scalpel(step, depth, (x, y, z), (way[0], way[1], way[2]))
    tool, kind, serial, *numbers = values
    if tool >= TOOLS or kind not in OF_TOOLS:
        raise DataError(
            f"ToolCommand: tool {tool}, kind {kind}, expected less than {TOOLS}, and one of {OF_TOOLS}; reload the page"
        )
    if not np.isfinite(numbers).all():
        raise DataError(f"ToolCommand: {numbers} are not all finite; reload the page")
    x, y, z, dx, dy, dz = numbers
    return ToolCommand(tool, kind, serial, (x, y, z), (dx, dy, dz))
