"""Several people in one session: whose tools are whose, what each role may do, and what a teacher can stop."""

import struct
import time

import numpy as np
import pytest
from support.example_organs import organ
from support.room_socket import SIDE, TOP, open_to_all, shared_session

import palpate as pp
from palpate.server import messages
from palpate.server.held_tools import HeldTools
from palpate.server.message_kinds import CutStep, LeadStep, PlayStep
from palpate.server.people import shown_name
from palpate.server.touch import replayed
from palpate.simulation.pointer import TOOLS, Command


@pytest.fixture
def live():
    return shared_session()


@pytest.fixture
def enter(live):
    with open_to_all(live) as come:
        yield come


def test_two_hands_hold_the_same_number_and_feel_what_push_says_of_both(enter, live):
    first, second = enter("trainee", "Ada"), enter("trainee", "Bo")
    first.press(0, TOP, (0.0, 0.0, -3.0))
    second.press(0, SIDE, (-2.0, 0.0, 1.0))
    ones, twos = first.settled(), second.settled()
    answer = live.session.model.push([TOP, SIDE], [(0.0, 0.0, -3.0), (-2.0, 0.0, 1.0)], [9.0, 9.0])
    np.testing.assert_allclose(ones[3][0], answer.force[0], rtol=0.02, atol=1e-3)
    np.testing.assert_allclose(twos[3][0], answer.force[1], rtol=0.02, atol=1e-3)
    assert (ones[1], twos[1]) == ((ones[1][0], 0, 0, 0), (twos[1][0], 0, 0, 0))  # each sees its own alone as its own
    names = {person["number"]: person["name"] for person in first.people}
    assert names == {first.you: "Ada", second.you: "Bo"}
    assert [int(row[0]) for row in first.hands] == [second.you]
    np.testing.assert_allclose(first.hands[0, 8:11], twos[3][0], rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(second.hands[0, 8:11], ones[3][0], rtol=1e-3, atol=1e-3)
    first.socket.close()  # its tools let go
    second.until(lambda *_: len(second.hands) == 0 and len(second.people) == 1)


def test_a_page_that_computes_displacements_gets_frames_without_them(enter, live):
    """It, not the others; whoever watches may ask for them; and again as before when it asks for that."""
    first, second = enter("viewer"), enter("trainee")
    second.press(0, TOP, (0.0, 0.0, -3.0))
    second.settled()
    first.until(lambda *_: first.displaced[1] > 0)
    whole, shown = first.length, first.displaced[1]
    assert shown == len(live.session.shown)
    first.send(messages.Detail(0))
    first.until(lambda *_: first.displaced[1] == 0)
    assert first.displaced[0] != 0  # it is not at rest
    assert first.length == whole - 6 * shown
    assert len(first.hands) == 1
    second.until(lambda *_: second.displaced[1] == shown, 1)
    first.send(messages.Detail(1))
    first.until(lambda *_: first.displaced[1] == shown)
    assert first.length == whole


def test_a_hand_too_many_is_told_and_gets_a_tool_that_is_let_go(enter):
    pages = [enter("trainee") for _ in range(TOOLS + 1)]
    for i, page in enumerate(pages):
        page.press(0, (10.0 * i - 20, 0.0, 24.0))
        page.until(lambda serial, contact, *_, page=page: contact[0] or page.told)
    assert [page.told for page in pages] == [[]] * TOOLS + [["All tools are in other hands."]]
    pages[1].away()
    pages[1].until(lambda _, contact, *__: not contact[0])
    pages[-1].press(0)
    pages[-1].until(lambda _, contact, *__: contact[0])


def test_each_role_may_do_its_own_and_no_more(enter, live):
    teacher, trainee, viewer = enter("teacher"), enter("trainee"), enter("viewer")
    forbidden = {
        viewer: [
            messages.ToolCommand(0, 1, 1, TOP, (0.0, 0.0, -2.0)),
            messages.Scalpel(CutStep.begin, 9.0, TOP),
            messages.Mark(0, 0),
            messages.Guided(1, 5.0, (1.0, 0.0, 0.0)),
        ],
        trainee: [messages.Scalpel(CutStep.undo, 9.0, TOP)],
    }
    for page in (viewer, trainee):
        forbidden[page] += [
            messages.Selection(0, 1),
            messages.Lead(LeadStep.freeze, 0),
            messages.Lead(LeadStep.take_over, trainee.you or 1),
            messages.Lead(LeadStep.guide, trainee.you or 1),
            messages.Lead(LeadStep.end_guidance, 0),
            messages.Compare(1),
        ]
    before = live.current
    for page, sent in forbidden.items():
        for message in sent:
            page.told.clear()
            page.send(message)
            page.until(lambda *_, page=page: page.told)
            assert page.told[0].startswith("Only a "), message
    assert live.current == before
    assert not live.people.frozen
    assert not live.tools.holders
    assert live.people.guidance.number == 0
    teacher.send(messages.Lead(LeadStep.freeze, 0))
    teacher.until(lambda *_: teacher.frozen == 1)
    assert teacher.told == []


def test_a_role_that_is_none_watches(enter):
    page = enter("surgeon")
    page.press()
    page.until(lambda *_: page.told == ["Only a trainee can do this here."])


def test_frozen_hands_stay_where_they_are_and_go_on_where_they_are_then(enter):
    teacher, trainee = enter("teacher"), enter("trainee")
    trainee.press(0, TOP, (0.0, 0.0, -2.0))
    before = trainee.settled()[3][0]
    teacher.send(messages.Lead(LeadStep.freeze, 0))
    trainee.until(lambda *_: trainee.frozen == 1)
    trainee.press(0, TOP, (0.0, 0.0, -4.0))
    trainee.away()
    trainee.press(0, TOP, (0.0, 0.0, -3.0))
    for _ in range(30):
        force = trainee.frame()[3][0]
    np.testing.assert_allclose(force, before, atol=1e-4)
    teacher.press(0, SIDE, (-2.0, 0.0, 0.0))  # who leads can go on
    teacher.until(lambda _, contact, *__: contact[0])
    teacher.away()
    teacher.send(messages.Lead(LeadStep.resume, 0))
    after = trainee.settled()
    np.testing.assert_allclose(after[2][0], (0.0, 0.0, -3.0), atol=1e-3)
    assert after[3][0, 2] == pytest.approx(1.5 * before[2], rel=0.02)


def test_without_a_teacher_nothing_stays_frozen(enter):
    teacher, trainee = enter("teacher"), enter("trainee")
    trainee.press()
    trainee.settled()
    teacher.send(messages.Lead(LeadStep.freeze, 0))
    trainee.until(lambda *_: trainee.frozen == 1)
    trainee.away()
    teacher.socket.close()
    trainee.until(lambda serial, contact, *_: trainee.frozen == 0 and not contact[0])


def test_a_teacher_takes_tools_over_as_they_are_and_lets_them_go(enter):
    teacher, trainee = enter("teacher"), enter("trainee")
    trainee.press(0, TOP, (0.0, 0.0, -2.0))
    before = trainee.settled()[3][0]
    trainee.until(lambda *_: trainee.you)
    teacher.send(messages.Lead(LeadStep.take_over, trainee.you))
    taken = teacher.until(lambda _, contact, *__: contact[0])
    np.testing.assert_allclose(taken[3][0], before, atol=1e-3)
    trainee.press(0, TOP, (0.0, 0.0, -5.0))  # it is not in this hand any more
    trainee.until(lambda _, contact, *__: not contact[0] and len(trainee.hands) == 1)
    for _ in range(20):
        force = teacher.frame()[3][0]
    np.testing.assert_allclose(force, before, atol=1e-3)
    teacher.press(0, TOP, (0.0, 0.0, -1.0))
    assert teacher.settled()[3][0, 2] == pytest.approx(before[2] / 2, rel=0.02)
    trainee.away()
    trainee.press(0, SIDE, (-1.0, 0.0, 0.0))  # it begins anew
    trainee.until(lambda _, contact, *__: contact[0])
    teacher.send(messages.Lead(LeadStep.release, trainee.you))
    trainee.until(lambda _, contact, *__: not contact[0])


def test_reset_takes_all_cuts_back_and_all_tools_let_go(enter, live):
    teacher, trainee = enter("teacher"), enter("trainee")
    x = np.linspace(-12, 12, 12)
    way = [(float(a), 0.0, float(25 * np.sqrt(1 - (a / 40) ** 2))) for a in x]
    for i, point in enumerate(way):
        step = CutStep.begin if i == 0 else CutStep.end if i == len(way) - 1 else CutStep.move
        trainee.send(messages.Scalpel(step, 12.0, point))
    trainee.until(lambda *_: live.session.cuts == 1 and live.cutting.stroke is None, 3000)
    trainee.press(0, SIDE, (-1.0, 0.0, 0.0))
    trainee.until(lambda _, contact, *__: contact[0])
    teacher.send(messages.Lead(LeadStep.reset, 0))
    trainee.until(lambda _, contact, *__: not contact[0])
    teacher.until(lambda *_: live.session.cuts == 0, 3000)
    assert [text.split(" of ")[0] for text in trainee.told] == ["Cut"]  # who cuts is told of the work
    assert teacher.told == []


def test_a_page_that_is_far_behind_gets_no_more_frames_until_it_has_caught_up_and_then_the_newest(enter, live):
    """One that says what has come; the others go on, and so does one that says nothing."""
    slow, silent, quick = (enter("viewer") for _ in range(3))

    def tick(frame):
        return struct.unpack_from("<d", frame, 2)[0]

    def next_frame(page, seconds):
        while True:
            data = page.socket.recv(timeout=seconds)
            if isinstance(data, bytes) and data[0] == 2:
                return data

    def until_held_back(page):
        count = 0
        while count < 1000:
            try:
                last = tick(next_frame(page, 2.0))
            except TimeoutError:
                break
            count += 1
        return last, count

    slow.send(messages.Seen(0))
    last, count = until_held_back(slow)
    assert 1 <= count < 50, "and those that were under way before its first word"
    newest = [tick(next_frame(quick, 2.0)) for _ in range(count + 20)][-1]
    quick.send(messages.Seen(count + 20))
    assert len([next_frame(silent, 2.0) for _ in range(count + 20)]) == count + 20
    assert newest > last
    slow.send(messages.Seen(count))
    assert tick(next_frame(slow, 5.0)) > last + 1000, "nothing of what was held back"
    slow.send(messages.Seen(2**32 - 1))
    slow.send(messages.Seen(0))
    next_frame(slow, 5.0)


@pytest.mark.parametrize("seed", range(5))
def test_no_tool_has_two_hands_and_no_hand_two_tools_whatever_comes(seed):
    rng = np.random.default_rng(seed)
    sent = {}

    class Sends:
        def send(self, command, serial=None, tool=0):
            sent[tool] = command.held

    tools, pages = HeldTools(Sends(), shared=True), ["a", "b", "c"]
    held = Command(True, TOP, (0.0, 0.0, -1.0))
    for _ in range(3000):
        page, other = rng.choice(pages, 2)
        draw = rng.random()
        if draw < 0.8:
            command = held if rng.random() < 0.6 else Command()
            tools.command(page, int(rng.integers(TOOLS)), command, 1, stopped=rng.random() < 0.1)
        elif draw < 0.85:
            tools.resume()
        elif draw < 0.9 and page != other:
            tools.take_over(page, other)
        elif draw < 0.95:
            tools.release(page)
        elif draw < 0.99:
            tools.leave(page)
        else:
            tools.let_go()
        hands = list(tools.holders.values())
        assert len(set(hands)) == len(hands)
        assert {tool for tool, down in sent.items() if down} == set(tools.holders)


def test_names_are_one_line_that_can_be_seen():
    assert shown_name(" Ada\n\u202eLovelace \x00\x1b[31m") == "AdaLovelace [31m"
    assert shown_name("x" * 100) == "x" * 40


@pytest.fixture
def watched():
    """A session that is replayed to a room: a press from above."""
    tissue = organ(9)
    session = pp.Session(pp.model(tissue, "compliance"), radius=9.0, sweeps=8)
    session.step([None] * 500 + [pp.Command(True, TOP, (0.0, 0.0, -3.0))] * 1500)
    live = replayed({"A press": session.record()}, {"organ": tissue}, 0.0, [], "lecture")
    with open_to_all(live) as come:
        yield come


def test_a_replay_is_played_by_teachers_and_seen_by_all_alike(watched):
    teacher, trainee, viewer = watched("teacher", "Gray"), watched("trainee"), watched("viewer")
    teacher.send(messages.Play(PlayStep.pause, 0.0))
    teacher.send(messages.Play(PlayStep.seek, 1900.0))
    forces = [one.until(lambda _, contact, *__: contact[0])[3] for one in (teacher, trainee, viewer)]
    np.testing.assert_array_equal(forces[0], forces[1])
    np.testing.assert_array_equal(forces[0], forces[2])
    assert np.linalg.norm(forces[0][0]) > 0.1, "the recorded tool is everybody's to see"
    for one in (trainee, viewer):
        one.send(messages.Play(PlayStep.play, 0.0))
        one.send(messages.Play(PlayStep.seek, 0.0))
    trainee.press(0)
    trainee.send(messages.Scalpel(CutStep.begin, 9.0, TOP))
    teacher.send(messages.Lead(LeadStep.freeze, 0))
    teacher.send(messages.Lead(LeadStep.take_over, 2))
    late = watched("viewer", "Ada")
    frame = late.frame()
    np.testing.assert_array_equal(frame[3], forces[0])
    late.socket.close()
    teacher.send(messages.Play(PlayStep.seek, 100.0))
    trainee.until(lambda _, contact, *__: not contact[0])
    assert set(trainee.told) == {"Only a teacher can do this here."}
    assert {person["name"] for person in teacher.people} >= {"Gray"}
    assert teacher.told == []


def test_a_paused_replay_is_heard_on_and_on(watched):
    """A page in a room takes a server that says nothing for lost, and connects anew (room-liveness.ts, after 1.5 s)."""
    teacher = watched("teacher", "Gray")
    teacher.send(messages.Play(PlayStep.pause, 0.0))
    teacher.send(messages.Play(PlayStep.seek, 1900.0))
    teacher.until(lambda _, contact, *__: contact[0])
    viewer, end = watched("viewer").socket, time.monotonic() + 4
    while time.monotonic() < end:
        assert viewer.recv(timeout=1.4)
