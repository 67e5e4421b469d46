"""The organ in a headset: real Chromium, the headset and its controllers emulated by another's hand."""

import numpy as np
import pytest
from support.browser import LAPTOP
from support.example_organs import organ
from support.touch_page import Touched, agrees_with_push
from support.webxr_emulator import EYES, emulator

import palpate as pp
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import serving

pytestmark = pytest.mark.browser
RIGHT = 1  # the tool that the right hand is
TOP = np.array([0, 0, 25.0])  # mm, of the organ


@pytest.fixture(scope="module")
def script(tmp_path_factory):
    return emulator(tmp_path_factory.mktemp("headset"))


@pytest.fixture
def worn(browser, script):
    """A page, and a headset put on."""
    session = pp.Session(pp.model(organ(11), "compliance"), radius=10.0)
    context = browser.new_context(viewport=LAPTOP)
    page = context.new_page()
    page.add_init_script(script)
    with serving(session, loopback_socket(None), title="Test organ") as address:
        touched = Touched(session, page)
        touched.open(address)
        page.click("#headset")
        touched.wait("Boolean(headset.activeSession) && palpate.frame.contact[1] !== 0")
        yield touched
        assert touched.problems == []
        context.close()


def hand(touched, tip, side="right"):
    """Moves a controller to a place of the organ, mm: five times life-size, 0.7 m before the eyes and 0.25 m under them."""
    x, y, z = np.asarray(tip) / 200
    touched.see(f"(headset.controllers.{side}.position.set({x}, {EYES - 0.25 + z}, {-0.7 - y}), 0)")


def obeyed(touched):
    """Waits until the loop obeys what the controllers do now."""
    drawn = touched.see("palpate.framesDrawn")
    touched.wait(f"palpate.framesDrawn > {drawn + 1}")
    sent = touched.see("palpate.lastSerial")
    touched.wait(f"palpate.frame.serial >= {sent}")


def arrive(touched, tip):
    """Moves the right hand and waits until its tool is there. What a hand does between two pictures nobody sees, and they
    may come late: without this, one that is sent on at once comes down aslant, from wherever it was."""
    hand(touched, tip)
    obeyed(touched)
    tick = touched.see("palpate.frame.tick")
    touched.wait(f"palpate.frame.tick > {tick + 100}")  # a tool in space does 5 mm a tick


def squeeze(touched, value):
    touched.see(f"(headset.controllers.right.updateButtonValue('trigger', {value}), 0)")


def flesh(picture):
    return picture[..., 0] > picture[..., 2] + 30


def test_a_controller_presses_as_deep_as_it_goes(worn, album):
    for above in (20, 5, -2, -6):
        arrive(worn, TOP + [0, 0, above])
    worn.settle()
    point, displacement, force, _ = worn.tool(RIGHT)
    np.testing.assert_allclose(point, TOP, atol=0.2)
    np.testing.assert_allclose(displacement, [0, 0, -6], atol=0.1)
    assert force[2] > 0.5  # pushed up
    agrees_with_push(worn, RIGHT)
    worn.page.screenshot(path=album / "headset.png")


def test_each_eye_sees_the_organ_from_its_own_place(worn):
    picture = worn.pixels("#view")
    half = picture.shape[1] // 2
    left, right = flesh(picture[:, :half]), flesh(picture[:, half : 2 * half])
    assert min(left.mean(), right.mean()) > 0.02
    middle = [np.nonzero(eye)[1].mean() for eye in (left, right)]
    assert middle[0] > middle[1] + 2  # what is near lies further right for the left eye


def test_a_trigger_takes_hold_and_lets_go(worn, album):
    for above in (10, -1):
        arrive(worn, TOP + [0, 0, above])
    worn.wait(f"palpate.frame.contact[{RIGHT}] === 1")
    squeeze(worn, 1)
    obeyed(worn)
    hand(worn, TOP + [3, 2, 9])
    worn.wait(f"palpate.frame.displacement[{3 * RIGHT + 2}] > 8.5")
    worn.settle()
    _, displacement, force, _ = worn.tool(RIGHT)
    np.testing.assert_allclose(displacement, [3, 2, 9], atol=0.3)
    assert np.dot(force, displacement) < 0  # drawn back
    agrees_with_push(worn, RIGHT)
    worn.page.screenshot(path=album / "headset-pull.png")
    squeeze(worn, 0)
    worn.wait(f"palpate.frame.contact[{RIGHT}] !== 1 && palpate.frame.count === 0")


def test_taken_off_nothing_touches_and_the_page_is_as_before(worn):
    hand(worn, TOP - [0, 0, 4])
    worn.wait(f"palpate.frame.contact[{RIGHT}] === 1")
    worn.see("headset.activeSession.end()")
    worn.until_home()
    worn.drag(worn.place(), np.array((30, 10)))
    worn.wait("palpate.frame.contact[0] === 1")
    worn.page.mouse.up()
    worn.until_home()
    picture = worn.pixels("#view")
    assert abs(np.nonzero(flesh(picture))[1].mean() / picture.shape[1] - 0.5) < 0.1  # one organ, in the middle


def test_without_a_headset_none_is_offered(browser):
    session = pp.Session(pp.model(organ(5), "compliance"), radius=10.0)
    context = browser.new_context(viewport=LAPTOP)
    with serving(session, loopback_socket(None), title="Test organ") as address:
        touched = Touched(session, context.new_page())
        touched.open(address)
        assert not touched.page.locator("#headset").is_visible()
    context.close()
