"""Measuring in a real Chromium, by real pointer and key events, on solids whose measures are known."""

import csv
import math
from itertools import pairwise

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from scipy.integrate import dblquad
from support.brick_meshes import brick
from support.browser import LAPTOP, PHONE
from support.example_organs import ellipsoid, organ
from support.touch_page import Touched, served_pages

import palpate as pp

pytestmark = pytest.mark.browser

EDGE, RADIUS, HEIGHT = 50.0, 30.0, 40.0


def cylinder(cells=16, levels=8):
    """Upright, from z = 0 on: squares of a brick's cross-section become circles."""
    mesh = brick((cells, cells, levels), (2.0, 2.0, HEIGHT))
    x, y = mesh.nodes[:, :2].T - 1
    round_x, round_y = x * np.sqrt(1 - y**2 / 2), y * np.sqrt(1 - x**2 / 2)
    return pp.TetMesh(np.stack([RADIUS * round_x, RADIUS * round_y, mesh.nodes[:, 2]], axis=1), mesh.tets)


def solid(name):
    mesh = {
        "cube": lambda: brick((10, 10, 10)),
        "ball": lambda: ellipsoid(17, (RADIUS,) * 3, (0.0, 0.0, 0.0), 12.0),
        "cylinder": cylinder,
    }[name]()
    return pp.Tissue(mesh, 5.0, 0.3, mesh.nodes[:, 2] <= mesh.nodes[:, 2].min() + 1e-6 + 0.1 * RADIUS)


class Measured(Touched):
    """A page with the tool Measure, and what it tells."""

    def pixel(self, point):
        """Where a point of space is drawn."""
        return np.array(self.see(f"palpate.pixel({[float(x) for x in point]})"))

    def click(self, *points):
        """A click at each point; where the picture has whole pixels, the place of the click."""
        for point in points:
            x, y = self.pixel(point)
            self.page.mouse.move(x, y)
            self.page.mouse.down()
            self.page.mouse.up()

    def choose(self, kind):
        self.page.click(f"#measure-kind >> text={kind}")

    def rows(self):
        self.wait("palpate.measured")
        return self.page.locator("#measurement-list li").all_inner_texts()

    def figures(self, when="At rest"):
        """Every number of the newest measurement, in mm, mm² or degrees."""
        line = next(line for line in self.rows()[-1].splitlines() if line.startswith(when))
        return numbers(line.removeprefix(f"{when}:"))

    def volumes(self, when="At rest"):
        """mm³ by name."""
        found = {}
        for text in self.page.locator("#volumes li").all_inner_texts():
            name, *lines = text.splitlines()
            line = next(line for line in lines if line.startswith(when))
            found[name] = numbers(line.removeprefix(f"{when}:"))[0]
        return found


def numbers(line):
    found = []
    for quantity in line.split(","):
        *_, number, unit = quantity.replace("°", " °").split()
        found.append(float(number) * {"cm²": 100, "cm³": 1000}.get(unit, 1))
    return found


@pytest.fixture
def measured(browser):
    """Gives a page that shows a solid, with the tool chosen by its key."""
    with served_pages(browser, Measured) as opened:

        def open_page(tissue, *how, model="springs", **serve):
            page = opened(pp.Session(pp.model(tissue, model), radius=8.0, sweeps=4), "Test solid", *how, **serve)
            page.page.keyboard.press("6")
            return page

        yield open_page


def on_ball(*degrees):
    """A point of the ball by longitude and latitude, the front of the picture at (-30, 25)."""
    a, b = np.radians(degrees)
    return RADIUS * np.array([np.sin(a) * np.cos(b), -np.cos(a) * np.cos(b), np.sin(b)])


def test_a_cube_s_distance_angle_area_and_volume(measured, album):
    page = measured(solid("cube"))
    page.click((10, 10, EDGE), (40, 30, EDGE))
    straight, along = page.figures()
    assert straight == pytest.approx(math.hypot(30, 20), rel=0.01)
    assert along == pytest.approx(straight, rel=0.01)  # in a face the shortest way is the straight one
    page.click((25, 0, 20), (25, 20, EDGE))  # over an edge, square to it: up the front and in along the top
    straight, along = page.figures()
    assert straight == pytest.approx(math.hypot(30, 20), rel=0.01)
    assert along == pytest.approx(30 + 20, rel=0.01)
    page.choose("Angle")
    page.click((40, 10, EDGE), (10, 10, EDGE), (30, 30, EDGE))
    assert page.figures() == [pytest.approx(45, rel=0.01)]
    page.choose("Area")
    corners = [(10, 5, EDGE), (40, 5, EDGE), (40, 45, EDGE), (20, 20, EDGE)]  # not convex
    page.click(*corners, corners[0])  # the first one again closes it
    x, y = np.array(corners)[:, 0], np.array(corners)[:, 1]
    shoelace = abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2
    around = np.linalg.norm(np.diff(np.array([*corners, corners[0]]), axis=0), axis=1).sum()
    assert page.figures() == [pytest.approx(shoelace, rel=0.01), pytest.approx(around, rel=0.01)]
    assert page.volumes() == {"Volume of organ": pytest.approx(EDGE**3, rel=0.001)}
    page.page.screenshot(path=album / "measure-cube.png")


def test_a_ball_s_great_circle_cap_and_volumes(measured, album):
    page = measured(solid("ball"))
    one, other = on_ball(-60, 10), on_ball(5, 45)
    page.click(one, other)
    straight, along = page.figures()
    between = math.acos(one @ other / RADIUS**2)
    assert straight == pytest.approx(2 * RADIUS * math.sin(between / 2), rel=0.01)
    assert along == pytest.approx(RADIUS * between, rel=0.01)
    page.choose("Area")
    middle = on_ball(-30, 25) / RADIUS
    east = np.cross((0, 0, 1), middle) / np.linalg.norm(np.cross((0, 0, 1), middle))
    north, half = np.cross(middle, east), 16.0
    square = [(-half, -half), (half, -half), (half, half), (-half, half)]
    page.click(*[a * east + b * north + math.sqrt(RADIUS**2 - a * a - b * b) * middle for a, b in square])
    page.page.keyboard.press("Enter")
    cap = dblquad(lambda b, a: RADIUS / math.sqrt(RADIUS**2 - a * a - b * b), -half, half, -half, half)[0]
    assert cap > 1.1 * (2 * half) ** 2  # it is not the flat square
    assert page.figures()[0] == pytest.approx(cap, rel=0.01)
    volumes, mesh = page.volumes(), page.session.mesh
    edges = mesh.nodes[mesh.tets[:, 1:]] - mesh.nodes[mesh.tets[:, :1]]
    lump = (np.linalg.det(edges) / 6)[mesh.region == 2].sum()  # of tetrahedra: another sum than over a surface
    assert volumes == {
        "Volume of organ, with what is inside": pytest.approx(4 / 3 * math.pi * RADIUS**3, rel=0.01),
        "Volume of lump": pytest.approx(lump, rel=0.001),
    }
    page.page.screenshot(path=album / "measure-ball.png")


def test_a_cylinder_s_girth_wall_and_volume(measured):
    page = measured(solid("cylinder"))
    a, b = np.radians([-70, 10])
    page.click(*[(RADIUS * math.sin(t), -RADIUS * math.cos(t), 20) for t in (a, b)])
    straight, along = page.figures()
    assert straight == pytest.approx(2 * RADIUS * math.sin((b - a) / 2), rel=0.01)
    assert along == pytest.approx(RADIUS * (b - a), rel=0.01)
    page.choose("Area")
    angles = np.radians(np.linspace(-55, -5, 6))
    wall = [
        (RADIUS * math.sin(t), -RADIUS * math.cos(t), z) for z, row in ((8, angles), (30, angles[::-1])) for t in row
    ]
    page.click(*wall)
    page.page.click("#measure-finish")
    assert page.figures()[0] == pytest.approx(RADIUS * np.radians(50) * 22, rel=0.01)
    assert page.volumes() == {"Volume of organ": pytest.approx(math.pi * RADIUS**2 * HEIGHT, rel=0.01)}


def ink(page, pixel):
    """Whether a mark is drawn at a pixel of the window."""
    return page.see(
        f"""(() => {{
            const canvas = document.getElementById('marks-overlay'), box = canvas.getBoundingClientRect();
            const [x, y] = [{pixel[0]} - box.left, {pixel[1]} - box.top].map((v) => Math.round(v * devicePixelRatio));
            return canvas.getContext('2d').getImageData(x, y, 1, 1).data[3] > 0;
        }})()"""
    )


def node_at(page, point):
    """The shown node nearest to a point, and where it is at rest and now."""
    session = page.session
    places = session.mesh.nodes[session.shown]
    number = int(np.argmin(np.linalg.norm(places - point, axis=1)))
    return number, places[number], places[number] + np.array(session.frame().shown)[number]


def test_marks_stay_on_the_tissue_and_say_whether_it_is_at_rest(measured, album):
    page = measured(organ(11), model="blocks")
    points = [(-16.0, -12.0, 18.0), (14.0, -10.0, 18.0)]
    nodes = [node_at(page, point) for point in points]
    page.click(*[node[1] for node in nodes])
    rest = np.linalg.norm(nodes[0][1] - nodes[1][1])
    assert page.figures()[0] == pytest.approx(rest, rel=0.01)
    assert "Now" not in page.rows()[0]
    before = np.array(page.see(f"palpate.nodePixel({nodes[0][0]})"))
    page.page.keyboard.press("2")
    page.drag(before + (8, 4), np.array((-70, -60)))
    page.settle()
    (number, _, one), (_, _, other) = (node_at(page, point) for point in points)
    now = np.linalg.norm(one - other)
    assert abs(now - rest) > 0.1 * rest
    assert page.figures("Now")[0] == pytest.approx(now, rel=0.02)
    assert page.figures("At rest")[0] == pytest.approx(rest, rel=0.01)
    after = np.array(page.see(f"palpate.nodePixel({number})"))
    assert np.linalg.norm(after - before) > 25
    assert ink(page, after)
    assert not ink(page, before)
    volumes = page.volumes(), page.volumes("Now")
    assert 0.9 < volumes[1]["Volume of lump"] / volumes[0]["Volume of lump"] < 1.1
    page.page.screenshot(path=album / "measure-pulled.png")
    page.page.mouse.up()
    page.until_home()
    page.wait("document.querySelectorAll('#measurement-list p:not([hidden])').length === 1")
    assert not ink(page, after)


def test_keys_alone_measure_take_back_and_remove(measured):
    page = measured(organ())
    keyboard = page.page.keyboard
    page.page.locator("#view").focus()
    keyboard.press(" ")
    for _ in range(6):
        keyboard.press("ArrowRight")
    assert "1 point of 2" in page.rows()[0]
    keyboard.press(" ")
    assert page.figures()[0] > 5
    for key in ("k", " ", "ArrowUp", "ArrowUp", " "):
        keyboard.press(key)
    assert "2 points of 3" in page.rows()[1]
    keyboard.press("z")
    assert "1 point of 3" in page.rows()[1]
    keyboard.press("Escape")
    assert len(page.rows()) == 1
    keyboard.press("k")  # an area
    for key in (" ", *["ArrowUp"] * 4, " ", *["ArrowLeft"] * 4, " ", "Enter"):
        keyboard.press(key)
    assert [row.splitlines()[0] for row in page.rows()] == ["Distance 1", "Area 1"]
    assert page.figures()[0] > 10
    page.page.get_by_role("button", name="Remove Distance 1").press("Enter")
    assert [row.splitlines()[0] for row in page.rows()] == ["Area 1"]
    assert page.see("document.activeElement.getAttribute('aria-label')") == "Remove Area 1"
    keyboard.press("z")
    assert page.rows() == []
    page.page.locator("#measure-undo").press("Enter")
    page.until_told("no measurement to take back")


def test_a_polygon_that_crosses_itself_and_a_line_that_leaves_the_surface_have_no_figure(measured):
    page = measured(solid("cube"))
    page.choose("Area")
    page.click((10, 10, EDGE), (40, 40, EDGE), (40, 10, EDGE), (10, 40, EDGE))
    page.page.keyboard.press("Enter")
    assert "At rest: –, outline –" in page.rows()[0]
    page.page.click("#measure-finish")
    page.until_told("three points")


def test_the_table_holds_what_the_list_tells(measured):
    page = measured(organ())
    page.click((-16, -12, 18), (14, -10, 18))
    straight, along = page.figures()
    with page.page.expect_download() as saved:
        page.page.click("#measure-save")
    with open(saved.value.path()) as file:
        rows = list(csv.DictReader(file))
    found = [(r["measurement"], r["state"], r["quantity"], r["unit"]) for r in rows]
    assert found[:2] == [("Distance 1", "at rest", "", "mm"), ("Distance 1", "at rest", "along the surface", "mm")]
    assert [float(r["value"]) for r in rows[:2]] == [
        pytest.approx(straight, abs=0.051),
        pytest.approx(along, abs=0.051),
    ]
    assert ("Volume of lump", "now", "", "mm³") in found


def test_a_replay_is_measured_while_it_plays(measured):
    session = pp.Session(pp.model(organ(), "springs"), radius=8.0, sweeps=4)
    session.step([pp.Command(True, (0.0, 0.0, 25.0), (0, 0, -6))] * 6000)
    page = measured(organ(), replay=session.record())
    page.wait("palpate.frame.contact[0] === 1")
    page.click((0, -3, 24.8), (14, -10, 18))
    assert page.figures("Now")[0] != page.figures("At rest")[0]


@pytest.mark.parametrize(
    ("viewport", "scheme"), [(PHONE, "dark"), ({"width": 844, "height": 390}, "light"), (LAPTOP, "dark")]
)
def test_it_fits_and_axe_finds_nothing(measured, album, viewport, scheme):
    page = measured(organ(), viewport, scheme)
    page.click((-16, -12, 18), (14, -10, 18))
    page.choose("Area")
    page.click((-8, -18, 15), (8, -18, 15), (8, -12, 20), (-8, -12, 20))
    page.page.click("#measure-finish")
    rows = page.rows()
    assert len(rows) == 2
    assert page.see("document.documentElement.scrollWidth") == viewport["width"]
    buttons = [each.bounding_box() for each in page.page.locator("#tool button:visible").all()]
    assert all(a["x"] + a["width"] <= b["x"] + 0.5 for a, b in pairwise(buttons))
    assert Axe().run(page.page).response["violations"] == []
    page.page.screenshot(path=album / f"measure-{viewport['width']}-{scheme}.png")
