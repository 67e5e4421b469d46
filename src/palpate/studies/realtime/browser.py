"""The page in a real Chromium without a screen, stroked by real pointer events: pictures a second, and how late they are.

Seen from outside: calls of the graphics interface are counted, and the page's commands are watched on their way to its
worker, so that the page is not asked how well it does. A monitor's own delay is not in it.
"""

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from palpate.report.tables import Row
from palpate.server.loopback_server import loopback_socket
from palpate.server.touch import serving
from palpate.simulation.session import Session
from palpate.studies.deformation.kidney import kidney
from palpate.studies.realtime.config import Setting
from palpate.tissue.models.registry import model

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
# As Chromium draws where there is no graphics card. With --use-angle=swiftshader it would put the whole page together
# through the software's graphics card as well: three times slower.
SOFTWARE = ["--enable-unsafe-swiftshader"]
HARDWARE = ["--use-gl=angle", "--ignore-gpu-blocklist", "--enable-gpu"]
LAPTOP = {"width": 1280, "height": 800}
WARM = 1.0  # s of strokes before counting
EVENT = 16  # ms between moves of the pointer

# A picture: animation frames in which the organ's canvas is drawn on. A delay: from a pointer event to the first picture
# of a frame that obeys the command sent for it.
WATCHER = """(() => {
  const seen = (window.__seen = { pictures: [], delays: [] });
  const sent = [];
  let event = 0, beat = 0, drawn = -1;
  const count = () => { beat++; requestAnimationFrame(count); };
  requestAnimationFrame(count);
  for (const move of ["pointerrawupdate", "pointermove"])
    addEventListener(move, (e) => (event = e.timeStamp), true);
  const serial = (m) => m && typeof m === "object"
    ? (typeof m.serial === "number" ? m.serial : serial(m.command)) : undefined;
  const post = Worker.prototype.postMessage;
  Worker.prototype.postMessage = function (message, ...rest) {
    const number = serial(message);
    if (number !== undefined && event) { sent.push([number, event]); event = 0; }
    return post.call(this, message, ...rest);
  };
  for (const name of ["drawElements", "drawArrays"]) {
    const draw = WebGL2RenderingContext.prototype[name];
    WebGL2RenderingContext.prototype[name] = function (...given) {
      const done = draw.apply(this, given);
      if (this.canvas.id === "view" && drawn !== beat) {
        drawn = beat;
        const now = performance.now(), obeyed = window.palpate?.frame?.serial ?? -1;
        seen.pictures.push(now);
        while (sent.length && sent[0][0] <= obeyed) seen.delays.push(now - sent.shift()[1]);
      }
      return done;
    };
  }
})();"""


def pages(setting: Setting, resolution: str, edge: float) -> dict[str, list[Row]]:
    """Of one resolution, each way of drawing, by software and, where there is one, by a graphics card."""
    rows: list[Row] = []
    tissue = kidney(edge)
    for rendering, arguments in (("software", SOFTWARE), ("hardware", HARDWARE)):
        with launched(arguments) as (browser, missing):
            if browser is None:
                return {"pages": [{"resolution": resolution, "missing": missing}]}
            name = renderer(browser)
            if (rendering == "hardware") == any(word in name for word in ("SwiftShader", "llvmpipe", "none")):
                continue  # no card here
            with serving(Session(model(tissue, "compliance")), loopback_socket(None)) as address:
                for mode in setting.modes:
                    row = {"resolution": resolution, "triangles": len(tissue.mesh.surface), "mode": mode}
                    rows.append(
                        row | {"rendering": rendering, "renderer": name} | seen(setting, browser, address, mode)
                    )
    return {"pages": rows}


@contextmanager
def launched(arguments: list[str]) -> Iterator[tuple[Any, str]]:
    """A browser, or None and what is missing."""
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        yield None, "the Python package playwright is missing: pip install playwright"
        return
    if found is None:
        yield None, "no Chromium on the PATH: apt-get install chromium"
        return
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=["--no-sandbox", "--no-first-run", *arguments])
        yield browser, ""
        browser.close()


def renderer(browser: Any) -> str:
    """What draws, by its own name."""
    page = browser.new_page()
    name = page.evaluate(
        "(() => { const gl = document.createElement('canvas').getContext('webgl2'); if (!gl) return 'none';"
        " const named = gl.getExtension('WEBGL_debug_renderer_info');"
        " return String(gl.getParameter(named ? named.UNMASKED_RENDERER_WEBGL : gl.RENDERER)); })()"
    )
    page.close()
    return str(name)


def seen(setting: Setting, browser: Any, address: str, mode: str) -> Row:
    """Strokes the organ in one way of drawing."""
    context = browser.new_context(viewport=LAPTOP)
    page = context.new_page()
    page.add_init_script(WATCHER)
    page.goto(address)
    while not page.evaluate("Boolean(window.palpate && palpate.frame)"):
        page.wait_for_timeout(50)
    if mode != "Smooth":
        wanted = page.get_by_role("button", name=mode)
        if not wanted.is_visible():
            page.get_by_role("button", name="More").click()
        wanted.click()
    box = page.locator("#view").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + 0.45 * box["height"]
    page.mouse.move(x, y)
    page.mouse.down()
    stroke(page, x, y, WARM)
    page.evaluate("(__seen.pictures.length = 0, __seen.delays.length = 0)")
    events = stroke(page, x, y, setting.watched)
    pictures = np.array(page.evaluate("__seen.pictures"))
    delays = np.array(page.evaluate("__seen.delays"))
    page.mouse.up()
    context.close()
    gaps = np.diff(pictures)
    row: Row = {"pictures_a_second": 1e3 / float(gaps.mean()) if len(gaps) else 0.0, "events": events}
    row |= {"gap_p99_ms": float(np.quantile(gaps, 0.99)) if len(gaps) else None, "delays": len(delays)}
    for q in (0.5, 0.99):
        row[f"delay_p{100 * q:g}_ms"] = float(np.quantile(delays, q)) if len(delays) else None
    return row


def stroke(page: Any, x: float, y: float, seconds: float) -> int:
    """To and fro over the organ; the number of events."""
    end, events = time.perf_counter() + seconds, 0
    while time.perf_counter() < end:
        page.mouse.move(x + abs(events % 80 - 40), y + events % 7)
        page.wait_for_timeout(EVENT)
        events += 1
    return events
