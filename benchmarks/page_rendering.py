"""The page in a headless Chromium that draws by software: frames a second, work of its thread, delay from hand to picture.

Two organs, plain, the second as tissue too: 100,000 triangles streamed 60 times a second (made up: the page's work,
no model's), and a small organ under the real loop, stroked with real pointer events. The page's own clock ends when
it has handed the picture to the browser; rasterising goes on in the GPU process, whose time is given apart. A
monitor's own delay is not in any of it.
"""

import bisect
import contextlib
import json
import os
import re
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import psutil

import palpate as pp
from benchmarks.page_stream import stream, streaming
from palpate.samples import sample
from palpate.server.loopback_server import loopback_socket
from palpate.server.messages import ToolCommand
from palpate.studies.realtime.browser import SOFTWARE

SECONDS, TRACED = 8, 4
ARGUMENTS = ["--no-sandbox", *SOFTWARE]
HARDWARE = "PALPATE_BENCH_GPU"  # set: draw with the graphics card, if Chromium finds one
WANTED = {"CrRendererMain": "main", "DedicatedWorker thread": "worker", "CrGpuMain": "raster"}
TASK = "ThreadControllerImpl::RunTask"  # in a trace: all that a thread does
WIDE = {"width": 1280, "height": 800}


@dataclass(frozen=True)
class Seen:
    """One organ's figures. sent, drawn: a second. work: ms of the page's thread for a frame, by its clock: median, 99 %.

    main: processor ms of the page's thread for a picture, all that page and browser do there: mean as the system counts
    it, then median and 99 % from a trace, which slows it. worker: CPU ms of that thread for a picture, raster: wall ms of
    the GPU process's main thread, both from the trace. delay: ms from a pointer event to the end of drawing what obeys
    it: median, 99 %, count.
    """

    name: str
    triangles: int
    sent: float
    drawn: float
    work: tuple[float, float]
    main: tuple[float, float, float]
    worker: float
    raster: float
    delay: tuple[float, float, int] | None
    renderer: str


def lines() -> Iterator[str]:
    """The table."""
    from playwright.sync_api import sync_playwright

    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if found is None:
        yield "no Chromium on the PATH: apt-get install chromium"
        return
    with sync_playwright() as playwright:
        hardware = bool(os.environ.get(HARDWARE))
        arguments = ARGUMENTS[:1] if hardware else ARGUMENTS
        chromium = playwright.chromium.launch(executable_path=found, args=arguments)
        yield (
            "| organ | triangles | sent /s | drawn /s | work of a frame, ms (99 %) "
            "| processor time of that thread, ms (traced: median, 99 %) | worker, CPU ms | GPU process, ms "
            "| hand to picture, ms (99 %, events) |"
        )
        yield "|---|---|---|---|---|---|---|---|---|"
        made_up = stream(71)
        made_up.obey(ToolCommand(0, 1, 1, (0.0, 0.0, 25.0), (0.0, 0.0, -6.0)))
        made_up.swings = True
        with streaming([made_up], loopback_socket(None)) as address:
            seen = measured(chromium, address, "made up", lambda: made_up.sent)
            yield row(seen)
        with small() as (address, name):
            yield row(measured(chromium, address, name, None))
            yield row(measured(chromium, address, f"{name}, tissue", None, look="tissue"))
        chromium.close()
    yield f"\nDrawn by {seen.renderer}. Work: decoding, normals and colours are in the worker."


def row(seen: Seen) -> str:
    """Of the table."""
    sent = "–" if seen.sent != seen.sent else f"{seen.sent:.0f}"
    delay = f"{seen.delay[0]:.0f} ({seen.delay[1]:.0f}, {seen.delay[2]})" if seen.delay else "–"
    return (
        f"| {seen.name} | {seen.triangles:,} | {sent} | {seen.drawn:.0f} | {seen.work[0]:.1f} ({seen.work[1]:.1f}) "
        f"| {seen.main[0]:.1f} ({seen.main[1]:.1f}, {seen.main[2]:.1f}) | {seen.worker:.1f} | {seen.raster:.1f} "
        f"| {delay} |"
    )


@contextlib.contextmanager
def small() -> Iterator[tuple[str, str]]:
    """The sample CT's left kidney with edges of 6 mm, under the real loop, served by a process of its own."""
    labels = pp.read_labels(sample("abdomen") / "labels.nii.gz")
    mesh = pp.tetrahedralize(labels, label="kidney_left", edge=6.0)
    tissue = pp.Tissue(mesh, 15.0, 0.45, pp.resting_on(mesh, (0, 1, 0), depth=12.0))
    with tempfile.TemporaryDirectory() as folder:
        pp.write_tissue(f"{folder}/kidney.vtu", tissue)
        touch = [
            sys.executable,
            "-m",
            "palpate",
            "touch",
            f"{folder}/kidney.vtu",
            "--model",
            "compliance",
            "--no-browser",
        ]
        served = subprocess.Popen(touch, stdout=subprocess.PIPE, text=True)
        assert served.stdout is not None
        try:
            found = next(filter(None, (re.search(r"http://\S+", line) for line in served.stdout)))
            yield found[0], "kidney, real loop"
        finally:
            served.send_signal(signal.SIGINT)
            served.communicate(timeout=30)


def measured(chromium: Any, address: str, name: str, sent: Any, look: str = "plain") -> Seen:
    """Strokes the organ for some seconds, then for some more while the browser is traced. Effects do not step down."""
    page = chromium.new_context(viewport=WIDE).new_page()
    page.add_init_script(f"localStorage.setItem('palpate-look', '{look}')")
    page.goto(address)
    while not page.evaluate("Boolean(window.palpate && palpate.frame)"):
        page.wait_for_timeout(100)
    page.evaluate("palpate.appearance.count = () => {}")
    size = page.evaluate("[document.getElementById('view').clientWidth, document.getElementById('view').clientHeight]")
    x, y = 0.5 * size[0], 0.45 * size[1]
    if sent is None:
        page.mouse.move(x, y)
        page.mouse.down()
    stroke(page, x, y, 2.0, sent is None)  # shaders are compiled, code is warm
    pictures, before = page.evaluate("palpate.framesDrawn"), sent() if sent else 0
    page.evaluate("palpate.work.length = 0")
    before_it = renderers()
    began = time.perf_counter()
    events = stroke(page, x, y, SECONDS, sent is None)
    took = time.perf_counter() - began
    spent = max(now - before_it.get(process, 0) for process, now in renderers().items())  # the others wait
    drawn = page.evaluate("palpate.framesDrawn") - pictures
    came = (sent() - before) if sent else float("nan")
    work = sorted(page.evaluate("palpate.work.slice()"))
    delay = page.evaluate(f"palpate.latency({events or 1})")
    pictures = page.evaluate("palpate.framesDrawn")
    chromium.start_tracing(page=page, categories=["toplevel", "devtools.timeline"])  # which slows it
    stroke(page, x, y, TRACED, sent is None)
    traced = page.evaluate("palpate.framesDrawn") - pictures
    trace = json.loads(chromium.stop_tracing())
    total, each = threads(trace), sorted(per_picture(trace))
    renderer = page.evaluate(
        "(() => { const gl = document.createElement('canvas').getContext('webgl2');"
        " return gl.getParameter(gl.getExtension('WEBGL_debug_renderer_info').UNMASKED_RENDERER_WEBGL); })()"
    )
    triangles = page.evaluate("palpate.scene.triangles")
    page.context.close()
    return Seen(
        name, triangles, came / took, drawn / took, (statistics.median(work), work[int(0.99 * (len(work) - 1))]),
        (1000 * spent / drawn, statistics.median(each), each[int(0.99 * (len(each) - 1))]),
        total["worker"] / traced, total["raster"] / traced,
        (delay["median"], delay["p99"], delay["count"]) if events else None, renderer,
    )  # fmt: skip


def stroke(page: Any, x: float, y: float, seconds: float, hand: bool) -> int:
    """A finger that goes to and fro; gives the number of events. Without a hand only time goes by."""
    if not hand:
        page.wait_for_timeout(1000 * seconds)
        return 0
    end, events = time.perf_counter() + seconds, 0
    while time.perf_counter() < end:
        page.mouse.move(x + abs(events % 80 - 40), y + events % 7)
        page.wait_for_timeout(15)
        events += 1
    return events


def events(trace: Any) -> Iterator[tuple[str, Any]]:
    """Whole events of a trace, with the thread of `WANTED` that they are of."""
    names = {(e["pid"], e["tid"]): e["args"]["name"] for e in trace["traceEvents"] if e["name"] == "thread_name"}
    for event in trace["traceEvents"]:
        part = WANTED.get(names.get((event["pid"], event["tid"]), ""))
        if part and event.get("ph") == "X":
            yield part, event


def threads(trace: Any) -> Counter[str]:
    """ms of the page's worker (CPU) and of the GPU process's main thread (wall)."""
    total: Counter[str] = Counter()
    for part, event in events(trace):
        if event["name"] == TASK:
            total[part] += event.get("dur" if part == "raster" else "tdur", 0) / 1000
    return total


def per_picture(trace: Any) -> list[float]:
    """CPU ms of the page's thread, all its tasks from one animation frame to the next, for each of them."""
    main = sorted((e for part, e in events(trace) if part == "main"), key=lambda e: e["ts"])
    turns = [e["ts"] for e in main if e["name"] == "FireAnimationFrame"]
    spent = [0.0] * len(turns)
    for task in main:
        if task["name"] == TASK and (at := bisect.bisect_left(turns, task["ts"] + task["dur"])) > 0:
            spent[at - 1] += task.get("tdur", 0) / 1000
    return spent[1:-1]  # the first and the last are not whole


def renderers() -> dict[int, float]:
    """Processor seconds of the main thread of each of the browser's processes that may hold a page; Linux."""
    seconds = {}
    for process in psutil.process_iter(["cmdline"]):
        if any("--type=renderer" in word for word in process.info["cmdline"] or []):
            own = next(thread for thread in process.threads() if thread.id == process.pid)
            seconds[process.pid] = own.user_time + own.system_time
    return seconds
