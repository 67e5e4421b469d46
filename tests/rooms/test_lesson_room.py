"""A case of a lesson in a room: all take it together, nobody is sent what is inside, and the record is judged."""

import struct

import httpx
import numpy as np
import pytest
from support.lessons import lesson_file
from support.open_rooms import open_rooms, socket_of, until_message
from support.running_server import until

import palpate as pp
from palpate.server import messages
from palpate.server.message_kinds import MarkKind, NoteStep

FRAME = 2
CLAIM = messages.encode(messages.Mark(MarkKind.lump, 0))


def contact(data):
    return data[0] == FRAME and struct.unpack_from(messages.code(messages.Frame), data)[9]


def test_a_lesson_is_taken_together(tmp_path):
    file = lesson_file(tmp_path, 9, claims=2, time=600)
    lesson, record = pp.read_lesson(file), tmp_path / "exam.h5"
    top = lesson_top(lesson)
    press = messages.encode(messages.ToolCommand(0, 1, 1, top, (0.0, 0.0, -3.0)))
    with open_rooms([pp.RoomFile("exam", (), lesson=file, seed=7, record=record)], tmp_path) as rooms:
        addresses = [rooms.address("exam", "trainee", name) for name in ("Ada", "Grace")]
        with socket_of(addresses[0]) as ada, socket_of(addresses[1]) as grace:
            for page in (ada, grace):
                page.send(press)
                until_message(page, contact)
                page.send(CLAIM)
            ada.send(CLAIM)
            assert "2 claims" in until_message(ada, lambda data: isinstance(data, str))
            base, token = addresses[0].split("?")
            assert httpx.get(f"{base}solid?{token}").status_code == 409
            process = rooms.rooms["exam"]
            until(lambda: (process.state or {}).get("claims") == 2)
            ada.send(messages.encode(messages.Note(NoteStep.add, 0, top)) + b"seen")
    result = pp.lesson_result(pp.read_record(record), lesson)
    assert (result.seed, len(result.score.claims)) == (7, 2)
    assert {tool for _, _, tool in pp.read_record(record).marks} == {0, 1}, "a tool of each hand"
    assert not pp.read_record(record).notes


def lesson_top(lesson):
    nodes = pp.read_tissue(lesson.organ).mesh.nodes
    return tuple(nodes[np.argmax(nodes[:, 2])].tolist())


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("{lesson: lesson.yaml, organs: [tissue.vtu]}", "leave out organs"),
        ("{lesson: lesson.yaml, tension: 2}", "leave out tension"),
        ("{lesson: lesson.yaml, title: An exam}", "leave out title"),
        ("{lesson: 3}", "lesson: expected a text"),
        ("{lesson: lesson.yaml, seed: -1}", "seed: '-1'"),
        ("{organs: [tissue.vtu], seed: 3}", "seed: '3'; with a lesson"),
    ],
)
def test_what_does_not_go_with_a_lesson_is_refused(given, said, tmp_path):
    (tmp_path / "rooms.yaml").write_text(f"palpate rooms: 1\nrooms: {{exam: {given}}}")
    with pytest.raises(pp.errors.DataError) as refusal:
        pp.read_rooms(tmp_path / "rooms.yaml")
    assert said in str(refusal.value)
