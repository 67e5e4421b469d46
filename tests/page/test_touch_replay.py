"""The timeline of a replay in a real Chromium: seeking by pointer and keys, pausing, speeds, two sessions side by side."""

from contextlib import ExitStack
from urllib.parse import urlsplit

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from support.browser import LAPTOP, PHONE
from support.delayed_link import delayed_link
from support.example_organs import organ
from support.touch_page import Touched

import palpate as pp
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import replayed, running_session

pytestmark = pytest.mark.browser

TOP, LENGTH = (0.0, 0.0, 25.0), 4000
PRESS = [None] * 500 + [pp.Command(True, TOP, (0, 0, -6))] * 1500 + [None] * 2000


@pytest.fixture(scope="module")
def tissue():
    return organ()


def session_of(tissue, model="springs", **how):
    return pp.Session(pp.model(tissue, model), radius=8.0, sweeps=2, **how)


@pytest.fixture(scope="module")
def records(tissue):
    """Of a press from above, and of a weaker one that comes later."""
    found = {}
    for name, late, depth in (("mine", 500, -6), ("hers", 1500, -3)):
        session = session_of(tissue, limit=1.0)
        session.step([None] * late + [pp.Command(True, TOP, (0, 0, depth))] * 1500)
        session.mark(0)
        session.step([None] * (LENGTH - 1500 - late))
        found[name] = session.record()
    return found


class Replayed(Touched):
    """A page of a replay."""

    def seek(self, tick):
        """With the slider's own value, as a drag of it sets it."""
        self.page.locator("#seek").fill(str(tick))
        self.arrive(tick)

    def arrive(self, tick):
        self.wait(f"palpate.frame.tick === {tick} && document.getElementById('seek').value === '{tick}'")

    def text(self, name):
        return self.page.inner_text(f"#{name}")


@pytest.fixture
def opened(browser, tissue):
    """Gives what opens a page of a replay. delay: s, of the way to it and back each."""
    with ExitStack() as closing:
        pages = []

        def open_page(records, viewport=LAPTOP, scheme="light", of=None, delay=None):
            live = replayed(records, {"organ": of or tissue}, 0.0, ())
            address = closing.enter_context(running_session(live, loopback_socket(None)))
            if delay is not None:
                parts = urlsplit(address)
                link = closing.enter_context(delayed_link(parts.port, delay, loss=0.0))
                address = parts._replace(netloc=f"{parts.hostname}:{link.port}").geturl()
            touch = viewport is not LAPTOP
            context = browser.new_context(viewport=viewport, color_scheme=scheme, has_touch=touch, is_mobile=touch)
            closing.callback(context.close)
            page = Replayed(live.session, context.new_page())
            page.live = live
            pages.append(page)
            page.open(address)
            page.wait("!document.getElementById('timeline').hidden")
            return page

        yield open_page
    assert [page.problems for page in pages if page.problems] == []


PAUSE_IF_PLAYING = """(() => {
    const button = document.getElementById('play');
    if (button.textContent === 'Pause') button.click();
})()"""


def pause(page):
    """In one step of the page: where the replay ends before a key arrives, the key begins it anew."""
    page.see(PAUSE_IF_PLAYING)
    page.wait("document.getElementById('play').textContent === 'Play'")


def test_seeking_by_pointer_and_keys_shows_the_state_of_playing(opened, records, tissue, album):
    page = opened({"mine": records["mine"]})
    pause(page)
    fresh = session_of(tissue, limit=1.0)
    forces = np.concatenate([force for _, force in fresh.replayed(records["mine"], 100)])
    for tick in (1800, 700, 3999, 20):  # ahead, and back
        page.seek(tick)
        np.testing.assert_allclose(page.tool()[2], forces[tick - 1, 0], atol=1e-5)
        page.read(forces[tick - 1, 0])
    assert np.linalg.norm(forces[1799, 0]) > 1
    box = page.page.locator("#timeline-plot").bounding_box()
    page.page.mouse.click(box["x"] + box["width"] / 2, box["y"] + 20)
    page.arrive(LENGTH // 2)
    keyboard = page.page.keyboard
    for key, tick in (("j", 1000), ("l", 2000), ("l", 3000)):
        keyboard.press(key)
        page.arrive(tick)
    page.page.locator("#seek").focus()
    keyboard.press("Home")
    page.arrive(0)
    page.wait("document.getElementById('timeline-key').textContent.includes('force limit')")
    for event in (500, 510, 2000):  # the second one: the force passes its limit
        keyboard.press(".")
        page.arrive(event)
    assert page.text("event-now") == "Claim: a lump is here"
    keyboard.press(",")
    page.arrive(510)
    page.seek(1500)
    page.page.screenshot(path=album / "replay.png")
    assert page.text("play-time") == "0:01.5 of 0:04.0"
    session = session_of(tissue, limit=1.0)
    session.step(PRESS[:1500])
    assert page.live.player.session.displacement.tobytes() == session.displacement.tobytes()


SLOWER_THEN_SEEK = """new Promise((done) => {
    const speed = document.getElementById('play-speed'), slider = document.getElementById('seek'), seen = [];
    speed.value = '0.5';
    speed.dispatchEvent(new Event('change'));
    setTimeout(() => {
        slider.value = '1200';
        slider.dispatchEvent(new Event('input'));
        const look = () => {
            seen.push(Number(slider.value));
            if (palpate.frame.tick === 1200) done(seen);
            else requestAnimationFrame(look);
        };
        look();
    }, 150);
})"""


def test_the_slider_stays_where_it_was_put(opened, records):
    """While an answer to what was asked before is still on its way."""
    page = opened({"mine": records["mine"]}, delay=0.2)
    pause(page)
    page.seek(700)
    assert set(page.see(SLOWER_THEN_SEEK)) == {1200}
    page.page.keyboard.press("j")
    page.arrive(200)
    assert page.see("document.getElementById('play-speed').value") == "0.5"


def test_it_plays_to_the_end_and_from_the_start_again_at_the_speed_that_is_chosen(opened, records):
    page = opened({"mine": records["mine"]})
    page.page.select_option("#play-speed", "4")
    page.arrive(LENGTH)
    page.wait("document.getElementById('play').textContent === 'Play'")
    page.page.select_option("#play-speed", "0.25")
    page.page.click("#play")
    page.wait("palpate.frame.tick < 2000 && document.getElementById('play').textContent === 'Pause'")
    pause(page)
    page.seek(100)
    page.page.keyboard.press("p")
    page.wait("palpate.frame.tick > 100")
    for key, speed in (("[", "0.25"), ("]", "0.5"), ("]", "1"), ("[", "0.5"), ("[", "0.25")):
        page.page.keyboard.press(key)
        page.wait(f"document.getElementById('play-speed').value === '{speed}'")


def test_events_and_the_limit_of_the_force_are_on_the_timeline(opened, records):
    page = opened({"mine": records["mine"]})
    page.wait("document.getElementById('timeline-key').textContent.includes('force limit')")
    assert page.text("timeline-key").split() == ["▲", "touch", "▽", "release", "★", "claim", "!", "force", "limit"]
    pause(page)
    page.page.locator("#seek").focus()
    page.page.keyboard.press("Home")
    page.arrive(0)
    told = []
    for _ in range(3):
        before = page.see("palpate.frame.tick")
        page.page.click("#event-after")
        page.wait(f"palpate.frame.tick > {before}")
        told.append(page.text("event-now"))
    assert told[:2] == ["Tool 1 holds", "Force over 1 N"]
    assert told[2] == "Claim: a lump is here"  # at the tick at which the tool let go


def test_a_cut_is_on_the_timeline_and_going_back_takes_it_from_the_picture(opened, album):
    tissue = organ(7)
    session = session_of(tissue, "compliance")
    session.step([None] * 600)
    session.cut(pp.incision(tissue, [(-8, 0, 25), (8, 0, 25)], depth=8))
    session.step([pp.Command(True, (0, 6, 24), (0, 0, -3))] * 900)
    page = opened({"mine": session.record()}, of=tissue)
    pause(page)
    page.seek(1400)
    page.wait("palpate.scene.made === 1 && palpate.scene.body === palpate.frame.body")
    page.seek(300)
    page.wait("palpate.scene.made === 0 && palpate.scene.body === palpate.frame.body")
    page.page.keyboard.press(".")
    page.arrive(600)
    assert page.text("event-now") == "Cut"


def test_two_sessions_are_played_side_by_side_with_one_camera(opened, records, album):
    page = opened(records)
    pause(page)
    page.wait("palpate.secondFrame !== null")
    page.seek(1900)
    page.wait("palpate.secondFrame.tick === 1900")
    first, second = (np.array(page.see(f"palpate.{name}.force.slice(0, 3)")) for name in ("frame", "secondFrame"))
    assert np.linalg.norm(first) > 1.5 * np.linalg.norm(second) > 0.1
    left, right = page.pixels("#view"), page.pixels("#second-view")
    flesh = [(each[..., 0] > each[..., 2] + 30) for each in (left, right)]
    assert abs(flesh[0].mean() - flesh[1].mean()) < 0.02 < flesh[0].mean()
    x = page.page.locator("#second-view").bounding_box()["x"]
    page.page.mouse.move(x + 150, 300)
    page.page.mouse.down()
    page.page.mouse.move(x + 270, 330, steps=5)
    page.page.mouse.up()
    turned = [page.still("#view"), page.still("#second-view")]
    for before, after in zip((left, right), turned, strict=True):
        assert (np.abs(before - after).max(axis=2) > 20).mean() > 0.01
    page.wait("document.getElementById('timeline-key').textContent.includes('force limit')")
    plot = page.pixels("#timeline-plot")
    for ink in ((11, 116, 128), (168, 65, 15)):  # of the sessions: both curves are there
        assert (np.abs(plot - ink).max(axis=2) < 40).sum() > 60
    page.page.screenshot(path=album / "replay-two.png")


@pytest.mark.parametrize(
    ("viewport", "scheme"), [(PHONE, "dark"), ({"width": 844, "height": 390}, "light"), (LAPTOP, "dark")]
)
def test_it_fits_and_axe_finds_nothing(opened, records, album, viewport, scheme):
    page = opened(records, viewport, scheme)
    pause(page)
    page.seek(1900)
    page.wait("palpate.secondFrame !== null && palpate.secondFrame.tick === 1900")
    assert page.see("document.documentElement.scrollWidth") == viewport["width"]
    boxes = [each.bounding_box() for each in page.page.locator("#timeline :is(button, select, input)").all()]
    assert all(box["x"] >= 0 and box["x"] + box["width"] <= viewport["width"] for box in boxes)
    assert Axe().run(page.page).response["violations"] == []
    page.page.wait_for_timeout(400)
    page.page.screenshot(path=album / f"replay-{viewport['width']}-{scheme}.png")
