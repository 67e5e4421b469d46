"""A page that shows a served session, for the tests of it."""

from contextlib import ExitStack, contextmanager

import numpy as np
import pytest

from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import serving
from support.browser import LAPTOP, PATIENCE, Seen

RECORD_HINTS = """(() => {
    window.hints = [];
    const hint = document.getElementById('hint');
    const told = new MutationObserver(() => hints.push(hint.textContent));
    told.observe(hint, { childList: true, characterData: true, subtree: true });
})()"""


class Touched(Seen):
    """A served session and the page that shows it."""

    def __init__(self, session, page):
        super().__init__(page)
        self.session = session

    def wait(self, expression, seconds=PATIENCE):
        super().wait(expression, seconds, told="palpate.frame")

    def open(self, address):
        self.page.goto(address)
        self.wait("Boolean(window.palpate && palpate.frame)")
        self.see(RECORD_HINTS)

    def until_told(self, words):
        """Until the hint has said that: a busy machine may look at the page after the message has gone."""
        self.wait(f"hints.some((hint) => hint.includes('{words}'))")

    def place(self, across=0.5, down=0.42):
        """A pixel of the organ's canvas."""
        box = self.page.locator("#view").bounding_box()
        return np.array([box["x"] + across * box["width"], box["y"] + down * box["height"]])

    def settle(self, ticks=250):
        """Until force and displacement of one body have stood still for that many ticks, and in frames of three: frames
        alone may come late, and repeat, and the first one of a page that was busy may be one of long after."""
        seen, body, still = [], None, np.full(28, np.inf)
        for _ in range(600):
            frame = self.see("palpate.frame")
            now = np.array([*frame["force"], *frame["displacement"], *frame["insertion"]])
            if frame["body"] != body or (np.abs(now - still) > 2e-4 * np.maximum(np.abs(now).max(), 0.1)).any():
                seen, body, still = [frame["tick"]], frame["body"], now
            elif frame["tick"] != seen[-1]:
                seen.append(frame["tick"])
            if len(seen) >= 3 and seen[-1] - seen[0] >= ticks:
                return
            self.page.wait_for_timeout(50)
        pytest.fail(f"the force does not settle: {still}")

    def drag(self, start, way, steps=12):
        self.page.mouse.move(*start)
        self.page.mouse.down()
        for i in range(1, steps + 1):
            self.page.mouse.move(*(start + way * i / steps))
            self.page.wait_for_timeout(15)

    def tool(self, number=0):
        """Point, displacement, force (mm, N) and grip of one tool in the newest frame."""
        frame = self.see("palpate.frame")
        three = [np.array(frame[name][3 * number : 3 * number + 3]) for name in ("point", "displacement", "force")]
        return *three, frame["contact"][number]

    def read(self, force):
        """Waits until the force that is read is this one, N."""
        self.wait(f"Math.abs(document.getElementById('force').textContent - {np.linalg.norm(force)}) <= 0.011")

    def until_home(self):
        self.wait("palpate.frame.contact.every((g) => g === 0) && palpate.frame.count === 0")


def agrees_with_push(touched, number=0):
    """The force read from the page, against the model's own answer for the same point and displacement."""
    point, displacement, force, _ = touched.tool(number)
    radius = touched.session.settings.radius
    expected = touched.session.model.push(point, displacement, radius, tolerance=1e-4).force
    assert np.linalg.norm(expected) > 0.1
    assert np.linalg.norm(force - expected) <= 0.02 * np.linalg.norm(expected)
    touched.read(force)


@contextmanager
def served_pages(browser, kind=Touched):
    """Gives what opens a page of a served session. At the end all are closed, and none may have had an error."""
    with ExitStack() as closing:
        pages = []

        def open_page(session, title, viewport=LAPTOP, scheme="light", script=None, **serve):
            touch = viewport is not LAPTOP
            context = browser.new_context(viewport=viewport, color_scheme=scheme, has_touch=touch, is_mobile=touch)
            if script:
                context.add_init_script(script)
            pages.append(kind(session, context.new_page()))
            address = closing.enter_context(serving(session, loopback_socket(None), title=title, **serve))
            closing.callback(context.close)
            pages[-1].open(address)
            return pages[-1]

        yield open_page
    assert [page.problems for page in pages if page.problems] == []
