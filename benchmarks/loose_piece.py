"""A picture of a piece that is cut out and lifted: python -m benchmarks.loose_piece docs/images/piece-lifted.jpg.

The kidney of the sample in the page of `palpate touch`, in Chromium: a stroke through its lower pole, from beside it to
beside it, then two jaws that take the piece.
"""

import argparse
import shutil
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

import palpate as pp
from palpate.atomic_write import replacing
from palpate.server.live_session import LiveSession
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import running_session
from palpate.simulation.pointer import Pointer
from palpate.studies.deformation.kidney import kidney

EDGE = 5.0  # mm


def drag(page: Page, start: tuple[float, float], end: tuple[float, float]) -> None:
    """The pointer goes down at a pixel and moves to another one."""
    page.mouse.move(*start)
    page.mouse.down()
    for i in range(1, 41):
        page.mouse.move(*(a + (b - a) * i / 40 for a, b in zip(start, end, strict=True)))
        page.wait_for_timeout(20)


def wait(page: Page, expression: str) -> None:
    """Until the page finds it true, whose policy forbids an eval."""
    while not page.evaluate(expression):
        page.wait_for_timeout(50)


def operate(page: Page) -> None:
    """Cuts the pole off and lifts it."""
    wait(page, "Boolean(window.palpate && palpate.frame)")
    page.locator('[data-value="tissue"]').first.click()
    page.keyboard.press("5")
    page.locator("#amount").fill(page.locator("#amount").get_attribute("max") or "")
    box = page.locator("#view").bounding_box()
    assert box
    middle = (box["x"] + 0.56 * box["width"], box["y"] + 0.7 * box["height"])
    drag(page, (middle[0] - 109, middle[1] + 36), (middle[0] + 160, middle[1] - 40))
    page.mouse.up()
    wait(page, "palpate.pieces().length > 0")
    page.keyboard.press("3")
    x, y = page.evaluate("palpate.pieces()[0].pixel")
    drag(page, (x, y), (x + 150, y + 60))
    page.wait_for_timeout(3000)


def main(picture: Path) -> None:
    """Takes the picture."""
    tissue = kidney(EDGE).replace(element="smoothed")
    materials = dict.fromkeys(tissue.mesh.region.tolist(), "kidney")
    session = pp.Session(pp.model(tissue.replace(materials=materials), "compliance"))
    live = LiveSession(session, Pointer(), "Kidney")
    with running_session(live, loopback_socket(None)) as address, sync_playwright() as play:
        browser = play.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox", "--enable-unsafe-swiftshader"]
        )
        page = browser.new_page(viewport={"width": 1280, "height": 800}, color_scheme="light")
        page.goto(address)
        operate(page)
        with replacing(picture) as temporary:
            page.screenshot(path=temporary, type="jpeg", quality=85)
        browser.close()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.loose_piece", description=__doc__.splitlines()[0])
    parser.add_argument("picture", type=Path, help=".jpg")
    main(parser.parse_args().picture)
