"""The view from inside a hollow organ, by real keys, wheel and pointer."""

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from support.browser import LAPTOP, PHONE
from support.lumens import bent
from support.touch_page import Touched, served_pages

import palpate as pp
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import serving

LUMEN, BEND, WALL = 5.0, 25.0, 2.0  # mm
LABELS, CENTER = bent(LUMEN, BEND)
WAY = BEND * np.pi / 2


def tube():
    """A quarter of a torus, held at both ends."""
    mesh = pp.hollow_mesh(LABELS, 1, WALL, 2.5)
    held = np.zeros(len(mesh.nodes), dtype=bool)
    for opening in mesh.centerline.openings:
        held |= np.abs((mesh.nodes - opening[:3]) @ opening[3:]) < 0.5
    return pp.Tissue(mesh, young=600, poisson=0.45, fixed=held)


TISSUE = tube()


def off_axis(points):
    """Distance (n,) of points to the torus' circle, mm, and the angle along it, radians."""
    x, y, z = (np.asarray(points) - CENTER).reshape(-1, 3).T
    return np.hypot(np.hypot(y, z) - BEND, x), np.arctan2(z, y)


class Inside(Touched):
    def position(self):
        return np.array(self.see("palpate.endoscope.position"))

    def along(self):
        return self.see("palpate.endoscope.along.mm")

    def wheel(self, steps):
        self.page.mouse.move(*self.place())
        for _ in range(abs(steps)):
            self.page.mouse.wheel(0, -100 if steps > 0 else 100)
            self.page.wait_for_timeout(20)


@pytest.fixture(scope="module")
def session():
    return pp.Session(pp.model(TISSUE, "compliance"), radius=2.5)


@pytest.fixture
def inside(browser, session):
    """Gives a page that shows the tube, with the camera in it."""
    with served_pages(browser, Inside) as opened:

        def open_page(*how, **serve):
            page = opened(pp.Session(session.model, radius=2.5), "Tube", *how, **serve)
            page.page.keyboard.press("7")
            return page

        yield open_page


def test_it_goes_in_looks_around_goes_on_and_leaves(inside, album):
    page = inside()
    page.wait("palpate.endoscope.active")
    begun = page.along()
    assert off_axis(page.position())[0] < 1.5
    page.page.screenshot(path=album / "inside-begin.png")
    page.wheel(6)
    page.wait(f"palpate.endoscope.along.mm > {begun + 4}")
    forward = np.array(page.see("palpate.endoscope.forward"))
    page.drag(page.place(0.7, 0.5), np.array((-200, 0)))  # what is seen follows the pointer: it looks to the right
    page.page.mouse.up()
    turned = np.array(page.see("palpate.endoscope.forward"))
    angle = np.degrees(np.arccos(forward @ turned))
    height = page.page.locator("#view").bounding_box()["height"]
    assert angle == pytest.approx(200 / height * 90, rel=0.1)
    before = page.along()
    page.page.keyboard.press("Tab")
    page.page.locator("#view").focus()
    page.page.keyboard.press("PageDown")  # back
    page.page.keyboard.press("q")
    page.wait("!palpate.endoscope.active")
    assert page.see("document.querySelector('#tool [aria-pressed=true]').dataset.value") == "press"
    page.wait("document.getElementById('camera-row').hidden")  # with the next picture
    page.page.keyboard.press("7")
    page.wait("palpate.endoscope.active")
    assert page.along() == pytest.approx(before, abs=3)  # it has stayed where it was


def test_it_flies_to_the_end_along_the_middle(inside):
    page = inside()
    page.page.keyboard.press("g")
    seen = []
    for _ in range(600):
        seen.append(page.position())
        if not page.see("palpate.endoscope.flying") and len(seen) > 5:
            break
        page.page.wait_for_timeout(50)
    away, angle = off_axis(seen)
    assert away.max() < 1.5
    assert np.ptp(angle) * BEND > 0.75 * WAY
    assert np.sign(np.diff(angle)).sum() in (np.count_nonzero(np.diff(angle)), -np.count_nonzero(np.diff(angle)))
    value = page.page.locator("#along").input_value()
    assert float(value) > 0.85 * WAY
    page.page.locator("#along").fill("10")
    page.wait("Math.abs(palpate.endoscope.along.mm - 10) < 1.5")


def test_ten_thousand_random_moves_never_leave_the_lumen(inside):
    """Towards places up to 40 mm away, through walls and openings. The circle of the torus is the judge."""
    page = inside()
    seen = page.see(
        """(() => {
          let seed = 1;
          const random = () => ((seed = (seed * 48271) % 2147483647) / 2147483647 - 0.5), seen = [];
          const { sphere } = palpate.endoscope;
          for (let i = 0; i < 10000; i++) {
            const far = i % 8 ? 4 : 80;
            sphere.moveTo(sphere.position.map((x) => x + far * random()));
            seen.push(...sphere.position);
          }
          return seen;
        })()"""
    )
    away, angle = off_axis(np.array(seen).reshape(-1, 3))
    radius = page.see("palpate.endoscope.radius")
    assert away.max() < LUMEN - 0.4 * radius + 0.3  # half of its radius is kept, to within the voxels of the label
    assert angle.min() > -0.02
    assert angle.max() < np.pi / 2 + 0.02
    assert np.ptp(angle) * BEND > 0.8 * WAY  # it was everywhere
    assert np.quantile(away, 0.99) > LUMEN - radius  # and pressed the wall


def test_the_wall_gives_and_its_force_is_that_of_push(inside):
    page = inside()
    page.see("palpate.endoscope.goTo(0, 20)")
    page.see("palpate.endoscope.look([1, 0, 0])")  # across: at the wall
    page.wheel(30)
    page.settle()
    frame = page.see("palpate.frame")
    tool = 2
    assert frame["contact"][tool] == 1
    point, moved, force = (
        np.array(frame[name][3 * tool : 3 * tool + 3]) for name in ("point", "displacement", "force")
    )
    radius = page.see("palpate.endoscope.radius")
    assert np.linalg.norm(moved) == pytest.approx(0.5 * radius, rel=0.05)  # as far as it may
    model = page.session.model
    expected = model.push(point, moved, 2.5, tolerance=1e-6).force
    if frame["contact"][1] == 0:  # else both tools are felt
        assert np.linalg.norm(force - expected) <= 2e-3 * np.linalg.norm(expected)
    assert np.linalg.norm(force) > 0.05
    assert page.see("Number(document.getElementById('force').textContent)") == pytest.approx(
        np.linalg.norm(force), abs=0.02
    )
    page.see("palpate.endoscope.goTo(0, 20)")
    page.wait("palpate.frame.contact.every((state) => state === 0)")


def test_a_biopsy_through_the_wall(inside, album):
    page = inside(scheme="dark")
    page.see("palpate.endoscope.goTo(0, 12)")
    page.page.keyboard.press("4")
    assert page.see("palpate.endoscope.active")
    page.page.mouse.click(*page.place(0.72, 0.5))
    page.wait("palpate.frame.contact[3] === 1")
    for _ in range(40):
        page.page.keyboard.press("+")
        page.page.wait_for_timeout(15)
        if page.see("palpate.frame.insertion[3]") > WALL:
            break
    page.wait(f"palpate.frame.insertion[3] > {WALL}")
    page.page.screenshot(path=album / "inside-biopsy.png")
    page.page.keyboard.press("o")
    page.wait("palpate.frame.contact[3] === 0")


@pytest.mark.parametrize(("viewport", "scheme"), [(LAPTOP, "light"), (LAPTOP, "dark"), (PHONE, "dark")])
def test_it_fits_and_axe_finds_nothing(inside, album, viewport, scheme):
    page = inside(viewport, scheme)
    page.wait("palpate.endoscope.active && !document.getElementById('camera-row').hidden")
    page.page.screenshot(path=album / f"inside-{viewport['width']}-{scheme}.png")
    found = Axe().run(page.page)
    assert found.violations_count == 0, found.generate_report()
    assert page.see("document.documentElement.scrollWidth <= innerWidth")
    boxes = page.see(
        "[...document.querySelectorAll('#tool button')].filter((b) => !b.hidden)"
        ".map((b) => [b.scrollWidth <= b.clientWidth + 1, b.getBoundingClientRect().right <= innerWidth])"
    )
    assert len(boxes) >= 6
    assert all(all(box) for box in boxes)


def test_what_is_solid_offers_no_camera(browser, tissue):
    session = pp.Session(pp.model(tissue, "springs"), radius=8, sweeps=4)
    with serving(session, loopback_socket(None), title="Solid") as address:
        page = Inside(session, browser.new_page())
        page.open(address)
        assert not page.page.locator("#tool >> text=Camera").is_visible()
        page.page.keyboard.press("7")
        assert not page.see("palpate.endoscope.active")
        page.page.close()


def test_an_exported_page_goes_in_too(browser, tmp_path):
    pp.export(TISSUE, tmp_path / "tube.html", title="Tube")
    context = browser.new_context(viewport=LAPTOP, offline=True)
    page = Inside(None, context.new_page())
    page.page.goto(f"file://{tmp_path}/tube.html")
    page.wait("Boolean(window.palpate && palpate.frame)")
    page.page.keyboard.press("7")
    page.wait("palpate.endoscope.active")
    page.see("palpate.endoscope.goTo(0, 20)")
    page.see("palpate.endoscope.look([1, 0, 0])")
    page.wheel(30)
    page.wait("palpate.frame.contact[2] === 1")
    context.close()
