"""The page in a real Chromium, driven by real pointer events."""

import numpy as np
import pytest
from support.browser import LAPTOP, PHONE
from support.example_organs import organ
from support.registries import free_port
from support.touch_page import Touched, agrees_with_push

import palpate as pp
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import serving

pytestmark = pytest.mark.browser


@pytest.fixture(params=[LAPTOP], ids=["laptop"])
def touched(browser, request):
    session = pp.Session(pp.model(organ(11), "blocks"), radius=10.0, sweeps=2)
    view = request.param
    context = browser.new_context(viewport=view, has_touch=view is PHONE, color_scheme="light")
    with serving(session, loopback_socket(None), title="Test organ") as address:
        mine = Touched(session, context.new_page())
        mine.open(address)
        yield mine
        assert mine.problems == []
        context.close()


@pytest.mark.parametrize("way", [(60, -40), (-50, 30)])
def test_pulled_surface_follows_the_pointer(touched, album, way):
    touched.page.click("text=Pull")
    start = touched.place()
    touched.drag(start, np.array(way))
    touched.settle()
    held = np.array(touched.see("palpate.heldPixel()"))
    assert np.linalg.norm(held - (start + way)) <= 10
    assert np.linalg.norm(held - start) > 0.7 * np.linalg.norm(way)  # it did move
    agrees_with_push(touched)
    touched.page.screenshot(path=album / f"pull{way[0]}.png")
    touched.page.mouse.up()
    touched.wait("palpate.frame.contact[0] === 0 && palpate.frame.force.every((f) => f === 0)")


def test_press_goes_in_along_the_normal_and_is_felt(touched, album):
    start = touched.place()
    touched.drag(start, np.array((40, 10)))
    touched.settle()
    point, displacement, force, _ = touched.tool()
    depth = np.linalg.norm(displacement)
    surface = touched.session.model.tissue.surface
    normal = surface.normal(surface.closest(point))
    assert np.dot(displacement, normal) == pytest.approx(-depth, rel=0.02)  # straight in
    assert np.dot(force, normal) > 0.1  # and pushed out
    touched.wait(f"document.getElementById('depth').textContent === '{depth:.1f} mm'")
    agrees_with_push(touched)
    touched.page.screenshot(path=album / "press.png")
    touched.page.mouse.wheel(0, -300)
    touched.wait(f"Math.hypot(...palpate.frame.displacement.slice(0, 3)) > {1.1 * depth}")  # the wheel presses deeper
    touched.page.mouse.up()
    touched.wait("palpate.frame.contact[0] === 0")


def test_no_ray_slips_between_triangles(touched):
    """Through every corner of the surface that is not near the outline, the organ is under the pointer."""
    outline = """[...Array(palpate.scene.nodes).keys()].filter((node) => {
        const [x, y] = palpate.nodePixel(node);
        return [[9, 0], [-9, 0], [0, 9], [0, -9]].every(([dx, dy]) => palpate.hitsOrgan(x + dx, y + dy));
    })"""
    well_inside = touched.see(outline)
    assert len(well_inside) > 200
    missed = touched.see(f"({outline}).filter((node) => !palpate.hitsOrgan(...palpate.nodePixel(node)))")
    assert missed == []


def test_stroking_over_the_lump_feels_it(touched):
    """The stiffness read from the page is higher over the lump than beside it."""
    touched.drag(touched.place(0.04, 0.3), np.array((0, 200)))  # look from above, where the lump is
    touched.page.mouse.up()
    felt = {}
    for name, point in (("lump", (0.0, 0.0, 25.0)), ("beside", (26.0, 0.0, 19.0))):
        nodes = touched.session.mesh.nodes[touched.session.shown]
        node = int(np.argmin(np.linalg.norm(nodes - point, axis=1)))
        touched.page.mouse.move(*touched.see(f"palpate.nodePixel({node})"))
        touched.page.mouse.down()
        touched.wait("palpate.frame.contact[0] === 1")
        touched.settle()
        touched.read(touched.tool()[2])
        felt[name] = float(touched.page.locator("#stiffness").inner_text().split()[0])
        touched.page.mouse.up()
        touched.wait("palpate.frame.contact[0] === 0 && palpate.frame.count === 0")  # home again
    assert felt["lump"] > 1.1 * felt["beside"]


def test_wireframe_and_see_inside_change_the_picture(touched, album):
    smooth = touched.pixels("#view")
    touched.page.click("text=Wireframe")
    touched.page.wait_for_timeout(300)
    wire = touched.pixels("#view")
    touched.page.screenshot(path=album / "wireframe.png")
    touched.page.click("text=See inside")
    touched.page.wait_for_timeout(300)
    inside = touched.pixels("#view")
    touched.page.screenshot(path=album / "inside.png")
    for one, other in ((smooth, wire), (wire, inside)):
        assert (np.abs(one - other).max(axis=2) > 20).mean() > 0.01
    flesh = (smooth[..., 0] > smooth[..., 2] + 30).mean()
    assert flesh > 0.05  # the organ fills a good part of the picture
    assert (wire[..., 0] > wire[..., 2] + 30).mean() < flesh / 2  # lines only


def test_dragging_beside_the_organ_turns_the_view_and_touches_nothing(touched):
    before = np.array(touched.see("palpate.nodePixel(0)"))
    touched.drag(touched.place(0.04, 0.9), np.array((120, 0)))
    touched.page.mouse.up()
    assert np.linalg.norm(touched.see("palpate.nodePixel(0)") - before) > 10
    touched.drag(touched.place(), np.array((0, 0)), steps=1)
    touched.wait("palpate.frame.contact[0] === 1")
    touched.page.mouse.up()
    touched.wait("palpate.frame.contact[0] === 0 && palpate.frame.count === 0")  # the tissue is home again
    touched.page.click("text=Reset view")
    np.testing.assert_allclose(touched.see("palpate.nodePixel(0)"), before, atol=1)


def test_session_felt_in_the_page_replays_to_the_bit(touched, album, tmp_path):
    touched.drag(touched.place(), np.array((70, 20)))
    touched.page.mouse.up()
    touched.page.click("text=Pull")
    touched.drag(touched.place(0.45), np.array((30, -30)))
    session = touched.session
    session.stop()
    pp.write_record(tmp_path / "session.h5", session.record())
    record = pp.read_record(tmp_path / "session.h5")
    assert (record.kinds == 1).sum() > 10
    again = pp.Session(session.model, radius=10.0, sweeps=2)
    assert again.replay(record) is None
    assert again.displacement.tobytes() == session.displacement.tobytes()
    assert np.abs(session.displacement).max() > 0.1


def test_a_record_is_shown_and_obeys_no_hand(browser):
    model, point = pp.model(organ(), "blocks"), (0.0, 0.0, 25.0)
    session = pp.Session(model, radius=10.0, sweeps=4)
    both = [pp.Command(True, point, (0, 0, -5)), None, None, pp.Command(True, (25, 0, 18), (-8, 0, -8), "needle")]
    session.step([None] * 500 + [both] * 8_000)
    with serving(pp.Session(model, radius=10.0, sweeps=4), loopback_socket(None), replay=session.record()) as address:
        context = browser.new_context(viewport=LAPTOP)
        touched = Touched(session, context.new_page())
        touched.open(address)
        touched.wait("palpate.scene.replay && palpate.frame.contact[0] === 1 && palpate.frame.insertion[3] > 0")
        touched.wait("palpate.frame.tick > 3000")
        touched.drag(touched.place(), np.array((30, 10)))
        np.testing.assert_allclose(touched.tool()[0], point, atol=1e-4)
        np.testing.assert_allclose(touched.tool()[1], (0, 0, -5), atol=1e-4)
        touched.read(touched.tool()[2])
        assert touched.problems == []
        context.close()


def test_lost_server_is_said_and_found_again(browser, monkeypatch, tmp_path):
    """After a restart the page goes on by itself, with what is served now, and touches it; a stranger it leaves alone."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    model = pp.model(organ(), "blocks")
    port = free_port()  # none of those that other tests take as soon as they are free
    listener = loopback_socket(port)
    context = browser.new_context(viewport=LAPTOP)
    touched = Touched(None, context.new_page())
    status, lost = (
        touched.page.locator("#status"),
        "document.getElementById('status').textContent.includes('not running')",
    )
    with serving(pp.Session(model, radius=10.0, sweeps=4), listener) as address:
        touched.open(address)
        assert not status.is_visible()
    listener.close()
    touched.wait(lost)
    assert status.is_visible()
    with (
        loopback_socket(port) as listener,
        serving(pp.Session(model, radius=10.0, sweeps=4), listener, title="Restarted"),
    ):
        touched.wait("palpate.scene.title === 'Restarted' && document.getElementById('status').textContent === ''")
        touched.drag(touched.place(), np.array((20, 5)))
        touched.wait("palpate.frame.contact[0] === 1")
        touched.page.mouse.up()
    touched.wait(lost)
    (tmp_path / "palpate" / "token").unlink()
    with loopback_socket(port) as listener, serving(pp.Session(model, radius=10.0, sweeps=4), listener):
        touched.wait("document.getElementById('status').textContent.includes('open the address that palpate printed')")
    context.close()


def test_the_token_is_not_left_in_the_address_and_the_page_can_be_loaded_again(browser):
    context = browser.new_context(viewport=LAPTOP)
    with serving(pp.Session(pp.model(organ(), "blocks"), radius=10.0, sweeps=4), loopback_socket(None)) as address:
        touched = Touched(None, context.new_page())
        touched.open(address)
        for _ in range(2):
            assert touched.page.url == address.split("?")[0]
            touched.page.reload()
            touched.wait("Boolean(window.palpate && palpate.frame)")
        context.new_page().goto(touched.page.url)  # another tab has no token
        stranger = Touched(None, context.pages[-1])
        stranger.wait("document.getElementById('status').textContent.includes('open the address that palpate printed')")
    context.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_fits_a_phone_and_obeys_a_finger(browser, album, scheme):
    session = pp.Session(pp.model(organ(11), "blocks"), radius=10.0, sweeps=2)
    context = browser.new_context(viewport=PHONE, has_touch=True, is_mobile=True, color_scheme=scheme)
    with serving(session, loopback_socket(None), title="Test organ") as address:
        touched = Touched(session, context.new_page())
        touched.open(address)
        page = touched.page
        wide = touched.see("document.documentElement.scrollWidth")
        assert wide == PHONE["width"]  # nothing sticks out sideways
        for button in page.locator("button:visible").all():
            box = button.bounding_box()
            assert box["y"] + box["height"] <= PHONE["height"]
            assert box["height"] >= 32  # a fingertip
        finger = context.new_cdp_session(page)
        x, y = touched.place()
        finger.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [{"x": x, "y": y}]})
        finger.send("Input.dispatchTouchEvent", {"type": "touchMove", "touchPoints": [{"x": x + 15, "y": y}]})
        touched.wait("palpate.frame.contact[0] === 1 && Math.hypot(...palpate.frame.displacement.slice(0, 3)) > 0")
        touched.settle()
        agrees_with_push(touched)
        page.screenshot(path=album / f"phone-{scheme}.png")
        finger.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        touched.wait("palpate.frame.contact[0] === 0")
        before = np.array(touched.see("palpate.nodePixel(0)"))
        one, two = {"x": x, "y": y, "id": 0}, {"x": x + 40, "y": y, "id": 1}
        finger.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [one]})
        finger.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [one, two]})
        one, two = ({**point, "y": y + 40} for point in (one, two))
        finger.send("Input.dispatchTouchEvent", {"type": "touchMove", "touchPoints": [one, two]})
        touched.wait("palpate.frame.contact[0] === 0")  # a second finger turns the view, and the first lets go
        assert np.linalg.norm(touched.see("palpate.nodePixel(0)") - before) > 5
        finger.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        assert touched.problems == []
    context.close()
