"""Organs beside each other in a real Chromium: one is pressed, and moves the other."""

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from support.brick_meshes import brick
from support.browser import LAPTOP
from support.running_server import until
from support.touch_page import Touched, agrees_with_push

import palpate as pp
from palpate.server.live_session import LiveSession
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import running_session
from palpate.simulation.pointer import Pointer

pytestmark = pytest.mark.browser


def block(cells, at, name):
    made = brick(cells, (30, 30, 40))
    mesh = pp.TetMesh(made.nodes + at, made.tets, made.region, {1: name})
    return pp.Tissue(mesh, 5.0, 0.4, mesh.nodes[:, 1] == 30 + at[1])  # held at the back


@pytest.fixture
def touched(browser):
    """A front block, and one behind it that stands back to front against it, 0.2 mm away."""
    front = block((5, 5, 6), (0, 0, 0), "front")
    front = front.replace(fixed=front.mesh.nodes[:, 2] == 0)
    behind = block((6, 4, 6), (0, 30.2, 0), "behind")
    session = pp.Session(pp.model(pp.join_tissues([front, behind]), "compliance"), radius=9.0, sweeps=2)
    live = LiveSession(session, Pointer(), "Two organs")
    with running_session(live, loopback_socket(None)) as address:
        context = browser.new_context(viewport=LAPTOP)
        opened = Touched(session, context.new_page())
        opened.open(address)
        yield opened
        context.close()


def test_a_pressed_organ_moves_the_one_behind_it(touched):
    assert "front, behind" in touched.page.text_content("#about")
    touched.page.mouse.move(*touched.place(down=0.3))
    touched.page.mouse.down()
    until(lambda: np.linalg.norm(touched.session.frame().force[0]) > 0.01)
    touched.settle()
    agrees_with_push(touched)
    drawn, session = touched.session.displayed, touched.session
    moved = np.linalg.norm(session.drawn(session.frame()), axis=1)
    assert 0.05 < moved[drawn.organ == 1].max() < moved[drawn.organ == 0].max()


def test_organs_have_colours_of_their_own(touched):
    assert touched.page.evaluate("palpate.scene.beside") == ["front", "behind"]
    touched.drag(np.array([100.0, 500.0]), np.array([240.0, 0.0]))  # the view turns, so that both are seen
    touched.page.mouse.up()
    r, g, b = touched.still()[150:650, 150:800, :3].astype(int).transpose(2, 0, 1)
    red = (r > 1.6 * g) & (r > 60)
    ochre = (r > 1.15 * g) & (r < 1.55 * g) & (g > 1.3 * b)
    assert red.sum() > 2000
    assert ochre.sum() > 2000
    assert Axe().run(touched.page).violations_count == 0
