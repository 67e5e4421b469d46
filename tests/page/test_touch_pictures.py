"""Pictures and videos that the page saves, and its way back to the beginning; in a real Chromium."""

import io
import math

import numpy as np
import pytest
from skimage.io import imread
from support.example_organs import organ
from support.touch_page import served_pages

import palpate as pp

pytestmark = pytest.mark.browser

NO_VIDEO = "delete window.MediaRecorder"


@pytest.fixture
def opened(browser):
    with served_pages(browser) as open_page:
        yield lambda script=None: open_page(
            pp.Session(pp.model(organ(), "springs"), radius=8.0, sweeps=4), "Test <organ>", script=script
        )


def saved(page, action):
    with page.page.expect_download() as download:
        action()
    with open(download.value.path(), "rb") as file:
        return download.value.suggested_filename, file.read()


def test_a_picture_holds_what_is_shown_with_scale_legend_and_time(opened, album):
    page = opened()
    page.page.click("#color-mode >> text=Moved")
    page.drag(page.place(), np.array((5, 5)))
    page.settle()
    name, data = saved(page, lambda: page.page.keyboard.press("t"))
    assert name == "Test_organ_.png"
    (album / "picture.png").write_bytes(data)
    picture = imread(io.BytesIO(data))[..., :3].astype(float)
    shown = page.pixels("#view")
    assert picture.shape == (shown.shape[0] + 30, shown.shape[1], 3)
    middle = np.s_[150:650, 250:750]  # no text of the page lies there
    assert (np.abs(picture[middle] - shown[middle]).max(axis=2) > 40).mean() < 0.02
    strip, line = picture[-30:], (picture[-45, :154] < 100).all(axis=1)  # the scale's, above the text
    right = np.array((math.cos(-0.5), math.sin(-0.5), 0))  # of the first view
    ends = [page.see(f"palpate.pixel({(side * 10 * right).tolist()})") for side in (-1, 1)]
    assert line.sum() == pytest.approx(math.dist(*ends), abs=2)  # 20 mm in the middle of the organ
    yellow = (strip[..., 0] > 200) & (strip[..., 1] > 200) & (strip[..., 2] < 90)
    assert yellow[:, -200:].sum() > 10  # the legend's bright end
    page.page.mouse.up()


def test_a_video_of_the_canvas_is_saved_as_webm(opened):
    page = opened()
    page.page.click("#video")
    page.wait("document.getElementById('video').textContent === 'Stop video'")
    page.drag(page.place(), np.array((20, 5)))
    page.page.wait_for_timeout(1200)
    page.page.mouse.up()
    name, data = saved(page, lambda: page.page.click("#video"))
    assert name == "Test_organ_.webm"
    assert data[:4] == b"\x1a\x45\xdf\xa3"  # EBML
    assert b"webm" in data[:64]
    assert len(data) > 5000
    assert page.page.inner_text("#video") == "Record video"


def test_where_the_browser_has_no_recorder_the_page_says_so(opened):
    page = opened(NO_VIDEO)
    assert not page.page.locator("#video").is_visible()
    assert page.page.inner_text("#video-missing") == "This browser cannot record a video."
    page.page.keyboard.press("v")
    page.until_told("cannot record")


def test_reset_brings_back_view_tools_and_colors(opened):
    page = opened()
    state = """[palpate.nodePixel(0), document.getElementById('amount').value,
        [...document.querySelectorAll('#controls [aria-pressed=true]')].map((b) => b.textContent)]"""
    before = page.see(state)
    for key in ("3", "+", "+", "w", "i", "c", "n"):
        page.page.keyboard.press(key)
    page.drag(page.place(0.04, 0.9), np.array((120, 0)))
    page.page.mouse.up()
    page.page.keyboard.press("4")
    page.page.mouse.click(*page.place())
    page.wait("palpate.frame.contact[3] === 1")
    assert page.see(state)[2] != before[2]
    page.page.keyboard.press("0")
    page.until_home()
    after = page.see(state)
    assert after[1:] == before[1:]
    np.testing.assert_allclose(after[0], before[0], atol=1)
