"""A piece that is cut out in a real Chromium: it lies, is taken out by the hand, and falls when that lets go."""

import numpy as np
import pytest
from support.browser import LAPTOP
from support.example_organs import organ
from support.open_rooms import open_rooms
from support.touch_page import Touched

import palpate as pp
from palpate.server.live_session import LiveSession
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import running_session
from palpate.simulation.pointer import ContactState, PieceState, Pointer

pytestmark = pytest.mark.browser
CARRIED = f"palpate.pieces()[0]?.state === {int(PieceState.carried)}"


@pytest.fixture(scope="module")
def model():
    tissue = organ(10)
    return pp.model(tissue.replace(materials=dict.fromkeys(tissue.mesh.names, "liver")), "compliance")


@pytest.fixture
def opened(browser, model):
    """Gives pages of one session."""
    live = LiveSession(pp.Session(model, radius=8.0, sweeps=2), Pointer(), "Test organ")
    contexts = []
    with running_session(live, loopback_socket(None)) as address:

        def page():
            contexts.append(browser.new_context(viewport=LAPTOP, color_scheme="light"))
            touched = Touched(live.session, contexts[-1].new_page())
            touched.live = live
            touched.open(address)
            return touched

        yield page
        for context in contexts:
            context.close()


@pytest.fixture
def room(browser, tmp_path):
    """Gives pages of people in one room."""
    pp.write_tissue(tmp_path / "organ.vtu", organ(10))
    with open_rooms([pp.RoomFile("anatomy", (tmp_path / "organ.vtu",), title="Organ")], tmp_path) as rooms:
        contexts = []

        def enter(role, name):
            contexts.append(browser.new_context(viewport=LAPTOP, color_scheme="light"))
            touched = Touched(None, contexts[-1].new_page())
            touched.open(rooms.address("anatomy", role, name))
            return touched

        yield enter
        for context in contexts:
            context.close()


def drag(touched, start, way, steps=40, pause=15):
    """Holds the pointer down and moves it; it stays down."""
    touched.page.mouse.move(*start)
    touched.page.mouse.down()
    for i in range(1, steps + 1):
        touched.page.mouse.move(*(start + way * i / steps))
        touched.page.wait_for_timeout(pause)


def cut_off_the_top(touched):
    """Through the organ along the line of sight, from edge to edge, until the page shows the piece."""
    page = touched.page
    page.click("#cut-tool")
    page.locator("#amount").fill(str(touched.see("document.getElementById('amount').max")))
    start, end = (np.array(touched.see(f"palpate.pixel({point})")) for point in ([-34.5, 0, 9], [34.5, 0, 9]))
    drag(touched, start, 1.2 * (end - start))
    page.mouse.up()
    touched.until_told("came free")
    touched.wait("palpate.scene.body === palpate.frame.body && palpate.pieces().length > 0")


def test_a_piece_is_cut_out_lifted_out_and_falls(opened, album):
    touched = opened()
    page, session = touched.page, touched.session
    cut_off_the_top(touched)
    piece = session.pieces[0]
    assert session.mesh.volumes.sum() + sum(one.volume for one in session.pieces) == pytest.approx(
        session.first.tissue.mesh.volumes.sum(), rel=1e-9
    )
    touched.wait(f"palpate.pieces()[0].state === {int(PieceState.lying)}")
    page.wait_for_timeout(400)
    page.screenshot(path=album / "piece-lying.png")
    page.click('#tool [data-value="grasp"]')
    start = np.array(touched.see("palpate.pieces()[0].pixel"))
    drag(touched, start, np.array((60.0, -150.0)))
    touched.wait(CARRIED)
    touched.wait(f"palpate.frame.contact.slice(0, 2).every((state) => state === {int(ContactState.carrying)})")
    touched.wait("Math.hypot(...palpate.pieces()[0].offset) > 15")
    page.wait_for_timeout(500)
    page.screenshot(path=album / "piece-carried.png")
    held = touched.see("palpate.heldPixel()")
    assert held == pytest.approx((start + (60, -150)).tolist(), abs=3), "what was taken is under the pointer"
    now = touched.see("palpate.pieces()[0]")
    assert now["offset"] == pytest.approx(session.frame().piece_offset[0], abs=1e-3)
    forces = np.reshape(touched.see("palpate.frame.force"), (4, 3))[:2]
    assert forces.sum(axis=0) == pytest.approx([0, 0, -piece.weight], abs=1e-5)
    page.mouse.up()
    touched.until_told("ml lifted out at")
    touched.wait(f"palpate.pieces()[0].state === {int(PieceState.gone)}")
    page.keyboard.press("z")
    touched.wait("palpate.scene.made === 0 && palpate.pieces().length === 0")
    assert session.mesh.volumes.sum() == pytest.approx(session.first.tissue.mesh.volumes.sum(), rel=1e-12)
    assert touched.problems == []


def test_in_a_room_one_cuts_another_lifts_and_all_see_the_same(room, album):
    teacher, trainee = room("teacher", "Dr Gray"), room("trainee", "Ada")
    cut_off_the_top(teacher)
    trainee.wait("palpate.scene.body === palpate.frame.body && palpate.pieces().length > 0")
    trainee.page.click('#tool [data-value="pull"]')
    start = np.array(trainee.see("palpate.pieces()[0].pixel"))
    drag(trainee, start, np.array((-60.0, -120.0)))
    for page in (trainee, teacher):
        page.wait(CARRIED)
        page.wait("Math.hypot(...palpate.pieces()[0].offset) > 15")
    teacher.wait(f"palpate.hands.map((hand) => hand.contact).join() === '{int(ContactState.carrying)}'")
    trainee.settle()
    teacher.wait(f"palpate.pieces()[0].offset.join() === '{trainee.see('palpate.pieces()[0].offset.join()')}'")
    mine, theirs = (page.see("palpate.pieces()[0]") for page in (trainee, teacher))
    assert mine["pixel"] == pytest.approx(theirs["pixel"], abs=0.5), "both look from the same side"
    teacher.page.screenshot(path=album / "piece-in-a-room.png")
    trainee.page.mouse.up()
    for page in (trainee, teacher):
        page.wait(f"palpate.pieces()[0].state === {int(PieceState.gone)}")
        assert page.problems == []
