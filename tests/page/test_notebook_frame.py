"""The front end of the notebook's widgets in a real Chromium, mounted as anywidget mounts it, without Jupyter."""

import re

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from support.browser import LAPTOP, PHONE
from support.example_organs import organ
from support.notebook_host import framed, host, mount

import palpate as pp
from palpate.server.view import image_payloads
from palpate.simulation.recording import record_of_page
from palpate.simulation.session_compatibility import recorded_settings
from palpate.standalone.image_page import image_page
from palpate.standalone.organ_data import organ_data, session_of
from palpate.standalone.organ_page import one_file

SETTABLE = ("tool", "depth", "view", "color")
TISSUE = organ(9)


@pytest.fixture(scope="module")
def organ_html():
    return one_file(organ_data(session_of(TISSUE), "Organ", "Find the lump."), "Organ", host="notebook")


@pytest.fixture
def notebook(browser):
    context = browser.new_context(viewport=LAPTOP)
    context.set_offline(True)
    page = context.new_page()
    page.problems, page.requests = [], []
    page.on("pageerror", lambda error: page.problems.append(str(error)))
    page.on("request", lambda request: page.requests.append(request.url))
    host(page)
    yield page
    assert page.problems == []
    assert [url for url in page.requests if not re.match("data:|blob:|about:", url)] == []
    context.close()


@pytest.fixture
def touched(notebook, organ_html):
    return mount(notebook, organ_html, SETTABLE)


def test_the_force_of_a_press_is_that_of_push(touched):
    touched.drag(touched.place(), np.array((40, 10)))
    touched.settle()
    touched.until("v._touched && Math.hypot(...v._touched.force) > 0.1")
    told, before = touched.value("_touched"), None
    while told != before:  # until the newest is there
        touched.page.wait_for_timeout(500)
        told, before = touched.value("_touched"), told
    told = {name: np.array(value) for name, value in told.items()}
    radius = session_of(TISSUE).settings.radius
    expected = pp.model(TISSUE, "compliance").push(told["point"], told["displacement"], radius, tolerance=1e-6).force
    assert np.linalg.norm(expected) > 0.1
    assert np.linalg.norm(told["force"] - expected) <= 1e-3 * np.linalg.norm(expected)
    np.testing.assert_allclose(told["position"], told["point"] + told["displacement"], atol=1e-9)
    touched.page.mouse.up()
    touched.until("v._touched === null")


def test_a_click_is_reported_once_with_its_place(touched):
    touched.until("v.depth > 0")
    assert touched.value("_picked") is None
    touched.page.mouse.click(*touched.place())
    touched.until("v._picked?.count === 1")
    point = np.array(touched.value("_picked")["point"])
    ideal = np.sqrt(((point / (40, 30, 25)) ** 2).sum())  # 1 on the ellipsoid, less on the chords of its mesh
    assert 0.93 < ideal <= 1.001
    touched.page.mouse.click(*touched.place(0.03, 0.95))  # beside the organ
    touched.page.mouse.click(*touched.place(0.45))
    touched.until("v._picked?.count === 2")
    assert np.linalg.norm(np.array(touched.value("_picked")["point"]) - point) > 1


def test_the_session_that_is_reported_replays_and_is_scored(touched):
    touched.drag(touched.place(), np.array((30, 10)))
    touched.settle()
    touched.frame.locator("#found").evaluate("button => button.click()")
    force, tick = touched.tool()[2], int(touched.see("palpate.frame.tick"))
    touched.page.mouse.up()
    touched.until("v._record")
    record = record_of_page(touched.value("_record"))
    assert [mark[1:] for mark in record.marks] == [(0, 0)]
    session = pp.Session(pp.model(TISSUE, "compliance"), **recorded_settings(record))
    forces = next(session.replayed(record, record.length))[1]
    assert np.abs(forces[min(tick, len(forces)) - 1, 0] - force).max() <= 1e-3
    score = pp.score(record, TISSUE, pp.Task("lump"))
    assert score.touches == len(score.claims) == 1


def test_what_is_set_is_obeyed_and_what_is_possible_is_told(touched):
    touched.until("v.depth > 0")
    touched.give("tool", "needle")
    touched.until("v.depth === 0")  # of the needle, as the page says
    assert touched.see("document.querySelector('#tool [aria-pressed=true]').dataset.value") == "needle"
    touched.give("tool", "press")
    touched.until("v.depth > 0")
    touched.give("depth", 3.25)
    touched.wait("document.getElementById('amount-set').textContent === '3.3 mm'")
    for _ in range(2):  # the second time the page changes nothing, and says so again
        touched.give("depth", 1000)
        touched.until("v.depth < 20")
    touched.give("color", "displacement")
    touched.wait("!document.getElementById('legend').hidden")
    top = int(np.argmax(TISSUE.mesh.nodes[:, 2]))
    shown = int(np.searchsorted(session_of(TISSUE).displayed.nodes, top))
    touched.give("view", [0, 90])
    touched.until("v.view[1] > 85")
    center = np.array(touched.frame.locator("#view").evaluate("view => [view.clientWidth, view.clientHeight]")) / 2
    assert np.abs(np.array(touched.see(f"palpate.nodePixel({shown})")) - center).max() < 25  # seen from above
    touched.give("view", [90, 0])  # from +x: the node of largest x is in the middle
    touched.until("v.view[0] === 90")
    right = int(np.argmax(TISSUE.mesh.nodes[:, 0] - np.abs(TISSUE.mesh.nodes[:, 1:]).sum(axis=1)))
    shown = int(np.searchsorted(session_of(TISSUE).displayed.nodes, right))
    assert np.abs(np.array(touched.see(f"palpate.nodePixel({shown})")) - center).max() < 25


def test_a_report_on_its_way_does_not_undo_what_is_set(touched):
    """The page reports 5 mm while the 2 mm that were set here are still on their way to it."""
    touched.until("v.depth > 0")
    touched.page.evaluate("""() => {
      const post = MessagePort.prototype.postMessage;
      MessagePort.prototype.postMessage = function (message) { setTimeout(() => post.call(this, message), 2000); };
      window.depths = [];
      const { model } = mounted[0];
      model.on("change:depth", () => depths.push(model.get("depth")));
    }""")
    touched.give("depth", 2)
    touched.frame.locator("#amount").fill("5")
    touched.wait("document.getElementById('amount-set').textContent === '5.0 mm'")
    touched.wait("document.getElementById('amount-set').textContent === '2.0 mm'")
    touched.page.wait_for_timeout(300)
    assert touched.page.evaluate("depths") == [2]


def test_the_hand_in_the_page_is_reported_too(touched):
    touched.until("v.depth > 0")
    touched.frame.locator("#tool >> text=Pull").click()
    touched.until("v.tool === 'pull'")
    touched.frame.locator("#amount").fill("2.5")
    touched.until("Math.abs(v.depth - 2.5) < 0.2")
    before = touched.value("view")
    touched.drag(touched.place(0.05, 0.95), np.array((60, -30)))
    touched.page.mouse.up()
    touched.until(f"Math.abs(v.view[0] - {before[0]}) > 2")


def test_no_more_than_twenty_messages_a_second(touched):
    touched.until("v.depth > 0")
    begun = touched.page.evaluate("[performance.now(), mounted[0].saves.length]")
    for i in range(3):
        touched.drag(touched.place(), np.array((40 * (-1) ** i, 10)), steps=15)
        touched.page.mouse.up()
    ended = touched.page.evaluate("[performance.now(), mounted[0].saves.length]")
    assert 3 <= ended[1] - begun[1] <= (ended[0] - begun[0]) / 50 + 2


def test_two_at_once_and_their_workers_end_with_them(browser, notebook, organ_html):
    """Five at once are tried in JupyterLab (test_jupyterlab.py): here they would take the machine from the other tests."""
    seen = browser.new_browser_cdp_session()

    def workers():
        return sum(each["type"] == "worker" for each in seen.send("Target.getTargets")["targetInfos"])

    others = workers()
    both = [mount(notebook, organ_html, SETTABLE, height=420) for _ in range(2)]
    for i, each in enumerate(both):
        each.give("depth", 1 + i)
    for i, each in enumerate(both):
        notebook.locator(".palpate-widget").nth(i).scroll_into_view_if_needed()
        each.drag(each.place(), np.array((10, 5)), steps=2)
        each.until(f"v._touched && Math.abs(Math.hypot(...v._touched.displacement) - {1 + i}) < 0.02")
        notebook.mouse.up()
        each.until("v._touched === null")
    assert workers() == others + 2
    assert notebook.evaluate("document.querySelectorAll('style').length") == 2
    notebook.evaluate("for (const each of mounted) each.close()")
    for _ in range(600):
        if workers() == others:
            break
        notebook.wait_for_timeout(50)
    assert workers() == others
    assert notebook.evaluate("document.querySelectorAll('iframe, style').length") == 0
    assert notebook.evaluate("mounted.flatMap(({ heard }) => Object.values(heard).flat()).length") == 0


def test_the_frame_cannot_reach_the_notebook(touched):
    assert touched.see("origin") == "null"
    reach = "(() => { try { return String(parent.document); } catch (error) { return error.name; } })()"
    assert touched.see(reach) == "SecurityError"


def test_it_begins_again_where_the_notebook_moves_it(touched):
    """A notebook that moves a cell takes the frame out of its document, and the browser loads it anew."""
    touched.give("depth", 2)
    touched.wait("document.getElementById('amount-set').textContent === '2.0 mm'")
    touched.page.evaluate("document.body.append(mounted[0].el)")
    again = framed(touched.page, 0)
    again.wait("document.getElementById('amount-set').textContent === '2.0 mm'")


@pytest.mark.parametrize(("device", "dark"), [("laptop", True), ("laptop", False), ("phone", True)])
def test_light_and_dark_are_the_notebooks(device, dark, browser, organ_html, album):
    """Even where the system's are others."""
    context = browser.new_context(
        viewport=PHONE if device == "phone" else LAPTOP, color_scheme="light" if dark else "dark"
    )
    page = context.new_page()
    host(page)
    page.evaluate(f"document.body.dataset.jpThemeLight = '{str(not dark).lower()}'")
    mine = mount(page, organ_html, SETTABLE)
    ground = "getComputedStyle(document.body).backgroundColor"
    sheets = {True: "rgb(25, 30, 34)", False: "rgb(255, 255, 255)"}
    mine.wait(f"{ground} === '{sheets[dark]}'")
    found = Axe().run(mine.frame)
    assert found.violations_count == 0, found.generate_report()
    page.screenshot(path=album / f"notebook-touch-{device}-{'dark' if dark else 'light'}.png")
    page.evaluate(f"document.body.dataset.jpThemeLight = '{str(dark).lower()}'")
    mine.wait(f"{ground} === '{sheets[not dark]}'")
    context.close()


def ramp(shape=(8, 10, 12)):
    grid = pp.Grid(shape, (2, 1.5, 1), (-3, 4, 5))
    z, y, x = np.indices(shape)
    return pp.Volume(100 * z + 10 * y + x, grid, unit="HU")


def test_slices_are_read_and_set(notebook, album):
    volume = ramp()
    html = image_page(image_payloads([volume], ["</script><!-- ramp"]), host="notebook")
    mine = mount(notebook, html, ("position", "window"), ready="Boolean(window.viewer && viewer.ready)")
    mine.until("v.position && v._value !== undefined")
    mine.give("position", [volume.grid.origin[0] + 4.2, volume.grid.origin[1] + 3 * 1.5, volume.grid.origin[2] + 2])
    mine.until("v._value === 134")
    np.testing.assert_allclose(mine.value("position"), volume.grid.points([1, 3, 4])[0])
    mine.give("window", [10, 300])
    mine.wait("document.getElementById('high').value === '300'")
    assert mine.see("document.getElementById('title').textContent") == "</script><!-- ramp"
    assert mine.see("document.querySelectorAll('#layout button').length") == 4  # no rendering
    pixel = mine.see(f"viewer.pixel(0, 'axial', {volume.grid.points([1, 5, 6])[0].tolist()})")
    box = notebook.locator("iframe").bounding_box()
    notebook.mouse.click(box["x"] + pixel[0], box["y"] + pixel[1])
    mine.until("v._value === 156")
    notebook.screenshot(path=album / "notebook-view-laptop-light.png")
    found = Axe().run(mine.frame)
    assert found.violations_count == 0, found.generate_report()


def test_a_large_volume_is_coarser_and_says_so(notebook):
    payloads = image_payloads([ramp((16, 20, 24))], ["large"], most=2000)
    html = image_page(payloads, host="notebook")
    mine = mount(notebook, html, ("position", "window"), ready="Boolean(window.viewer && viewer.ready)")
    assert np.prod(mine.see("viewer.state.side.source.shape")) <= 2000
    assert "7,680 voxels are too many" in mine.see("document.getElementById('note').textContent")


def test_projections_play_in_it(notebook):
    counts = np.random.default_rng(0).uniform(100, 900, (5, 10, 20)).astype(np.float32)
    source = np.stack([np.arange(5) * 10.0, np.zeros(5), np.full(5, 500.0)], axis=1)
    scan = pp.Scan(counts, 1000, pp.Views(source, pp.Panel((10, 20), (0.5, 0.25), (0, 0, 0))))
    mine = mount(
        notebook,
        image_page(image_payloads([scan], ["scan"]), host="notebook"),
        ("position", "window"),
        ready="Boolean(window.viewer && viewer.ready)",
    )
    mine.frame.locator("text=Counts").click()
    mine.until(f"Math.abs(v._value - {counts[2, 5, 10]}) < 1e-3")
