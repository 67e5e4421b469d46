"""What the spread of a tissue's stiffness makes of the force, in a real Chromium."""

from contextlib import contextmanager

import numpy as np
import pytest
from support.brick_meshes import brick
from support.browser import LAPTOP
from support.touch_page import Touched

import palpate as pp
from palpate.server.live_session import LiveSession
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import running_session
from palpate.simulation.pointer import Pointer

pytestmark = pytest.mark.browser


@contextmanager
def pressed(browser, spread):
    """A block with a lump, pressed in its middle until it rests."""
    mesh = brick((6, 5, 6), (40, 30, 40), region=lambda x: np.where(np.linalg.norm(x - (20, 8, 20), axis=1) < 8, 2, 1))
    named = pp.TetMesh(mesh.nodes, mesh.tets, mesh.region, {1: "organ", 2: "lump"})
    tissue = pp.Tissue(named, {1: 5.0, 2: 40.0}, 0.4, mesh.nodes[:, 1] == 30, young_spread=spread)
    session = pp.Session(pp.model(tissue, "compliance"), radius=9.0, sweeps=2)
    with running_session(LiveSession(session, Pointer(), "A lump"), loopback_socket(None)) as address:
        context = browser.new_context(viewport=LAPTOP)
        opened = Touched(session, context.new_page())
        opened.open(address)
        opened.page.mouse.move(*opened.place())
        opened.page.mouse.down()
        opened.settle()
        yield opened
        context.close()


def test_the_band_is_that_of_push(browser, album):
    with pressed(browser, {"organ": 1.0, "lump": 20.0}) as touched:
        touched.wait("palpate.frame.stiffness_spread > 0 && !document.getElementById('spread-row').hidden")
        frame = touched.session.frame()
        answer = touched.session.model.push(frame.point[0], frame.displacement[0], 9.0)
        told = touched.page.evaluate("palpate.frame.stiffness_spread")
        assert told == pytest.approx(answer.estimate.stiffness, rel=0.01)
        assert 0.05 < told < 0.5
        band = float(touched.page.text_content("#spread").removeprefix("± ").removesuffix(" N"))
        assert band == pytest.approx(told * np.linalg.norm(answer.force), abs=0.006)
        touched.page.screenshot(path=album / "spread.png")


def test_of_a_stiffness_without_a_spread_nothing_is_shown(browser):
    with pressed(browser, 0.0) as touched:
        touched.wait("palpate.frame.stiffness_spread === 0")
        assert touched.page.evaluate("document.getElementById('spread-row').hidden")
