"""How the organ is drawn in a real Chromium: as tissue or plainly, tools, blood, and what a slow machine leaves out."""

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from support.brick_meshes import brick
from support.browser import LAPTOP, PHONE
from support.example_organs import organ
from support.running_server import until
from support.touch_page import Touched

import palpate as pp
from palpate.server.live_session import LiveSession
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import running_session
from palpate.simulation.pointer import Pointer

pytestmark = pytest.mark.browser
RADIUS = 7.0  # mm, of the contact


@pytest.fixture(scope="module")
def model():
    return pp.model(organ(10), "compliance")


@pytest.fixture
def opened(browser, model):
    """Gives a page of a session of that title."""
    closing = []

    def start(title="kidney", viewport=LAPTOP, scheme="light", model=model):
        live = LiveSession(pp.Session(model, radius=RADIUS, sweeps=2, tension=1.0), Pointer(), title)
        serving = running_session(live, loopback_socket(None))
        context = browser.new_context(viewport=viewport, color_scheme=scheme, has_touch=viewport is PHONE)
        touched = Touched(live.session, context.new_page())
        closing.extend([(context.close, ()), (serving.__exit__, (None, None, None))])
        touched.open(serving.__enter__())
        touched.live = live
        draw_all(touched)
        return touched

    yield start
    for close, arguments in closing:
        close(*arguments)


def draw_all(touched, level=3):
    """Everything is drawn, or less; however slow this machine is, whose pictures are not counted from now on."""
    touched.see(f"palpate.appearance.look = 'tissue', palpate.appearance.affordable = {level}")
    touched.see("(palpate.appearance.count = () => undefined, null)")
    sharp(touched)


def sharp(touched):
    """Until the picture is drawn, at its full resolution where the organ is still."""
    touched.page.wait_for_timeout(450)
    touched.still()


def set_amount(touched, share):
    """Moves the slider of the depth to that share of its range."""
    touched.see(f"(amount.value = {share} * amount.max, amount.dispatchEvent(new Event('input', {{ bubbles: true }})))")


def node_colours(touched):
    """Pixels of the shown nodes, and their colours in a picture of now, linear: (nodes, 2), (nodes, 3) 0..1."""
    box = touched.page.locator("#view").bounding_box()
    pixels = np.array(touched.see("[...Array(palpate.scene.nodes).keys()].map((node) => palpate.nodePixel(node))"))
    picture = touched.pixels("#view")
    x, y = np.clip((pixels - (box["x"], box["y"])).round().astype(int), 0, np.array(picture.shape[1::-1]) - 1).T
    return pixels, (picture[y, x] / 255) ** 2.2


def facing(touched, least=0.35):
    """Nodes at rest that look at the first view, which is from the front, half a radian to the side and 0.42 above."""
    back = view_directions()[2]
    return np.flatnonzero(normals(touched) @ back > least)


def view_directions(yaw=-0.5, pitch=0.42):
    """To the right, up, and back to the eye, unit vectors."""
    right = np.array((np.cos(yaw), np.sin(yaw), 0))
    back = np.array((np.sin(yaw) * np.cos(pitch), -np.cos(yaw) * np.cos(pitch), np.sin(pitch)))
    return right, np.cross(back, right), back


def normals(touched):
    """Of the nodes at rest, unit vectors: of the triangles around, by their areas."""
    drawn = touched.session.displayed
    part = next(part for part in drawn.parts if not part.inside)
    triangles = drawn.triangles[part.first : part.first + part.count]
    a, b, c = (drawn.places[triangles[:, k]] for k in range(3))
    sums = np.zeros_like(drawn.places, dtype=float)
    for k in range(3):
        np.add.at(sums, triangles[:, k], np.cross(b - a, c - a))
    return sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12)


def test_the_plain_look_is_gouraud_shading_in_one_colour(opened, album):
    """Lambert's law, a light of the sky and a faint highlight, at the nodes, written anew here; the look is remembered."""
    touched = opened()
    touched.page.keyboard.press("a")
    sharp(touched)
    assert touched.page.get_attribute("#shading [data-value=plain]", "aria-pressed") == "true"
    nodes, (right, up, back) = facing(touched), view_directions()
    _, colours = node_colours(touched)
    light = (-0.5 * right + 0.8 * up + back) / np.sqrt(0.25 + 0.64 + 1)
    halfway = (light + back) / np.linalg.norm(light + back)
    n = normals(touched)[nodes]
    lambert, gloss = np.maximum(n @ light, 0)[:, None], np.maximum(n @ halfway, 0)[:, None] ** 16
    sky = np.array((0.3, 0.302, 0.324)) + n[:, 2:] * np.array((0.18, 0.178, 0.156))
    expected = np.array((143, 51, 43)) / 255 * (sky + 0.73 * lambert) + 0.07 * gloss
    assert len(nodes) > 100
    assert (np.median(np.abs(colours[nodes] - expected), axis=0) < 0.008).all()
    touched.page.screenshot(path=album / "look-plain.png")
    touched.page.reload()
    touched.wait("Boolean(window.palpate && palpate.frame)")
    sharp(touched)
    _, again = node_colours(touched)
    assert np.median(np.abs(again[nodes] - expected)) < 0.012, "a page that is opened again looks plain"
    touched.page.click("#shading >> text=Tissue")
    sharp(touched)
    _, tissue = node_colours(touched)
    assert np.median(np.abs(tissue[nodes] - expected)) > 0.05
    touched.page.click("#color-mode >> text=Moved")
    sharp(touched)
    assert touched.see("palpate.appearance.level") == 0, "colors that mean something are drawn plainly"
    assert touched.problems == []


def test_the_name_of_an_organ_chooses_its_tissue(opened, album):
    """Fat is yellow, a kidney red, bone pale; one whose name says nothing has the plain color."""
    hue = {}
    parts = []
    for i, name in enumerate(("kidney_left", "perirenal_fat", "thing", "vertebrae_L1 bone")):
        made = brick((3, 3, 4), (20, 20, 30))
        mesh = pp.TetMesh(made.nodes + (21 * i, 0, 0), made.tets, made.region, {1: name})
        parts.append(pp.Tissue(mesh, 5.0, 0.4, mesh.nodes[:, 2] == 0))
    touched = opened(model=pp.model(pp.join_tissues(parts), "compliance"))
    touched.page.screenshot(path=album / "look-organs.png")
    nodes = facing(touched, 0.6)
    _, colours = node_colours(touched)
    for i, name in enumerate(("kidney", "fat", "unknown", "bone")):
        mine = nodes[touched.session.displayed.organ[nodes] == i]
        hue[name] = np.median(colours[mine], axis=0)
    red, green, blue = 0, 1, 2
    assert hue["kidney"][red] > 3 * hue["kidney"][green]
    assert hue["fat"][green] > 0.5 * hue["fat"][red]
    assert hue["fat"][green] > 1.8 * hue["fat"][blue]
    assert hue["bone"].min() > 0.55 * hue["bone"].max()
    assert hue["bone"].sum() > 2 * hue["kidney"].sum()


def grain(touched):
    """Of each node: by how much grain changes its brightness."""
    draw_all(touched, 3)
    _, grained = node_colours(touched)
    draw_all(touched, 2)
    _, smooth = node_colours(touched)
    return (grained[:, 0] - smooth[:, 0]) / np.maximum(smooth[:, 0], 0.02)


def test_the_grain_moves_with_the_tissue(opened):
    """A pulled organ carries its grain along, though its nodes are elsewhere by more than a bump."""
    touched = opened("pancreas")  # as coarse as any
    nodes, before = facing(touched), grain(touched)
    assert np.std(before[nodes]) > 0.05
    touched.page.keyboard.press("2")
    touched.drag(touched.place(), np.array((110, -70)))
    touched.settle()
    drawn = np.array(touched.see("palpate.frame.displacement.slice(0, 3)"))
    assert np.linalg.norm(drawn) > 5
    point = touched.tool()[0]
    near = nodes[np.linalg.norm(touched.session.displayed.places[nodes] - point, axis=1) < 16]
    apart = np.linalg.norm(touched.session.displayed.places[near] - point, axis=1) > 5  # the probe hides those
    after = grain(touched)
    assert apart.sum() > 12
    assert np.corrcoef(before[near[apart]], after[near[apart]])[0, 1] > 0.6
    touched.page.mouse.up()


def test_a_tool_casts_a_shadow_and_pressed_tissue_pales_there_and_nowhere_else(opened, album):
    """A light touch moves the tissue little, so what darkens is shadow. A strong one takes red from the tissue."""
    touched = opened()
    draw_all(touched, 2)
    nodes, places = facing(touched), touched.session.displayed.places
    pixels, before = node_colours(touched)
    set_amount(touched, 0.08)
    touched.drag(touched.place(), np.array((2, 0)), 2)
    touched.settle()
    draw_all(touched, 2)
    point, displacement, *_ = touched.tool()
    assert np.linalg.norm(displacement) < 1.5
    _, after = node_colours(touched)
    touched.page.screenshot(path=album / "look-shadow.png")
    away = np.linalg.norm(places[nodes] - point, axis=1)
    beside = pixels[nodes, 1] > touched.see(f"palpate.pixel({point.tolist()})")[1] + 6  # the finger comes from above
    ratio = after[nodes].sum(axis=1) / before[nodes].sum(axis=1)
    near, far = ratio[(away < 8) & beside], ratio[(away > 20) & beside]
    assert len(near) >= 3
    assert len(far) > 20
    assert np.median(near) < 0.93
    assert abs(np.median(far) - 1) < 0.03
    set_amount(touched, 0.6)
    touched.settle()
    draw_all(touched, 2)
    _, pressed = node_colours(touched)
    paleness = (pressed[nodes, 1] / pressed[nodes, 0]) / (before[nodes, 1] / before[nodes, 0])
    assert np.median(paleness[(away < 9) & beside]) > 1.1
    assert np.median(paleness[(away > 22) & beside]) == pytest.approx(1, abs=0.05)
    touched.page.mouse.up()


def skin(picture):
    """Pixels in the color of a finger."""
    r, g, b = picture.transpose(2, 0, 1)
    return (r > 1.15 * g) & (r < 1.8 * g) & (g > 1.05 * b) & (r > 90)


def test_a_finger_presses_and_is_seen_through_what_hides_it(opened, album):
    touched = opened("kidney")
    assert skin(touched.pixels("#view")[150:650, 150:800]).sum() < 50
    touched.drag(touched.place(), np.array((4, 0)), 3)
    touched.settle()
    touched.page.screenshot(path=album / "look-press.png")
    assert skin(touched.pixels("#view")[150:650, 150:800]).sum() > 1500, "the finger"
    set_amount(touched, 0.08)  # a light touch changes the tissue little
    touched.settle()
    touched.page.focus("#view")
    for _ in range(33):  # half a turn: the organ hides its tip
        touched.page.keyboard.press("Shift+ArrowRight")
    sharp(touched)
    touched.page.screenshot(path=album / "look-behind.png")
    point, displacement, *_ = touched.tool()
    x, y = np.array(touched.see(f"palpate.pixel({(point + displacement).tolist()})")).astype(int)
    held = touched.pixels("#view")[y - 6 : y + 2, x - 4 : x + 4]
    touched.page.mouse.up()
    touched.until_home()
    sharp(touched)
    free = touched.pixels("#view")[y - 6 : y + 2, x - 4 : x + 4]
    assert (free[..., 0] > 1.5 * free[..., 2]).all(), "there the organ is"
    assert np.median(held[..., 1] - free[..., 1]) > 10


def test_a_cut_bleeds(opened, album):
    touched = opened("fat")  # yellow: blood is seen best
    touched.page.click("#cut-tool")

    def bloody():
        r, g, _ = touched.pixels("#view")[150:650, 150:800].transpose(2, 0, 1)
        return np.count_nonzero((r > 40) & (r > 2.2 * g))

    assert bloody() < 30
    start, way = touched.place(0.36, 0.42), np.array((260, 0))
    touched.page.mouse.move(*start)
    touched.page.mouse.down()
    for i in range(1, 41):
        touched.page.mouse.move(*(start + way * i / 40))
        touched.page.wait_for_timeout(20)
    touched.page.screenshot(path=album / "look-scalpel.png")
    touched.page.mouse.up()
    until(lambda: touched.live.cutting.stroke is None and touched.session.bodies > 0)
    touched.wait(f"palpate.frame.body === {touched.session.bodies}")
    draw_all(touched)
    touched.page.screenshot(path=album / "look-cut.png")
    assert bloody() > 2000
    touched.page.keyboard.press("z")
    until(lambda: touched.session.cuts == 0)
    touched.wait(f"palpate.frame.body === {touched.session.bodies}")
    until(lambda: bloody() < 30)


def pictures(touched, interval):
    """As many pictures as are counted before a step, `interval` ms each."""
    touched.see(f"(() => {{ for (let i = 0; i < 54; i++) palpate.appearance.count(1e7 + {interval} * i, true); }})()")


def test_a_slow_machine_draws_less_and_says_so_once(opened):
    touched = opened()
    touched.see("(delete palpate.appearance.count, palpate.appearance.look = 'tissue')")
    assert touched.see("palpate.appearance.level") == 3
    pictures(touched, 20)
    assert touched.see("palpate.appearance.level") == 3, "fast enough"
    said = "hints.filter((hint) => hint.includes('draws slowly')).length"
    for level in (2, 1, 0, 0):
        touched.see("(palpate.appearance.spent = [], document.getElementById('hint').textContent = '')")
        pictures(touched, 45)
        assert touched.see("palpate.appearance.level") == level
    touched.until_told("draws slowly")
    assert touched.see(said) == 1
    sharp(touched)
    assert touched.see("palpate.appearance.look") == "tissue", "what was chosen stays chosen"
    assert touched.problems == []


@pytest.mark.parametrize(
    ("viewport", "scheme"), [(LAPTOP, "dark"), (PHONE, "dark"), ({"width": 844, "height": 390}, "light")]
)
def test_it_looks_well_in_light_and_dark_and_on_a_phone(opened, album, viewport, scheme):
    touched = opened(viewport=viewport, scheme=scheme)
    touched.page.screenshot(path=album / f"look-{viewport['width']}-{scheme}.png")
    red = touched.pixels("#view")
    assert (red[..., 0] > red[..., 2] + 30).mean() > 0.03
    if viewport["width"] < 760:
        touched.page.click("#more")
        touched.page.screenshot(path=album / f"look-{viewport['width']}-{scheme}-more.png")
    assert Axe().run(touched.page).violations_count == 0
    assert touched.problems == []
