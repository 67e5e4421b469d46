"""The server of an exam gives a page nothing that tells what is inside, whatever the page asks for."""

import httpx
import pytest
from support.lessons import lesson_file

import palpate as pp
from palpate.server.exam import Exam
from palpate.server.lesson_server import exam_session
from palpate.server.live_session import LiveSession
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import running_session
from palpate.simulation.pointer import Pointer

ROUTES = (
    "/",
    "/scene",
    "/scene?beside=1",
    "/solid",
    "/solid?beside=1",
    "/engine",
    "/album",
    "/values/0/0",
    "/static/main.js",
)


@pytest.fixture(scope="module")
def lesson(tmp_path_factory):
    return pp.read_lesson(lesson_file(tmp_path_factory.mktemp("lesson"), 9))


def answers(lesson, seed):
    """Of every address to a page that asks with its token."""
    exam = Exam(lesson, seed)
    live = LiveSession(exam_session(exam), Pointer(), lesson.title, task=lesson.asked, exam=exam)
    with running_session(live, loopback_socket(None), token="t") as address:
        base = address.split("/?")[0]
        asked = [httpx.get(f"{base}{route}{'&' if '?' in route else '?'}token=t") for route in ROUTES]
        return [(one.status_code, one.content) for one in asked]


def test_two_cases_answer_all_requests_alike(lesson):
    first, second = answers(lesson, 1), answers(lesson, 2)
    assert first == second
    assert first[1][0] == 200
    told = dict(zip(ROUTES, first, strict=True))
    assert told["/solid"] == (409, b"prediction: not in an exam")
