"""A case of a lesson in one file: in a real Chromium, offline, it is taken as a served exam is, and its session is judged."""

import json

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from support.browser import LAPTOP, PHONE
from support.lessons import lesson_file
from support.running_server import ended
from support.touch_page import Touched

import palpate as pp
from palpate.server.exam import Exam
from palpate.simulation.lesson import EXAM_FORCE, EXAM_LENGTH
from palpate.standalone.organ_data import case_data, case_session

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("class")
    lesson_file(folder, 11, claims=2, time=5)
    code, out, err = ended("lesson export lesson.yaml --seed 7 -o case.html", folder)
    assert code == 0, err
    assert "case 7" in out
    return folder


@pytest.fixture(params=[(LAPTOP, "light"), (PHONE, "dark")], ids=["laptop", "phone"])
def taken(browser, folder, request):
    viewport, scheme = request.param
    context = browser.new_context(viewport=viewport, color_scheme=scheme)
    context.set_offline(True)
    page = Touched(None, context.new_page())
    page.open((folder / "case.html").as_uri())
    if viewport is PHONE:
        page.page.click("#more")
    yield page
    assert page.problems == []
    context.close()


def shown(page, what):
    return page.see(
        f"[...document.querySelectorAll('{what} button')].filter((b) => b.offsetParent).map((b) => b.textContent)"
    )


def test_it_is_taken_offline_as_a_served_exam(taken, folder, album, tmp_path):
    lesson = pp.read_lesson(folder / "lesson.yaml")
    assert taken.page.title() == f"{lesson.title} – palpate"
    assert taken.page.inner_text("#task") == lesson.asked
    assert shown(taken, "#tool") == ["Press", "Pull"]
    assert shown(taken, "#color-mode") == shown(taken, "#shading") == []
    for hidden in (
        "#translucent",
        "#stiffness-row",
        "#mesh-error-row",
        "#spread-row",
        "#linearity-row",
        "#slices-toggle",
        "#model-and-mesh",
    ):
        assert not taken.page.locator(hidden).is_visible(), hidden
    assert taken.see("palpate.scene.parts.length") == 1
    assert Axe().run(taken.page).response["violations"] == []
    taken.page.mouse.move(*taken.place())
    taken.page.mouse.down()
    taken.wait("palpate.frame.contact[0] === 1 && Math.abs(palpate.frame.force[2]) > 0.05")
    frame = taken.see("palpate.frame")
    for name, step in (("force", EXAM_FORCE), ("displacement", EXAM_LENGTH), ("point", EXAM_LENGTH)):
        steps = np.array(frame[name]) / step
        np.testing.assert_allclose(steps, np.rint(steps), atol=1e-3, err_msg=name)
    assert frame["step"] == pytest.approx(EXAM_LENGTH)
    taken.page.screenshot(path=album / f"exported-exam-{taken.page.viewport_size['width']}.png")
    for _ in range(2):
        taken.page.keyboard.press("f")
        taken.until_told("Noted")
    taken.page.keyboard.press("f")
    taken.until_told("2 claims have been made")
    taken.until_told("time is over")
    taken.wait("palpate.frame.contact[0] === 0")
    taken.page.mouse.up()
    taken.drag(taken.place(), np.array((5, 5)), 3)
    taken.page.wait_for_timeout(300)
    assert taken.see("palpate.frame.contact[0]") == 0
    taken.page.mouse.up()
    with taken.page.expect_download() as saved:
        taken.page.locator("#save-session").click()
    saved.value.save_as(folder / "session.json")
    record = pp.read_record(folder / "session.json")
    assert json.loads(record.lesson) == json.loads(Exam(lesson, 7).description)
    result = pp.lesson_result(record, lesson)
    assert (result.seed, result.channel, len(result.score.claims), result.score.touches) == (7, "screen", 2, 1)
    code, out, err = ended("lesson score session.json lesson.yaml -o report.html", folder)
    assert code == 0, err
    assert "case 7, force by screen: " in out


def test_two_cases_are_drawn_alike_and_feel_different(folder):
    """What is drawn, sizes included; the solid differs, which the engine needs."""
    lesson = pp.read_lesson(folder / "lesson.yaml")
    parts = []
    for seed in (7, 8):
        exam = Exam(lesson, seed)
        data = case_data(case_session(exam), exam)
        found, at = [], 0
        while at < len(data):
            length = int.from_bytes(data[at : at + 4], "little")
            found.append(data[at + 4 : at + 4 + length])
            at += 4 + length
        parts.append(found)
    (scene, solid, rules), (other_scene, other_solid, other_rules) = parts
    assert scene == other_scene
    assert len(solid) == len(other_solid)
    assert solid != other_solid
    assert json.loads(rules)["claims"] == json.loads(other_rules)["claims"] == 2


def test_a_class_is_a_folder_of_pages(folder):
    code, _, err = ended("lesson export lesson.yaml --seed 3 --cases 2 -o class --channel sound", folder)
    assert code == 0, err
    assert sorted(path.name for path in (folder / "class").iterdir()) == ["case-3.html", "case-4.html"]
    code, _, err = ended("lesson export lesson.yaml --seed 3 -o case-3.html --channel device", folder)
    assert code == 2
    assert "screen, sound, gamepad" in " ".join(err.split())
    assert not (folder / "case-3.html").exists()
