"""Measuring in slices, in a real Chromium by real pointer and key events: mm by the file's own spacing."""

import csv
import math

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from support.browser import LAPTOP, PHONE, Seen

import palpate as pp
from palpate.server.loopback_server import loopback_socket
from palpate.server.view import image_payloads, serving_images

pytestmark = pytest.mark.browser

SHAPE, SPACING = (12, 40, 60), (5.0, 2.0, 0.5)  # anisotropic, (z, y, x) mm


def volume():
    return pp.Volume(np.random.default_rng(1).uniform(0, 1, SHAPE), pp.Grid(SHAPE, SPACING, (-3, 7, 11)))


def scan():
    counts = np.random.default_rng(6).poisson(400, (3, 40, 30)).astype(float)
    source = np.stack([np.linspace(-50, 50, 3), np.zeros(3), np.full(3, 300.0)], axis=1)
    return pp.Scan(counts, 1000, pp.Views(source, pp.Panel((40, 30), (0.5, 2.0), (-3, -3, 0))))


class Measured(Seen):
    """The viewer with one image, and what it tells of it."""

    def open(self, address):
        self.page.goto(address)
        self.drawn()

    def drawn(self):
        self.wait("Boolean(window.viewer && viewer.ready)")

    def click(self, plane, *indices):
        """Clicks at voxels (rows, columns of the file along the plane), by arithmetic on the pane's size alone."""
        cut = {"axial": 0, "coronal": 1, "sagittal": 2}[plane]
        down, across = (axis for axis in range(3) if axis != cut)
        for row, column in indices:
            box = self.page.locator(f'.pane[data-plane="{plane}"] canvas').bounding_box()
            mm = np.array(self.shape) * self.spacing
            scale = max(mm[across] / box["width"], mm[down] / box["height"])
            x = (column - (self.shape[across] - 1) / 2) * self.spacing[across] / scale
            y = (row - (self.shape[down] - 1) / 2) * self.spacing[down] / scale * (1 if plane == "axial" else -1)
            self.page.mouse.click(box["x"] + box["width"] / 2 + x, box["y"] + box["height"] / 2 + y)
            self.drawn()

    def choose(self, kind):
        self.page.click(f"#measure-kind >> text={kind}")
        self.drawn()

    def rows(self):
        self.drawn()
        return [
            [line for line in row.splitlines() if line]
            for row in self.page.locator("#measurement-list li").all_inner_texts()
        ]

    def figures(self):
        """Of the newest measurement, in mm, mm² or degrees."""
        quantities = [q.replace("°", " °").split() for q in self.rows()[-1][1].split(",")]
        return [float(number) * {"cm²": 100}.get(unit, 1) for *_, number, unit in quantities]


@pytest.fixture
def opened(browser):
    """Gives the viewer of an image."""
    closing, pages = [], []

    def open_page(image, shape, spacing, viewport=LAPTOP, scheme="light"):
        served = serving_images(image_payloads([image], ["image"]), loopback_socket(None))
        touch = viewport is not LAPTOP
        context = browser.new_context(viewport=viewport, color_scheme=scheme, has_touch=touch, is_mobile=touch)
        page = Measured(context.new_page())
        page.shape, page.spacing = shape, spacing
        closing.extend([context.close, lambda: served.__exit__(None, None, None)])
        pages.append(page)
        page.open(served.__enter__())
        return page

    yield open_page
    for close in closing:
        close()
    for page in pages:
        assert page.problems == []


def test_distance_angle_and_area_are_in_mm_of_an_anisotropic_volume(opened, album):
    page = opened(volume(), SHAPE, SPACING)
    page.page.click("#tool >> text=Measure")
    page.click("axial", (5, 10), (35, 50))
    assert page.figures() == [pytest.approx(math.hypot(30 * 2.0, 40 * 0.5), rel=0.01)]
    page.click("coronal", (1, 10), (9, 50))
    assert page.figures() == [pytest.approx(math.hypot(8 * 5.0, 40 * 0.5), rel=0.01)]
    page.choose("Angle")
    page.click("axial", (30, 10), (10, 10), (30, 50))
    assert page.figures() == [pytest.approx(math.degrees(math.atan2(40 * 0.5, 20 * 2.0)), rel=0.01)]
    page.choose("Area")
    corners = [(z, y) for y, z in [(2, 1), (36, 1), (34, 10), (20, 4)]]
    page.click("sagittal", *corners, corners[0])
    z, y = np.array(corners, dtype=float).T * [[5.0], [2.0]]
    shoelace = abs(np.dot(y, np.roll(z, -1)) - np.dot(z, np.roll(y, -1))) / 2
    outline = np.hypot(np.roll(y, -1) - y, np.roll(z, -1) - z).sum()
    assert page.figures() == [pytest.approx(shoelace, rel=0.01), pytest.approx(outline, rel=0.01)]
    assert [row[0] for row in page.rows()] == ["Distance 1", "Distance 2", "Angle 1", "Area 1"]
    page.page.screenshot(path=album / "view-measure.png")
    with page.page.expect_download() as saved:
        page.page.click("#measure-save")
    with open(saved.value.path()) as file:
        table = list(csv.DictReader(file))
    assert [float(row["value"]) for row in table][-2:] == [
        pytest.approx(shoelace, rel=0.01),
        pytest.approx(outline, rel=0.01),
    ]


def test_a_scan_is_measured_on_its_panel(opened):
    page = opened(scan(), (3, 40, 30), (1, 0.5, 2.0))
    page.page.keyboard.press("a")
    page.click("axial", (5, 5), (35, 25))
    assert page.figures() == [pytest.approx(math.hypot(30 * 0.5, 20 * 2.0), rel=0.01)]
    assert page.rows()[0][2].endswith("on the panel")


def test_keys_alone_measure_and_a_mark_belongs_to_its_slice(opened):
    page = opened(volume(), SHAPE, SPACING)
    keyboard = page.page.keyboard
    for key in ("Tab",) * 40:
        keyboard.press(key)
        if page.see("document.activeElement.parentElement.dataset.plane === 'axial'"):
            break
    for key in ("a", "Enter", *["ArrowDown"] * 6, "Enter"):
        keyboard.press(key)
    assert page.figures() == [pytest.approx(12.0)]
    marked = page.see("document.querySelector('[data-plane=axial] canvas').toDataURL()")
    keyboard.press("PageUp")
    page.drawn()
    keyboard.press("Enter")  # begins another one here
    keyboard.press("PageDown")
    keyboard.press("Enter")
    page.drawn()
    assert "another slice" in page.page.inner_text("#measure-message")
    keyboard.press("Escape")
    page.drawn()
    assert page.see("document.querySelector('[data-plane=axial] canvas').toDataURL()") == marked
    keyboard.press("z")
    assert page.rows() == []
    assert page.see("document.querySelector('[data-plane=axial] canvas').toDataURL()") != marked
    for key in ("a", "a", "Enter", *["ArrowRight"] * 8, "Enter", *["ArrowDown"] * 3, "Enter", "Shift+Enter"):
        keyboard.press(key)
    assert page.figures()[0] == pytest.approx(8 * 0.5 * 3 * 2.0 / 2)
    keyboard.press("r")
    assert page.rows() == []


@pytest.mark.parametrize(("viewport", "scheme"), [(PHONE, "dark"), (LAPTOP, "light")])
def test_it_fits_and_axe_finds_nothing(opened, album, viewport, scheme):
    page = opened(volume(), SHAPE, SPACING, viewport, scheme)
    page.page.click("#tool >> text=Measure")
    page.click("axial", (5, 10), (35, 50))
    page.choose("Area")
    assert page.see("document.documentElement.scrollWidth") == viewport["width"]
    assert Axe().run(page.page).response["violations"] == []
    page.page.screenshot(path=album / f"view-measure-{viewport['width']}.png")
