"""Cutting by hand in a real Chromium: pointer, keys and finger, what opens, what holds on, and what takes it back."""

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from support.browser import LAPTOP, PHONE
from support.example_organs import organ
from support.running_server import until
from support.touch_page import Touched

import palpate as pp
from palpate.server.live_session import LiveSession
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import running_session
from palpate.simulation.pointer import Pointer
from palpate.simulation.replay import Replay

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def tissue():
    return organ(10)


@pytest.fixture(scope="module")
def model(tissue):
    return pp.model(tissue, "compliance")


@pytest.fixture
def opened(browser, model):
    """Gives pages of one session; a page whose context has other options is another window."""
    serving = []

    def start(viewport=LAPTOP, record=None, tension=1.0, toughness=None, **options):
        if not serving:
            session = pp.Session(model, radius=8.0, sweeps=2, tension=tension, toughness=toughness)
            live = LiveSession(session, Pointer() if record is None else Replay(record), "Test organ")
            served = running_session(live, loopback_socket(None))
            serving.extend([served, served.__enter__(), live])
        live = serving[2]
        context = browser.new_context(viewport=viewport, color_scheme=options.pop("scheme", "light"), **options)
        touched = Touched(live.session, context.new_page())
        touched.live = live
        serving.append(context)
        touched.open(serving[1])
        return touched

    yield start
    served, _, _, *contexts = serving
    for context in contexts:
        context.close()
    served.__exit__(None, None, None)


def draw(touched, start, way, steps=30):
    """A stroke of the scalpel."""
    touched.page.mouse.move(*start)
    touched.page.mouse.down()
    for i in range(1, steps + 1):
        touched.page.mouse.move(*(start + way * i / steps))
        touched.page.wait_for_timeout(20)


def organ_picture(touched):
    """Pixels of the organ, without hints, headings and the ring of the focus."""
    return touched.pixels("#view")[200:600, 200:760]


def followed(touched):
    """Until the cut has followed the stroke, and the page shows it."""
    until(lambda: touched.live.cutting.stroke is None)
    touched.wait(f"palpate.scene.body === {touched.session.bodies}")
    touched.wait(f"palpate.frame.body === {touched.session.bodies}")


def test_a_stroke_cuts_while_it_goes_on_and_the_cut_opens(opened, album):
    touched = opened()
    before = organ_picture(touched)
    touched.page.click("#cut-tool")
    assert touched.see("document.getElementById('undo-cut').disabled")
    draw(touched, touched.place(0.36, 0.42), np.array((260, 0)), 60)
    until(lambda: touched.session.bodies > 0)
    touched.page.screenshot(path=album / "while-cutting.png")
    touched.page.mouse.up()
    followed(touched)
    mesh = touched.session.mesh
    assert touched.session.cuts == 1, "one stroke is one cut"
    assert len(mesh.nodes) > len(touched.session.first.tissue.mesh.nodes)
    assert mesh.volumes.sum() == pytest.approx(touched.session.first.tissue.mesh.volumes.sum())
    touched.wait("document.getElementById('about').textContent.includes('1 cut')")
    touched.settle()
    touched.still()
    touched.page.screenshot(path=album / "cut.png")
    moved = np.abs(organ_picture(touched) - before).max(axis=2) > 40
    assert np.count_nonzero(moved) > 800, "it gapes"
    left, right = np.flatnonzero(moved.any(axis=0))[[0, -1]]
    assert right - left > 150, "along the stroke"
    record_of_a_cut = [one.kind for one in touched.session.events.cuts]
    assert record_of_a_cut[0] == "cut"
    assert set(record_of_a_cut[1:]) <= {"extend"}
    touched.page.keyboard.press("z")
    until(lambda: touched.session.cuts == 0)
    followed(touched)
    touched.wait("document.getElementById('undo-cut').disabled")
    # The picture is drawn sharp again after a while.
    until(lambda: np.count_nonzero(np.abs(organ_picture(touched) - before).max(axis=2) > 40) < 300)
    assert touched.problems == []


def test_a_hand_reads_and_hears_what_its_blade_takes(opened, album):
    touched = opened(tension=0.0, toughness=164)
    touched.page.click("#cut-tool")
    depth = touched.see("Number(document.getElementById('amount').value)")
    draw(touched, touched.place(0.36, 0.42), np.array((200, 0)), 40)
    touched.wait("palpate.frame.contact[0] === 4 && Math.hypot(...palpate.frame.force.slice(0, 3)) > 0.5")
    force = touched.see("palpate.frame.force.slice(0, 3)")
    assert np.linalg.norm(force) == pytest.approx(0.164 * depth, rel=0.05)
    touched.wait(f"Math.abs(Number(document.getElementById('force').textContent) - {np.linalg.norm(force)}) < 0.1")
    assert touched.see("document.getElementById('depth-name').textContent") == "Ahead by"
    touched.page.screenshot(path=album / "blade-felt.png")
    assert touched.see("palpate.played.filter((sound) => sound.event === 'cut').length") > 5
    touched.page.mouse.up()
    touched.wait("palpate.frame.contact[0] === 0 && Math.hypot(...palpate.frame.force) === 0")
    touched.wait("document.getElementById('force').textContent === '0.00'")
    touched.until_told("N on the blade")
    assert touched.problems == []


def test_one_lip_follows_the_hand_and_the_other_stays(opened, album):
    touched = opened(tension=0.0)
    touched.page.click("#cut-tool")
    start, way = touched.place(0.36, 0.42), np.array((260, 0))
    draw(touched, start, way)
    touched.page.mouse.up()
    followed(touched)
    touched.page.click("[data-value=pull]")
    touched.drag(start + way / 2 - (0, 14), np.array((0, -70)))
    touched.settle()
    touched.page.screenshot(path=album / "pulled-open.png")
    session = touched.session
    frame = session.frame()
    drawn, places, lips = session.drawn(frame), session.displayed.places, session.displayed.lips[0]
    held = np.array(frame.point[0])
    near = np.flatnonzero(np.linalg.norm(places[lips:] - held, axis=1) < 12) + lips
    size = np.linalg.norm(drawn[near], axis=1)
    most = np.linalg.norm(frame.displacement[0])
    assert most > 3
    assert size.max() > 0.8 * most, "the held lip"
    assert size.min() < 0.3 * most, "the other one"
    touched.page.mouse.up()
    assert touched.problems == []


def test_a_hand_in_another_window_holds_on_while_one_cuts(opened):
    surgeon, assistant = opened(tension=0.0), opened()
    assistant.drag(assistant.place(0.5, 0.33), np.array((0, -50)))
    assistant.settle()
    before = assistant.tool()
    surgeon.page.click("#cut-tool")
    draw(surgeon, surgeon.place(0.36, 0.42), np.array((260, 0)))
    surgeon.page.mouse.up()
    followed(surgeon)
    followed(assistant)
    assistant.settle()
    point, displacement, force, contact = assistant.tool()
    assert contact == before[3] == 1
    assert np.allclose(displacement, before[1], atol=0.5)
    session = surgeon.session
    expected = session.model.push(point, displacement, session.settings.radius).force
    assert np.linalg.norm(force - expected) < 0.02 * np.linalg.norm(expected)
    assistant.page.mouse.up()
    assert surgeon.problems == assistant.problems == []


def test_the_keys_cut(opened):
    touched = opened()
    touched.page.focus("#view")
    touched.page.keyboard.press("5")
    assert touched.see("document.getElementById('cut-tool').getAttribute('aria-pressed')") == "true"
    for _ in range(8):
        touched.page.keyboard.press("ArrowLeft")
    touched.page.keyboard.press("Space")
    for _ in range(16):
        touched.page.keyboard.press("ArrowRight")
    touched.page.keyboard.press("Space")
    until(lambda: touched.session.cuts == 1)
    followed(touched)
    touched.page.click("#undo-cut")
    until(lambda: touched.session.cuts == 0)
    assert touched.problems == []


@pytest.mark.parametrize(("viewport", "scheme"), [(LAPTOP, "light"), (PHONE, "dark")])
def test_a_finger_cuts_and_the_page_is_accessible(opened, album, viewport, scheme):
    touched = opened(viewport, scheme=scheme, has_touch=True, is_mobile=viewport is PHONE)
    touched.page.tap("#cut-tool")
    start, client = touched.place(0.3, 0.45), touched.page.context.new_cdp_session(touched.page)
    way = 0.4 * touched.page.locator("#view").bounding_box()["width"]

    def finger(kind, *points):
        client.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": x, "y": y} for x, y in points]})

    finger("touchStart", start)
    for i in range(1, 25):
        finger("touchMove", (start[0] + way * i / 24, start[1]))
        touched.page.wait_for_timeout(15)
    finger("touchEnd")
    until(lambda: touched.session.cuts == 1)
    followed(touched)
    touched.page.wait_for_timeout(400)
    touched.page.screenshot(path=album / f"cut-by-a-finger-{scheme}.png")
    assert Axe().run(touched.page).response["violations"] == []
    assert touched.problems == []


def test_a_cut_that_is_refused_is_told(opened, monkeypatch):
    touched = opened()

    def refused(blade, extend):
        raise pp.errors.MaterialError("blade: 1 of 2 pieces come free")

    monkeypatch.setattr(touched.session, "cut", refused)
    touched.page.click("#cut-tool")
    draw(touched, touched.place(0.36, 0.42), np.array((260, 0)))
    touched.page.mouse.up()
    touched.until_told("come free")
    assert touched.session.bodies == 0
    touched.page.keyboard.press("z")
    touched.until_told("nothing has been cut")
    assert touched.problems == []


def test_a_replay_cuts_again(opened, model, tissue):
    top = tissue.mesh.nodes[np.argmax(tissue.mesh.nodes[:, 2])]
    session = pp.Session(model, radius=8.0, sweeps=2)
    session.step([pp.Command(True, tuple(top + (0, 8, 0)), (0, 0, -2))] * 300)
    session.cut(pp.incision(tissue, [top - (15, 0, 0), top + (15, 0, 0)], depth=12))
    session.step([None] * 60_000)
    touched = opened(record=session.record())
    until(lambda: touched.session.bodies == 1)
    touched.wait("palpate.scene.body === 1 && palpate.frame.body === 1")
    assert np.array_equal(touched.session.mesh.tets, session.mesh.tets)
    assert touched.see("document.getElementById('cut-tool').hidden")
    assert touched.problems == []
