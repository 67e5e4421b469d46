"""An exam in a real Chromium: what it offers, what it hides, claims, and the end of its time."""

from dataclasses import replace

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from support.browser import LAPTOP, PHONE
from support.example_organs import ellipsoid
from support.running_server import until
from support.touch_page import Touched

import palpate as pp
from palpate.meshes.tet_mesh import TetMesh
from palpate.server.exam import Exam
from palpate.server.lesson_server import exam_session
from palpate.server.live_session import LiveSession
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import running_session
from palpate.simulation.pointer import Pointer

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def lesson(tmp_path_factory):
    folder, mesh = tmp_path_factory.mktemp("lesson"), ellipsoid(11)
    plain = TetMesh(mesh.nodes, mesh.tets, np.ones(len(mesh.tets), dtype=np.int32), {1: "organ"})
    pp.write_tissue(folder / "tissue.vtu", pp.Tissue(plain, 5.0, 0.45, pp.resting_on(plain, (0, 0, -1), depth=8.0)))
    (folder / "lesson.yaml").write_text(pp.lesson_template("tissue.vtu"))
    return pp.read_lesson(folder / "lesson.yaml")


@pytest.fixture
def sat(browser, lesson):
    """Gives the page of an exam."""
    closing = []

    def start(viewport=LAPTOP, scheme="light", **changes):
        exam = Exam(replace(lesson, **changes), 7)
        session = exam_session(exam)
        live = LiveSession(session, Pointer(), lesson.title, task=exam.lesson.asked, exam=exam)
        serving = running_session(live, loopback_socket(None))
        context = browser.new_context(viewport=viewport, color_scheme=scheme)
        touched = Touched(session, context.new_page())
        touched.live = live
        closing.extend([serving, context])
        touched.open(serving.__enter__())
        return touched

    yield start
    serving, context = closing
    context.close()
    serving.__exit__(None, None, None)


def shown(touched, what):
    """Texts of the buttons that are seen."""
    return touched.see(
        f"[...document.querySelectorAll('{what} button')].filter((b) => b.offsetParent).map((b) => b.textContent)"
    )


@pytest.mark.parametrize(("viewport", "scheme"), [(LAPTOP, "light"), (PHONE, "dark")])
def test_an_exam_offers_what_its_lesson_allows(sat, album, viewport, scheme):
    touched = sat(viewport, scheme)
    if viewport is PHONE:
        touched.page.click("#more")
    assert shown(touched, "#tool") == ["Press", "Pull"]
    assert shown(touched, "#color-mode") == shown(touched, "#shading") == [], "there is nothing to choose"
    for hidden in (
        "#translucent",
        "#slices-toggle",
        "#model-and-mesh",
        "#stiffness-row",
        "#mesh-error-row",
        "#spread-row",
        "#linearity-row",
    ):
        assert not touched.page.locator(hidden).is_visible(), hidden
    for key in "34cwis6":
        touched.page.keyboard.press(key)
    pressed = "[...document.querySelectorAll('#tool [aria-pressed=true], #color-mode [aria-pressed=true]')]"
    assert touched.see(f"{pressed}.map((b) => b.textContent)") == ["Press", "Plain"]
    assert not touched.see("document.body.classList.contains('with-slices')")
    assert Axe().run(touched.page).response["violations"] == []
    touched.page.mouse.move(*touched.place())
    touched.page.mouse.down()
    touched.settle()
    frame = touched.see("palpate.frame")
    assert frame["contact"][0] == 1
    assert frame["mesh_error"] != frame["mesh_error"] or frame["mesh_error"] is None
    touched.page.screenshot(path=album / f"exam-{scheme}.png")
    assert not touched.page.locator("#stiffness-row").is_visible()
    touched.page.mouse.up()
    assert touched.problems == []


def test_claims_are_counted_and_the_time_ends(sat):
    touched = sat(claims=2, time=4.0)
    touched.page.mouse.move(*touched.place())
    touched.page.mouse.down()
    touched.wait("palpate.frame.contact[0] === 1")
    for count in (1, 2):
        touched.page.keyboard.press("f")
        until(lambda count=count: len(touched.session.events.marks) == count)
    touched.page.keyboard.press("f")
    touched.until_told("2 claims have been made")
    touched.until_told("time is over")
    touched.wait("palpate.frame.contact[0] === 0")
    touched.page.mouse.up()
    touched.drag(touched.place(), np.array((5, 5)), 3)
    touched.page.wait_for_timeout(300)
    assert touched.see("palpate.frame.contact[0]") == 0
    touched.page.mouse.up()
    assert len(touched.session.events.marks) == 2
    assert touched.problems == []
