"""Two sites far from each other in one room: what a hand feels there while the page predicts."""

from contextlib import ExitStack
from urllib.parse import urlsplit

import numpy as np
import pytest
from support.browser import LAPTOP
from support.delayed_link import delayed_link
from support.example_organs import organ
from support.open_rooms import open_rooms
from support.touch_page import Touched
from support.two_sites import two_sites

import palpate as pp

DELAY = 0.15  # s each way
RADIUS = 8.0  # mm
LEFT, RIGHT = (-10.0, 0.0, 25.0), (10.0, 0.0, 25.0)


@pytest.fixture(scope="module")
def tissue():
    return organ(9)


@pytest.fixture(scope="module")
def rooms(tissue, tmp_path_factory):
    folder = tmp_path_factory.mktemp("far-rooms")
    pp.write_tissue(folder / "kidney.vtu", tissue)
    room = pp.RoomFile("anatomy", (folder / "kidney.vtu",), title="Kidney", model="compliance", radius=RADIUS)
    with open_rooms([room], folder) as opened:
        yield opened


@pytest.fixture
def far(rooms, browser):
    """Opens pages whose way to the room is long."""
    with ExitStack() as closing:
        pages = []

        def come(role, delay=DELAY, predict=True, **how):
            address = urlsplit(rooms.address("anatomy", role))
            link = closing.enter_context(delayed_link(address.port, delay, **how))
            context = browser.new_context(viewport=LAPTOP)
            closing.callback(context.close)
            page = Touched(None, context.new_page())
            page.link = link
            pages.append(page)
            page.open(address._replace(netloc=f"{address.hostname}:{link.port}").geturl())
            page.wait("document.querySelectorAll('#people li').length > 0")
            if predict:
                page.page.locator("#predict").click()
                page.wait("document.getElementById('predict').textContent === 'Predict'")
                page.wait("document.getElementById('predict').getAttribute('aria-pressed') === 'true'")
            return page

        yield come
    assert [page.problems for page in pages if page.problems] == []


def hold(page, point, displacement, tool=0):
    page.see(f"palpate.hold({tool}, {list(point)}, {list(map(float, displacement))})")


def test_force_of_both_hands_is_that_of_one_push(far, tissue):
    """At rest, on both pages, and of the same organ."""
    first, second = far("trainee"), far("teacher")
    hold(first, LEFT, (1.0, 0, -2.5))
    hold(second, RIGHT, (-1.0, 0.5, 2.0))
    for page in (first, second):
        page.wait("palpate.hands.length === 1 && palpate.hands[0].contact === 1")
        page.settle(1500)
    points, displacements = [LEFT, RIGHT], [(1.0, 0, -2.5), (-1.0, 0.5, 2.0)]
    expected = pp.model(tissue, "compliance").push(points, displacements, RADIUS)
    for page, force in zip((first, second), expected.force, strict=True):
        assert np.linalg.norm(page.tool()[2] - force) < 0.02 * np.linalg.norm(force)


def test_stopped_and_taken_over_hands_follow_the_room(far):
    """What a teacher does holds for a hand that predicts."""
    trainee, teacher = far("trainee"), far("teacher", delay=0.02)
    hold(trainee, LEFT, (0, 0, -2.0))
    trainee.settle()
    teacher.wait("palpate.hands.length === 1 && palpate.hands[0].contact === 1")
    teacher.page.keyboard.press("h")
    trainee.wait("document.getElementById('room-state').textContent === 'All hands are stopped.'")
    hold(trainee, LEFT, (0, 0, 3.0))
    trainee.page.wait_for_timeout(600)
    np.testing.assert_allclose(trainee.tool()[1], (0, 0, -2), atol=0.02)
    teacher.page.keyboard.press("h")
    trainee.wait("palpate.frame.displacement[2] > 2.9")
    teacher.page.locator("#people button", has_text="Let go").evaluate("(button) => button.click()")
    trainee.until_home()
    hold(trainee, LEFT, (0, 0, 2.0))  # it begins anew only after it has let go
    trainee.page.wait_for_timeout(600)
    assert trainee.tool()[3] == 0
    trainee.see("palpate.release(0)")
    hold(trainee, LEFT, (0, 0, 2.0))
    trainee.wait("palpate.frame.contact[0] === 1 && palpate.frame.displacement[2] > 1.9")


def test_after_a_cut_the_page_predicts_the_cut_organ(far, tissue):
    """The teacher cuts, the trainee feels it: by the page's own engine, as `push` says of the organ that is cut."""
    trainee, teacher = far("trainee"), far("teacher", delay=0.02, predict=False)
    teacher.page.click("#cut-tool")
    start = teacher.place(0.4, 0.42)
    teacher.page.mouse.move(*start)
    teacher.page.mouse.down()
    teacher.page.mouse.move(*(start + (160, 0)), steps=20)
    teacher.page.mouse.up()
    teacher.wait("palpate.scene.made === 1")
    teacher.settle(1500)
    predicting = "[predict.textContent, predict.getAttribute('aria-pressed')].join() === 'Predict,true'"
    for _ in range(5):  # the cut follows the stroke, a body for each part of it: until one has lasted
        trainee.wait(f"palpate.scene.made === 1 && palpate.scene.body === palpate.frame.body && {predicting}")
        body = trainee.see("palpate.frame.body")
        hold(trainee, LEFT, (0, 0, 2.0))
        trainee.settle(1500)
        predicted, force = trainee.see(predicting), trainee.tool()[2]
        trainee.page.locator("#predict").click()
        trainee.wait("document.getElementById('predict').getAttribute('aria-pressed') === 'false'")
        trainee.settle(1500)
        if trainee.see("palpate.frame.body") == body:
            break
        trainee.see("palpate.release(0)")
        trainee.until_home()
        trainee.page.locator("#predict").click()
    assert predicted
    assert np.linalg.norm(trainee.tool()[2] - force) < 0.02 * np.linalg.norm(force)
    assert np.linalg.norm(force) > 0.1
    teacher.page.keyboard.press("z")
    trainee.wait("palpate.scene.made === 0")


COUPLED = """(() => {
    const at = (values) => [0, 1, 2].map((k) => values.point[k] + values.displacement[k]);
    return {own: at(palpate.frame), other: at(palpate.hands[0]), force: palpate.guidance.force};
})()"""


def test_a_hand_is_guided_from_afar(far):
    """At rest both pages make the same force, each by itself, while both predict; it ends when the teacher lets go."""
    trainee, teacher = far("trainee"), far("teacher")
    points = [(x, 0.0, float(25 * np.sqrt(1 - (x / 40) ** 2))) for x in (-10.0, -2.0)]  # on the surface
    hold(trainee, points[0], (0, 0, -2.0))
    hold(teacher, points[1], (0, 0, -2.0))
    teacher.wait("palpate.hands.length === 1 && palpate.hands[0].contact === 1")
    teacher.page.locator("#people button", has_text="Guide").evaluate("(button) => button.click()")
    for page in (teacher, trainee):
        page.wait("palpate.guidance.told?.state === 2 && Math.hypot(...palpate.guidance.force) > 0.3")
        page.settle(1500)
    told = [page.see(COUPLED) for page in (trainee, teacher)]
    spring = 0.1 * np.subtract(told[0]["other"], told[0]["own"])
    for one in told:
        np.testing.assert_allclose(one["force"], spring, atol=0.02)
    np.testing.assert_allclose(told[0]["force"], told[1]["force"], atol=1e-3)
    np.testing.assert_allclose(trainee.tool()[1], np.add((0, 0, -2), 5 * np.array(told[0]["force"])), atol=0.05)
    teacher.see("palpate.release(0)")
    trainee.wait("palpate.guidance.told === null && Math.abs(palpate.frame.displacement[0]) < 0.02")
    assert trainee.tool()[3] == 1


LARGEST_FORCE = """(() => {
    window.largestForce = 0;
    setInterval(() => {
        if (palpate.frame) largestForce = Math.max(largestForce, Math.hypot(...palpate.frame.force.slice(0, 3)));
    }, 4);
})()"""


def test_a_hand_is_answered_without_the_room_and_not_for_long(far):
    page = far("trainee")
    hold(page, LEFT, (0, 0, -1.0))
    page.settle()
    page.see("palpate.release(0)")
    page.until_home()
    page.see(LARGEST_FORCE)
    page.link.cut = True
    hold(page, LEFT, (0, 0, -2.0))
    page.wait("largestForce > 0.1")
    page.wait("document.getElementById('status').textContent.includes('does not answer')")
    page.wait("palpate.frame.force.every((f) => f === 0)")
    page.wait("document.getElementById('force').textContent === '0.00'")


def test_two_hands_that_pull_against_each_other_get_no_energy(tissue, tmp_path):
    """In virtual time, and beside it what they get without prediction."""
    directions = [(-0.8, 0, 0.6), (0.8, 0, 0.6)]
    for predict in (True, False):
        told = two_sites(organ(5), tmp_path, [LEFT, RIGHT], directions, delay=150, predict=predict, contacts=1)
        felt = [contact for hand in told["hands"] for contact in hand]
        assert len(felt) == 2
        assert min(contact["largest"] for contact in felt) > 0.5
        if not predict:
            assert max(contact["energy"] for contact in felt) > 4
            continue
        assert max(contact["energy"] for contact in felt) < 2  # mJ
        assert max(contact["step"] / contact["largest"] for contact in felt) < 0.05
        assert max(each["sites"] for each in told["apart"]) < 0.5  # mm
        assert max(each["room"] for each in told["apart"]) < 0.5
        assert min(each["moved"] for each in told["apart"]) > 5
