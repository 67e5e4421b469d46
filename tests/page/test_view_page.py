"""`palpate view` in a real Chromium: what is drawn, read out, linked, sampled and saved."""

import io
from contextlib import ExitStack

import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from skimage.io import imread
from support.browser import LAPTOP, PHONE, Seen

import palpate as pp
from palpate.server.loopback_server import loopback_socket
from palpate.server.view import image_payloads, serving_images

pytestmark = pytest.mark.browser

SPACING = (2.5, 1.5, 1.0)
RAS = np.diag([-1.0, -1.0, 1.0])  # stored from left to right and from back to front: the page must turn both
MARK = (17, 7, 8)  # (z, y, x) in the array: superior, posterior (y grows towards the front), left
WATER = 0.02


def head():
    """HU on 24 x 30 x 40 voxels, each value its own, with one bright block that is off every middle."""
    rng = np.random.default_rng(4)
    values = np.round(rng.uniform(-300, 300, (24, 30, 40)))
    z, y, x = MARK
    values[z - 1 : z + 2, y - 1 : y + 2, x - 1 : x + 2] = 3000
    values[z, y, x] = 3001
    return pp.Volume(values, pp.Grid(values.shape, SPACING, (30, 20, -10), RAS), "HU")


def other():
    """Another volume of the same place on another grid."""
    values = np.random.default_rng(5).uniform(-300, 300, (30, 20, 20)).round()
    return pp.Volume(values, pp.Grid(values.shape, (2, 2.25, 2), (-9, -23, -10)), "HU")


def flat():
    """Attenuation in the frame of a reconstruction."""
    return pp.Volume(np.full((4, 5, 6), 0.025), pp.Grid((4, 5, 6), (1, 1, 1)))


def scan():
    """Five views of which one pixel was not measured."""
    counts = np.random.default_rng(6).poisson(400, (5, 12, 16)).astype(float)
    mask = np.ones(counts.shape, dtype=bool)
    mask[2, 3, 4] = False
    panel = pp.Panel((12, 16), (0.5, 0.4), (-3, -3, 0))
    source = np.stack([np.linspace(-50, 50, 5), np.zeros(5), np.full(5, 300.0)], axis=1)
    return pp.Scan(counts, 1000, pp.Views(source, panel), background=20, mask=mask)


class Viewed(Seen):
    """The page, and what it shows."""

    def open(self, address):
        self.page.goto(address)
        self.wait("Boolean(window.viewer && viewer.ready)")

    def drawn(self):
        self.wait("viewer.ready")

    def canvas(self, plane, side=0):
        return self.page.locator(f'.pane[data-plane="{plane}"][data-side="{side}"] canvas')

    def press(self, *keys):
        for key in keys:
            self.page.keyboard.press(key)
        self.drawn()

    def text(self, name):
        return self.page.locator(f"#{name}").inner_text().replace("−", "-")

    def voxel(self):
        return tuple(int(i) for i in self.text("voxel").removeprefix("voxel [").removesuffix("]").split(","))

    def number(self, name="value"):
        return float(self.text(name).split()[-2])

    def to(self, plane, spot, side=0, button="left"):
        """Clicks at a spot of a pane, in CSS pixels from its corner."""
        self.canvas(plane, side).click(position={"x": spot[0], "y": spot[1]}, button=button)
        self.drawn()

    def grey(self, plane, spot, side=0):
        """The grey drawn at a spot."""
        picture = imread(io.BytesIO(self.canvas(plane, side).screenshot()))[..., :3].astype(float)
        return picture[int(spot[1]), int(spot[0])]


@pytest.fixture(scope="module")
def pages(browser):
    """Pages that are open already, by what they show: starting one is most of a test's time."""
    found = {}
    with ExitStack() as stack:

        def page(makers, water, view, scheme):
            key = (makers, water, view is PHONE, scheme)
            if key not in found:
                things = image_payloads([make() for make in makers], ("A", "B"), water)
                address = stack.enter_context(serving_images(things, loopback_socket(None)))
                how = {"viewport": view, "has_touch": view is PHONE, "is_mobile": view is PHONE}
                context = browser.new_context(color_scheme=scheme, **how)
                stack.callback(context.close)
                found[key] = Viewed(context.new_page()), address
            return found[key]

        yield page


@pytest.fixture
def opened(pages):
    """Opens what the functions given make, anew; nothing may have gone wrong in the page by the end."""
    used = []

    def open_page(*makers, water=None, view=LAPTOP, scheme="light"):
        viewed, address = pages(makers, water, view, scheme)
        viewed.open(address)
        used.append(viewed)
        return viewed

    yield open_page
    for viewed in used:
        assert viewed.problems == []


def spot_of(viewed, plane, voxel, shape=(24, 30, 40)):
    """Where radiologists expect a voxel of `head()`, found from the pane's size alone: the volume fits, centred.

    The patient's right is on the left; front above, and in the other planes the head.
    """
    box = viewed.canvas(plane).bounding_box()
    z, y, x = voxel
    size = np.array(shape) * SPACING
    # mm from the middle towards left, posterior, superior; the array runs from left to right and from back to front
    left = -(x - (shape[2] - 1) / 2) * SPACING[2]
    back = -(y - (shape[1] - 1) / 2) * SPACING[1]
    above = (z - (shape[0] - 1) / 2) * SPACING[0]
    across, down, wide, high = {
        "axial": (left, back, size[2], size[1]),
        "coronal": (left, -above, size[2], size[0]),
        "sagittal": (back, -above, size[1], size[0]),
    }[plane]
    scale = max(wide / box["width"], high / box["height"])
    return np.array([box["width"] / 2 + across / scale, box["height"] / 2 + down / scale])


def test_a_marked_voxel_is_bright_where_radiologists_expect_it(opened):
    viewed = opened(head)
    viewed.to("axial", spot_of(viewed, "axial", MARK))
    viewed.to("coronal", spot_of(viewed, "coronal", MARK))
    viewed.press("x")  # the crosshair off
    viewed.page.select_option("#preset", "Full")
    viewed.drawn()
    for plane, ends in (
        ("axial", "R left, L right, A above, P below"),
        ("coronal", "R left, L right, S above, I below"),
        ("sagittal", "A left, P right, S above, I below"),
    ):
        picture = imread(io.BytesIO(viewed.canvas(plane).screenshot()))[..., 0].astype(float)
        picture[:45], picture[-45:], picture[:, :25], picture[:, -25:] = 0, 0, 0, 0  # letters and scale
        bright = np.argwhere(picture > 200).mean(axis=0)[::-1]
        np.testing.assert_allclose(bright, spot_of(viewed, plane, MARK), atol=2)
        assert ends in viewed.canvas(plane).get_attribute("aria-label")


def test_crosshair_goes_where_one_clicks_and_reads_the_voxel(opened):
    volume = head()
    viewed = opened(head, water=WATER)
    for plane, voxel in (("axial", (12, 20, 30)), ("coronal", (4, 20, 9)), ("sagittal", (20, 11, 9))):
        viewed.to(plane, spot_of(viewed, plane, voxel))
        assert viewed.voxel() == voxel
        assert viewed.number() == volume.values[voxel]
        place = [float(part.split()[-2]) for part in viewed.text("place").split(", ")]
        np.testing.assert_allclose(place, volume.grid.points(voxel)[0], atol=0.06)
        expected = WATER * (1 + volume.values[voxel] / 1000)
        assert viewed.number("converted") == pytest.approx(expected, rel=1e-3)


def test_attenuation_is_read_in_hounsfield_units_too_once_water_is_known(opened):
    viewed = opened(flat, water=WATER)
    assert viewed.text("value") == "0.025 1/mm"
    assert viewed.text("converted") == "250 HU"
    assert "-x left, +x right" in viewed.canvas("axial").get_attribute("aria-label").replace("−", "-")
    assert "not known" in viewed.text("note")


def test_every_move_can_be_made_by_key(opened):
    volume = head()
    viewed = opened(head)
    start = np.array(viewed.voxel())
    viewed.canvas("axial").focus()
    for keys, by in (
        (["ArrowRight"], (0, 0, -1)),  # to the patient's left, where the array's x falls
        (["ArrowDown", "ArrowDown"], (0, -2, 0)),
        (["PageUp"], (1, 0, 0)),
        (["Shift+PageDown"], (-10, 0, 0)),
        (["ArrowUp", "ArrowLeft"], (0, 1, 1)),
    ):
        viewed.press(*keys)
        start = start + by
        assert viewed.voxel() == tuple(start)
        assert viewed.number() == volume.values[tuple(start)]
    viewed.canvas("coronal").focus()
    viewed.press("ArrowUp")
    assert viewed.voxel() == tuple(start + (1, 0, 0))
    viewed.press("Home")
    assert viewed.voxel()[1] == volume.grid.shape[1] - 1  # the front is the array's end
    viewed.press("2")
    assert viewed.page.locator(".pane").count() == 1
    viewed.press("5")
    assert viewed.page.locator(".pane").count() == 4
    viewed.page.keyboard.press("?")
    assert viewed.page.locator("#help").is_visible()
    assert viewed.page.locator("#help tr").count() > 15
    viewed.page.keyboard.press("Escape")
    assert not viewed.page.locator("#help").is_visible()


def test_grey_follows_the_window(opened):
    volume = head()
    viewed = opened(head)
    voxel = (12, 20, 30)
    viewed.to("axial", spot_of(viewed, "axial", voxel))
    viewed.press("x", "n")  # no crosshair, voxels as squares
    spot, value = spot_of(viewed, "axial", voxel), float(volume.values[voxel])

    def expected(low, high):
        return np.clip(255 * (value - low) / (high - low), 0, 255)

    for name, low, high in (
        ("Soft tissue", -160, 240),
        ("Bone", -500, 1300),
        ("Full", volume.values.min(), volume.values.max()),
    ):
        viewed.page.select_option("#preset", name)
        viewed.drawn()
        np.testing.assert_allclose(viewed.grey("axial", spot), expected(low, high), atol=1.01)
    viewed.page.fill("#low", "-400")
    viewed.page.fill("#high", "500")
    viewed.page.keyboard.press("Tab")
    viewed.drawn()
    np.testing.assert_allclose(viewed.grey("axial", spot), expected(-400, 500), atol=1.01)
    viewed.press("i")
    np.testing.assert_allclose(viewed.grey("axial", spot), 255 - expected(-400, 500), atol=1.01)
    before = viewed.see("viewer.state.side.high - viewer.state.side.low")
    viewed.press("[")
    assert viewed.see("viewer.state.side.high - viewer.state.side.low") == pytest.approx(1.1 * before)


def test_a_slab_shows_mean_and_maximum_of_its_slices(opened):
    volume = head()
    viewed = opened(head)
    z, y, x = voxel = (12, 20, 30)
    viewed.to("axial", spot_of(viewed, "axial", voxel))
    viewed.page.locator("#thick").fill("13")  # five slices of 2.5 mm, the middle one here
    viewed.drawn()
    slices = volume.values[z - 2 : z + 3, y, x]
    assert viewed.number("slab-value") == pytest.approx(slices.mean(), abs=0.51)
    viewed.press("x", "n")
    low, high = (viewed.see(f"viewer.state.side.{end}") for end in ("low", "high"))
    shown = np.clip(255 * (slices.mean() - low) / (high - low), 0, 255)
    np.testing.assert_allclose(viewed.grey("axial", spot_of(viewed, "axial", voxel)), shown, atol=1.01)
    viewed.page.click("#mode >> text=Max")
    viewed.drawn()
    assert viewed.number("slab-value") == slices.max()
    viewed.canvas("sagittal").focus()  # 13 mm are 13 slices of 1 mm there
    viewed.drawn()
    assert viewed.number("slab-value") == volume.values[z, y, x - 6 : x + 7].max()


def test_two_volumes_are_linked_in_place_zoom_and_window(opened):
    one, two = head(), other()
    viewed = opened(head, other)
    viewed.press("1")
    assert viewed.page.locator(".pane").count() == 2
    box = viewed.canvas("axial", 0).bounding_box()
    viewed.to("axial", (0.4 * box["width"], 0.55 * box["height"]), 0)
    voxel = viewed.voxel()
    point = one.grid.points(voxel)[0]
    there = tuple(np.rint(two.grid.indices(point)[0]).astype(int))
    assert viewed.number("value-0") == one.values[voxel]
    assert viewed.number("value-1") == two.values[there]
    assert viewed.number("difference") == two.values[there] - one.values[voxel]
    viewed.press("w", "+")
    sides = viewed.see("viewer.state.sides.map((s) => [s.low, s.high, s.zoom.axial, ...s.crosshair])")
    assert sides[0] == sides[1]
    spots = [viewed.see(f"viewer.pixel({i}, 'axial', viewer.state.sides[0].crosshair)") for i in (0, 1)]
    middles = [viewed.see(f"viewer.pixel({i}, 'axial', viewer.state.sides[{i}].center.axial)") for i in (0, 1)]
    viewed.press("+")
    again = [viewed.see(f"viewer.pixel({i}, 'axial', viewer.state.sides[0].crosshair)") for i in (0, 1)]
    for spot, middle, later in zip(spots, middles, again, strict=True):  # 1.25 times as far from the middle, in both
        np.testing.assert_allclose(np.subtract(later, middle), 1.25 * np.subtract(spot, middle), atol=1e-6)
    viewed.press("l")
    viewed.press("ArrowRight")
    assert viewed.see("viewer.state.sides[0].crosshair[0] !== viewer.state.sides[1].crosshair[0]")


def test_profile_is_linear_between_voxels(opened):
    volume = head()
    viewed = opened(head)
    a, b = (12, 24, 33), (12, 6, 8)
    viewed.to("axial", spot_of(viewed, "axial", a))
    viewed.page.click("#tool >> text=Profile")
    box = viewed.canvas("axial").bounding_box()
    start, end = (spot_of(viewed, "axial", v) + (box["x"], box["y"]) for v in (a, b))
    viewed.page.mouse.move(*start)
    viewed.page.mouse.down()
    viewed.page.mouse.move(*end, steps=4)
    viewed.page.mouse.up()
    viewed.drawn()
    compare_profile(viewed, volume, a, b, atol=0.6)
    viewed.press("Escape")
    assert not viewed.page.locator("#profile").is_visible()
    viewed.press("Enter", *["ArrowRight"] * 5, "ArrowUp", "Enter")  # the same by keys, exactly from voxel to voxel
    compare_profile(viewed, volume, a, (12, 25, 28), atol=1e-6)
    with viewed.page.expect_download() as download:
        viewed.page.click("text=Save values")
    table = np.genfromtxt(download.value.path(), delimiter=",", skip_header=1)
    profile = viewed.see("viewer.profile()")
    np.testing.assert_allclose(table, np.stack([profile["distance"], profile["lines"][0]["values"]], axis=1))


def compare_profile(viewed, volume, a, b, atol):
    """The page's profile against SciPy's interpolation of the array, and against distances in mm."""
    profile = viewed.see("viewer.profile()")
    long = np.linalg.norm(volume.grid.points(b) - volume.grid.points(a))
    distance = np.array(profile["distance"])
    assert distance[-1] == pytest.approx(long, abs=atol)
    assert len(distance) >= 2 * long / min(SPACING)
    ends = viewed.see("[viewer.state.profile.start, viewer.state.profile.end]")
    np.testing.assert_allclose(ends, volume.grid.points([a, b]), atol=atol)
    points = np.array(ends[0]) + np.linspace(0, 1, len(distance))[:, None] * (np.array(ends[1]) - ends[0])
    expected = map_coordinates(volume.values.astype(float), volume.grid.indices(points).T, order=1, mode="nearest")
    np.testing.assert_allclose(profile["lines"][0]["values"], expected, atol=1e-3)


def test_saved_picture_is_what_is_shown(opened, album):
    viewed = opened(head)
    viewed.page.screenshot(path=album / "view-volume.png")
    with viewed.page.expect_download() as download:
        viewed.press("s")
    assert download.value.suggested_filename == "A.png"
    saved = imread(download.value.path())[..., :3].astype(float)
    box = viewed.page.locator("#slices").bounding_box()
    assert saved.shape[0] == pytest.approx(box["height"] + 26, abs=1)
    assert saved.shape[1] == pytest.approx(box["width"], abs=1)
    shown = viewed.pixels('.pane[data-plane="axial"] canvas')
    rows, columns = shown.shape[0] - 4, shown.shape[1] - 4
    assert np.abs(saved[2:rows, 2:columns] - shown[2:rows, 2:columns]).mean() < 2
    assert shown.std() > 30


def test_rendering_is_fetched_only_when_asked_for(opened):
    viewed = opened(head)
    fetched = []
    viewed.page.on("request", lambda request: fetched.append(request.url))
    viewed.press("w")
    assert not fetched
    viewed.page.click("text=Render in 3D")
    viewed.wait("viewer.rendered")
    assert any("/static/view-" in url for url in fetched)
    assert (viewed.still(".render canvas").max(axis=2) > 30).mean() > 0.02


def test_projections_step_and_play(opened, album):
    measured = scan()
    viewed = opened(scan)
    lines = np.log(1000 / np.maximum(measured.counts - 20, 0.5))
    assert "row 6, column 8" in viewed.text("place")
    assert float(viewed.text("value")) == pytest.approx(lines[2, 6, 8], rel=1e-3)
    viewed.press("PageUp")
    assert float(viewed.text("value")) == pytest.approx(lines[3, 6, 8], rel=1e-3)
    viewed.page.click("#stack >> text=Counts")
    viewed.wait("viewer.ready && viewer.state.side.source.stack.name === 'counts'")
    assert viewed.text("value") == f"{measured.counts[3, 6, 8]:.0f} photons"
    viewed.press("PageDown", *["ArrowUp"] * 3, *["ArrowLeft"] * 4)
    assert viewed.text("value") == "not measured"
    viewed.press("x", "n")
    box = viewed.canvas("axial").bounding_box()
    scale = max(16 * 0.4 / box["width"], 12 * 0.5 / box["height"])
    spot = (box["width"] / 2 + (4 - 7.5) * 0.4 / scale, box["height"] / 2 + (3 - 5.5) * 0.5 / scale)
    assert np.ptp(viewed.grey("axial", spot)) > 20  # no grey: no value
    viewed.page.screenshot(path=album / "view-scan.png")
    viewed.canvas("axial").focus()
    viewed.press(" ")
    seen = set()
    for _ in range(200):
        seen.add(viewed.see("viewer.state.slice(viewer.state.side, 'axial')"))
        if len(seen) == 5:
            break
        viewed.page.wait_for_timeout(20)
    assert seen == {0, 1, 2, 3, 4}
    assert viewed.text("play") == "Pause"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_fits_a_phone_and_two_fingers_zoom(opened, album, scheme):
    viewed = opened(head, view=PHONE, scheme=scheme)
    assert viewed.see("document.documentElement.scrollWidth") == PHONE["width"]
    for button in viewed.page.locator("#panel button:visible").all():
        assert button.bounding_box()["height"] >= 32  # a fingertip
    box = viewed.canvas("axial").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    finger = viewed.page.context.new_cdp_session(viewed.page)

    def touch(kind, *points):
        spots = [{"x": px, "y": py, "id": i} for i, (px, py) in enumerate(points)]
        finger.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": spots})

    touch("touchStart", (x - 20, y))
    touch("touchStart", (x - 20, y), (x + 20, y))
    touch("touchMove", (x - 60, y), (x + 60, y))
    touch("touchEnd")
    viewed.drawn()
    assert viewed.see("viewer.state.side.zoom.axial") == pytest.approx(3, rel=0.05)
    viewed.page.screenshot(path=album / f"view-phone-{scheme}.png")


def test_the_token_is_not_left_in_the_address_and_the_page_can_be_loaded_again(browser):
    context = browser.new_context(viewport=LAPTOP)
    with serving_images(image_payloads([flat()], ["A"]), loopback_socket(None)) as address:
        viewed = Viewed(context.new_page())
        viewed.open(address)
        for _ in range(2):
            assert viewed.page.url == address.split("?")[0]
            viewed.page.reload()
            viewed.wait("Boolean(window.viewer && viewer.ready)")
    context.close()
