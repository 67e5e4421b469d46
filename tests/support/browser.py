"""A real Chromium for the tests of the pages."""

import io
import os
import shutil
from contextlib import contextmanager

import pytest

# The first is Chromium without its windows: a page opens with a sixth of the work.
BROWSERS = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
ARGUMENTS = [
    "--no-sandbox",
    "--enable-unsafe-swiftshader",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-default-apps",
]
PATIENCE = 90  # s: on a busy machine without a graphics card a picture takes seconds
LAPTOP, PHONE = {"width": 1280, "height": 800}, {"width": 390, "height": 844}


# Pages begin with the plain look, which a processor draws in less time; the tests of tissue choose it.
PLAIN = "try { localStorage.getItem('palpate-look') ?? localStorage.setItem('palpate-look', 'plain'); } catch {}"
# They draw some 15 times a second: without a graphics card drawing takes most of a test's work.
RARELY = """(() => {
    const frame = window.requestAnimationFrame.bind(window);
    let last = 0, newest = 0;
    const waiting = new Map();
    const draw = (id) => (time) => {
        const callback = waiting.get(id);
        waiting.delete(id);
        last = performance.now();
        callback?.(time);
    };
    window.requestAnimationFrame = (callback) => {
        waiting.set(++newest, callback);
        const id = newest;
        setTimeout(() => frame(draw(id)), Math.max(0, last + 60 - performance.now()));
        return id;
    };
    window.cancelAnimationFrame = (id) => waiting.delete(id);
})()"""


def draw_plainly(chromium, scripts=(PLAIN, RARELY)):
    """Pages are drawn with less work."""
    make_context = chromium.new_context

    def new_context(**options):
        context = make_context(**options)
        for script in scripts:
            context.add_init_script(script)
        return context

    chromium.new_context = new_context
    chromium.new_page = lambda **options: new_context(**options).new_page()


@contextmanager
def launched(draws=draw_plainly):
    """Chromium, or a skip that says what is missing; a failure where a browser is required. draws: how its pages draw."""
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        missing = "the Python package playwright is missing: pip install playwright"
    else:
        found = next(filter(None, map(shutil.which, BROWSERS)), None)
        missing = None if found else "no Chromium on the PATH: apt-get install chromium"
    if missing:
        (pytest.fail if os.environ.get("PALPATE_REQUIRE_BROWSER") == "1" else pytest.skip)(missing)
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=found, args=ARGUMENTS)
        draws(chromium)
        yield chromium
        chromium.close()


class Seen:
    """A page, what went wrong in it, and waiting without an eval, which the page's policy forbids."""

    def __init__(self, page):
        self.page = page
        self.page.set_default_timeout(1000 * PATIENCE)
        self.problems = []
        page.on("pageerror", lambda error: self.problems.append(str(error)))
        page.on("console", lambda line: line.type == "error" and self.problems.append(line.text))

    def see(self, expression):
        return self.page.evaluate(expression)

    def wait(self, expression, seconds=PATIENCE, told="null"):
        """Until the page finds `expression` true; `told`: what a failure shows of the page."""
        for _ in range(seconds * 20):
            if self.see(expression):
                return
            self.page.wait_for_timeout(50)
        pytest.fail(f"after {seconds} s still not: {expression}; {told} is {self.see(told)}")

    def pixels(self, what):
        """The picture of an element, (rows, columns, 3)."""
        from skimage.io import imread

        return imread(io.BytesIO(self.page.locator(what).screenshot()))[..., :3].astype(float)

    def still(self, what="#view"):
        """That picture once two looks at it are alike, between which the page has drawn twice: a busy one draws late."""
        before = None
        for _ in range(10 * PATIENCE):
            now = self.pixels(what)
            if before is not None and (now == before).all():
                return now
            before = now
            self.see(f"new Promise((done) => {2 * 'requestAnimationFrame(() => '}setTimeout(done, 100))))")
        pytest.fail(f"{what} is never still")
