"""Notes in a real Chromium: written, kept with the record, shown in a replay; as text, whatever they say."""

import csv
from collections import deque

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from support.browser import LAPTOP, PHONE
from support.example_organs import organ
from support.touch_page import Touched
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

import palpate as pp
from palpate.server.live_session import LiveSession
from palpate.server.loopback_server import loopback_socket
from palpate.server.messages import Note, encode
from palpate.server.touch import running_session, write_records
from palpate.simulation.pointer import Pointer
from palpate.simulation.replay import Replay

pytestmark = pytest.mark.browser

NASTY = '<img src=x onerror=alert(1)> \u202eevil & "q"'
CLEAN = '<img src=x onerror=alert(1)> evil & "q"'


@pytest.fixture
def opened(browser):
    """Gives a page of a session that is recorded, or of a replay."""
    closing, pages = [], []

    def open_page(viewport=LAPTOP, scheme="light", record=None, replay=None):
        session = pp.Session(pp.model(organ(), "springs"), radius=8.0, sweeps=4)
        live = LiveSession(session, Pointer() if replay is None else Replay(replay), record=record)
        served = running_session(live, loopback_socket(None))
        touch = viewport is not LAPTOP
        context = browser.new_context(viewport=viewport, color_scheme=scheme, has_touch=touch, is_mobile=touch)
        page = Touched(session, context.new_page())
        closing.extend([context.close, lambda: served.__exit__(None, None, None)])
        pages.append(page)
        page.address = served.__enter__()
        page.open(page.address)
        return page

    yield open_page
    for close in closing:
        close()
    for page in pages:
        assert page.problems == []


def click(page, point):
    page.page.mouse.click(*page.see(f"palpate.pixel({list(point)})"))


def other_frames(socket):
    """What a socket sends, until it is closed."""
    while True:
        yield socket.recv(timeout=30)


def texts(page):
    return [[line for line in row.splitlines() if line] for row in page.page.locator("#note-list li").all_inner_texts()]


def until_noted(page, count):
    page.wait(f"document.querySelectorAll('#note-list li').length === {count}")


def test_a_note_is_kept_with_the_record_and_shown_in_its_replay(opened, album, tmp_path):
    path = tmp_path / "session.h5"
    page = opened(record=path)
    page.page.keyboard.press("6")
    page.page.click("#note-kind")
    place = (-16.0, -12.0, 18.0)
    click(page, place)
    assert page.page.inner_text("#note-where") == "Kept with the record of the session."
    page.page.keyboard.type(f"{NASTY} rwc 12")  # letters that are keys elsewhere
    page.page.keyboard.press("Enter")
    until_noted(page, 1)
    assert f"{CLEAN} rwc 12" in texts(page)[0]
    assert page.see("document.querySelector('#color-mode [aria-pressed=true]').dataset.value") == "plain"
    page.page.click("#measure-kind >> text=Distance")
    click(page, place)
    click(page, (14, -10, 18))
    page.page.click("#measurement-list button.note")
    page.page.keyboard.press("Enter")
    until_noted(page, 2)
    told = page.page.inner_text("#measurement-list p").removeprefix("At rest: ")
    assert texts(page)[1][1] == f"Distance 1: {told} (at rest)"
    with page.page.expect_download() as saved:
        page.page.click("#notes-save")
    with open(saved.value.path()) as file:
        assert [row["note"] for row in csv.DictReader(file)] == [texts(page)[0][1], texts(page)[1][1]]
    page.page.screenshot(path=album / "notes.png")
    page.session.stop()
    write_records(path, [page.session])
    page.session.journal = None  # it is removed
    record = pp.read_record(path)
    assert [note.text for note in record.notes] == [f"{CLEAN} rwc 12", f"Distance 1: {told} (at rest)"]
    nodes = page.session.mesh.nodes
    assert np.linalg.norm(nodes - record.notes[0].point, axis=1).min() < 8
    replayed = opened(replay=record)
    until_noted(replayed, 2)  # each once its tick has come
    assert [row[1] for row in texts(replayed)] == [note.text for note in record.notes]
    assert replayed.page.locator("#note-list button:visible").count() == 0
    assert not replayed.page.locator("#note-kind").is_visible()
    replayed.page.screenshot(path=album / "notes-replay.png")


def test_keys_alone_write_a_note_and_remove_it(opened):
    page = opened()
    keyboard = page.page.keyboard
    page.page.locator("#view").focus()
    for key in ("6", "k", "k", "k", " "):
        keyboard.press(key)
    assert page.see("document.activeElement.id") == "note-text"
    assert "not recorded" in page.page.inner_text("#note-where")
    keyboard.press("Escape")
    assert page.see("document.activeElement.id") == "view"
    keyboard.press(" ")
    keyboard.press("Enter")  # without a text
    assert page.page.locator("#note-form").is_visible()
    keyboard.type("a" * 250)
    keyboard.press("Enter")
    until_noted(page, 1)
    assert texts(page)[0][1] == "a" * 200
    page.page.get_by_role("button", name="Remove Note 1").press("Enter")
    page.wait("document.getElementById('notes').hidden")
    assert page.session.events.notes == ()


def test_every_page_has_the_notes_and_one_that_is_none_is_refused(opened):
    page = opened()
    base, token = page.address.split("/?")
    socket = f"{base.replace('http', 'ws')}/socket?{token}"
    note = encode(Note(0, 0, (0.0, 0.0, 25.0)))
    with connect(socket, origin=base) as other:
        other.send(note + b"from another page")
        until_noted(page, 1)
    for bad in (note, note + b"\xff", note + b"a" * 801, encode(Note(2, 0, (0, 0, 25))) + b"a"):
        with connect(socket, origin=base) as other:
            other.send(bad)
            with pytest.raises(ConnectionClosed) as closed:
                deque(other_frames(other), maxlen=0)
            assert closed.value.rcvd.code == 1008, bad
    assert len(page.session.events.notes) == 1


@pytest.mark.parametrize(("viewport", "scheme"), [(PHONE, "dark"), (LAPTOP, "light")])
def test_the_form_fits_and_axe_finds_nothing(opened, album, viewport, scheme):
    page = opened(viewport, scheme)
    page.page.click("#tool >> text=Measure")
    page.page.click("#note-kind")
    for text in ("a hard place under the skin, felt best from the left", ""):
        click(page, (-16 + len(text) / 2, -12, 18))
        page.page.keyboard.type(text or "x")
        if text:
            page.page.keyboard.press("Enter")
            until_noted(page, 1)
    assert page.see("document.documentElement.scrollWidth") == viewport["width"]
    assert Axe().run(page.page).response["violations"] == []
    page.page.screenshot(path=album / f"notes-{viewport['width']}.png")
