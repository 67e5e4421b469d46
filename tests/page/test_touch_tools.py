"""The page's other tools and choices in a real Chromium: grasp, needle, keys, gamepad, models, meshes, slices."""

import re
import threading

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from matplotlib import colormaps
from support.browser import LAPTOP, PHONE
from support.example_organs import organ
from support.running_server import until
from support.touch_page import Touched, agrees_with_push

import palpate as pp
from palpate.errors import MaterialError
from palpate.server import live_session
from palpate.server.live_session import LiveSession
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import running_session
from palpate.server.view import image_payloads
from palpate.simulation.pointer import Pointer

pytestmark = pytest.mark.browser
WHY = "blocks (as the test wants): in time"
PAD = """navigator.getGamepads = () => [window.pad];
window.pad = {connected: true, mapping: "standard", axes: [0, 0, 0, 0],
              buttons: [...Array(17)].map(() => ({pressed: false, value: 0}))};"""


@pytest.fixture(scope="module")
def organs():
    return {"coarse": organ(9), "fine": organ(11)}


@pytest.fixture(scope="module")
def ct():
    """A volume around the organ whose voxels hold their own x, mm."""
    grid = pp.Grid(shape=(30, 40, 50), spacing=(2.0, 2.0, 2.0), origin=(-49.0, -39.0, -29.0))
    return pp.Volume(np.broadcast_to(grid.origin[0] + 2.0 * np.arange(50.0, dtype=np.float32), grid.shape), grid, "HU")


@pytest.fixture
def opened_page(browser, organs, ct):
    """Gives a page that shows a live; options of the context may differ."""
    closing = []

    def start(viewport=LAPTOP, script="", **options):
        session = pp.Session(pp.model(organs["coarse"], "blocks"), radius=8.0, sweeps=2)
        live = LiveSession(
            session, Pointer(), "Test organ", organs, image_payloads([ct], ["CT"]), "Find the lump.", WHY
        )
        serving = running_session(live, loopback_socket(None))
        context = browser.new_context(viewport=viewport, color_scheme=options.pop("scheme", "light"), **options)
        touched = Touched(session, context.new_page())
        touched.live = live
        closing.extend([serving, context])
        if script:
            touched.page.add_init_script(script)
        touched.open(serving.__enter__())
        return touched

    yield start
    serving, context = closing
    context.close()
    serving.__exit__(None, None, None)


@pytest.fixture
def touched(opened_page):
    touched = opened_page()
    yield touched
    assert touched.problems == []


def key(touched, *names):
    for name in names:
        touched.page.keyboard.press(name)


def test_grasp_takes_hold_with_two_jaws_and_moves_them_together(touched, album):
    touched.page.click("text=Grasp")
    start, way = touched.place(), np.array((20, -40))
    touched.page.mouse.move(*start)
    touched.page.mouse.down()
    touched.wait("palpate.frame.contact[0] === 1 && palpate.frame.contact[1] === 1")
    touched.settle()
    (left, one, pushed, _), (right, other, back, _) = touched.tool(0), touched.tool(1)
    across = (right - left) / np.linalg.norm(right - left)
    radius = touched.session.settings.radius
    assert np.linalg.norm(right - left) >= 2 * radius  # patches apart
    np.testing.assert_allclose(one, -other, atol=0.05)  # pinched from both sides
    assert np.dot(one, across) == pytest.approx(radius / 4, rel=0.05)  # half of the pinch, which is half a radius
    assert np.dot(pushed, across) < -0.01 < 0.01 < np.dot(back, across)  # the tissue pushes the jaws apart
    for i in range(1, 9):
        touched.page.mouse.move(*(start + way * i / 8))
        touched.page.wait_for_timeout(15)
    touched.settle()
    held = np.array(touched.see("palpate.heldPixel()"))
    assert np.linalg.norm(held - (start + way)) <= 12  # pixels
    assert np.dot(touched.tool(1)[0] + touched.tool(1)[1] - touched.tool(0)[0] - touched.tool(0)[1], across) > 0
    touched.page.screenshot(path=album / "grasp.png")
    touched.page.mouse.up()
    touched.until_home()


def test_needle_enters_stays_goes_deeper_and_takes_a_sample(touched, album):
    touched.page.click("text=Needle")
    touched.page.click("text=See inside")
    touched.page.mouse.move(*touched.place())
    touched.page.mouse.down()
    touched.page.mouse.up()
    touched.wait("palpate.frame.contact[3] === 1")  # stays without a hand
    touched.page.click("text=Take sample")
    touched.until_told("not in the tissue")
    slider = touched.page.locator("#amount")
    slider.focus()
    key(touched, *["+"] * 20)
    touched.wait("palpate.frame.insertion[3] > 4")
    touched.settle()
    point, displacement, force, _ = touched.tool(3)
    surface = touched.session.model.tissue.surface
    inward = -np.array(surface.normal(surface.closest(point)))
    assert np.dot(force, inward) < 0  # the tissue resists
    assert np.linalg.norm(np.cross(displacement, inward)) <= 0.05 * np.linalg.norm(displacement) + 1e-3
    inside = touched.see("palpate.frame.insertion[3]")
    asked = float(slider.input_value())
    assert inside + np.dot(displacement, inward) == pytest.approx(asked, rel=0.02)  # the tip is where it was driven
    touched.wait(f"document.getElementById('depth').textContent === '{inside:.1f} mm'")
    tip = point + displacement + inside * inward
    touched.page.screenshot(path=album / "needle.png")
    touched.page.click("text=Slices")
    touched.wait("palpate.crosshair() !== null")
    touched.wait(f"palpate.crosshair().every((x, i) => Math.abs(x - {tip.tolist()}[i]) <= 1.01)")  # half a voxel
    touched.page.click("text=Take sample")
    touched.page.click("text=Found it")
    touched.until_told("Noted")
    touched.page.click("text=Needle out")
    touched.until_home()
    touched.session.stop()
    assert [mark[1:] for mark in touched.session.record().marks] == [(1, 3), (0, 3)]


def test_needle_on_a_phone_is_driven_by_the_slider(opened_page):
    touched = opened_page(PHONE, has_touch=True, is_mobile=True)
    page = touched.page
    page.tap("#tool >> text=Needle")
    page.touchscreen.tap(*touched.place())
    touched.wait("palpate.frame.contact[3] === 1")
    page.locator("#amount").fill("15")
    touched.wait("palpate.frame.insertion[3] > 5")
    for button in page.locator("button:visible").all():
        box = button.bounding_box()
        assert box["y"] + box["height"] <= PHONE["height"]
        assert box["height"] >= 32
    page.tap("text=Take sample")
    page.tap("text=Needle out")
    touched.until_home()
    touched.session.stop()
    assert [mark[1:] for mark in touched.session.record().marks] == [(1, 3)]
    assert touched.problems == []


def test_another_model_comes_into_force_under_the_hand(touched):
    touched.drag(touched.place(), np.array((5, 0)))
    touched.settle()
    before = touched.tool()[2]
    names = touched.see("palpate.scene.models")
    touched.page.select_option("#model", "compliance")
    touched.wait(f"palpate.frame.model === {names.index('compliance')}")
    touched.page.wait_for_timeout(400)
    touched.settle()
    agrees_with_push(touched)
    assert np.linalg.norm(touched.tool()[2] - before) <= 0.05 * np.linalg.norm(before)  # both are linear FEM
    assert touched.page.locator("#model").input_value() == "compliance"
    touched.page.mouse.up()
    touched.until_home()


def test_a_model_that_is_being_made_is_said_and_a_later_choice_wins(touched, monkeypatch):
    real, made = live_session.build, threading.Event()
    monkeypatch.setattr(live_session, "build", lambda tissue, name: made.wait(30) and real(tissue, name))
    note = touched.page.locator("#model-note")
    touched.wait(f"document.getElementById('model-note').textContent === 'Began with {WHY}.'")
    touched.page.select_option("#model", "compliance")
    touched.wait("document.getElementById('model-note').textContent === 'Making compliance; until then blocks.'")
    touched.page.select_option("#model", "springs")
    touched.wait("document.getElementById('model-note').textContent === 'Making springs; until then blocks.'")
    made.set()
    touched.wait("palpate.scene.models[palpate.frame.model] === 'springs'")
    assert touched.page.locator("#model").input_value() == "springs"
    assert not note.inner_text().startswith("Making")


def test_a_model_that_cannot_be_made_is_said(touched, monkeypatch, capsys):
    def build(tissue, name):
        raise MaterialError("not today")

    monkeypatch.setattr(live_session, "build", build)
    touched.page.select_option("#model", "compliance")
    touched.until_told("compliance was not made: not today")
    touched.wait("document.getElementById('model').value === 'blocks'")
    assert "not today" in capsys.readouterr().out


def test_another_mesh_is_fetched_at_once_and_seen_from_the_same_place(touched):
    touched.drag(touched.place(0.04, 0.9), np.array((120, 0)))  # turn the view
    touched.page.mouse.up()
    coarse, top = touched.see("palpate.scene.nodes"), (0.0, 0.0, 25.0)

    def seen_at(tissue):
        nodes = tissue.mesh.nodes[touched.live.session.shown]
        return np.array(touched.see(f"palpate.nodePixel({int(np.argmin(np.linalg.norm(nodes - top, axis=1)))})"))

    before = seen_at(touched.live.organs["coarse"])
    touched.page.select_option("#organ", "fine")
    touched.wait(f"palpate.scene.nodes > {coarse} && palpate.scene.organ === 1")
    touched.wait("palpate.nodePixel(0).every(Number.isFinite)")
    assert np.linalg.norm(seen_at(touched.live.organs["fine"]) - before) < 8
    touched.wait("document.getElementById('status').classList.contains('good')")
    touched.drag(touched.place(), np.array((5, 0)))
    touched.wait("palpate.frame.contact[0] === 1")
    touched.page.mouse.up()
    touched.until_home()


def test_keyboard_alone_reaches_every_tool(touched):
    """No pointer at all: every control has the focus in turn, and each tool works from the cursor."""
    reached, page = set(), touched.page
    for _ in range(60):
        key(touched, "Tab")
        name = touched.see("document.activeElement.id || document.activeElement.dataset.value || ''")
        reached.add(name)
        if name == "view":
            assert touched.see("getComputedStyle(document.getElementById('stage'), '::after').borderTopWidth") == "2px"
    visible = page.locator("button:visible, select:visible, input:visible, #view")
    assert reached >= {each.get_attribute("id") or each.get_attribute("data-value") for each in visible.all()}
    page.locator("#view").focus()
    start = np.array(touched.see("palpate.cursorPixel()"))
    key(touched, "ArrowRight", "ArrowRight")
    assert np.array(touched.see("palpate.cursorPixel()"))[0] > start[0] + 15
    key(touched, " ")
    touched.wait("palpate.frame.contact[0] === 1")
    touched.settle()
    shallow = np.linalg.norm(touched.tool()[1])
    key(touched, "+", "+", "+")
    touched.wait(f"Math.hypot(...palpate.frame.displacement.slice(0, 3)) > {1.1 * shallow}")
    at = touched.tool()[0]
    key(touched, "ArrowLeft", "ArrowLeft", "ArrowLeft")
    touched.wait(f"Math.hypot(palpate.frame.point[0] - {at[0]}, palpate.frame.point[1] - {at[1]}) > 1")  # strokes
    key(touched, " ")
    touched.until_home()
    key(touched, "3", " ")
    touched.wait("palpate.frame.contact[0] === 1 && palpate.frame.contact[1] === 1")
    key(touched, "Escape", "4", " ", "+", "+")
    touched.wait("palpate.frame.contact[3] === 1 && palpate.frame.contact[0] === 0")
    key(touched, "o")
    touched.until_home()
    before = np.array(touched.see("palpate.nodePixel(0)"))
    key(touched, "Shift+ArrowLeft", "PageUp")
    assert np.linalg.norm(touched.see("palpate.nodePixel(0)") - before) > 5


def test_gamepad_presses_as_deep_as_its_trigger_is_pulled(opened_page):
    touched = opened_page(script=PAD)
    touched.see("window.pad.axes[0] = 0.8")
    touched.wait("palpate.cursorPixel() !== null")
    touched.see("window.pad.axes[0] = 0")
    depths = []
    for value in (0.5, 1.0):
        touched.see(f"window.pad.buttons[7].value = {value}")
        touched.wait("palpate.frame.contact[0] === 1")
        touched.settle()
        depths.append(np.linalg.norm(touched.tool()[1]))
    assert depths[0] == pytest.approx(depths[1] / 2, rel=0.02)
    agrees_with_push(touched)
    touched.see("window.pad.connected = false")  # unplugged in contact
    touched.until_home()
    assert touched.problems == []


def test_strain_is_the_largest_stretch_of_the_surface(touched):
    """The largest value in the legend, against the same number from the session's own nodes."""
    touched.page.click("text=Strain")
    touched.page.click("text=Pull")
    touched.drag(touched.place(), np.array((30, -50)))
    touched.settle()
    shown = largest(touched)
    session = touched.session
    mesh, moved = session.mesh, np.zeros_like(session.mesh.nodes)
    moved[session.shown] = np.array(session.frame().shown)
    stretch = largest_stretch(mesh.nodes, mesh.nodes + moved, mesh.surface)
    assert shown == pytest.approx(100 * stretch.max(), rel=0.06)
    assert shown > 1
    touched.page.mouse.up()
    touched.wait("document.getElementById('largest').textContent.startsWith('Largest now: 0 % stretch')")


def largest(touched):
    """The largest value of now, as the legend tells it."""
    return float(touched.see("document.getElementById('largest').textContent").split()[2])


def high_end(touched):
    return touched.see("document.getElementById('high').textContent")


def share(touched, colour):
    """Share of the picture in the scale's lowest colour, its highest, or that beyond the model; light changes none."""
    red, green, blue = touched.pixels("#view").transpose(2, 0, 1)
    return {
        "dark": (blue > green + 25) & (red > green + 15) & (red < 0.95 * blue),
        "yellow": (red > 1.02 * green) & (green > 2 * blue) & (green > 100),
        "pink": (red > green + 90) & (blue > green + 50) & (red > blue),
    }[colour].mean()


def turns_dark(touched):
    """Within some seconds: figures are told as they come, and the next frame is painted by them."""
    return any(share(touched, "dark") > 0.05 or touched.page.wait_for_timeout(100) for _ in range(50))


def pulled(touched, way):
    touched.drag(touched.place(), np.array(way))
    touched.settle()
    return largest(touched), share(touched, "yellow"), share(touched, "pink")


def test_a_colour_means_the_same_strain_at_every_moment(touched, album):
    """What is strained half as much is not drawn in the highest colour again; the user alone changes the scale."""
    touched.page.click("text=Strain")
    touched.page.select_option("#model", "neo-hookean")
    touched.wait("palpate.scene.models[palpate.frame.model] === 'neo-hookean'")
    touched.page.click("text=Pull")
    assert turns_dark(touched)  # at rest: the scale is there, and the organ in its lowest colour
    assert high_end(touched) == "10 % stretch"
    most, yellow, _ = pulled(touched, (60, -90))
    assert yellow > 0.02  # measured 0.034; P1 elements, which lock, spread the strain over 0.05 and more
    assert high_end(touched) == "10 % stretch"
    touched.page.screenshot(path=album / "strain-clamped.png")
    touched.page.mouse.up()
    touched.until_home()
    touched.page.click("#scale-fit")  # what was largest so far
    touched.wait("document.getElementById('high').textContent !== '10 % stretch'")
    end = high_end(touched)
    assert most <= float(end.split()[0]) <= 1.25 * most
    less, yellow, _ = pulled(touched, (16, -24))
    assert less < 0.6 * most
    assert high_end(touched) == end
    assert yellow < 0.001  # some pixels at the edge of the drawn tool
    touched.page.screenshot(path=album / "strain-fitted.png")
    touched.page.mouse.up()
    touched.page.fill("#scale-high", "2.5")
    touched.page.press("#scale-high", "Enter")
    touched.wait("document.getElementById('high').textContent === '2.5 % stretch'")
    touched.page.click("#color-mode >> text=Moved")
    touched.wait("document.getElementById('high').textContent === '10 mm'")
    touched.page.click("text=Strain")
    touched.wait("document.getElementById('high').textContent === '2.5 % stretch'")  # each mode keeps its own


def test_the_scale_runs_from_the_dark_end_of_viridis_to_its_bright_end(touched):
    stops = touched.see("getComputedStyle(document.getElementById('colors')).backgroundImage")
    rgb = np.array([[int(n) for n in stop.split(",")] for stop in re.findall(r"rgb\(([^)]*)\)", stops)])
    truth = 255 * colormaps["viridis"](np.linspace(0, 1, len(rgb)))[:, :3]
    assert np.abs(rgb - truth).max() < 4


def test_strain_beyond_the_model_is_told_and_drawn_in_a_colour_of_its_own(touched, album):
    touched.page.click("text=Strain")
    touched.page.click("text=Pull")
    less, _, pink = pulled(touched, (6, -8))
    assert less < 10
    assert pink == 0
    assert not touched.page.is_visible("#beyond")
    touched.page.mouse.up()
    touched.until_home()
    most, _, pink = pulled(touched, (60, -120))
    assert most > 10
    assert touched.page.inner_text("#beyond") == "Pink: over 10 % stretch, more than the model blocks can mean"
    touched.page.screenshot(path=album / "strain-beyond.png")
    assert pink > 0
    touched.page.mouse.up()
    touched.until_home()
    assert not touched.page.is_visible("#beyond")


def test_error_against_finite_elements(touched, album):
    """The figures that are told, against direct solutions; springs err, tables of linear elements do not."""
    assert share(touched, "dark") < 0.01
    touched.page.click("#color-mode >> text=Error")
    touched.wait("document.getElementById('error-values').textContent.startsWith('At most 0.000 mm')")
    assert turns_dark(touched)  # the organ, all of it
    tissue, radius = touched.live.organs["coarse"], touched.session.settings.radius

    def told():
        """mm, % of the force."""
        words = touched.page.locator("#error-values").inner_text().split()
        return float(words[2]), float(words[words.index("force") + 1])

    for name in ("springs", "compliance"):
        touched.page.select_option("#model", name)
        touched.wait(f"palpate.scene.models[palpate.frame.model] === '{name}'")
        touched.page.wait_for_timeout(400)
        touched.drag(touched.place(), np.array((40, 10)))
        touched.settle()
        point, displacement = touched.tool()[:2]
        if name == "springs":
            truth = pp.finite_elements(tissue).push(point, displacement, radius)
            mine = pp.model(tissue, "springs").push(point, displacement, radius, tolerance=1e-4)
            most = np.linalg.norm(mine.displacement - truth.displacement, axis=1)[touched.session.shown].max()
            off = 100 * np.linalg.norm(mine.force - truth.force) / np.linalg.norm(truth.force)
            assert most > 0.1
            until(lambda: told() == (pytest.approx(most, rel=0.02), pytest.approx(off, abs=0.5)))  # noqa: B023
        else:
            last_digit = 5e-4
            most = 2e-4 * np.linalg.norm(displacement) + last_digit
            until(lambda: told()[0] < most and told()[1] < 0.1)  # noqa: B023
        touched.page.screenshot(path=album / f"error-{name}.png")
        touched.page.mouse.up()
        touched.until_home()
    touched.page.select_option("#organ", "fine")
    touched.wait("palpate.scene.organ === 1")
    touched.wait("document.getElementById('error-values').textContent.startsWith('At most 0.000 mm')")
    assert turns_dark(touched)  # the new mesh too
    assert touched.live.comparison.pages
    touched.page.click("#color-mode >> text=Plain")
    touched.wait("document.getElementById('legend').hidden")
    until(lambda: not touched.live.comparison.pages, seconds=20)  # the server hears of it after the page


def largest_stretch(rest, now, faces):
    """At each node, by singular values of each triangle's deformation, weighted by area at rest."""
    edges = [nodes[faces[:, 1:]] - nodes[faces[:, :1]] for nodes in (rest, now)]
    plane = np.linalg.qr(edges[0].transpose(0, 2, 1))
    gradient = edges[1].transpose(0, 2, 1) @ np.linalg.inv(plane.R)
    stretch = np.linalg.svd(gradient, compute_uv=False)[:, 0] - 1
    area = np.abs(np.linalg.det(plane.R))
    total, weight = np.zeros(len(rest)), np.zeros(len(rest))
    np.add.at(total, faces, (area * stretch)[:, None])
    np.add.at(weight, faces, area[:, None])
    return np.divide(total, weight, out=np.zeros_like(total), where=weight > 0)


@pytest.mark.parametrize(("scheme", "size"), [("light", LAPTOP), ("dark", LAPTOP), ("light", PHONE), ("dark", PHONE)])
def test_axe_finds_nothing_to_object_to(opened_page, album, scheme, size):
    phone = size is PHONE
    touched = opened_page(size, scheme=scheme, has_touch=phone, is_mobile=phone)
    page = touched.page
    if phone:
        page.click("#more")
    page.click("text=Slices")
    touched.wait("palpate.crosshair() !== null")
    page.click("#tool >> text=Needle")
    page.click("#color-mode >> text=Error")
    touched.wait("document.getElementById('error-values').textContent.startsWith('At most')")
    found = Axe().run(page)
    assert found.violations_count == 0, found.generate_report()
    assert len(found.response["passes"]) > 10
    page.screenshot(path=album / f"all-{scheme}-{size['width']}.png")
    page.click("text=Keys")
    assert Axe().run(page).violations_count == 0


def test_where_linear_strain_is_not_valid_it_says_so_and_hands_over(touched, album):
    """The server says it of the frame, the page of the server, and one click goes on at finite strain."""
    touched.page.select_option("#model", "compliance")
    touched.wait("palpate.scene.models[palpate.frame.model] === 'compliance'")
    touched.page.click("text=Pull")
    touched.drag(touched.place(), np.array((6, -9)))
    touched.wait("Math.abs(palpate.frame.linearisation) < 0.1 && palpate.frame.least_volume > 0")
    touched.wait("document.getElementById('hand-over').hidden")
    touched.page.mouse.up()
    touched.until_home()
    touched.drag(touched.place(), np.array((120, -180)))
    touched.wait("Math.abs(palpate.frame.linearisation) > 0.1 || palpate.frame.least_volume <= 0")
    touched.wait("document.getElementById('linearity').classList.contains('warning')")
    touched.page.screenshot(path=album / "linearity.png")
    touched.page.mouse.up()  # the hand that presses the button has let go
    touched.page.click("#use-neo-hookean")
    touched.wait("palpate.scene.models[palpate.frame.model] === 'neo-hookean'")
    touched.drag(touched.place(), np.array((120, -180)))
    touched.wait("palpate.frame.solution_age > 0")
    touched.wait("document.getElementById('solution').textContent.includes('ms old')")
    touched.wait("document.getElementById('linearity-row').hidden")
