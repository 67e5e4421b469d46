"""A room in real pages: who is there, each other's hands, what each may do, what a teacher can stop."""

import os
import signal
from contextlib import ExitStack

import numpy as np
import pytest
from support.browser import LAPTOP, PHONE
from support.example_organs import organ
from support.open_rooms import open_rooms
from support.touch_page import Touched

import palpate as pp


class InRoom(Touched):
    """A page of somebody in a room."""

    def people(self):
        return self.page.locator("#people li b").all_text_contents()

    def press(self, across=0.5, down=0.45):
        """Holds the pointer down on the organ, 2 mm deep or so, until the force is there."""
        self.page.mouse.move(*self.place(across, down))
        self.page.mouse.down()
        self.wait("palpate.frame.contact[0] === 1 && Number(document.getElementById('force').textContent) > 0.02")

    def until_hand_of(self, name):
        self.wait(f"[...document.querySelectorAll('.hand-name')].some((n) => !n.hidden && n.textContent === '{name}')")

    def until_force_of(self, name):
        self.wait(
            f"[...document.querySelectorAll('#people li')]"
            f".some((n) => n.textContent.includes('{name}') && / N/.test(n.textContent))"
        )

    def shown(self, selector):
        return self.page.locator(selector).is_visible()


@pytest.fixture(scope="module")
def rooms(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rooms")
    pp.write_tissue(folder / "kidney.vtu", organ(9))
    with open_rooms([pp.RoomFile("anatomy", (folder / "kidney.vtu",), title="Kidney")], folder) as opened:
        yield opened


@pytest.fixture
def enter(rooms, browser):
    with ExitStack() as closing:
        pages = []

        def come(role, name="", viewport=LAPTOP, scheme="light"):
            touch = viewport is not LAPTOP
            context = browser.new_context(viewport=viewport, color_scheme=scheme, has_touch=touch, is_mobile=touch)
            closing.callback(context.close)
            pages.append(InRoom(None, context.new_page()))
            pages[-1].open(rooms.address("anatomy", role, name))
            pages[-1].wait("document.querySelectorAll('#people li').length > 0")
            return pages[-1]

        yield come
    assert [page.problems for page in pages if page.problems] == []


def test_each_sees_the_other_s_hand_by_name_and_who_leaves_lets_go(enter, album):
    teacher, trainee = enter("teacher", "Dr Gray"), enter("trainee", "Ada")
    teacher.wait("document.querySelectorAll('#people li').length === 2")
    assert teacher.people() == ["Dr Gray (you)", "Ada"]
    assert trainee.people() == ["Dr Gray", "Ada (you)"]
    trainee.press(0.45, 0.4)
    teacher.press(0.6, 0.5)
    for page, other in ((teacher, "Ada"), (trainee, "Dr Gray")):
        page.until_hand_of(other)
        page.until_force_of(other)
    teacher.page.screenshot(path=album / "room-teacher.png")
    trainee.page.screenshot(path=album / "room-trainee.png")
    assert teacher.see("palpate.frame.contact.filter((state) => state !== 0).length") == 1  # its own alone
    trainee.page.close()
    teacher.wait("document.querySelectorAll('#people li').length === 1")
    teacher.wait("[...document.querySelectorAll('.hand-name')].every((n) => n.hidden)")
    teacher.page.mouse.up()
    teacher.until_home()


def test_stopped_hands_stay_and_go_on(enter, album):
    teacher, trainee = enter("teacher"), enter("trainee")
    trainee.press()
    trainee.settle()
    before = trainee.tool()
    teacher.page.keyboard.press("h")
    trainee.wait("document.getElementById('room-state').textContent === 'All hands are stopped.'")
    trainee.page.mouse.move(*trainee.place(0.58, 0.45), steps=5)
    trainee.page.mouse.up()
    trainee.page.wait_for_timeout(500)
    np.testing.assert_allclose(trainee.tool()[0], before[0], atol=1e-5)
    assert trainee.tool()[3] == before[3]
    teacher.page.screenshot(path=album / "room-stopped.png")
    teacher.page.get_by_role("button", name="Go on", exact=True).click()
    trainee.until_home()


def test_a_teacher_takes_a_hand_over_and_lets_it_go(enter):
    teacher, trainee = enter("teacher"), enter("trainee", "Ada")
    trainee.press()
    trainee.settle()
    force = trainee.tool()[2]
    teacher.page.get_by_role("button", name="Take over: Ada").click()
    teacher.wait("palpate.frame.contact[0] === 1")
    np.testing.assert_allclose(teacher.tool()[2], force, rtol=0.02)
    trainee.wait("palpate.frame.contact.every((state) => state === 0)")
    trainee.wait("document.getElementById('force').textContent === '0.00'")
    trainee.page.mouse.up()
    teacher.page.locator("#let-go").click()
    teacher.until_home()


GUIDING = "palpate.guidance.told?.state === 2"
COUPLED = """(() => {
    const at = (values, tool) => [0, 1, 2].map((k) => values.point[3 * tool + k] + values.displacement[3 * tool + k]);
    const other = palpate.hands[0];
    return {own: at(palpate.frame, 0), other: at(other, 0), force: palpate.guidance.force, told: palpate.guidance.told,
            read: Number.parseFloat(document.getElementById('guidance-force').textContent)};
})()"""


def hold(page, point, displacement):
    page.see(f"palpate.hold(0, {list(point)}, {list(map(float, displacement))})")


def until_rest(page):
    """Until the tools and the coupling between them stand still, and the reading is that of now."""
    page.settle()
    page.wait(
        "Math.abs(parseFloat(document.getElementById('guidance-force').textContent)"
        " - Math.hypot(...palpate.guidance.force)) < 0.0051"
    )


def test_a_teacher_guides_a_hand_and_both_see_it(enter, album):
    """Both hold with the mouse: the teacher asks first, and it begins with the teacher's touch."""
    teacher, trainee, viewer = enter("teacher", "Dr Gray"), enter("trainee", "Ada"), enter("viewer", "Bo")
    trainee.press(0.45, 0.4)
    trainee.settle()
    alone = trainee.tool()[0]
    teacher.page.get_by_role("button", name="Guide: Ada").click()
    trainee.wait(
        "document.getElementById('guidance-who').textContent === 'Dr Gray guides you once both hold the organ.'"
    )
    teacher.press(0.58, 0.5)
    for page, words in ((teacher, "You guide Ada"), (trainee, "Dr Gray guides you"), (viewer, "Dr Gray guides Ada")):
        page.wait(GUIDING)
        page.wait(f"document.getElementById('guidance-who').textContent === '{words}'")
    until_rest(trainee)
    until_rest(teacher)
    teacher.page.screenshot(path=album / "room-guiding.png")
    trainee.page.screenshot(path=album / "room-guided.png")
    led, leads = trainee.see(COUPLED), teacher.see(COUPLED)
    np.testing.assert_allclose(led["force"], leads["force"], atol=0.02)  # on the trainee; the teacher's is its opposite
    viewer.wait(f"Math.abs(parseFloat(document.getElementById('guidance-force').textContent) - {led['read']}) < 0.02")
    assert led["read"] > 0.2
    towards = np.subtract(led["other"], led["own"])
    drawn = np.subtract(trainee.tool()[0], alone)
    assert np.dot(drawn, towards) > 0.9 * np.linalg.norm(drawn) * np.linalg.norm(towards)
    assert np.linalg.norm(drawn) > 0.5
    teacher.page.mouse.up()  # it ends, and the trainee's tool is where the hand has it
    for page in (teacher, trainee, viewer):
        page.wait("palpate.guidance.told === null && document.getElementById('guidance').hidden")
    trainee.settle()
    np.testing.assert_allclose(trainee.tool()[0], alone, atol=0.02)
    trainee.page.mouse.up()
    trainee.until_home()


def test_the_force_of_a_guidance_is_that_of_its_spring_and_the_button_ends_it(enter):
    teacher, trainee = enter("teacher", "Dr Gray"), enter("trainee", "Ada")
    hold(trainee, (0.0, 0.0, 25.0), (0, 0, -2))
    hold(teacher, (8.0, 0.0, 24.5), (0, 0, -2))
    button = teacher.page.get_by_role("button", name="Guide: Ada")
    button.click()
    for page in (teacher, trainee):
        page.wait(GUIDING)
    until_rest(trainee)
    until_rest(teacher)
    led, leads = trainee.see(COUPLED), teacher.see(COUPLED)
    spring = 0.1 * np.subtract(led["other"], led["own"])
    assert np.linalg.norm(spring) > 0.3
    np.testing.assert_allclose(led["force"], spring, atol=0.01)
    np.testing.assert_allclose(leads["force"], spring, atol=0.01)
    np.testing.assert_allclose(trainee.tool()[1], np.add((0, 0, -2), 5 * np.array(led["force"])), atol=0.05)
    assert button.get_attribute("aria-pressed") == "true"
    button.click()
    for page in (teacher, trainee):
        page.wait("palpate.guidance.told === null")
    page = trainee
    page.wait("palpate.frame.contact[0] === 1 && Math.abs(palpate.frame.displacement[0]) < 0.01")
    np.testing.assert_allclose(trainee.tool()[1], (0, 0, -2), atol=0.02)
    for page in (teacher, trainee):
        page.see("palpate.release(0)")
    trainee.until_home()


def test_who_watches_can_look_and_measure_and_nothing_else(enter, album):
    viewer, trainee = enter("viewer", "A guest", PHONE, "dark"), enter("trainee", "Ada")
    viewer.wait("document.querySelector('#tool [data-value=press]').hidden")
    assert not viewer.shown("#lead-row")
    assert not viewer.shown("#undo-cut")
    trainee.press()
    viewer.until_hand_of("Ada")
    viewer.wait("palpate.frame.count > 0")  # the organ is deformed here too
    viewer.page.screenshot(path=album / "room-viewer-phone.png")
    assert viewer.see("document.documentElement.scrollWidth <= innerWidth")
    viewer.drag(viewer.place(), np.array((60, 0)))
    viewer.page.mouse.up()
    assert viewer.see("palpate.lastSerial") == 0
    trainee.page.mouse.up()
    assert not trainee.shown("#lead-row")
    trainee.page.locator("#more").evaluate("(button) => button.click()")
    assert not trainee.shown("#model")


def test_an_invitation_that_is_over_says_so(rooms, browser):
    """Of a page that is opened, and of one that is loaded again later."""
    page = browser.new_page()
    page.goto(rooms.address("anatomy", "trainee", hours=1e-9))
    page.get_by_text("the invitation is over; ask the teacher for a new one").wait_for()
    page.goto(rooms.address("anatomy", "trainee", hours=2.5 / 3600))
    page.wait_for_timeout(3000)
    page.reload()
    page.get_by_text("Not let in: the invitation is over; ask the teacher for a new one.").wait_for()
    page.context.close()


def test_a_room_whose_process_dies_is_back_with_its_state(enter, rooms):
    """No force is shown meanwhile; the page finds it again by itself."""
    trainee = enter("trainee", "Ada")
    trainee.press()
    room = rooms.rooms["anatomy"]
    deaths = room.deaths
    trainee.see("""(() => {
        window.lost = [];
        new MutationObserver(() => lost.push(document.getElementById('force').textContent)).observe(
            document.getElementById('status'), { attributes: true, attributeFilter: ['class'] });
    })()""")
    room._process.kill()
    trainee.wait("lost.length > 0")
    assert trainee.see("lost[0]") == "0.00"
    trainee.wait("document.getElementById('status').classList.contains('good')")
    assert room.deaths == deaths + 1
    trainee.page.mouse.up()
    trainee.wait("document.querySelectorAll('#people li').length === 1")
    trainee.press()
    trainee.page.mouse.up()
    trainee.until_home()
    trainee.problems.clear()  # the browser's own line about the lost connection


def test_a_room_that_falls_silent_shows_no_force(enter, rooms):
    trainee = enter("trainee", "Ada")
    trainee.press()
    process = rooms.rooms["anatomy"]._process.pid
    os.kill(process, signal.SIGSTOP)
    try:
        trainee.wait("document.getElementById('status').textContent.includes('does not answer')", 5)
        assert trainee.see("document.getElementById('force').textContent") == "0.00"
    finally:
        os.kill(process, signal.SIGCONT)
    trainee.wait("document.getElementById('status').classList.contains('good')")
    trainee.page.mouse.up()
    trainee.until_home()


def test_a_lecture_is_seen_by_all_as_the_teacher_plays_it(browser, album, tmp_path):
    """Two sessions side by side, through the gateway; whoever does not teach has no controls."""
    tissue = organ(9)
    pp.write_tissue(tmp_path / "kidney.vtu", tissue)
    for name, depth in (("novice", -3), ("expert", -5)):
        session = pp.Session(pp.model(tissue, "compliance"), radius=9.0, sweeps=2)
        session.step([None] * 500 + [pp.Command(True, (0.0, 0.0, 25.0), (0, 0, depth))] * 1500)
        pp.write_record(tmp_path / f"{name}.h5", session.record())
    sessions = tuple(tmp_path / f"{name}.h5" for name in ("novice", "expert"))
    room = pp.RoomFile("lecture", (tmp_path / "kidney.vtu",), title="A press", replay=sessions)
    with open_rooms([room], tmp_path) as opened, ExitStack() as closing:
        pages = []
        for role, name in (("teacher", "Dr Gray"), ("trainee", "Ada")):
            context = browser.new_context(viewport=LAPTOP)
            closing.callback(context.close)
            pages.append(InRoom(None, context.new_page()))
            pages[-1].open(opened.address("lecture", role, name))
            pages[-1].wait("document.querySelectorAll('#people li').length > 0 && palpate.secondFrame")
        teacher, trainee = pages
        assert not teacher.page.is_disabled("#play")
        assert trainee.page.is_disabled("#seek")
        for control in ("play", "play-speed", "event-before", "event-after"):
            assert not trainee.shown(f"#{control}")
        assert "as the teacher plays it" in trainee.page.inner_text("#play-time")
        for page in pages:
            assert not page.shown("#lead-row")
            assert not page.shown("#predict")
        teacher.wait("document.getElementById('play').textContent === 'Play'")  # it has come to its end
        teacher.page.locator("#seek").fill("1900")
        for page in pages:
            page.wait(
                "palpate.frame.tick === 1900 && palpate.frame.contact[0] === 1 && palpate.secondFrame.contact[0] === 1"
            )
        trainee.page.focus("#view")
        trainee.page.keyboard.press("p")
        trainee.page.keyboard.press("j")
        trainee.page.wait_for_timeout(3000)  # a paused lecture is no silent room
        for page in pages:
            assert page.see("palpate.frame.tick") == 1900
            assert page.see("document.getElementById('status').classList.contains('good')")
        teacher.page.click("#play")
        for page in pages:
            page.wait("palpate.frame.tick === 2000 && palpate.secondFrame.tick === 2000")
        forces = [
            page.see("[palpate.frame.force.slice(0, 3), palpate.secondFrame.force.slice(0, 3)]") for page in pages
        ]
        assert forces[0] == forces[1]
        assert np.linalg.norm(forces[0][1]) > 1.5 * np.linalg.norm(forces[0][0])
        trainee.page.screenshot(path=album / "room-lecture.png")
        assert [page.problems for page in pages] == [[], []]
