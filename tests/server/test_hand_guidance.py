"""A teacher guides a hand in a room: from when on and until when, what both are told, who may, and what is on the record."""

import struct

import numpy as np
import pytest
from support.example_organs import organ
from support.room_socket import SIDE, TOP, open_to_all, shared_session

import palpate as pp
from palpate.errors import DataError
from palpate.server import messages
from palpate.server.message_checks import decode
from palpate.server.message_kinds import GuidanceState, LeadStep
from palpate.simulation.record_events import record_events

ON, NONE, WAITING = GuidanceState.on, GuidanceState.none, GuidanceState.waiting
DEPTH = (0.0, 0.0, -2.0)


@pytest.fixture
def live():
    return shared_session()


@pytest.fixture
def enter(live):
    with open_to_all(live) as come:

        def once_known(role, name=""):
            page = come(role, name)
            page.until(lambda *_: page.you)
            return page

        yield once_known


def until_state(page, state):
    page.until(lambda *_: page.guidance and page.guidance["state"] == state)


def guide(teacher, trainee):
    """Both hold the organ, and the teacher guides."""
    trainee.press(0, TOP, DEPTH)
    teacher.press(1, SIDE, (-1.0, 0.0, 0.0))
    for page in (teacher, trainee):
        page.until(lambda _, contact, *__: any(contact))
    teacher.send(messages.Lead(LeadStep.guide, trainee.you))
    for page in (teacher, trainee):
        until_state(page, ON)


def test_it_begins_once_both_hold_and_tells_each_where_the_other_is(enter):
    teacher, trainee, viewer = enter("teacher"), enter("trainee"), enter("viewer")
    trainee.press(2, TOP, DEPTH)
    teacher.send(messages.Lead(LeadStep.guide, trainee.you))
    until_state(trainee, WAITING)
    teacher.press(1, SIDE, (-1.0, 0.0, 0.0))
    for page in (teacher, trainee, viewer):
        until_state(page, ON)
        assert page.guidance["hands"] == (teacher.you, trainee.you)
        assert page.guidance["tools"] == [1, 2]
        np.testing.assert_allclose(page.guidance["at"], [np.add(SIDE, (-1, 0, 0)), np.add(TOP, DEPTH)], rtol=1e-6)
    teacher.press(1, SIDE, (-2.0, 1.0, 0.0))
    trainee.until(lambda *_: trainee.guidance["at"][0][1] == 1)
    number = teacher.guidance["number"]
    trainee.send(messages.Guided(number, 0.5, (0.25, 0.0, -0.5)))
    teacher.until(lambda *_: teacher.guidance["force"][1] == [0.25, 0.0, -0.5])
    assert teacher.guidance["given"] == [0.0, 0.5]
    trainee.send(messages.Guided(number, 0.25, (0.0, 0.0, 0.0)))  # what was given stays given
    teacher.until(lambda *_: teacher.guidance["force"][1] == [0.0, 0.0, 0.0])
    assert teacher.guidance["given"] == [0.0, 0.5]
    viewer.until(lambda *_: viewer.guidance["given"] == [0.0, 0.5])


def test_an_end_can_give_no_more_than_its_hand_can_have_put_in(enter):
    """A page that says more is not believed, since the other hand would get it."""
    teacher, trainee, other = enter("teacher"), enter("trainee"), enter("trainee")
    guide(teacher, trainee)
    number = teacher.guidance["number"]
    trainee.send(messages.Guided(number, 1e6, (0.0, 0.0, 0.1)))
    teacher.until(lambda *_: teacher.guidance["force"][1][2] > 0)
    before = teacher.guidance["given"][1]
    assert before <= 1
    trainee.press(0, TOP, (0.0, 3.0, -2.0))
    trainee.send(messages.Guided(number, 1e6, (0.0, 0.0, 0.2)))
    teacher.until(lambda *_: teacher.guidance["force"][1][2] > 0.15)
    assert teacher.guidance["given"][1] == pytest.approx(before + 3 * messages.GUIDANCE_LIMIT)
    other.send(messages.Guided(number, 7.0, (0.0, 0.5, 0.0)))  # it has no end of it
    trainee.send(messages.Guided(number + 1, 900.0, (0.5, 0.0, 0.0)))  # of another one
    for _ in range(20):
        teacher.frame()
    assert teacher.guidance["given"] == [0.0, pytest.approx(before + 3)]
    assert teacher.guidance["force"][1] == pytest.approx([0.0, 0.0, 0.2])


def by_button(teacher, trainee):
    teacher.send(messages.Lead(LeadStep.end_guidance, trainee.you))


def trainee_lets_go(teacher, trainee):
    trainee.away(0)


def teacher_lets_go(teacher, trainee):
    teacher.away(1)


def trainee_vanishes(teacher, trainee):
    trainee.socket.close()


def teacher_vanishes(teacher, trainee):
    teacher.socket.close()


def stopped(teacher, trainee):
    teacher.send(messages.Lead(LeadStep.freeze, 0))


def reset(teacher, trainee):
    teacher.send(messages.Lead(LeadStep.reset, 0))


def taken_over(teacher, trainee):
    teacher.send(messages.Lead(LeadStep.take_over, trainee.you))


def released(teacher, trainee):
    teacher.send(messages.Lead(LeadStep.release, trainee.you))


ENDS = [
    by_button, trainee_lets_go, teacher_lets_go, trainee_vanishes, teacher_vanishes, stopped, reset, taken_over, released,
]  # fmt: skip


@pytest.mark.parametrize("ends", ENDS, ids=lambda ends: ends.__name__)
def test_it_ends(enter, ends):
    teacher, trainee, viewer = enter("teacher"), enter("trainee"), enter("viewer")
    guide(teacher, trainee)
    until_state(viewer, ON)
    ends(teacher, trainee)
    there = [viewer, *(page for page in (teacher, trainee) if page.socket.protocol.state.name == "OPEN")]
    for page in there:
        until_state(page, NONE)
        for _ in range(10):
            page.frame()
        assert page.guidance["state"] == NONE, "it does not begin again by itself"


def test_a_wish_to_guide_ends_as_guiding_does(enter, live):
    """Before both hold the organ."""
    teacher, trainee = enter("teacher"), enter("trainee")
    for ends in (by_button, stopped, reset, taken_over, released):
        teacher.send(messages.Lead(LeadStep.guide, trainee.you))
        until_state(trainee, WAITING)
        ends(teacher, trainee)
        until_state(trainee, NONE)
        teacher.send(messages.Lead(LeadStep.resume, 0))
        teacher.until(lambda *_: teacher.frozen == 0)
    assert live.people.guidance.number == 5


def test_what_cannot_be_guided_is_refused_and_said(enter, live):
    teacher, second, trainee, viewer = (
        enter("teacher", "Gray"),
        enter("teacher"),
        enter("trainee"),
        enter("viewer", "Bo"),
    )

    def told(page, person):
        page.told.clear()
        page.send(messages.Lead(LeadStep.guide, person))
        page.until(lambda *_: page.told)
        return page.told[0]

    assert told(teacher, teacher.you) == "There is no such hand to guide."
    assert told(teacher, 99) == "There is no such hand to guide."
    assert told(teacher, viewer.you) == "Bo watches, and has no hand to guide."
    assert told(trainee, teacher.you) == "Only a teacher can do this here."
    assert told(viewer, trainee.you) == "Only a teacher can do this here."
    teacher.send(messages.Lead(LeadStep.freeze, 0))
    assert told(teacher, trainee.you) == "All hands are stopped. Let them go on, then guide."
    assert live.people.guidance.number == 0
    teacher.send(messages.Lead(LeadStep.resume, 0))
    teacher.send(messages.Lead(LeadStep.guide, trainee.you))
    until_state(second, WAITING)
    assert told(second, trainee.you) == "Gray guides a hand already."


@pytest.mark.parametrize(
    ("given", "force"),
    [
        (-1.0, (0, 0, 0)),
        (np.nan, (0, 0, 0)),
        (np.inf, (0, 0, 0)),
        (0.0, (0, np.nan, 0)),
        (0.0, (0.8, 0.8, 0)),
        (0.0, (0, 0, -np.inf)),
    ],
)
def test_an_end_that_cannot_be_is_refused(given, force):
    good = messages.encode(messages.Guided(3, 2.5, (0.6, 0.0, -0.8)))
    told = decode(good)
    assert (told.number, told.given) == (3, 2.5)
    np.testing.assert_allclose(told.force, (0.6, 0.0, -0.8), rtol=1e-6)
    with pytest.raises(DataError, match="expected 0 or more, finite, and at most 1 N; reload the page"):
        decode(messages.encode(messages.Guided(3, given, force)))
    with pytest.raises(DataError, match="27 bytes, expected 28"):
        decode(good[:-1])
    with pytest.raises(DataError, match="Lead: step 7"):
        decode(struct.pack("<BBIxx", 15, 7, 1))


def test_it_is_on_the_record_which_replays_to_the_bit(enter, live, tmp_path):
    teacher, trainee = enter("teacher"), enter("trainee")
    guide(teacher, trainee)
    tool = live.people.guidance.guided
    for i in range(40):
        teacher.press(1, SIDE, (-1.0, 0.05 * i, 0.0))
        trainee.press(0, TOP, (0.0, 0.02 * i, -2.0))
        trainee.frame()
    trainee.away(0)
    until_state(teacher, NONE)
    live.session.stop()
    pp.write_record(tmp_path / "guided.h5", live.session.record())
    record = pp.read_record(tmp_path / "guided.h5")
    assert [(what, which) for _, what, which in record.marks] == [(2, tool), (3, tool)]
    assert record.marks[0][0] < record.marks[1][0]
    assert [e.text for e in record_events(record) if e.kind == "guide"] == [
        f"Tool {tool + 1} is guided",
        f"Tool {tool + 1} is guided no more",
    ]
    again = pp.Session(pp.model(organ(9), "compliance"), radius=9.0, sweeps=8)
    again.replay(record)
    np.testing.assert_array_equal(again.record().digests, record.digests)
    assert len(record.digests) > 3
    assert np.ptp(record.displacements[:, 1]) > 1
    assert pp.score(record, organ(9)).claims == ()
